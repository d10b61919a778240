"""Small figures over time that all checks share: the worst value with its place, steps that stand out, what lasts a while."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from retarget.core.types import Array

NEIGHBOURS = 5
"""Steps over which the median tells the usual one: two false steps (there and back) among five don't move it."""
CHUNK = 4096
"""Frames computed together."""


@dataclass(frozen=True)
class Signal:
    """The largest value of a signal, where and when; "" and None where nothing is above zero. index: (frame, column)."""

    value: float
    where: str = ""
    time_s: float | None = None
    index: tuple[int, int] | None = None


def worst(values: Array, time: Array, names: Sequence[str]) -> Signal:
    """The largest of `values` (T, n) ≥ 0 at `time` (T,) s, one name a column; the first in time of equals."""
    if not values.size or not (most := float(values.max())) > 0:
        return Signal(0.0)
    frame, column = (int(i) for i in np.unravel_index(int(np.argmax(values)), values.shape))
    return Signal(most, names[column], float(time[frame]), (frame, column))


def held(values: Array, frames: int) -> Array:
    """Differences along time (K, n) as a signal (frames, n): each stands at the frame in which it shows, the first ones are 0."""
    return np.concatenate([np.zeros((frames - len(values), values.shape[1])), values])


def local_jumps(values: Array, time: Array) -> Array:
    """(T-1, n) how far each step of `values` (T, n) is from the usual one around it: the median of five.

    A step over a gap in `time` (T,) s is first shortened to the median duration, so that a lost frame is no jump.
    """
    steps = np.diff(time)
    moved = np.diff(values, axis=0) * np.minimum(1.0, np.median(steps) / steps)[:, None]
    half = NEIGHBOURS // 2
    if len(moved) <= half:
        return np.asarray(moved)
    padded = np.pad(moved, ((half, half), (0, 0)), mode="reflect")
    around = sliding_window_view(padded, NEIGHBOURS, axis=0)
    for start in range(0, len(moved), CHUNK):  # sorting copies: five times as much as there is
        part = slice(start, start + CHUNK)
        moved[part] -= np.sort(around[part], axis=-1)[..., half]
    return np.asarray(moved)


def lasting(values: Array, time: Array, duration_s: float) -> Array:
    """(T,) of `values` (T,): the largest value that is not undercut for `duration_s` around each frame; a shorter clip counts as a whole.

    The morphological opening of the signal: a peak shorter than the duration is levelled, a plateau stays as it is.
    """
    rate = (len(time) - 1) / (time[-1] - time[0]) if len(time) > 1 else 1.0
    width = min(max(1, int(np.ceil(duration_s * rate - 1e-9))), len(values))
    lowest = sliding_window_view(values, width).min(axis=1)
    padded = np.pad(lowest, width - 1, constant_values=-np.inf)
    return np.asarray(sliding_window_view(padded, width).max(axis=1))
