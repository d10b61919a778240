"""The paper's experiments: closed forms for circles and squares, arm lines for postures known by hand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from retarget.core import comparison, experiments, rotations
from retarget.core.errors import InvalidDataError
from retarget.core.mapping.absolute import one_to_one
from retarget.core.mapping.hand_weights import mapping_weights
from retarget.core.mapping.proportional import in_proportion
from retarget.core.robot_model import RobotModel
from retarget.core.types import Array, HumanMotion, JointTrajectory

from tests.core.mapping.operators import authors_arms, calibration_of, pose

MotionFactory = Callable[..., HumanMotion]
ROBOT_ARM_M = 0.78


def circle(radius: float = 0.15, centre: tuple[float, float, float] = (0.35, 0.1, 0.2), frames: int = 361) -> Array:
    angle = np.linspace(0, 2 * np.pi, frames)[:-1]
    return np.asarray(centre) + radius * np.stack([0 * angle, np.cos(angle), np.sin(angle)], axis=1)


def robot_basis(side: str) -> Array:
    return ROBOT_ARM_M * np.array([[0, 0, 1], [0, 1 if side == "Left" else -1, 0], [-1, 0, 0]], float)


def test_a_circle_has_index_zero_wherever_it_is() -> None:
    assert experiments.circle_index(circle()) == pytest.approx(0.0, abs=1e-14)
    assert experiments.circle_index(circle(0.3, (1.0, -2.0, 0.5))) == pytest.approx(0.0, abs=1e-14)


def test_index_of_a_wavy_circle() -> None:
    """Radius r (1 + a cos 5φ): mean distance r, RMS error r a / √2. What happens along x does not count."""
    angle = np.linspace(0, 2 * np.pi, 721)[:-1]
    distance = 0.15 * (1 + 0.2 * np.cos(5 * angle))
    path = np.stack([np.sin(3 * angle), distance * np.cos(angle), distance * np.sin(angle)], axis=1)
    assert experiments.circle_index(path) == pytest.approx(0.2 / np.sqrt(2), abs=1e-12)


def test_index_of_a_square() -> None:
    """Distance from the centre over a unit square's edge: mean (√2 + asinh 1)/2, mean square 4/3."""
    mean = 0.5 * (np.sqrt(2) + np.arcsinh(1.0))
    path = experiments.ideal_square((0.4, 0.0, 0.1), 2.0, 4000)[:-1]
    assert experiments.circle_index(path) == pytest.approx(np.sqrt(4 / 3 - mean**2) / mean, abs=1e-6)


def test_one_to_one_and_proportional_mapping_leave_the_index_alone() -> None:
    random = np.random.default_rng(0)
    drawn = circle() + random.normal(scale=0.01, size=(360, 3))
    index = experiments.circle_index(drawn)
    assert experiments.circle_index(one_to_one(drawn)) == pytest.approx(index, abs=1e-12)
    assert experiments.circle_index(in_proportion(drawn, ROBOT_ARM_M, 0.6)) == pytest.approx(index, abs=1e-12)


@pytest.mark.parametrize("side", ["Left", "Right"])
def test_a_circle_in_the_operators_own_sense_of_space_comes_out_round(side: str) -> None:
    """What is a circle in units of the three poses is drawn as B_h B_r⁻¹ circle; the mapping makes the circle of it again."""
    basis = authors_arms()[side].basis
    meant = circle(0.15 * ROBOT_ARM_M / 0.6, (0.35, 0.0, -0.1))
    drawn = experiments.between_bases(meant, robot_basis(side), basis)
    index = experiments.circle_index(drawn)
    assert index > 0.02
    weights = mapping_weights(np.arange(360) / 90, drawn, basis).weights
    assert experiments.circle_index(weights @ robot_basis(side).T) < 1e-12
    assert experiments.circle_index(in_proportion(drawn, ROBOT_ARM_M, 0.6)) == pytest.approx(index, abs=1e-12)


@pytest.mark.parametrize("side", ["Left", "Right"])
def test_the_square_becomes_the_parallelogram_of_the_two_bases(side: str) -> None:
    basis = authors_arms()[side].basis
    square = experiments.ideal_square((0.35, 0.0, -0.1), 0.3)
    weights = mapping_weights(np.arange(len(square)) / 50, square, basis).weights
    found = weights @ robot_basis(side).T
    exact = square @ (robot_basis(side) @ np.linalg.inv(basis)).T
    assert np.abs(found - exact).max() < 1e-9
    assert np.abs(experiments.between_bases(square, basis, robot_basis(side)) - exact).max() < 1e-12
    corners = found[:-1:50]
    assert corners[0] - corners[1] == pytest.approx(corners[3] - corners[2], abs=1e-9)


def test_the_square() -> None:
    square = experiments.ideal_square((0.4, 0.1, 0.2), 0.3, 10)
    assert square.shape == (41, 3)
    assert square[[0, 10, 20, 30, 40]] == pytest.approx(
        np.array([[0.4, 0.25, 0.35], [0.4, -0.05, 0.35], [0.4, -0.05, 0.05], [0.4, 0.25, 0.05], [0.4, 0.25, 0.35]])
    )
    assert np.linalg.norm(np.diff(square, axis=0), axis=1) == pytest.approx(np.full(40, 0.03))


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.zeros((2, 3)), r"found points of shape \(2, 3\)"),
        (np.full((5, 3), np.nan), "finite"),
        (np.zeros((5, 3)), "doesn't move in the y-z plane"),
    ],
)
def test_paths_without_a_circle(points: Array, message: str) -> None:
    with pytest.raises(InvalidDataError, match=message):
        experiments.circle_index(points)


def drawn(
    turns: float, *, way: int = 1, noise_m: float = 0.0, lead_s: float = 1.0, period_s: float = 2.0
) -> tuple[Array, Array]:
    """(time, path) at 90 Hz: the hand rests, comes 0.3 m from below to the circle's lowest point, draws, goes back, rests."""
    come = np.linspace(-0.3, 0.0, 46)[:-1, None] * [0, 0, 1] + [0.4, 0, -0.15]
    angle = way * np.linspace(0, 2 * np.pi * turns, int(90 * period_s * turns)) - np.pi / 2
    round_ = np.stack([0 * angle + 0.4, 0.15 * np.cos(angle), 0.15 * np.sin(angle)], axis=1)
    rest = np.tile(come[0], (int(90 * lead_s), 1))
    path = np.concatenate([rest, come, round_, round_[-1] + (come - come[-1])[::-1], rest])
    path = path + np.random.default_rng(3).normal(scale=noise_m, size=path.shape)
    return np.arange(len(path)) / 90, path


@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize("noise_m", [0.0, 0.002])
def test_circles_are_found_between_coming_and_going(way: int, noise_m: float) -> None:
    """Four turns of 2 s from 1.5 s on; the hand rests a second before and after, and comes and goes at a right angle, which averages
    into the circle over TURN_SMOOTH_S."""
    time, path = drawn(4, way=way, noise_m=noise_m)
    window = experiments.find_circle(time, path)
    assert window is not None
    assert 1.5 < window[0] < window[1] < 9.5
    assert window == pytest.approx((1.5, 9.5), abs=0.25)


def test_what_is_no_circle() -> None:
    """One turn, going to and fro, standing still, and hardly a recording."""
    time = np.arange(900) / 90
    swing = 0.2 * np.sin(4 * time)[:, None] * [0.0, 1.0, 0.5]
    assert experiments.find_circle(*drawn(1.2)) is None
    assert experiments.find_circle(time, swing) is None
    assert experiments.find_circle(time, np.zeros((900, 3))) is None
    assert experiments.find_circle(time[:2], swing[:2]) is None


def test_circle_indices_of_a_clip(make_motion: MotionFactory, build_robot: Callable[[str], Any]) -> None:
    """Hands that draw circles, slightly egg-shaped: the calibration's basis is 0.55 m · axes, so nothing becomes rounder or less
    round."""
    motion = make_motion(np.linspace(0.0, 2.0, 180))
    position = np.array(motion.position)
    angle = np.linspace(0, 2 * np.pi, 181)[:-1]
    for side, out in (("Left", 1), ("Right", -1)):
        radius = 0.15 * (1 + 0.1 * np.cos(2 * angle))
        path = np.stack([0 * angle + 0.3, out * 0.2 + radius * np.cos(angle), 0.4 + radius * np.sin(angle)], axis=1)
        position[:, motion.index(f"{side}Hand")] = position[:, motion.index("Pelvis")] + path
    motion = replace(motion, position=position, calibration=calibration_of(make_motion))
    found = comparison.circles(motion, build_robot("g1"), experiments.HAND_MAPPINGS, (0.0, 2.0))
    for side in ("Left", "Right"):
        index = found[side].index
        assert set(index) == {"original", *experiments.HAND_MAPPINGS}
        assert index["original"] == pytest.approx(0.1 / np.sqrt(2), abs=1e-12)
        for name in experiments.HAND_MAPPINGS:
            assert index[name] == pytest.approx(index["original"], abs=1e-9)


def test_only_the_window_counts(make_motion: MotionFactory, build_robot: Callable[[str], Any]) -> None:
    """Two seconds of a circle, then a second of standing with arms out."""
    time = np.arange(270) / 90
    motion = make_motion(time, calibration=calibration_of(make_motion))
    position = np.array(motion.position)
    for side, out in (("Left", 1), ("Right", -1)):
        path = circle(0.1, (0.3, out * 0.2, 0.4), 181)
        position[:180, motion.index(f"{side}Hand")] = position[:180, motion.index("Pelvis")] + path
    motion = replace(motion, position=position)
    model = build_robot("tocabi")
    within = comparison.circles(motion, model, ["absolute", "hand_position"], (0.0, 2.0 - 1e-6))
    assert all(index < 1e-9 for side in ("Left", "Right") for index in within[side].index.values())
    throughout = comparison.circles(motion, model, ["absolute"], (0.0, float(time[-1])))
    assert throughout["Left"].index["absolute"] > 0.1


def direction_errors(trajectory: JointTrajectory, model: RobotModel, motion: HumanMotion) -> dict[str, Array]:
    return experiments.line_angles(
        experiments.operator_arm_points(motion, model), experiments.robot_arm_points(trajectory, model)
    )


@pytest.mark.parametrize("name", ["g1", "tocabi"])
def test_arm_directions(make_motion: MotionFactory, build_robot: Callable[[str], Any], name: str) -> None:
    """A robot in its T-pose: one with arms forward is a right angle off. Its elbows lie off the line from shoulder to hand, by up
    to 6°."""
    model = build_robot(name)
    calibration = calibration_of(make_motion)
    joints = np.tile(model.reference_posture, (2, 1))
    trajectory = JointTrajectory(np.array([0.0, 1.0]), model.joint_names, joints, np.zeros_like(joints))
    for held, angle in (("tpose", 0.0), ("forward", 90.0)):
        motion = make_motion([0.0, 1.0], pose(held), calibration=calibration)
        found = direction_errors(trajectory, model, motion)
        assert set(found) == {f"{side}{line}" for side in ("Left", "Right") for line in ("UpperArm", "ForeArm", "Arm")}
        for line, error in found.items():
            assert error.shape == (2,)
            assert error == pytest.approx(angle, abs=1.0 if line.endswith(("LeftArm", "RightArm")) else 6.0), line
    # What trackers leave: no upper arm, no elbow.
    sparse = replace(motion, measured=np.array([s in ("T8", "LeftHand", "RightHand") for s in motion.segments]))
    found = direction_errors(trajectory, model, sparse)
    assert set(found) == {"LeftArm", "RightArm"}
    assert found["LeftArm"] == pytest.approx(90.0, abs=1.0)


def test_arm_directions_are_those_of_the_person_in_their_own_frame(
    make_motion: MotionFactory, build_robot: Callable[[str], Any]
) -> None:
    """A person in T-pose who has turned about by 2 rad is in T-pose."""
    model = build_robot("tocabi")
    calibration = calibration_of(make_motion)
    joints = np.tile(model.reference_posture, (2, 1))
    trajectory = JointTrajectory(np.array([0.0, 1.0]), model.joint_names, joints, np.zeros_like(joints))
    motion = make_motion([0.0, 1.0], {"Pelvis": rotations.exp(np.array([0.0, 0.0, 2.0]))}, calibration=calibration)
    found = direction_errors(trajectory, model, motion)
    assert found["LeftArm"] == pytest.approx(np.zeros(2), abs=0.01)
    assert found["RightArm"] == pytest.approx(np.zeros(2), abs=0.01)
