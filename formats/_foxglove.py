"""Poses out of Foxglove's own messages as JSON and as Protobuf: `FrameTransform`, `FrameTransforms`, `PoseInFrame`.

Of Protobuf only the wire format is needed, as these messages are fixed by Foxglove's published schemas: no library, no schema compiler.
A number that Protobuf leaves out is 0. JSON has to hold every number: one that is missing is an error, not a 0.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator, Sequence
from typing import Any

from retarget.formats._ros_wire import Numbers, Pose

TYPES = ("FrameTransform", "FrameTransforms", "PoseInFrame")
_XYZ, _XYZW = ("x", "y", "z"), ("x", "y", "z", "w")
_VARINT, _DOUBLE, _BYTES, _FLOAT = 0, 1, 2, 5


def from_json(data: bytes | memoryview, kind: str) -> Iterator[Pose]:
    """The poses of one message of `TYPES`. Raises `ValueError` or `KeyError` for what is no such message."""
    message = json.loads(bytes(data))
    for item in message["transforms"] if kind == "FrameTransforms" else [message]:
        time = item["timestamp"]
        stamp = int(time["sec"]) * 1_000_000_000 + int(time["nsec"])
        if kind == "PoseInFrame":
            pose = item["pose"]
            values = _named(pose["position"], _XYZ) + _named(pose["orientation"], _XYZW)
            yield Pose(str(item["frame_id"]), "", stamp, values)
        else:
            values = _named(item["translation"], _XYZ) + _named(item["rotation"], _XYZW)
            yield Pose(str(item["parent_frame_id"]), str(item["child_frame_id"]), stamp, values)


def from_protobuf(data: bytes | memoryview, kind: str) -> Iterator[Pose]:
    """The poses of one message of `TYPES`. Raises `ValueError` or `struct.error` for what is no such message."""
    if kind == "FrameTransforms":
        for field, value in _fields(data):
            if field == 1:
                yield from from_protobuf(_bytes(value), "FrameTransform")
        return
    fields = dict(_fields(data))
    time = dict(_fields(_bytes(fields.get(1, b""))))
    stamp = _whole(time.get(1, 0)) * 1_000_000_000 + _whole(time.get(2, 0))
    parent = bytes(_bytes(fields.get(2, b""))).decode()
    if kind == "PoseInFrame":
        pose = dict(_fields(_bytes(fields.get(3, b""))))
        yield Pose(parent, "", stamp, _numbers(pose.get(1, b""), 3) + _numbers(pose.get(2, b""), 4))
    else:
        child = bytes(_bytes(fields.get(3, b""))).decode()
        yield Pose(parent, child, stamp, _numbers(fields.get(4, b""), 3) + _numbers(fields.get(5, b""), 4))


def _named(values: Any, names: Sequence[str]) -> Numbers:
    return tuple(float(values[name]) for name in names)


def _fields(data: bytes | memoryview) -> Iterator[tuple[int, int | float | memoryview]]:
    """Field number and value of each field: varint as int, 64-bit as double, text and messages as bytes."""
    view, at = memoryview(data), 0
    while at < len(view):
        key, at = _varint(view, at)
        wire = key & 7
        value: int | float | memoryview
        if wire == _VARINT:
            value, at = _varint(view, at)
        elif wire == _DOUBLE:
            (value,) = struct.unpack_from("<d", view, at)
            at += 8
        elif wire == _FLOAT:
            (value,) = struct.unpack_from("<f", view, at)
            at += 4
        elif wire == _BYTES:
            size, at = _varint(view, at)
            if size > len(view) - at:
                raise ValueError(f"a field of {size} bytes in a message that holds {len(view) - at} more")
            value = view[at : at + size]
            at += size
        else:
            raise ValueError(f"wire type {wire}")
        yield key >> 3, value


def _varint(view: memoryview, at: int) -> tuple[int, int]:
    value = shift = 0
    while shift < 64:
        if at >= len(view):
            raise ValueError("ends inside a number")
        byte = view[at]
        at += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            # int64 in two's complement, as Timestamp's seconds are
            return (value if value < 1 << 63 else value - (1 << 64)), at
        shift += 7
    raise ValueError("a number of more than 64 bits")


def _bytes(value: int | float | bytes | memoryview) -> bytes | memoryview:
    if isinstance(value, int | float):
        raise ValueError("a number where a message or text belongs")
    return value


def _whole(value: int | float | memoryview) -> int:
    if not isinstance(value, int):
        raise ValueError("no whole number where one belongs")
    return value


def _numbers(value: int | float | bytes | memoryview, count: int) -> Numbers:
    found = [0.0] * count
    for field, number in _fields(_bytes(value)):
        if not isinstance(number, float):
            raise ValueError("no double where one belongs")
        if 1 <= field <= count:
            found[field - 1] = number
    return tuple(found)
