"""The nearest point of a polytope, against SciPy's general solver and the conditions of optimality."""

from __future__ import annotations

import numpy as np
import pytest
from retarget.core.mapping.projection import Projection
from scipy.optimize import nnls


def dual_solution(metric, rows, start, lower, upper):  # type: ignore[no-untyped-def]
    """The same problem by its dual, a non-negative least squares over the multipliers of all one-sided rows (Lawson and Hanson's
    LDP)."""
    root = np.linalg.cholesky(metric).T  # y = root (x - start): min ‖y‖² subject to G y ≥ h
    g = np.concatenate([rows, -rows]) @ np.linalg.inv(root)
    h = np.concatenate([lower - rows @ start, rows @ start - upper])
    system = np.vstack([g.T, h])
    target = np.zeros(len(system))
    target[-1] = 1.0
    multipliers, _ = nnls(system, target)
    rest = system @ multipliers - target
    return start + np.linalg.solve(root, -rest[:-1] / rest[-1])


@pytest.mark.parametrize("seed", range(40))
def test_agrees_with_the_dual(seed: int) -> None:
    random = np.random.default_rng(seed)
    basis = np.diag([0.6, 0.6, 0.6]) + 0.15 * random.normal(size=(3, 3))
    rows, metric = np.concatenate([basis, np.eye(3)]), basis.T @ basis + 1e-5 * np.eye(3)
    projection = Projection(metric, rows)
    for _ in range(20):
        inside = random.normal(size=3)
        lower, upper = rows @ inside - random.uniform(0, 1, 6), rows @ inside + random.uniform(0, 1, 6)
        start = inside + random.normal(scale=3, size=3)
        found = projection.nearest(start, lower, upper)
        assert (rows @ found <= upper + 1e-9).all()
        assert (rows @ found >= lower - 1e-9).all()
        assert found == pytest.approx(dual_solution(metric, rows, start, lower, upper), abs=1e-7)


def test_a_point_inside_stays_itself() -> None:
    start = np.array([0.1, -0.2, 0.3])
    assert Projection(np.eye(3), np.eye(3)).nearest(start, -np.ones(3), np.ones(3)) is start


def test_a_box_in_its_own_metric_is_clipping() -> None:
    start = np.array([2.0, -0.2, -3.0])
    assert Projection(np.eye(3), np.eye(3)).nearest(start, -np.ones(3), np.ones(3)) == pytest.approx([1.0, -0.2, -1.0])


def test_parallel_rows_and_a_single_point() -> None:
    """Rows that repeat each other, and bounds that leave one point: degenerate, still exact."""
    rows = np.concatenate([np.eye(3), np.eye(3)])
    metric = np.diag([1.0, 2.0, 3.0]) + 0.3
    zero = np.zeros(6)
    assert Projection(metric, rows).nearest(np.array([1.0, 2.0, -1.0]), zero, zero) == pytest.approx(
        np.zeros(3), abs=1e-12
    )
