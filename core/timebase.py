"""One time base for everything: cutting, resampling, filling short gaps, zero-lag smoothing.

Times are seconds, strictly increasing. Quaternions are unit wxyz, continuous in sign. Nothing here shifts a signal in time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from retarget.core import rotations
from retarget.core.errors import MotionError, UsageError
from retarget.core.field_checks import LARGEST_ARRAY_BYTES
from retarget.core.types import Array, BoolArray, HumanMotion

CLOCK_SLACK_S = 5e-7
"""Frame times carry rounding (index / rate): this much slack keeps "--end 2" from losing the frame at 2 s."""


def cut(motion: HumanMotion, start: float | None, end: float | None) -> HumanMotion:
    """The frames with start ≤ time ≤ end (s, on the motion's own clock; None = open). The clock is kept.

    Raises `MotionError` when no frame is left, and `UsageError` for an end before the start.
    """
    if start is not None and end is not None and end < start:
        raise UsageError(f"end {end:g} s is before start {start:g} s")
    t = motion.time
    first = 0 if start is None else int(np.searchsorted(t, start - CLOCK_SLACK_S))
    stop = len(t) if end is None else int(np.searchsorted(t, end + CLOCK_SLACK_S, side="right"))
    if first >= stop:
        wanted = " and ".join(
            f"{word} {limit:g} s" for word, limit in (("from", start), ("until", end)) if limit is not None
        )
        raise MotionError(f"no frame {wanted}; the recording runs from {t[0]:g} s to {t[-1]:g} s")
    keep = slice(first, stop)  # a slice shares the recording's memory
    return replace(
        motion,
        time=t[keep],
        orientation=motion.orientation[keep],
        position=motion.position[keep],
        angular_velocity=None if motion.angular_velocity is None else motion.angular_velocity[keep],
        foot_contacts=None if motion.foot_contacts is None else motion.foot_contacts[keep],
    )


def joined(parts: Sequence[HumanMotion]) -> HumanMotion:
    """Consecutive parts of one motion as one; what they say of the person is the first one's, `source` the last one's."""
    if len(parts) == 1:
        return parts[0]

    def together(name: str) -> Array | None:
        if getattr(parts[0], name) is None:
            return None
        values: Array = np.concatenate([getattr(part, name) for part in parts])
        values.flags.writeable = False  # so it is shared, not copied
        return values

    fields = ("time", "orientation", "position", "angular_velocity", "foot_contacts")
    arrays: dict[str, Any] = {name: together(name) for name in fields}
    return replace(parts[0], source=parts[-1].source, **arrays)


def resample(motion: HumanMotion, rate_hz: float, anchor_s: float | None = None) -> HumanMotion:
    """The motion at `rate_hz`, never beyond its first and last frame; one frame falls on `anchor_s`, a time in it (its first when None).

    Positions and angular velocities linearly, orientations along the shortest arc, contacts from the nearest frame.
    Raises `UsageError` for a rate that is not positive and finite or gives more frames than fit into memory, and for an anchor outside the motion.
    """
    if not (np.isfinite(rate_hz) and rate_hz > 0):
        raise UsageError(f"rate {rate_hz:g} Hz; expected a positive number")
    t = motion.time
    anchor = t[0] if anchor_s is None else anchor_s
    if not t[0] - CLOCK_SLACK_S <= anchor <= t[-1] + CLOCK_SLACK_S:
        raise UsageError(f"anchor {anchor:g} s; expected a time from {t[0]:g} s to {t[-1]:g} s")
    return on_grid(motion, rate_hz, anchor)


def on_grid(motion: HumanMotion, rate_hz: float, anchor: float) -> HumanMotion:
    """As `resample`, at those times anchor + k / rate_hz, k whole, that are in the motion; `anchor` need not be.

    Parts of a motion get the very same frames as the whole. Raises `UsageError` for a rate that gives more frames than fit into memory.
    """
    t = motion.time
    steps = float(t[-1] - t[0]) * rate_hz
    most = LARGEST_ARRAY_BYTES // motion.orientation[0].nbytes
    if steps >= most:
        raise UsageError(f"rate {rate_hz:g} Hz gives {steps:.3g} frames; expected at most {most:,}")
    first, last = np.ceil((t[0] - anchor) * rate_hz - 1e-6), np.floor((t[-1] - anchor) * rate_hz + 1e-6)
    new = np.clip(anchor + np.arange(first, last + 1) / rate_hz, t[0], t[-1])
    if len(new) == len(t) and np.allclose(new, t, rtol=0, atol=1e-9):
        return motion
    if len(t) == 1:
        return motion
    right = np.clip(np.searchsorted(t, new, side="right"), 1, len(t) - 1)
    left = right - 1
    fraction = (new - t[left]) / (t[right] - t[left])
    weight = fraction[:, None, None]
    orientation = rotations.slerp(motion.orientation[left], motion.orientation[right], weight[..., 0])
    omega = motion.angular_velocity
    nearest = np.where(fraction < 0.5, left, right)
    return replace(
        motion,
        time=new,
        orientation=rotations.make_continuous(orientation),
        position=(1 - weight) * motion.position[left] + weight * motion.position[right],
        angular_velocity=None if omega is None else (1 - weight) * omega[left] + weight * omega[right],
        foot_contacts=None if motion.foot_contacts is None else motion.foot_contacts[nearest],
    )


def fill_gaps(
    time: ArrayLike, values: ArrayLike, *, longest_s: float, quaternions: bool = False
) -> tuple[Array, BoolArray]:
    """Values (T, k) with their non-finite rows interpolated, and which rows (T,) were filled.

    A row counts as missing when any of its k numbers is not finite. Vectors are interpolated linearly, quaternions (k = 4) along the
    shortest arc; gaps at either end hold the nearest row. Raises `MotionError` for a gap longer than `longest_s` (from the
    last good row before to the first good one after) and when no row is good.
    """
    t, x = np.asarray(time, float), np.array(values, float)
    bad = ~np.isfinite(x).all(axis=1)
    if not bad.any():
        return x, bad
    good = np.flatnonzero(~bad)
    if not len(good):
        raise MotionError("no frame holds finite values")
    missing = np.flatnonzero(bad)
    after = np.searchsorted(good, missing)
    left, right = good[np.maximum(after - 1, 0)], good[np.minimum(after, len(good) - 1)]
    # A gap at an end has a neighbour on one side only: it lasts from the clip's end to that neighbour.
    start = np.where(after == 0, t[0], t[left])
    stop = np.where(after == len(good), t[-1], t[right])
    length = stop - start
    if (length > longest_s + CLOCK_SLACK_S).any():
        worst = int(np.argmax(length))
        raise MotionError(
            f"values missing for {length[worst]:.3g} s from {start[worst]:.3f} s on; gaps up to {longest_s:g} s are interpolated"
        )
    span = t[right] - t[left]
    fraction = np.where(span > 0, (t[missing] - t[left]) / np.where(span > 0, span, 1.0), 0.0)
    if quaternions:
        x[missing] = rotations.slerp(x[left], x[right], fraction)
    else:
        x[missing] = x[left] + fraction[:, None] * (x[right] - x[left])
    return x, bad


def runs(mask: BoolArray) -> list[tuple[int, int]]:
    """(first, last) index of every run of true values in `mask` (T,)."""
    edges = np.flatnonzero(np.diff(mask, prepend=False, append=False)).reshape(-1, 2)
    return [(start, stop - 1) for start, stop in edges.tolist()]


def rate_of_change(time: Array, values: Array) -> Array:
    """Central differences (T, k) of `values` per second at `time` (T,) s, zero for a single frame.

    Never beyond the largest step's rate: limits that hold on steps hold here.
    """
    return np.asarray(np.gradient(values, time, axis=0)) if len(time) > 1 else np.zeros_like(values)


def minimum_jerk(fraction: ArrayLike) -> Array:
    """10s³ − 15s⁴ + 6s⁵ of `fraction` clipped to [0, 1]: 0 → 1 with zero velocity and acceleration at both ends."""
    s = np.clip(np.asarray(fraction, float), 0.0, 1.0)
    return np.asarray(s**3 * (10 - 15 * s + 6 * s**2))


def smooth(
    time: ArrayLike, values: ArrayLike, window_s: float, *, ends: Literal["reflect", "hold"] = "reflect"
) -> Array:
    """Values (T, ...) averaged over ±`window_s` s with minimum-jerk flanks: symmetric, so without lag.

    Weights are positive and sum to one, so away from the ends a smoothed signal leaves neither the range of the original nor that of
    its steps. Beyond the ends the signal is continued by point reflection ("reflect": a straight line stays the same straight line) or by
    its end values ("hold": every convex limit on values and steps that holds before holds after).
    Rates are taken as uniform (the mean step of `time`).
    """
    t, x = np.asarray(time, float), np.asarray(values, float)
    if len(t) < 3 or window_s <= 0:
        return x.copy()
    step = (t[-1] - t[0]) / (len(t) - 1)
    half = min(round(window_s / step), len(t) - 1)
    if half < 1:
        return x.copy()
    kernel = 1.0 - minimum_jerk(np.abs(np.arange(-half, half + 1)) / (half + 1))
    kernel /= kernel.sum()
    flat = x.reshape(len(x), -1)
    if ends == "reflect":
        before, after = 2 * flat[0] - flat[half:0:-1], 2 * flat[-1] - flat[-2 : -half - 2 : -1]
    else:
        before, after = np.repeat(flat[:1], half, axis=0), np.repeat(flat[-1:], half, axis=0)
    padded = np.concatenate([before, flat, after])
    out = np.stack([np.convolve(column, kernel, mode="valid") for column in padded.T], axis=1)
    return np.asarray(out.reshape(x.shape))
