"""Strict priorities: one QP a level, each in the null space of those before [Lim2022 eq. 14].

    min_q̇  ρ ‖J_p q̇ - v_p‖²_W + ‖q̇‖²_A + a ‖(q̇ - q̇_before)/dt‖²   s.t.  lower ≤ (q̇, C q̇) ≤ upper,  J_n q̇ = J_n q̇_{p-1}  for n < p

The equalities are not handed to a solver but removed: q̇ = q̇_{p-1} + N y, N an orthonormal basis of what moves no higher level, and the QP is
in y. As y = 0 stands for the solution before, no level is ever infeasible, and a level for which nothing is left is simply skipped.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite

import daqp
import numpy as np
from numpy.typing import NDArray
from retarget.core.solve.priorities import Priority
from retarget.core.types import Array

LEAK = 1e-6
"""m/s and rad/s: by how much the lower levels together may move a task of a higher one."""

QP_SCALE = 1e3
"""daqp meets constraints to 1e-6 in the unit that it is given; velocities are given in thousandths."""


@dataclass(frozen=True, eq=False)
class CascadeStep:
    """velocity: (c,). freedom: per level, the dimensions in which it could move its own tasks, 0 = none; of the last level a bound on them.

    qps: how many were solved. failed: the level whose QP failed, whereupon the solution of those before was kept, or None.
    """

    velocity: Array
    freedom: NDArray[np.int64]
    qps: int
    failed: int | None = None


class Cascade:
    """Solver for one set of levels, with its work space. Not thread-safe.

    levels: first to last; rows: the Jacobian rows of each, R in all. weight: (T, R) ≥ 0 of the rows at T frames. speed: (c,) rad/s that no joint
    exceeds; it says which directions are null.
    """

    def __init__(self, levels: Sequence[Priority], rows: Sequence[slice], weight: Array, speed: Array) -> None:
        self._levels, self._rows = tuple(levels), tuple(rows)
        self._count = max(own.stop for own in self._rows)
        importance = np.array(weight[:, : self._count])
        for level, own in zip(self._levels, self._rows, strict=True):
            importance[:, own] *= level.weight
        self._scale = np.sqrt(importance)
        # Lower levels change velocities by twice the limits at most: along a direction n with |J n| below this that moves a task by LEAK at most.
        # Rows are scaled, and so are tolerances.
        tolerance = 0.5 * LEAK / max(float(np.linalg.norm(speed)), 1.0)
        least = np.where(self._scale > 0.0, self._scale, np.inf)
        least = np.stack([least[:, own].min(axis=1) for own in self._rows], axis=1)
        self._tolerance = (tolerance * np.where(np.isfinite(least), least, 1.0)).tolist()

    def solve(
        self,
        frame: int,
        jacobian: Array,
        command: Array,
        inertia: Array,
        lower: Array,
        upper: Array,
        constraints: Array,
        before: Array,
        step_s: float,
    ) -> CascadeStep:
        """The joint velocities that follow `command` (R,) by priority.

        frame: whose weights count. jacobian (R, c). inertia (c, c) = A, positive definite. lower, upper (c + k,): bounds on the velocities, then
        on `constraints` (k, c) times them; lower ≤ 0 ≤ upper. before: (c,) the last step's velocities. All finite.
        """
        joints, limits, last = len(before), len(lower), len(self._levels) - 1
        count, scale, tolerances = self._count, self._scale[frame], self._tolerance[frame]
        # (I; C; √ρ J) N, and what these rows say at the solution so far, less what the tasks want: all in units of 1 / QP_SCALE.
        rows = np.concatenate([np.eye(joints), constraints, scale[:, None] * jacobian[:count]])
        value = np.zeros(len(rows))
        value[limits:] = -QP_SCALE * scale * command[:count]
        low, high, before = QP_SCALE * lower, QP_SCALE * upper, QP_SCALE * before
        velocity, own = value[:joints], inertia  # own: Nᵀ A N
        freedom = np.zeros(len(self._levels), np.int64)
        for number, (level, task_rows) in enumerate(zip(self._levels, self._rows, strict=True)):
            tasks = slice(limits + task_rows.start, limits + task_rows.stop)
            reduced = rows[tasks]
            tolerance = tolerances[number]
            null = None if number == last else _null_space(reduced, tolerance)
            freedom[number] = _any(reduced, tolerance) if null is None else len(null) - null.shape[1]
            hessian = reduced.T @ reduced
            hessian += own
            pull = inertia @ velocity
            if level.acceleration_s2 > 0.0:
                factor = level.acceleration_s2 / step_s**2
                hessian.reshape(-1)[:: len(hessian) + 1] += factor  # NᵀN = I
                pull += factor * (velocity - before)
            gradient = reduced.T @ value[tasks]
            gradient += rows[:joints].T @ pull
            step = _qp(hessian, gradient, low - value[:limits], high - value[:limits], rows[:limits], number == 0)
            if step is None:
                return CascadeStep(_inside(velocity / QP_SCALE, lower, upper), freedom, number + 1, number)
            value += rows @ step
            if null is not None:
                if not null.shape[1]:
                    break
                rows, own = rows @ null, null.T @ own @ null
        return CascadeStep(_inside(velocity / QP_SCALE, lower, upper), freedom, number + 1)


def _null_space(reduced: Array, tolerance: float) -> Array:
    """An orthonormal basis (f, f - rank) of the directions that `reduced` (r, f) sends to no more than `tolerance`."""
    _, sizes, right = np.linalg.svd(reduced)
    null: Array = right[np.count_nonzero(sizes > tolerance) :].T
    return null


def _any(reduced: Array, tolerance: float) -> int:
    """A bound on the rank of `reduced` (r, f) that is 0 where it is."""
    flat = reduced.reshape(-1)
    return min(reduced.shape) if flat @ flat > tolerance**2 else 0


def _qp(hessian: Array, gradient: Array, lower: Array, upper: Array, directions: Array, first: bool) -> Array | None:
    """y of one level; None when the QP fails. The first level's `directions` start with the identity. Overwrites the bounds."""
    np.minimum(lower, 0.0, out=lower)  # what a higher level left at its bound, to daqp's tolerance, may stay there
    np.maximum(upper, 0.0, out=upper)
    matrix = directions[len(gradient) :] if first else directions
    for scale in (1.0, 1.0 / QP_SCALE):  # where nearly parallel limits bind, the finer unit may be too fine for it
        step, _, flag, _ = daqp.solve(
            hessian, scale * gradient, matrix, scale * upper, scale * lower, np.zeros(len(lower), np.intc)
        )
        step = np.asarray(step, float) / scale
        if flag in (1, 2) and isfinite(step @ step):
            return step
    return None


def _inside(velocity: Array, lower: Array, upper: Array) -> Array:
    """`velocity` (c,) without what daqp's tolerance left outside the joints' own bounds."""
    np.maximum(velocity, lower[: len(velocity)], out=velocity)
    return np.minimum(velocity, upper[: len(velocity)], out=velocity)
