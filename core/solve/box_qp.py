"""min ½xᵀHx + gᵀx over a box, or over a box and linear rows: two exact active-set solvers behind one contract.

MuJoCo's `mju_boxQP` is the faster one; its answer is checked by the optimality conditions, and where these fail daqp solves it again
(in 4 of 3000 ill-conditioned problems it was silently not optimal). Rows go to daqp at once.
"""

from __future__ import annotations

import daqp
import mujoco
import numpy as np
from retarget.core.errors import SolverError
from retarget.core.types import Array

KKT_TOLERANCE = 1e-8
"""Largest accepted violation of the optimality conditions, relative to the gradient's scale."""


class BoxQp:
    """Solver of one size, with its work space. Not thread-safe."""

    def __init__(self, size: int) -> None:
        self._factor = np.zeros((size, size + 7))
        self._index = np.zeros(size, np.int32)
        self._sense = np.zeros(size, np.intc)
        self._no_rows = np.zeros((0, size))
        self.fallbacks = 0

    def solve(self, hessian: Array, gradient: Array, lower: Array, upper: Array, start: Array | None = None) -> Array:
        """x (size,) with lower ≤ x ≤ upper. H symmetric positive definite, all input finite. Raises `SolverError` if both solvers fail."""
        x = np.clip(np.zeros(len(gradient)) if start is None else start, lower, upper)
        # Equal bounds make mju_boxQP raise; a width of 1e-12 rad does no harm.
        wide = np.maximum(upper, lower + 1e-12)
        try:
            free = mujoco.mju_boxQP(x, self._factor, self._index, hessian, gradient, lower, wide)
        except mujoco.FatalError:
            free = -1
        if free >= 0 and optimal(hessian, gradient, lower, wide, x):
            return np.minimum(np.maximum(x, lower), upper)
        self.fallbacks += 1
        return self.solve_with_rows(hessian, gradient, lower, upper, self._no_rows, np.zeros(0), np.zeros(0))

    def solve_with_rows(
        self,
        hessian: Array,
        gradient: Array,
        lower: Array,
        upper: Array,
        rows: Array,
        rows_lower: Array,
        rows_upper: Array,
    ) -> Array:
        """x (size,) with lower ≤ x ≤ upper and rows_lower ≤ rows·x ≤ rows_upper, by daqp. Raises `SolverError` when it fails."""
        sense = np.zeros(len(gradient) + len(rows), np.intc)
        x, _, flag, _ = daqp.solve(
            np.ascontiguousarray(hessian), np.ascontiguousarray(gradient), np.ascontiguousarray(rows),
            np.concatenate([upper, rows_upper]), np.concatenate([lower, rows_lower]), sense,
        )  # fmt: skip
        if flag not in (1, 2) or not np.isfinite(x).all():
            raise SolverError(f"the QP has no solution (daqp exit flag {flag})")
        return np.clip(np.asarray(x, float), lower, upper)


def optimal(hessian: Array, gradient: Array, lower: Array, upper: Array, x: Array) -> bool:
    """Whether x satisfies the Karush-Kuhn-Tucker conditions of the box QP to `KKT_TOLERANCE`."""
    slope = hessian @ x + gradient
    # The projected gradient step vanishes exactly at the optimum of a box-constrained convex problem.
    step = np.minimum(np.maximum(x - slope, lower), upper) - x
    return bool(np.abs(step).max() <= KKT_TOLERANCE * (1.0 + np.abs(gradient).max()))
