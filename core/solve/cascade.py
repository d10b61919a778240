"""Strict priorities: one QP a level, each in the null space of those before [Lim2022 eq. 14].

    min_q̇  ρ ‖J_p q̇ - v_p‖²_W + ‖q̇‖²_A + a ‖(q̇ - q̇_before)/dt‖²   s.t.  lower ≤ (q̇, C q̇) ≤ upper,  J_n q̇ = J_n q̇_{p-1}  for n < p

The equalities are not handed to a solver but removed: q̇ = q̇_{p-1} + N y, N an orthonormal basis of what moves no higher level, and the QP is
in y. As y = 0 stands for the solution before, no level is ever infeasible, and a level for which nothing is left is simply skipped.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

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
    """velocity: (c,). freedom: per level, the dimensions in which it could move its own tasks, 0 = none.

    qps: how many were solved. failed: the level whose QP failed, whereupon the solution of those before was kept, or None.
    """

    velocity: Array
    freedom: NDArray[np.int64]
    qps: int
    failed: int | None = None


class Cascade:
    """Solver for one set of levels, with its work space. Not thread-safe.

    levels: first to last; rows: the Jacobian rows of each. speed: (c,) rad/s that no joint exceeds; it says which directions are null.
    """

    def __init__(self, levels: Sequence[Priority], rows: Sequence[slice], speed: Array) -> None:
        self._levels, self._rows = tuple(levels), tuple(rows)
        # A direction n with |J n| below this moves nothing by more than LEAK at any speed within the limits.
        self.tolerance = LEAK / max(float(np.linalg.norm(speed)), 1.0)

    def solve(
        self,
        jacobian: Array,
        command: Array,
        weight: Array,
        inertia: Array,
        lower: Array,
        upper: Array,
        constraints: Array,
        before: Array,
        step_s: float,
    ) -> CascadeStep:
        """The joint velocities that follow `command` (R,) by priority.

        jacobian (R, c), weight (R,) ≥ 0 of its rows. inertia (c, c) = A, positive definite. lower, upper (c + k,): bounds on the velocities, then on
        `constraints` (k, c) times them; lower ≤ 0 ≤ upper. before: (c,) the last step's velocities. All finite.
        """
        count = len(before)
        velocity, freedom, qps = np.zeros(count), np.zeros(len(self._levels), np.int64), 0
        reached = np.zeros(len(lower))  # the constraints' values at `velocity`
        directions = np.concatenate([np.eye(count), constraints])  # (I; C) N
        own = inertia  # Nᵀ A N
        for number, (level, rows) in enumerate(zip(self._levels, self._rows, strict=True)):
            basis = directions[:count]
            full, importance = jacobian[rows], level.weight * weight[rows]
            reduced = full @ basis
            if not importance.all():
                reduced *= (importance > 0.0)[:, None]
            last = number + 1 == len(self._levels)
            rank, null = (self._any(reduced), None) if last else self._null_space(reduced)
            freedom[number] = rank
            weighted = reduced.T * importance
            hessian, pull = weighted @ reduced + own, inertia @ velocity
            if level.acceleration_s2 > 0.0:
                factor = level.acceleration_s2 / step_s**2
                hessian.reshape(-1)[:: len(hessian) + 1] += factor  # NᵀN = I
                pull += factor * (velocity - before)
            gradient = weighted @ (full @ velocity - command[rows]) + basis.T @ pull
            step = self._qp(hessian, gradient, lower - reached, upper - reached, directions, number == 0)
            qps += 1
            if step is None:
                return CascadeStep(velocity, freedom, qps, number)
            moved = directions @ step
            velocity += moved[:count]
            reached += moved
            if null is not None:
                if not null.shape[1]:
                    break
                directions, own = directions @ null, null.T @ own @ null
        np.clip(velocity, lower[:count], upper[:count], out=velocity)
        return CascadeStep(velocity, freedom, qps)

    def _null_space(self, reduced: Array) -> tuple[int, Array]:
        """Rank of `reduced` (r, f) and an orthonormal basis (f, f - rank) of the directions that it sends to nothing."""
        _, sizes, right = np.linalg.svd(reduced)
        rank = int((sizes > self.tolerance).sum())
        return rank, right[rank:].T

    def _any(self, reduced: Array) -> int:
        """A bound on the rank of `reduced` (r, f) that is 0 where it is."""
        return min(reduced.shape) if np.linalg.norm(reduced) > self.tolerance else 0

    def _qp(
        self, hessian: Array, gradient: Array, lower: Array, upper: Array, directions: Array, first: bool
    ) -> Array | None:
        """y of one level; None when the QP fails. The first level's `directions` start with the identity."""
        np.minimum(lower, 0.0, out=lower)  # what a higher level left at its bound, to daqp's tolerance, may stay there
        np.maximum(upper, 0.0, out=upper)
        matrix = directions[len(gradient) :] if first else directions
        sense = np.zeros(len(lower), np.intc)
        step, _, flag, _ = daqp.solve(hessian, QP_SCALE * gradient, matrix, QP_SCALE * upper, QP_SCALE * lower, sense)
        if flag not in (1, 2):
            return None
        step = np.asarray(step, float) / QP_SCALE
        return step if np.isfinite(step).all() else None
