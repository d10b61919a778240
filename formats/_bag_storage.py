"""Messages in the storage of bags, by rosbags' readers of ROS 1 bags and SQLite and our own of MCAP; nothing unpacks without a limit.

A few bytes may stand for gigabytes: chunks of bags, files and messages that zstd packed, views and computed columns of SQLite.
"""

from __future__ import annotations

import bz2
import io
import sqlite3
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import IO, Any, BinaryIO, cast
from urllib.parse import quote

from retarget.core.errors import FormatError, RetargetError
from retarget.formats import _bag_metadata, _mcap_reader
from retarget.formats._mcap_reader import Batch, Metadata

LARGEST_UNPACKED = 256 << 20
"""Of one chunk or message, and of a file beside `_LARGEST_RATIO` times its size. Recorders write chunks of about 1 MB."""
_LARGEST_RATIO = 200
_BATCH = 1024
_BLOCK = 1 << 20
_PROFILES, _LARGEST_PROFILES, _DEEPEST_PROFILE = "offered_qos_profiles", 1 << 20, 10
"""A publisher's profile has 600 characters, and brackets in no brackets."""
_TABLES = ("topics", "messages", "schema", "message_definitions")


@dataclass(frozen=True)
class Unread:
    """A topic of a type that isn't wanted, and how many messages it has."""

    topic: str
    message_type: str
    count: int


Wanted = Callable[[str], bool]


def read_folder(folder: Path, name: str, wanted: Wanted) -> Iterator[Batch | Metadata | Unread]:
    """Batches of a rosbag2 folder, file after file; of SQLite only messages of `wanted` types, of MCAP all and metadata records.

    Raises `FormatError` for content that can't be read.
    """
    bag = _bag_metadata.load(folder, name)
    for path in bag.files:
        shown = f"{name}/{path.name}"
        items: Iterator[Batch | Metadata | Unread]
        with ExitStack() as stack:
            if bag.storage == "mcap":
                stream = stack.enter_context(path.open("rb"))
                unpacked = _unzstd(stream, path, shown) if bag.compression == "file" else stream
                items = _mcap_reader.read(unpacked, shown)
            else:
                if bag.compression == "file":
                    path = stack.enter_context(_unpacked_file(path, shown))
                items = read_sqlite(path, shown, wanted)
            for item in items:
                if isinstance(item, Batch) and bag.compression == "message":
                    item.payloads = [memoryview(_unpacked(payload, shown)) for payload in item.payloads]
                yield item


def read_sqlite(path: Path, name: str, wanted: Wanted) -> Iterator[Batch | Unread]:
    """Batches of a `.db3` of ROS 2; errors as those of `read_folder`."""
    with _one_line(name), ExitStack() as stack:
        from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

        path.open("rb").close()  # SQLite doesn't say why it can't
        # rosbags makes a URI of it.
        quoted = Path(quote(str(path.absolute())))
        _check_tables(path, name)
        reader = Sqlite3Reader(quoted)
        reader.open()
        stack.callback(reader.close)
        yield from _batches(reader, name, wanted, ros1=False)


def read_ros1(path: Path, name: str, wanted: Wanted) -> Iterator[Batch | Unread]:
    """Batches of a ROS 1 bag; errors as those of `read_folder`."""
    with _one_line(name), ExitStack() as stack:
        from rosbags.rosbag1 import reader as rosbag1

        reader = rosbag1.Reader(path)
        reader.open()
        stack.callback(reader.close)
        limited = {rosbag1.decompressors["bz2"]: _unbz2, rosbag1.decompressors["lz4"]: _unlz4}
        for position, chunk in reader.chunks.items():
            reader.chunks[position] = chunk._replace(decompressor=limited.get(chunk.decompressor, chunk.decompressor))
        yield from _batches(reader, name, wanted, ros1=True)


@contextmanager
def _one_line(name: str) -> Iterator[None]:
    """Whatever rosbags raises, as one line."""
    try:
        yield
    except (RetargetError, OSError):
        raise
    # Besides its own errors, rosbags lets through those of SQLite, compression libraries, and of its own parsing.
    except Exception as error:
        text = str(error).strip()
        first = text.splitlines()[0] if text else type(error).__name__
        raise FormatError(name, f"can't be read as a recording: {first}", expected="a complete bag") from error


def _batches(reader: Any, name: str, wanted: Wanted, *, ros1: bool) -> Iterator[Batch | Unread]:
    connections = []
    for connection in reader.connections:
        # SQLite keeps any type in any column.
        if not isinstance(connection.topic, str) or not isinstance(connection.msgtype, str):
            problem = f"topic {connection.topic!r} of type {connection.msgtype!r}"
            raise FormatError(name, problem, expected="names")
        if wanted(connection.msgtype):
            connections.append(connection)
        else:
            yield Unread(connection.topic, connection.msgtype, int(connection.msgcount))
    if not connections:
        return
    batches: dict[int, Batch] = {}
    for connection, log_time, data in reader.messages(connections=connections):
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


def _batch(connection: Any, *, ros1: bool) -> Batch:
    kind = getattr(connection.msgdef.format, "name", "NONE")
    encodings = {"MSG": "ros1msg" if ros1 else "ros2msg", "IDL": "ros2idl"}
    text = connection.msgdef.data if kind in encodings and isinstance(connection.msgdef.data, str) else ""
    return Batch(
        connection.topic,
        connection.msgtype,
        "ros1" if ros1 else "cdr",
        schema=text.encode("utf-8", "replace"),
        schema_encoding=encodings.get(kind, ""),
    )


def _check_tables(path: Path, name: str) -> None:
    """Raise `FormatError` for tables that are computed: a view can run forever, and a column be as large as it likes."""
    with closing(sqlite3.connect(f"file:{quote(str(path.absolute()))}?mode=ro&immutable=1", uri=True)) as database:
        marks = ", ".join("?" * len(_TABLES))
        rows = database.execute(f"SELECT type, name, sql FROM sqlite_master WHERE lower(name) IN ({marks})", _TABLES)
        for kind, table, sql in rows.fetchall():
            hidden = database.execute("SELECT name FROM pragma_table_xinfo(?) WHERE hidden != 0", (table,)).fetchall()
            if kind != "table" or hidden or "VIRTUAL" in str(sql).upper().split("(")[0]:
                raise FormatError(name, f"'{table}' is computed when read", expected="a table with plain columns")
        # Else every message is read once for each.
        count, different = database.execute("SELECT count(*), count(DISTINCT id) FROM topics").fetchone()
        if different < count:
            raise FormatError(name, f"{count} topics with {different} ids", expected="an id for each")
        _check_profiles(database, name)


def _check_profiles(database: sqlite3.Connection, name: str) -> None:
    """Raise `FormatError` for profiles of quality of service that no recorder writes: rosbags parses their YAML, in time that grows with the
    square of its depth."""
    if not database.execute("SELECT 1 FROM pragma_table_info('topics') WHERE name = ?", (_PROFILES,)).fetchone():
        return
    rest = _LARGEST_PROFILES
    for (text,) in database.execute(f"SELECT {_PROFILES} FROM topics"):
        if isinstance(text, str):
            rest -= len(text)
            depth = max(accumulate((c in "[{") - (c in "]}") for c in text), default=0)
            if rest < 0 or depth > _DEEPEST_PROFILE or "- - " in text or "? ? " in text:
                problem = f"{_PROFILES} of {len(text)} characters, {depth} deep"
                raise FormatError(name, problem, expected="profiles as recorders write them")


def _unbz2(data: bytes) -> bytes:
    return _limited(bz2.BZ2Decompressor().decompress(data, LARGEST_UNPACKED + 1))


def _unlz4(data: bytes) -> bytes:
    import lz4.frame  # type: ignore[import-untyped]  # has none

    return _limited(lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=LARGEST_UNPACKED + 1))


def _limited(data: bytes) -> bytes:
    if len(data) > LARGEST_UNPACKED:
        raise ValueError(f"a chunk of more than {LARGEST_UNPACKED >> 20} MB")
    return data


def _unpacked(payload: memoryview, name: str) -> bytes:
    """A message that was packed by itself."""
    import zstandard

    try:
        with zstandard.ZstdDecompressor().stream_reader(io.BytesIO(payload)) as stream:
            data = stream.read(LARGEST_UNPACKED + 1)
    except zstandard.ZstdError as error:
        raise FormatError(name, f"a message that can't be unpacked: {error}", expected="zstd") from error
    if len(data) > LARGEST_UNPACKED:
        raise FormatError(name, f"a message of more than {LARGEST_UNPACKED >> 20} MB")
    return bytes(data)


def _unzstd(stream: BinaryIO, path: Path, name: str) -> BinaryIO:
    """What `stream`, of the file at `path`, unpacks to."""
    import zstandard

    unpacked = zstandard.ZstdDecompressor().stream_reader(stream, read_across_frames=True)
    return cast(BinaryIO, _Unpacked(unpacked, name, LARGEST_UNPACKED + _LARGEST_RATIO * path.stat().st_size))


class _Unpacked:
    """A stream that is unpacked while it is read: its damage is told as the file's, and so is more than `most` bytes."""

    def __init__(self, stream: Any, name: str, most: int) -> None:
        self._stream, self._name, self._most, self._size = stream, name, most, 0

    def read(self, size: int) -> bytes:
        """At most `size` bytes, none at the end."""
        import zstandard

        try:
            data = bytes(self._stream.read(size))
        except zstandard.ZstdError as error:
            raise FormatError(self._name, f"can't be unpacked: {error}", expected="zstd") from error
        self._size += len(data)
        if self._size > self._most:
            raise FormatError(self._name, f"unpacks to more than {self._most >> 20} MB", expected="a recording")
        return data


@contextmanager
def _unpacked_file(path: Path, name: str) -> Iterator[Path]:
    """A copy of a packed file, unpacked, that lives as long."""
    with path.open("rb") as stream, tempfile.NamedTemporaryFile(suffix=".db3") as copy:
        source = _unzstd(stream, path, name)
        while block := source.read(_BLOCK):
            cast(IO[bytes], copy).write(block)
        copy.flush()
        yield Path(copy.name)
