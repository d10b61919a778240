"""Text of separated columns → arrays, a column or a block of columns at a time."""

from __future__ import annotations

import csv
import hashlib
import re
import string
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray
from retarget.core.errors import FormatError
from retarget.core.types import Array, BoolArray
from retarget.formats._byte_chunks import read_whole

DELIMITERS = {"comma": ",", "semicolon": ";", "tab": "\t", "space": " "}
COMMENTS = ("#", "%", "//")
_SUSPECT = frozenset(["", "#", "%", "/", *string.whitespace])

_NOTHING = ("", "nan", "none", "null", "na", "n/a", "-", "--")
_YES = (
    "1",
    "1.0",
    "true",
    "yes",
    "y",
    "t",
    "ok",
    "valid",
    "tracked",
    "tracking",
    "good",
    "running_ok",
    "trackingresult_running_ok",
)
_NO = [
    "0",
    "0.0",
    "false",
    "no",
    "n",
    "f",
    "invalid",
    "lost",
    "untracked",
    "not_tracked",
    "nottracked",
    "bad",
    "uninitialized",
    "out_of_range",
    "running_outofrange",
    "calibrating_inprogress",
    "calibrating_outofrange",
    "fallback_rotationonly",
    "disconnected",
    "occluded",
    "nan",
    "none",
    "null",
]
LONGEST_CELL = 100
"""Characters; numbers have up to 25, names of devices some 40."""
_OPENVR_RUNNING_OK = 200.0  # ETrackingResult; all its codes but 1 (uninitialised) are 100 or more
_OPENVR_CODES = 100.0


def read_lines(stream: BinaryIO, name: str) -> tuple[list[str], str]:
    """All lines of a text file, without their ends, and the hash of its bytes; raises `FormatError` for what is no text."""
    digest = hashlib.sha256()
    data = read_whole(stream, name, digest)
    encoding = "utf-16" if data.startswith((b"\xff\xfe", b"\xfe\xff")) else "utf-8-sig"
    try:
        text = data.decode(encoding)
    except UnicodeDecodeError as error:
        raise FormatError(name, f"not UTF-8 text: {error.reason}", place=f"byte {error.start}") from None
    if "\0" in text:
        raise FormatError(name, "not a text file: holds NUL characters", expected="columns of numbers")
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n"), digest.hexdigest()


def split(line: str, delimiter: str) -> list[str]:
    """The cells of a line of names, without blanks and quotes around them."""
    if delimiter == " ":
        return [cell.strip('"') for cell in line.split()]
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])]
    except csv.Error:
        return []


@dataclass(frozen=True, eq=False)
class Table:
    """Rows below a header. lines: one text a row, cells set apart by `delimiter`, all of `width` cells. numbers: (N,) line numbers from 1.

    columns: names for messages, as many as there are cells.
    """

    name: str
    lines: list[str]
    numbers: NDArray[np.int64]
    delimiter: str
    columns: tuple[str, ...]
    _numbers: dict[int, Array] = field(default_factory=dict)

    def load(self, columns: Iterable[int]) -> None:
        """Parse those of the columns that hold numbers in one pass over the text, for `values` and `flags` to find."""
        cells = self.lines[0].split(self.delimiter)
        numeric = sorted({column for column in columns if is_number(cells[column].strip())})
        try:
            values = self._load(numeric, np.float64) if numeric else np.zeros((0, 0))
        except ValueError:  # some cell farther down holds none
            return
        self._numbers.update(zip(numeric, values.T, strict=False))

    def values(self, columns: Sequence[int]) -> Array:
        """Numbers (N, k) of those columns, NaN where a cell is empty. Raises `FormatError` naming a cell that holds none."""
        if all(column in self._numbers for column in columns):
            return np.stack([self._numbers[column] for column in columns], axis=1)
        try:
            return np.asarray(self._load(columns, np.float64), float)
        except ValueError:  # empty cells, or words: seldom, so a slower way is good enough
            pass
        out = np.empty((len(self.lines), len(columns)))
        for place, column in enumerate(columns):
            texts = self.words([column])[:, 0]
            texts = np.where(np.isin(np.char.lower(texts), _NOTHING), "nan", texts)
            try:
                out[:, place] = texts.astype(np.float64)
            except ValueError:
                row = next((i for i, text in enumerate(texts.tolist()) if not is_number(text)), 0)
                raise FormatError(
                    self.name,
                    f"'{_short(texts[row])}' in column '{self.columns[column]}' is no number",
                    place=f"line {self.numbers[row]}",
                ) from None
        return out

    def words(self, columns: Sequence[int]) -> NDArray[np.str_]:
        """Texts (N, k) of those columns, without blanks around them. Raises `FormatError` for a row with a cell over `LONGEST_CELL`."""
        # NumPy keeps as many characters for every cell as the longest of them has.
        for number, line in zip(self.numbers, self.lines, strict=True):
            if len(line) > LONGEST_CELL and (longest := max(map(len, line.split(self.delimiter)))) > LONGEST_CELL:
                raise FormatError(
                    self.name,
                    f"a cell of {longest} characters",
                    place=f"line {number}",
                    expected=f"at most {LONGEST_CELL}",
                )
        try:
            return np.char.strip(np.asarray(self._load(columns, np.str_), np.str_))
        except ValueError as error:
            raise FormatError(self.name, " ".join(str(error).split()), place="below the header") from None

    def flags(self, column: int, *, inverted: bool = False) -> BoolArray:
        """Whether a row (N,) is valid by a column of 0 and 1, true and false, words such as "lost", or OpenVR's tracking results."""
        if column in self._numbers:
            found, which = np.unique(self._numbers[column], return_inverse=True)
            kinds = found.astype(np.str_)
        else:
            kinds, which = np.unique(np.char.lower(self.words([column])[:, 0]), return_inverse=True)
        numbers = [float(kind) for kind in kinds.tolist() if is_number(kind)]
        if numbers and max(numbers) >= _OPENVR_CODES:
            known = [float(kind) == _OPENVR_RUNNING_OK if is_number(kind) else None for kind in kinds.tolist()]
        elif len(numbers) == len(kinds) and all(0 <= number <= 1 for number in numbers):
            known = [number > 0.5 for number in numbers]  # 1.000000, or the ratio of a mean
        else:
            known = [True if kind in _YES else False if kind in _NO or not kind else None for kind in kinds.tolist()]
        if None in known:
            row = int(np.argmax(which == known.index(None)))
            raise FormatError(
                self.name,
                f"'{_short(str(kinds[which[row]]))}' in column '{self.columns[column]}' says neither valid nor lost",
                place=f"line {self.numbers[row]}",
                expected="0 or 1, true or false, valid or lost, or OpenVR's 200 for running",
            )
        return np.asarray(known, bool)[which] ^ inverted

    def times(self, column: int) -> tuple[Array, bool]:
        """Times (N,) of a column, and whether these were calendar times (ISO 8601, UTC where no offset stands): then s since the first."""
        try:
            return self.values([column])[:, 0], False
        except FormatError:
            words = self.words([column])[:, 0].tolist()
        if not re.match(r"\d{4}-?\d{2}-?\d{2}[T ]", words[0]):
            return self.values([column])[:, 0], False  # raises again, naming the cell
        stamps = []
        for row, word in enumerate(words):
            try:
                stamp = datetime.fromisoformat(word)
            except ValueError:
                raise FormatError(
                    self.name,
                    f"'{_short(word)}' in column '{self.columns[column]}' is no ISO 8601 time",
                    place=f"line {self.numbers[row]}",
                ) from None
            stamps.append(stamp if stamp.tzinfo else stamp.replace(tzinfo=UTC))
        return np.array([(stamp - stamps[0]).total_seconds() for stamp in stamps]), True

    def _load(self, columns: Sequence[int], dtype: type[np.generic]) -> NDArray[np.generic]:
        return np.loadtxt(
            self.lines, dtype=dtype, delimiter=self.delimiter, comments=None, usecols=tuple(columns), ndmin=2
        )


def make_table(
    name: str, lines: list[str], first: int, delimiter: str, header: Sequence[str], warnings: list[str]
) -> Table:
    """The rows from line index `first` on; blank and comment lines are left out, a last line cut short too, with a warning.

    header: the columns' names, or empty for a file without. Raises `FormatError` for rows of another number of cells.
    """
    kept = [
        (number, line)
        for number, line in enumerate(lines[first:], first + 1)
        # Looking at the first character is enough for nearly all rows.
        if line[:1] not in _SUSPECT or (line.strip() and not line.lstrip().startswith(COMMENTS))
    ]
    if not kept:
        raise FormatError(name, "no rows below the header" if header else "no rows")
    rows = _plain([line for _, line in kept], delimiter)
    numbers = np.array([number for number, _ in kept])
    counts = np.array([row.count(delimiter) for row in rows]) + 1
    width = len(header) or int(counts[0])
    if header and (counts == width + 1).all() and all(row.endswith(delimiter) for row in rows):
        rows, counts = [row.removesuffix(delimiter) for row in rows], counts - 1
    if counts[-1] < width and lines[-1] and len(rows) > 1:  # the file doesn't end with a line's end
        warnings.append(f"line {numbers[-1]} is cut short and left out")
        rows, numbers, counts = rows[:-1], numbers[:-1], counts[:-1]
    if (counts != width).any():
        at = int(np.argmax(counts != width))
        raise FormatError(
            name,
            f"{counts[at]} cells",
            place=f"line {numbers[at]}",
            expected=f"{width} as in the {'header' if header else 'first row'}",
        )
    columns = tuple(header) or tuple(str(number) for number in range(1, width + 1))
    return Table(name, rows, numbers, delimiter, columns)


def _plain(rows: list[str], delimiter: str) -> list[str]:
    """Rows without quotes, with single blanks where blanks separate, with decimal points where semicolons separate decimal commas."""
    if delimiter == " ":
        rows = [" ".join(row.split()) for row in rows]
    if any('"' in row for row in rows):
        try:
            cells = list(csv.reader(rows, delimiter=delimiter, skipinitialspace=True))
        except csv.Error:
            cells = []
        # A quoted cell over several lines joins rows: no log has that, and line numbers would be wrong.
        if len(cells) == len(rows):
            rows = [delimiter.join(cell.replace(delimiter, "_") for cell in row) for row in cells]
    if delimiter == ";" and any("," in row for row in rows):
        rows = [row.replace(",", ".") for row in rows]
    return rows


def is_number(text: str) -> bool:
    """Whether a cell holds a number, or one of its spellings for none."""
    try:
        float(text)
    except ValueError:
        return False
    return "_" not in text


def _short(text: str) -> str:
    return text if len(text) <= 30 else text[:30] + "…"
