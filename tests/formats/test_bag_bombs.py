"""Bags that are small and unpack to gigabytes, or keep a database busy for ever: refused with a line, before they are."""

from __future__ import annotations

import bz2
import sqlite3
import struct
import tracemalloc
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Literal

import lz4.frame
import numpy as np
import pytest
import zstandard
from retarget import formats
from retarget.core.errors import FormatError
from retarget.core.types import TrackerRecording
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

from tests.formats.ros_recordings import Ros, Sent, stamps, storage, write_bag, write_folder

TF = "tf2_msgs/msg/TFMessage"
POSE = np.array([0.1, 0.2, 1.0]), np.array([1.0, 0.0, 0.0, 0.0])


def _sent(ros: Ros, frames: int = 20) -> list[Sent]:
    at = stamps(np.arange(frames) / 90.0)
    return [
        Sent("/tf", TF, s, ros.tf(ros.transform(s, "world", "waist", POSE[0] * i, POSE[1]))) for i, s in enumerate(at)
    ]


def _read(path: Path) -> TrackerRecording:
    found = formats.read_recording(path)
    assert isinstance(found, TrackerRecording)
    return found


@pytest.fixture
def database(tmp_path: Path) -> Path:
    ros = Ros(2)
    return storage(write_folder(tmp_path / "bag", ros, _sent(ros)))


def _change(path: Path, *statements: str) -> Path:
    with closing(sqlite3.connect(path, isolation_level=None)) as connection:
        for statement in statements:
            connection.execute(statement)
    return path


ENDLESS = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n)"


@pytest.mark.parametrize("bare", [True, False])
@pytest.mark.parametrize(
    ("statements", "problem"),
    [
        (
            (
                "ALTER TABLE message_definitions RENAME TO d",
                f"CREATE VIEW message_definitions AS {ENDLESS} SELECT d.* FROM n, d",
            ),
            "'message_definitions' is computed when read; expected a table with plain columns",
        ),
        (
            ("ALTER TABLE messages RENAME TO m", f"CREATE VIEW messages AS {ENDLESS} SELECT m.* FROM n, m"),
            "'messages' is computed when read",
        ),
        (
            ("DROP TABLE messages", "CREATE TABLE messages(id, topic_id, timestamp, data AS (zeroblob(1000000000)))"),
            "'messages' is computed when read",
        ),
        (
            (
                "ALTER TABLE topics RENAME TO t",
                "CREATE TABLE topics AS WITH n(i) AS (VALUES (1), (2), (3)) SELECT t.* FROM n, t",
            ),
            "3 topics with 1 ids; expected an id for each",
        ),
        (("DROP TABLE messages",), "can't be read as a recording"),
        (("DROP TABLE topics",), "can't be read as a recording: no such table: topics"),
        (("UPDATE topics SET name = x'00'",), r"topic b'\\x00' of type 'tf2_msgs/msg/TFMessage'; expected names"),
        (("UPDATE messages SET data = 'text'",), r"a message of str at \d+; expected bytes and ns"),
        (("UPDATE messages SET timestamp = 'now'",), "can't be read as a recording"),
    ],
)
def test_tables_that_are_computed_or_hold_other_things(
    database: Path, bare: bool, statements: tuple[str, ...], problem: str
) -> None:
    path = _change(database, *statements) if bare else _change(database, *statements).parent
    with pytest.raises(FormatError, match=problem) as caught:
        _read(path)
    assert "\n" not in str(caught.value)


def test_a_definition_that_is_no_text_is_none(database: Path) -> None:
    _change(
        database,
        "ALTER TABLE message_definitions RENAME TO d",
        "CREATE TABLE message_definitions AS SELECT * FROM d",
        "UPDATE message_definitions SET encoded_message_definition = NULL",
    )
    assert _read(database).trackers == ("waist",)


@pytest.mark.parametrize("text", ["[" * 300, "- " * 300, "{a: " * 300, "? " * 300, "- {history: 3}\n" * 80_000])
def test_profiles_that_take_long_to_parse(database: Path, text: str) -> None:
    """300 brackets take the parser 2 s."""
    _change(database, f"UPDATE topics SET offered_qos_profiles = '{text}'")
    with pytest.raises(FormatError, match=r"^[^\n]*offered_qos_profiles of \d+ characters[^\n]*expected profiles"):
        _read(database)


def test_profiles_of_many_publishers(database: Path) -> None:
    time = "{sec: 9223372036, nsec: 854775807}"
    one = (
        "- history: 3\n  depth: 0\n  reliability: 1\n  durability: 2\n  liveliness: 1\n  avoid_ros_namespace_conventions: false\n"
        + "".join(f"  {key}: {time}\n" for key in ("deadline", "lifespan", "liveliness_lease_duration"))
    )
    before = _read(database)
    _change(database, f"UPDATE topics SET offered_qos_profiles = '{one * 60}'")
    assert _read(database).frames == before.frames


def test_a_path_that_reads_like_an_address(database: Path) -> None:
    """rosbags opens databases by URI, in which these characters mean something."""
    for name in ("walk#1.db3", "walk 100%.db3", "walk?vfs=none.db3", "walk%23.db3"):
        path = database.with_name(name)
        path.write_bytes(database.read_bytes())
        assert _read(path).trackers == ("waist",)


@pytest.mark.parametrize("plugin", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
@pytest.mark.parametrize("mode", [CompressionMode.FILE, CompressionMode.MESSAGE])
def test_packed_bags_are_read(tmp_path: Path, plugin: StoragePlugin, mode: CompressionMode) -> None:
    expected = _read(write_folder(tmp_path / "plain", Ros(2), _sent(Ros(2))))
    found = _read(_packed(tmp_path / "packed", plugin, mode))
    assert found.trackers == expected.trackers
    np.testing.assert_array_equal(found.position, expected.position)
    np.testing.assert_array_equal(found.time, expected.time)


def _packed(path: Path, plugin: StoragePlugin, mode: CompressionMode) -> Path:
    ros = Ros(2)
    version: Literal[9] = 9
    writer = Writer(path, version=version, storage_plugin=plugin)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection("/tf", TF, typestore=ros.store)
        for sent in _sent(ros):
            writer.write(connection, sent.log_time, ros.store.serialize_cdr(sent.message, TF))
    return path


def test_files_and_messages_that_unpack_to_gigabytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("retarget.formats._bag_storage.LARGEST_UNPACKED", 1 << 20)
    zeros = zstandard.compress(bytes(64 << 20))
    folder = _packed(tmp_path / "file", StoragePlugin.SQLITE3, CompressionMode.FILE)
    (file,) = folder.glob("*.zstd")
    file.write_bytes(zeros)
    with pytest.raises(FormatError, match=r"file/file.db3.zstd: unpacks to more than \d+ MB; expected a recording"):
        _read(folder)
    folder = _packed(tmp_path / "message", StoragePlugin.SQLITE3, CompressionMode.MESSAGE)
    with closing(sqlite3.connect(storage(folder), isolation_level=None)) as connection:
        connection.execute("UPDATE messages SET data = ?", (zeros,))
    tracemalloc.start()
    with pytest.raises(FormatError, match=r"message/message.db3: a message of more than 1 MB"):
        _read(folder)
    assert tracemalloc.get_traced_memory()[1] < 8 << 20
    tracemalloc.stop()


def test_a_record_that_unpacks_to_gigabytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("retarget.formats._bag_storage.LARGEST_UNPACKED", 1 << 20)
    monkeypatch.setattr("retarget.formats._mcap_reader._BLOCK", 1 << 20)
    folder = _packed(tmp_path / "bag", StoragePlugin.MCAP, CompressionMode.FILE)
    (file,) = folder.glob("*.zstd")
    attachment = struct.pack("<BQ", 0x09, 64 << 20) + bytes(64 << 20)
    file.write_bytes(zstandard.compress(b"\x89MCAP0\r\n" + attachment))
    tracemalloc.start()
    with pytest.raises(FormatError, match=r"mcap\.zstd: unpacks to more than \d+ MB; expected a recording"):
        _read(folder)
    assert tracemalloc.get_traced_memory()[1] < 8 << 20
    tracemalloc.stop()


@pytest.mark.parametrize("plugin", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
def test_packed_bags_that_are_damaged(tmp_path: Path, plugin: StoragePlugin) -> None:
    folder = _packed(tmp_path / "file", plugin, CompressionMode.FILE)
    (file,) = folder.glob("*.zstd")
    data = file.read_bytes()
    for damaged, problem in ((b"\0" * 99, "can't be unpacked"), (data[:-40], "the file ends inside|as a recording")):
        file.write_bytes(damaged)
        with pytest.raises(FormatError, match=problem) as caught:
            _read(folder)
        assert str(caught.value).startswith(f"{folder}/{file.name}")


@pytest.mark.parametrize(
    ("compression", "pack"), [("bz2", bz2.compress), ("lz4", lambda data: bytes(lz4.frame.compress(data)))]
)
def test_a_chunk_of_a_bag_that_is_a_bomb(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, compression: str, pack: Callable[[bytes], bytes]
) -> None:
    monkeypatch.setattr("retarget.formats._bag_storage.LARGEST_UNPACKED", 1 << 20)
    path = tmp_path / "a.bag"
    path.write_bytes(_with_chunk(write_bag(path, Ros(1), _sent(Ros(1))).read_bytes(), compression, pack, 64 << 20))
    tracemalloc.start()
    with pytest.raises(FormatError, match="a chunk of more than 1 MB; expected a complete bag"):
        _read(path)
    assert tracemalloc.get_traced_memory()[1] < 8 << 20
    tracemalloc.stop()
    # The same bag with a chunk that is none.
    plain = write_bag(tmp_path / "b.bag", Ros(1), _sent(Ros(1))).read_bytes()
    path.write_bytes(_with_chunk(plain, compression, pack, 0))
    np.testing.assert_array_equal(_read(path).position, _read(tmp_path / "b.bag").position)


def _with_chunk(data: bytes, compression: str, pack: Callable[[bytes], bytes], zeros: int) -> bytes:
    """A bag of one chunk with that packed, so many zeros behind it; what follows is moved, which the header and the index say."""
    start = data.index(b"op=\x05") - 8  # header length, field length
    (size,) = struct.unpack_from("<I", data, start)
    (length,) = struct.unpack_from("<I", data, start + 4 + size)
    begin = start + 8 + size
    content = pack(data[begin : begin + length] + bytes(zeros))
    old, new = (
        struct.pack("<I", len(b"compression=" + kind)) + b"compression=" + kind
        for kind in (b"none", compression.encode())
    )
    header = data[start + 4 : start + 4 + size].replace(old, new)
    chunk = struct.pack("<I", len(header)) + header + struct.pack("<I", len(content)) + content
    rest = data[begin + length :]
    at = data.index(b"index_pos=") + len(b"index_pos=")
    (index,) = struct.unpack_from("<Q", data, at)
    index += len(chunk) - (begin + length - start)
    return data[:at] + struct.pack("<Q", index) + data[at + 8 : start] + chunk + rest


def test_metadata_that_grows_when_merged(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "bag", Ros(2), _sent(Ros(2)))
    lines = ["a0: &a0 {k: v, l: w}"]
    for i in range(30):
        lines.append(f"a{i + 1}: &a{i + 1} {{<<: [{', '.join([f'*a{i}'] * 10)}]}}")
    text = (folder / "metadata.yaml").read_text() + "\n".join(lines)
    (folder / "metadata.yaml").write_text(text)
    with pytest.raises(FormatError, match=r"metadata.yaml: not YAML: found a merge key"):
        _read(folder)
