"""A recording of calibrated trackers as a person's motion in the operator frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from retarget.core import rotations
from retarget.core.calibration import SIDES, Calibration
from retarget.core.errors import MotionError
from retarget.core.rotations import Array
from retarget.core.segments import SEGMENTS
from retarget.core.types import HumanMotion, TrackerRecording


def apply(calibration: Calibration, recording: TrackerRecording) -> HumanMotion:
    """The motion of the segments that trackers are strapped to: T8, Head, upper arms, hands, and the pelvis where it has one.

    Everything is in the operator frame: the world turned by `-heading_rad` about Z, its origin at `origin`. Orientations are
    R_tracker · tracker_rotation, the identity in T-pose facing +X. Positions: of T8, Head and Pelvis the tracker's own point; of the upper arms
    the live shoulder `p_ch + R_ch R_ch,Sᵀ (p_sh,S − p_ch,S)` [Lim2022 eq. 2]; of the hands the hand point, tracker + R · offset.

    A segment whose tracker is nowhere in the recording, or is never tracked, is not measured (position NaN, orientation that of the Still
    pose). Frames in which a tracker is lost keep the recording's interpolated or held values and are counted in the warnings.
    Raises `MotionError` when the recording is of other trackers than the calibration, or has them on other segments.
    """
    _check_trackers(calibration, recording)
    to_operator = rotations.exp([0.0, 0.0, -calibration.heading_rad])
    names = [segment for segment in SEGMENTS if segment in calibration.trackers]
    position = np.full((recording.frames, len(names), 3), np.nan)
    orientation = np.empty((recording.frames, len(names), 4))
    measured = np.zeros(len(names), bool)
    warnings: list[str] = []
    for column, segment in enumerate(names):
        tracker = calibration.trackers[segment]
        lost = _lost_frames(recording, tracker)
        if lost == recording.frames:
            orientation[:, column] = calibration.still_orientation[segment]
            warnings.append(f"{segment}: its tracker {tracker} is not tracked in any frame")
            continue
        if lost:
            warnings.append(f"{segment}: its tracker {tracker} is not tracked in {lost} of {recording.frames} frames")
        index = recording.index(tracker)
        turned = rotations.multiply(to_operator, recording.orientation[:, index])
        point = rotations.rotate(to_operator, recording.position[:, index] - calibration.origin)
        if segment.endswith("Hand"):
            offset = calibration.hand_offset_m.get(segment.removesuffix("Hand"), np.zeros(3))
            point = point + rotations.rotate(turned, offset)
        orientation[:, column] = rotations.multiply(turned, calibration.tracker_rotation[segment])
        position[:, column] = point
        measured[column] = True
    _place_shoulders(calibration, names, orientation, position, measured)
    return HumanMotion(
        time=recording.time,
        segments=tuple(names),
        orientation=rotations.make_continuous(rotations.normalize(orientation)),
        position=position,
        measured=measured,
        source=replace(recording.source, warnings=(*recording.source.warnings, *warnings)),
        calibration=calibration,
    )


def _place_shoulders(
    calibration: Calibration, names: list[str], orientation: Array, position: Array, measured: Array
) -> None:
    """Replace the upper arms' positions by the shoulders, which go with the chest; unknown where the chest is not tracked."""
    chest = names.index("T8") if "T8" in names and measured[names.index("T8")] else None
    for side in SIDES:
        if f"{side}UpperArm" not in names:
            continue
        column = names.index(f"{side}UpperArm")
        if chest is None or not measured[column]:
            position[:, column] = np.nan
            continue
        from_chest = calibration.arms[side].shoulder - calibration.chest_position
        turn = rotations.multiply(orientation[:, chest], rotations.conjugate(calibration.chest_orientation))
        position[:, column] = position[:, chest] + rotations.rotate(turn, from_chest)


def _lost_frames(recording: TrackerRecording, tracker: str) -> int:
    if tracker not in recording.trackers:
        return recording.frames
    return int((~recording.tracked[:, recording.index(tracker)]).sum())


def _check_trackers(calibration: Calibration, recording: TrackerRecording) -> None:
    if not calibration.trackers:
        raise MotionError(
            "the calibration was made from a suit's segments and fits no trackers; calibrate with these trackers"
        )
    known, found = set(calibration.trackers.values()), set(recording.trackers)
    # Fewer trackers may have been seen in this recording; others in their place mean another set.
    if not known & found or (known - found and found - known):
        raise MotionError(
            f"calibration of another tracker set: it is of {', '.join(sorted(known))}; the recording has {', '.join(sorted(found))}"
        )
    for segment, tracker in calibration.trackers.items():
        named = recording.segments.get(tracker, segment)
        if named != segment:
            raise MotionError(
                f"calibration of another tracker set: it has tracker {tracker} on {segment}, the recording has it on {named}"
            )
    if lacking := [s for s in calibration.trackers if s not in calibration.tracker_rotation]:
        raise MotionError(f"the calibration has no rotation of the tracker on {lacking[0]}; make it again")
    if lacking := [s for s in calibration.trackers if s not in calibration.still_orientation]:
        raise MotionError(f"the calibration has no Still pose of {lacking[0]}; make it again")
