"""The cubic spline through samples, in NumPy: twice continuously differentiable, not-a-knot ends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from retarget.core.types import Array


@dataclass(frozen=True, eq=False)
class CubicSpline:
    """A piecewise cubic: between knots i and i + 1 its value is Σ_k coefficients[k, i] · (t − knots[i])^k.

    knots: (T,) s, strictly increasing. coefficients: (4, T − 1, n). Beyond either end the outermost cubic goes on.
    """

    knots: Array
    coefficients: Array

    @classmethod
    def through(cls, time: Array, values: Array) -> CubicSpline:
        """The spline through `values` (T, n) at `time` (T,) s, strictly increasing, T ≥ 2.

        Not-a-knot ends: the first two pieces are one cubic, and so are the last two, which assumes nothing about speed or acceleration
        at the clip's ends. Three samples give their parabola, two their straight line.
        """
        t, x = np.asarray(time, float), np.asarray(values, float)
        step = np.diff(t)[:, None]
        slope = np.diff(x, axis=0) / step
        bend = _second_derivatives(step, slope)
        coefficients = np.stack(
            [x[:-1], slope - step * (2 * bend[:-1] + bend[1:]) / 6, bend[:-1] / 2, np.diff(bend, axis=0) / (6 * step)]
        )
        return cls(t, coefficients)

    def __call__(self, time: Array) -> Array:
        """Values (K, n) at `time` (K,) s."""
        t = np.asarray(time, float)
        piece = np.clip(np.searchsorted(self.knots, t, side="right") - 1, 0, len(self.knots) - 2)
        u = (t - self.knots[piece])[:, None]
        c0, c1, c2, c3 = self.coefficients[:, piece]
        return np.asarray(c0 + u * (c1 + u * (c2 + u * c3)))


def _second_derivatives(step: Array, slope: Array) -> Array:
    """Second derivatives (T, n) at the knots, from the steps (T − 1, 1) between these and the chords' slopes (T − 1, n)."""
    knots, n = len(step) + 1, slope.shape[1]
    if knots == 2:
        return np.zeros((2, n))
    jump = np.diff(slope, axis=0)
    if knots == 3:
        return np.repeat(2 * jump / (step[0] + step[1]), 3, axis=0)
    h = step[:, 0]
    below, diagonal, above, right = h[:-1].copy(), 2 * (h[:-1] + h[1:]), h[1:].copy(), 6 * jump
    # The end values lie on the straight line through their two neighbours, and leave the system of the inner knots.
    first, last = h[0] / h[1], h[-1] / h[-2]
    diagonal[0] += h[0] * (1 + first)
    above[0] -= h[0] * first
    diagonal[-1] += h[-1] * (1 + last)
    below[-1] -= h[-1] * last
    inner = _solve_tridiagonal(below, diagonal, above, right)
    start = (1 + first) * inner[:1] - first * inner[1:2]
    end = (1 + last) * inner[-1:] - last * inner[-2:-1]
    return np.concatenate([start, inner, end])


def _solve_tridiagonal(below: Array, diagonal: Array, above: Array, right: Array) -> Array:
    """x (m, n) of the system whose row i is below[i] x[i−1] + diagonal[i] x[i] + above[i] x[i+1] = right[i]; diagonally dominant."""
    m = len(diagonal)
    ratio = np.empty(m)
    x = np.array(right)
    ratio[0] = above[0] / diagonal[0]
    x[0] /= diagonal[0]
    for i in range(1, m):
        pivot = diagonal[i] - below[i] * ratio[i - 1]
        ratio[i] = above[i] / pivot
        x[i] = (x[i] - below[i] * x[i - 1]) / pivot
    for i in range(m - 2, -1, -1):
        x[i] -= ratio[i] * x[i + 1]
    return x
