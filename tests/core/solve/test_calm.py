"""Calming: what runs is held, what doesn't stays as it was, and what differs by rounding before differs by rounding after."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from retarget.core import rotations
from retarget.core.robot_model import RobotModel
from retarget.core.solve.calm import CalmOptions, calmed, rush
from retarget.core.solve.dynamical import DynamicalOptions, Solution, solve
from retarget.core.solve.newton import NewtonOptions
from retarget.core.solve.problem import OrientationProblem, orientation_problem
from retarget.core.types import Array, Targets, Task

RATE_HZ = 100.0
NUMPY = DynamicalOptions(kernel="numpy", newton=NewtonOptions(posture_weight=1e-6))


def turning_about_z(arm: RobotModel, angle: Array) -> OrientationProblem:
    """The link behind the first hinge (about z, ±2 rad, 3 rad/s) should be turned by `angle` (T,) rad."""
    value = rotations.exp(angle[:, None] * np.array([0.0, 0.0, 1.0]))
    task = Task("a", "orientation", rotations.make_continuous(value))
    return orientation_problem(Targets(np.arange(len(angle)) / RATE_HZ, (task,), "test"), arm, free_base=False)


def solved(problem: OrientationProblem) -> Solution:
    return solve(problem, NUMPY)


def steps(problem: OrientationProblem, joints: Array) -> Array:
    """Speeds (T - 1, n) as part of the limits."""
    return np.asarray(np.abs(np.diff(joints, axis=0)) * RATE_HZ / problem.velocity)


def test_a_motion_within_the_speed_limits_is_the_same_object(sliding_arm: RobotModel) -> None:
    time = np.arange(600) / RATE_HZ
    problem = turning_about_z(sliding_arm, 1.2 * np.sin(1.6 * time))  # up to 1.92 of 3 rad/s
    solution = solved(problem)
    again, passes = calmed(problem, solution, solved)
    assert again is solution
    assert passes == 0


def test_a_burst_is_calmed_and_the_rest_stays_exact(sliding_arm: RobotModel) -> None:
    """Six seconds before and after a wave of 9 rad/s, three times the limit, every frame keeps its exact answer."""
    time = np.arange(1600) / RATE_HZ
    burst = np.exp(-(((time - 8.0) / 0.7) ** 4))
    angle = 0.5 * np.sin(time) + burst * np.sin(9.0 * time)
    problem = turning_about_z(sliding_arm, angle)
    solution = solved(problem)
    assert (steps(problem, solution.joints)[:, 0] > 0.999).sum() > 50
    calm, passes = calmed(problem, solution, solved)
    assert passes > 0
    assert (steps(problem, calm.joints) < 0.999).all()
    far = np.abs(time - 8.0) > 3.0
    np.testing.assert_allclose(calm.joints[far, 0], angle[far], atol=1e-5)
    middle = np.abs(time - 8.0) < 0.5
    assert np.abs(calm.joints[middle, 0]).max() < 0.7 * np.abs(solution.joints[middle, 0]).max()


def test_position_limits_and_status_hold_in_every_pass(
    model: Callable[[str], RobotModel], swinging: Callable[..., Targets]
) -> None:
    robot = model("baxter")
    targets = swinging(robot, 200, amplitude=2.5, rate_hz=60.0, twist_weight=0.1)
    problem = orientation_problem(targets, robot, free_base=False)
    calm, passes = calmed(problem, solved(problem), solved)
    assert passes > 0
    assert ((calm.joints >= robot.lower) & (calm.joints <= robot.upper)).all()
    assert (np.abs(np.diff(calm.joints, axis=0)) * 60.0 <= robot.velocity_limit).all()
    assert not calm.status.any()


def test_rounding_of_the_targets_is_not_magnified(sliding_arm: RobotModel) -> None:
    """Targets that differ by 1e-6 rad, as two files with six decimals do, end less than ten times that apart."""
    time = np.arange(800) / RATE_HZ
    angle = np.exp(-(((time - 4.0) / 1.5) ** 4)) * np.sin(7.0 * time)
    rounded = angle + 1e-6 * np.random.default_rng(0).choice([-1.0, 1.0], len(time))
    both = []
    for target in (angle, rounded):
        problem = turning_about_z(sliding_arm, target)
        calm, passes = calmed(problem, solved(problem), solved)
        assert passes > 0
        both.append(calm.joints)
    assert np.abs(both[0] - both[1]).max() < 1e-5


@pytest.mark.parametrize(("part", "expected"), [(0.5, 0.0), (0.7, 0.0), (0.85, 0.5), (1.0, 1.0)])
def test_rush_of_a_constant_speed(sliding_arm: RobotModel, part: float, expected: float) -> None:
    """Smoothstep between `full_speed` and 1: half way at 0.85."""
    problem = turning_about_z(sliding_arm, np.zeros(200))
    joints = np.arange(200)[:, None] * part * problem.velocity / RATE_HZ
    np.testing.assert_allclose(rush(problem, joints, CalmOptions()), expected, atol=1e-9)


def test_rush_sees_a_zigzag_at_the_limit_but_not_a_single_step(sliding_arm: RobotModel) -> None:
    problem = turning_about_z(sliding_arm, np.zeros(200))
    step = problem.velocity / RATE_HZ
    zigzag = (np.arange(200)[:, None] % 2) * step
    np.testing.assert_allclose(rush(problem, zigzag, CalmOptions()), 1.0, atol=1e-9)
    once = (np.arange(200)[:, None] >= 100) * step
    assert rush(problem, once, CalmOptions()).max() == 0.0


def test_rush_needs_two_frames(sliding_arm: RobotModel) -> None:
    problem = turning_about_z(sliding_arm, np.zeros(1))
    assert (rush(problem, np.zeros((1, 3)), CalmOptions()) == 0.0).all()


def test_the_number_of_passes_is_bounded(sliding_arm: RobotModel) -> None:
    time = np.arange(300) / RATE_HZ
    problem = turning_about_z(sliding_arm, np.sin(9.0 * time))
    calls = []

    def counted(again: OrientationProblem) -> Solution:
        calls.append(again)
        return solved(again)

    _, passes = calmed(problem, solved(problem), counted, replace(CalmOptions(), passes=2))
    assert passes == len(calls) == 2
    assert all(again.hold is not None and (again.hold[0] >= 0).all() for again in calls)
