"""`Freedom` compiled by numba: the same QPs, several times as fast.

All rows are kept transposed, (f, m): a Householder reflection of the basis is then a sum of long rows. A level's null space is found by QR with
pivots: each reflection turns what can still move one of its tasks most onto one direction of the basis, which is used up, until none can be moved by
more than the tolerance. The directions after these are what is left; nothing is copied.
"""

from __future__ import annotations

import numpy as np
from retarget.core.solve.freedom import QP_SCALE, ControlStep, Freedom, Qp
from retarget.core.solve.jit import jit
from retarget.core.types import Array


class CompiledFreedom(Freedom):
    """As `Freedom`."""

    def __init__(self, step: ControlStep) -> None:
        jacobian, scale, command, self._inertia, self._lower, self._upper, constraints, self._before = (
            np.ascontiguousarray(array) for array in step
        )
        self._rows, self._value = _begin(jacobian, scale, command, constraints, QP_SCALE)
        self._joints, self._task_rows, self._first, self.left = len(step.before), len(scale), 0, len(step.before)

    @property
    def velocity(self) -> Array:
        """(c,), rad/s."""
        velocity: Array = self._value[self._task_rows :][: self._joints] / QP_SCALE
        return velocity

    def qp(self, tasks: slice, factor: float) -> Qp:
        """As `Freedom.qp`."""
        return Qp._make(
            _qp(
                self._rows, self._value, self._first, tasks.start, tasks.stop, self._inertia, self._before, factor,
                self._lower, self._upper, QP_SCALE,
            )
        )  # fmt: skip

    def add(self, step: Array) -> None:
        """As `Freedom.add`."""
        _add(self._rows, self._value, self._first, step)

    def take(self, tasks: slice, tolerance: float) -> int:
        """As `Freedom.take`; the tolerance is every row's own."""
        before, self._first = self._first, _take(self._rows, self._first, tasks.start, tasks.stop, tolerance)
        self.left = self._joints - self._first
        return self._first - before

    def _tasks(self, tasks: slice) -> Array:
        transposed: Array = self._rows[self._first :, tasks]
        return transposed


@jit
def _begin(jacobian: Array, scale: Array, command: Array, constraints: Array, unit: float) -> tuple[Array, Array]:
    """(√ρ J; I; C)ᵀ (c, m), and what these rows say at zero velocity less what the tasks want (m,), in units of 1 / `unit`."""
    tasks, columns, limits = len(scale), jacobian.shape[1], len(constraints)
    rows, value = np.zeros((columns, tasks + columns + limits)), np.zeros(tasks + columns + limits)
    for i in range(tasks):
        value[i] = -unit * scale[i] * command[i]
        for j in range(columns):
            rows[j, i] = scale[i] * jacobian[i, j]
    for j in range(columns):
        rows[j, tasks + j] = 1.0
    for i in range(limits):
        for j in range(columns):
            rows[j, tasks + columns + i] = constraints[i, j]
    return rows, value


@jit
def _qp(
    rows: Array, value: Array, first: int, start: int, stop: int, inertia: Array, before: Array, factor: float,
    lower: Array, upper: Array, unit: float,
) -> tuple[Array, Array, Array, Array, Array]:  # fmt: skip
    """The QP of the level with the tasks start to stop: Hessian (f, f), gradient (f,), rows (m', f), and lower and upper bounds.

    first: of `rows` (c, m) that are left. factor: of ‖y - before‖². The first bounds of the first level are the joints' own, without rows.
    """
    columns, size, limits = len(inertia), len(rows) - first, len(lower)
    joints = rows.shape[1] - limits
    left, own, limited = rows[first:, joints:], rows[first:, start:stop], value[joints:]
    turned, pull = np.zeros((size, columns)), np.empty(columns)  # N A, and A q̇ with the acceleration's part
    for i in range(size):
        for k in range(columns):
            entry = left[i, k]
            if entry != 0.0:
                for j in range(columns):
                    turned[i, j] += entry * inertia[k, j]
    for k in range(columns):
        entry = factor * (limited[k] - unit * before[k])
        for j in range(columns):
            entry += inertia[k, j] * limited[j]
        pull[k] = entry
    hessian, gradient = np.empty((size, size)), np.empty(size)
    wanted = value[start:stop]
    for i in range(size):
        entry = 0.0
        for k in range(columns):
            entry += left[i, k] * pull[k]
        for k in range(len(wanted)):
            entry += own[i, k] * wanted[k]
        gradient[i] = entry
        for j in range(i + 1):
            entry = 0.0
            for k in range(columns):
                entry += turned[i, k] * left[j, k]
            for k in range(len(wanted)):
                entry += own[i, k] * own[j, k]
            hessian[i, j] = hessian[j, i] = entry
        hessian[i, i] += factor  # NᵀN = I
    skipped = columns if start == 0 else 0
    directions = np.ascontiguousarray(left[:, skipped:].T)
    # What a higher level left at its bound, to daqp's tolerance, may stay there.
    low, high = np.empty(limits), np.empty(limits)
    for i in range(limits):
        low[i] = min(unit * lower[i] - limited[i], 0.0)
        high[i] = max(unit * upper[i] - limited[i], 0.0)
    return hessian, gradient, directions, low, high


@jit
def _add(rows: Array, value: Array, first: int, step: Array) -> None:
    """value += what `step` (f,) along the directions that are left does to all rows."""
    for i in range(len(step)):
        row, size = rows[first + i], step[i]
        for k in range(len(row)):
            value[k] += size * row[k]


@jit
def _take(rows: Array, first: int, start: int, stop: int, tolerance: float) -> int:
    """Turn the basis so that the tasks start to stop move in its first directions only; returns `first` after these."""
    rows = rows[:, start:]  # those before are done
    columns, width, tasks = rows.shape[0], rows.shape[1], stop - start
    reflector, moved, squares = np.empty(columns), np.empty(width), np.empty(tasks)
    while first < columns:
        squares[:] = 0.0
        for j in range(first, columns):
            row = rows[j]
            for k in range(tasks):
                squares[k] += row[k] * row[k]
        pivot = np.argmax(squares)
        size = np.sqrt(squares[pivot])
        if not size > tolerance:
            break
        for j in range(first, columns):
            reflector[j] = rows[j, pivot] / size
        sign = 1.0 if reflector[first] >= 0.0 else -1.0
        reflector[first] += sign
        moved[:] = 0.0
        for j in range(first, columns):
            row, share = rows[j], reflector[j]
            for k in range(width):
                moved[k] += share * row[k]
        factor = sign / reflector[first]  # 2 / ‖v‖²
        for j in range(first, columns):
            row, share = rows[j], factor * reflector[j]
            for k in range(width):
                row[k] -= share * moved[k]
            row[pivot] = 0.0
        rows[first, pivot] = -sign * size
        first += 1
    return first
