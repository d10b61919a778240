"""Logs of Vive and other trackers as text in columns: CSV, semicolons, tabs or blanks, with a header that names each column.

| form | columns |
|---|---|
| wide | a time, then each tracker's: `time_s, waist_x, waist_y, waist_z, waist_qw, waist_qx, waist_qy, waist_qz, chest_x, …` |
| long | one row a tracker and time: `timestamp, serial, x, y, z, qw, qx, qy, qz, valid` |

- Names are read in the common spellings: `LHR-1234_qw`, `left_hand.pos.x`, `chest/position/x [mm]`, `pose.orientation.w`, `HeadRotW`. A
  quaternion's order comes from its columns' names only. `x y z w i j k` (triad_openvr with its header) is one tracker.
- Units: m, s; or as the names say (`x_mm`, `y [cm]`, `time_ms`). ISO 8601 times count from the first row; so do numbers above 1e8 s (Unix time).
- `valid`, `tracked`, `status`, `lost` …, for all or each tracker: 0 and 1, true and false, words, OpenVR's tracking results (200 = running).
- Free text and comments before the header, a UTF-8 BOM, decimal commas between semicolons, a last line cut short are dealt with.
- For everything else a columns file says which column is what:

__COLUMNS__

**Up.** OpenVR's world has Y up, libsurvive's Z; a log doesn't tell, so say which. Undeclared, it is taken as Y, with a warning. Another warning comes
where the declared axis is unlikely. House world from OpenVR: (x, y, z) → (−z, −x, y).

**Faults.** Rejected, interpolated, held, repeated and jumping rows are counted in the warnings; what was not measured is marked as not
tracked. Gaps up to 0.5 s are interpolated; over longer ones the last pose is held and then blended back.
A tracker that is never tracked is an error, and so is time that goes backward.

**Roles.** Trackers named by SteamVR's roles (`waist`, `chest`, `left_elbow`, `TrackerRole_RightHand` …) or by segment sit on these; serials need a
table of roles.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, BinaryIO

import numpy as np
from retarget.core.errors import FormatError
from retarget.core.types import Array, TrackerRecording
from retarget.formats import _vive_columns
from retarget.formats._tracker_faults import LATEST_S, Samples, since_first, usual_step
from retarget.formats._tracker_recording import Log, build
from retarget.formats._vive_columns import ColumnsFile, read_columns
from retarget.formats._vive_layout import Layout, PoseColumns, recognise
from retarget.formats._vive_table import COMMENTS, DELIMITERS, Table, is_number, make_table, read_lines, split
from retarget.formats.base import Format, TrackerOptions

_columns_text = (_vive_columns.__doc__ or "").split("\n", 2)[-1].strip()
__doc__ = (__doc__ or "").replace("__COLUMNS__", "\n".join(f"  {line}".rstrip() for line in _columns_text.split("\n")))

_HEADER_WITHIN = 50
_LONGEST_HEADER = 100_000
_STEPS_S = (1e-4, 2.0)
"""Between these lies the time from row to row of a log, if a column without unit holds seconds."""


def read_trackers(stream: BinaryIO, name: str, options: TrackerOptions) -> TrackerRecording:
    """The trackers of a log. `stream` need not seek; `name` is what messages call it.

    Raises `FormatError` for content that can't be read, never guessing what a column is; `UsageError` for options that don't fit the log.
    """
    return build(_read(stream, name, options))[0]


def describe(stream: BinaryIO, name: str, options: TrackerOptions) -> Mapping[str, Any]:
    """Facts for `retarget info`, from a full read."""
    return build(_read(stream, name, options))[1]


def recognises(head: bytes) -> bool:
    """Whether among the first lines of a file one names a tracker's pose."""
    lines = head.decode("utf-8-sig", "replace").splitlines()
    return any(_recognised(line) is not None for line in lines[:_HEADER_WITHIN])


def _read(stream: BinaryIO, name: str, options: TrackerOptions) -> Log:
    lines, sha256 = read_lines(stream, name)
    warnings: list[str] = []
    columns = None if options.columns is None else read_columns(options.columns)
    if columns is None:
        table, layout = _by_header(lines, name, warnings)
    else:
        table, layout = _by_columns(lines, name, columns, warnings)
    table.load(layout.columns())
    rate = options.rate_hz or (columns.rate_hz if columns else None)
    time = _time(table, layout, options.rate_hz, rate, warnings)
    samples = _long(table, layout, time, rate) if layout.device is not None else _wide(table, layout, time, rate)
    if flat := [pose for pose in layout.trackers.values() if not pose.quaternion]:
        which = "the trackers" if len(flat) == len(layout.trackers) else f"{len(flat)} of the trackers"
        warnings.append(f"{which} have no orientation: set to the identity")
    up = options.up or (columns.up if columns else None)
    if up is None:
        up = "y"
        warnings.append("up axis not declared: taken as y, as OpenVR has it (libsurvive: z)")
    return Log(
        name=name,
        format=FORMAT.name,
        trackers=samples,
        up=up,
        handedness=options.handedness or (columns.handedness if columns else None) or "right",
        roles={**_present(columns, samples), **options.roles},
        warnings=warnings,
        sha256=sha256,
        configuration="long" if layout.device is not None else "wide",
    )


def _present(columns: ColumnsFile | None, samples: Iterable[Samples]) -> dict[str, str]:
    """Roles of the columns file for trackers that this log has: one file serves many logs."""
    names = {one.tracker for one in samples}
    return {tracker: role for tracker, role in (columns.roles if columns else {}).items() if tracker in names}


@dataclass(frozen=True)
class _Header:
    cells: list[str]
    delimiter: str
    layout: Layout


def _recognised(line: str) -> _Header | None:
    """A line as a header, with the delimiter for which it names a tracker's pose."""
    if len(line) > _LONGEST_HEADER:
        return None
    for delimiter in DELIMITERS.values():
        if delimiter in line:
            cells = split(line.strip().lstrip("#%").strip(), delimiter)
            if len(cells) >= 7 and (layout := recognise(cells)) is not None:
                return _Header(cells, delimiter, layout)
    return None


def _by_header(lines: list[str], name: str, warnings: list[str]) -> tuple[Table, Layout]:
    for number, line in enumerate(lines[:_HEADER_WITHIN]):
        header = _recognised(line)
        if header is None or not _fits(header, lines[number + 1 :]):
            continue
        table = make_table(name, lines, number + 1, header.delimiter, header.cells, warnings)
        if header.layout.unused:
            shown = header.layout.unused[:8]
            warnings.append(
                f"columns not used: {', '.join(shown)}{' …' if len(header.layout.unused) > len(shown) else ''}"
            )
        return table, header.layout
    first = next((line for line in lines if line.strip()), "")
    if any(is_number(cell) for delimiter in DELIMITERS.values() for cell in split(first, delimiter)[:1]):
        problem, example = "starts with numbers, without a header: their order can't be known", _vive_columns.EXAMPLE
    else:
        problem = "no header that names x, y, z and a quaternion's w, x, y, z of a tracker, each once"
        example = f"{_vive_columns.EXAMPLE_NAMED}; without a header, {_vive_columns.EXAMPLE}"
    raise FormatError(
        name,
        problem,
        place=f"line 1 '{_short(first)}'",
        expected=f"names such as time_s, chest_x … chest_qz, or a columns file (--columns) with lines such as {example}",
    )


def _fits(header: _Header, below: list[str]) -> bool:
    """Whether the first row below has as many cells as the header: a free text can name letters, too. True where there is no row."""
    for line in below:
        if line.strip() and not line.lstrip().startswith(COMMENTS):
            count = len(split(line, header.delimiter))
            return count in (len(header.cells), len(header.cells) + 1)
    return True


def _by_columns(lines: list[str], name: str, columns: ColumnsFile, warnings: list[str]) -> tuple[Table, Layout]:
    first = min(columns.skip_lines, len(lines))
    if not columns.header:
        delimiter = columns.delimiter or _likely_delimiter(lines[first:])
        table = make_table(name, lines, first, delimiter, (), warnings)
        return table, columns.layout((), len(table.columns))
    while first < len(lines) and not lines[first].strip():
        first += 1
    if first == len(lines):
        raise FormatError(name, f"nothing after the first {columns.skip_lines} lines", expected="a header and rows")
    delimiter = columns.delimiter or _likely_delimiter(lines[first:])
    names = split(lines[first].strip().lstrip("#%").strip(), delimiter)
    table = make_table(name, lines, first + 1, delimiter, names, warnings)
    return table, columns.layout(names, len(names))


def _likely_delimiter(lines: list[str]) -> str:
    """The first of comma, semicolon, tab and blank that is in the first line; semicolons before the commas of decimals."""
    line = next((line for line in lines if line.strip()), "")
    order = ";\t, "
    return next((delimiter for delimiter in order if delimiter in line.strip()), ",")


def _time(
    table: Table, layout: Layout, given_hz: float | None, rate: float | None, warnings: list[str]
) -> Array | None:
    """Times (N,) s of all rows, or None when they follow from the rate."""
    if layout.time is None:
        if rate is None:
            raise FormatError(
                table.name,
                f"no time column among {', '.join(table.columns[:12])}{' …' if len(table.columns) > 12 else ''}",
                expected="a column such as time_s, or the rate: --rate 90",
            )
        return None
    if given_hz is not None:
        warnings.append(f"the file has times: the rate {given_hz:g} Hz is not used")
    time, calendar = table.times(layout.time)
    if calendar:
        return time
    time = time * (layout.time_s or 1.0)
    if not (np.abs(time) < LATEST_S).all():
        return time  # refused below, with the line
    if layout.time_s is None:
        _check_seconds(table, layout, time)
    return since_first(time)


def _check_seconds(table: Table, layout: Layout, time: Array) -> None:
    """Whether a time column without unit can hold seconds."""
    steps = np.sort(np.unique(time))
    step = usual_step(steps)
    if step and not _STEPS_S[0] <= step <= _STEPS_S[1]:
        assert layout.time is not None
        column = table.columns[layout.time]
        raise FormatError(
            table.name,
            f"rows come every {step:.3g} in column '{column}', which is unlikely in seconds",
            expected=f"the unit in its name ({column}_ms, {column}_us, {column}_ns, {column}_s), or time_unit in a columns file",
        )


def _wide(table: Table, layout: Layout, time: Array | None, rate: float | None) -> list[Samples]:
    if time is None:
        assert rate is not None
        time = np.arange(len(table.lines)) / rate
    read = _Poses(table, layout.trackers.values())
    return [read.samples(tracker, pose, time) for tracker, pose in layout.trackers.items()]


def _long(table: Table, layout: Layout, time: Array | None, rate: float | None) -> list[Samples]:
    """Rows of each tracker, trackers in the order in which they first appear."""
    assert layout.device is not None
    (pose,) = layout.trackers.values()
    names = table.words([layout.device])[:, 0]
    trackers, first, which = np.unique(names, return_index=True, return_inverse=True)
    roles = None if layout.role is None else table.words([layout.role])[:, 0]
    whole = _Poses(table, [pose]).samples("", pose, np.zeros(len(names)) if time is None else time)
    if len(trackers) > 100:
        raise FormatError(
            table.name,
            f"{len(trackers)} different names in column '{table.columns[layout.device]}'",
            expected="the names of at most 100 trackers",
        )
    found = []
    for index in np.argsort(first):
        rows = np.flatnonzero(which == index)
        tracker = str(trackers[index])
        if not tracker:
            raise FormatError(table.name, "a row names no tracker", place=f"line {table.numbers[rows[0]]}")
        found.append(
            Samples(
                tracker=tracker,
                time=whole.time[rows] if time is not None else np.arange(len(rows)) / (rate or 1.0),
                position=whole.position[rows],
                orientation=whole.orientation[rows],
                valid=whole.valid[rows],
                line=whole.line[rows],
                role=str(roles[rows[0]]) if roles is not None else pose.role,
            )
        )
    return found


class _Poses:
    """Pose columns of all trackers, parsed at once."""

    def __init__(self, table: Table, poses: Iterable[PoseColumns]) -> None:
        self.table = table
        columns = sorted({column for pose in poses for column in (*pose.position, *pose.quaternion)})
        self._values = table.values(columns)
        self._place = {column: place for place, column in enumerate(columns)}

    def samples(self, tracker: str, pose: PoseColumns, time: Array) -> Samples:
        """Rows of one tracker."""
        rows = len(self._values)
        orientation = np.tile([1.0, 0.0, 0.0, 0.0], (rows, 1))
        if pose.quaternion:
            orientation = self._values[:, [self._place[column] for column in pose.quaternion]]
        valid = np.ones(rows, bool)
        for column, opposite in pose.valid:
            valid &= self.table.flags(column, inverted=opposite)
        with np.errstate(over="ignore", invalid="ignore"):
            position = self._values[:, [self._place[column] for column in pose.position]] * np.array(pose.to_m)
        return Samples(tracker, time, position, orientation, valid, self.table.numbers, pose.role)


def _short(text: str) -> str:
    return text if len(text) <= 60 else text[:60] + "…"


FORMAT = Format(
    name="vive",
    description="logs of Vive, SteamVR and other trackers: columns with a header, or described by a columns file",
    suffixes=(".csv", ".txt"),
    recognises=recognises,
    read_trackers=read_trackers,
    describe_trackers=describe,
    pipeable=True,
)
