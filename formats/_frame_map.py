"""Which frame of a ROS recording is which segment or tracker: the user's map, or what the drivers' own names say.

```toml
root = "world"                   # poses are in this frame (default: the root of the tree that the frames hang in)
prefix = "skeleton_1_"           # of the driver's frames, where several people are in one recording
[segments]                       # a suit: canonical segment = frame
Pelvis = "hips"
[rotations]                      # wxyz, world ← frame when the person stands in T-pose facing +X; default the identity
Pelvis = [0.5, 0.5, 0.5, 0.5]
[trackers]                       # or trackers: name = frame; a name that is a role or a segment assigns it
waist = "tracker_LHR_1DB92FB1"
[poses]                          # geometry_msgs/PoseArray: topic = names of its poses in order
"/mocap" = ["hips", "chest"]
```

Known without a map:

| driver | frames |
|---|---|
| xsens_mvn_ros, xsens_mvn_ros2 | `<model>_<segment>` in snake case (`skeleton_right_upper_arm`), `link_states` |
| canonical names | `Pelvis`, `RightUpperArm` …, with any prefix |
| vive_ros | `tracker_<serial>`, `controller_<serial>`, `hmd` |
| libsurvive_ros2 | `<serial>` in `libsurvive_frame` or `libsurvive_world` |
| vive_tracker_ros2 | `<serial or alias>` in `vive_world`, topics `<alias>_pose`, `<alias>_odom` |
| poses called by a role | `left_elbow`, `waist` … |

Base stations (`LHB…`, `lighthouse…`) are on nobody.
"""

from __future__ import annotations

import difflib
import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from retarget.core.errors import UnknownNameError, UsageError
from retarget.core.segments import SEGMENTS
from retarget.formats._tracker_roles import segment_of

FEWEST_SEGMENTS = 5
"""So many segments under one prefix are a suit; fewer may be trackers named by where they sit."""
_ALIKE = 0.75
_TOP = ("root", "prefix", "segments", "rotations", "trackers", "poses")
_WORLDS = ("libsurvive_frame", "libsurvive_world", "libsurvive", "vive_world", "world_vive")
_DEVICE = re.compile(r"(?i)^(?:(?:tracker|controller)[_-]\w|hmd(?:[_-]|$)|LHR[_-])")
_STATION = re.compile(r"(?i)^(?:LHB[_-]|lighthouse|(?:tracking_)?reference|base_?station)")


def _snake(segment: str) -> str:
    """`right_upper_arm` of RightUpperArm, as the Xsens drivers spell it: `forearm` is one word to them."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", segment).lower().replace("fore_arm", "forearm")


SUIT_NAMES: Mapping[str, str] = {
    spelling: segment
    for segment in SEGMENTS
    for spelling in (_snake(segment), _snake(segment).replace("forearm", "fore_arm"), segment.lower())
}
"""Frame name in lower case, without prefix → segment."""


@dataclass(frozen=True)
class FrameMap:
    """A map as the user wrote it, or an empty one. Frames are without leading slash; rotations wxyz, unit."""

    name: str = ""
    root: str | None = None
    prefix: str | None = None
    segments: Mapping[str, str] = field(default_factory=dict)
    rotations: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    trackers: Mapping[str, str] = field(default_factory=dict)
    poses: Mapping[str, tuple[str, ...]] = field(default_factory=dict)


def load(source: Path | Mapping[str, Any] | None) -> FrameMap:
    """The map in a TOML file, or in its content. Raises `UsageError` and `UnknownNameError`, naming place, found, expected, nearest."""
    if source is None:
        return FrameMap()
    if isinstance(source, Mapping):
        return _checked("frames", source)
    try:
        return _checked(str(source), tomllib.loads(source.read_text(encoding="utf-8-sig")))
    except OSError as error:
        raise UsageError(f"--frames {source}: {(error.strerror or str(error)).lower()}") from None
    # ValueError: TOMLDecodeError, text that is none, and numbers of thousands of digits.
    except (ValueError, RecursionError) as error:
        raise UsageError(f"--frames {source}: not TOML: {error}") from None


def _checked(name: str, table: Mapping[str, Any]) -> FrameMap:
    for key in table:
        if key not in _TOP:
            raise UnknownNameError("key", key, _TOP, where=name)
    segments, trackers = _texts(name, table, "segments"), _texts(name, table, "trackers")
    if segments and trackers:
        raise UsageError(f"{name}: found [segments] and [trackers]; expected one of them")
    _known_segments(name, "segments", segments)
    rotations = _table(name, table, "rotations")
    _known_segments(name, "rotations", rotations)
    for segment in rotations:
        if segments and segment not in segments:
            raise UnknownNameError("segment", segment, segments, where=f"{name}, [rotations]")
    poses = {}
    for topic, names in _table(name, table, "poses").items():
        if not isinstance(names, list) or not names or not all(isinstance(one, str) and one for one in names):
            raise UsageError(f"{name}, [poses] {topic}: found {names!r}, expected a list of names")
        poses["/" + topic.lstrip("/")] = tuple(one.lstrip("/") for one in names)
    return FrameMap(
        name=name,
        root=_text(name, table, "root"),
        prefix=_text(name, table, "prefix"),
        segments=segments,
        rotations={segment: _rotation(name, segment, value) for segment, value in rotations.items()},
        trackers=trackers,
        poses=poses,
    )


def _table(name: str, table: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    value = table.get(key, {})
    if not isinstance(value, Mapping):
        raise UsageError(f"{name}: [{key}] is {value!r}, expected a table")
    return value


def _text(name: str, table: Mapping[str, Any], key: str) -> str | None:
    value = table.get(key)
    if value is not None and not (isinstance(value, str) and value):
        raise UsageError(f"{name}: {key} is {value!r}, expected text")
    return value.lstrip("/") if isinstance(value, str) else None


def _texts(name: str, table: Mapping[str, Any], key: str) -> dict[str, str]:
    found: dict[str, str] = {}
    for item, value in _table(name, table, key).items():
        if not isinstance(value, str) or not value.strip("/"):
            raise UsageError(f"{name}, [{key}] {item}: found {value!r}, expected a frame's name")
        frame = value.lstrip("/")
        if frame in found.values():
            other = next(one for one, taken in found.items() if taken == frame)
            raise UsageError(f"{name}, [{key}]: frame '{frame}' is given to {other} and to {item}; choose one")
        found[item] = frame
    return found


def _known_segments(name: str, key: str, names: Iterable[str]) -> None:
    for segment in names:
        if segment not in SEGMENTS:
            raise UnknownNameError("segment", segment, SEGMENTS, where=f"{name}, [{key}]")


def _rotation(name: str, segment: str, value: Any) -> tuple[float, ...]:
    numbers = value if isinstance(value, list) else []
    plain = len(numbers) == 4 and all(isinstance(one, int | float) and not isinstance(one, bool) for one in numbers)
    # Beyond this a float can't hold a TOML integer.
    if not plain or not all(abs(one) <= 2 for one in numbers) or abs(np.linalg.norm(numbers) - 1) > 1e-3:
        raise UsageError(f"{name}, [rotations] {segment}: found {value!r}, expected a unit quaternion [w, x, y, z]")
    return tuple(float(one) / float(np.linalg.norm(numbers)) for one in numbers)


def suit_segments(frames: Iterable[str], prefix: str | None) -> tuple[dict[str, str], list[str]]:
    """Segment → frame of the person whose frames are most, and the prefixes of all people found.

    prefix: of the wanted person's frames, None = the only or the most complete one.
    """
    people: dict[str, dict[str, str]] = {}
    for frame in frames:
        lower = frame.lower()
        for spelling, segment in SUIT_NAMES.items():
            before = frame[: len(frame) - len(spelling)]
            if lower.endswith(spelling) and (not before or before[-1] in "_/-.:"):
                people.setdefault(before, {}).setdefault(segment, frame)
    # "left_" before "hand" is no person: whoever lacks a pelvis and is part of longer names falls away.
    people = {name: found for name, found in people.items() if len(found) >= FEWEST_SEGMENTS}
    if prefix is not None:
        return people.get(prefix, {}), sorted(people)
    best = max(people, key=lambda name: (len(people[name]), -len(name)), default="")
    return people.get(best, {}), sorted(people)


def tracker_frames(parents: Mapping[str, str], roles: Iterable[str]) -> dict[str, str]:
    """Tracker → frame of those frames (child → parent) that are tracked devices by name, by their world, or because `roles` names them."""
    found = {}
    named = {role.lstrip("/") for role in roles}
    for frame, parent in parents.items():
        last = frame.rpartition("/")[2]
        if _STATION.match(last):
            continue
        if frame in named or _DEVICE.match(last) or parent.rpartition("/")[2] in _WORLDS or segment_of(last):
            found[frame] = frame
    return found


def unmapped(frames: Sequence[str]) -> str:
    """What is found where nothing maps, and which lines of a map come nearest."""
    shown = ", ".join(frames[:8]) + (f" and {len(frames) - 8} more" if len(frames) > 8 else "")
    lines = suggestion(frames)
    return f"no frame is a known segment or tracker: found {shown}" + (
        f"; nearest: {', '.join(lines[:3])}" if lines else ""
    )


def suggestion(frames: Iterable[str]) -> list[str]:
    """Lines `Segment = "frame"` of a map, for frames whose names are near to a segment's or a role's."""
    taken: dict[str, str] = {}
    for frame in frames:
        last = frame.rpartition("/")[2].lower()
        ending = (segment for spelling, segment in SUIT_NAMES.items() if re.search(rf"(?:^|[_.:-]){spelling}$", last))
        segment = segment_of(last) or next(ending, None)
        if segment is None:
            near = difflib.get_close_matches(last, SUIT_NAMES, 1, _ALIKE)
            segment = SUIT_NAMES[near[0]] if near else None
        if segment is not None:
            taken.setdefault(segment, frame)
    return [f'{segment} = "{taken[segment]}"' for segment in SEGMENTS if segment in taken]
