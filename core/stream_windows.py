"""A motion that arrives in parts, cut into windows that overlap: each with as much around what is wanted of it as decides how that moves."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from retarget.core import timebase
from retarget.core.errors import MotionError
from retarget.core.timebase import CLOCK_SLACK_S
from retarget.core.types import HumanMotion, Source


@dataclass(frozen=True)
class Blocks:
    """Seconds of the recording: the first block's, which is to be out soon, the later ones', and how much more on either side is looked at."""

    first_s: float
    block_s: float
    lead_s: float


@dataclass(frozen=True, eq=False)
class Window:
    """motion: the frames to convert. wanted: which of them are the block. is_last: no block follows; source: then that of the whole."""

    motion: HumanMotion
    wanted: slice
    is_last: bool
    source: Source


class Windows:
    """The windows of a motion's `parts`, at `rate_hz` (None = its own), of its frames from `start_s` to `end_s` on its own clock.

    Blocks are as long as `blocks` says, whatever the parts are, and disjoint; together they are the frames that `timebase.cut` and
    `timebase.resample`, anchored at the first of them, give of the whole motion. Parts are asked for when they are needed, and forgotten.
    """

    def __init__(
        self,
        parts: Iterable[HumanMotion],
        blocks: Blocks,
        start_s: float | None = None,
        end_s: float | None = None,
        rate_hz: float | None = None,
    ) -> None:
        self._parts, self._blocks, self._rate_hz = iter(parts), blocks, rate_hz
        self._start = -np.inf if start_s is None else start_s - CLOCK_SLACK_S
        self._end = np.inf if end_s is None else end_s + CLOCK_SLACK_S
        self._held: list[HumanMotion] = []
        self._is_over = False

    def __iter__(self) -> Iterator[Window]:
        """Raises `MotionError` when no frame is wanted, and what asking for parts raises."""
        blocks = self._blocks
        begin = anchor = self._first_wanted()
        length, is_last = blocks.first_s, False
        while not is_last:
            end = begin + length
            while self._held[-1].time[-1] < min(end, self._end) + blocks.lead_s and self._more():
                pass
            led = self._led(begin, end)
            if self._rate_hz is not None:
                led = timebase.on_grid(led, self._rate_hz, anchor)
            last = self._last_wanted(anchor)
            is_last = last < end - CLOCK_SLACK_S
            if is_last:
                self._read_to_the_end()
            inside = (led.time >= begin - CLOCK_SLACK_S) & (led.time < end - CLOCK_SLACK_S)
            wanted = np.flatnonzero(inside & (led.time <= last + CLOCK_SLACK_S))
            if len(wanted):  # else frames are missing for longer than a block
                yield Window(led, slice(int(wanted[0]), int(wanted[-1]) + 1), is_last, self._held[-1].source)
            self._forget(end - blocks.lead_s)
            begin, length = end, blocks.block_s

    def _more(self) -> bool:
        """Ask for the next part; whether there was one."""
        part = None if self._is_over else next(self._parts, None)
        if part is None:
            self._is_over = True
            return False
        self._held.append(part)
        return True

    def _first_wanted(self) -> float:
        first: float | None = None
        while self._more():
            time = self._held[-1].time
            first = float(time[0]) if first is None else first
            if len(inside := time[time >= self._start]):
                if inside[0] > self._end:
                    break
                return float(inside[0])
            self._forget(self._start - self._blocks.lead_s)
        if first is None:
            raise MotionError("no frame")
        self._read_to_the_end()
        wanted = " and ".join(
            f"{word} {limit:g} s"
            for word, limit in (("from", self._start + CLOCK_SLACK_S), ("until", self._end - CLOCK_SLACK_S))
            if np.isfinite(limit)
        )
        raise MotionError(f"no frame {wanted}; the recording runs from {first:g} s to {self._held[-1].time[-1]:g} s")

    def _led(self, begin: float, end: float) -> HumanMotion:
        """The held frames from `begin` to `end` and around them, at least one before where there is any."""
        held = timebase.joined(self._held)
        self._held = [held]
        before = held.time[held.time < begin - CLOCK_SLACK_S]
        low = begin - self._blocks.lead_s
        return timebase.cut(
            held, min(low, float(before[-1])) if len(before) else low, min(end, self._end) + self._blocks.lead_s
        )

    def _last_wanted(self, anchor: float) -> float:
        """Time of the last wanted frame among those that are held, on the grid where there is one."""
        time = self._held[-1].time
        last = float(time[time <= self._end][-1])
        if self._rate_hz is None:
            return last
        return anchor + float(np.floor((last - anchor) * self._rate_hz + 1e-6)) / self._rate_hz

    def _read_to_the_end(self) -> None:
        """What comes after the wanted frames still has to be a recording, and its last part tells of the whole."""
        while self._more():
            del self._held[:-1]

    def _forget(self, before: float) -> None:
        """Hold frames from `before` on only, and one before, which a gap in time may leave alone."""
        held = self._held[-1]
        earlier = [part for part in self._held[:-1] if part.time[-1] >= before]
        if not earlier:
            at = max(int(np.searchsorted(held.time, before)) - 1, 0)
            held = timebase.cut(held, float(held.time[at]), None)
        self._held = [*earlier, held]
