"""The rows of several trackers on one time base: gaps filled and marked, everything counted, the house's world.

Time: the file's own times where they are even (steps within half of the usual one) and common to all trackers; else an even grid at the
median tracker's rate, onto which positions are interpolated linearly and orientations along the shortest arc.

Gaps: what was not measured is interpolated up to `LONGEST_GAP_S`, and marked `tracked = False`. Over a longer gap the last pose is held;
when the tracker is back, the pose is blended from there to the measured one by a minimum-jerk weight that lasts as long as keeps the
blend's own peak below `BLEND_SPEED_M_S` and `BLEND_RATE_RAD_S`, between `SHORTEST_BLEND_S` and `LONGEST_BLEND_S`. Hold and blend are
marked, too.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from retarget.core import rotations
from retarget.core.errors import FormatError
from retarget.core.timebase import minimum_jerk
from retarget.core.types import Array, BoolArray, Source, TrackerRecording
from retarget.formats._path_length import sampled_path, steady_path
from retarget.formats._tracker_faults import FROZEN_S, JUMP_M, UNIT_TOLERANCE, Cleaned, Samples, clean, usual_step
from retarget.formats._tracker_frames import doubt_up, to_house
from retarget.formats._tracker_roles import assign
from retarget.formats.base import Handedness, UpAxis

LONGEST_GAP_S = 0.5
SHORTEST_BLEND_S, LONGEST_BLEND_S = 0.5, 5.0
BLEND_SPEED_M_S, BLEND_RATE_RAD_S = 0.5, 1.5
_PEAK = 1.875  # of the minimum-jerk weight's rate, over a duration of 1
_EVEN = 0.5
_SHOWN = 3


@dataclass(frozen=True)
class Log:
    """What a reader found in file `name`: rows of each tracker, and what holds for all.

    up, handedness: of the file's world. warnings: what the reader itself has to say.
    roles: tracker → role or segment, chosen by the user.
    """

    name: str
    format: str
    trackers: Sequence[Samples]
    up: UpAxis
    handedness: Handedness = "right"
    roles: Mapping[str, str] | None = None
    warnings: Sequence[str] = ()
    sha256: str = ""
    configuration: str = ""


@dataclass(frozen=True)
class Filled:
    """One tracker on the time base; long_gaps (start, end) in s."""

    position: Array
    orientation: Array
    tracked: BoolArray
    long_gaps: list[tuple[float, float]]


@dataclass(frozen=True)
class Placed:
    """D trackers on one time base, in the file's own world.

    time: (T,) s. position: (T, D, 3) m. orientation: (T, D, 4). tracked: (T, D). roles: tracker → what the file says it is worn as.
    cleaned: what became of the rows. warnings: what there is to say of them.
    """

    time: Array
    trackers: tuple[str, ...]
    position: Array
    orientation: Array
    tracked: BoolArray
    roles: Mapping[str, str]
    cleaned: Sequence[Cleaned]
    warnings: Sequence[str]


def build(log: Log) -> tuple[TrackerRecording, dict[str, Any]]:
    """The recording, and JSON-able facts of it.

    Raises `FormatError` for time going backward, a tracker never tracked, and times too uneven to put on one base;
    `UsageError` for roles that don't fit.
    """
    return assemble(log, place(log))


def place(log: Log, *, suit: bool = False) -> Placed:
    """All trackers on one time base, gaps filled and marked. suit: as of `clean`. Raises `FormatError` as `build` does."""
    cleaned = [clean(samples, log.name, suit=suit) for samples in log.trackers]
    warnings: list[str] = []
    time = time_base(cleaned, log.name, warnings)
    filled = [fill(time, one) for one in cleaned]
    for one, here in zip(cleaned, filled, strict=True):
        warnings.extend(fault_lines(one, here))
    if not suit:
        warnings.extend(_repeat_lines(cleaned))
    return stacked(time, cleaned, filled, warnings)


def stacked(time: Array, cleaned: Sequence[Cleaned], filled: Sequence[Filled], warnings: Sequence[str]) -> Placed:
    """Trackers side by side that were put onto `time` (T,), s, one by one."""
    return Placed(
        time=time,
        trackers=tuple(one.tracker for one in cleaned),
        position=np.stack([one.position for one in filled], axis=1),
        orientation=np.stack([one.orientation for one in filled], axis=1),
        tracked=np.stack([one.tracked for one in filled], axis=1),
        roles={one.tracker: one.role for one in cleaned},
        cleaned=cleaned,
        warnings=warnings,
    )


def assemble(log: Log, placed: Placed) -> tuple[TrackerRecording, dict[str, Any]]:
    """The recording of trackers that are on one time base, in the house's world, and its facts. Raises `UsageError` for roles that don't fit."""
    warnings = list(log.warnings)
    time, tracked = placed.time, placed.tracked
    position, orientation = to_house(placed.position, placed.orientation, log.up, log.handedness)
    segments = assign(placed.trackers, placed.roles, log.roles or {}, warnings)
    warnings.extend(placed.warnings)
    if doubt := doubt_up(position, tracked, log.up, [segments.get(name) for name in placed.trackers]):
        warnings.append(doubt)
    step = usual_step(time)
    recording = TrackerRecording(
        time=time,
        trackers=placed.trackers,
        orientation=rotations.make_continuous(rotations.normalize(orientation)),
        position=position,
        tracked=tracked,
        segments=segments,
        source=Source(
            format=log.format,
            rate_hz=1.0 / step if step else 0.0,
            configuration=log.configuration,
            sha256=log.sha256,
            warnings=tuple(warnings),
            interpolated_frames=int((~tracked).any(axis=1).sum()),
        ),
    )
    return recording, _facts(recording, placed.cleaned, log)


def time_base(trackers: Sequence[Cleaned], name: str, warnings: list[str]) -> Array:
    """The times (T,) s of all frames. Raises `FormatError` for times too uneven to put on one base."""
    times = np.unique(np.concatenate([one.time for one in trackers]))
    if len(times) == 1:
        return times
    usual = usual_step(times)
    own = [one.step_s for one in trackers if one.step_s]
    step = float(np.median(own)) if own else usual
    # Times that interleave are even, too, but are nobody's rate.
    if usual >= 0.9 * step and np.abs(np.diff(times) - usual).max() <= _EVEN * usual:
        return times
    refuse_sparse(times, step, name)
    rates = sorted({f"{1 / value:.4g}" for value in own})
    why = f"trackers log at {', '.join(rates)} Hz" if len(rates) > 1 else "times are uneven or differ between trackers"
    warnings.append(f"{why}: interpolated onto an even {1 / step:.5g} Hz")
    return np.asarray(times[0] + step * np.arange(int(float(times[-1] - times[0]) / step + 1e-6) + 1))


def refuse_sparse(times: Array, step: float, name: str) -> None:
    """Raise `FormatError` where an even grid of `step` s over `times` would be almost nothing but gaps."""
    duration = float(times[-1] - times[0])
    if not duration / step < 100 * len(times) + 100_000:
        raise FormatError(
            name,
            f"rows come every {step:.3g} s but span {duration:.3g} s",
            expected="times of one unit and one recording",
        )


def fill(time: Array, one: Cleaned) -> Filled:
    """The tracker's rows at the times (T,), s, of the frames: interpolated, held and blended as the module says, and marked."""
    position, position_seen, position_gaps = _on_base(time, one, one.position, one.position_ok)
    orientation, orientation_seen, orientation_gaps = _on_base(time, one, one.orientation, one.orientation_ok)
    return Filled(position, orientation, position_seen & orientation_seen, sorted({*position_gaps, *orientation_gaps}))


def longest_gap_s(one: Cleaned) -> float:
    """Rows of the tracker may be so far apart and are still interpolated between."""
    return max(LONGEST_GAP_S, 1.5 * one.step_s) + 1e-3 * one.step_s


def _on_base(
    time: Array, one: Cleaned, values: Array, measured: BoolArray
) -> tuple[Array, BoolArray, list[tuple[float, float]]]:
    """`values` (N, 3) or quaternions (N, 4) at `time` (T,), where they count as tracked (T,), and the long gaps (start, end) in s."""
    at, known = one.time[measured], values[measured]
    if np.array_equal(at, time):
        return known, np.ones(len(time), bool), []
    slack = 1e-3 * one.step_s  # a time this near a row's is that row's: clocks are rounded
    right = np.searchsorted(at, time)
    inside, left = np.minimum(right, len(at) - 1), np.maximum(right - 1, 0)
    out = known[inside]
    inner = np.flatnonzero((right > 0) & (right < len(at)) & (at[inside] != time))
    before, after = left[inner], inside[inner]
    span = at[after] - at[before]
    out[inner] = _between(known[before], known[after], (time[inner] - at[before]) / span)
    seen = np.minimum(np.abs(at[inside] - time), np.abs(at[left] - time)) <= slack
    seen[inner] |= span <= 1.5 * one.step_s + slack

    longest = longest_gap_s(one)
    between = [(float(at[i]), float(at[i + 1])) for i in np.flatnonzero(np.diff(at) > longest)]
    out = _hold_and_blend(time, out, seen, between, slack)
    ends = [(float(time[0]), float(at[0])), (float(at[-1]), float(time[-1]))]
    return out, seen, sorted([*between, *((start, end) for start, end in ends if end - start > longest)])


def _hold_and_blend(
    time: Array, values: Array, seen: BoolArray, gaps: list[tuple[float, float]], slack: float
) -> Array:
    """`values` with the last pose held over each long gap and blended back after it; `seen` is cleared there, in place.

    gaps: (start, end) in s, of the rows before and after, in their order.
    """
    out = values
    for start, end in gaps:
        first, back = np.searchsorted(time, [start + slack, end - slack])
        if not 0 < first < back < len(time):
            continue  # between two frames
        held = out[first - 1].copy()
        if out is values:
            out = values.copy()
        out[first:] = values[first:]  # what an earlier blend had left beyond here
        out[first:back] = held
        duration = _blend_s(held, values[back])
        until = int(np.searchsorted(time, time[back - 1] + duration))
        weight = minimum_jerk((time[back:until] - time[back - 1]) / duration)
        out[back:until] = _between(np.broadcast_to(held, values[back:until].shape), values[back:until], weight)
        seen[first:until] = False
    return out


def _blend_s(held: Array, wanted: Array) -> float:
    if len(held) == 4:
        needed = _PEAK * float(rotations.angle(held, wanted)) / BLEND_RATE_RAD_S
    else:
        needed = _PEAK * float(np.linalg.norm(wanted - held)) / BLEND_SPEED_M_S
    return min(max(needed, SHORTEST_BLEND_S), LONGEST_BLEND_S)


def _between(start: Array, end: Array, fraction: Array) -> Array:
    if start.shape[-1] == 4:
        return rotations.slerp(start, end, fraction)
    return np.asarray(start + fraction[:, None] * (end - start))


def fault_lines(one: Cleaned, filled: Filled) -> list[str]:
    """One short line for each kind of fault of one tracker."""
    lines = []
    if one.invalid_rows:
        lines.append(f"{one.invalid_rows} rows marked as not tracked")
    if one.origin_rows:
        lines.append(f"{one.origin_rows} rows at the origin, as written for a lost tracker: taken as not tracked")
    if one.missing_rows:
        lines.append(f"{one.missing_rows} rows with missing or impossible numbers")
    if one.bad_quaternions:
        lines.append(f"{one.bad_quaternions} quaternions rejected, length off by more than {UNIT_TOLERANCE:g}")
    if one.same_time_rows:
        lines.append(f"{one.same_time_rows} rows with the time of the row before left out")
    if count := len(one.jump_times):
        shown = ", ".join(f"{time:.3f}" for time in one.jump_times[:_SHOWN]) + (" …" if count > _SHOWN else "")
        lines.append(f"{count} jumps over {1000 * JUMP_M:g} mm between rows, at {shown} s: kept")
    if filled.long_gaps:
        lines.append(
            f"lost for longer than {LONGEST_GAP_S:g} s ({_spans(filled.long_gaps)}): last pose held, then blended back"
        )
    if marked := int((~filled.tracked).sum()):
        lines.append(
            f"{marked} of {len(filled.tracked)} frames not measured (interpolated, held or blended) and marked"
        )
    return [f"{one.tracker}: {line}" for line in lines]


def _repeat_lines(trackers: Sequence[Cleaned]) -> list[str]:
    """What repeats, for all trackers together: where one log holds samples, or a synthetic person stands still, all do."""
    lines = []
    if repeating := [f"{one.tracker} {one.repeated_rows} of {one.rows}" for one in trackers if one.repeated_rows]:
        lines.append(f"rows that repeat the pose before: {', '.join(repeating)}")
    if frozen := [f"{one.tracker} {_spans(one.frozen, shown=1)}" for one in trackers if one.frozen]:
        lines.append(
            f"the same pose for longer than {FROZEN_S:g} s, so stood perfectly still, or the log froze: {'; '.join(frozen)}"
        )
    return lines


def _spans(spans: Sequence[tuple[float, float]], shown: int = _SHOWN) -> str:
    more = f" and {len(spans) - shown} more" if len(spans) > shown else ""
    return ", ".join(f"{start:.2f}-{end:.2f} s" for start, end in spans[:shown]) + more


def _facts(recording: TrackerRecording, cleaned: Sequence[Cleaned], log: Log) -> dict[str, Any]:
    """What `retarget info` says of a tracker log, JSON-able."""
    time = recording.time
    return {
        "format": log.format,
        "kind": "trackers",
        "rate_hz": recording.rate_hz,
        "frames": recording.frames,
        "duration_s": float(time[-1] - time[0]),
        "start_s": float(time[0]),
        "up": log.up,
        "trackers": list(recording.trackers),
        "segments": dict(recording.segments),
        "gaps": _gaps(recording),
        "interpolated_frames": recording.source.interpolated_frames,
        "bad_quaternions": sum(one.bad_quaternions for one in cleaned),
        "repeated_rows": sum(one.repeated_rows for one in cleaned),
        "jumps": sum(len(one.jump_times) for one in cleaned),
        "path_m": _paths(recording, sampled_path),
        "steady_path_m": _paths(recording, steady_path),
        "warnings": list(recording.source.warnings),
    }


def _paths(recording: TrackerRecording, length: Callable[[Array, Array, BoolArray], float]) -> dict[str, float]:
    """Tracker → m, to the millimetre."""
    return {
        tracker: round(length(recording.time, recording.position[:, column], recording.tracked[:, column]), 3)
        for column, tracker in enumerate(recording.trackers)
    }


def _gaps(recording: TrackerRecording) -> list[dict[str, Any]]:
    """Each run of frames in which a tracker was not measured."""
    found = []
    time = recording.time
    for column, tracker in enumerate(recording.trackers):
        edges = np.flatnonzero(np.diff(~recording.tracked[:, column], prepend=False, append=False))
        for start, stop in edges.reshape(-1, 2).tolist():
            first, last = time[max(start - 1, 0)], time[min(stop, len(time) - 1)]
            found.append(
                {
                    "tracker": tracker,
                    "start_s": float(first),
                    "duration_s": float(last - first),
                    "frames": stop - start,
                }
            )
    return found
