"""How far a tracker went: the length of its path, as sampled and without the jitter and jumps of the tracking system.

Summed from sample to sample, noise counts as way: 1 mm of it on each axis, at 150 Hz, makes a third of a metre a second where nothing moves.
What lasts less than `MEDIAN_S` is taken for an outlier (running median over ± that time), what swings within `AVERAGE_S` for jitter (average).
Quick motion is cut with it: it is meant for comparing tracking systems on slow ones.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from retarget.core.timebase import smooth
from retarget.core.types import Array, BoolArray

MEDIAN_S, AVERAGE_S = 0.3, 0.2
"""Half-widths."""
CHUNK = 4096
"""Samples whose medians are taken together."""


def sampled_path(time: Array, position: Array, tracked: BoolArray) -> float:
    """Metres from sample to sample along `position` (T, 3) m at `time` (T,) s, over the stretches where `tracked` (T,); 0 where nothing was."""
    return _over_stretches(lambda _, stretch: stretch, time, position, tracked)


def steady_path(time: Array, position: Array, tracked: BoolArray) -> float:
    """Metres along the same path without what jitters and jumps; arguments as those of `sampled_path`."""
    return _over_stretches(_steady, time, position, tracked)


def _over_stretches(
    filtered: Callable[[Array, Array], Array], time: Array, position: Array, tracked: BoolArray
) -> float:
    edges = np.flatnonzero(np.diff(tracked, prepend=False, append=False)).reshape(-1, 2)
    lengths = [
        np.linalg.norm(np.diff(filtered(time[start:stop], position[start:stop]), axis=0), axis=1).sum()
        for start, stop in edges.tolist()
    ]
    return float(sum(lengths))


def _steady(time: Array, position: Array) -> Array:
    if len(time) < 2:
        return position
    half = min(round(MEDIAN_S * (len(time) - 1) / float(time[-1] - time[0])), len(time) - 1)
    # Continued by point reflection, as `smooth` does: the ends would be cut off otherwise.
    before, after = 2 * position[0] - position[half:0:-1], 2 * position[-1] - position[-2 : -half - 2 : -1]
    windows = np.lib.stride_tricks.sliding_window_view(np.concatenate([before, position, after]), 2 * half + 1, axis=0)
    medians = [np.median(part, axis=-1) for part in np.array_split(windows, len(windows) // CHUNK + 1)]
    return smooth(time, np.concatenate(medians), AVERAGE_S)
