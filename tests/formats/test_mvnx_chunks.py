"""Streams as chunks of bytes, plain and gzip."""

from __future__ import annotations

import gzip
import hashlib
import io
import random

import pytest
from retarget.core.errors import FormatError
from retarget.formats._byte_chunks import CHUNK_BYTES, read_chunks

TEXT = random.Random(1).randbytes(3 * CHUNK_BYTES + 17)


class Dribble(io.RawIOBase):
    """A pipe that gives a few bytes at a time."""

    def __init__(self, data: bytes, step: int) -> None:
        self.rest, self.step = io.BytesIO(data), step

    def read(self, size: int = -1) -> bytes:
        return self.rest.read(min(size, self.step))


def content(data: bytes, step: int = 1 << 30) -> bytes:
    digest = hashlib.sha256()
    chunks = list(read_chunks(Dribble(data, step), "clip", digest))  # type: ignore[arg-type]  # a raw stream has all that is used
    assert all(0 < len(chunk) <= CHUNK_BYTES for chunk in chunks)
    assert digest.hexdigest() == hashlib.sha256(data).hexdigest()
    return b"".join(chunks)


@pytest.mark.parametrize("step", [1 << 30, 65536, 4093])
@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (b"", b""),
        (b"\x1f", b"\x1f"),
        (TEXT, TEXT),
        (gzip.compress(TEXT), TEXT),
        (gzip.compress(b""), b""),
        (gzip.compress(bytes(5 * CHUNK_BYTES)), bytes(5 * CHUNK_BYTES)),
        (gzip.compress(TEXT) + gzip.compress(b"more") + bytes(700), TEXT + b"more"),
    ],
    ids=["nothing", "one byte", "plain", "gzip", "gzip of nothing", "very compressible", "two members and padding"],
)
def test_content(data: bytes, expected: bytes, step: int) -> None:
    assert content(data, step) == expected


def test_one_byte_at_a_time() -> None:
    assert content(gzip.compress(b"hello") + gzip.compress(b" world"), 1) == b"hello world"
    assert content(b"<mvnx/>", 1) == b"<mvnx/>"


@pytest.mark.parametrize("step", [1, 1 << 30])
def test_damage(step: int) -> None:
    packed = gzip.compress(b"hello " * 100)
    for end in range(2, len(packed)):
        with pytest.raises(FormatError, match="ends before its end mark"):
            content(packed[:end], step)
    with pytest.raises(FormatError, match=r"^clip: bytes that are not gzip follow the gzip stream$"):
        content(packed + b"\0\0x", step)
    with pytest.raises(FormatError, match="damaged gzip stream"):
        content(packed[:-8] + bytes([packed[-8] ^ 1]) + packed[-7:], step)  # in the checksum
    with pytest.raises(FormatError, match="ends before its end mark"):
        content(packed + packed[:12], step)
