"""Limits as boxes on one step. A box always contains the step that stays, so no QP is ever infeasible."""

from __future__ import annotations

import numpy as np
from retarget.core.errors import SolverError
from retarget.core.solve.box_qp import BoxQp
from retarget.core.types import Array

ROW_MARGIN_RAD = 1e-7
"""Coupled rows are solved this much inside, because the QP solver meets rows only to its own tolerance."""


def reachable(previous: Array, lower: Array, upper: Array, velocity: Array, step_s: float) -> tuple[Array, Array]:
    """Joint values (n,) and (n,) that may follow `previous` after `step_s` seconds: inside the position limits, no faster than `velocity`.

    `previous` must itself be inside the position limits.
    """
    return np.maximum(lower, previous - velocity * step_s), np.minimum(upper, previous + velocity * step_s)


def damped_velocity_bounds(
    joints: Array, lower: Array, upper: Array, velocity: Array, step_s: float, sharpness: float = 0.5
) -> tuple[Array, Array]:
    """Velocity bounds (n,), (n,) in rad/s that fade out toward the position limits, as in the authors' code of [Darvish2019]:

    -v tanh(k (s - s_min)) ≤ ṡ ≤ v tanh(k (s_max - s)), k = `sharpness` 1/rad; and never a step past the limit within `step_s`.
    """
    room_down, room_up = np.maximum(joints - lower, 0.0), np.maximum(upper - joints, 0.0)
    low = -np.minimum(velocity * np.tanh(sharpness * room_down), room_down / step_s)
    high = np.minimum(velocity * np.tanh(sharpness * room_up), room_up / step_s)
    return low, high


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
