"""Small figures over time that all checks share: the worst value with its place, steps that stand out, what lasts a while."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from retarget.core.chunks import gathered
from retarget.core.types import Array

NEIGHBOURS = 5
"""Steps over which the median tells the usual one: two false steps (there and back) among five don't move it."""


@dataclass(frozen=True)
class Signal:
    """The largest value of a signal, where and when; "" and None where nothing is above zero. index: (frame, column)."""

    value: float
    where: str = ""
    time_s: float | None = None
    index: tuple[int, int] | None = None


def worst(values: Array, time: Array, names: Sequence[str], start: int = 0) -> Signal:
    """The largest of `values` (K, n) ≥ 0, those of frame `start` of `time` (T,) s and on, one name a column; the first in time of equals."""
    if not values.size or not (most := float(values.max())) > 0:
        return Signal(0.0)
    row, column = (int(i) for i in np.unravel_index(int(np.argmax(values)), values.shape))
    return Signal(most, names[column], float(time[start + row]), (start + row, column))


def larger(earlier: Signal, later: Signal) -> Signal:
    """The larger of the worst of two parts of a clip; the first in time of equals."""
    return later if later.value > earlier.value else earlier


def held(values: Array, frames: int) -> Array:
    """Differences along time (K, n) as a signal (frames, n): each stands at the frame in which it shows, the first ones are 0."""
    return np.concatenate([np.zeros((frames - len(values), values.shape[1])), values])


def local_jumps(values: Array, time: Array) -> Array:
    """(T-1, n) how far each step of `values` (T, n) is from the usual one around it: the median of five.

    A step over a gap in `time` (T,) s is first shortened to the median duration, so that a lost frame is no jump.
    """
    return gathered(len(values) - 1, jumps_of(values, time), values.shape[1:])


def jumps_of(values: Array, time: Array) -> Callable[[slice], Array]:
    """A function that gives rows of `local_jumps`: (K, n) of steps `start` to `stop` - 1 of a slice."""
    steps = np.diff(time)
    shorter = np.minimum(1.0, np.median(steps) / steps)[:, None] if len(steps) else steps[:, None]
    half = NEIGHBOURS // 2 if len(steps) > NEIGHBOURS // 2 else 0

    def jumps(part: slice) -> Array:
        index = np.abs(np.arange(part.start - half, part.stop + half))  # the clip's ends mirror its steps
        index = np.where(index < len(steps), index, 2 * (len(steps) - 1) - index)
        moved = (values[index + 1] - values[index]) * shorter[index]
        if not half:
            return np.asarray(moved)
        around = sliding_window_view(moved, NEIGHBOURS, axis=0)
        return np.asarray(moved[half:-half] - np.sort(around, axis=-1)[..., half])

    return jumps


def lasting(values: Array, time: Array, duration_s: float) -> Array:
    """(T,) of `values` (T,): the largest value that is not undercut for `duration_s` around each frame; a shorter clip counts as a whole.

    The morphological opening of the signal: a peak shorter than the duration is levelled, a plateau stays as it is.
    """
    rate = (len(time) - 1) / (time[-1] - time[0]) if len(time) > 1 else 1.0
    width = min(max(1, int(np.ceil(duration_s * rate - 1e-9))), len(values))
    lowest = sliding_window_view(values, width).min(axis=1)
    padded = np.pad(lowest, width - 1, constant_values=-np.inf)
    return np.asarray(sliding_window_view(padded, width).max(axis=1))
