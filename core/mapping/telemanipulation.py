"""What the three hand mappings of [Lim2022] share: everything but where the hands should be.

The robot stands upright on its base at the origin, facing +X, and its base doesn't move; targets are in its world. The person is
seen in the operator frame. Levels, gains and weights within a level are the robot's (`priority_levels`); what the level weighs is
the solver's affair.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from retarget.core import rotations
from retarget.core.calibration import SIDES, Calibration
from retarget.core.errors import MotionError, ProfileError
from retarget.core.mapping.arm_frames import ArmFrame, arm_frames
from retarget.core.mapping.link_rotations import from_geometry, from_reference_posture
from retarget.core.mapping.operator_arms import arm_plane
from retarget.core.mapping.operator_frame import in_operator_frame
from retarget.core.mapping.priority_levels import priority_levels
from retarget.core.mapping.relative_orientation import mapped_orientation
from retarget.core.profile import LevelTask
from retarget.core.robot_model import RobotModel
from retarget.core.timebase import rate_of_change
from retarget.core.types import Array, HumanMotion, Targets, Task


def operator_of(motion: HumanMotion, model: RobotModel) -> tuple[HumanMotion, Calibration]:
    """The motion in the operator frame that suits the robot, and its calibration. Raises `MotionError` where it has none."""
    if motion.calibration is None:
        raise MotionError(
            "hand mappings need the operator's calibration, and the motion has none; "
            "expected a calibration from `retarget calibrate`"
        )
    return in_operator_frame(motion, motion.calibration, model.profile.base_segment), motion.calibration


def targets_of(
    name: str, motion: HumanMotion, calibration: Calibration, model: RobotModel, hands: Mapping[str, Array]
) -> Targets:
    """The robot's tasks, level by level.

    motion: in the operator frame. hands: side → (T, 3) m, where the robot's hand point should be in its world. Orientations by
    AOM or ROM, upper arms by the normal of the arm's plane. Tasks of segments that the motion lacks are left out.
    """
    arms = arm_frames(model)
    constants = from_geometry(model)
    tasks = []
    for number, level in enumerate(priority_levels(model)):
        for wanted in level.tasks:
            if wanted.kind == "position":
                side = wanted.segment.removesuffix("Hand")
                if side not in SIDES:
                    raise ProfileError(
                        model.profile.origin or model.profile.name,
                        f"position task of segment '{wanted.segment}'",
                        place="[hierarchy]",
                        expected="LeftHand or RightHand",
                    )
                tasks.append(_position_task(motion.time, hands[side], wanted, number, arms[side]))
            elif _measured(motion, wanted.segment):
                tasks.append(_direction_task(motion, calibration, wanted, number, model, constants))
    return Targets(motion.time, tuple(tasks), name)


def _position_task(time: Array, hand: Array, wanted: LevelTask, level: int, arm: ArmFrame) -> Task:
    """Where the hand point of one arm is to be: hand (T, 3) m, world."""
    return Task(
        frame=arm.hand_link,
        kind="position",
        value=hand,
        feed_forward=rate_of_change(time, hand),
        level=level,
        segment=wanted.segment,
        offset=arm.hand,
        gain=wanted.gain,
        weight=np.array(wanted.weight),
    )


def _direction_task(
    motion: HumanMotion,
    calibration: Calibration,
    wanted: LevelTask,
    level: int,
    model: RobotModel,
    constants: Mapping[str, Array],
) -> Task:
    """Which way a link, or one axis of it, points: the segment's mapped orientation, the arm plane's for the axis of an upper arm."""
    link, constant = _link(model, wanted, constants)
    if wanted.kind == "axis" and wanted.segment.endswith("UpperArm"):
        segment = arm_plane(motion, calibration, wanted.segment.removesuffix("UpperArm"))
    else:
        segment = mapped_orientation(motion, calibration, wanted.segment)
    oriented = rotations.make_continuous(rotations.multiply(segment, rotations.from_matrix(constant)))
    if wanted.kind == "orientation":
        return Task(
            frame=link,
            kind="orientation",
            value=oriented,
            feed_forward=rotations.angular_velocity(motion.time, oriented),
            level=level,
            segment=wanted.segment,
            gain=wanted.gain,
            weight=np.array(wanted.weight),
        )
    axis = np.array(wanted.axis) / np.linalg.norm(wanted.axis)
    pointing = rotations.rotate(oriented, axis)
    return Task(
        frame=link,
        kind="axis",
        value=pointing,
        feed_forward=np.asarray(np.cross(pointing, rate_of_change(motion.time, pointing)), float),
        level=level,
        segment=wanted.segment,
        axis=axis,
        gain=wanted.gain,
        weight=np.array(wanted.weight),
    )


def _measured(motion: HumanMotion, segment: str) -> bool:
    """A shoulder without a measurement of its own goes with the chest."""
    return motion.has("T8" if segment.endswith("Shoulder") and not motion.has(segment) else segment)


def _link(model: RobotModel, wanted: LevelTask, constants: Mapping[str, Array]) -> tuple[str, Array]:
    """The task's link and its rotation (3, 3) segment ← link: by geometry for the mapped link, from the reference posture for
    another."""
    link = wanted.link or model.links.get(wanted.segment, "")
    if not link:
        raise ProfileError(
            model.profile.origin or model.profile.name,
            f"the task of {wanted.segment} names no link",
            place="[hierarchy]",
            expected="a link, or a segment of [links]",
        )
    if link == model.links.get(wanted.segment):
        return link, constants[wanted.segment]
    return link, from_reference_posture(model, {wanted.segment: link})[wanted.segment]
