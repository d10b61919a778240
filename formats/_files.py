"""Files that appear whole or not at all, whatever stops the writer: an error, Ctrl-C, a kill, a full disk."""

from __future__ import annotations

import contextlib
import errno
import os
import secrets
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, cast

from retarget.core.errors import RetargetError, UsageError

_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_NAMELESS_UNKNOWN = (errno.EOPNOTSUPP, errno.EISDIR, errno.EINVAL, errno.ENOENT)
"""What a file system without nameless files says, or a kernel, or a machine without /proc, where they get their name."""


def part_name() -> str:
    """Name of something unfinished: short and its own, as one derived from the target's could be too long for the file system."""
    return f".retarget-{secrets.token_hex(6)}.part"


@contextmanager
def new_file(path: str | Path) -> Iterator[BinaryIO]:
    """A stream to a new file that takes the place of `path` when the body ends well; else nothing of it is left and `path` is as it was.

    A link is followed. Raises `UsageError` and `RetargetError`, naming `path`, for what the file system refuses, such as a full disk.
    """
    with placed(path, Path(os.path.realpath(path))) as stream:
        yield stream


@contextmanager
def placed(path: str | Path, target: Path, check: Callable[[], None] = lambda: None) -> Iterator[BinaryIO]:
    """A stream to a new file that becomes `target` when the body ends well and `check` passes, and is removed otherwise.

    Where the system has nameless files the new one gets its name when it is complete: a killed process leaves nothing behind, either.
    Raises `RetargetError`, naming `path`, for what the file system refuses.
    """
    part = target.parent / part_name()
    try:
        stream, named = _new_file(part)
    except OSError as error:
        raise refusal(path, error) from None
    try:
        try:
            with stream:
                yield stream
                stream.flush()
                # Without this a full disk or a lost network share may show only after the rename.
                os.fsync(stream.fileno())
                # Raises here if another process made the file meanwhile, before anything of it is lost.
                check()
                if not named:
                    _name(stream, part)
            part.replace(target)
        except OSError as error:
            raise refusal(path, error) from error
    except BaseException:
        with contextlib.suppress(OSError):
            part.unlink()
        raise


def _new_file(part: Path) -> tuple[BinaryIO, bool]:
    """A new file, and whether it has the name `part` already."""
    if hasattr(os, "O_TMPFILE") and Path("/proc/self/fd").is_dir():
        try:
            descriptor = os.open(part.parent, os.O_TMPFILE | os.O_RDWR | os.O_CLOEXEC, 0o666)
            return cast(BinaryIO, os.fdopen(descriptor, "w+b")), False
        except OSError as error:
            if error.errno not in _NAMELESS_UNKNOWN:
                raise
    return cast(BinaryIO, part.open("x+b")), True


def _name(stream: BinaryIO, part: Path) -> None:
    """Give the nameless file behind `stream` the name `part`, as open(2) says under O_TMPFILE."""
    folder = os.open(part.parent, os.O_RDONLY | os.O_CLOEXEC)
    try:
        # Only with a folder's descriptor Python calls linkat(2), which follows the link that /proc holds.
        os.link(f"/proc/self/fd/{stream.fileno()}", part.name, dst_dir_fd=folder, follow_symlinks=True)
    finally:
        os.close(folder)


def refusal(path: object, error: OSError | ValueError) -> RetargetError:
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
