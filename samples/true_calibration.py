"""What a perfect calibration of a take would be, and the motion that a perfect one makes of its trackers."""

from __future__ import annotations

import numpy as np
from retarget.core import rotations
from retarget.core.calibration import SIDES, ArmCalibration, Calibration
from retarget.core.segments import SEGMENTS
from retarget.core.types import Array, HumanMotion
from retarget.samples.arm_reach import ARM_LENGTH
from retarget.samples.primitive_poses import Operator, candidate_distances
from retarget.samples.takes import SHOULDER, Take
from retarget.samples.trackers import HAND_OFFSET


def true_calibration(take: Take) -> Calibration:
    """The operator of `take` as the trackers strapped on for it would show him in the Still, T and Forward pose, free of faults.

    The operator frame has its origin at the pelvis in the Still pose, in which every task starts, about which the body sways, and the chest
    counts as not having moved since. As with trackers, `chest_position` is where the chest's tracker is. Calibrations of takes with the same
    heading, origin and `mount_seed` are the same but for `windows_s`, which is empty where the task has no such poses.
    """
    back = rotations.exp(np.array([0.0, 0.0, -take.heading_rad]))
    pose = take.still
    origin = pose.position[0, pose.index("Pelvis")]

    def in_operator_frame(point: Array) -> Array:
        return rotations.rotate(back, point - origin)

    still = {segment: rotations.multiply(back, pose.orientation[0, pose.index(segment)]) for segment in take.mounts}
    chest = in_operator_frame(pose.position[0, pose.index("T8")])
    arms = {side: _arm(take.task.operator, side, chest + SHOULDER[side]) for side in SIDES}
    poses = {"still", "tpose", "forward"}
    windows = take.task.windows
    return Calibration(
        arms=arms,
        origin=origin,
        heading_rad=take.heading_rad,
        chest_position=chest + rotations.rotate(still["T8"], take.mounts["T8"].position),
        chest_orientation=still["T8"],
        still_orientation=still,
        trackers=take.tracker_of,
        tracker_rotation={segment: mount.tracker_rotation for segment, mount in take.mounts.items()},
        hand_offset_m={side: np.array(HAND_OFFSET) for side in SIDES},
        windows_s=windows if poses <= set(windows) else {},
    )


def true_motion(take: Take) -> HumanMotion:
    """The six tracked segments in the operator frame, calibration attached, as `core.calibrate.apply` makes them of perfect trackers.

    Orientations are true; origins are where trackers can put them: T8 and Head at their trackers, UpperArm at the shoulder's centre, Hand
    at the hand point.
    """
    motion, calibration = take.motion, true_calibration(take)
    segments = tuple(segment for segment in SEGMENTS if segment in take.mounts)
    back = rotations.exp(np.array([0.0, 0.0, -take.heading_rad]))
    points = {f"{side}Hand": take.hand_point[side] for side in SIDES}
    points |= {f"{side}UpperArm": take.position(f"{side}UpperArm") for side in SIDES}
    for segment in ("T8", "Head"):
        turned = motion.orientation[:, motion.index(segment)]
        points[segment] = take.position(segment) + rotations.rotate(turned, take.mounts[segment].position)
    return HumanMotion(
        time=motion.time,
        segments=segments,
        orientation=rotations.multiply(back, motion.orientation[:, [motion.index(segment) for segment in segments]]),
        position=rotations.rotate(
            back, np.stack([points[segment] for segment in segments], axis=1) - calibration.origin
        ),
        source=motion.source,
        calibration=calibration,
    )


def _arm(operator: Operator, side: str, shoulder: Array) -> ArmCalibration:
    angles = operator.angles_deg(side)
    first, second, third = (ARM_LENGTH * candidate_distances(angles)).tolist()
    return ArmCalibration(
        hand_points=shoulder + operator.basis(side).T,
        shoulder=shoulder,
        length_m=ARM_LENGTH,
        angles_deg=angles,
        offsets_m=(first, second, third),
    )
