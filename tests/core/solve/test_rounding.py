"""Rounding off: kinks of the robot go, the person's own stay, limits and coupled rows hold."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from retarget.core import rotations
from retarget.core.robot_model import RobotModel
from retarget.core.solve.problem import OrientationProblem, orientation_problem
from retarget.core.solve.rounding import RoundingOptions, own_kinks, rounded_off
from retarget.core.types import Array, Targets, Task

RATE_HZ = 100.0
TIME = np.arange(500) / RATE_HZ


def following(arm: RobotModel, angle: Array) -> OrientationProblem:
    """The person turns one segment about z by `angle` (T,) rad."""
    value = rotations.make_continuous(rotations.exp(angle[:, None] * np.array([0.0, 0.0, 1.0])))
    task = Task("a", "orientation", value)
    return orientation_problem(Targets(np.arange(len(angle)) / RATE_HZ, (task,), "test"), arm, free_base=False)


def joints_of(first: Array) -> Array:
    return np.stack([first, np.zeros_like(first), np.zeros_like(first)], axis=1)


def jerk(joints: Array) -> float:
    return float(np.abs(np.diff(joints[:, 0], n=3)).max())


def test_a_kink_of_the_robot_is_rounded_and_the_rest_is_exact(sliding_arm: RobotModel) -> None:
    """The person swings smoothly; the joint stops at 0.6 rad as if at a limit, twice."""
    smooth_angle = 0.8 * np.sin(2.0 * TIME)
    joints = joints_of(np.minimum(smooth_angle, 0.6))
    rounded = rounded_off(following(sliding_arm, smooth_angle), joints)
    assert jerk(rounded) < 0.3 * jerk(joints)
    kinks = np.flatnonzero(np.abs(np.diff(joints[:, 0], n=2)) > 1e-3) + 1
    near = (np.abs(TIME[:, None] - TIME[kinks]) < 0.4).any(axis=1)
    assert 0.1 < near.mean() < 0.9
    np.testing.assert_allclose(rounded[~near], joints[~near], atol=1e-4)
    assert np.abs(rounded - joints).max() < 0.02


def test_what_the_person_does_abruptly_stays(sliding_arm: RobotModel) -> None:
    """A heel strike: the segment itself changes its speed within a frame, and the joint with it."""
    angle = np.where(TIME < 2.5, 0.4 * TIME, 1.0 - 0.8 * (TIME - 2.5))
    joints = joints_of(angle)
    np.testing.assert_allclose(rounded_off(following(sliding_arm, angle), joints), joints, rtol=0, atol=1e-12)


def test_speed_limits_hold_around_kinks_at_full_speed(sliding_arm: RobotModel) -> None:
    """Random motions at full speed between the position limits, with three seconds at half speed in their middle to be rounded."""
    problem = following(sliding_arm, np.zeros(len(TIME)))
    allowed = problem.velocity / RATE_HZ
    for seed in range(5):
        rng = np.random.default_rng(seed)
        steps = rng.choice([-1.0, 1.0], (len(TIME), 3)).repeat(5, axis=0)[: len(TIME)] * allowed
        joints = np.zeros((len(TIME), 3))
        steps[100:400] *= 0.5
        for k in range(1, len(TIME)):
            joints[k] = np.clip(joints[k - 1] + steps[k], problem.lower, problem.upper)
        rounded = rounded_off(problem, joints)
        assert (rounded != joints).any()
        assert ((rounded >= problem.lower) & (rounded <= problem.upper)).all()
        assert (np.abs(np.diff(rounded, axis=0)) <= allowed * (1 + 1e-12)).all()


def test_coupled_rows_hold_because_all_joints_take_the_same_share(
    model: Callable[[str], RobotModel], swinging: Callable[..., Targets]
) -> None:
    icub = model("icub")
    problem = orientation_problem(swinging(icub, 150, amplitude=0.2), icub, free_base=True)
    assert problem.coupled is not None
    matrix, lower, upper = problem.coupled
    rng = np.random.default_rng(1)
    corners = []
    while len(corners) < 4:
        posture = rng.uniform(np.maximum(icub.lower, -2), np.minimum(icub.upper, 2))
        if ((matrix @ posture >= lower) & (matrix @ posture <= upper)).all():
            corners.append(posture)
    at = np.linspace(0, len(corners) - 1, len(problem.time))
    joints = np.stack([np.interp(at, np.arange(len(corners)), column) for column in np.transpose(corners)], axis=1)
    rounded = rounded_off(problem, joints)
    assert (rounded != joints).any()
    value = rounded @ matrix.T
    assert ((value >= lower - 1e-9) & (value <= upper + 1e-9)).all()


def test_own_kinks_of_a_corner_in_closed_form(sliding_arm: RobotModel) -> None:
    """At a corner of slopes ∓c the symmetric average lies c · Σ w|t| off; elsewhere a straight line is its own average."""
    angle = 0.5 * np.abs(TIME - 2.5)
    window_s = RoundingOptions().window_s
    half = round(window_s * RATE_HZ)
    flank = np.abs(np.arange(-half, half + 1)) / (half + 1)
    weight = 1.0 - flank**3 * (10 - 15 * flank + 6 * flank**2)
    expected = 0.5 * float((weight * np.abs(np.arange(-half, half + 1))).sum() / weight.sum()) / RATE_HZ
    own = own_kinks(following(sliding_arm, angle), window_s)
    assert own[250] == pytest.approx(expected, rel=1e-4)
    np.testing.assert_allclose(own[20:200], 0.0, atol=1e-9)


def test_four_frames_are_left_alone(sliding_arm: RobotModel) -> None:
    joints = joints_of(np.array([0.0, 0.02, 0.0, 0.02]))
    assert rounded_off(following(sliding_arm, np.zeros(4)), joints) is joints
