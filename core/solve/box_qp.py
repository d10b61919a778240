"""min ½xᵀHx + gᵀx over a box, or over a box and linear rows: two exact active-set solvers behind one contract.

MuJoCo's `mju_boxQP` (projected Newton) is the faster one; its answer is checked by the optimality conditions, and where these fail daqp
(dual active set) solves the problem again: in 4 of 3000 ill-conditioned problems `mju_boxQP` was silently not optimal.
"""

from __future__ import annotations

import daqp
import mujoco
import numpy as np
from retarget.core.errors import SolverError
from retarget.core.types import Array

STOP = 1e-8
"""`mju_boxQP` stops at a free gradient of this length, whatever the problem's units."""


class BoxQp:
    """Solver of one size, with its work space. `fallbacks` counts the problems that daqp had to solve. Not thread-safe.

    scale: `mju_boxQP` is given x, g and the bounds times this, so that it stops at a free gradient of `STOP` / scale.
    """

    def __init__(self, size: int, scale: float = 1.0) -> None:
        self._scale = scale
        self._factor = np.zeros((size, size + 7))
        self._index = np.zeros(size, np.int32)
        self._x, self._slope, self._step = np.zeros(size), np.zeros(size), np.zeros(size)
        self._scaled = np.zeros((3, size))
        self._no_rows, self._none = np.zeros((0, size)), np.zeros(0)
        self.fallbacks = 0

    def solve(self, hessian: Array, gradient: Array, lower: Array, upper: Array) -> Array | None:
        """x (size,) with lower ≤ x ≤ upper; None when neither solver finds H positive definite enough.

        H symmetric, all input finite, lower ≤ upper. The result is overwritten by the next call.
        """
        x, slope, step = self._x, self._slope, self._step
        free = self._by_projected_newton(hessian, gradient, lower, upper)
        if free < 0:
            return None
        # At the optimum of a convex problem over a box, and only there, the projected gradient step vanishes.
        hessian.dot(x, slope)
        slope += gradient
        if free < len(x):
            np.subtract(x, slope, step)
            np.minimum(step, upper, step)
            np.maximum(step, lower, step)
            step -= x
        else:
            step = slope
        accepted = 2.0 * STOP / self._scale + 1e-12
        if step.dot(step) <= accepted * accepted * (1.0 + gradient.dot(gradient)):
            return x
        self.fallbacks += 1
        try:
            return self.solve_with_rows(hessian, gradient, lower, upper, self._no_rows, self._none, self._none)
        except SolverError:
            return None

    def _by_projected_newton(self, hessian: Array, gradient: Array, lower: Array, upper: Array) -> int:
        """Solve into `_x`; the number of free variables, negative when H isn't positive definite on them."""
        x, scale = self._x, self._scale
        if scale != 1.0:
            g, low, high = self._scaled
            np.multiply(gradient, scale, g)
            np.multiply(lower, scale, low)
            np.multiply(upper, scale, high)
        else:
            g, low, high = gradient, lower, upper
        x.fill(0.0)
        try:
            free = mujoco.mju_boxQP(x, self._factor, self._index, hessian, g, low, high)
        except mujoco.FatalError:
            # Equal bounds (a locked joint) make it raise; a width of 1e-12 does no harm, and is clipped off again.
            np.maximum(high, low + 1e-12 * scale, out=self._scaled[2])
            free = mujoco.mju_boxQP(x, self._factor, self._index, hessian, g, low, self._scaled[2])
            np.minimum(x, high, out=x)
        if scale != 1.0:
            x /= scale
        return int(free)

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
        return np.minimum(np.maximum(np.asarray(x, float), lower), upper)
