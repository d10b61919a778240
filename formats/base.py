"""What one file format is to the house: a name, how to know its files, and a few functions.

Each format lives in one file of this folder and exposes one `FORMAT`. Readers and writers get an open binary stream and a display
name for messages; opening and pipes are dealt with once in `_input.py`, renaming into place in `_output.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, Literal

from retarget.core.errors import UsageError, nearest
from retarget.core.types import HumanMotion, JointTrajectory, TrackerRecording

UpAxis = Literal["y", "z"]
Handedness = Literal["right", "left"]
QuaternionOrder = Literal["wxyz", "xyzw"]
Clock = Literal["header", "log"]


@dataclass(frozen=True)
class TrackerOptions:
    """What a recording of trackers, or of ROS, doesn't say of itself. None = not given: the columns file's own word, then the format's stated default, holds.

    columns: which column is what, a TOML file or its content (`formats/vive.py` documents it); None = the header's names tell.
    up: the file's vertical axis. handedness: of the file's axes; "left" is mirrored before anything else.
    rate_hz: frames a second, of files without a time column.
    roles: tracker, as the file names it → canonical segment, role ("left_elbow", "waist" …), or "none"; goes before the file's own roles.
    Of ROS recordings only: frames: which frame is what, a TOML file or its content (`formats/rosbag.py` documents it). clock: times by the
    messages' own stamps or by the recorder's. msg_defs: `.msg` files, or folders of them, for recordings without definitions.

    Raises `UsageError` for values that are none of these.
    """

    columns: Path | Mapping[str, Any] | None = None
    up: UpAxis | None = None
    rate_hz: float | None = None
    roles: Mapping[str, str] = field(default_factory=dict)
    handedness: Handedness | None = None
    frames: Path | Mapping[str, Any] | None = None
    clock: Clock | None = None
    msg_defs: tuple[Path, ...] = ()

    def __post_init__(self) -> None:
        _check_choice("up", self.up, ("y", "z"))
        _check_choice("handedness", self.handedness, ("right", "left"))
        _check_choice("clock", self.clock, ("header", "log"))
        _check_rate(self.rate_hz)

    @property
    def of_ros(self) -> tuple[str, ...]:
        """Names of the given options that only ROS recordings take."""
        given = {"frames": self.frames is not None, "clock": self.clock is not None, "msg-def": bool(self.msg_defs)}
        return tuple(name for name, is_given in given.items() if is_given)


@dataclass(frozen=True)
class TrajectoryOptions:
    """What a robot trajectory of other tools doesn't say of itself; a file's own word goes before it. None = not given.

    style: one of the format's `read_styles`, for files that can't be told apart by their content.
    rate_hz: frames a second, of files without times and rate.
    joint_names: one for each joint column, of files that name none.
    quaternion_order: of the base, in files that don't name its components; None = what the style or the keys mean by convention.

    Raises `UsageError` for values that are none of these.
    """

    style: str | None = None
    rate_hz: float | None = None
    joint_names: tuple[str, ...] | None = None
    quaternion_order: QuaternionOrder | None = None

    def __post_init__(self) -> None:
        _check_choice("quaternion order", self.quaternion_order, ("wxyz", "xyzw"))
        _check_rate(self.rate_hz)


def _check_choice(name: str, value: str | None, choices: tuple[str, ...]) -> None:
    if value is not None and value not in choices:
        near = nearest(str(value), choices)
        hint = f"; did you mean {near[0]}?" if near else ""
        raise UsageError(f"{name}: found '{value}', expected {' or '.join(choices)}{hint}")


def _check_rate(rate_hz: float | None) -> None:
    if rate_hz is not None and not 0 < rate_hz < 1e6:
        raise UsageError(f"rate {rate_hz:g} Hz; expected a positive number below a million")


MotionReader = Callable[[BinaryIO, str], HumanMotion]
MotionStreamer = Callable[[BinaryIO, str, float], Iterator[HumanMotion]]
TrajectoryReader = Callable[[BinaryIO, str, TrajectoryOptions], JointTrajectory]
TrackerReader = Callable[[BinaryIO, str, TrackerOptions], TrackerRecording]
RecordingStreamer = Callable[[BinaryIO, str, TrackerOptions, float], Iterator[HumanMotion | TrackerRecording | None]]
RecordingReader = Callable[[BinaryIO, str, TrackerOptions], HumanMotion | TrackerRecording | None]
TrackerDescriber = Callable[[BinaryIO, str, TrackerOptions], Mapping[str, Any]]
TrajectoryWriter = Callable[[BinaryIO, JointTrajectory, str], None]
PartsWriter = Callable[[BinaryIO, Iterable[JointTrajectory]], None]
SceneWriter = Callable[[BinaryIO, JointTrajectory, str, HumanMotion], None]
FolderWriter = Callable[[Path, JointTrajectory, str, HumanMotion | None], None]
FolderReader = Callable[[Path, str, TrajectoryOptions], JointTrajectory]
Describer = Callable[[BinaryIO, str], Mapping[str, Any]]


@dataclass(frozen=True)
class Format:
    """One file format.

    suffixes: lower case, longest first where one ends with another (".mvnx.gz" before ".gz"). Formats may share one, if they can
    recognise their own files.
    is_own_output: whether a file that starts with these bytes is a trajectory that was written here, of formats that hold recordings, too.
    magic: byte strings of which a file starts with one, for files whose suffix tells nothing; empty = no magic.
    recognises: whether a file that starts with these bytes is of this format, asked where a suffix is shared; None = can't say.
    read_motion: (binary stream, display name) → type; None = this format doesn't hold that. read_trajectory: the same, with options.
    stream_motion: (binary stream, display name, seconds) → consecutive parts of the motion as the stream arrives, the first so long or all there is;
    joined they are what `read_motion` gives, and the last one's `source` is that of the whole.
    read_trackers: (binary stream, display name, options) → poses of devices that are nobody's segments yet.
    read_recording: the same arguments → a motion or trackers, for formats that hold either; None = the file is a robot's.
    stream_recording: (binary stream, display name, options, seconds) → as `stream_motion` and `read_recording`: one None or trackers, or the
    parts of a motion.
    describe_trackers: as `describe`, for formats with `read_trackers` or `read_recording`.
    write_trajectory: (binary stream, trajectory, style) → nothing.
    write_with_motion: the same, with the person's motion, for formats that can show both.
    write_parts: (binary stream, consecutive parts of a trajectory) → nothing: each part is written before the next is asked for, in the default
    style. The last part's provenance is that of the whole.
    recognises_folder: whether a folder is of this format, of formats that are folders; those have `read_folder` (folder, display name,
    options) and `write_folder` (empty folder, trajectory, style, motion or None) in place of the functions of streams.
    is_own_folder: whether a folder holds what `write_folder` wrote and nothing else: only such a one is ever replaced.
    describe: (binary stream, display name) → facts for `retarget info`, cheaper than a full read; None = from a full read.
    pipeable: whether it can be written to and read from a stream that can't seek.
    styles: names accepted as `style` by `write_trajectory`, the default first.
    read_styles: names accepted as the `style` of `TrajectoryOptions`, the one that needs no naming first.
    """

    name: str
    description: str
    suffixes: tuple[str, ...]
    magic: tuple[bytes, ...] = ()
    recognises: Callable[[bytes], bool] | None = None
    read_motion: MotionReader | None = None
    stream_motion: MotionStreamer | None = None
    read_trajectory: TrajectoryReader | None = None
    read_trackers: TrackerReader | None = None
    read_recording: RecordingReader | None = None
    stream_recording: RecordingStreamer | None = None
    write_trajectory: TrajectoryWriter | None = None
    write_with_motion: SceneWriter | None = None
    write_parts: PartsWriter | None = None
    recognises_folder: Callable[[Path], bool] | None = None
    is_own_folder: Callable[[Path], bool] | None = None
    read_folder: FolderReader | None = None
    write_folder: FolderWriter | None = None
    describe_trackers: TrackerDescriber | None = None
    describe: Describer | None = None
    is_own_output: Callable[[bytes], bool] | None = None
    pipeable: bool = False
    styles: tuple[str, ...] = field(default=("default",))
    read_styles: tuple[str, ...] = field(default=("default",))

    @property
    def writable(self) -> bool:
        """Whether trajectories can be written in it."""
        return self.write_trajectory is not None or self.write_folder is not None
