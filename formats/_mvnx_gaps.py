"""Values that an MVNX recording lacks: which can't be used, how long they are missing, and their interpolation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from retarget.core.timebase import CLOCK_SLACK_S, fill_gaps
from retarget.core.types import Array, BoolArray
from retarget.formats._mvnx_body import UNIT_TOLERANCE

LONGEST_GAP_S = 0.25
"""Missing values are interpolated over at most this time, from the last good frame to the next."""

BLOCK_FRAMES = 1024
"""Frames worked on at a time, so that temporaries stay small, in the processor's cache even."""

_LONGEST_VECTOR = 1e100  # beyond, nothing was measured, and the square may be no number

Gap = dict[str, Any]


def blocks(frames: int) -> Iterator[slice]:
    """Slices of `BLOCK_FRAMES` that cover `frames`."""
    return (slice(start, start + BLOCK_FRAMES) for start in range(0, frames, BLOCK_FRAMES))


def unusable(values: Array) -> BoolArray:
    """Which (T, S) of the vectors (T, S, 3) or quaternions (T, S, 4) are not finite, or no unit quaternions."""
    low, high = (1 - UNIT_TOLERANCE, 1 + UNIT_TOLERANCE) if values.shape[2] == 4 else (0.0, _LONGEST_VECTOR)
    missing = np.empty(values.shape[:2], bool)
    for block in blocks(len(values)):
        with np.errstate(over="ignore", invalid="ignore"):
            square = np.einsum("tsi,tsi->ts", values[block], values[block])
            missing[block] = ~((square >= low**2) & (square <= high**2))
    return missing


def interpolate(time: Array, values: Array) -> BoolArray:
    """Fill the NaN rows of one segment's `values` (T, 3 or 4) in place; which rows (T,) that were.

    Raises `MotionError` for a gap longer than `LONGEST_GAP_S`.
    """
    values[:], filled = fill_gaps(time, values, longest_s=LONGEST_GAP_S, quaternions=values.shape[1] == 4)
    return filled


def usual_step(index: NDArray[np.int64]) -> int:
    """By how much frame numbers grow from frame to frame where none was dropped: 4 in an export of every fourth frame."""
    return int(np.gcd.reduce(np.diff(index))) if len(index) > 1 else 1


def dropped_frames(index: NDArray[np.int64], time: Array) -> list[Gap]:
    """Where frame numbers (T,) jump."""
    usual, steps = usual_step(index), np.diff(index)
    return [
        {
            "kind": "dropped frames",
            "start_s": float(time[at]),
            "duration_s": float(time[at + 1] - time[at]),
            "frames": int(steps[at] // usual - 1),
        }
        for at in np.flatnonzero(steps > usual)
    ]


def missing_values(missing: Mapping[str, BoolArray], time: Array, segments: Sequence[str]) -> list[Gap]:
    """Where values of fields are missing, `missing` being field → (T, S); segments that lack the same frames together."""
    found: dict[tuple[int, int, str], list[str]] = {}
    for field, lacks in missing.items():
        for column in np.flatnonzero(lacks.any(axis=0)):
            edges = np.flatnonzero(np.diff(lacks[:, column].astype(np.int8), prepend=0, append=0))
            for start, stop in edges.reshape(-1, 2).tolist():
                found.setdefault((start, stop, field), []).append(segments[column])
    return [_missing_gap(*place, names, time) for place, names in sorted(found.items())]


def _missing_gap(start: int, stop: int, field: str, segments: list[str], time: Array) -> Gap:
    first, last = time[max(start - 1, 0)], time[min(stop, len(time) - 1)]
    return {
        "kind": "missing values",
        "field": field,
        "segments": segments,
        "start_s": float(first),
        "duration_s": float(last - first),
        "frames": stop - start,
    }


def is_too_long(gap: Gap, frames: int) -> bool:
    """Whether a gap of missing values, in a recording of so many frames, is one that is not interpolated."""
    return bool(gap["duration_s"] > LONGEST_GAP_S + CLOCK_SLACK_S or gap["frames"] == frames)
