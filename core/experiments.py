"""The experiments of [Lim2022 sec. IV] as functions: the circle's index, the ideal square, where the arms point."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from retarget.core import rotations
from retarget.core.calibration import SIDES
from retarget.core.errors import InvalidDataError
from retarget.core.kinematics import Poses
from retarget.core.mapping import load
from retarget.core.mapping.arm_frames import arm_frames
from retarget.core.mapping.operator_arms import elbow_line, hand_point, shoulder_point
from retarget.core.mapping.telemanipulation import operator_of
from retarget.core.robot_model import RobotModel
from retarget.core.types import Array, HumanMotion, JointTrajectory, Targets

HAND_MAPPINGS = ("hand_position", "proportional", "absolute")
ORIGINAL = "original"


def circle_index(points: Array) -> float:
    """How far a hand's path is from a circle in the frontal plane: RMS error of the fitted circle over its radius, without unit
    [Lim2022 sec. IV-A].

    points: (T, 3), x forward. Centre: the mean of all points. Radius: the mean distance from it in the y-z plane. 0 is a circle;
    neither shifting nor scaling the path changes it. Raises `InvalidDataError` for fewer than three points, and for a path
    without extent in that plane.
    """
    if points.ndim != 2 or points.shape[1] != 3 or len(points) < 3 or not np.isfinite(points).all():
        raise InvalidDataError(f"circle index: found points of shape {points.shape}, expected (T, 3), T ≥ 3, finite")
    flat = points[:, 1:] - points[:, 1:].mean(axis=0)
    distance = np.linalg.norm(flat, axis=1)
    radius = float(distance.mean())
    if radius < 1e-9:
        raise InvalidDataError(
            "circle index: found a hand that doesn't move in the y-z plane, expected a path around a centre"
        )
    return float(np.sqrt(np.mean((distance - radius) ** 2)) / radius)


def ideal_square(centre: Sequence[float], side_m: float, per_side: int = 50) -> Array:
    """A square (4 · per_side + 1, 3) m in the y-z plane about `centre`, drawn at constant speed from its upper left corner and
    closed [Lim2022 fig. 6]."""
    corners = 0.5 * side_m * np.array([[0, 1, 1], [0, -1, 1], [0, -1, -1], [0, 1, -1], [0, 1, 1]], float)
    along = np.arange(per_side)[:, None] / per_side
    edges = [begin + along * (end - begin) for begin, end in pairwise(corners)]
    return np.asarray(np.concatenate([*edges, corners[-1:]]) + np.asarray(centre, float))


def between_bases(hand: Array, human: Array, robot: Array) -> Array:
    """B_r B_h⁻¹ h: what the mapping of [Lim2022 eq. 3] makes of hand points (T, 3), seen from the shoulder, where no limit is
    active. Bases (3, 3)."""
    return np.asarray(np.linalg.solve(human.T, robot.T).T @ hand[..., None])[..., 0]


def hand_paths(targets: Targets) -> dict[str, Array]:
    """ "Left", "Right" → hand targets (T, 3) m in the robot's world."""
    return {task.segment.removesuffix("Hand"): task.value for task in targets.tasks if task.kind == "position"}


def circle_indices(
    motion: HumanMotion,
    model: RobotModel,
    mappings: Sequence[str] = HAND_MAPPINGS,
    window_s: tuple[float, float] | None = None,
) -> dict[str, dict[str, float]]:
    """Side → {"original": index of the operator's own path, mapping's name: of the robot's target path} [Lim2022 table IV].

    motion: one in which both hands draw circles in front of the person, with its calibration. window_s: (start, end), when they
    do; None = throughout. Raises `InvalidDataError` for a window with fewer than three frames.
    """
    operator, calibration = operator_of(motion, model)
    paths = {ORIGINAL: {side: hand_point(operator, calibration, side) for side in SIDES}}
    paths |= {name: hand_paths(load(name).targets(motion, model)) for name in mappings}
    start, end = window_s or (-np.inf, np.inf)
    drawn = (motion.time >= start) & (motion.time <= end)
    return {side: {name: circle_index(path[side][drawn]) for name, path in paths.items()} for side in SIDES}


def arm_direction_errors(trajectory: JointTrajectory, model: RobotModel, motion: HumanMotion) -> dict[str, Array]:
    """Line → angle (T,) in degrees between the operator's and the robot's: {Left,Right}UpperArm, ForeArm (elbow to hand), Arm
    (shoulder to hand).

    The visual similarity of [Lim2022 sec. IV-C] as a number. `motion` is what was retargeted, frame for frame, with its
    calibration; the robot's base stands upright, the person is seen in the operator frame. Lines that start or end at an elbow
    are left out where robot or person has none known.
    """
    operator, calibration = operator_of(motion, model)
    arms = arm_frames(model)
    links = [link for arm in arms.values() for link in (arm.shoulder_link, arm.hand_link, arm.elbow_link) if link]
    poses = Poses.of(model, links, trajectory.position, trajectory.base_orientation, trajectory.base_position)

    def point(link: str, offset: Array) -> Array:
        rotation, origin = poses.at(link)
        return np.asarray(origin + rotation @ offset)

    errors = {}
    for side, arm in arms.items():
        robot_shoulder, robot_hand = point(arm.shoulder_link, arm.shoulder), point(arm.hand_link, arm.hand)
        hand = hand_point(operator, calibration, side)
        if operator.has(f"{side}UpperArm"):
            shoulder, elbow = elbow_line(operator, calibration, side)
            if arm.elbow_link:
                robot_elbow = point(arm.elbow_link, arm.elbow)
                errors[f"{side}UpperArm"] = _angle(robot_elbow - robot_shoulder, elbow - shoulder)
                errors[f"{side}ForeArm"] = _angle(robot_hand - robot_elbow, hand - elbow)
        else:
            shoulder = shoulder_point(operator, calibration, side)
        errors[f"{side}Arm"] = _angle(robot_hand - robot_shoulder, hand - shoulder)
    return errors


def _angle(a: Array, b: Array) -> Array:
    return np.asarray(np.degrees(rotations.vector_angle(a, b)))
