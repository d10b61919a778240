"""What higher levels leave to a lower one: q̇ = q̇_{p-1} + N y, N an orthonormal basis of the velocities that move none of their tasks.

`Freedom` is NumPy; `freedom_kernel` has the same, compiled. Velocities are in units of 1 / QP_SCALE.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from retarget.core.types import Array

QP_SCALE = 1e3
"""daqp meets constraints to 1e-6 in the unit that it is given; velocities are given in thousandths."""


class ControlStep(NamedTuple):
    """One control step's rows, c joints. jacobian (R, c), command (R,), and scale (R,), by which both are multiplied: the roots of their weights.

    inertia (c, c) = A, positive definite. lower, upper (c + k,): bounds on the velocities, then on `constraints` (k, c) times them;
    lower ≤ 0 ≤ upper. before: (c,) the last step's velocities. All finite.
    """

    jacobian: Array
    scale: Array
    command: Array
    inertia: Array
    lower: Array
    upper: Array
    constraints: Array
    before: Array


class Qp(NamedTuple):
    """min ½ yᵀ hessian y + gradientᵀ y  s.t.  lower ≤ (y, directions y) ≤ upper, without y when there are as many bounds as directions."""

    hessian: Array
    gradient: Array
    directions: Array
    lower: Array
    upper: Array


class Freedom:
    """The velocity that the levels so far chose, and what they left, of one control step. left: f, the columns of N."""

    def __init__(self, step: ControlStep) -> None:
        joints, limits, scale = len(step.before), len(step.lower), step.scale
        # (I; C; √ρ J) N, and what these rows say at the velocity so far, less what the tasks want.
        self._rows = np.concatenate([np.eye(joints), step.constraints, scale[:, None] * step.jacobian])
        self._value = np.zeros(len(self._rows))
        self._value[limits:] = -QP_SCALE * scale * step.command
        self._lower, self._upper, self._before = (QP_SCALE * x for x in (step.lower, step.upper, step.before))
        self._joints, self._limits, self.left = joints, limits, joints
        self._inertia, self._reduced_inertia = step.inertia, step.inertia  # A, Nᵀ A N

    @property
    def velocity(self) -> Array:
        """(c,), rad/s."""
        return self._value[: self._joints] / QP_SCALE

    def qp(self, tasks: slice, factor: float) -> Qp:
        """The QP of the level with the rows `tasks`. factor: of ‖q̇ - q̇_before‖²."""
        reduced = self._tasks(tasks)
        hessian = reduced.T @ reduced
        hessian += self._reduced_inertia
        velocity, joints = self._value[: self._joints], self._rows[: self._joints]
        pull = self._inertia @ velocity
        if factor > 0.0:
            hessian.reshape(-1)[:: len(hessian) + 1] += factor  # NᵀN = I
            pull += factor * (velocity - self._before)
        gradient = reduced.T @ self._value[self._limits :][tasks]
        gradient += joints.T @ pull
        limited = self._value[: self._limits]
        lower, upper = self._lower - limited, self._upper - limited
        np.minimum(lower, 0.0, out=lower)  # what a higher level left at its bound, to daqp's tolerance, may stay there
        np.maximum(upper, 0.0, out=upper)
        skipped = self._joints if tasks.start == 0 else 0
        return Qp(hessian, gradient, self._rows[skipped : self._limits], lower, upper)

    def add(self, step: Array) -> None:
        """Move on by y = `step` (f,)."""
        self._value += self._rows @ step

    def take(self, tasks: slice, tolerance: float) -> int:
        """Keep the directions that send the rows `tasks` to no more than `tolerance`; how many are gone."""
        null = _null_space(self._tasks(tasks), tolerance)
        self._rows, self._reduced_inertia = self._rows @ null, null.T @ self._reduced_inertia @ null
        left = self.left
        self.left = null.shape[1]
        return left - self.left

    def most(self, tasks: slice, tolerance: float) -> int:
        """A bound on what `take` would return that is 0 where that is."""
        flat = self._tasks(tasks).reshape(-1)
        return min(tasks.stop - tasks.start, self.left) if flat @ flat > tolerance**2 else 0

    def _tasks(self, tasks: slice) -> Array:
        rows: Array = self._rows[self._limits :][tasks]
        return rows


def _null_space(reduced: Array, tolerance: float) -> Array:
    """An orthonormal basis (f, f - rank) of the directions that `reduced` (r, f) sends to no more than `tolerance`."""
    _, sizes, right = np.linalg.svd(reduced)
    null: Array = right[np.count_nonzero(sizes > tolerance) :].T
    return null
