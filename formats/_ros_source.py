"""Messages of ROS recordings, whatever holds them: a ROS 1 bag, a rosbag2 folder, a bare `.db3`, an MCAP file or an MCAP stream.

MCAP is read front to back by `_mcap_reader`, from a file as from a pipe. The others need a path, and are read by the readers that
rosbags' `AnyReader` is made of; `AnyReader` itself refuses a whole recording for one definition that it can't parse, of a topic that
nobody asked for. Of these, only messages of wanted types are read at all.
"""

from __future__ import annotations

import hashlib
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from retarget.core.errors import FormatError, RetargetError
from retarget.formats._mcap_reader import Batch

BAG_MAGIC, SQLITE_MAGIC, FOLDER_MAGIC = b"#ROSBAG V", b"SQLite format 3\0", b"rosbag2_bagfile_information:"
_BATCH = 1024
_LARGEST_METADATA = 16 << 20


@dataclass(frozen=True)
class Unread:
    """A topic of a type that isn't wanted, and how many messages it has."""

    topic: str
    message_type: str
    count: int


def is_folder(path: Path) -> bool:
    """Whether `path` is a rosbag2 recording: a folder whose metadata.yaml says so."""
    try:
        with (path / "metadata.yaml").open("rb") as stream:
            return stream.read(len(FOLDER_MAGIC)) == FOLDER_MAGIC
    except (OSError, ValueError):  # ValueError: a NUL in the path
        return False


def short_type(name: str) -> str:
    """`package/Name` of a message type, however its recording writes it."""
    parts = name.replace("::", "/").split("/")
    return f"{parts[0]}/{parts[-1]}" if len(parts) > 1 else name


def read(stream: BinaryIO, name: str, wanted: Callable[[str], bool]) -> Iterator[Batch | Unread]:
    """Batches of the messages whose type, as `short_type`, is `wanted`, in the order of each file; the other topics as `Unread`.

    stream: of a bag, a `.db3`, or the metadata.yaml of a folder. Raises `FormatError` for content that can't be read.
    """
    with _path_of(stream, name) as path, ExitStack() as stack:
        reader, ros1 = _opened(path, name, stack)
        with _one_line(name):
            connections = [c for c in reader.connections if wanted(short_type(c.msgtype))]
            others = [
                Unread(c.topic, short_type(c.msgtype), int(c.msgcount))
                for c in reader.connections
                if c not in connections
            ]
        yield from others
        if not connections:
            return
        batches: dict[int, Batch] = {}
        messages = reader.messages(connections=connections)
        while True:
            with _one_line(name):
                item = next(messages, None)
            if item is None:
                break
            connection, log_time, data = item
            # SQLite keeps any type in any column.
            if not isinstance(data, bytes | memoryview) or not isinstance(log_time, int):
                raise FormatError(name, f"a message of {type(data).__name__} at {log_time!r}", expected="bytes and ns")
            batch = batches.get(connection.id)
            if batch is None:
                batch = batches[connection.id] = _batch(connection, ros1=ros1)
            batch.log_times.append(log_time)
            batch.payloads.append(memoryview(data))
            if len(batch.payloads) >= _BATCH:
                yield batches.pop(connection.id)
        yield from batches.values()


def digest(stream: BinaryIO, name: str) -> str:
    """sha256 of the recording's bytes; of a folder, those of its storage files in order of their names."""
    total = hashlib.sha256()
    with _path_of(stream, name) as path:
        files = [path]
        if path.is_dir():
            files = sorted(p for p in path.iterdir() if p.is_file() and p.name != "metadata.yaml")
        for file in files:
            with file.open("rb") as content:
                while block := content.read(1 << 20):
                    total.update(block)
    return total.hexdigest()


@contextmanager
def _path_of(stream: BinaryIO, name: str) -> Iterator[Path]:
    """The path of the recording that `stream` was opened from; of bytes from elsewhere, that of a copy that lives as long."""
    start = stream.tell()
    head = stream.read(len(FOLDER_MAGIC))
    stream.seek(start)
    own = getattr(stream, "name", None)
    path = Path(own) if isinstance(own, str) else None
    if head == FOLDER_MAGIC:
        if path is None or not path.is_file():
            raise FormatError(
                name, "the metadata of a rosbag2 folder, without the folder", expected="the folder's path"
            )
        if path.stat().st_size > _LARGEST_METADATA:
            raise FormatError(name, f"metadata.yaml of {path.stat().st_size} bytes", expected="at most 16 MiB")
        yield path.parent
    elif path is not None and path.is_file() and start == 0:
        yield path
    else:
        suffix = ".bag" if head.startswith(BAG_MAGIC) else ".db3"
        with tempfile.NamedTemporaryFile(suffix=suffix) as copy:
            shutil.copyfileobj(stream, copy)
            copy.flush()
            yield Path(copy.name)
        stream.seek(start)


def _opened(path: Path, name: str, stack: ExitStack) -> tuple[Any, bool]:
    """The open rosbags reader of `path`, closed by `stack`, and whether it is of ROS 1."""
    with _one_line(name):
        reader: Any
        from rosbags.rosbag1.reader import Reader
        from rosbags.rosbag2.reader import DirectoryReader
        from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

        if path.is_dir():
            ros1, reader = False, DirectoryReader(path)
        else:
            with path.open("rb") as content:
                ros1 = content.read(len(BAG_MAGIC)) == BAG_MAGIC
            reader = Reader(path) if ros1 else Sqlite3Reader(path)
        reader.open()
        stack.callback(reader.close)
    return reader, ros1


@contextmanager
def _one_line(name: str) -> Iterator[None]:
    """Whatever rosbags raises, as one line."""
    try:
        yield
    except (RetargetError, OSError):
        raise
    # Besides its own errors, rosbags lets through those of SQLite, YAML, compression libraries, and of its own parsing.
    except Exception as error:
        text = str(error).strip()
        first = text.splitlines()[0] if text else type(error).__name__
        raise FormatError(name, f"can't be read as a recording: {first}", expected="a complete bag") from error


def _batch(connection: Any, *, ros1: bool) -> Batch:
    kind = getattr(connection.msgdef.format, "name", "NONE")
    encodings = {"MSG": "ros1msg" if ros1 else "ros2msg", "IDL": "ros2idl"}
    text = connection.msgdef.data if kind in encodings else ""
    return Batch(
        connection.topic,
        connection.msgtype,
        "ros1" if ros1 else "cdr",
        schema=text.encode(),
        schema_encoding=encodings.get(kind, ""),
    )
