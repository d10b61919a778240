"""The truth beside a tracker sample: what reading, calibrating and mapping it should find."""

from __future__ import annotations

from typing import Any

import numpy as np
from retarget.core.calibration import POSES, SIDES
from retarget.samples import person
from retarget.samples.arm_reach import ARM_LENGTH, PALM
from retarget.samples.golden_json import rounded
from retarget.samples.primitive_poses import intended
from retarget.samples.takes import SHOULDER, Take
from retarget.samples.tasks import Circles
from retarget.samples.trackers import HAND_OFFSET
from retarget.samples.true_calibration import true_calibration


def golden(take: Take) -> dict[str, Any]:
    """Facts, and some frames of what truly happened, in the house's world. Free of the trackers' faults.

    `shoulder_m` and `hand_points_m` are in the operator frame: origin at the pelvis in the Still pose, +X where the person faces, as if
    the chest had neither swayed nor moved since. `basis_m` has columns S - sh, T - sh, F - sh.
    """
    recording, operator = take.recording, take.task.operator
    calibration = true_calibration(take)
    segment_of = {name: segment for segment, name in take.tracker_of.items()}
    content: dict[str, Any] = {
        "synthetic": "computed, not recorded from a person",
        "format": "tracker csv",
        "up": "y",
        "rate_hz": recording.source.rate_hz,
        "frames": take.motion.frames,
        "trackers": list(recording.trackers),
        "segments": [segment_of[name] for name in recording.trackers],
        "untracked_frames": dict(zip(recording.trackers, (~recording.tracked).sum(axis=0).tolist(), strict=True)),
        "heading_rad": rounded(take.heading_rad),
        "origin_m": rounded(calibration.origin),
        "windows_s": {name: rounded(window) for name, window in take.task.windows.items()},
        "tracker_rotation": {segment: rounded(mount.tracker_rotation) for segment, mount in take.mounts.items()},
        "tracker_position_m": {segment: rounded(mount.position) for segment, mount in take.mounts.items()},
        "hand_offset_m": {side: list(HAND_OFFSET) for side in SIDES},
        "bones_m": {
            "upper_arm": rounded(person.UPPER_ARM),
            "forearm": rounded(person.FOREARM),
            "wrist_to_hand_point": rounded(PALM),
        },
        "arm_length_m": rounded(ARM_LENGTH),
        "angles_deg": {side: rounded(arm.angles_deg) for side, arm in calibration.arms.items()},
        "shoulder_in_chest_m": {side: rounded(SHOULDER[side]) for side in SIDES},
        "shoulder_m": {side: rounded(arm.shoulder) for side, arm in calibration.arms.items()},
        "hand_points_m": {
            side: dict(zip(POSES, rounded(arm.hand_points), strict=True)) for side, arm in calibration.arms.items()
        },
        "basis_m": {side: rounded(arm.basis) for side, arm in calibration.arms.items()},
    }
    if isinstance(take.task, Circles):
        content["circles"] = {
            "turns": take.task.turns,
            "diameter_m": take.task.diameter,
            "period_s": take.task.period,
            "center_from_shoulder_m": {side: rounded(take.task.center(side)) for side in SIDES},
            "drawn_from_meant": {side: rounded(operator.basis(side) @ np.linalg.inv(intended(side))) for side in SIDES},
        }
    content["selected"] = [_frame(take, at) for at in _chosen(take)]
    return content


def _chosen(take: Take) -> list[int]:
    """First and last frame, thirds, and the middle of every window."""
    last, rate = take.motion.frames - 1, take.motion.source.rate_hz
    middles = [round((start + end) / 2 * rate) for start, end in take.task.windows.values()]
    return sorted({0, last // 3, 2 * last // 3, last, *middles})


def _frame(take: Take, at: int) -> dict[str, Any]:
    segments = list(take.mounts)
    return {
        "frame": at,
        "time_s": rounded(take.motion.time[at]),
        "orientation": {
            segment: rounded(take.motion.orientation[at, take.motion.index(segment)]) for segment in segments
        },
        "t8_m": rounded(take.position("T8")[at]),
        "shoulder_m": {side: rounded(take.position(f"{side}UpperArm")[at]) for side in SIDES},
        "elbow_m": {side: rounded(take.position(f"{side}ForeArm")[at]) for side in SIDES},
        "hand_point_m": {side: rounded(take.hand_point[side][at]) for side in SIDES},
    }
