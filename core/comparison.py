"""Hand mappings side by side [Lim2022 sec. IV]: the operator's circles and an ideal square through them, and whose arms look most alike."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from retarget.core import experiments, timebase
from retarget.core.calibration import SIDES, Calibration
from retarget.core.errors import MotionError, UsageError
from retarget.core.kinematics import link_poses, position_errors
from retarget.core.mapping import load
from retarget.core.mapping.absolute import HEIGHT_M
from retarget.core.mapping.arm_frames import arm_frames
from retarget.core.mapping.telemanipulation import operator_of
from retarget.core.robot_model import RobotModel
from retarget.core.types import Array, HumanMotion, JointTrajectory

Progress = Callable[[int, int], None]

RATE_HZ = 30.0
"""Frames a second of the arms that are compared; recordings that are slower stay as they are."""
CONTROL_STEP_S = 5e-3
"""Longest control step on the way between them, with which errors change by less than 0.2° against steps of 1 ms, in a third of the time."""

SQUARE_M = 0.3
"""Side of the ideal square: the diameter that [Lim2022 sec. IV-A] asks of the circles."""
SQUARE_AHEAD = 0.6
"""How far in front of the shoulder the square's centre is, in arm lengths: all of the square is within an adult's reach."""


@dataclass(frozen=True)
class Variant:
    """A mapping with its settings, called `name`."""

    name: str
    mapping: str
    settings: Mapping[str, Any] = field(default_factory=dict)


def variants(mappings: Sequence[str]) -> list[Variant]:
    """Each mapping as it is; one that raises hands by a constant as it is in the paper, and with shoulders level.

    That constant is TOCABI's over the authors' operator [the authors' code]. On other robots, and with people of other build, a
    mapping would be judged by it; with hands at the same height over both pairs of shoulders the comparison is a fair one.
    """
    found = []
    for name in mappings:
        if "height_m" in load(name).settings:
            found.append(Variant(f"{name}, raised {HEIGHT_M:g} m", name, {"height_m": HEIGHT_M}))
            found.append(Variant(f"{name}, shoulders level", name, {"height_m": None}))
        else:
            found.append(Variant(name, name))
    return found


def check_mappings(mappings: Sequence[str]) -> None:
    """Raise `UsageError` for mappings that give hands no place."""
    for name in mappings:
        if not load(name).needs_calibration:
            raise UsageError(
                f"mapping '{name}' gives hands no positions; expected one of those that do, as {', '.join(experiments.HAND_MAPPINGS)}"
            )


@dataclass(frozen=True, eq=False)
class Circles:
    """One hand's circles. paths: "original" or mapping → (T, 3) m, within the window; index: of each of these."""

    window_s: tuple[float, float]
    paths: Mapping[str, Array]
    index: Mapping[str, float]


def circles(
    motion: HumanMotion, model: RobotModel, mappings: Sequence[str], window_s: tuple[float, float] | None = None
) -> dict[str, Circles]:
    """Side → its circles; sides that draw none are left out.

    window_s: when both hands draw, else it is found for each hand (`experiments.find_circle`). Raises `MotionError` for a window
    that isn't in the recording, and where a hand does not move in it.
    """
    if window_s is not None:
        first, last = float(motion.time[0]), float(motion.time[-1])
        if window_s[0] < first - 1e-6 or window_s[1] > last + 1e-6:
            raise MotionError(
                f"found a window from {window_s[0]:g} to {window_s[1]:g} s, expected one in the recording, {first:g} to {last:g} s"
            )
        if np.count_nonzero(experiments.within(motion.time, window_s)) < 3:
            raise MotionError(
                f"found fewer than three frames from {window_s[0]:g} to {window_s[1]:g} s, expected a circle"
            )
    found = {}
    for side, paths in experiments.circle_paths(motion, model, mappings).items():
        window = window_s or experiments.find_circle(motion.time, paths[experiments.ORIGINAL])
        if window is not None:
            drawn = experiments.within(motion.time, window)
            inside = {name: path[drawn] for name, path in paths.items()}
            index = {name: experiments.circle_index(path) for name, path in inside.items()}
            found[side] = Circles(window, inside, index)
    return found


@dataclass(frozen=True, eq=False)
class Square:
    """An ideal square and what `hand_position` makes of it, one arm: (N, 3) m from the shoulder, x forward, closed.

    edges_m: of the robot's parallelogram, the one along which the operator's hand goes sideways and the one along which it goes
    down. corner_deg: the angle between them at the square's upper left corner, 90 without distortion. tilt_deg: of its plane
    against the frontal one.
    """

    operator: Array
    robot: Array
    edges_m: tuple[float, float]
    corner_deg: float
    tilt_deg: float


def squares(calibration: Calibration, model: RobotModel) -> dict[str, Square]:
    """Side → a square of SQUARE_M straight ahead of the shoulder [Lim2022 fig. 6], where no limit is active."""
    found = {}
    for side, arm in arm_frames(model).items():
        human = calibration.arms[side]
        drawn = experiments.ideal_square((SQUARE_AHEAD * human.length_m, 0.0, 0.0), SQUARE_M)
        made = experiments.between_bases(drawn, human.basis, arm.basis)
        corner = len(drawn) // 4
        across, down = made[corner] - made[0], made[-1 - corner] - made[0]
        lengths = float(np.linalg.norm(across)), float(np.linalg.norm(down))
        normal = np.cross(across, down)
        found[side] = Square(
            operator=drawn,
            robot=made,
            edges_m=lengths,
            corner_deg=float(np.degrees(np.arccos(across @ down / (lengths[0] * lengths[1])))),
            tilt_deg=float(np.degrees(np.arccos(min(1.0, abs(normal[0]) / np.linalg.norm(normal))))),
        )
    return found


@dataclass(frozen=True, eq=False)
class Similarity:
    """The robot's arms by one variant, T frames.

    errors_deg: line → (T,), as `experiments.line_angles`. points: as `experiments.robot_arm_points`, and Pelvis, Neck, Head.
    hand_error_m: side → (T,), from the hand's target to where the robot's limits and the levels above let it be. unsolved_frames: their number.
    """

    variant: Variant
    errors_deg: Mapping[str, Array]
    points: Mapping[str, Array]
    hand_error_m: Mapping[str, Array]
    unsolved_frames: int


def at_rate(motion: HumanMotion) -> HumanMotion:
    """The motion at RATE_HZ, or as it is where it is slower."""
    return timebase.resample(motion, RATE_HZ) if motion.rate_hz > RATE_HZ else motion


def similarity(
    motion: HumanMotion, model: RobotModel, chosen: Sequence[Variant], progress: Progress | None = None
) -> list[Similarity]:
    """The arms of every variant over the whole motion, solved by strict priorities alike. `progress` gets (frames done, in all)."""
    person = experiments.operator_arm_points(motion, model)
    found = []
    for number, variant in enumerate(chosen):
        trajectory, hand_error = _solved(motion, model, variant, _later(progress, number, len(chosen)))
        robot = experiments.robot_arm_points(trajectory, model)
        found.append(
            Similarity(
                variant=variant,
                errors_deg=experiments.line_angles(person, robot),
                points={**robot, **_robot_trunk(trajectory, model, robot)},
                hand_error_m=hand_error,
                unsolved_frames=int(np.count_nonzero(trajectory.status)),
            )
        )
    return found


def operator_points(motion: HumanMotion, model: RobotModel) -> dict[str, Array]:
    """As `experiments.operator_arm_points`, and Pelvis (where it was in the Still pose, unless it is tracked), Neck and Head."""
    operator, _ = operator_of(motion, model)
    points = experiments.operator_arm_points(motion, model)
    points["Pelvis"] = np.zeros((motion.frames, 3))
    for name in ("Pelvis", "Head"):
        if operator.has(name) and np.isfinite(operator.position[:, operator.index(name)]).all():
            points[name] = operator.position[:, operator.index(name)]
    points["Neck"] = 0.5 * (points["LeftShoulder"] + points["RightShoulder"])
    return points


def _solved(
    motion: HumanMotion, model: RobotModel, variant: Variant, progress: Progress | None
) -> tuple[JointTrajectory, dict[str, Array]]:
    """The robot's motion, on a base that stands upright at the origin, and side → distance (T,) m of the hand from its target."""
    from retarget.core.solve.hierarchical import HierarchicalOptions, solve

    targets = load(variant.mapping).targets(motion, model, **variant.settings)
    solution = solve(targets, model, HierarchicalOptions(control_step_s=CONTROL_STEP_S), progress)
    floating = solution.base_orientation is not None
    trajectory = JointTrajectory(
        time=motion.time,
        joint_names=model.joint_names,
        position=solution.joints,
        velocity=timebase.rate_of_change(motion.time, solution.joints),
        base_position=np.zeros((motion.frames, 3)) if floating else None,
        base_orientation=solution.base_orientation,
        status=solution.status,
        robot=model.profile.name,
    )
    errors = position_errors(model, targets, solution.joints)
    return trajectory, {segment.removesuffix("Hand"): error for segment, error in errors.items()}


def _robot_trunk(trajectory: JointTrajectory, model: RobotModel, arms: Mapping[str, Array]) -> dict[str, Array]:
    links = {"Pelvis": model.links.get("Pelvis", model.base_link)}
    if "Head" in model.links:
        links["Head"] = model.links["Head"]
    _, origin = link_poses(
        model, list(links.values()), trajectory.position, trajectory.base_orientation, trajectory.base_position
    )
    neck = np.asarray(0.5 * sum(arms[f"{side}Shoulder"] for side in SIDES))
    return {"Neck": neck, **{name: np.asarray(origin[:, i]) for i, name in enumerate(links)}}


def _later(progress: Progress | None, number: int, count: int) -> Progress | None:
    """`progress` of the `number`-th of `count` solutions of the same length."""
    if progress is None:
        return None
    return lambda done, total: progress(number * total + done, count * total)
