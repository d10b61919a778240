"""Writes trajectories to files, folders and streams; what exists is finished."""

from __future__ import annotations

import errno
import io
import os
import stat
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, cast

from retarget.core.errors import UnknownNameError, UsageError, nearest
from retarget.core.types import HumanMotion, JointTrajectory
from retarget.formats import _files, _folders, _registry, _trajectory
from retarget.formats.base import Format


def write_trajectory(
    path: str | Path,
    trajectory: JointTrajectory,
    *,
    format: str | None = None,
    style: str | None = None,
    motion: HumanMotion | None = None,
    overwrite: bool = False,
) -> None:
    """Write `trajectory` to `path`, in the format named or the one of its suffix, in one of that format's styles.

    motion: the person it was made from, frame for frame; formats that can't show a person beside the robot leave it out.
    The file, or folder of a format that is one, appears whole or not at all; a link to a file is followed and stays. On any error, and
    when interrupted, nothing is left behind and what was there is kept.
    Raises `UsageError` when the file exists (unless `overwrite`), its folder is missing or can't be written to, or the path is
    a directory or device; `UnknownNameError` for an unknown format, suffix or style; `RetargetError` when the disk is full.
    """
    target = Path(os.path.realpath(path))
    chosen = _registry.get(format) if format else _of_output(path)
    style = _style(chosen, style)
    _trajectory.check_texts(trajectory)
    if chosen.write_folder is not None:
        with _folders.placed(path, target, chosen, overwrite) as folder:
            chosen.write_folder(folder, trajectory, style, motion)
        return
    _check_target(path, target, overwrite)
    with _files.placed(path, target, lambda: _check_target(path, target, overwrite)) as stream:
        _write(chosen, stream, trajectory, style, motion)


def write_trajectory_stream(
    stream: BinaryIO,
    trajectory: JointTrajectory,
    format: str = "mcap",
    *,
    style: str | None = None,
    motion: HumanMotion | None = None,
) -> None:
    """Write `trajectory` to an open binary stream that need not seek, such as stdout; the stream is flushed, not closed.

    motion: as in `write_trajectory`.
    Raises `UsageError` for a format that can't be piped. `BrokenPipeError` is passed on: only the caller knows what it means.
    """
    chosen = _registry.get(format)
    style = _style(chosen, style)
    if not chosen.pipeable:
        raise UsageError(f"{chosen.name} can't be written to a pipe; write it to a file with -o FILE")
    _trajectory.check_texts(trajectory)
    with _to_stream(stream) as out:
        _write(chosen, out, trajectory, style, motion)


def write_trajectory_parts(stream: BinaryIO, parts: Iterable[JointTrajectory], format: str = "mcap") -> None:
    """Write a trajectory that comes in consecutive parts, at least one, in the format's default style: each part is out before the next is asked for.

    The stream is as in `write_trajectory_stream`, and so are errors. What iterating over `parts` raises is passed on: the document then lacks
    its end, and readers say so.
    """
    chosen = _registry.get(format)
    if chosen.write_parts is None:
        raise UsageError(f"{chosen.name} can't be written in parts; expected a whole trajectory")
    with _to_stream(stream) as out:
        chosen.write_parts(out, _checked(parts))


def _checked(parts: Iterable[JointTrajectory]) -> Iterator[JointTrajectory]:
    for part in parts:
        _trajectory.check_texts(part)
        yield part


@contextmanager
def _to_stream(stream: BinaryIO) -> Iterator[BinaryIO]:
    """A stream that takes all it is given, flushed at the end; what the file system refuses becomes one line."""
    out = cast(BinaryIO, _Whole(stream)) if isinstance(stream, io.RawIOBase) else stream
    try:
        yield out
        out.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        raise _files.refusal("output stream", error) from error


class _Whole:
    """Writes all it is given to a raw stream, which may take only part at a time."""

    def __init__(self, raw: io.RawIOBase) -> None:
        self._raw = raw

    def write(self, data: bytes | bytearray | memoryview) -> int:
        rest = memoryview(data).cast("B")
        size = len(rest)
        while rest:
            taken = self._raw.write(rest)
            if taken is None:
                raise BlockingIOError(errno.EAGAIN, "the stream does not wait for its reader")
            rest = rest[taken:]
        return size

    def flush(self) -> None:
        self._raw.flush()


def _of_output(path: str | Path) -> Format:
    found = _registry.of_suffix(path)
    if found is not None:
        return found
    suffixes = {s for f in _registry.available().values() if f.writable for s in f.suffixes}
    suffix = Path(path).suffix
    if suffix:
        raise UnknownNameError("output suffix", suffix, suffixes, where=str(path))
    raise UsageError(
        f"{path}: no suffix tells the format; expected one of {', '.join(sorted(suffixes))}, or an explicit format"
    )


def _style(chosen: Format, style: str | None) -> str:
    """The style to write, the format's default for None; raises where format or style can't be written."""
    if not chosen.writable:
        writable = sorted(name for name, f in _registry.available().items() if f.writable)
        raise UsageError(f"{chosen.name} can't be written; choose from {', '.join(writable)}")
    style = chosen.styles[0] if style is None else style
    if style not in chosen.styles:
        raise UnknownNameError(f"{chosen.name} style", style, chosen.styles)
    return style


def _write(
    chosen: Format, stream: BinaryIO, trajectory: JointTrajectory, style: str, motion: HumanMotion | None
) -> None:
    if motion is not None and chosen.write_with_motion is not None:
        chosen.write_with_motion(stream, trajectory, style, motion)
    else:
        assert chosen.write_trajectory is not None
        chosen.write_trajectory(stream, trajectory, style)


def _check_target(path: str | Path, target: Path, overwrite: bool) -> None:
    try:
        mode = target.lstat().st_mode
    except FileNotFoundError:
        if not target.parent.exists():
            raise UsageError(f"{path}: there is no folder {target.parent}{_near_folder(target.parent)}") from None
        return
    except (OSError, ValueError) as error:
        raise _files.refusal(path, error) from None
    if stat.S_ISDIR(mode):
        raise UsageError(f"{path}: is a directory; expected a file name")
    if not stat.S_ISREG(mode):
        raise UsageError(f"{path}: is not a regular file; to write to a pipe use -o -")
    if not overwrite:
        raise UsageError(f"{path}: exists already; overwriting must be asked for")


def _near_folder(folder: Path) -> str:
    try:
        near = nearest(folder.name, [entry.name for entry in folder.parent.iterdir() if entry.is_dir()])
    except OSError:
        return ""
    return f"; did you mean {folder.parent / near[0]}?" if near else ""
