"""Poses out of the bytes of ROS messages, ROS 1 and ROS 2 (CDR), without an object a message.

| message | gives |
|---|---|
| tf2_msgs/TFMessage (tf/tfMessage) | each transform |
| geometry_msgs/TransformStamped, nav_msgs/Odometry | the child frame it names |
| geometry_msgs/PoseStamped, PoseWithCovarianceStamped | one pose, whose frame the topic names |
| geometry_msgs/PoseArray | poses in order, which a list has to name |
| foxglove_msgs FrameTransform, FrameTransforms, PoseInFrame | as the first three |

All begin with headers and poses, which are all that is read: covariances and twists behind them are not. A recording of five minutes holds
a million transforms; made into objects they would take a minute.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

Numbers = tuple[float, ...]


class Pose(NamedTuple):
    """One pose as a message holds it.

    parent: the frame it is in. child: the frame it is of; "" where the topic names it, or the position in its list as "#0", "#1" ….
    stamp: ns, of the header. values: translation in m, then the quaternion **xyzw**.
    """

    parent: str
    child: str
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
            self.count()
        return self.stamp(), self.string()


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
        yield Pose(parent, f"#{index}", stamp, cursor.doubles(7))


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
