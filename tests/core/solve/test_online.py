"""The paper's one QP a frame: tracks with the feed-forward, never leaves a limit, fails gracefully."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from retarget import robots
from retarget.core.errors import SolverError
from retarget.core.robot_model import RobotModel
from retarget.core.solve.dynamical import DynamicalOptions, solve
from retarget.core.solve.normal_equations import rotation_vector
from retarget.core.solve.online import OnlineOptions, OnlineSolver
from retarget.core.solve.problem import OrientationProblem, orientation_problem
from retarget.core.types import FRAME_MARKED, Array, Targets

Models = Callable[[str], RobotModel]
Swinging = Callable[..., Targets]
ONLINE = DynamicalOptions(online=True, starts=4)


def errors(problem: OrientationProblem, joints: Array, base: Array | None) -> Array:
    """(T, L) rad, by pinocchio, one frame at a time."""
    import pinocchio as pin

    model, data = problem.model.pin_model, problem.model.pin_model.createData()
    out = np.empty((len(joints), len(problem.joint_ids)))
    for k in range(len(joints)):
        pin.forwardKinematics(model, data, problem.model.configuration(joints[k], None if base is None else base[k]))
        for link, joint in enumerate(problem.joint_ids):
            rotation = np.array(data.oMi[int(joint)].rotation)
            out[k, link] = np.linalg.norm(rotation_vector(problem.desired[k, link] @ rotation.T))
    return out


def test_feed_forward_takes_the_lag_away(model: Models, swinging: Swinging) -> None:
    """Targets that G1 can follow: with ω* the error stays within what damping leaves, without it lags by about ω/K."""
    g1 = model("g1")
    problem = orientation_problem(swinging(g1, 180, misalignment=0.0, amplitude=0.3), g1, free_base=True)
    options = replace(ONLINE, one_step=OnlineOptions(gain=10.0, damping=1e-6))
    followed = solve(problem, options)
    blind = replace(problem, feed_forward=np.zeros_like(problem.feed_forward))
    lagging = solve(blind, options)
    with_it = errors(problem, followed.joints, followed.base_orientation)[30:].mean()
    without = errors(problem, lagging.joints, lagging.base_orientation)[30:].mean()
    assert np.degrees(with_it) < 0.5
    speed = np.linalg.norm(problem.feed_forward[30:], axis=2).mean()
    assert without == pytest.approx(speed / 10.0, rel=0.3)
    assert with_it < 0.15 * without


def test_one_qp_a_frame(model: Models, swinging: Swinging) -> None:
    g1 = model("g1")
    solution = solve(orientation_problem(swinging(g1, 20), g1, free_base=True), ONLINE)
    assert (solution.iterations[1:] == 1).all()


@pytest.mark.parametrize("rate_hz", [5.0, 60.0, 240.0])
@pytest.mark.parametrize("robot", robots.names())
def test_limits_hold(robot: str, rate_hz: float, model: Models, swinging: Swinging) -> None:
    """Targets far beyond the robot, also at a rate at which a gain of 10/s would overshoot."""
    chosen = model(robot)
    targets = swinging(chosen, 60, amplitude=3.0, misalignment=1.0, rate_hz=rate_hz, twist_weight=0.1)
    problem = orientation_problem(targets, chosen, free_base=chosen.base_is_floating)
    solution = solve(problem, ONLINE)
    assert not solution.status.any()
    assert ((solution.joints >= chosen.lower) & (solution.joints <= chosen.upper)).all()
    assert (np.abs(np.diff(solution.joints, axis=0)) * rate_hz <= chosen.velocity_limit).all()
    if problem.coupled is not None:
        matrix, lower, upper = problem.coupled
        value = solution.joints @ matrix.T
        assert ((value >= lower - 1e-9) & (value <= upper + 1e-9)).all()


def test_a_frame_that_fails_holds_and_is_marked(
    model: Models, swinging: Swinging, monkeypatch: pytest.MonkeyPatch
) -> None:
    g1 = model("g1")
    problem = orientation_problem(swinging(g1, 12), g1, free_base=True)
    step = OnlineSolver.step

    def failing(self: OnlineSolver, k: int, q: Array, step_s: float) -> Array:
        if k == 5:
            raise SolverError("injected")
        return step(self, k, q, step_s)

    monkeypatch.setattr(OnlineSolver, "step", failing)
    solution = solve(problem, ONLINE)
    assert np.flatnonzero(solution.status == FRAME_MARKED).tolist() == [6]
    np.testing.assert_array_equal(solution.joints[6], solution.joints[5])
