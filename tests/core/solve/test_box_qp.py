"""Box QPs against every possible active set, against daqp, and where they are ill-conditioned, degenerate or have no answer."""

from __future__ import annotations

from itertools import product

import daqp
import mujoco
import numpy as np
import pytest
from retarget.core.errors import SolverError
from retarget.core.solve.box_qp import BoxQp, by_active_sets
from retarget.core.types import Array

Problem = tuple[Array, Array, Array, Array]


def random_problem(rng: np.random.Generator, n: int, condition: float = 1e2, tight: float = 0.3) -> Problem:
    vectors, _ = np.linalg.qr(rng.normal(size=(n, n)))
    hessian = (vectors * np.geomspace(1.0, 1.0 / condition, n)) @ vectors.T
    return 0.5 * (hessian + hessian.T), rng.normal(size=n), -rng.uniform(0, tight, n), rng.uniform(0, tight, n)


def by_enumeration(hessian: Array, gradient: Array, lower: Array, upper: Array) -> Array:
    """The best of all points that are stationary on some face of the box: slow and certain."""
    n, best, found = len(gradient), np.inf, np.zeros(len(gradient))
    for faces in product((0, 1, 2), repeat=n):
        free = np.array([face == 0 for face in faces])
        x = np.where(np.array(faces) == 1, lower, upper)
        if free.any():
            rhs = -gradient[free] - hessian[np.ix_(free, ~free)] @ x[~free]
            x[free] = np.linalg.solve(hessian[np.ix_(free, free)], rhs)
        if (x >= lower - 1e-12).all() and (x <= upper + 1e-12).all():
            value = 0.5 * x @ hessian @ x + gradient @ x
            if value < best:
                best, found = value, x
    return found


def violation(problem: Problem, x: Array) -> float:
    """Largest violation of the Karush-Kuhn-Tucker conditions."""
    hessian, gradient, lower, upper = problem
    slope = hessian @ x + gradient
    at_lower, at_upper = x <= lower + 1e-13, x >= upper - 1e-13
    wrong = np.where(at_lower, np.maximum(-slope, 0), np.where(at_upper, np.maximum(slope, 0), np.abs(slope)))
    outside = np.maximum(np.maximum(lower - x, x - upper), 0)
    return float(max(wrong.max(), outside.max()))


@pytest.mark.parametrize("scale", [1.0, 1e6])
@pytest.mark.parametrize("n", [1, 2, 3, 5, 6])
def test_finds_what_enumeration_finds(n: int, scale: float) -> None:
    rng, solver = np.random.default_rng(n), BoxQp(n, scale)
    for _ in range(40):
        problem = random_problem(rng, n, tight=1.0)
        x = solver.solve(*problem)
        assert x is not None
        np.testing.assert_allclose(x, by_enumeration(*problem), atol=1e-7 / scale**0.5)


@pytest.mark.parametrize("condition", [1e2, 1e5, 1e8])
def test_agrees_with_daqp_and_the_optimality_conditions(condition: float) -> None:
    rng, n = np.random.default_rng(int(condition)), 32
    solver = BoxQp(n, 1e6)
    for _ in range(60):
        problem = random_problem(rng, n, condition)
        x = solver.solve(*problem)
        assert x is not None
        assert violation(problem, x) < 1e-11
        hessian, gradient, lower, upper = problem
        by_daqp, _, flag, _ = daqp.solve(
            hessian, gradient, np.zeros((0, n)), upper.copy(), lower.copy(), np.zeros(n, np.intc)
        )
        assert flag in (1, 2)
        np.testing.assert_allclose(hessian @ x, hessian @ by_daqp, atol=1e-6)


def test_an_answer_that_is_not_optimal_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """`mju_boxQP` that says success at a point of its own choice: daqp must have the last word."""
    rng, n = np.random.default_rng(0), 8

    def wrong(x: Array, *_: Array) -> int:
        x[:] = 0.01
        return n

    problem = random_problem(rng, n)
    solver = BoxQp(n)
    expected = np.array(solver.solve(*problem))
    monkeypatch.setattr(mujoco, "mju_boxQP", wrong)
    np.testing.assert_allclose(solver.solve(*problem), expected, atol=1e-9)
    assert solver.fallbacks == 1


@pytest.mark.parametrize("scale", [1.0, 1e6])
def test_locked_variables_stay(scale: float) -> None:
    """Equal bounds, some away from zero: the others are the optimum of the smaller problem."""
    rng = np.random.default_rng(0)
    hessian, gradient, lower, upper = random_problem(rng, 6)
    lower[[1, 4]] = upper[[1, 4]] = [0.0, 0.1]
    x = BoxQp(6, scale).solve(hessian, gradient, lower, upper)
    assert x is not None
    np.testing.assert_allclose(x[[1, 4]], [0.0, 0.1], atol=1e-12)
    free, held = [0, 2, 3, 5], [1, 4]
    smaller = BoxQp(4, scale).solve(
        np.ascontiguousarray(hessian[np.ix_(free, free)]),
        gradient[free] + hessian[np.ix_(free, held)] @ x[held],
        lower[free],
        upper[free],
    )
    assert smaller is not None
    np.testing.assert_allclose(x[free], smaller, atol=1e-9)


def test_all_locked() -> None:
    zero = np.zeros(3)
    np.testing.assert_array_equal(BoxQp(3).solve(np.eye(3), np.ones(3), zero, zero), zero)


def test_an_indefinite_problem_has_no_answer() -> None:
    box = np.ones(3)
    problem = (np.diag([1.0, -1.0, 2.0]), np.array([0.1, 0.2, -0.1]), -box, box)
    assert BoxQp(3).solve(*problem) is None
    assert BoxQp(3).solve(*problem, thorough=True) is None


class TestRows:
    def test_rows_that_bind(self) -> None:
        """min ½‖x - (2, 2)‖² with x + y ≤ 1 in the box [-1, 1]²: (½, ½); with x - y = 1 as well: (1, 0)."""
        box, target = np.ones(2), np.array([2.0, 2.0])
        solver = BoxQp(2)
        one = solver.solve_with_rows(
            np.eye(2), -target, -box, box, np.array([[1.0, 1.0]]), np.array([-10.0]), np.array([1.0])
        )
        np.testing.assert_allclose(one, [0.5, 0.5], atol=1e-9)
        both = solver.solve_with_rows(
            np.eye(2), -target, -box, box, np.array([[1.0, 1.0], [1.0, -1.0]]), np.array([-10.0, 1.0]), np.ones(2)
        )
        np.testing.assert_allclose(both, [1.0, 0.0], atol=1e-6)

    def test_rows_that_contradict_the_box(self) -> None:
        with pytest.raises(SolverError, match="no solution"):
            BoxQp(2).solve_with_rows(
                np.eye(2),
                np.zeros(2),
                -np.ones(2),
                np.ones(2),
                np.array([[1.0, 1.0]]),
                np.array([3.0]),
                np.array([4.0]),
            )

    def test_coupled_answers_satisfy_the_optimality_conditions(self) -> None:
        """Random rows through the box: solve_coupled against daqp, and its rows met far better than daqp's 1e-6."""
        rng, n, m = np.random.default_rng(0), 12, 3
        solver, bound = BoxQp(n, 1e6), 0
        for _ in range(60):
            hessian, gradient, lower, upper = random_problem(rng, n)
            rows = rng.normal(size=(m, n))
            low, high = -rng.uniform(0, 0.1, m), rng.uniform(0, 0.1, m)
            x = solver.solve_coupled(hessian, gradient, lower, upper, rows, low, high)
            assert x is not None
            value = rows @ x
            assert ((value >= low - 1e-12) & (value <= high + 1e-12)).all()
            assert ((x >= lower - 1e-12) & (x <= upper + 1e-12)).all()
            expected = solver.solve_with_rows(hessian, gradient, lower, upper, rows, low, high)
            np.testing.assert_allclose(x, expected, atol=1e-7)
            bound += bool(((value < low + 1e-9) | (value > high - 1e-9)).any())
        assert bound > 30


class TestActiveSets:
    def test_agrees_where_everything_is_convex(self) -> None:
        rng = np.random.default_rng(1)
        for _ in range(50):
            problem = random_problem(rng, 8)
            x = by_active_sets(*problem)
            assert x is not None
            np.testing.assert_allclose(x, BoxQp(8, 1e6).solve(*problem), atol=1e-10)

    def test_needs_convexity_only_on_what_is_free(self) -> None:
        """The cost falls along x₀ beyond its bound ever faster (-1 on the diagonal): held there, the rest is convex."""
        hessian = np.array([[-1.0, 0.3, 0.0], [0.3, 2.0, 0.5], [0.0, 0.5, 1.0]])
        gradient = np.array([-1.0, 0.2, -0.1])
        lower, upper = np.array([-1.0, -1.0, -1.0]), np.array([0.0, 1.0, 1.0])
        for x in (
            by_active_sets(hessian, gradient, lower, upper),
            BoxQp(3).solve(hessian, gradient, lower, upper, thorough=True),
        ):
            assert x is not None
            assert x[0] == 0.0
            np.testing.assert_allclose(x[1:], np.linalg.solve(hessian[1:, 1:], -gradient[1:]), atol=1e-12)

    def test_needs_convexity_only_along_held_rows(self) -> None:
        """Indefinite along (1, 1), which a touched row forbids: the answer is the optimum along (1, -1)."""
        along, across = np.array([1.0, -1.0]) / np.sqrt(2), np.array([1.0, 1.0]) / np.sqrt(2)
        hessian = 2.0 * np.outer(along, along) - 1.0 * np.outer(across, across)
        gradient = -0.4 * along - 1.0 * across
        box = np.ones(2)
        x = by_active_sets(hessian, gradient, -box, box, across[None], np.array([-1.0]), np.array([0.0]))
        assert x is not None
        np.testing.assert_allclose(x, 0.2 * along, atol=1e-12)

    def test_indefinite_where_it_is_free(self) -> None:
        box = np.ones(2)
        assert by_active_sets(np.diag([1.0, -1.0]), np.array([0.1, 0.1]), -box, box) is None
