"""Reads an MCAP stream once, front to back, without seeking: metadata as it comes, messages a chunk at a time.

`mcap.stream_reader.StreamReader` parses every message and every index entry by itself, which costs more than decoding them in bulk, and
reads short at the end of a truncated file without noticing. So the outer loop is here; schemas, channels, chunks and metadata are
still parsed by the mcap package.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, BinaryIO

from retarget.core.errors import FormatError

if TYPE_CHECKING:
    from mcap.records import Channel, Chunk, Schema

MAGIC = b"\x89MCAP0\r\n"
_HEAD = struct.Struct("<BQ")
_MESSAGE_HEAD = struct.Struct("<HIQQ")
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _METADATA, _DATA_END = 0x02, 0x03, 0x04, 0x05, 0x06, 0x0C, 0x0F
_LARGEST_RECORD = 4 << 30
_LARGEST_CHUNK = 1 << 30
_BLOCK = 16 << 20
_UNCHUNKED_BATCH = 4096


@dataclass
class Batch:
    """Messages of one channel, in file order. `message_type`, `encoding` and `schema` are empty where the channel has no schema.

    schema: the definition of the message type, as `schema_encoding` ("ros2msg", "jsonschema", "protobuf" …) has it.
    """

    topic: str
    message_type: str
    encoding: str
    log_times: list[int] = field(default_factory=list)
    payloads: list[memoryview] = field(default_factory=list)
    schema: bytes = b""
    schema_encoding: str = ""


@dataclass(frozen=True)
class Metadata:
    """A metadata record."""

    name: str
    entries: dict[str, str]


def read(stream: BinaryIO, name: str) -> Iterator[Batch | Metadata]:
    """Batches of messages and metadata records of the MCAP document that `stream` starts with; checksums are verified.

    Raises `FormatError` for a document that is broken or ends early. Stops right behind the document's last byte.
    """
    from mcap import records
    from mcap.exceptions import McapError

    channels = _Channels(name)
    loose: dict[int, Batch] = {}
    try:
        for opcode, content in _records(stream, name):
            if opcode == _CHUNK:
                yield from _split(memoryview(_chunk_content(content, name)), channels, {}).values()
            elif opcode == _METADATA:
                metadata = records.Metadata.read(_data_stream(content))
                yield Metadata(metadata.name, metadata.metadata)
            elif opcode == _MESSAGE:
                _collect(memoryview(content), channels, loose)
                if any(len(batch.payloads) >= _UNCHUNKED_BATCH for batch in loose.values()):
                    yield from loose.values()
                    loose = {}
            elif opcode in (_SCHEMA, _CHANNEL):
                channels.declare(opcode, content)
        yield from loose.values()
    except (McapError, struct.error, UnicodeDecodeError, OverflowError, MemoryError) as error:
        raise FormatError(name, f"broken MCAP record: {error or type(error).__name__}") from error


def count_rest(stream: BinaryIO) -> int:
    """How many bytes `stream` still holds; reads them."""
    rest = 0
    while block := stream.read(1 << 20):
        rest += len(block)
    return rest


class _Channels:
    """The schemas and channels declared so far."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}

    def declare(self, opcode: int, content: bytes | memoryview) -> None:
        from mcap.records import Channel, Schema

        if opcode == _SCHEMA:
            schema = Schema.read(_data_stream(content))
            self.schemas[schema.id] = schema
        else:
            channel = Channel.read(_data_stream(content))
            self.channels[channel.id] = channel

    def batch(self, channel_id: int) -> Batch:
        """An empty batch for the channel's messages."""
        channel = self.channels.get(channel_id)
        if channel is None:
            raise FormatError(self.name, f"a message of channel {channel_id}, which is not declared before it")
        schema = self.schemas.get(channel.schema_id)
        if schema is None:
            return Batch(channel.topic, "", "")
        return Batch(
            channel.topic,
            schema.name,
            channel.message_encoding,
            schema=schema.data,
            schema_encoding=schema.encoding,
        )


def _records(stream: BinaryIO, name: str) -> Iterator[tuple[int, bytes]]:
    """(opcode, content) of each record of the data and summary sections; consumes the footer and the closing magic."""
    offset = 0

    def exactly(size: int, what: str) -> bytes:
        nonlocal offset
        # In blocks: a corrupt length must not allocate gigabytes before the end of the file is met.
        blocks = []
        missing = size
        while missing and (block := stream.read(min(missing, _BLOCK))):
            blocks.append(block)
            missing -= len(block)
        if missing:
            raise FormatError(
                name,
                f"the file ends inside {what}: {size - missing} of {size} bytes",
                place=f"byte {offset}",
                expected="a complete MCAP (was the writer interrupted?)",
            )
        offset += size
        return b"".join(blocks) if len(blocks) != 1 else blocks[0]

    if (magic := exactly(len(MAGIC), "the opening magic")) != MAGIC:
        raise FormatError(name, f"starts with {magic!r}", expected=f"MCAP's magic {MAGIC!r}")
    crc: int | None = zlib.crc32(magic)
    while True:
        start = offset
        head = exactly(_HEAD.size, "a record's head")
        opcode, size = _HEAD.unpack(head)
        if size > _LARGEST_RECORD or opcode == 0:
            problem = f"record of opcode {opcode} and {size} bytes"
            raise FormatError(name, problem, place=f"byte {start}", expected="a record of at most 4 GiB")
        content = exactly(size, f"a record of opcode {opcode}")
        if opcode == _DATA_END and crc is not None:
            stated = int.from_bytes(content[:4], "little")
            if stated not in (0, crc):
                raise FormatError(
                    name, f"checksum of the data section is {crc:#010x}", expected=f"{stated:#010x} as stated"
                )
            crc = None
        elif crc is not None:
            crc = zlib.crc32(content, zlib.crc32(head, crc))
        yield opcode, content
        if opcode == _FOOTER:
            if (magic := exactly(len(MAGIC), "the closing magic")) != MAGIC:
                raise FormatError(name, f"ends with {magic!r}", expected=f"MCAP's magic {MAGIC!r}")
            return


def _chunk_content(content: bytes, name: str) -> bytes:
    from mcap.records import Chunk

    chunk = Chunk.read(_data_stream(content))
    if chunk.compression not in ("", "lz4", "zstd"):
        raise FormatError(name, f"chunk compressed with '{chunk.compression}'", expected="lz4, zstd or none")
    if chunk.uncompressed_size > _LARGEST_CHUNK:
        raise FormatError(
            name,
            f"a chunk of {chunk.uncompressed_size >> 20} MB",
            expected=f"at most {_LARGEST_CHUNK >> 20} MB (writers make chunks of 1 to 4 MB)",
        )
    try:
        data = _decompressed(chunk)
    # lz4 raises RuntimeError, zstandard its own ZstdError: both say that the chunk is damaged.
    except Exception as error:
        raise FormatError(name, f"damaged chunk: {error or type(error).__name__}") from error
    if len(data) != chunk.uncompressed_size:
        raise FormatError(name, f"chunk of {len(data)} bytes", expected=f"{chunk.uncompressed_size} as stated")
    if chunk.uncompressed_crc and (crc := zlib.crc32(data)) != chunk.uncompressed_crc:
        problem = f"damaged chunk: crc validation failed, it is {crc:#010x}"
        raise FormatError(name, problem, expected=f"{chunk.uncompressed_crc:#010x} as stated")
    return data


def _decompressed(chunk: Chunk) -> bytes:
    """The chunk's content, of which at most one byte more than stated is ever made: a few bytes may stand for gigabytes."""
    most = chunk.uncompressed_size + 1
    if chunk.compression == "zstd":
        import zstandard

        with zstandard.ZstdDecompressor().stream_reader(io.BytesIO(chunk.data)) as stream:
            return bytes(stream.read(most))
    if chunk.compression == "lz4":
        import lz4.frame  # type: ignore[import-untyped]  # has none

        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=most))
    return chunk.data


def _split(data: memoryview, channels: _Channels, batches: dict[int, Batch]) -> dict[int, Batch]:
    """The messages of a chunk's content by channel id."""
    at, end = 0, len(data)
    while at < end:
        if end - at < _HEAD.size:
            raise FormatError(channels.name, f"{end - at} bytes too many at the end of a chunk")
        opcode, size = _HEAD.unpack_from(data, at)
        at += _HEAD.size
        if size > end - at:
            raise FormatError(channels.name, f"a record of {size} bytes in a chunk that holds {end - at} more")
        if opcode == _MESSAGE:
            _collect(data[at : at + size], channels, batches)
        elif opcode in (_SCHEMA, _CHANNEL):
            channels.declare(opcode, data[at : at + size])
        at += size
    return batches


def _collect(content: memoryview, channels: _Channels, batches: dict[int, Batch]) -> None:
    channel_id, _, log_time, _ = _MESSAGE_HEAD.unpack_from(content)
    batch = batches.get(channel_id)
    if batch is None:
        batch = batches[channel_id] = channels.batch(channel_id)
    batch.log_times.append(log_time)
    batch.payloads.append(content[_MESSAGE_HEAD.size :])


def _data_stream(content: bytes | memoryview) -> Any:
    from mcap.data_stream import ReadDataStream

    return ReadDataStream(io.BytesIO(content))
