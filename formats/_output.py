"""Writes outputs beside their final place and renames them: a file that exists is finished."""

from __future__ import annotations

import contextlib
import errno
import io
import os
import secrets
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, cast

from retarget.core.errors import RetargetError, UnknownNameError, UsageError, nearest
from retarget.core.types import JointTrajectory
from retarget.formats import _registry, _trajectory
from retarget.formats.base import Format, TrajectoryWriter

_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def write_trajectory(
    path: str | Path,
    trajectory: JointTrajectory,
    *,
    format: str | None = None,
    style: str | None = None,
    overwrite: bool = False,
) -> None:
    """Write `trajectory` to the file `path`, in the format named or the one of its suffix, in one of that format's styles.

    The file appears whole or not at all; a link is followed and stays. On any error, and when interrupted, nothing is left
    behind and a file that was there is kept.
    Raises `UsageError` when the file exists (unless `overwrite`), its folder is missing or can't be written to, or the path is
    a directory or device; `UnknownNameError` for an unknown format, suffix or style; `RetargetError` when the disk is full.
    """
    target = Path(os.path.realpath(path))
    chosen = _registry.get(format) if format else _of_output(path)
    writer, style = _writer(chosen, style)
    _trajectory.check_texts(trajectory)
    _check_target(path, target, overwrite)
    with _placed(path, target) as stream:
        writer(stream, trajectory, style)
        # Raises here if another process made the file meanwhile, before anything of it is lost.
        _check_target(path, target, overwrite)


def write_trajectory_stream(
    stream: BinaryIO, trajectory: JointTrajectory, format: str = "mcap", *, style: str | None = None
) -> None:
    """Write `trajectory` to an open binary stream that need not seek, such as stdout; the stream is flushed, not closed.

    Raises `UsageError` for a format that can't be piped. `BrokenPipeError` is passed on: only the caller knows what it means.
    """
    chosen = _registry.get(format)
    writer, style = _writer(chosen, style)
    if not chosen.pipeable:
        raise UsageError(f"{chosen.name} can't be written to a pipe; write it to a file with -o FILE")
    _trajectory.check_texts(trajectory)
    out = cast(BinaryIO, _Whole(stream)) if isinstance(stream, io.RawIOBase) else stream
    try:
        writer(out, trajectory, style)
        out.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        raise _refusal("output stream", error) from error


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
    suffixes = {s for f in _registry.available().values() if f.write_trajectory for s in f.suffixes}
    suffix = Path(path).suffix
    if suffix:
        raise UnknownNameError("output suffix", suffix, suffixes, where=str(path))
    raise UsageError(
        f"{path}: no suffix tells the format; expected one of {', '.join(sorted(suffixes))}, or an explicit format"
    )


def _writer(chosen: Format, style: str | None) -> tuple[TrajectoryWriter, str]:
    if chosen.write_trajectory is None:
        writable = sorted(name for name, f in _registry.available().items() if f.write_trajectory)
        raise UsageError(f"{chosen.name} can't be written; choose from {', '.join(writable)}")
    style = chosen.styles[0] if style is None else style
    if style not in chosen.styles:
        raise UnknownNameError(f"{chosen.name} style", style, chosen.styles)
    return chosen.write_trajectory, style


def _check_target(path: str | Path, target: Path, overwrite: bool) -> None:
    try:
        mode = target.lstat().st_mode
    except FileNotFoundError:
        if not target.parent.exists():
            raise UsageError(f"{path}: there is no folder {target.parent}{_near_folder(target.parent)}") from None
        return
    except (OSError, ValueError) as error:
        raise _refusal(path, error) from None
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


@contextmanager
def _placed(path: str | Path, target: Path) -> Iterator[BinaryIO]:
    """A stream to a new file beside `target`, renamed to it when the body ends well and removed otherwise."""
    # A short name of its own: one derived from the target's could be too long for the file system.
    part = target.parent / f".retarget-{secrets.token_hex(6)}.part"
    try:
        stream = part.open("x+b")
    except OSError as error:
        raise _refusal(path, error) from None
    try:
        try:
            with stream:
                yield cast(BinaryIO, stream)
                stream.flush()
                # Without this a full disk or a lost network share may show only after the rename.
                os.fsync(stream.fileno())
            part.replace(target)
        except OSError as error:
            raise _refusal(path, error) from error
    except BaseException:
        with contextlib.suppress(OSError):
            part.unlink()
        raise


def _refusal(path: object, error: OSError | ValueError) -> RetargetError:
    """One line for what the file system said: a usage error where another path or permission would help."""
    if not isinstance(error, OSError):
        return UsageError(f"{path}: {error}")
    reason = (error.strerror or str(error)).lower()
    if error.errno in _FULL:
        return RetargetError(f"{path}: can't be written: {reason}")
    if error.errno in (
        errno.EACCES,
        errno.EPERM,
        errno.EROFS,
        errno.ENAMETOOLONG,
        errno.ENOTDIR,
        errno.ENOENT,
        errno.ELOOP,
    ):
        return UsageError(f"{path}: can't be written: {reason}")
    return RetargetError(f"{path}: can't be written: {reason}")
