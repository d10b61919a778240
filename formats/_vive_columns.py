"""The columns file: a TOML that says what each column of a tracker log is, for logs whose header doesn't.

```toml
delimiter = "space"      # comma, semicolon, tab, space or the character; found by itself when not given
skip_lines = 1           # lines before the header, or before the first row where there is none
header = false           # whether a line with the columns' names comes next (default true)
rate_hz = 148.77         # where there is no time column
up = "y"                 # the vertical axis, y or z
handedness = "right"     # or left
time = "stamp"           # a column's name, or its number from 1
time_unit = "ms"         # s, ms, us, ns; ISO 8601 needs none

[trackers.chest]         # one table a tracker; each quaternion component is named, so that their order can't be mistaken
x = 1
y = 2
z = 3
qw = 4
qx = 5
qy = 6
qz = 7
unit = "mm"              # of x, y, z: m, cm, mm (default m)
valid = "chest_ok"       # a column of 0 and 1, true and false …; or a list of them
lost = "chest_occluded"  # the opposite
role = "chest"           # a role or segment, where the name says none
```

In the long form, one row a tracker and time, `device = "serial"` names the column that tells the trackers apart, and one table `[columns]`,
with the same keys, takes the place of `[trackers.…]`. `[roles]` maps trackers to roles or segments. A tracker without qw … qz has its
position read and its orientation set to the identity, with a warning.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from retarget.core.errors import UnknownNameError, UsageError
from retarget.formats._vive_layout import LENGTHS_M, ONLY_TRACKER, TIMES_S, Layout, PoseColumns
from retarget.formats._vive_table import DELIMITERS

EXAMPLE = "'header = false', 'rate_hz = 90', 'up = \"y\"', 'trackers.chest = {x = 1, y = 2, z = 3, qw = 4, qx = 5, qy = 6, qz = 7}'"
"""Lines of a columns file for a log without header, for messages of one line."""
EXAMPLE_NAMED = '\'time = "stamp"\', \'trackers.chest = {x = "px", y = "py", z = "pz", qw = "o4", qx = "o1", qy = "o2", qz = "o3"}\''
"""The same for a log whose header has other names."""

_TOP = [
    "delimiter",
    "skip_lines",
    "header",
    "rate_hz",
    "up",
    "handedness",
    "time",
    "time_unit",
    "device",
    "trackers",
    "columns",
    "roles",
]
_POSE = ["x", "y", "z", "qw", "qx", "qy", "qz", "unit", "valid", "lost", "role"]


@dataclass(frozen=True)
class ColumnsFile:
    """A columns file as written, checked but for the columns themselves, which need the log's header.

    poses: tracker → its table; the long form has one, `ONLY_TRACKER`.
    """

    name: str
    poses: Mapping[str, Mapping[str, Any]]
    delimiter: str | None = None
    skip_lines: int = 0
    header: bool = True
    rate_hz: float | None = None
    up: Any = None
    handedness: Any = None
    time: Any = None
    time_s: float | None = None
    device: Any = None
    roles: Mapping[str, str] = field(default_factory=dict)

    def layout(self, names: Sequence[str], width: int) -> Layout:
        """Columns by their places, of a log with these column names (or none) and so many cells a row. Raises `UsageError`."""
        find = _Finder(self.name, names, width)
        trackers = {tracker: find.pose(tracker, table) for tracker, table in self.poses.items()}
        time = None if self.time is None else find.column("time", self.time)
        device = None if self.device is None else find.column("device", self.device)
        return Layout(trackers=trackers, time=time, time_s=self.time_s, device=device)


def read_columns(source: Path | Mapping[str, Any]) -> ColumnsFile:
    """A columns file, or its content. Raises `UsageError`: unknown keys with the nearest, values of another kind, no tracker."""
    if isinstance(source, Mapping):
        return _checked("columns", source)
    try:
        text = Path(source).read_text(encoding="utf-8-sig")
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise UsageError(f"{source}: columns file can't be read: {reason.lower()}") from None
    try:
        return _checked(str(source), tomllib.loads(text))
    except (ValueError, RecursionError) as error:  # ValueError: TOMLDecodeError, and numbers of thousands of digits
        raise UsageError(f"{source}: no valid TOML: {error}") from None


def _checked(name: str, content: Mapping[str, Any]) -> ColumnsFile:
    _check_keys(name, "key", content, _TOP)
    delimiter = content.get("delimiter")
    if delimiter is not None:
        delimiter = DELIMITERS.get(delimiter, delimiter) if isinstance(delimiter, str) else delimiter
        if not isinstance(delimiter, str) or len(delimiter) != 1 or delimiter in '"\n\r.-+' or delimiter.isalnum():
            raise UsageError(f"{name}: delimiter = {delimiter!r}; expected {', '.join(DELIMITERS)} or one character")
    skip = content.get("skip_lines", 0)
    if not isinstance(skip, int) or isinstance(skip, bool) or skip < 0:
        raise UsageError(f"{name}: skip_lines = {skip!r}; expected a whole number, 0 or more")
    header = content.get("header", True)
    if not isinstance(header, bool):
        raise UsageError(f"{name}: header = {header!r}; expected true or false")
    rate = content.get("rate_hz")
    if rate is not None and (not isinstance(rate, int | float) or isinstance(rate, bool) or not 0 < rate < 1e6):
        raise UsageError(f"{name}: rate_hz = {rate!r}; expected a positive number")
    for key, choices in (("up", ("y", "z")), ("handedness", ("right", "left"))):
        if content.get(key) not in (None, *choices):
            raise UsageError(f"{name}: {key} = {content[key]!r}; expected {' or '.join(choices)}")
    unit = content.get("time_unit")
    if unit is not None and (not isinstance(unit, str) or unit not in TIMES_S):
        raise UsageError(f"{name}: time_unit = {unit!r}; expected s, ms, us or ns")
    roles = content.get("roles", {})
    if not isinstance(roles, Mapping) or not all(isinstance(role, str) for role in roles.values()):
        raise UsageError(f'{name}: [roles]; expected lines such as "LHR-1A2B3C4D" = "left_hand"')
    return ColumnsFile(
        name=name,
        poses=_poses(name, content),
        delimiter=delimiter,
        skip_lines=skip,
        header=header,
        rate_hz=None if rate is None else float(rate),
        up=content.get("up"),
        handedness=content.get("handedness"),
        time=content.get("time"),
        time_s=None if unit is None else TIMES_S[unit],
        device=content.get("device"),
        roles=dict(roles),
    )


def _poses(name: str, content: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    long = "device" in content
    here, other = ("columns", "trackers") if long else ("trackers", "columns")
    if other in content:
        raise UsageError(
            f"{name}: [{other}] {'beside' if long else 'without'} device; expected [columns] with device = …, or [trackers.<name>] without"
        )
    found = {ONLY_TRACKER: content.get("columns")} if long else content.get("trackers")
    named = found.items() if isinstance(found, Mapping) else ()
    tables = {str(tracker): table for tracker, table in named if isinstance(table, Mapping)}
    if not tables or len(tables) < len(named):
        raise UsageError(f"{name}: no table [{here}{'' if long else '.<name>'}]; expected lines such as {EXAMPLE}")
    for tracker, table in tables.items():
        place = "columns" if long else f"trackers.{tracker}"
        _check_keys(name, f"key in [{place}]", table, _POSE)
        if missing := [key for key in "xyz" if key not in table]:
            raise UsageError(f"{name}: [{place}] has no {missing[0]}; expected the columns of x, y and z")
        quaternion = [key for key in ("qw", "qx", "qy", "qz") if key in table]
        if quaternion and len(quaternion) < 4:
            raise UsageError(f"{name}: [{place}] has only {', '.join(quaternion)}; expected qw, qx, qy and qz, or none")
        if table.get("unit", "m") not in tuple(LENGTHS_M):
            raise UsageError(f"{name}: [{place}] unit = {table['unit']!r}; expected m, cm or mm")
        if not isinstance(table.get("role", ""), str):
            raise UsageError(f"{name}: [{place}] role = {table['role']!r}; expected a role or segment in quotes")
    return tables


def _check_keys(name: str, kind: str, table: Mapping[str, Any], known: Iterable[str]) -> None:
    known = list(known)
    for key in table:
        if key not in known:
            raise UnknownNameError(kind, str(key), known, where=name)


@dataclass(frozen=True)
class _Finder:
    """Places of columns in a log with these names and this many cells a row."""

    name: str
    names: Sequence[str]
    width: int

    def column(self, key: str, wanted: Any) -> int:
        """The place, from 0, of a column given by name or number."""
        if isinstance(wanted, int) and not isinstance(wanted, bool):
            if not 1 <= wanted <= self.width:
                raise UsageError(f"{self.name}: {key} = {wanted}; the log has columns 1 to {self.width}")
            return wanted - 1
        if not isinstance(wanted, str):
            raise UsageError(f"{self.name}: {key} = {wanted!r}; expected a column's name or number")
        if not self.names:
            raise UsageError(f"{self.name}: {key} = '{wanted}', but header = false; expected a column's number")
        if self.names.count(wanted) > 1:
            raise UsageError(f"{self.name}: {key} = '{wanted}' stands in the header twice; expected its number")
        if wanted not in self.names:
            raise UnknownNameError("column", wanted, self.names, where=f"{self.name}, {key}")
        return self.names.index(wanted)

    def pose(self, tracker: str, table: Mapping[str, Any]) -> PoseColumns:
        """All columns of one tracker."""

        def place(key: str) -> int:
            return self.column(f"{tracker}.{key}", table[key])

        scale = LENGTHS_M[table.get("unit", "m")]
        valid = [
            (self.column(f"{tracker}.{key}", wanted), key == "lost")
            for key in ("valid", "lost")
            for wanted in (table[key] if isinstance(table.get(key), list) else [table[key]] if key in table else [])
        ]
        return PoseColumns(
            position=(place("x"), place("y"), place("z")),
            to_m=(scale, scale, scale),
            quaternion=tuple(place(key) for key in ("qw", "qx", "qy", "qz")) if "qw" in table else (),
            valid=tuple(valid),
            role=table.get("role", ""),
        )
