"""File formats: recordings and trajectories, each format in one file of this folder.

To add one, put `<name>.py` here with a `FORMAT` (see `base.py`), or publish an entry point of group `retarget.formats` that names such
a `Format` or a module holding one. Nothing else needs to be told.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

from retarget.core.errors import FormatError, InvalidDataError, RetargetError, UnknownNameError, UsageError
from retarget.core.types import HumanMotion, JointTrajectory, TrackerRecording
from retarget.formats import _folders
from retarget.formats._describe import motion_facts, trajectory_facts
from retarget.formats._files import new_file
from retarget.formats._input import Input, opened
from retarget.formats._output import write_trajectory, write_trajectory_parts, write_trajectory_stream
from retarget.formats._reader_options import noted
from retarget.formats._registry import available, detect, get, names
from retarget.formats._replay_log import ReplayLog
from retarget.formats._ros_source import is_folder as is_bag_folder
from retarget.formats.base import Format, TrackerOptions, TrajectoryOptions

__all__ = [
    "Format",
    "ReplayLog",
    "TrackerOptions",
    "TrajectoryOptions",
    "available",
    "describe",
    "detect",
    "folder_format",
    "get",
    "is_bag_folder",
    "is_output_folder",
    "names",
    "new_file",
    "read_any",
    "read_motion",
    "read_recording",
    "read_trackers",
    "read_trajectory",
    "stream_recording",
    "write_trajectory",
    "write_trajectory_parts",
    "write_trajectory_stream",
]

Kind = TypeVar("Kind", HumanMotion, TrackerRecording)
_KINDS = {HumanMotion: "recorded motion", TrackerRecording: "poses of trackers"}
"""What a file that holds one of them holds, in words."""


def read_motion(
    source: Input, name: str | None = None, format: str | None = None, options: TrackerOptions | None = None
) -> HumanMotion:
    """The recorded motion in `source`, a path or an open binary stream (a pipe, where the format can be piped).

    name: what messages call it (default: the path). format: its name, when suffix and content don't tell. options: what it doesn't say.
    Raises `UsageError` for a path that can't be opened and a file that holds no motion, `FormatError` for content that can't be read.
    """
    return _read_kind(HumanMotion, source, name, format, options)


def read_trajectory(
    source: Input, name: str | None = None, format: str | None = None, options: TrajectoryOptions | None = None
) -> JointTrajectory:
    """The robot trajectory in `source`; arguments and errors as those of `read_motion`, `options` what files of other tools don't say.

    Pickle is refused. Raises `UnknownNameError` for a style that the format doesn't read.
    """
    options = options or TrajectoryOptions()
    if (folder := _folder(source, format)) is not None:
        return _read_folder(*folder, name, options)
    with opened(source, name, format, "read_trajectory") as (stream, shown, found):
        if found.read_trajectory is None:
            raise UsageError(
                f"{shown}: {found.name} holds {_content(found)}, not a robot trajectory; expected one of {_readers('trajectory')}"
            )
        if options.style is not None and options.style not in found.read_styles:
            raise UnknownNameError(f"{found.name} style", options.style, found.read_styles, where=shown)
        try:
            return found.read_trajectory(stream, shown, options)
        except InvalidDataError as error:
            raise FormatError(shown, str(error)) from error


def read_trackers(
    source: Input, name: str | None = None, format: str | None = None, options: TrackerOptions | None = None
) -> TrackerRecording:
    """The poses of tracked devices in `source`; arguments and errors as those of `read_motion`."""
    return _read_kind(TrackerRecording, source, name, format, options)


def read_recording(
    source: Input, name: str | None = None, format: str | None = None, options: TrackerOptions | None = None
) -> HumanMotion | TrackerRecording:
    """What `source` recorded of a person: a motion of segments, or poses of trackers, as it holds; errors as those of `read_motion`."""
    with opened(source, name, format, "read_trackers") as (stream, shown, found):
        return _read_recording(stream, shown, found, options)


def stream_recording(
    source: Input, first_s: float, name: str | None = None, options: TrackerOptions | None = None
) -> Iterator[HumanMotion | TrackerRecording]:
    """As `read_recording`, in consecutive parts while `source` arrives, the first lasting `first_s` seconds of the recording, or all there is.

    Joined, the parts are the motion, and the last one's `source` is that of the whole; of formats that can't be read in parts, and of
    trackers, there is one. Raises what `read_recording` raises, when it is met.
    """
    with opened(source, name, None, "read_trackers") as (stream, shown, found):
        options = options or TrackerOptions()
        try:
            if found.stream_motion is not None:
                _refuse_ros_options(shown, found, options)
                yield from found.stream_motion(stream, shown, first_s)
            elif found.stream_recording is not None:
                for part in found.stream_recording(stream, shown, options, first_s):
                    yield noted(_persons(part, shown, found), options)
            else:
                yield _read_recording(stream, shown, found, options)
        except InvalidDataError as error:
            raise FormatError(shown, str(error)) from error


def read_any(
    source: Input, name: str | None = None, format: str | None = None, options: TrackerOptions | None = None
) -> HumanMotion | TrackerRecording | JointTrajectory:
    """Whatever `source` holds: a person's recording before a robot's trajectory, where a format may hold either.

    Arguments and errors as those of `read_trackers`. A pipe that may hold either is kept in memory.
    """
    folder = _folder(source, format)
    if folder is not None and not _may_be_a_persons(folder[0], format):
        return _read_folder(*folder, name, TrajectoryOptions())
    with opened(source, name, format, "read_trackers") as (stream, shown, found):
        if found.read_trajectory is not None and not stream.seekable():
            stream = io.BytesIO(stream.read())
        start = stream.tell() if stream.seekable() else 0
        reader = found.read_trackers or (None if found.read_trajectory is not None else found.read_motion)
        recording = _recording(stream, shown, found, options, reader)
        if recording is not None:
            return recording
        if found.read_trajectory is not None:
            stream.seek(start)
            try:
                return found.read_trajectory(stream, shown, TrajectoryOptions())
            except InvalidDataError as error:
                raise FormatError(shown, str(error)) from error
    if folder is not None:
        return _read_folder(*folder, name, TrajectoryOptions())
    raise UsageError(f"{shown}: {found.name} holds {_content(found)}, not a person's motion or a robot's trajectory")


def _read_recording(
    stream: BinaryIO, name: str, found: Format, options: TrackerOptions | None
) -> HumanMotion | TrackerRecording:
    return _persons(_recording(stream, name, found, options, found.read_trackers or found.read_motion), name, found)


def _persons(
    recording: HumanMotion | TrackerRecording | None, name: str, found: Format
) -> HumanMotion | TrackerRecording:
    """`recording`, which must be one: not None, as readers give for a robot's."""
    if recording is not None:
        return recording
    raise UsageError(
        f"{name}: {found.name} holds {_content(found)}, not a person's motion; expected one of {_readers('trackers', 'motion')}"
    )


def _read_kind(
    kind: type[Kind], source: Input, name: str | None, format: str | None, options: TrackerOptions | None
) -> Kind:
    """What `source` recorded of a person, where it is of this kind."""
    readers = "motion" if kind is HumanMotion else "trackers"
    with opened(source, name, format, f"read_{readers}") as (stream, shown, found):
        recording = _recording(stream, shown, found, options, getattr(found, f"read_{readers}"))
        if isinstance(recording, kind):
            return recording
        content = _content(found) if recording is None else _KINDS[type(recording)]
    raise UsageError(f"{shown}: {found.name} holds {content}, not {_KINDS[kind]}; expected one of {_readers(readers)}")


def _recording(
    stream: BinaryIO, name: str, found: Format, options: TrackerOptions | None, reader: Callable[..., Any] | None
) -> HumanMotion | TrackerRecording | None:
    """What the format's `read_recording` gives, where it has that, else its `reader`; None where the file is no person's recording."""
    options = options or TrackerOptions()
    try:
        if found.read_recording is not None:
            recording = found.read_recording(stream, name, options)
            return None if recording is None else noted(recording, options)
        _refuse_ros_options(name, found, options)
        if reader is None:
            return None
        takes_options = reader is not found.read_motion
        arguments: tuple[Any, ...] = (stream, name, options) if takes_options else (stream, name)
        result: HumanMotion | TrackerRecording = reader(*arguments)
        return noted(result, options) if takes_options else result
    except InvalidDataError as error:
        raise FormatError(name, str(error)) from error


def _refuse_ros_options(name: str, found: Format, options: TrackerOptions) -> None:
    if options.of_ros:
        raise UsageError(f"{name}: --{options.of_ros[0]} is for ROS recordings, not for {found.name}")


def describe(
    source: Input, name: str | None = None, format: str | None = None, options: TrackerOptions | None = None
) -> Mapping[str, Any]:
    """JSON-able facts of a file, for `retarget info`; arguments and errors as those of `read_trackers`."""
    folder = _folder(source, format)
    if folder is not None and not _may_be_a_persons(folder[0], format):
        return trajectory_facts(folder[1].name, _read_folder(*folder, name, TrajectoryOptions()))
    # Where formats share a suffix and none knows the file: trajectories were written here and are known, tracker logs come from anywhere.
    with opened(source, name, format, "read_trackers") as (stream, shown, found):
        try:
            if found.read_recording is None and options is not None:
                _refuse_ros_options(shown, found, options)
            if found.describe_trackers is not None:
                return found.describe_trackers(stream, shown, options or TrackerOptions())
            if found.describe is not None:
                return found.describe(stream, shown)
            if found.read_trajectory is not None:
                return trajectory_facts(found.name, found.read_trajectory(stream, shown, TrajectoryOptions()))
            if found.read_motion is not None:
                return motion_facts(found.name, found.read_motion(stream, shown))
        except InvalidDataError as error:
            raise FormatError(shown, str(error)) from error
    raise UsageError(f"{shown}: {found.name} can only be written")


def folder_format(path: str | Path) -> Format | None:
    """The format of trajectories that the folder `path` is of; None where it is of none, or no folder."""
    return _folders.format_of(path)


def is_output_folder(path: str | Path, format_: Format) -> bool:
    """Whether the folder `path` is what `format_`, which is a folder, wrote, and holds nothing else: only then it is ever replaced."""
    return _folders.is_output(Path(path), format_)


def _folder(source: Input, format: str | None) -> tuple[Path, Format] | None:
    """The folder and its format where `source` is the folder of a format that is one, or is said to be by the format named."""
    found = get(format) if format else _folders.format_of(source)
    if found is None or found.read_folder is None:
        return None
    if not isinstance(source, str | Path):
        raise UsageError(f"{found.name} is a folder, which can't be read from a pipe")
    if not _folders.is_folder(source) or (found.recognises_folder and not found.recognises_folder(Path(source))):
        raise UsageError(f"{source}: is no folder of format {found.name}")
    return Path(source), found


def _may_be_a_persons(folder: Path, format: str | None) -> bool:
    """Whether what a folder holds, not named as a trajectory's format, has to be looked at: bags are of persons and of robots."""
    return format is None and is_bag_folder(folder)


def _read_folder(path: Path, found: Format, name: str | None, options: TrajectoryOptions) -> JointTrajectory:
    shown = name or str(path)
    assert found.read_folder is not None
    try:
        return found.read_folder(path, shown, options)
    except InvalidDataError as error:
        raise FormatError(shown, str(error)) from error
    except OSError as error:
        raise RetargetError(f"{shown}: can't be read: {(error.strerror or str(error)).lower()}") from error


def _content(format_: Format) -> str:
    """What files of a format hold, in words."""
    if format_.read_motion is not None:
        return "recorded motion"
    if format_.read_recording is not None and format_.read_trajectory is None:
        return "ROS messages"
    return "poses of trackers" if format_.read_trackers is not None else "robot trajectories"


def _readers(*kinds: str) -> str:
    """Names of the formats that hold something of one of these kinds."""
    recordings, folders = "trajectory" not in kinds, "trajectory" in kinds
    return ", ".join(
        f.name
        for f in available().values()
        if any(getattr(f, f"read_{kind}") is not None for kind in kinds)
        or (recordings and f.read_recording is not None)
        or (folders and f.read_folder is not None)
    )
