"""ROS 2 messages of fixed size as NumPy structured types: a whole clip is encoded or decoded in a few array operations.

Between the messages of one topic only numbers change (stamps, positions): names and frame ids stay. So the layout of one message is
worked out once, as a template of bytes with named slots at fixed offsets; a million messages are then one array of that type.

CDR, little endian, version 1 (OMG DDS-RTPS 10.2): four bytes of encapsulation, then each primitive aligned to its own size counted
from after those four bytes; strings are a uint32 length with their closing NUL counted, sequences a uint32 count. An empty sequence
adds no alignment for its missing elements.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Rows = NDArray[np.void]

ENCAPSULATION = b"\x00\x01\x00\x00"


@dataclass
class Layout:
    """A growing byte template with named variable slots.

    `slots` maps a name to its (dtype, offset). Slots hold zeros in the template.
    """

    template: bytearray = field(default_factory=bytearray)
    slots: dict[str, tuple[np.dtype[Any], int]] = field(default_factory=dict)
    origin: int = 0
    """Where alignment counts from: after the encapsulation of the message being laid out. Negative for a layout that continues a message."""

    def raw(self, data: bytes) -> None:
        """Append constant bytes, unaligned."""
        self.template += data

    def variable(self, name: str, dtype: str, shape: tuple[int, ...] = (), *, aligned: bool = True) -> None:
        """Append a slot of `shape` numbers of `dtype`, aligned to one number's size unless told otherwise."""
        kind = np.dtype((dtype, shape))
        if aligned and kind.itemsize:
            self._align(np.dtype(dtype).itemsize)
        self.slots[name] = (kind, len(self.template))
        self.template += bytes(kind.itemsize)

    def continued(self) -> Layout:
        """An empty layout for what follows this one in the same message, aligned as there."""
        return Layout(origin=self.origin - len(self.template))

    def begin_message(self) -> None:
        """Append the encapsulation; alignment counts from here on."""
        self.raw(ENCAPSULATION)
        self.origin = len(self.template)

    def count(self, value: int) -> None:
        """Append a constant uint32: the length of a string or sequence."""
        self._align(4)
        self.raw(struct.pack("<I", value))

    def string(self, text: str) -> None:
        """Append a constant string, UTF-8."""
        data = text.encode() + b"\0"
        self.count(len(data))
        self.raw(data)

    def sequence(self, name: str, dtype: str, length: int) -> None:
        """Append a sequence of `length` variable numbers."""
        self.count(length)
        self.variable(name, dtype, (length,))

    def dtype(self, itemsize: int | None = None) -> np.dtype[Any]:
        """The structured type of one row, `itemsize` bytes long (default: the template's length)."""
        return np.dtype(
            {
                "names": list(self.slots),
                "formats": [kind for kind, _ in self.slots.values()],
                "offsets": [offset for _, offset in self.slots.values()],
                "itemsize": len(self.template) if itemsize is None else itemsize,
            }
        )

    def rows(self, count: int) -> Rows:
        """`count` rows holding the template, slots zero; C-contiguous, to be filled by slot name."""
        matrix = np.empty((count, len(self.template)), np.uint8)
        matrix[:] = np.frombuffer(bytes(self.template), np.uint8)
        return matrix.view(self.dtype())[:, 0]

    def match(self, messages: Sequence[bytes | memoryview]) -> Rows | None:
        """The messages as rows of this layout, or None when their length or any constant byte differs.

        Up to three bytes of padding at the end are accepted: some middleware rounds messages up to four.
        """
        size = len(messages[0])
        if not 0 <= size - len(self.template) <= 3 or any(len(message) != size for message in messages):
            return None
        matrix = np.frombuffer(b"".join(messages), np.uint8).reshape(len(messages), size)
        template = np.frombuffer(bytes(self.template), np.uint8)
        start = 0
        for kind, offset in [*self.slots.values(), (np.dtype("V0"), len(template))]:
            if not (matrix[:, start:offset] == template[start:offset]).all():
                return None
            start = offset + kind.itemsize
        return matrix.view(self.dtype(size))[:, 0]

    def _align(self, size: int) -> None:
        self.template += bytes(-(len(self.template) - self.origin) % size)


def joint_state(
    layout: Layout,
    frame_id: str,
    names: Sequence[str],
    positions: int,
    velocities: int,
    efforts: int = 0,
    *,
    slot: str = "",
) -> None:
    """sensor_msgs/msg/JointState: slots sec, nanosec, position, velocity, effort, each prefixed by `slot`."""
    layout.begin_message()
    _header(layout, frame_id, slot)
    layout.count(len(names))
    for name in names:
        layout.string(name)
    layout.sequence(f"{slot}position", "<f8", positions)
    layout.sequence(f"{slot}velocity", "<f8", velocities)
    layout.sequence(f"{slot}effort", "<f8", efforts)


def transforms(layout: Layout, edges: Sequence[tuple[str, str]], *, slot: str = "") -> None:
    """tf2_msgs/msg/TFMessage of a transform parent ← child for each of `edges`.

    Slots of the i-th: i.sec, i.nanosec, i.translation (3), i.rotation (4, **xyzw**), each prefixed by `slot`.
    """
    layout.begin_message()
    layout.count(len(edges))
    for index, (parent, child) in enumerate(edges):
        _header(layout, parent, f"{slot}{index}.")
        layout.string(child)
        layout.variable(f"{slot}{index}.translation", "<f8", (3,))
        layout.variable(f"{slot}{index}.rotation", "<f8", (4,))


def joint_trajectory_head(layout: Layout, names: Sequence[str], points: int) -> None:
    """trajectory_msgs/msg/JointTrajectory up to its points, which follow: stamp 0 and no frame, all constant."""
    layout.begin_message()
    layout.raw(bytes(8))
    layout.string("")
    layout.count(len(names))
    for name in names:
        layout.string(name)
    layout.count(points)


def joint_trajectory_point(layout: Layout, joints: int) -> None:
    """trajectory_msgs/msg/JointTrajectoryPoint within a message: slots positions, velocities, sec, nanosec (time from start)."""
    layout.sequence("positions", "<f8", joints)
    layout.sequence("velocities", "<f8", joints)
    layout.count(0)  # accelerations
    layout.count(0)  # effort
    layout.variable("sec", "<i4")
    layout.variable("nanosec", "<u4")


def twist(layout: Layout, frame_id: str, *, slot: str = "") -> None:
    """geometry_msgs/msg/TwistStamped: slots sec, nanosec, linear (3), angular (3)."""
    layout.begin_message()
    _header(layout, frame_id, slot)
    layout.variable(f"{slot}linear", "<f8", (3,))
    layout.variable(f"{slot}angular", "<f8", (3,))


def int8(layout: Layout, *, slot: str = "") -> None:
    """std_msgs/msg/Int8: slot data."""
    layout.begin_message()
    layout.variable(f"{slot}data", "i1")


def string(layout: Layout, text: str) -> None:
    """std_msgs/msg/String, all constant."""
    layout.begin_message()
    layout.string(text)


def _header(layout: Layout, frame_id: str, slot: str) -> None:
    layout.variable(f"{slot}sec", "<i4")
    layout.variable(f"{slot}nanosec", "<u4")
    layout.string(frame_id)
