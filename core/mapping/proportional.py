"""Hands in proportion to arm lengths, a baseline of [Lim2022 sec. IV-C]: as `absolute`, but scaled to the robot's reach."""

from __future__ import annotations

import numpy as np
from retarget.core.calibration import SIDES
from retarget.core.mapping import Mapping
from retarget.core.mapping.absolute import HEIGHT_M, height_between_shoulders, one_to_one, pelvis_origin
from retarget.core.mapping.arm_frames import arm_frames
from retarget.core.mapping.operator_arms import hand_point
from retarget.core.mapping.telemanipulation import operator_of, targets_of
from retarget.core.robot_model import RobotModel
from retarget.core.types import Array, HumanMotion, Targets

USED_REACH = 0.9
"""Part of the robot's arm length that a stretched human arm reaches [the authors' code]."""


def in_proportion(hand: Array, robot_arm_m: float, human_arm_m: float, height_m: float = HEIGHT_M) -> Array:
    """0.9 · L / arm · p_hand + (0, 0, height): hand points (T, 3) m, in the operator's pelvis frame → in the robot's."""
    return one_to_one(USED_REACH * robot_arm_m / human_arm_m * hand, height_m)


def targets(motion: HumanMotion, model: RobotModel, *, height_m: float | None = HEIGHT_M) -> Targets:
    """Tasks of all levels, hands in proportion; arm lengths are means of left and right. `height_m` and what is raised: as in
    `absolute`."""
    operator, calibration = operator_of(motion, model)
    origin = pelvis_origin(model)
    robot = float(np.mean([arm.length_m for arm in arm_frames(model).values()]))
    human = float(np.mean([calibration.arms[side].length_m for side in SIDES]))
    if height_m is None:
        height_m = height_between_shoulders(model, calibration, USED_REACH * robot / human)
    hands = {
        side: origin + in_proportion(hand_point(operator, calibration, side), robot, human, height_m) for side in SIDES
    }
    return targets_of("proportional", operator, calibration, model, hands)


MAPPING = Mapping(
    "proportional",
    "hands scaled by arm length, from the pelvis [Lim2022 sec. IV-C]",
    targets,
    settings=frozenset({"height_m"}),
    needs_calibration=True,
)
