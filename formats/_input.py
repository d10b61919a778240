"""Opens what is to be read: paths, and streams that may be pipes. Every failure is one line naming the file."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, cast

from retarget.core.errors import FormatError, RetargetError, UsageError, nearest
from retarget.formats import _registry
from retarget.formats._ros_source import is_folder
from retarget.formats.base import Format

Input = str | Path | BinaryIO

_HEAD = 512
"""Bytes looked at to recognise a format."""


@contextmanager
def opened(
    source: Input, name: str | None, format: str | None, reader: str = ""
) -> Iterator[tuple[BinaryIO, str, Format]]:
    """The open stream, its display name and its format. Streams given by the caller are left open.

    Of a rosbag2 folder the stream is that of its metadata.yaml. reader: the `Format` function wanted of it, which chooses between formats that share a suffix and both can't say.
    """
    with contextlib.ExitStack() as stack:
        if isinstance(source, str | Path):
            name = name or str(source)
            where: str | Path = Path(source) / "metadata.yaml" if is_folder(Path(source)) else source
            stream = stack.enter_context(_open(Path(where)))
        else:
            stream, name = source, name or _stream_name(source)
            where = name
        head, stream = _peek(stream, name)
        if not head:
            raise FormatError(name, "empty file")
        _refuse_pickle(name, where, head)
        found = _registry.get(format) if format else _registry.detect(where, head, reader)
        if not found.pipeable and not stream.seekable():
            raise UsageError(f"{name}: {found.name} can't be read from a pipe; save it to a file and name that")
        try:
            yield stream, name, found
        except OSError as error:
            reason = error.strerror.lower() if error.strerror else error
            raise RetargetError(f"{name}: can't be read: {reason}") from error


def _refuse_pickle(name: str, where: str | Path, head: bytes) -> None:
    # Protocols 2 to 5 start with the opcode PROTO and their number; older ones only have the suffix.
    begins = len(head) > 1 and head[0] == 0x80 and 2 <= head[1] <= 5
    if begins or Path(where).suffix.lower() in (".pkl", ".pickle"):
        raise FormatError(
            name,
            "a pickle runs code of its author's when it is read, so it never is",
            expected="the same arrays as .npz (np.savez with fps, root_pos, root_rot, dof_pos) or as .csv",
        )


def _open(path: Path) -> BinaryIO:
    try:
        return path.open("rb")
    except FileNotFoundError:
        raise UsageError(f"{path}: no such file{_neighbours(path)}") from None
    except IsADirectoryError:
        raise UsageError(
            f"{path}: is a directory; expected a file, or a rosbag2 folder with its metadata.yaml"
        ) from None
    # ENAMETOOLONG, ELOOP, permission; ValueError is a NUL in the path
    except (OSError, ValueError) as error:
        reason = error.strerror.lower() if isinstance(error, OSError) and error.strerror else str(error)
        raise UsageError(f"{path}: {reason}") from None


def _neighbours(path: Path) -> str:
    """A hint naming files beside `path` that are called almost like it, or where the path stops existing."""
    if not path.parent.is_dir():
        return f" (there is no folder {path.parent})"
    try:
        near = nearest(path.name, [entry.name for entry in path.parent.iterdir()])
    except OSError:
        return ""
    return f"; did you mean {' or '.join(near)}?" if near else ""


def _peek(stream: BinaryIO, name: str) -> tuple[bytes, BinaryIO]:
    """The first bytes of `stream`, and a stream that still starts with them."""
    try:
        if stream.seekable():
            start = stream.tell()
            head = stream.read(_HEAD)
            stream.seek(start)
            return head, stream
        head = b""
        while len(head) < _HEAD and (block := stream.read(_HEAD - len(head))):
            head += block
    except OSError as error:
        raise RetargetError(f"{name}: can't be read: {(error.strerror or str(error)).lower()}") from error
    return head, cast(BinaryIO, io.BufferedReader(_Rejoined(head, stream)))


class _Rejoined(io.RawIOBase):
    """Bytes already taken from a pipe, then the rest of the pipe."""

    def __init__(self, head: bytes, rest: BinaryIO) -> None:
        self._head, self._rest = memoryview(head), rest

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        block: bytes | memoryview = self._head[: len(buffer)]
        self._head = self._head[len(block) :]
        if not block:
            # What is there, at least a byte: who wants a full buffer asks again.
            block = getattr(self._rest, "read1", self._rest.read)(len(buffer))
        buffer[: len(block)] = block
        return len(block)


def _stream_name(stream: BinaryIO) -> str:
    name = getattr(stream, "name", None)
    return name if isinstance(name, str) else "<stream>"
