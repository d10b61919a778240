"""Messages of ROS recordings, whatever holds them: a ROS 1 bag, a rosbag2 folder, a bare `.db3`, an MCAP file or an MCAP stream.

MCAP is read front to back by `_mcap_reader`, from a file as from a pipe. The others need a path, and are read by the readers that
rosbags' `AnyReader` is made of, see `_bag_storage`; `AnyReader` itself refuses a whole recording for one definition that it can't parse,
of a topic that nobody asked for. Of these, only messages of wanted types are read at all.
"""

from __future__ import annotations

import hashlib
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from retarget.core.errors import FormatError
from retarget.formats import _bag_storage
from retarget.formats._bag_metadata import METADATA
from retarget.formats._bag_storage import Unread
from retarget.formats._mcap_reader import Batch, Metadata

BAG_MAGIC, SQLITE_MAGIC, FOLDER_MAGIC = b"#ROSBAG V", b"SQLite format 3\0", b"rosbag2_bagfile_information:"


def is_folder(path: Path) -> bool:
    """Whether `path` is a rosbag2 recording: a folder whose metadata.yaml says so."""
    try:
        with (path / METADATA).open("rb") as stream:
            return stream.read(len(FOLDER_MAGIC)) == FOLDER_MAGIC
    except (OSError, ValueError):  # ValueError: a NUL in the path
        return False


def short_type(name: str) -> str:
    """`package/Name` of a message type, however its recording writes it."""
    parts = name.replace("::", "/").split("/")
    return f"{parts[0]}/{parts[-1]}" if len(parts) > 1 else name


def folder_of(stream: BinaryIO) -> Path | None:
    """The rosbag2 folder whose metadata.yaml `stream` is; None for anything else."""
    path = getattr(stream, "name", None)
    return Path(path).parent if isinstance(path, str) and is_folder(Path(path).parent) else None


def read(stream: BinaryIO, name: str, wanted: Callable[[str], bool]) -> Iterator[Batch | Metadata | Unread]:
    """Batches of the messages whose type, as `short_type`, is `wanted`, in the order of each file; the other topics as `Unread`.

    stream: of a bag, a `.db3`, or the metadata.yaml of a folder. Raises `FormatError` for content that can't be read.
    """

    def by_type(message_type: str) -> bool:
        return wanted(short_type(message_type))

    with _path_of(stream, name) as path:
        if path.is_dir():
            yield from _bag_storage.read_folder(path, name, by_type)
            return
        with path.open("rb") as content:
            head = content.read(len(SQLITE_MAGIC))
        ros1 = head.startswith(BAG_MAGIC)
        if not ros1 and head != SQLITE_MAGIC:
            problem = f"can't be read as a recording: starts with {head!r}"
            raise FormatError(
                name, problem, expected="a bag of ROS 1 (#ROSBAG V2.0) or a .db3 of ROS 2 (SQLite format 3)"
            )
        yield from (_bag_storage.read_ros1 if ros1 else _bag_storage.read_sqlite)(path, name, by_type)


def digest(stream: BinaryIO, name: str) -> str:
    """sha256 of the recording's bytes; of a folder, those of its storage files in order of their names."""
    total = hashlib.sha256()
    with _path_of(stream, name) as path:
        files = [path]
        if path.is_dir():
            files = sorted(p for p in path.iterdir() if p.is_file() and p.name != METADATA)
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
