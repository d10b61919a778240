"""The cascade against eq. 14 with equalities as [Lim2022] prints it, and what strict priority promises, on 1,000 random states a robot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec

import daqp
import numpy as np
import pytest
from retarget.core.robot_model import RobotModel
from retarget.core.solve.cascade import Cascade, CascadeStep
from retarget.core.solve.freedom import Freedom
from retarget.core.solve.hierarchical import HierarchicalOptions, HierarchicalSolver
from retarget.core.solve.priorities import Priority
from retarget.core.solve.task_samples import TaskSamples
from retarget.core.types import Array
from scipy.optimize import minimize

from tests.core.solve.hierarchies import (
    ROBOTS,
    by_cascade,
    largest_change,
    last_step,
    paper_cascade,
    paper_targets,
    random_step,
    upper_body_motion,
)

Make = Callable[..., Cascade]
STATES, STEP_S = 1000, 1e-3


@dataclass(frozen=True)
class Solved:
    """One robot's random states: ours after all levels, in NumPy and compiled, the paper's form after each, and of both of ours residual changes and excess."""

    solver: HierarchicalSolver
    steps: list[CascadeStep]
    compiled: list[CascadeStep]
    paper: Array
    paper_solved: Array
    leaks: Array
    excess: Array


def compiled_cascade(solver: HierarchicalSolver) -> Cascade | None:
    if find_spec("numba") is None:
        return None
    from retarget.core.solve.freedom_kernel import CompiledFreedom

    return Cascade(solver.levels, solver.level_rows, solver.weight, solver.limits.speed, CompiledFreedom)


@pytest.fixture(scope="module", params=ROBOTS)
def solved(request: pytest.FixtureRequest, model: Callable[[str], RobotModel]) -> Solved:
    robot = model(request.param)
    targets = paper_targets(robot, upper_body_motion(robot, 1), turned=0.3)
    solver = HierarchicalSolver(targets, robot, HierarchicalOptions(kernel="numpy"))
    by_numba = compiled_cascade(solver)
    wanted, rng = TaskSamples(solver.tasks, robot).at(0), np.random.default_rng(0)
    steps, compiled, paper, paper_solved, leaks, excess = [], [], [], [], [], []
    for _ in range(STATES):
        state = random_step(solver, robot, rng)
        steps.append(solver.step(state.joints, wanted, 0, state.before, STEP_S))
        given = last_step(solver, state.before)
        if by_numba is not None:
            compiled.append(by_cascade(by_numba, given, STEP_S))
        velocities, fine = paper_cascade(solver, solver.weight[0], state.before, STEP_S)
        paper.append(velocities)
        paper_solved.append(fine)
        for found, kind in zip((steps, compiled), (Freedom, by_numba and by_numba.freedom), strict=True):
            if kind is None:
                continue
            own = found[-1].velocity
            leaks.append(largest_change(solver, state.before, own, STEP_S, kind))
            value = np.concatenate([own, given.constraints @ own])
            excess.append(max((value - given.upper).max(), (given.lower - value).max()))
    return Solved(solver, steps, compiled, np.array(paper), np.array(paper_solved), np.array(leaks), np.array(excess))


def test_agrees_with_the_papers_form(solved: Solved) -> None:
    """Per step to 1e-6. The paper's form calls a level infeasible now and then, mostly one that has no freedom; ours never."""
    freedom = np.array([step.freedom for step in solved.steps])
    comparable = (solved.paper_solved | (freedom == 0)).all(axis=1)
    assert comparable.mean() >= 0.99
    assert solved.paper_solved.mean(axis=0).min() > 0.9
    ours = np.array([step.velocity for step in solved.steps])
    np.testing.assert_allclose(ours[comparable], solved.paper[comparable, -1], atol=1e-6)


def test_compiled_it_is_the_same(solved: Solved) -> None:
    """Nothing but the order of sums differs, and how a null space is found."""
    if not solved.compiled:
        pytest.skip("numba is not there for this Python")
    for ours, compiled in zip(solved.steps, solved.compiled, strict=True):
        np.testing.assert_allclose(compiled.velocity, ours.velocity, atol=1e-9)
        np.testing.assert_array_equal(compiled.freedom, ours.freedom)
        assert (compiled.qps, compiled.failed) == (ours.qps, ours.failed)


def test_no_level_moves_a_higher_one(solved: Solved) -> None:
    assert solved.leaks.max() <= 1e-6


def test_no_step_is_infeasible_and_none_leaves_its_limits(solved: Solved) -> None:
    steps = solved.steps + solved.compiled
    assert not [step.failed for step in steps if step.failed is not None]
    assert solved.excess.max() <= 1e-8


def test_a_level_without_freedom_is_reported(solved: Solved) -> None:
    """Seven joints that hold a hand and an upper arm's x axis have nothing left; the chest always can move."""
    freedom = np.array([step.freedom for step in solved.steps])
    assert (freedom[:, 0] > 0).all()
    columns, rows = len(solved.solver.columns), solved.solver.level_rows
    empty = (freedom[:, 3] == 0).mean()
    higher = rows[2].stop
    assert empty == 1.0 if columns <= higher else empty < 1.0


@pytest.fixture(params=["numpy", "compiled"])
def freedom(request: pytest.FixtureRequest) -> type[Freedom]:
    if request.param == "numpy":
        return Freedom
    pytest.importorskip("numba", reason="numba is not there for this Python")
    from retarget.core.solve.freedom_kernel import CompiledFreedom

    return CompiledFreedom


@pytest.fixture
def cascade(freedom: type[Freedom]) -> Make:
    def make(*weights: float, acceleration: float = 0.0, of_rows: Array | None = None) -> Cascade:
        """Levels of one row each."""
        levels = [Priority(i, slice(i, i + 1), weight, acceleration) for i, weight in enumerate(weights)]
        rows = [slice(i, i + 1) for i in range(len(weights))]
        weight = np.ones((1, len(weights))) if of_rows is None else of_rows[None]
        return Cascade(levels, rows, weight, np.full(2, 100.0), freedom)

    return make


def solve_plainly(
    own: Cascade, jacobian: Array, command: Array, limit: float = 1e6, before: Array | None = None
) -> CascadeStep:
    count = jacobian.shape[1]
    return own.solve(
        0,
        jacobian,
        command,
        0.02 * np.eye(count),
        np.full(count, -limit),
        np.full(count, limit),
        np.zeros((0, count)),
        np.zeros(count) if before is None else before,
        0.01,
    )


class TestInClosedForm:
    def test_two_levels(self, cascade: Make) -> None:
        """x = 50·1 / (50 + 0.02) for the first; the second wants x + y = 3 and has y alone for it."""
        jacobian, command = np.array([[1.0, 0.0], [1.0, 1.0]]), np.array([1.0, 3.0])
        found = solve_plainly(cascade(50.0, 5.0), jacobian, command)
        x = 50 / 50.02
        np.testing.assert_allclose(found.velocity, [x, 5 * (3 - x) / 5.02], atol=1e-9)
        np.testing.assert_array_equal(found.freedom, [1, 1])

    def test_acceleration_cost_draws_to_the_velocity_before(self, cascade: Make) -> None:
        """ρ (x - 1)² + 0.02 x² + a/dt² (x - 4)², a/dt² = 0.4."""
        found = solve_plainly(
            cascade(50.0, acceleration=4e-5), np.array([[1.0, 0.0]]), np.array([1.0]), before=np.array([4.0, -2.0])
        )
        np.testing.assert_allclose(found.velocity, [(50 + 0.4 * 4) / 50.42, -2 * 0.4 / 0.42], atol=1e-9)

    def test_the_second_level_gets_what_the_first_leaves_within_limits(self, cascade: Make) -> None:
        jacobian, command = np.array([[1.0, 0.0], [1.0, 1.0]]), np.array([5.0, 30.0])
        found = solve_plainly(cascade(50.0, 5.0), jacobian, command, limit=2.0)
        np.testing.assert_allclose(found.velocity, [2.0, 2.0], atol=1e-12)

    def test_nothing_left(self, cascade: Make) -> None:
        """A second level on the same direction, and a third behind one that took all."""
        same = solve_plainly(cascade(50.0, 5.0), np.array([[1.0, 0.0], [2.0, 0.0]]), np.array([1.0, 9.0]))
        np.testing.assert_allclose(same.velocity, [50 / 50.02, 0.0], atol=1e-9)
        np.testing.assert_array_equal(same.freedom, [1, 0])
        full = solve_plainly(cascade(50.0, 50.0, 5.0), np.eye(3, 2) + np.eye(3, 2, -2), np.array([1.0, 1.0, 9.0]))
        np.testing.assert_allclose(full.velocity, np.full(2, 50 / 50.02), atol=1e-9)
        np.testing.assert_array_equal(full.freedom, [1, 1, 0])
        assert full.qps == 2

    def test_a_task_of_weight_zero_takes_no_freedom(self, cascade: Make) -> None:
        jacobian, command = np.array([[1.0, 0.0], [1.0, 0.0]]), np.array([7.0, 1.0])
        found = solve_plainly(cascade(50.0, 50.0, of_rows=np.array([0.0, 1.0])), jacobian, command)
        np.testing.assert_allclose(found.velocity, [50 / 50.02, 0.0], atol=1e-9)

    @pytest.mark.parametrize("size", [1e-3, 1e-6, 1e-8, 1e-9, 1e-12])
    def test_near_singular_levels_stay_too(self, size: float, cascade: Make) -> None:
        """Whatever a level can hardly move, the next moves it by no more than 1e-6, as fast as joints are."""
        jacobian, command = np.array([[1.0, 0.0], [1.0, 1.0]]), np.array([0.0, 50.0])
        jacobian[0] = [1.0, size]
        first = solve_plainly(cascade(50.0), jacobian[:1], command[:1], limit=100.0)
        both = solve_plainly(cascade(50.0, 5e6), jacobian, command, limit=100.0)
        assert abs(jacobian[0] @ (both.velocity - first.velocity)) <= 1e-6


def test_a_level_whose_qp_fails_keeps_the_one_before(monkeypatch: pytest.MonkeyPatch, cascade: Make) -> None:
    """After the second try in a coarser unit."""
    real, calls = daqp.solve, []

    def failing(*problem: Array) -> tuple[Array, float, int, dict[str, float]]:
        calls.append(len(problem[1]))
        x, value, flag, info = real(*problem)
        return x, value, (flag if len(calls) < 2 else -1), info

    jacobian, command = np.eye(3), np.ones(3)
    monkeypatch.setattr(daqp, "solve", failing)
    found = solve_plainly(cascade(50.0, 50.0, 50.0), jacobian, command)
    assert found.failed == 1
    assert calls == [3, 2, 2]
    np.testing.assert_allclose(found.velocity, [50 / 50.02, 0.0, 0.0], atol=1e-9)


def test_a_qp_that_fails_is_tried_in_a_coarser_unit(monkeypatch: pytest.MonkeyPatch, cascade: Make) -> None:
    real, calls = daqp.solve, []

    def failing(*problem: Array) -> tuple[Array, float, int, dict[str, float]]:
        calls.append(float(np.abs(problem[1]).max()))
        x, value, flag, info = real(*problem)
        return x, value, (flag if len(calls) % 2 == 0 else -1), info

    monkeypatch.setattr(daqp, "solve", failing)
    jacobian, command = np.array([[1.0, 0.0], [1.0, 1.0]]), np.array([1.0, 3.0])
    found = solve_plainly(cascade(50.0, 5.0), jacobian, command)
    assert found.failed is None
    np.testing.assert_allclose(calls[::2], 1e3 * np.array(calls[1::2]))
    np.testing.assert_allclose(found.velocity, [50 / 50.02, 5 * (3 - 50 / 50.02) / 5.02], atol=1e-9)


def test_nan_from_the_qp_is_a_failure(monkeypatch: pytest.MonkeyPatch, cascade: Make) -> None:
    """daqp returns NaN as success."""
    monkeypatch.setattr(daqp, "solve", lambda *problem: (np.full(len(problem[1]), np.nan), 0.0, 1, {}))
    found = solve_plainly(cascade(50.0), np.eye(1, 2), np.ones(1))
    assert found.failed == 0
    np.testing.assert_array_equal(found.velocity, [0.0, 0.0])


def test_one_level_agrees_with_scipy(freedom: type[Freedom]) -> None:
    """Bounds, rows and a full inertia at once, by another kind of solver."""
    rng = np.random.default_rng(3)
    for _ in range(5):
        jacobian, command, root = rng.normal(size=(4, 6)), 4 * rng.normal(size=4), rng.normal(size=(6, 6))
        inertia, rows = root @ root.T / 6 + 0.02 * np.eye(6), rng.normal(size=(2, 6))
        lower, upper = np.full(8, -1.0), np.full(8, 1.0)
        lower[6:], upper[6:] = -0.5, 0.5
        own = Cascade([Priority(0, slice(0, 1), 50.0, 0.0)], [slice(0, 4)], np.ones((1, 4)), np.ones(6), freedom)
        found = own.solve(0, jacobian, command, inertia, lower, upper, rows, np.zeros(6), 0.01).velocity

        def cost(x: Array, j: Array = jacobian, v: Array = command, a: Array = inertia) -> float:
            return float(50 * np.sum((j @ x - v) ** 2) + x @ a @ x)

        both = np.concatenate([rows, -rows])
        held = {"type": "ineq", "fun": lambda x, both=both: 0.5 - both @ x, "jac": lambda _, both=both: -both}
        best = minimize(cost, np.zeros(6), bounds=[(-1, 1)] * 6, constraints=held, method="SLSQP", tol=1e-12)
        assert cost(found) <= best.fun * (1 + 1e-6)
        assert (np.abs(rows @ found) <= 0.5 + 1e-8).all()
        np.testing.assert_allclose(found, best.x, atol=1e-3)
