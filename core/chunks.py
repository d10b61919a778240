"""Long clips in parts: what a computation needs for itself stays small beside the clip."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

CHUNK_FRAMES = 4096
"""Frames computed together: a value for each of 30 joints is 1 MB. A multiple of `kinematics.CHUNK`, so that its parts stay the same."""


def frame_chunks(frames: int) -> Iterator[slice]:
    """Slices of at most `CHUNK_FRAMES` that cover frames 0 to `frames` - 1, in order; start and stop are set, and none is empty."""
    for start in range(0, frames, CHUNK_FRAMES):
        yield slice(start, min(start + CHUNK_FRAMES, frames))


def gathered(frames: int, compute: Callable[[slice], Array], columns: tuple[int, ...] = ()) -> Array:
    """(frames, *columns) whose rows `part` are `compute(part)`, chunk by chunk.

    For sums over a whole clip: NumPy adds an array's values in an order of its own, so sums of chunks would differ in the last digits.
    """
    values = np.empty((frames, *columns))
    for part in frame_chunks(frames):
        values[part] = compute(part)
    return values
