"""A suit's motion in consecutive parts while its ROS recording arrives: joined, they are what `RosRecording.result` makes of the whole.

Which frames are whose, the clock, the time base, the arms' frames and the person's size are decided by the first part and kept. A part ends where
every frame was measured shortly before and nothing is being held or blended: so nothing behind that instant depends on what was before
it, and what was before it is forgotten. While a frame is lost, its recording is held until it is back.

Not read in parts, but as a whole at the end: trackers, and suits whose frames come from several topics, which may stand one after the other.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from retarget.core.errors import FormatError, RetargetError
from retarget.core.types import Array, BoolArray, HumanMotion, TrackerRecording
from retarget.formats._mcap_reader import Batch
from retarget.formats._ros_frames import Edge
from retarget.formats._ros_motion import arm_references, in_house, motion_of
from retarget.formats._ros_placing import composed, samples_of, without_held
from retarget.formats._ros_recording import Choice, RosRecording
from retarget.formats._ros_tally import Tally
from retarget.formats._tracker_faults import Cleaned, Samples, clean, usual_step
from retarget.formats._tracker_recording import (
    LONGEST_BLEND_S,
    Log,
    fill,
    longest_gap_s,
    refuse_sparse,
    stacked,
    time_base,
)

PART_S = 10.0
SLACK_S = 2.0
"""Messages may come so much later than others of the same time."""
OVERLAP_S = 1.0
"""Rows are kept from so long before the last frame given out: more than lies between two that are interpolated between."""
LONGEST_STEP_S = 0.5
_PATIENCE = 1.5
"""So many times as much has to have come before it is tried again."""
_EVEN, _NEAR = 0.5, 0.9
_UNTURNED = (1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class _Rows:
    """What is held of each moving edge up to some time, looked through. held: repeated rows, left out."""

    cleaned: list[Cleaned]
    held: int
    log: Log


class SuitStream:
    """Takes in the messages of a recording and gives out the motion, the first part at least `first_s` long. `recording` must be empty."""

    def __init__(self, recording: RosRecording, first_s: float) -> None:
        self._recording, self._first_s = recording, first_s
        self._due_s = first_s + SLACK_S
        self._choice: Choice | None = None
        self._edges: list[Edge] = []
        self._start_ns = 0
        self._map = recording.map
        self._known_lines, self._base_lines = list[str](), list[str]()
        self._written_s = -np.inf
        self._kept: list[int] = []  # rows of each edge up to the last frame given out
        self._counted: list[int] = []  # rows of each edge whose order was looked at
        self._step_s = 0.0
        self._grid: float | None = None  # a time of the even grid, where times are not the recording's own
        self._first: HumanMotion | None = None
        self._last_orientation: Array | None = None
        self._times_s: list[Array] = []
        self._tally = Tally()

    def add(self, batch: Batch) -> Iterator[HumanMotion]:
        """Take in messages; the part that they complete, if they do. Raises `FormatError` as `RosRecording.add`, and for rows too late."""
        self._recording.add(batch)
        if self._span_s() < self._due_s:
            return
        part = self._next()
        self._due_s = _PATIENCE * self._span_s() if part is None else self._span_s() + PART_S
        if part is not None:
            yield part

    def end(self, sha256: str) -> HumanMotion | TrackerRecording | None:
        """The last part, whose `source` is that of the whole; None for a robot's recording. Raises as `RosRecording.result`."""
        if self._first is None:
            return None if self._recording.is_robot() else self._recording.result(sha256)[0]
        rows = self._rows(np.inf)
        part = self._part(rows, self._time_base(rows.cleaned))
        warnings = (
            *self._recording.warnings,
            *self._known_lines,
            *self._tally.row_lines(),
            *self._base_lines,
            *self._tally.fault_lines(),
            *self._first.source.warnings,
            *self._unused(),
        )
        source = replace(
            self._first.source,
            rate_hz=1.0 / usual_step(np.concatenate(self._times_s)),
            sha256=sha256,
            warnings=warnings,
            interpolated_frames=self._tally.interpolated,
        )
        return replace(part, source=source)

    def _next(self) -> HumanMotion | None:
        """The next part; None where it is not whole yet, or not known yet what the recording holds."""
        try:
            if self._first is None and not self._begin():
                return None
            settled = max(int(time.max()) for time in self._times()) / 1e9 - SLACK_S
            rows = self._rows(settled)
            time = self._time_base(rows.cleaned)
        except RetargetError:
            if self._first is None:  # what is missing may still come; if not, it is said at the end
                return None
            raise
        until = self._quiet(rows, time)
        if until is None:
            return None
        part = self._part(rows, time[time <= until])
        self._forget(settled)
        return part

    def _span_s(self) -> float:
        topics = self._recording.topics.values()
        first = [topic.first for topic in topics if topic.first is not None]
        last = [topic.last for topic in topics if topic.last is not None]
        return (max(last) - min(first)) * 1e-9 if first else 0.0

    def _begin(self) -> bool:
        """Decide which frames are used, by all that has come; whether they can be given out in parts. Raises as `RosRecording.choice`."""
        recording = self._recording
        said = len(recording.warnings)
        if recording.is_robot():
            return False
        choice = recording.choice()
        edges = choice.moving()
        if not choice.suit or len({edge.topic for edge in edges}) != 1:
            return False
        self._choice, self._edges, self._known_lines = choice, edges, choice.warnings[said:]
        self._start_ns = min(int(edge.times(choice.clock).min()) for edge in edges)
        self._counted, self._tally = [0] * len(edges), Tally()
        return True

    def _times(self) -> list[NDArray[np.int64]]:
        """ns since the first of all, of the held rows of each edge."""
        assert self._choice is not None
        return [edge.times(self._choice.clock) - self._start_ns for edge in self._edges]

    def _rows(self, until: float) -> _Rows:
        """Up to `until`, s. Raises `FormatError` for an edge that has none, or none that can be used, and for such as come too late."""
        name, times = self._recording.name, self._times()
        if self._first is not None:
            self._refuse_late(times)
        self._count_late(times)
        samples = [_up_to(until, samples_of(edge, time, [])) for edge, time in zip(self._edges, times, strict=True)]
        if missing := [one.tracker for one in samples if not len(one.time)]:
            raise FormatError(name, f"{missing[0]}: no pose")
        fewer = without_held(samples, [])
        return _Rows(
            cleaned=[clean(one, name, suit=True) for one in fewer],
            held=len(samples[0].time) - len(fewer[0].time),
            log=self._recording.log(fewer, []),
        )

    def _count_late(self, times: list[NDArray[np.int64]]) -> None:
        for index, (edge, time) in enumerate(zip(self._edges, times, strict=True)):
            new = time[max(self._counted[index] - 1, 0) :]
            self._tally.late[edge.label] = self._tally.late.get(edge.label, 0) + int((np.diff(new) < 0).sum())
            self._counted[index] = len(time)

    def _refuse_late(self, times: list[NDArray[np.int64]]) -> None:
        for edge, time, kept in zip(self._edges, times, self._kept, strict=True):
            if int((time / 1e9 <= self._written_s).sum()) > kept:
                raise FormatError(
                    self._recording.name,
                    f"{edge.label}: poses of before {self._written_s:.3f} s arrive behind those of {time.max() / 1e9:.3f} s",
                    place=f"topic {edge.topic}",
                    expected="messages in order of time; a file can be read as it is: write to one with -o FILE",
                )

    def _time_base(self, cleaned: list[Cleaned]) -> Array:
        """Times (T,) s of frames, from the last one given out on.

        The first part decides on them; where they are the recording's own and turn uneven, an even grid goes on from there.
        """
        own = np.unique(np.concatenate([one.time for one in cleaned]))
        if self._first is None:
            lines = list[str]()
            time = time_base(cleaned, self._recording.name, lines)
            self._base_lines = lines
            if np.array_equal(time, own):
                self._step_s, self._grid = usual_step(own), None
            else:
                self._step_s = float(np.median([one.step_s for one in cleaned if one.step_s]))
                self._grid = float(time[0])
            return time
        own = own[own >= self._written_s]
        if self._grid is None:
            uneven = float(np.abs(np.diff(own) - self._step_s).max(initial=0.0)) > _EVEN * self._step_s
            if not uneven and usual_step(own) >= _NEAR * self._step_s:
                return own
            self._grid = self._written_s
            self._base_lines.append(
                f"times are uneven behind {self._written_s:.3f} s: from there on interpolated onto an even {1 / self._step_s:.5g} Hz"
            )
        refuse_sparse(own, self._step_s, self._recording.name)
        first = np.rint((self._written_s - self._grid) / self._step_s)
        last = int((own[-1] - self._grid) / self._step_s + 1e-6)
        return np.asarray(self._grid + self._step_s * np.arange(first, last + 1))

    def _quiet(self, rows: _Rows, time: Array) -> float | None:
        """The latest time of a frame behind which nothing depends on what was before it."""
        if not 0 < self._step_s <= LONGEST_STEP_S:
            return None
        measured = [one.time[one.orientation_ok] for one in rows.cleaned]
        quiet = time <= min(float(at[-1]) for at in measured)
        quiet &= time > self._written_s if self._first is not None else time >= time[0] + self._first_s
        for one, at in zip(rows.cleaned, measured, strict=True):
            for index in np.flatnonzero(np.diff(at) > longest_gap_s(one)):
                quiet &= (time <= at[index]) | (time > at[index + 1] + LONGEST_BLEND_S)
        found = np.flatnonzero(quiet)
        return float(time[found[-1]]) if len(found) else None

    def _part(self, rows: _Rows, time: Array) -> HumanMotion:
        """The frames at `time`, without the first, which was given out, where anything was."""
        assert self._choice is not None
        recording, first = self._recording, self._first
        filled = [fill(time, one) for one in rows.cleaned]
        placed = stacked(time, rows.cleaned, filled, [])
        placed = composed(recording.name, self._choice.chains, placed)
        motion, _ = motion_of(rows.log, placed, self._map)
        if first is None and not self._map.rotations:  # later parts take them from here, unturned ones, too
            found = arm_references(*in_house(rows.log, placed), [])
            self._map = replace(self._map, rotations=found or {next(iter(self._choice.chains)): _UNTURNED})
        wanted = slice(0 if first is None else 1, len(time))
        self._tally.rows(rows.cleaned, rows.held)
        self._tally.frames(rows.cleaned, filled, wanted, self._written_s, float(time[-1]))
        self._tally.interpolated += int((~placed.tracked[wanted]).any(axis=1).sum())
        orientation = motion.orientation
        if self._last_orientation is not None:
            flipped = (orientation[0] * self._last_orientation).sum(axis=-1, keepdims=True) < 0
            orientation = np.where(flipped, -orientation, orientation)
        self._last_orientation, self._written_s = orientation[-1].copy(), float(time[-1])
        self._times_s.append(time[wanted].copy())
        part = replace(
            motion,
            time=time[wanted],
            orientation=orientation[wanted],
            position=motion.position[wanted],
            source=replace(motion.source, interpolated_frames=0),
        )
        if first is None:
            self._first = first = part
        return replace(part, joint_offsets=first.joint_offsets, source=first.source)

    def _forget(self, settled: float) -> None:
        """Keep the rows that what comes needs, and of what is not used nothing. settled: up to where, s, rows were counted."""
        used = {id(edge) for edge in self._edges}
        for edge in self._recording.frames.edges.values():
            if id(edge) not in used:
                kept = np.zeros(len(edge.stamps), bool)
                kept[-1:] = edge.static
                _keep(edge, kept)
        for edge, time in zip(self._edges, self._times(), strict=True):
            _keep(edge, time / 1e9 >= self._written_s - OVERLAP_S)
        times = self._times()
        self._kept = [int((time / 1e9 <= self._written_s).sum()) for time in times]
        self._counted = [len(time) for time in times]
        again = self._rows(settled)
        self._tally.rows(again.cleaned, again.held, sign=-1)

    def _unused(self) -> list[str]:
        """Which segments came after it was decided which there are."""
        assert self._choice is not None
        try:
            late = sorted(self._recording.choice().chains.keys() - self._choice.chains.keys())
        except RetargetError:
            return []
        return [f"{', '.join(late)}: not used, as first seen behind the first {self._first_s:g} s"] if late else []


def _up_to(until: float, samples: Samples) -> Samples:
    """The rows with times up to `until`, s."""
    rows = slice(int(np.searchsorted(samples.time, until, side="right")))
    names = ("time", "position", "orientation", "valid", "line")
    return replace(samples, **{name: getattr(samples, name)[rows] for name in names})


def _keep(edge: Edge, rows: BoolArray) -> None:
    """Forget all other rows of `edge`."""
    if rows.all():
        return
    edge.stamps = array("q", np.array(edge.stamps, np.int64)[rows].tobytes())
    edge.log_times = array("q", np.array(edge.log_times, np.int64)[rows].tobytes())
    edge.values = array("d", np.array(edge.values, float).reshape(-1, 7)[rows].tobytes())
