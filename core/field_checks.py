"""Checks with which the types of `core.types` keep their promises: each names the field, what was found, and what was expected."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from retarget.core.chunks import frame_chunks
from retarget.core.errors import InvalidDataError, nearest
from retarget.core.segments import SEGMENTS

Array = NDArray[np.float64]

LARGEST_ARRAY_BYTES = 4 << 30
"""No array of a recording or trajectory is larger: 6 hours of 23 orientations at 240 Hz. What asks for more is broken, or a bomb."""


class FieldSetter:
    """Writes checked values into a frozen dataclass while it is being made."""

    def __init__(self, owner: object) -> None:
        self.owner = owner

    def value(self, name: str, value: object) -> None:
        """Replace field `name` by `value`, unchecked."""
        object.__setattr__(self.owner, name, value)

    def array(
        self,
        name: str,
        shape: Sequence[int | str],
        *,
        optional: bool = False,
        finite: bool = True,
        dtype: type[np.generic] = np.float64,
    ) -> Array:
        """Replace field `name` by a read-only array of `shape`; a string in `shape` stands for any size ≥ 1."""
        value = getattr(self.owner, name)
        if value is None and optional:
            return np.zeros(0)
        array = frozen_array(f"{type(self.owner).__name__}.{name}", value, shape, finite=finite, dtype=dtype)
        self.value(name, array)
        return array


def frozen_array(
    name: str,
    value: ArrayLike,
    shape: Sequence[int | str],
    *,
    finite: bool = True,
    dtype: type[np.generic] = np.float64,
) -> Array:
    """`value` as a read-only, C-contiguous array of `shape`, a string standing for any size ≥ 1. Raises `InvalidDataError`."""
    array = read_only(name, value, dtype)
    fits = len(array.shape) == len(shape) and all(
        size >= 1 if isinstance(want, str) else size == want for size, want in zip(array.shape, shape, strict=True)
    )
    if not fits:
        wanted = ", ".join(str(size) for size in shape) + ("," if len(shape) == 1 else "")
        at_least = "".join(f", {size} ≥ 1" for size in shape if isinstance(size, str))
        raise InvalidDataError(f"{name}: found shape {array.shape}, expected ({wanted}){at_least}")
    if finite and not _all_finite(array):
        where = np.argwhere(~np.isfinite(array))[0]
        raise InvalidDataError(
            f"{name}: found {array[tuple(where)]} at {tuple(int(i) for i in where)}, expected finite values"
        )
    return array


def read_only(name: str, value: ArrayLike, dtype: type[np.generic]) -> Array:
    """`value` as a C-contiguous array of `dtype` that nobody can write to: itself where that holds already, else a copy.

    Raises `InvalidDataError` for what is no array of numbers, and for values that `dtype` can't hold.
    """
    try:
        given = np.asarray(value)
    except ValueError:
        raise InvalidDataError(f"{name}: found rows of unequal lengths, expected an array of numbers") from None
    if given.dtype.kind not in "biuf":
        raise InvalidDataError(f"{name}: found {given.dtype} values, expected an array of numbers")
    if given.dtype == dtype and given.flags.c_contiguous and _nobody_can_write_to(given):
        return given
    with np.errstate(invalid="ignore", over="ignore"):  # what doesn't fit is refused below, in our own words
        array = np.array(given, dtype, order="C")
    if dtype is not np.float64 and not np.array_equal(array, given):
        where = np.argwhere(array != given)[0]
        raise InvalidDataError(
            f"{name}: found {given[tuple(where)]} at {tuple(int(i) for i in where)}, expected {np.dtype(dtype)} values"
        )
    array.flags.writeable = False
    return array


def _nobody_can_write_to(array: Array) -> bool:
    """Whether `array` and all that it is a view of are read-only."""
    owner: object = array
    while isinstance(owner, np.ndarray):
        if owner.flags.writeable:
            return False
        owner = owner.base
    return owner is None or isinstance(owner, bytes)


def _all_finite(array: Array) -> bool:
    # A finite sum has finite terms, and needs no temporary array; only a sum that overflows needs the second look.
    with np.errstate(over="ignore", invalid="ignore"):
        return bool(np.isfinite(array.sum()) or np.isfinite(array).all())


def check_segment_names(field: str, names: Iterable[str]) -> None:
    """Every name is one of the canonical segments."""
    if unknown := [name for name in names if name not in SEGMENTS]:
        near = nearest(str(unknown[0]), SEGMENTS)
        hint = f"did you mean {' or '.join(near)}?" if near else f"one of {', '.join(SEGMENTS)}"
        raise InvalidDataError(f"{field}: found unknown segment '{unknown[0]}', expected a canonical name; {hint}")


def check_tracked_or_not(field: str, segment: str, position: Array) -> None:
    """`position` (T, 3) of one segment is finite throughout (tracked) or NaN throughout (not tracked)."""
    if _all_finite(position) or np.isnan(position).all():
        return
    finite = np.isfinite(position)
    # Name an infinity, or else the first value that isn't like the segment's very first.
    odd = np.isinf(position) if np.isinf(position).any() else finite != finite[0, 0]
    frame, axis = (int(i) for i in np.argwhere(odd)[0])
    raise InvalidDataError(
        f"{field}: found {position[frame, axis]} for {segment} in frame {frame}, "
        "expected a segment finite in every frame or NaN in every frame"
    )


def check_time(field: str, time: Array) -> None:
    """`time` (T,) s increases strictly."""
    if (steps := np.diff(time) <= 0).any():
        at = int(np.argmax(steps)) + 1
        raise InvalidDataError(
            f"{field}: found frame {at} at {time[at]:.9g} s after frame {at - 1} at {time[at - 1]:.9g} s, "
            "expected increasing times"
        )


def check_unit(field: str, vectors: Array, expected: str) -> None:
    """`vectors` (..., k) have length 1; their squares to 1e-6."""
    off = np.abs(np.einsum("...i,...i->...", vectors, vectors) - 1.0)
    if (off > 1e-6).any():
        _refuse_length(field, vectors, tuple(int(i) for i in np.argwhere(off > 1e-6)[0]), 0, expected)


def check_unit_quaternions(field: str, quaternion: Array) -> None:
    """`quaternion` (T, ..., 4) is unit, and its signs are continuous along T."""
    for frames in frame_chunks(len(quaternion)):
        start = frames.start
        part = quaternion[start : frames.stop + 1]  # one more: its sign against the next chunk's first
        off = np.abs(np.einsum("t...i,t...i->t...", part, part) - 1.0) > 1e-6
        if off.any():
            _refuse_length(field, part, tuple(int(i) for i in np.argwhere(off)[0]), start, "unit quaternions")
        flips = np.einsum("t...i,t...i->t...", part[1:], part[:-1]) < 0
        if flips.any():
            frame, *rest = (int(i) for i in np.argwhere(flips)[0])
            raise InvalidDataError(
                f"{field}: found a sign flip at {(start + frame + 1, *rest)}, expected signs continuous between frames"
            )


def _refuse_length(field: str, vectors: Array, where: tuple[int, ...], first_frame: int, expected: str) -> None:
    at = f" at {(where[0] + first_frame, *where[1:])}" if where else ""
    with np.errstate(over="ignore"):
        length = float(np.linalg.norm(vectors[where]))
    raise InvalidDataError(f"{field}: found length {length:.7g}{at}, expected {expected}")
