"""A binary stream as chunks of bytes: hashed as they come, decompressed where the content is gzip."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Iterator
from itertools import chain
from typing import BinaryIO, Protocol

from retarget.core.errors import FormatError

CHUNK_BYTES = 2 << 20
LARGEST_TEXT_BYTES = 1 << 30
"""Of a text that has to stand in memory as a whole: 6 hours of seven trackers at 90 Hz. A gzip stream of 1 MB can hold that much."""
_GZIP_MAGIC = b"\x1f\x8b"
_GZIP_FORMAT = 16 + zlib.MAX_WBITS


class Digest(Protocol):
    """What `hashlib` returns, as far as it is used here."""

    def update(self, data: bytes, /) -> None:
        """Take in `data`."""


def read_chunks(stream: BinaryIO, name: str, digest: Digest, *, as_it_comes: bool = False) -> Iterator[bytes]:
    """The content of `stream` in chunks of at most `CHUNK_BYTES`, none of them empty; never seeks.

    as_it_comes: don't wait for a pipe to fill a chunk. `digest` takes in the bytes as they stand in the stream. Content that starts with gzip's magic is decompressed, all its
    members. Raises `FormatError` for a gzip stream that is damaged, ends early, or is followed by something else.
    """
    blocks = _hashed(stream, digest, as_it_comes)
    first = b""
    while len(first) < len(_GZIP_MAGIC) and (block := next(blocks, b"")):
        first += block
    if not first:
        return iter(())
    blocks = chain([first], blocks)
    return _gunzip(blocks, name) if first.startswith(_GZIP_MAGIC) else blocks


def read_whole(stream: BinaryIO, name: str, digest: Digest) -> bytes:
    """All of it at once. Raises `FormatError` as `read_chunks`, and for more than `LARGEST_TEXT_BYTES`."""
    chunks: list[bytes] = []
    collect_chunks(stream, name, digest, chunks)
    return b"".join(chunks)


def collect_chunks(stream: BinaryIO, name: str, digest: Digest, chunks: list[bytes]) -> None:
    """Appends the chunks to `chunks`, which hold what came before the fault when this raises `FormatError`, as `read_whole` does."""
    size = 0
    for chunk in read_chunks(stream, name, digest):
        size += len(chunk)
        if size > LARGEST_TEXT_BYTES:
            chunks.clear()
            raise FormatError(
                name, f"a text of more than {LARGEST_TEXT_BYTES >> 20} MB", expected="a recording in several files"
            )
        chunks.append(chunk)


def _hashed(stream: BinaryIO, digest: Digest, as_it_comes: bool) -> Iterator[bytes]:
    read = getattr(stream, "read1", stream.read) if as_it_comes else stream.read
    while block := read(CHUNK_BYTES):
        digest.update(block)
        yield block


def _gunzip(blocks: Iterable[bytes], name: str) -> Iterator[bytes]:
    member = zlib.decompressobj(_GZIP_FORMAT)
    between = False
    for whole_block in blocks:
        block = whole_block
        while block:
            if between:
                block = block.lstrip(b"\0")  # archives pad with zeros
                if not block:
                    break
                if not _GZIP_MAGIC.startswith(block[:2]):
                    raise FormatError(name, "bytes that are not gzip follow the gzip stream")
                member, between = zlib.decompressobj(_GZIP_FORMAT), False
            yield from _inflate(member, block, name)
            between, block = member.eof, member.unused_data
    if not between:
        raise FormatError(name, "the gzip stream ends before its end mark; the file was cut off")


def _inflate(member: zlib._Decompress, block: bytes, name: str) -> Iterator[bytes]:
    """What `block` adds to `member`, in chunks: a small block may stand for a very large text."""
    more = True
    while more:
        try:
            data = member.decompress(block, CHUNK_BYTES)
        except zlib.error as error:
            raise FormatError(name, f"damaged gzip stream ({error})") from None
        if data:
            yield data
        block = member.unconsumed_tail
        more = not member.eof and (bool(block) or len(data) == CHUNK_BYTES)
