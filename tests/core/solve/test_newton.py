"""Single frames: the optimum against SciPy, ridges, damping; following a clip when a frame fails."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest
from retarget.core import rotations
from retarget.core.errors import SolverError
from retarget.core.robot_model import RobotModel
from retarget.core.solve.newton import Converged, FrameSolver, NewtonOptions, Path, remaining
from retarget.core.solve.problem import orientation_problem
from retarget.core.types import FRAME_MARKED, Array, Targets, Task
from scipy.optimize import minimize

Models = Callable[[str], RobotModel]
Swinging = Callable[..., Targets]
Cost = Callable[..., float]


@pytest.mark.parametrize("twist_weight", [1.0, 0.1])
@pytest.mark.parametrize("robot", ["g1", "icub", "baxter"])
def test_no_other_optimiser_finds_better(
    robot: str, twist_weight: float, model: Models, swinging: Swinging, independent_cost: Cost
) -> None:
    """SLSQP with numerical gradients, from where Newton's method ends: nothing left to gain, and the reported cost is the cost."""
    chosen = model(robot)
    targets = swinging(chosen, 2, twist_weight=twist_weight, misalignment=0.3)
    problem = orientation_problem(targets, chosen, free_base=chosen.base_is_floating)
    options = NewtonOptions(posture_weight=1e-3)
    found = FrameSolver(problem, options).converge(
        1, chosen.configuration(problem.reference), problem.lower, problem.upper
    )
    assert found.done
    assert found.cost == pytest.approx(independent_cost(problem, 1, found.q, 1e-3), abs=1e-10)
    base, joints = problem.base_columns, found.q[-len(problem.lower) :]

    def cost(x: Array) -> float:
        full = np.zeros(chosen.pin_model.nv)
        full[-problem.columns :] = x
        return independent_cost(problem, 1, pin.integrate(chosen.pin_model, found.q, full), 1e-3)

    lower = np.concatenate([np.full(base, -0.3), np.maximum(problem.lower - joints, -0.3)])
    upper = np.concatenate([np.full(base, 0.3), np.minimum(problem.upper - joints, 0.3)])
    constraints = []
    if problem.coupled is not None:
        matrix, rows_lower, rows_upper = problem.coupled
        room = np.concatenate([rows_upper - matrix @ joints, matrix @ joints - rows_lower])
        assert (room > 0).all()
        rows = np.hstack([np.zeros((2 * len(matrix), base)), np.vstack([-matrix, matrix])])
        constraints = [{"type": "ineq", "fun": lambda x: room + rows @ x, "jac": lambda _: rows}]
    rng = np.random.default_rng(0)
    for spread in (0.0, 0.02):
        start = np.clip(rng.normal(0, spread, len(lower)) if spread else np.zeros(len(lower)), lower, upper)
        best = minimize(
            cost, start, bounds=list(zip(lower, upper, strict=True)), constraints=constraints, method="SLSQP",
            options={"maxiter": 60, "ftol": 1e-12},
        )  # fmt: skip
        if all(constraint["fun"](best.x).min() > -1e-9 for constraint in constraints):
            assert best.fun >= found.cost - 1e-7


def test_bounds_hold_and_what_is_left_pushes_against_them(model: Models, swinging: Swinging) -> None:
    """The optimality conditions at the answer, with a box that binds: free slopes vanish, held ones point outward."""
    g1 = model("g1")
    problem = orientation_problem(swinging(g1, 2, misalignment=0.5), g1, free_base=True)
    solver = FrameSolver(problem, NewtonOptions())
    lower = np.clip(problem.reference - 0.1, problem.lower, problem.upper)
    upper = np.clip(problem.reference + 0.1, problem.lower, problem.upper)
    found = solver.converge(0, g1.configuration(problem.reference), lower, upper)
    solver.cost(0, found.q)
    slope, joints = solver._equations.gradient, found.q[-len(lower) :]
    assert ((joints >= lower) & (joints <= upper)).all()
    low, high = joints == lower, joints == upper
    assert 5 < np.count_nonzero(low | high) < len(lower)
    assert (slope[3:][low] >= -1e-9).all()
    assert (slope[3:][high] <= 1e-9).all()
    assert np.abs(slope[3:][~(low | high)]).max() < 1e-8
    assert np.abs(slope[:3]).max() < 1e-8


def ridge(arm: RobotModel) -> FrameSolver:
    """A hinge about z whose link should point backward and up: turned by 0 it stands on the ridge between both ways around."""
    backward_up = rotations.exp(np.array([[0.0, -2.6, 0.0]]))
    task = Task("a", "orientation", backward_up, twist_weight=0.0, axis=np.array([1.0, 0.0, 0.0]))
    return FrameSolver(orientation_problem(Targets(np.zeros(1), (task,)), arm, free_base=False), NewtonOptions())


def test_a_ridge_is_left_to_the_side_that_the_rule_names(sliding_arm: RobotModel) -> None:
    solver = ridge(sliding_arm)
    p = solver.problem
    assert np.abs(solver._equations.gradient).max(initial=0) < np.inf
    on_top = solver.cost(0, np.zeros(3))
    found = solver.converge(0, np.zeros(3), p.lower, p.upper)
    assert found.done
    assert found.q[sliding_arm.joint_index("first")] == pytest.approx(2.0)
    assert found.cost < on_top - 0.1
    other_side = solver.converge(0, np.array([-0.2, 0.0, 0.0]), p.lower, p.upper)
    assert other_side.q[sliding_arm.joint_index("first")] == pytest.approx(-2.0)
    assert other_side.cost == pytest.approx(found.cost, abs=1e-12)


def test_far_starts_converge_downhill(model: Models, swinging: Swinging) -> None:
    """From anywhere: a stationary point, reached without the cost ever rising (each start's cost bounds what it leads to)."""
    g1 = model("g1")
    problem = orientation_problem(swinging(g1, 1, misalignment=0.5, twist_weight=0.1), g1, free_base=True)
    solver, rng = FrameSolver(problem, NewtonOptions()), np.random.default_rng(0)
    done = 0
    for _ in range(20):
        q = g1.configuration(rng.uniform(problem.lower, problem.upper), rotations.exp(rng.normal(size=3)))
        before = solver.cost(0, q)
        found = solver.converge(0, q, problem.lower, problem.upper)
        assert found.cost <= before
        done += found.done
    assert done >= 18


def test_running_out_of_iterations_is_said(model: Models, swinging: Swinging) -> None:
    g1 = model("g1")
    problem = orientation_problem(swinging(g1, 2), g1, free_base=True)
    found = FrameSolver(problem, NewtonOptions(max_iterations=1)).converge(
        0, g1.configuration(problem.reference), problem.lower, problem.upper
    )
    assert not found.done
    assert found.iterations == 1


def test_remaining() -> None:
    """A geometric series' rest; unknown from one term; endless when terms grow."""
    assert remaining(0.25, 0.5) == pytest.approx(0.25)
    assert remaining(1e-3, 1.0) == pytest.approx(1e-6, rel=2e-3)
    assert remaining(0.1, np.inf) == 0.1
    assert remaining(0.2, 0.1) == np.inf
    assert remaining(0.0, 0.0) == 0.0


class TestFollow:
    def path(self, solver: FrameSolver) -> Path:
        problem = solver.problem
        path = Path.empty(len(problem.time), problem.model.pin_model.nq)
        path.put(0, solver.converge(0, problem.model.configuration(problem.reference), problem.lower, problem.upper))
        return path

    def test_a_frame_that_fails_holds_and_is_marked(
        self, model: Models, swinging: Swinging, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        g1 = model("g1")
        problem = orientation_problem(swinging(g1, 12), g1, free_base=True)
        converge = FrameSolver.converge

        def failing(self: FrameSolver, k: int, q: Array, lower: Array, upper: Array) -> Converged:
            if k in (5, 6):
                raise SolverError("injected")
            return converge(self, k, q, lower, upper)

        monkeypatch.setattr(FrameSolver, "converge", failing)
        solver = FrameSolver(problem, NewtonOptions())
        path = self.path(solver)
        assert solver.follow(path, 0, 11) == 11
        assert np.flatnonzero(path.status == FRAME_MARKED).tolist() == [5, 6]
        np.testing.assert_array_equal(path.q[5], path.q[4])
        np.testing.assert_array_equal(path.q[6], path.q[4])
        assert (path.q[7] != path.q[4]).any()
        assert path.cost[6] == pytest.approx(solver.cost(6, path.q[4]), abs=1e-12)

    def test_backward_is_forward_of_the_clip_reversed(self, model: Models, swinging: Swinging) -> None:
        g1 = model("g1")
        problem = orientation_problem(swinging(g1, 20), g1, free_base=True)
        solver = FrameSolver(problem, NewtonOptions())
        forward = self.path(solver)
        solver.follow(forward, 0, 19)
        backward = Path.empty(20, forward.q.shape[1])
        backward.put(19, Converged(forward.q[19], float(forward.cost[19]), 1, True))
        solver.follow(backward, 19, 0)
        np.testing.assert_allclose(backward.q, forward.q, atol=1e-8)

    def test_stops_where_it_is_not_below(self, model: Models, swinging: Swinging) -> None:
        g1 = model("g1")
        problem = orientation_problem(swinging(g1, 12), g1, free_base=True)
        solver = FrameSolver(problem, NewtonOptions())
        path = self.path(solver)
        below = np.full(12, np.inf)
        below[8] = 0.0
        assert solver.follow(path, 0, 11, below) == 7
        assert np.isinf(path.cost[8:]).all()
        assert np.isfinite(path.cost[:8]).all()
