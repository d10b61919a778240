"""Hands one to one, a baseline of [Lim2022 sec. IV-C]: where the operator's are, seen from the pelvis, raised by a constant."""

from __future__ import annotations

import numpy as np
from retarget.core.calibration import SIDES, Calibration
from retarget.core.kinematics import link_poses
from retarget.core.mapping import Mapping
from retarget.core.mapping.arm_frames import arm_frames
from retarget.core.mapping.operator_arms import hand_point
from retarget.core.mapping.telemanipulation import operator_of, targets_of
from retarget.core.mapping.trunk import shoulder_points
from retarget.core.robot_model import RobotModel
from retarget.core.types import Array, HumanMotion, Targets

HEIGHT_M = 0.15
"""How much higher the robot's shoulders are above its pelvis: TOCABI's, 0.49 m, against a person's 0.33 m [the authors' code]."""


def one_to_one(hand: Array, height_m: float = HEIGHT_M) -> Array:
    """p_hand + (0, 0, height): hand points (T, 3) m, in the operator's pelvis frame → in the robot's."""
    return np.asarray(hand + np.array([0.0, 0.0, height_m]))


def pelvis_origin(model: RobotModel) -> Array:
    """(3,) m, world: the origin of the robot's pelvis link, or of its base link where no link is mapped to the pelvis."""
    link = model.links.get("Pelvis", model.base_link)
    return np.array(link_poses(model, [link], model.reference_posture[None])[1][0, 0])


def height_between_shoulders(model: RobotModel, calibration: Calibration, scale: float) -> float:
    """How far (m) hands scaled by `scale` have to be raised so that a hand at the operator's shoulders' height is at the
    robot's."""
    upright = np.array([[1.0, 0.0, 0.0, 0.0]])
    robot = np.mean([point[0, 2] for point in shoulder_points(model, arm_frames(model), upright).values()])
    human = np.mean([calibration.arms[side].shoulder[2] for side in SIDES])
    return float(robot - pelvis_origin(model)[2] - scale * human)


def targets(motion: HumanMotion, model: RobotModel, *, height_m: float | None = HEIGHT_M) -> Targets:
    """Tasks of all levels, hands one to one.

    height_m: how much the hands are raised; None = as shoulders differ, which is fairer to robots other than TOCABI. Raises
    `MotionError` without a calibration or positions of chest and hands.
    """
    operator, calibration = operator_of(motion, model)
    origin = pelvis_origin(model)
    if height_m is None:
        height_m = height_between_shoulders(model, calibration, 1.0)
    hands = {side: origin + one_to_one(hand_point(operator, calibration, side), height_m) for side in SIDES}
    return targets_of("absolute", operator, calibration, model, hands)


MAPPING = Mapping(
    "absolute",
    "hands one to one, from the pelvis [Lim2022 sec. IV-C]",
    targets,
    settings=frozenset({"height_m"}),
    needs_calibration=True,
)
