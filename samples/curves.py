"""Smooth curves that motions are made of. All are twice continuously differentiable.

Angles in and out are whatever the caller uses; time is seconds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike
from retarget.core.timebase import minimum_jerk
from retarget.core.types import Array

Jet = tuple[Array, Array, Array]
"""Value, first and second time derivative at one instant, each of shape (k,)."""

Keys = Sequence[tuple[float, float]]
"""(time in s, value): rests between which something moves."""


def periodic(values: Sequence[float], harmonics: int = 8) -> Callable[[Array], Array]:
    """The trigonometric polynomial through equally spaced `values` of one cycle (the first at phase 0), cut after `harmonics`.

    The result takes phases (T,), one cycle per unit, and gives (T,).
    """
    spectrum = np.fft.rfft(np.asarray(values, float)) / len(values)

    def curve(phase: Array) -> Array:
        total = np.full(np.shape(phase), spectrum[0].real)
        for k in range(1, harmonics + 1):
            angle = 2 * np.pi * k * np.asarray(phase, float)
            total = total + 2 * (spectrum[k].real * np.cos(angle) - spectrum[k].imag * np.sin(angle))
        return total

    return curve


def ramp(time: ArrayLike, start: float, end: float) -> Array:
    """0 before `start`, 1 after `end`, minimum-jerk between."""
    return minimum_jerk((np.asarray(time, float) - start) / (end - start))


def ramp_integral(time: ArrayLike, start: float, end: float) -> Array:
    """The integral of `ramp` over time, in closed form."""
    t = np.asarray(time, float)
    s = np.clip((t - start) / (end - start), 0.0, 1.0)
    return np.asarray((end - start) * s**4 * (2.5 - 3 * s + s**2) + np.maximum(t - end, 0.0))


def jet(function: Callable[[Array], Array], instant: float) -> Jet:
    """Value and two derivatives at `instant` of `function` ((T,) → (T, k)), by central differences of fourth order.

    Derivatives are rounded: far below what can be seen, far above the last bits in which two machines' sine may differ. So the
    samples come out the same to the byte everywhere.
    """
    h = 2e-3
    f = function(np.asarray(instant + h * np.arange(-2, 3), float))
    velocity = (f[0] - 8 * f[1] + 8 * f[3] - f[4]) / (12 * h)
    acceleration = (-f[0] + 16 * f[1] - 30 * f[2] + 16 * f[3] - f[4]) / (12 * h * h)
    return f[2], np.round(velocity, 7), np.round(acceleration, 5)


def bridge(time: Array, start: float, end: float, before: Jet, after: Jet) -> Array:
    """The quintic (T, k) that meets `before` at `start` and `after` at `end` in value, velocity and acceleration."""
    length = end - start
    s = ((np.asarray(time, float) - start) / length)[:, None]
    x0, v0, a0 = before[0], before[1] * length, before[2] * length**2
    x1, v1, a1 = after[0], after[1] * length, after[2] * length**2
    gap, slope = x1 - x0 - v0 - a0 / 2, v1 - v0 - a0
    bend = a1 - a0
    c3 = 10 * gap - 4 * slope + bend / 2
    c4 = -15 * gap + 7 * slope - bend
    c5 = 6 * gap - 3 * slope + bend / 2
    return np.asarray(x0 + s * (v0 + s * (a0 / 2 + s * (c3 + s * (c4 + s * c5)))))


def hump(time: ArrayLike, start: float, end: float) -> Array:
    """A hump (T,) that is zero at both ends together with its first two derivatives."""
    s = (np.asarray(time, float) - start) / (end - start)
    return np.asarray((s * (1 - s)) ** 3)


def zero(size: int) -> Jet:
    """The jet of `size` numbers at rest at zero."""
    return np.zeros(size), np.zeros(size), np.zeros(size)


def keyed(time: Array, keys: Keys) -> Array:
    """A number (T,) that rests at each of `keys` (time in s, value) and moves between neighbours with minimum jerk."""
    total = np.full(np.shape(time), keys[0][1], float)
    for (start, value), (end, following) in pairwise(keys):
        total = total + (following - value) * ramp(time, start, end)
    return total
