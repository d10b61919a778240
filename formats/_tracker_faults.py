"""What is wrong with the rows of one tracker: which can't be used, which repeat the row before, where it jumps.

| fault | what happens |
|---|---|
| row marked invalid, number missing or not finite, farther than `FARTHEST_M` | not measured |
| origin and identity (or zeros) away from all else: what loggers write for a lost tracker | not measured |
| quaternion's length off by more than `UNIT_TOLERANCE` | orientation not measured, position kept; never normalised to something |
| the pose of the row before, to the last bit (a log faster than the tracker holds samples) | interpolated between the new samples where these are at most `LONGEST_HOLD_S` apart; kept where longer |
| step over `JUMP_M` that no hand makes | kept and warned of |
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from retarget.core import rotations
from retarget.core.errors import FormatError
from retarget.core.types import Array, BoolArray

UNIT_TOLERANCE = 1e-2
FARTHEST_M = 1e3
LONGEST_HOLD_S = 0.1
FROZEN_S = 0.5
JUMP_M = 0.03
JUMP_SPEED_M_S = 4.0
"""Fast punches and throws stay below it (hand trackers, 90 Hz)."""
LATEST_S = 1e30
"""No clock shows more, in whatever unit."""
_CALENDAR_S = 1e8
_JUMP_LEAST_RATE_HZ = 59.0
_JUMP_FACTOR = 4.0  # a slower jump is one that is so many times the steps around it
_AROUND = 4


@dataclass(frozen=True, eq=False)
class Samples:
    """The N rows of one tracker in the order of the file, as they stand there, in metres and with the quaternion as wxyz.

    time: (N,) s. position: (N, 3). orientation: (N, 4). valid: (N,), what the file's validity columns say. line: (N,), of the file.
    role: what the file says it is worn as, or "".
    """

    tracker: str
    time: Array
    position: Array
    orientation: Array
    valid: BoolArray
    line: NDArray[np.int64]
    role: str = ""


@dataclass(frozen=True, eq=False)
class Cleaned:
    """Rows of one tracker with increasing times, repeated rows interpolated, orientations unit where they are usable.

    position_ok, orientation_ok: (N,), where these were measured. step_s: its usual time between rows; 0 for a single row.
    jump_times: s, of the row after each jump. frozen: (start, end) in s of long stretches of one and the same pose.
    """

    tracker: str
    role: str
    time: Array
    position: Array
    orientation: Array
    position_ok: BoolArray
    orientation_ok: BoolArray
    step_s: float
    rows: int
    invalid_rows: int
    origin_rows: int
    missing_rows: int
    bad_quaternions: int
    repeated_rows: int
    same_time_rows: int
    jump_times: Array
    frozen: tuple[tuple[float, float], ...]


def since_first(time: Array) -> Array:
    """Times (N,) s as they are, or since the first where they count from a calendar's zero (Unix time), which would cost digits."""
    calendar = _CALENDAR_S < abs(float(time[0])) < LATEST_S
    return np.asarray(time - time[0]) if calendar and np.isfinite(time).all() else time


def usual_step(time: Array) -> float:
    """The mean of the steps (s) near the median step, so that neither gaps nor coarse time stamps shift it; 0 without steps."""
    steps = np.diff(time)
    steps = steps[steps > 0]
    if not len(steps):
        return 0.0
    median = np.sort(steps)[(len(steps) - 1) // 2]  # one of the steps, so that some step is near it
    return float(steps[np.abs(steps - median) <= 0.5 * median].mean())


def clean(samples: Samples, name: str, *, suit: bool = False) -> Cleaned:
    """Look through the rows of one tracker of file `name`. suit: rows of a segment, which nobody straps on: neither held nor jumping.

    Raises `FormatError` where time is not finite or goes backward, and for a tracker whose position or orientation was never measured.
    """
    rows = len(samples.time)
    increasing = _increasing(samples, name)
    time = samples.time[increasing]
    position, quaternion = samples.position[increasing], samples.orientation[increasing]
    valid = samples.valid[increasing]
    with np.errstate(invalid="ignore", over="ignore"):
        finite = (np.abs(position) <= FARTHEST_M).all(axis=1) & np.isfinite(quaternion).all(axis=1)
        length = np.linalg.norm(quaternion, axis=1)
        unit = np.abs(length - 1.0) <= UNIT_TOLERANCE
    origin = _placeholders(position, quaternion, valid & finite)
    position_ok = valid & finite & ~origin
    orientation_ok = position_ok & unit
    for ok, what in ((position_ok, "is never tracked"), (orientation_ok, "never has a usable quaternion")):
        if not ok.any():
            causes = f"of {rows} rows {int((~valid).sum())} are marked invalid, {int((valid & ~finite).sum())} lack numbers, "
            raise FormatError(
                name,
                f"tracker '{samples.tracker}' {what}: {causes}{int((position_ok & ~unit).sum())} have a bad quaternion",
            )
    position = np.where(position_ok[:, None], position, 0.0)
    orientation = np.where(orientation_ok[:, None], quaternion, [1.0, 0.0, 0.0, 0.0])
    same = np.zeros(len(time), bool)
    same[1:] = (position[1:] == position[:-1]).all(axis=1) & (quaternion[1:] == quaternion[:-1]).all(axis=1)
    same[1:] &= position_ok[1:] & position_ok[:-1]
    jumps = np.zeros(0) if suit else _jump_times(time, position, position_ok & ~same)
    orientation = rotations.normalize(orientation)
    frozen = _bridge(time, position, orientation, same, position_ok, orientation_ok) if not suit else ()
    return Cleaned(
        tracker=samples.tracker,
        role=samples.role,
        time=time,
        position=position,
        orientation=orientation,
        position_ok=position_ok,
        orientation_ok=orientation_ok,
        step_s=usual_step(time),
        rows=rows,
        invalid_rows=int((~valid).sum()),
        origin_rows=int(origin.sum()),
        missing_rows=int((valid & ~finite).sum()),
        bad_quaternions=int((position_ok & ~unit).sum()),
        repeated_rows=int(same.sum()),
        same_time_rows=rows - len(time),
        jump_times=jumps,
        frozen=frozen,
    )


def _increasing(samples: Samples, name: str) -> BoolArray:
    """Which rows (N,) have a time later than the row before them; equal ones are left out, the first kept."""
    time = samples.time
    possible = np.abs(time) < LATEST_S
    if not possible.all():
        at = int(np.argmin(possible))
        raise FormatError(name, f"the time is {time[at]}", place=f"line {samples.line[at]}", expected="a finite number")
    steps = np.diff(time)
    if (steps < 0).any():
        at = int(np.argmax(steps < 0)) + 1
        of = f" of tracker '{samples.tracker}'" if samples.tracker else ""
        raise FormatError(
            name,
            f"time{of} goes back from {time[at - 1]:.9g} s to {time[at]:.9g} s",
            place=f"line {samples.line[at]}",
            expected="increasing times",
        )
    return np.concatenate([[True], steps > 0])


def _placeholders(position: Array, quaternion: Array, usable: BoolArray) -> BoolArray:
    """Which rows (N,) stand at the origin, unturned or with no quaternion at all, while the nearest other rows are a jump away."""
    unturned = ((quaternion == [1.0, 0.0, 0.0, 0.0]) | (quaternion == 0.0)).all(axis=1)
    suspects: BoolArray = usable & (position == 0.0).all(axis=1) & unturned
    others = np.flatnonzero(usable & ~suspects)
    if not suspects.any() or not len(others):
        return np.zeros(len(position), bool)
    rows = np.flatnonzero(suspects)
    after = np.searchsorted(others, rows)
    away = np.linalg.norm(position[others], axis=1)
    nearest = np.minimum(away[np.maximum(after - 1, 0)], away[np.minimum(after, len(others) - 1)])
    suspects[rows[nearest <= JUMP_M]] = False
    return suspects


def _jump_times(time: Array, position: Array, new: BoolArray) -> Array:
    """Times (s) of new samples too far from the new sample before them."""
    at = np.flatnonzero(new)
    if len(at) < 2:
        return np.zeros(0)
    step = np.linalg.norm(np.diff(position[at], axis=0), axis=1)
    lasting = np.diff(time[at])
    far = np.flatnonzero((step > JUMP_M) & (lasting <= 1.0 / _JUMP_LEAST_RATE_HZ))
    padded = np.pad(step, _AROUND, mode="reflect" if len(step) > _AROUND else "edge")
    around = np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * _AROUND + 1)[far], axis=1)
    odd = (step[far] > JUMP_SPEED_M_S * lasting[far]) | (step[far] > _JUMP_FACTOR * around)
    return np.asarray(time[at[far[odd] + 1]])


def _bridge(
    time: Array, position: Array, orientation: Array, same: BoolArray, position_ok: BoolArray, orientation_ok: BoolArray
) -> tuple[tuple[float, float], ...]:
    """Interpolate, in place, rows that repeat the one before; what is returned are the stretches too long for that, if it moves at all."""
    repeats, new = np.flatnonzero(same), np.flatnonzero(~same)
    if not len(repeats):
        return ()
    after = np.searchsorted(new, repeats)
    left, right = new[after - 1], new[np.minimum(after, len(new) - 1)]
    ends = after < len(new)
    short = ends & position_ok[right] & (time[right] - time[left] <= LONGEST_HOLD_S)
    rows, left_, right_ = repeats[short], left[short], right[short]
    fraction = (time[rows] - time[left_]) / (time[right_] - time[left_])
    position[rows] = position[left_] + fraction[:, None] * (position[right_] - position[left_])
    turning = orientation_ok[left_] & orientation_ok[right_]
    rows, left_, right_, fraction = rows[turning], left_[turning], right_[turning], fraction[turning]
    orientation[rows] = rotations.slerp(orientation[left_], orientation[right_], fraction)
    if len(new) < 2:
        return ()
    starts = np.unique(left)
    last = np.searchsorted(repeats, np.append(starts[1:], len(time))) - 1
    spans = zip(time[starts].tolist(), time[repeats[last]].tolist(), strict=True)
    return tuple((start, end) for start, end in spans if end - start > FROZEN_S)
