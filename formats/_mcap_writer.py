"""Writes the structure of an MCAP file around messages that were encoded in bulk.

`mcap.writer.Writer` takes one message at a time, which costs tens of microseconds each in Python; here a chunk arrives as one array of
bytes together with the positions of its messages. All small records are written by the mcap package's own record classes. The
order of records and what is indexed are those of `mcap.writer.Writer`: https://mcap.dev/spec.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray
from retarget.formats._cdr import Layout
from retarget.formats._mcap_reader import MAGIC

_MESSAGE, _MESSAGE_INDEX = 0x05, 0x07
_RECORD_HEAD = struct.Struct("<BQ")
_FOOTER_HEAD = struct.Struct("<BQQQ")


_FOREVER = "{sec: 9223372036, nsec: 854775807}"
_LATCHED = (
    "- {history: 1, depth: 1, reliability: 1, durability: 1, liveliness: 1, avoid_ros_namespace_conventions: false, "
    f"deadline: {_FOREVER}, lifespan: {_FOREVER}, liveliness_lease_duration: {_FOREVER}}}"
)
"""Keep the last one, reliable, transient local, automatic: the numbers are rmw's (rmw/types.h)."""


@dataclass(frozen=True)
class Topic:
    """A channel to be written: its topic, ROS message type and that type's definition text. Its id is its place, from 1.

    latched: whether it is kept for whoever subscribes later (durability transient local): `ros2 bag play` offers it so.
    """

    topic: str
    message_type: str
    definition: str
    latched: bool = False

    @property
    def qos(self) -> str:
        """The publisher's quality of service as rosbag2 notes it, YAML; "" = the default."""
        return _LATCHED if self.latched else ""


@contextmanager
def message_record(layout: Layout, channel_id: int, slot: str) -> Iterator[None]:
    """Lay out one Message record around the message laid out in the body: slots sequence, log_time, publish_time with prefix `slot`."""
    start = len(layout.template)
    layout.raw(_RECORD_HEAD.pack(_MESSAGE, 0) + struct.pack("<H", channel_id))
    layout.variable(f"{slot}sequence", "<u4", aligned=False)
    layout.variable(f"{slot}log_time", "<u8", aligned=False)
    layout.variable(f"{slot}publish_time", "<u8", aligned=False)
    yield
    content = len(layout.template) - start - _RECORD_HEAD.size
    layout.template[start : start + _RECORD_HEAD.size] = _RECORD_HEAD.pack(_MESSAGE, content)


class McapFile:
    """An MCAP file being written to a stream that need not seek or tell.

    Call `chunk` and `metadata` any number of times, then `finish`. `topics` are declared in the first chunk. Chunks are compressed with zstd, as by
    `mcap.writer.Writer`, at level 1: for 29 joints that leaves 0.4 of the bytes and costs about 1 µs a frame.
    """

    def __init__(self, stream: BinaryIO, topics: Sequence[Topic], metadata: Mapping[str, Mapping[str, str]]) -> None:
        from mcap.records import Channel, Header, Schema
        from mcap.writer import LIBRARY_IDENTIFIER
        from zstandard import ZstdCompressor

        self._compressor = ZstdCompressor(level=1)
        self.topics = tuple(topics)
        self._stream = stream
        self._offset = 0
        self._crc = 0
        types = list(dict.fromkeys((topic.message_type, topic.definition) for topic in topics))
        self._schemas = [
            Schema(id=i, name=name, encoding="ros2msg", data=text.encode()) for i, (name, text) in enumerate(types, 1)
        ]
        ids = {schema.name: schema.id for schema in self._schemas}
        self._channels = [
            Channel(
                id=i,
                topic=topic.topic,
                message_encoding="cdr",
                metadata={"offered_qos_profiles": topic.qos} if topic.latched else {},
                schema_id=ids[topic.message_type],
            )
            for i, topic in enumerate(topics, 1)
        ]
        self._chunk_indexes: list[Any] = []
        self._metadata_indexes: list[Any] = []
        self._counts = {channel.id: 0 for channel in self._channels}
        self._first_time: int | None = None
        self._last_time = 0

        self._write(MAGIC)
        self._records(Header("ros2", LIBRARY_IDENTIFIER))
        for name, entries in metadata.items():
            self.metadata(name, entries)
        self._prefix = _encoded([*self._schemas, *self._channels])

    def metadata(self, name: str, entries: Mapping[str, str]) -> None:
        """Write a metadata record; there may be several of one name."""
        from mcap.records import Metadata, MetadataIndex

        start = self._offset
        self._records(Metadata(name=name, metadata=dict(entries)))
        self._metadata_indexes.append(MetadataIndex(offset=start, length=self._offset - start, name=name))

    def chunk(self, data: memoryview, messages: Mapping[int, NDArray[np.uint64]]) -> None:
        """Write one chunk and its message indexes.

        data: bytes of Message records one after another. messages: for each channel id, (K, 2) log time in ns and the record's offset in `data`.
        """
        from mcap.records import Chunk, ChunkIndex

        prefix, self._prefix = self._prefix, b""
        content = memoryview(prefix + data) if prefix else data
        first = min(int(index[:, 0].min()) for index in messages.values())
        last = max(int(index[:, 0].max()) for index in messages.values())
        compressed = self._compressor.compress(content)
        start = self._offset
        self._records(
            Chunk(
                compression="zstd",
                data=compressed,
                message_start_time=first,
                message_end_time=last,
                uncompressed_crc=zlib.crc32(content),
                uncompressed_size=len(content),
            )
        )
        chunk_end = self._offset
        index_offsets = {}
        for channel_id, index in messages.items():
            index_offsets[channel_id] = self._offset
            entries = (index + np.array([0, len(prefix)], np.uint64)).astype("<u8").tobytes()
            head = struct.pack("<HI", channel_id, len(entries))
            self._write(_RECORD_HEAD.pack(_MESSAGE_INDEX, len(head) + len(entries)) + head + entries)
            self._counts[channel_id] += len(index)
        self._chunk_indexes.append(
            ChunkIndex(
                message_start_time=first,
                message_end_time=last,
                chunk_start_offset=start,
                chunk_length=chunk_end - start,
                message_index_offsets=index_offsets,
                message_index_length=self._offset - chunk_end,
                compression="zstd",
                compressed_size=len(compressed),
                uncompressed_size=len(content),
            )
        )
        self._first_time = first if self._first_time is None else min(first, self._first_time)
        self._last_time = max(last, self._last_time)

    def message_counts(self) -> list[int]:
        """Messages written so far, for each of `topics`."""
        return [self._counts[i] for i in range(1, len(self.topics) + 1)]

    def time_range(self) -> tuple[int, int]:
        """First and last log time so far in ns, 0 twice without messages."""
        return self._first_time or 0, self._last_time

    def finish(self) -> None:
        """Write the summary section, its checksum, the footer and the closing magic."""
        from mcap.opcode import Opcode
        from mcap.records import DataEnd, Footer, Statistics, SummaryOffset

        self._records(DataEnd(self._crc))
        statistics = Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._chunk_indexes),
            message_count=sum(self._counts.values()),
            message_start_time=self._first_time or 0,
            message_end_time=self._last_time,
            metadata_count=len(self._metadata_indexes),
            schema_count=len(self._schemas),
        )
        groups: list[tuple[Opcode, list[Any]]] = [
            (Opcode.SCHEMA, self._schemas),
            (Opcode.CHANNEL, self._channels),
            (Opcode.STATISTICS, [statistics]),
            (Opcode.CHUNK_INDEX, self._chunk_indexes),
            (Opcode.METADATA_INDEX, self._metadata_indexes),
        ]
        summary, start = b"", self._offset
        offsets = []
        for opcode, records in groups:
            group = _encoded(records)
            if group:
                at = start + len(summary)
                offsets.append(SummaryOffset(group_opcode=opcode, group_start=at, group_length=len(group)))
            summary += group
        offset_start = start + len(summary)
        data = summary + _encoded(offsets)
        # The checksum covers the summary and the footer up to itself.
        crc = zlib.crc32(_FOOTER_HEAD.pack(Opcode.FOOTER, 20, start, offset_start), zlib.crc32(data))
        self._write(data)
        self._records(Footer(summary_start=start, summary_offset_start=offset_start, summary_crc=crc))
        self._write(MAGIC)

    def _records(self, *records: Any) -> None:
        self._write(_encoded(records))

    def _write(self, data: bytes) -> None:
        self._crc = zlib.crc32(data, self._crc)
        self._stream.write(data)
        self._offset += len(data)


def _encoded(records: Iterable[Any]) -> bytes:
    """Bytes of records of the mcap package, each written by its own class."""
    from mcap.data_stream import RecordBuilder

    builder: Any = RecordBuilder()  # partly untyped in the package
    for record in records:
        record.write(builder)
    return bytes(builder.end())
