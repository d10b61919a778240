"""Which column of a tracker log is what, from the names in its header.

A name is read from its end: unit, component, quantity, and what is left in front is the tracker. So `waist_x`, `LHR-1234_qw`,
`left_hand.pos.x`, `chest/position/x [mm]`, `HeadRotW`, `pose.orientation.w` are understood. Quaternion order comes from these names only.
A group of columns is a tracker when it has all of x, y, z and of a quaternion's w, x, y, z; anything else is left out.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

LENGTHS_M = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
TIMES_S = {
    "s": 1.0,
    "sec": 1.0,
    "secs": 1.0,
    "seconds": 1.0,
    "ms": 1e-3,
    "msec": 1e-3,
    "us": 1e-6,
    "usec": 1e-6,
    "µs": 1e-6,
    "ns": 1e-9,
    "nsec": 1e-9,
}

ONLY_TRACKER = "tracker"
"""Name of the one tracker of a file whose columns carry none."""


@dataclass(frozen=True)
class PoseColumns:
    """Columns of one tracker, or of each tracker in the long form.

    position: x, y, z, and to_m their factors to metres. quaternion: w, x, y, z, or empty where the file has none.
    valid: (column, whether it says the opposite), all of which have to agree.
    """

    position: tuple[int, int, int]
    to_m: tuple[float, float, float] = (1.0, 1.0, 1.0)
    quaternion: tuple[int, ...] = ()
    valid: tuple[tuple[int, bool], ...] = ()
    role: str = ""


@dataclass(frozen=True)
class Layout:
    """What the columns of a file are.

    trackers: name → columns; in the long form one entry, `ONLY_TRACKER`, and `device` is the column with the names.
    time_s: factor to seconds; None where no unit stands, and seconds are only assumed.
    """

    trackers: Mapping[str, PoseColumns]
    time: int | None = None
    time_s: float | None = None
    device: int | None = None
    role: int | None = None
    unused: tuple[str, ...] = field(default=())

    def columns(self) -> list[int]:
        """Places of all columns that can hold numbers."""
        found = [] if self.time is None else [self.time]
        for pose in self.trackers.values():
            found += [*pose.position, *pose.quaternion, *(column for column, _ in pose.valid)]
        return found


_SEPARATORS = r"[\s_.:/|\-]"
# Where a tracker's name ends: at a separator, or at a capital after a small letter (HeadPosX).
_EDGE = rf"(?:^|{_SEPARATORS}+|(?-i:(?<=[a-z])(?=[A-Z])))"
_POSITION = re.compile(
    rf"(?i)^(?P<tracker>.*?){_EDGE}(?:(?:p|pos|position|loc|location|t|trans|translation){_SEPARATORS}*)?(?P<part>[xyz])$"
)
_QUATERNION = re.compile(
    rf"(?i)^(?P<tracker>.*?){_EDGE}(?:q|quat|quaternion|rot|rotation|ori|orient|orientation|att|attitude)"
    rf"{_SEPARATORS}*(?P<part>[wxyzijk])$"
)
_VALID = re.compile(
    rf"(?i)^(?P<tracker>.*?){_EDGE}(?:is{_SEPARATORS}*|pose{_SEPARATORS}*|b?pose{_SEPARATORS}*is{_SEPARATORS}*)?"
    rf"(?P<part>valid|validity|tracked|tracking|tracking{_SEPARATORS}*(?:ok|result|state|status|valid)|status|lost|occluded|invalid)$"
)
_OPPOSITE = ("lost", "occluded", "invalid")
_UNIT = re.compile(r"(?i)^(?P<rest>.*?)\s*_?[\[(]\s*(?P<unit>[a-zµ]+)\s*[\])]$")
_LENGTH_ENDING = re.compile(rf"(?i)^(?P<rest>.*[xyz]){_SEPARATORS}+(?P<unit>mm|cm|m)$")
_TIME = re.compile(
    rf"(?i)^(?:(?:header|host|device|system|ros|utc|frame|log|sample|rel|relative|elapsed){_SEPARATORS}*)?"
    rf"(?:t|time|timestamp|time{_SEPARATORS}stamp|stamp|ts|date{_SEPARATORS}?time|clock|elapsed|utc)"
    rf"(?:{_SEPARATORS}*utc)?(?:{_SEPARATORS}+(?P<unit>{'|'.join(TIMES_S)}))?$"
)
_TIME_UNIT_ONLY = ("sec", "secs", "seconds")
_DEVICE = [
    "serial",
    "serial_number",
    "device_serial",
    "tracker_serial",
    "sn",
    "device",
    "tracker",
    "device_id",
    "tracker_id",
    "device_name",
    "tracker_name",
    "name",
    "id",
    "body",
    "rigid_body",
    "object",
    "label",
    "frame_id",
    "child_frame_id",
    "role",
    "tracker_role",
    "device_role",
]
_ROLES = ("role", "tracker_role", "device_role")
_EMPTY_ENDINGS = re.compile(rf"(?i){_SEPARATORS}+(?:pose|transform)$|^(?:pose|transform)$")


def recognise(cells: Sequence[str]) -> Layout | None:
    """The layout that names `cells` give, or None when they name no tracker's pose, or one column twice."""
    poses: dict[str, dict[str, int]] = {}
    units: dict[int, str] = {}
    valid: list[tuple[str, int, bool]] = []
    times: list[tuple[int, float | None]] = []
    folded = [cell.strip().lower() for cell in cells]
    if _triad(folded):
        at = [folded.index(letter) for letter in "xyzwijk"]
        poses[""] = dict(zip(["x", "y", "z", "qw", "qx", "qy", "qz"], at, strict=True))
    for index, cell in enumerate(cells):
        name, unit = _without_unit(cell.strip())
        if not name or index in poses.get("", {}).values():
            continue
        if match := _TIME.match(name):
            word = (match["unit"] or unit).lower()
            times.append((index, TIMES_S.get(word)))
        elif name.lower() in _TIME_UNIT_ONLY:
            times.append((index, 1.0))
        elif match := _QUATERNION.match(name):
            part = match["part"].lower()
            part = {"i": "x", "j": "y", "k": "z"}.get(part, part)
            if poses.setdefault(_tracker(match["tracker"]), {}).setdefault(f"q{part}", index) != index:
                return None
        elif match := _POSITION.match(name):
            if poses.setdefault(_tracker(match["tracker"]), {}).setdefault(match["part"].lower(), index) != index:
                return None
            units[index] = unit.lower()
        elif match := _VALID.match(name):
            valid.append((_tracker(match["tracker"]), index, match["part"].lower() in _OPPOSITE))
    whole = {name: pose for name, pose in poses.items() if len(pose) == 7}
    if not whole or any(units.get(pose[part], "") not in ("", *LENGTHS_M) for pose in whole.values() for part in "xyz"):
        return None

    simple = [re.sub(rf"{_SEPARATORS}+", "_", cell) for cell in folded]
    named = sorted((_DEVICE.index(cell), index) for index, cell in enumerate(simple) if cell in _DEVICE)
    device = named[0][1] if named and list(whole) == [""] else None
    role = next((index for index, cell in enumerate(simple) if cell in _ROLES and index != device), None)
    trackers = {}
    for name, pose in whole.items():
        scales = [LENGTHS_M[units.get(pose[part], "") or "m"] for part in "xyz"]
        trackers[name or ONLY_TRACKER] = PoseColumns(
            position=(pose["x"], pose["y"], pose["z"]),
            to_m=(scales[0], scales[1], scales[2]),
            quaternion=tuple(pose[part] for part in ("qw", "qx", "qy", "qz")),
            # A column that names no tracker speaks for all.
            valid=tuple((index, opposite) for owner, index, opposite in valid if owner in ("", name)),
        )
    # A number with its unit first: seconds are then certain.
    time = min(times, key=lambda found: found[1] is None, default=None)
    used = {index for pose in whole.values() for index in pose.values()} | {index for _, index, _ in valid}
    used |= {index for index in (device, role, time[0] if time else None) if index is not None}
    return Layout(
        trackers=trackers,
        time=time[0] if time else None,
        time_s=time[1] if time else None,
        device=device,
        role=role if device is not None else None,
        unused=tuple(cell for index, cell in enumerate(cells) if index not in used and cell),
    )


def _triad(folded: Sequence[str]) -> bool:
    """Whether the bare letters x y z w i j k stand there, each once, and no other spelling of a quaternion."""
    count = Counter(folded)
    return all(count[letter] == 1 for letter in "xyzwijk") and not any(_QUATERNION.match(cell) for cell in folded)


def _without_unit(cell: str) -> tuple[str, str]:
    for pattern in (_UNIT, _LENGTH_ENDING):
        if match := pattern.match(cell):
            return match["rest"].rstrip(" _"), match["unit"]
    return cell, ""


def _tracker(text: str) -> str:
    """A tracker's name as the header spells it, without separators at its ends and a trailing "pose"."""
    text = text.strip(" _.:/|-")
    return _EMPTY_ENDINGS.sub("", text).strip(" _.:/|-")
