"""The types that pass between the rooms: frozen, read-only, checked once when made.

SI units; world X forward, Y left, Z up, right-handed; quaternions unit, **wxyz**, continuous in sign along time.
Arrays are float64 and C-contiguous, and can't be written to. T frames, S segments, n joints. What is given is copied, unless
nobody can write to it any more: hand over a large array with `flags.writeable = False` (on what it views, too) and it is shared.
Types that hold arrays compare by identity.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from retarget.core.calibration import Calibration
from retarget.core.errors import InvalidDataError as InvalidDataError  # what making these types raises
from retarget.core.errors import nearest
from retarget.core.field_checks import (
    FieldSetter,
    check_segment_names,
    check_time,
    check_tracked_or_not,
    check_unit,
    check_unit_quaternions,
    frozen_array,
)

Array = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

TaskKind = Literal["orientation", "position", "axis"]


@dataclass(frozen=True)
class Source:
    """Where a motion came from. Holds no person's name and no path.

    `rate_hz` is the recording's own rate; `sha256` that of the input bytes, as read (compressed if it was); `options` what the reader was told
    beside, JSON-able, files by their hash.
    """

    format: str
    version: str = ""
    rate_hz: float = 0.0
    configuration: str = ""
    sha256: str = ""
    warnings: tuple[str, ...] = ()
    interpolated_frames: int = 0
    """Frames of which some value was missing or not finite and was interpolated."""
    options: Mapping[str, Any] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        FieldSetter(self).value("options", MappingProxyType(dict(self.options)))


class _Recorded:
    """What recordings of either kind tell of their time."""

    time: Array
    source: Source

    @property
    def frames(self) -> int:
        """Number of frames, T."""
        return len(self.time)

    @property
    def rate_hz(self) -> float:
        """Mean frame rate; the recording's own where there is a single frame."""
        return _rate(self.time) or self.source.rate_hz


@dataclass(frozen=True, eq=False)
class HumanMotion(_Recorded):
    """A person's motion: orientations and positions of canonical segments over time.

    Segment frames are the identity when the person stands in T-pose facing +X (the house's invariant).

    time: (T,) s, strictly increasing.
    segments: S canonical names.
    orientation: (T, S, 4) world ← segment, unit wxyz, continuous in sign.
    position: (T, S, 3) m, world, each segment's proximal joint; NaN throughout a segment = not tracked.
    angular_velocity: (T, S, 3) rad/s in the world frame, or None.
    foot_contacts: (T, 4) bool, columns `core.segments.FOOT_CONTACTS`, or None.
    measured: (S,) bool; segments that were not measured must not be retargeted.
    joint_offsets: segment → (3,) m, its proximal joint in the parent segment's frame, or empty when unknown.
    calibration: the person's shoulders, arm lengths and calibration poses, where they are known; mappings of hand positions need them.
    """

    time: Array
    segments: tuple[str, ...]
    orientation: Array
    position: Array
    angular_velocity: Array | None = None
    foot_contacts: BoolArray | None = None
    measured: BoolArray = field(default_factory=lambda: np.zeros(0, bool))
    joint_offsets: Mapping[str, Array] = field(default_factory=dict)
    source: Source = field(default_factory=lambda: Source("memory"))
    calibration: Calibration | None = None

    def __post_init__(self) -> None:
        set_ = FieldSetter(self)
        names = tuple(self.segments)
        count = len(names)
        set_.value("segments", names)
        check_segment_names("HumanMotion.segments", names)
        if len(set(names)) != count or not count:
            raise InvalidDataError(f"HumanMotion.segments: found {names}, expected at least one name, each once")
        time = set_.array("time", ("T",))
        set_.array("orientation", (len(time), count, 4))
        set_.array("position", (len(time), count, 3), finite=False)
        set_.array("angular_velocity", (len(time), count, 3), optional=True)
        if self.foot_contacts is not None:
            set_.array("foot_contacts", (len(time), 4), dtype=np.bool_)
        measured = self.measured if len(self.measured) else np.ones(count, bool)
        set_.value("measured", measured)
        set_.array("measured", (count,), dtype=np.bool_)
        check_segment_names("HumanMotion.joint_offsets", self.joint_offsets)
        offsets = {
            name: frozen_array(f"HumanMotion.joint_offsets[{name}]", offset, (3,))
            for name, offset in self.joint_offsets.items()
        }
        set_.value("joint_offsets", MappingProxyType(offsets))
        check_time("HumanMotion.time", time)
        check_unit_quaternions("HumanMotion.orientation", self.orientation)
        for index, name in enumerate(names):
            check_tracked_or_not("HumanMotion.position", name, self.position[:, index])

    @property
    def unmeasured_segments(self) -> tuple[str, ...]:
        """Names of the segments whose values were not measured."""
        return tuple(name for name, measured in zip(self.segments, self.measured, strict=True) if not measured)

    def index(self, segment: str) -> int:
        """Column of `segment`; raises `InvalidDataError` when the motion lacks it."""
        if segment not in self.segments:
            near = nearest(segment, self.segments)
            hint = f"did you mean {' or '.join(near)}?" if near else f"it has {', '.join(self.segments)}"
            raise InvalidDataError(f"the motion has no segment '{segment}'; {hint}")
        return self.segments.index(segment)

    def has(self, segment: str) -> bool:
        """Whether `segment` is present and measured."""
        return segment in self.segments and bool(self.measured[self.segments.index(segment)])


@dataclass(frozen=True, eq=False)
class TrackerRecording(_Recorded):
    """Poses of devices strapped to a person, as a tracking system logged them: not yet anyone's segments.

    time: (T,) s, strictly increasing. trackers: D names, serials or roles, each once.
    orientation: (T, D, 4) world ← tracker, unit wxyz, continuous in sign. position: (T, D, 3) m, world.
    tracked: (T, D) bool; False where a value was not measured but interpolated or held, and is not to be relied on.
    segments: tracker → canonical segment, as far as the file's own role names or a table tell.
    """

    time: Array
    trackers: tuple[str, ...]
    orientation: Array
    position: Array
    tracked: BoolArray
    segments: Mapping[str, str] = field(default_factory=dict)
    source: Source = field(default_factory=lambda: Source("memory"))

    def __post_init__(self) -> None:
        set_ = FieldSetter(self)
        names = tuple(self.trackers)
        set_.value("trackers", names)
        if len(set(names)) != len(names) or not names:
            raise InvalidDataError(f"TrackerRecording.trackers: found {names}, expected at least one name, each once")
        time = set_.array("time", ("T",))
        set_.array("orientation", (len(time), len(names), 4))
        set_.array("position", (len(time), len(names), 3))
        set_.array("tracked", (len(time), len(names)), dtype=np.bool_)
        check_time("TrackerRecording.time", time)
        check_unit_quaternions("TrackerRecording.orientation", self.orientation)
        check_segment_names("TrackerRecording.segments", self.segments.values())
        if unknown := sorted(set(self.segments) - set(names)):
            raise InvalidDataError(
                f"TrackerRecording.segments: found tracker '{unknown[0]}', expected one of {', '.join(names)}"
            )
        if len(set(self.segments.values())) != len(self.segments):
            raise InvalidDataError(
                f"TrackerRecording.segments: found {dict(self.segments)}, expected each segment once"
            )
        set_.value("segments", MappingProxyType(dict(self.segments)))

    def index(self, tracker: str) -> int:
        """Column of `tracker`; raises `InvalidDataError` when the recording lacks it."""
        if tracker not in self.trackers:
            raise InvalidDataError(f"the recording has no tracker '{tracker}'; it has {', '.join(self.trackers)}")
        return self.trackers.index(tracker)


@dataclass(frozen=True, eq=False)
class Task:
    """One desired quantity of one robot frame over time.

    kind "orientation": value (T, 4) world ← frame, unit wxyz; feed_forward (T, 3) rad/s, world.
    kind "position": value (T, 3) m, world, of the point `offset` (3,) m given in the frame; feed_forward (T, 3) m/s.
    kind "axis": value (T, 3) unit, world, for the frame's own direction `axis` (3,); feed_forward (T, 3) rad/s, world.
    weight: (T,) ≥ 0, or a scalar for all frames.
    gain: 1/s at which solvers that command velocities let the error decay; 0 = the solver's own choice.
    twist_weight: factor ≤ 1 on an orientation error's part about the frame's own direction `axis`: 1 = all three axes alike,
    0 = only where `axis` points matters.
    level: priority, 0 first; used by hierarchical solvers only.
    segment: the human segment it follows, "" for none.
    """

    frame: str
    kind: TaskKind
    value: Array
    feed_forward: Array | None = None
    weight: Array = field(default_factory=lambda: np.ones(1))
    twist_weight: float = 1.0
    level: int = 0
    segment: str = ""
    offset: Array = field(default_factory=lambda: np.zeros(3))
    axis: Array = field(default_factory=lambda: np.array([1.0, 0.0, 0.0]))
    gain: float = 0.0

    def __post_init__(self) -> None:
        set_ = FieldSetter(self)
        if self.kind not in ("orientation", "position", "axis"):
            raise InvalidDataError(f"Task.kind: found '{self.kind}', expected orientation, position or axis")
        frames = len(set_.array("value", ("T", 4 if self.kind == "orientation" else 3)))
        set_.array("feed_forward", (frames, 3), optional=True)
        if np.shape(self.weight) in ((), (1,)):
            set_.value("weight", np.broadcast_to(np.asarray(self.weight), (frames,)))
        set_.array("weight", (frames,))
        set_.array("offset", (3,))
        set_.array("axis", (3,))
        if (self.weight < 0).any():
            at = int(np.argmin(self.weight))
            raise InvalidDataError(f"Task.weight of {self.frame}: found {self.weight[at]:g} at ({at},), expected ≥ 0")
        if not 0 <= self.twist_weight <= 1:
            raise InvalidDataError(f"Task.twist_weight of {self.frame}: found {self.twist_weight:g}, expected 0 to 1")
        if self.level < 0:
            raise InvalidDataError(f"Task.level of {self.frame}: found {self.level}, expected 0 (first) or more")
        if not 0 <= self.gain < np.inf:
            raise InvalidDataError(f"Task.gain of {self.frame}: found {self.gain:g}, expected 0 or more, finite")
        check_unit(f"Task.axis of {self.frame}", self.axis, "a unit vector")
        if self.kind == "orientation":
            check_unit_quaternions(f"Task.value of {self.frame}", self.value)
        elif self.kind == "axis":
            check_unit(f"Task.value of {self.frame}", self.value, "unit vectors")


@dataclass(frozen=True, eq=False)
class Targets:
    """What the robot's frames should do: the seam between mappings and solvers.

    time: (T,) s. tasks: every task has T rows. mapping: the name of the mapping that made them.
    """

    time: Array
    tasks: tuple[Task, ...]
    mapping: str = ""

    def __post_init__(self) -> None:
        set_ = FieldSetter(self)
        set_.value("tasks", tuple(self.tasks))
        time = set_.array("time", ("T",))
        check_time("Targets.time", time)
        for task in self.tasks:
            if len(task.value) != len(time):
                raise InvalidDataError(
                    f"Targets.tasks: task of {task.frame} has {len(task.value)} frames, expected {len(time)}"
                )


FRAME_OK, FRAME_MARKED = 0, 1


@dataclass(frozen=True, eq=False)
class JointTrajectory:
    """A robot's motion.

    time: (T,) s, strictly increasing. joint_names: n names, the robot's own order.
    position: (T, n) rad (m for sliding joints). velocity: (T, n) rad/s.
    base_position: (T, 3) m and base_orientation: (T, 4) wxyz, world ← base link, or both None for a fixed base at the origin.
    base_linear_velocity, base_angular_velocity: (T, 3) m/s, rad/s, world frame, of the base link's origin; None = unknown.
    status: (T,) int8, 0 = solved, 1 = marked (the solver failed there and the frame holds its last good value).
    base_frame: the base link's name. robot: the profile's name. provenance: JSON-able facts of how it was made.
    robot_description: URDF text with the limits that were held, or "".
    """

    time: Array
    joint_names: tuple[str, ...]
    position: Array
    velocity: Array
    base_position: Array | None = None
    base_orientation: Array | None = None
    base_linear_velocity: Array | None = None
    base_angular_velocity: Array | None = None
    status: NDArray[np.int8] = field(default_factory=lambda: np.zeros(0, np.int8))
    base_frame: str = "base_link"
    robot: str = ""
    provenance: Mapping[str, Any] = field(default_factory=dict)
    robot_description: str = ""

    def __post_init__(self) -> None:
        set_ = FieldSetter(self)
        set_.value("joint_names", tuple(self.joint_names))
        count = len(self.joint_names)
        if len(set(self.joint_names)) != count:
            twice = next(name for name in self.joint_names if self.joint_names.count(name) > 1)
            raise InvalidDataError(f"JointTrajectory.joint_names: found '{twice}' twice, expected each name once")
        frames = len(set_.array("time", ("T",)))
        set_.array("position", (frames, count))
        set_.array("velocity", (frames, count))
        set_.array("base_position", (frames, 3), optional=True)
        set_.array("base_orientation", (frames, 4), optional=True)
        set_.array("base_linear_velocity", (frames, 3), optional=True)
        set_.array("base_angular_velocity", (frames, 3), optional=True)
        set_.value("status", self.status if len(self.status) else np.zeros(frames, np.int8))
        set_.array("status", (frames,), dtype=np.int8)
        if not np.isin(self.status, (FRAME_OK, FRAME_MARKED)).all():
            found = next(int(value) for value in self.status if value not in (FRAME_OK, FRAME_MARKED))
            raise InvalidDataError(
                f"JointTrajectory.status: found {found}, expected {FRAME_OK} (solved) or {FRAME_MARKED} (marked)"
            )
        if (self.base_position is None) != (self.base_orientation is None):
            given, lacking = "base_position", "base_orientation"
            if self.base_position is None:
                given, lacking = lacking, given
            raise InvalidDataError(f"JointTrajectory.{lacking}: found None beside a {given}, expected both or neither")
        if self.base_orientation is not None:
            check_unit_quaternions("JointTrajectory.base_orientation", self.base_orientation)
        check_time("JointTrajectory.time", self.time)
        set_.value("provenance", MappingProxyType(dict(self.provenance)))

    @property
    def frames(self) -> int:
        """Number of frames, T."""
        return len(self.time)

    @property
    def rate_hz(self) -> float:
        """Mean frame rate, 0 for a single frame."""
        return _rate(self.time)


def _rate(time: Array) -> float:
    return float((len(time) - 1) / (time[-1] - time[0])) if len(time) > 1 else 0.0
