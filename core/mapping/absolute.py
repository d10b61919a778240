"""Hands one to one, a baseline of [Lim2022 sec. IV-C]: the robot's hand is where the operator's is, seen from the pelvis, raised by a constant."""

from __future__ import annotations

import numpy as np
from retarget.core.calibration import SIDES
from retarget.core.kinematics import link_poses
from retarget.core.mapping import Mapping
from retarget.core.mapping.operator_arms import hand_point
from retarget.core.mapping.telemanipulation import operator_of, targets_of
from retarget.core.robot_model import RobotModel
from retarget.core.types import Array, HumanMotion, Targets

HEIGHT_M = 0.15
"""How much higher the robot's shoulders are above its pelvis: TOCABI's, 0.49 m, against a person's 0.33 m [the authors' code]."""


def one_to_one(hand: Array, height_m: float = HEIGHT_M) -> Array:
    """p_hand + (0, 0, height): hand points (T, 3) m, in the operator's pelvis frame → in the robot's."""
    return hand + np.array([0.0, 0.0, height_m])


def pelvis_origin(model: RobotModel) -> Array:
    """(3,) m, world: the origin of the robot's pelvis link, or of its base link where no link is mapped to the pelvis."""
    link = model.links.get("Pelvis", model.base_link)
    return np.array(link_poses(model, [link], model.reference_posture[None])[1][0, 0])


def targets(motion: HumanMotion, model: RobotModel, *, height_m: float = HEIGHT_M) -> Targets:
    """Tasks of all levels, hands one to one. Raises `MotionError` without a calibration or positions of chest and hands."""
    operator, calibration = operator_of(motion, model)
    origin = pelvis_origin(model)
    hands = {side: origin + one_to_one(hand_point(operator, calibration, side), height_m) for side in SIDES}
    return targets_of("absolute", operator, calibration, model, hands)


MAPPING = Mapping(
    "absolute",
    "hands one to one, from the pelvis [Lim2022 sec. IV-C]",
    targets,
    settings=frozenset({"height_m"}),
    needs_calibration=True,
)
