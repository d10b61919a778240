"""Collects the ROS 2 messages of a recording that a joint trajectory is made of: joint states and transforms.

Messages that all look alike, as ours do and as most publishers' do, are decoded in bulk; any other one by one through rosbags.
Stamps are int64 nanoseconds of the messages' own header.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from retarget.core.errors import FormatError
from retarget.core.types import Array
from retarget.formats._cdr import Layout, Rows, joint_state, transforms

Stamps = NDArray[np.int64]

JOINT_STATE = "sensor_msgs/msg/JointState"
TF_MESSAGE = "tf2_msgs/msg/TFMessage"
_MOST_IN_BULK = 512
JOINT_TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"


@lru_cache(maxsize=1)
def typestore() -> Any:
    """Definitions of the standard ROS 2 messages; those used here are the same in every distribution since Foxy."""
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_HUMBLE)


def deserialize(name: str, place: str, payload: memoryview, message_type: str) -> Any:
    """One CDR message as rosbags' object; `FormatError` when the bytes are no such message."""
    from rosbags.serde import SerdeError

    try:
        return typestore().deserialize_cdr(bytes(payload), message_type)
    # A length field that points beyond the message surfaces as whatever the generated decoder trips over first.
    except (SerdeError, IndexError, ValueError, AssertionError, MemoryError) as error:
        raise FormatError(name, f"not a {message_type}: {error or type(error).__name__}", place=place) from error


def stamps_of(rows: Rows, slot: str = "") -> Stamps:
    """Header stamps (K,) of `rows` in ns."""
    stamps: Stamps = rows[f"{slot}sec"].astype(np.int64) * 1_000_000_000 + rows[f"{slot}nanosec"]
    return stamps


class JointStates:
    """The messages of one JointState topic. `names` is the order of the first message; later ones are brought into it."""

    def __init__(self, file: str, topic: str) -> None:
        self.file, self.topic = file, topic
        self.names: tuple[str, ...] = ()
        self.count = 0
        self._layout: Layout | None = None
        self._blocks: list[tuple[Stamps, Array, Array]] = []
        self._log_times: list[int] = []

    def add(self, payloads: Sequence[memoryview], log_times: Sequence[int]) -> None:
        """Append messages. Raises `FormatError` for one without a position per name, or with other names than the first."""
        if self._layout is None:
            first = self._decode(payloads[0], self.count)
            if len(set(first.name)) != len(first.name):
                raise FormatError(self.file, "a joint stands twice in one message", place=self._place(0))
            self.names = tuple(first.name)
            self._layout = Layout()
            joint_state(
                self._layout,
                first.header.frame_id,
                self.names,
                *(len(values) for values in (first.position, first.velocity, first.effort)),
            )
        rows = self._layout.match(payloads)
        full = rows is not None and rows["position"].shape[1] == len(self.names)
        if rows is not None and full and rows["velocity"].shape[1] in (0, len(self.names)):
            known = rows["velocity"].shape[1] == len(self.names)
            velocity = rows["velocity"] if known else np.full(rows["position"].shape, np.nan)
            self._blocks.append((stamps_of(rows), rows["position"].astype(float), velocity.astype(float)))
        else:
            self._add_singly(payloads)
        self.count += len(payloads)
        self._log_times += log_times

    def collected(self) -> tuple[Stamps, Stamps, Array, Array]:
        """Header stamps (K,), log times (K,), positions (K, n) and velocities (K, n), NaN where a message had none; in file order."""
        stamps, position, velocity = (np.concatenate(parts) for parts in zip(*self._blocks, strict=True))
        return stamps, np.array(self._log_times, np.uint64).astype(np.int64), position, velocity

    def _add_singly(self, payloads: Sequence[memoryview]) -> None:
        stamps = np.empty(len(payloads), np.int64)
        position = np.empty((len(payloads), len(self.names)))
        velocity = np.full_like(position, np.nan)
        column = {joint: i for i, joint in enumerate(self.names)}
        for i, payload in enumerate(payloads):
            message = self._decode(payload, self.count + i)
            place = self._place(self.count + i)
            if sorted(message.name) != sorted(self.names):
                odd = sorted(set(message.name) ^ set(self.names)) or sorted(message.name)
                problem = f"joint '{odd[0]}' is in only some of the messages (or stands twice)"
                raise FormatError(
                    self.file, problem, place=place, expected=f"the same {len(self.names)} joints in each"
                )
            if len(message.position) != len(self.names) or len(message.velocity) not in (0, len(self.names)):
                sizes = f"{len(message.position)} positions and {len(message.velocity)} velocities"
                raise FormatError(self.file, sizes, place=place, expected=f"one for each of {len(self.names)} joints")
            order = [column[joint] for joint in message.name]
            position[i, order] = message.position
            if len(message.velocity):
                velocity[i, order] = message.velocity
            stamps[i] = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
        self._blocks.append((stamps, position, velocity))

    def _decode(self, payload: memoryview, index: int) -> Any:
        return deserialize(self.file, self._place(index), payload, JOINT_STATE)

    def _place(self, index: int) -> str:
        return f"topic {self.topic}, message {index}"


class Transforms:
    """The messages of one TFMessage topic: for each child frame its parents, and for each of those stamps and poses.

    Leading slashes of frame names are dropped. Poses are (K, 7): translation in m, then the quaternion **xyzw** as in the message.
    """

    def __init__(self, file: str, topic: str) -> None:
        self.file, self.topic = file, topic
        self.edges: dict[str, dict[str, list[tuple[Stamps, Array]]]] = {}
        self._count = 0
        self._layout: tuple[Layout, list[tuple[str, str]]] | None = None

    def add(self, payloads: Sequence[memoryview]) -> None:
        """Append messages."""
        if self._layout is None:
            first = self._decode(payloads[0], self._count).transforms
            # Beyond some number of slots a layout costs more than it saves; one without transforms matches no message that has any.
            edges = [(item.header.frame_id, item.child_frame_id) for item in first]
            self._layout = Layout(), edges if len(edges) <= _MOST_IN_BULK else []
            transforms(*self._layout)
        layout, edges = self._layout
        rows = layout.match(payloads)
        if rows is not None:
            for i, (parent, child) in enumerate(edges):
                pose = np.hstack([rows[f"{i}.translation"], rows[f"{i}.rotation"]])
                self._append(parent, child, stamps_of(rows, f"{i}."), pose)
        else:
            self._add_singly(payloads)
        self._count += len(payloads)

    def pose(self, child: str) -> tuple[str, Stamps, Array] | None:
        """Parent frame, stamps and poses of `child`, from the parent named most often; None when it is no child of any frame."""
        parents = self.edges.get(child)
        if not parents:
            return None
        counts = {parent: sum(len(stamps) for stamps, _ in blocks) for parent, blocks in parents.items()}
        parent = max(counts, key=counts.__getitem__)
        stamps, poses = (np.concatenate(parts) for parts in zip(*parents[parent], strict=True))
        return parent, stamps, poses

    def _add_singly(self, payloads: Sequence[memoryview]) -> None:
        found: dict[tuple[str, str], list[tuple[int, list[float]]]] = {}
        for i, payload in enumerate(payloads):
            for item in self._decode(payload, self._count + i).transforms:
                t, q = item.transform.translation, item.transform.rotation
                stamp = item.header.stamp.sec * 1_000_000_000 + item.header.stamp.nanosec
                pose = [t.x, t.y, t.z, q.x, q.y, q.z, q.w]
                found.setdefault((item.header.frame_id, item.child_frame_id), []).append((stamp, pose))
        for (parent, child), values in found.items():
            self._append(parent, child, np.array([v[0] for v in values], np.int64), np.array([v[1] for v in values]))

    def _append(self, parent: str, child: str, stamps: Stamps, poses: Array) -> None:
        self.edges.setdefault(child.lstrip("/"), {}).setdefault(parent.lstrip("/"), []).append((stamps, poses))

    def _decode(self, payload: memoryview, index: int) -> Any:
        return deserialize(self.file, f"topic {self.topic}, message {index}", payload, TF_MESSAGE)


def joint_trajectory(
    name: str, topic: str, payloads: Sequence[memoryview]
) -> tuple[tuple[str, ...], Stamps, Array, Array]:
    """Joint names, stamps (T,) ns, positions and velocities (T, n), NaN where there are none, of a topic's only JointTrajectory.

    Raises `FormatError` when there are several, and for points without a position for each joint.
    """
    place = f"topic {topic}"
    if len(payloads) != 1:
        raise FormatError(name, f"{len(payloads)} joint trajectories", place=place, expected="one")
    message = deserialize(name, place, payloads[0], JOINT_TRAJECTORY)
    joints, count = tuple(message.joint_names), len(message.joint_names)
    if not message.points:
        raise FormatError(name, "a joint trajectory without points", place=place)
    for i, point in enumerate(message.points):
        if len(point.positions) != count or len(point.velocities) not in (0, count):
            sizes = f"{len(point.positions)} positions and {len(point.velocities)} velocities"
            raise FormatError(name, sizes, place=f"{place}, point {i}", expected=f"one for each of {count} joints")
    unknown = np.full(count, np.nan)
    stamp = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
    after = [p.time_from_start.sec * 1_000_000_000 + p.time_from_start.nanosec for p in message.points]
    velocity = [point.velocities if len(point.velocities) else unknown for point in message.points]
    position = np.array([point.positions for point in message.points], float)
    return joints, stamp + np.array(after, np.int64), position, np.array(velocity, float)
