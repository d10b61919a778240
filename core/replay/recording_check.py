"""The robot's limbs beside those of the person it was retargeted from, where the recording is at hand.

Joints that changed places can stay inside every limit: then only the pose tells, and only beside the person's.
"""

from __future__ import annotations

import numpy as np
from retarget.core import metrics, rotations
from retarget.core.chunks import frame_chunks
from retarget.core.kinematics import Poses
from retarget.core.mapping.heading import without_heading
from retarget.core.replay.signals import worst
from retarget.core.replay.thresholds import Thresholds
from retarget.core.report import Check
from retarget.core.robot_model import RobotModel
from retarget.core.types import Array, HumanMotion, JointTrajectory

NAME = "limb_direction_error_deg"
SHARE_PERCENT = 95
"""The error that so many of the frames stay below: a moment at a joint's limit is not a wrong joint."""


def check_recording(
    trajectory: JointTrajectory, model: RobotModel, motion: HumanMotion | None, thresholds: Thresholds
) -> tuple[list[Check], dict[str, Array]]:
    """(the check of the limb whose direction is furthest off in 95 % of the frames, series["problem/<segment>"] (T,), 1 = at the limit).

    motion: what was retargeted, uncut or cut, at any rate, on the trajectory's clock; compared over the time that both have.
    """
    if motion is None:
        return [thresholds.check(NAME, None, "no recording is at hand")], {}
    limbs = {segment: limb for segment, limb in model.limbs.items() if motion.has(segment)}
    time = trajectory.time
    both = (time >= motion.time[0] - 1e-9) & (time <= motion.time[-1] + 1e-9)
    if not limbs or not both.any():
        why = "the robot and the recording share no limb" if not limbs else "the recording is of another time"
        return [thresholds.check(NAME, None, why)], {}
    if not model.base_is_floating:
        motion = without_heading(motion, model.profile.base_segment)
    links = [limb.link for limb in limbs.values()]
    lines = {segment: _line(motion, segment) for segment in limbs}
    errors = np.zeros((len(limbs), trajectory.frames))
    for part in frame_chunks(trajectory.frames):
        rotation = Poses.along(trajectory, model, links, part).rotations_of(links)
        for i, (segment, limb) in enumerate(limbs.items()):
            wanted = _at(time[part], motion.time, lines[segment])
            errors[i, part] = np.degrees(rotations.vector_angle(rotation[:, i] @ limb.bone, wanted))
    errors[:, ~both] = 0.0
    usual = [float(np.percentile(error[both], SHARE_PERCENT)) for error in errors]
    furthest = int(np.argmax(usual))
    name = tuple(limbs)[furthest]
    peak = worst(errors[furthest][:, None], time, (name,))
    note = f"exceeded in {100 - SHARE_PERCENT} % of the frames; {peak.value:.0f}° there" if peak.value > 0 else ""
    check = thresholds.check(NAME, usual[furthest], note, where=name, time_s=peak.time_s)
    limit = thresholds.limits[NAME]
    strips = (
        {f"problem/{segment}": error / limit for segment, error in zip(limbs, errors, strict=True)} if limit else {}
    )
    return [check], strips


def _line(motion: HumanMotion, segment: str) -> Array:
    """(M, 3) unit, the person's limb in the frames of the recording."""
    line = metrics.person_limb(motion, segment)
    return np.asarray(line / np.linalg.norm(line, axis=1, keepdims=True))


def _at(time: Array, recorded: Array, line: Array) -> Array:
    """(K, 3) the direction `line` (M, 3) at `time` (K,) s, linearly between the frames at `recorded` (M,) s; its length has no meaning."""
    return np.stack([np.interp(time, recorded, line[:, k]) for k in range(3)], axis=1)
