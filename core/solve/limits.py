"""Limits as boxes on one step. A box always contains the step that stays, so no QP is ever infeasible."""

from __future__ import annotations

import numpy as np
from retarget.core.errors import SolverError
from retarget.core.solve.box_qp import BoxQp
from retarget.core.types import Array

ROW_MARGIN_RAD = 1e-7
"""Coupled rows are solved this much inside: what solvers and arithmetic round must not break them."""

TANH_SHARPNESS = 0.5
"""1/rad; the authors' value."""

FREE_SPEED_RAD_S = 100.0
"""Bound on what has no speed limit of its own: the base's rotation."""


def reachable(previous: Array, lower: Array, upper: Array, velocity: Array, step_s: float) -> tuple[Array, Array]:
    """Joint values (n,) and (n,) that may follow `previous` after `step_s` seconds: inside the position limits, no faster than `velocity`.

    `previous` must itself be inside the position limits.
    """
    return np.maximum(lower, previous - velocity * step_s), np.minimum(upper, previous + velocity * step_s)


class DampedVelocityBounds:
    """Velocity bounds in rad/s that fade out toward the position limits [Darvish2019, their code], in place:

    -v tanh(k (s - s_min)) ≤ ṡ ≤ v tanh(k (s_max - s)), k = `TANH_SHARPNESS`; and never a step past a limit within the time step.
    `low` and `high` are (free + n,); the `free` first ones stay ∓`FREE_SPEED_RAD_S`.
    """

    def __init__(self, free: int, lower: Array, upper: Array, velocity: Array) -> None:
        bounds = np.array([[-1.0], [1.0]]) * np.full((2, free + len(lower)), FREE_SPEED_RAD_S)
        self.low, self.high = bounds
        self._of_joints = bounds[:, free:]
        self._limits, self._velocity = np.stack([lower, upper]), velocity
        self._sharpest = TANH_SHARPNESS * float(velocity.max(initial=0.0))
        self._room, self._fading = np.empty((2, len(lower))), np.empty((2, len(lower)))

    def update(self, joints: Array, step_s: float) -> None:
        """Write the bounds at `joints` (n,), which are inside the limits, for a step of `step_s` seconds into `low` and `high`."""
        np.subtract(self._limits, joints, self._room)
        np.multiply(self._room, TANH_SHARPNESS, self._fading)
        np.tanh(self._fading, self._fading)
        np.multiply(self._fading, self._velocity, self._of_joints)
        if self._sharpest * step_s > 1.0:  # only then is the fading bound not below room / time step everywhere
            low, high = self._of_joints
            np.maximum(low, self._room[0] / step_s, low)
            np.minimum(high, self._room[1] / step_s, high)


class CoupledRows:
    """Coupled joints' inequalities as rows over the unknowns of a step: `free` columns of the base, then the joints.

    matrix (m, n), lower and upper (m,): lower ≤ matrix · s ≤ upper. rows: (m, free + n).
    """

    def __init__(self, free: int, matrix: Array, lower: Array, upper: Array) -> None:
        self._matrix, self._lower, self._upper = matrix, lower, upper
        self.rows = np.hstack([np.zeros((len(matrix), free)), matrix])

    def hold(self, joints: Array) -> bool:
        """Whether the rows hold at `joints` (n,)."""
        value = self._matrix @ joints
        return bool((value >= self._lower).all() and (value <= self._upper).all())

    def room(self, joints: Array) -> tuple[Array, Array]:
        """Bounds (m,), (m,) on rows · step from `joints` (n,), which satisfy the rows; drawn in by `ROW_MARGIN_RAD`, never past 0."""
        value = self._matrix @ joints
        return (
            np.minimum(self._lower + ROW_MARGIN_RAD - value, 0.0),
            np.maximum(self._upper - ROW_MARGIN_RAD - value, 0.0),
        )


def nearest_feasible(joints: Array, lower: Array, upper: Array, rows: tuple[Array, Array, Array] | None) -> Array:
    """The joint values (n,) nearest to `joints` inside the limits and the coupled rows. Raises `SolverError` when there are none."""
    inside = np.clip(joints, lower, upper)
    if rows is None:
        return inside
    matrix, rows_lower, rows_upper = rows
    value = matrix @ inside
    if (value >= rows_lower).all() and (value <= rows_upper).all():
        return inside
    try:
        return BoxQp(len(joints)).solve_with_rows(
            np.eye(len(joints)),
            -joints,
            lower,
            upper,
            matrix,
            rows_lower + ROW_MARGIN_RAD,
            rows_upper - ROW_MARGIN_RAD,
        )
    except SolverError:
        raise SolverError("no posture satisfies the joint limits and the coupled-joint rows together") from None
