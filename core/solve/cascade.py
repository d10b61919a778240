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
from retarget.core.solve.freedom import QP_SCALE, ControlStep, Freedom, Qp
from retarget.core.solve.priorities import Priority
from retarget.core.types import Array

LEAK = 1e-6
"""m/s and rad/s: by how much the lower levels together may move a task of a higher one."""


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
    exceeds; it says which directions are null. freedom: `Freedom`, or the compiled one.
    """

    def __init__(
        self,
        levels: Sequence[Priority],
        rows: Sequence[slice],
        weight: Array,
        speed: Array,
        freedom: type[Freedom] = Freedom,
    ) -> None:
        self.freedom = freedom
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
        count, last, scale = self._count, len(self._levels) - 1, self._scale[frame]
        left = self.freedom(
            ControlStep(jacobian[:count], scale, command[:count], inertia, lower, upper, constraints, before)
        )
        freedom = np.zeros(len(self._levels), np.int64)
        for number, (level, tasks) in enumerate(zip(self._levels, self._rows, strict=True)):
            step = _solved(left.qp(tasks, level.acceleration_s2 / step_s**2))
            if step is not None:
                left.add(step)
            tolerance = self._tolerance[frame][number]
            freedom[number] = left.most(tasks, tolerance) if number == last else left.take(tasks, tolerance)
            if step is None or not left.left:
                break
        return CascadeStep(_inside(left.velocity, lower, upper), freedom, number + 1, number if step is None else None)


def _solved(qp: Qp) -> Array | None:
    """y of one level; None when the QP fails."""
    step = _by_daqp(qp)
    if step is not None:
        return step
    # Where nearly parallel limits bind, the finer unit may be too fine.
    coarse = qp._replace(gradient=qp.gradient / QP_SCALE, lower=qp.lower / QP_SCALE, upper=qp.upper / QP_SCALE)
    step = _by_daqp(coarse)
    return None if step is None else QP_SCALE * step


def _by_daqp(qp: Qp) -> Array | None:
    sense = np.zeros(len(qp.lower), np.intc)
    step, _, flag, _ = daqp.solve(qp.hessian, qp.gradient, qp.directions, qp.upper, qp.lower, sense)
    return step if flag in (1, 2) and isfinite(step @ step) else None


def _inside(velocity: Array, lower: Array, upper: Array) -> Array:
    """`velocity` (c,) without what daqp's tolerance left outside the joints' own bounds."""
    np.maximum(velocity, lower[: len(velocity)], out=velocity)
    return np.minimum(velocity, upper[: len(velocity)], out=velocity)
