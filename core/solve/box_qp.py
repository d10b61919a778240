"""min ½xᵀHx + gᵀx over a box, or over a box and linear rows: exact active-set solvers behind one contract.

MuJoCo's `mju_boxQP` (projected Newton) is the fastest; its answer is checked by the optimality conditions, and where these fail daqp
(dual active set) solves the problem again: in 4 of 3000 ill-conditioned problems `mju_boxQP` was silently not optimal. Where H is positive
definite only on the variables that end up inside their bounds, as it may be at a limit, both give up on the way there; the
primal-dual active set method, which looks at nothing else, does not.
"""

from __future__ import annotations

import daqp
import mujoco
import numpy as np
from retarget.core.errors import SolverError
from retarget.core.types import Array, BoolArray

STOP = 1e-8
"""`mju_boxQP` stops at a free gradient of this length, whatever the problem's units."""

TOUCH = 1e-5
"""A coupled row with less room than this is touched: H may be convex only along it."""

MOST_SETS = 25
"""Active sets after which the primal-dual method is taken to cycle."""


class BoxQp:
    """Solver of one size, with its work space. `fallbacks` counts the problems that daqp had to solve. Not thread-safe.

    warm: start from the last answer instead of zero, for problems that change little from one to the next; the answers are the same.
    scale: `mju_boxQP` is given x, g and the bounds times this, so that it stops at a free gradient of `STOP` / scale.
    """

    def __init__(self, size: int, scale: float = 1.0, *, warm: bool = False) -> None:
        self._scale, self._warm = scale, warm
        self._accepted = (2.0 * STOP / scale + 1e-12) ** 2
        self._factor = np.zeros((size, size + 7))
        self._index = np.zeros(size, np.int32)
        self._x, self._slope, self._step = np.zeros(size), np.zeros(size), np.zeros(size)
        self._scaled = np.zeros((3, size))
        self._no_rows, self._none = np.zeros((0, size)), np.zeros(0)
        self.fallbacks = 0

    def solve(
        self, hessian: Array, gradient: Array, lower: Array, upper: Array, *, thorough: bool = False
    ) -> Array | None:
        """x (size,) with lower ≤ x ≤ upper, to rounding; None when H isn't positive definite enough.

        thorough: it then has to be so only on the variables that end up inside their bounds (`by_active_sets`). H symmetric, all input
        finite, lower ≤ 0 ≤ upper. The result is overwritten by the next call.
        """
        x, slope, step = self._x, self._slope, self._step
        free = self._by_projected_newton(hessian, gradient, lower, upper)
        if free < 0:
            return by_active_sets(hessian, gradient, lower, upper) if thorough else None
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
        if step.dot(step) <= self._accepted * (1.0 + gradient.dot(gradient)):
            return x
        return self._by_daqp(hessian, gradient, lower, upper, self._no_rows, self._none, self._none)

    def solve_coupled(
        self,
        hessian: Array,
        gradient: Array,
        lower: Array,
        upper: Array,
        rows: Array,
        rows_lower: Array,
        rows_upper: Array,
        *,
        thorough: bool = False,
    ) -> Array | None:
        """As `solve`, and with rows_lower ≤ rows·x ≤ rows_upper; 0 must satisfy them."""
        x = self.solve(hessian, gradient, lower, upper, thorough=thorough)
        if x is not None:
            value = rows @ x
            if (value >= rows_lower).all() and (value <= rows_upper).all():
                return x  # the optimum without the rows satisfies them, so it is the optimum
        elif not thorough and (rows_lower < -TOUCH).all() and (rows_upper > TOUCH).all():
            return None
        by_sets = by_active_sets(hessian, gradient, lower, upper, rows, rows_lower, rows_upper)
        if by_sets is not None or x is None:
            return by_sets
        return self._by_daqp(hessian, gradient, lower, upper, rows, rows_lower, rows_upper)

    def _by_daqp(self, *problem: Array) -> Array | None:
        self.fallbacks += 1
        try:
            return self.solve_with_rows(*problem)
        except SolverError:
            return None

    def _by_projected_newton(self, hessian: Array, gradient: Array, lower: Array, upper: Array) -> int:
        """Solve into `_x`; the number of free variables, negative when H isn't positive definite on them."""
        x, scale = self._x, self._scale
        if scale != 1.0:
            if self._warm:
                x *= scale
            g, low, high = self._scaled
            np.multiply(gradient, scale, g)
            np.multiply(lower, scale, low)
            np.multiply(upper, scale, high)
        else:
            g, low, high = gradient, lower, upper
        if not self._warm:
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
        sense, scale = np.zeros(len(gradient) + len(rows), np.intc), self._scale
        # daqp meets bounds to 1e-6 in whatever unit it is given.
        x, _, flag, _ = daqp.solve(
            np.ascontiguousarray(hessian), scale * gradient, np.ascontiguousarray(rows),
            scale * np.concatenate([upper, rows_upper]), scale * np.concatenate([lower, rows_lower]), sense,
        )  # fmt: skip
        if flag not in (1, 2) or not np.isfinite(x).all():
            raise SolverError(f"the QP has no solution (daqp exit flag {flag})")
        return np.asarray(np.minimum(np.maximum(np.asarray(x, float) / scale, lower), upper))


def by_active_sets(
    hessian: Array,
    gradient: Array,
    lower: Array,
    upper: Array,
    rows: Array | None = None,
    rows_lower: Array | None = None,
    rows_upper: Array | None = None,
) -> Array | None:
    """x (n,) with lower ≤ x ≤ upper, rows_lower ≤ rows·x ≤ rows_upper by the primal-dual active set method [Hintermüller, Ito, Kunisch 2002].

    All of them contain 0. Held at first is what stands at a bound and would leave it. None when H is indefinite on what a set leaves
    free, or the sets cycle. H need be positive definite nowhere else.
    """
    n = len(gradient)
    matrix = np.zeros((0, n)) if rows is None else rows
    low_of = np.concatenate([lower, np.zeros(0) if rows_lower is None else rows_lower])
    high_of = np.concatenate([upper, np.zeros(0) if rows_upper is None else rows_upper])
    every = np.vstack([np.eye(n), matrix])
    outward = every @ -gradient
    low, high = (low_of >= 0.0) & (outward < 0.0), (high_of <= 0.0) & (outward > 0.0)
    high &= ~low
    for _ in range(MOST_SETS):
        solved = _with_held(hessian, gradient, every, low, high, np.where(low, low_of, high_of))
        if solved is None:
            return None
        x, push = solved
        free, excess = ~(low | high), np.maximum(low_of - every @ x, every @ x - high_of)
        entering, leaving = free & (excess > 1e-13), (low & (push < 0.0)) | (high & (push > 0.0))
        if not (entering.any() or leaving.any()):
            return x
        if entering[:n].any() or leaving[:n].any():  # the box first, then the rows that stay broken, one at a time
            entering[n:] = leaving[n:] = False
        elif entering.any():
            entering &= excess == excess[entering].max()
        below = entering & (every @ x < low_of)
        low, high = (low & ~leaving) | below, (high & ~leaving) | (entering & ~below)
    return None


def _with_held(
    hessian: Array, gradient: Array, every: Array, low: BoolArray, high: BoolArray, bounds: Array
) -> tuple[Array, Array] | None:
    """The stationary x with the rows low | high of `every` (identity, then rows) at `bounds`, and their multipliers, or None."""
    n = len(gradient)
    held = low | high
    free, at_rows = np.flatnonzero(~held[:n]), np.flatnonzero(held[n:]) + n
    x, push = np.where(held[:n], bounds[:n], 0.0), np.zeros(len(held))
    matrix = every[np.ix_(at_rows, free)]
    block = hessian[np.ix_(free, free)]
    system = np.block([[block, -matrix.T], [matrix, np.zeros((len(at_rows),) * 2)]])
    right = np.concatenate([-(gradient + hessian @ x)[free], bounds[at_rows] - every[at_rows] @ x])
    try:
        # Positive definite along the held rows exactly when it is so after stiffening across them enough.
        np.linalg.cholesky(block + (1e4 * np.abs(block).max(initial=1.0)) * matrix.T @ matrix)
        solution = np.linalg.solve(system, right)
    except np.linalg.LinAlgError:
        return None
    x[free], push[at_rows] = solution[: len(free)], solution[len(free) :]
    push[:n] = np.where(held[:n], hessian @ x + gradient - every[at_rows].T @ push[at_rows], 0.0)
    return x, push
