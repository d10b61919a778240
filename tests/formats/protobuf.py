"""Protobuf's wire format, as far as Foxglove's messages need it: fields numbered from 1 in order."""

from __future__ import annotations

import struct
from collections.abc import Sequence


def fields(*parts: bytes) -> bytes:
    """Fields of bytes: texts and messages."""
    return b"".join(bytes([8 * i + 2]) + varint(len(part)) + part for i, part in enumerate(parts, 1))


def doubles(values: Sequence[float], *, zeros: bool = False) -> bytes:
    """Fields of doubles; as Protobuf does, zeros are left out unless they are asked for."""
    pairs = enumerate(values, 1)
    return b"".join(bytes([8 * i + 1]) + struct.pack("<d", value) for i, value in pairs if value or zeros)


def stamp(nanoseconds: int) -> bytes:
    """google.protobuf.Timestamp."""
    seconds, rest = divmod(nanoseconds, 10**9)
    return b"\x08" + varint(seconds) + b"\x10" + varint(rest)


def varint(value: int) -> bytes:
    """Seven bits a byte, the lowest first."""
    out = b""
    while value > 0x7F:
        out += bytes([value & 0x7F | 0x80])
        value >>= 7
    return out + bytes([value])
