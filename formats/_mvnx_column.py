"""One field of an MVNX document over all its frames: texts of a chunk of the file become rows of an array, which grows in place."""

from __future__ import annotations

import numpy as np
from retarget.core.types import Array
from retarget.formats._number_text import parse_rows

_GROW_BYTES = 8 << 20


class Column:
    """A field's values over all frames: texts of the current chunk, and the array that they go to, `width` numbers a row.

    expected: what messages say the field holds. Frames are counted from 0 in the order of the document.
    """

    def __init__(self, field: str, width: int, expected: str) -> None:
        self.field, self.width, self.expected = field, width, expected
        self.values = np.empty((0, width))
        self.first = 0  # the frame in the array's first row: those before were dropped
        self.last = -1  # newest frame that has the field
        self.texts: list[str] = []  # one for each frame of `frames`, the last one perhaps in several pieces so far
        self.frames: list[int] = []
        self.lines: list[int] = []
        self.add_text = self.texts.append

    def end(self) -> None:
        """The field that was begun last is complete."""
        if len(self.texts) != len(self.frames):
            first = len(self.frames) - 1
            self.texts[first:] = ["".join(self.texts[first:])]

    def convert(self, frames: int, *, open_field: bool) -> None:
        """Turn the texts, except that of a field still open, into rows of the array; `frames` have begun so far.

        Raises `RowError`.
        """
        count = len(self.frames) - open_field
        if not count:
            return
        rows = parse_rows(self.texts[:count], self.width)
        self._grow(frames)
        places = np.array(self.frames[:count]) - self.first
        first, last = int(places[0]), int(places[-1])
        self.values[slice(first, last + 1) if last - first + 1 == count else places] = rows
        del self.texts[:count], self.frames[:count], self.lines[:count]

    def finish(self, frames: int) -> Array:
        """The array, with exactly the rows that are held of `frames`."""
        self._grow(frames)
        self.values.resize((frames - self.first, self.width), refcheck=False)
        return self.values

    def rows(self, first: int, stop: int) -> Array:
        """A copy of the rows of frames `first` to `stop` - 1, all of which are complete and held."""
        self._grow(stop)
        return self.values[first - self.first : stop - self.first].copy()

    def drop(self, before: int) -> None:
        """Hold the rows of frames from `before` on only."""
        self.values = self.values[before - self.first :].copy()
        self.first = before

    def _grow(self, frames: int) -> None:
        have, needed = len(self.values), frames - self.first
        if needed > have:
            # In place, and by bounded steps: a list of blocks would need twice the memory at the end.
            step = min(have // 4, _GROW_BYTES // (8 * max(self.width, 1)))
            self.values.resize((max(needed, have + step), self.width), refcheck=False)
            self.values[have:] = np.nan
