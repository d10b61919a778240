"""What became of the rows of a ROS recording that is read in parts, in sum: the lines that the whole would have at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from retarget.core.types import BoolArray
from retarget.formats._ros_placing import out_of_order, repeated
from retarget.formats._tracker_faults import Cleaned
from retarget.formats._tracker_recording import Filled, fault_lines

_COUNTS = ("rows", "origin_rows", "missing_rows", "bad_quaternions", "same_time_rows")


@dataclass
class _Edge:
    """Of one edge: rows by `_COUNTS`; flags of its frames; long gaps (start, end) in s."""

    counts: dict[str, int] = field(default_factory=lambda: dict.fromkeys(_COUNTS, 0))
    tracked: list[BoolArray] = field(default_factory=list)
    gaps: list[tuple[float, float]] = field(default_factory=list)


class Tally:
    """Counts rows once, though the parts of a recording share some. late: edge → rows out of order. interpolated: frames."""

    def __init__(self) -> None:
        self.late: dict[str, int] = {}
        self._edges: dict[str, _Edge] = {}
        self._last: dict[str, tuple[Cleaned, Filled]] = {}
        self._frames, self._held, self.interpolated = 0, 0, 0

    def rows(self, cleaned: Sequence[Cleaned], held: int, sign: int = 1) -> None:
        """Add what the rows of each edge came to, held: repeated ones that were left out; sign -1: of rows that will come again."""
        for one in cleaned:
            edge = self._edges.setdefault(one.tracker, _Edge())
            for name in _COUNTS:
                edge.counts[name] += sign * getattr(one, name)
        self._held += sign * held
        self._frames += sign * (cleaned[0].rows + held)

    def frames(
        self, cleaned: Sequence[Cleaned], filled: Sequence[Filled], wanted: slice, since: float, until: float
    ) -> None:
        """Add the frames `wanted` of each edge, and its long gaps that end after `since` and begin before `until`, s."""
        for one, here in zip(cleaned, filled, strict=True):
            edge = self._edges[one.tracker]
            edge.tracked.append(here.tracked[wanted].copy())
            edge.gaps += [gap for gap in here.long_gaps if gap[1] > since and gap[0] < until]
            self._last[one.tracker] = one, here

    def row_lines(self) -> list[str]:
        """Warnings of the messages themselves."""
        lines = [out_of_order(label, count) for label, count in self.late.items() if count]
        return [*lines, repeated(self._held, self._frames)] if self._held else lines

    def fault_lines(self) -> list[str]:
        """Warnings of what was not measured."""
        lines = []
        for label, edge in self._edges.items():
            one, here = self._last[label]
            summed: dict[str, Any] = {**edge.counts}
            tracked = np.concatenate(edge.tracked)
            lines += fault_lines(replace(one, **summed), replace(here, tracked=tracked, long_gaps=edge.gaps))
        return lines
