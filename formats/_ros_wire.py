"""Poses out of the bytes of ROS messages, ROS 1 and ROS 2 (CDR), without an object a message.

| message | gives |
|---|---|
| tf2_msgs/TFMessage (tf/tfMessage) | each transform |
| geometry_msgs/TransformStamped, nav_msgs/Odometry | the child frame it names |
| geometry_msgs/PoseStamped, PoseWithCovarianceStamped | one pose, whose frame the topic names |
| geometry_msgs/PoseArray | poses in order, which a list has to name |
| foxglove_msgs FrameTransform, FrameTransforms, PoseInFrame | as the first three |

All begin with headers and poses, which are all that is read: covariances and twists behind them are not. A recording of five minutes holds
a million transforms; made into objects they would take a minute, here they take seconds.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Numbers = tuple[float, ...]
_LAYOUTS = 64
"""Messages of one length that differ in more than numbers in more ways than this are parsed one by one."""


class Pose(NamedTuple):
    """One pose as a message holds it.

    parent: the frame it is in. child: the frame it is of; "" where the topic names it, or its position in a list of poses, from 0.
    stamp: ns, of the header. values: translation in m, then the quaternion **xyzw**.
    """

    parent: str
    child: str | int
    stamp: int
    values: Numbers


class Cursor:
    """Reads a message front to back. Raises `struct.error` where it ends early, `ValueError` for what is no such message."""

    __slots__ = ("_at", "_data", "_long", "_order", "_origin", "ros1")

    def __init__(self, data: bytes | memoryview, *, ros1: bool) -> None:
        self._data, self.ros1 = data, ros1
        order = "<"
        self._at = self._origin = 0
        if not ros1:
            if bytes(data[:2]) not in (b"\0\0", b"\0\1"):
                raise ValueError(f"encapsulation {bytes(data[:2]).hex()}, expected plain CDR (0000 or 0001)")
            order = "<" if data[1] else ">"
            self._at = self._origin = 4
        self._long = struct.Struct(order + "I")
        self._order = order

    def count(self) -> int:
        """An unsigned 32-bit number."""
        if not self.ros1:
            self._at += -(self._at - self._origin) % 4
        (value,) = self._long.unpack_from(self._data, self._at)
        self._at += 4
        return int(value)

    def string(self) -> str:
        """A string; CDR counts its closing NUL."""
        size = self.count()
        end = self._at + size
        if end > len(self._data):
            raise struct.error(f"a string of {size} bytes beyond the message's end")
        text = bytes(self._data[self._at : end if self.ros1 else max(end - 1, self._at)]).decode()
        self._at = end
        return text

    def doubles(self, number: int) -> Numbers:
        """`number` 64-bit floats."""
        if not self.ros1:
            self._at += -(self._at - self._origin) % 8
        values: Numbers = struct.unpack_from(f"{self._order}{number}d", self._data, self._at)
        self._at += 8 * number
        return values

    def stamp(self) -> int:
        """A time, in ns."""
        seconds = self.count()
        if not self.ros1 and seconds >= 1 << 31:
            seconds -= 1 << 32
        return seconds * 1_000_000_000 + self.count()

    def header(self) -> tuple[int, str]:
        """Stamp in ns and frame."""
        if self.ros1:
            self.sequence()
        return self.stamp(), self.string()

    def sequence(self) -> int:
        """The number of the message, which ROS 1 has in its header."""
        return self.count()


def _transform(cursor: Cursor) -> Iterator[Pose]:
    stamp, parent = cursor.header()
    child = cursor.string()
    yield Pose(parent, child, stamp, cursor.doubles(7))


def _transforms(cursor: Cursor) -> Iterator[Pose]:
    for _ in range(cursor.count()):
        yield from _transform(cursor)


def _pose(cursor: Cursor) -> Iterator[Pose]:
    stamp, parent = cursor.header()
    yield Pose(parent, "", stamp, cursor.doubles(7))


def _poses(cursor: Cursor) -> Iterator[Pose]:
    stamp, parent = cursor.header()
    for index in range(cursor.count()):
        yield Pose(parent, index, stamp, cursor.doubles(7))


def _foxglove_transform(cursor: Cursor) -> Iterator[Pose]:
    stamp, parent, child = cursor.stamp(), cursor.string(), cursor.string()
    yield Pose(parent, child, stamp, cursor.doubles(7))


def _foxglove_transforms(cursor: Cursor) -> Iterator[Pose]:
    for _ in range(cursor.count()):
        yield from _foxglove_transform(cursor)


def _foxglove_pose(cursor: Cursor) -> Iterator[Pose]:
    stamp, parent = cursor.stamp(), cursor.string()
    yield Pose(parent, "", stamp, cursor.doubles(7))


READERS: Mapping[str, Callable[[Cursor], Iterator[Pose]]] = {
    "tf2_msgs/TFMessage": _transforms,
    "tf/tfMessage": _transforms,
    "geometry_msgs/TransformStamped": _transform,
    "nav_msgs/Odometry": _transform,
    "geometry_msgs/PoseStamped": _pose,
    "geometry_msgs/PoseWithCovarianceStamped": _pose,
    "geometry_msgs/PoseArray": _poses,
    "foxglove_msgs/FrameTransform": _foxglove_transform,
    "foxglove_msgs/FrameTransforms": _foxglove_transforms,
    "foxglove_msgs/PoseInFrame": _foxglove_pose,
}
"""By message type, written `package/Name`."""


class BadMessage(ValueError):
    """A message that is not what its type says: `index` in the batch."""

    def __init__(self, index: int, error: Exception) -> None:
        self.index = index
        super().__init__(str(error) or type(error).__name__)


class Samples(NamedTuple):
    """One frame in many messages. message: (N,), which of the batch. stamps: (N,) ns. values: (N, 7) m, then **xyzw**."""

    parent: str
    child: str | int
    message: NDArray[np.int64]
    stamps: NDArray[np.int64]
    values: NDArray[np.float64]


def read_all(
    payloads: Sequence[memoryview], reader: Callable[[Cursor], Iterator[Pose]], *, ros1: bool
) -> Iterator[Samples]:
    """The poses of many messages of one topic. Raises `BadMessage`.

    Between most of them only numbers change: of those with equal bytes elsewhere one is parsed, and the others' numbers are read where that
    one has its own.
    """
    by_length: dict[int, list[int]] = {}
    for index, payload in enumerate(payloads):
        by_length.setdefault(len(payload), []).append(index)
    for size, indexes in by_length.items():
        matrix = np.frombuffer(b"".join(payloads[index] for index in indexes), np.uint8).reshape(len(indexes), size)
        left = np.array(indexes, np.int64)
        for _ in range(_LAYOUTS):
            if not len(left):
                break
            cursor, found = _traced(payloads, int(left[0]), reader, ros1=ros1)
            fixed = cursor.fixed()
            same = (matrix[:, fixed] == matrix[0, fixed]).all(axis=1)
            yield from _samples(cursor, found, matrix[same], left[same])
            matrix, left = matrix[~same], left[~same]
        for row, index in enumerate(left.tolist()):
            cursor, found = _traced(payloads, index, reader, ros1=ros1)
            yield from _samples(cursor, found, matrix[row : row + 1], left[row : row + 1])


_Found = list[tuple[Pose, int, int]]
"""Poses of a message, and where the bytes of stamp and values of each begin."""


def _traced(
    payloads: Sequence[memoryview], index: int, reader: Callable[[Cursor], Iterator[Pose]], *, ros1: bool
) -> tuple[_Tracer, _Found]:
    try:
        cursor = _Tracer(payloads[index], ros1=ros1)
        return cursor, [(pose, cursor.stamp_at, cursor.values_at) for pose in reader(cursor)]
    except (struct.error, ValueError) as error:
        raise BadMessage(index, error) from error


def _samples(cursor: _Tracer, found: _Found, rows: NDArray[np.uint8], message: NDArray[np.int64]) -> Iterator[Samples]:
    """What messages hold whose bytes are `rows` and whose layout is that of the one that `cursor` read."""
    for pose, stamp_at, values_at in found:
        times = _numbers(rows, stamp_at, 8, cursor.order + ("u4" if cursor.ros1 else "i4"))
        seconds = times[:, 0].astype(np.int64)
        nanoseconds = times[:, 1].astype(np.int64) & 0xFFFFFFFF
        values = _numbers(rows, values_at, 56, cursor.order + "f8").astype(float)
        yield Samples(pose.parent, pose.child, message, seconds * 1_000_000_000 + nanoseconds, values)


def _numbers(rows: NDArray[np.uint8], at: int, size: int, dtype: str) -> NDArray[Any]:
    return np.ascontiguousarray(rows[:, at : at + size]).view(dtype)


class _Tracer(Cursor):
    """A cursor that knows where it read numbers, which differ from message to message."""

    def __init__(self, data: bytes | memoryview, *, ros1: bool) -> None:
        super().__init__(data, ros1=ros1)
        self.stamp_at = self.values_at = 0
        self._varying: list[tuple[int, int]] = []

    @property
    def order(self) -> str:
        """NumPy's sign of the byte order."""
        return self._order

    def fixed(self) -> NDArray[np.int64]:
        """Places of the bytes read so far that are no numbers."""
        constant = np.ones(self._at, bool)
        for start, end in self._varying:
            constant[start:end] = False
        return np.flatnonzero(constant)

    def doubles(self, number: int) -> Numbers:
        values = super().doubles(number)
        self.values_at = self._at - 8 * number
        self._varying.append((self.values_at, self._at))
        return values

    def stamp(self) -> int:
        value = super().stamp()
        self.stamp_at = self._at - 8
        self._varying.append((self.stamp_at, self._at))
        return value

    def sequence(self) -> int:
        value = super().sequence()
        self._varying.append((self._at - 4, self._at))
        return value
