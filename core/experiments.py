"""The experiments of [Lim2022 sec. IV] as functions: the circle's index, the ideal square, where the arms point."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
from retarget.core import rotations, timebase
from retarget.core.calibration import SIDES
from retarget.core.errors import InvalidDataError
from retarget.core.kinematics import Poses
from retarget.core.mapping import load
from retarget.core.mapping.arm_frames import arm_frames
from retarget.core.mapping.operator_arms import elbow_line, hand_point, shoulder_point
from retarget.core.mapping.telemanipulation import operator_of
from retarget.core.robot_model import RobotModel
from retarget.core.types import Array, BoolArray, HumanMotion, JointTrajectory, Targets

HAND_MAPPINGS = ("hand_position", "proportional", "absolute")
ORIGINAL = "original"

LEAST_TURNS = 1.5
"""Fewer turns are no circle that somebody meant to draw: a swinging hand makes one now and then."""
ALMOST_A_TURN = 0.25
"""How much of its last turn a hand may owe: averaging eats some of where it begins and ends."""
PATH_SMOOTH_S, TURN_SMOOTH_S = 0.1, 0.25
"""Half-widths over which a path and its turning rate are averaged before circles are looked for: less than a quarter of a turn."""
SLOWEST = 0.1
"""Part of a hand's highest speed (95th percentile) below which it doesn't draw."""


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


def find_circle(time: Array, points: Array) -> tuple[float, float] | None:
    """When a hand draws circles in the frontal plane: (start, end) s of its whole turns, None where there are fewer than LEAST_TURNS.

    time: (T,) s. points: (T, 3) m, x forward. Looks for the stretch with the most turns in which the hand keeps moving and its heading
    in the y-z plane keeps turning one way; what is left over beside whole turns (coming and going) is dropped evenly at both ends.
    """
    if len(time) < 3:
        return None
    velocity = np.gradient(timebase.smooth(time, points[:, 1:], PATH_SMOOTH_S), time, axis=0)
    speed = np.linalg.norm(velocity, axis=1)
    heading = np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0]))
    turning = timebase.smooth(time, np.gradient(heading, time)[:, None], TURN_SMOOTH_S)[:, 0]
    moving = speed > SLOWEST * np.percentile(speed, 95)
    turned, begin, end = 0.0, 0, 0
    for way in (1.0, -1.0):
        for first, last in timebase.runs(moving & (way * turning > 0)):
            angle = abs(float(heading[last] - heading[first]))
            if angle > turned:
                turned, begin, end = angle, first, last + 1
    if turned < LEAST_TURNS * 2 * np.pi:
        return None
    progress = np.abs(heading[begin:end] - heading[begin])
    whole = min(turned, 2 * np.pi * np.floor(turned / (2 * np.pi) + ALMOST_A_TURN))
    inside = (progress >= 0.5 * (turned - whole)) & (progress <= 0.5 * (turned + whole))
    drawn = time[begin:end][inside]
    return float(drawn[0]), float(drawn[-1])


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


def circle_paths(
    motion: HumanMotion, model: RobotModel, mappings: Sequence[str] = HAND_MAPPINGS
) -> dict[str, dict[str, Array]]:
    """Side → {"original": the operator's hand point (T, 3) m in the operator frame, mapping's name: the robot's target in its world}."""
    operator, calibration = operator_of(motion, model)
    paths = {ORIGINAL: {side: hand_point(operator, calibration, side) for side in SIDES}}
    paths |= {name: hand_paths(load(name).targets(motion, model)) for name in mappings}
    return {side: {name: path[side] for name, path in paths.items()} for side in SIDES}


def within(time: Array, window_s: tuple[float, float] | None) -> BoolArray:
    """Which frames (T,) are in the window, ends included; all without one."""
    start, end = window_s or (-np.inf, np.inf)
    return np.asarray((time >= start) & (time <= end))


def operator_arm_points(motion: HumanMotion, model: RobotModel) -> dict[str, Array]:
    """{Left,Right}{Shoulder,Elbow,Hand} → (T, 3) m in the operator frame that suits the robot; no elbow where no upper arm is measured."""
    operator, calibration = operator_of(motion, model)
    points = {}
    for side in SIDES:
        if operator.has(f"{side}UpperArm"):
            points[f"{side}Shoulder"], points[f"{side}Elbow"] = elbow_line(operator, calibration, side)
        else:
            points[f"{side}Shoulder"] = shoulder_point(operator, calibration, side)
        points[f"{side}Hand"] = hand_point(operator, calibration, side)
    return points


def robot_arm_points(trajectory: JointTrajectory, model: RobotModel) -> dict[str, Array]:
    """{Left,Right}{Shoulder,Elbow,Hand} → (T, 3) m in the robot's world; no elbow where the robot's is unknown."""
    arms = arm_frames(model)
    links = [link for arm in arms.values() for link in (arm.shoulder_link, arm.hand_link, arm.elbow_link) if link]
    poses = Poses.of(model, links, trajectory.position, trajectory.base_orientation, trajectory.base_position)
    points = {}
    for side, arm in arms.items():
        for name, link, offset in (
            ("Shoulder", arm.shoulder_link, arm.shoulder),
            ("Elbow", arm.elbow_link, arm.elbow),
            ("Hand", arm.hand_link, arm.hand),
        ):
            if link:
                rotation, origin = poses.at(link)
                points[f"{side}{name}"] = np.asarray(origin + rotation @ offset)
    return points


LINES = {"UpperArm": ("Shoulder", "Elbow"), "ForeArm": ("Elbow", "Hand"), "Arm": ("Shoulder", "Hand")}
"""Line of an arm → the points that it joins."""


def line_angles(person: Mapping[str, Array], robot: Mapping[str, Array]) -> dict[str, Array]:
    """Line → angle (T,) in degrees between the arms of the two, from what `operator_arm_points` and `robot_arm_points` give: {Left,Right}UpperArm,
    ForeArm (elbow to hand), Arm (shoulder to hand).

    The visual similarity of [Lim2022 sec. IV-C] as a number: the person is seen in the operator frame, the robot's base stands upright. Lines
    that start or end at an elbow are left out where robot or person has none known.
    """
    errors = {}
    for side in SIDES:
        for line, (start, end) in LINES.items():
            ends = f"{side}{start}", f"{side}{end}"
            if all(name in person and name in robot for name in ends):
                errors[f"{side}{line}"] = _angle(robot[ends[1]] - robot[ends[0]], person[ends[1]] - person[ends[0]])
    return errors


def _angle(a: Array, b: Array) -> Array:
    return np.asarray(np.degrees(rotations.vector_angle(a, b)))
