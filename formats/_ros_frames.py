"""Frames of a ROS recording: who hangs on whom, when, where; chains of them composed to one root.

Every pair parent → child of every topic is kept as it comes, in numbers only. A frame that several topics give is taken from the one
that knows most of it: moving tf before tf_static, tf before the poses that drivers publish beside it.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from retarget.core import rotations
from retarget.core.errors import FormatError
from retarget.core.types import Array
from retarget.formats._ros_wire import Pose, Samples

Clock = Literal["header", "log"]
LINKS, TREE, POSES = 0, 1, 2
"""What a frame comes from: `LinkStateArray`, tf, or a topic of single poses; the earlier goes first."""
_DEEPEST = 128
_LEAST, _LARGEST = -(2**63), 2**63 - 1


@dataclass
class Edge:
    """One frame in another, from one topic. N samples: stamps and log_times in ns, values 7 each (m, xyzw)."""

    parent: str
    child: str
    topic: str
    kind: int
    static: bool
    stamps: array[int] = field(default_factory=lambda: array("q"))
    log_times: array[int] = field(default_factory=lambda: array("q"))
    values: array[float] = field(default_factory=lambda: array("d"))

    @property
    def label(self) -> str:
        """The frame with the one it is in, for messages."""
        return f"{self.child} in {self.parent}" if self.parent else self.child

    def times(self, clock: Clock) -> NDArray[np.int64]:
        """(N,) ns."""
        return np.array(self.stamps if clock == "header" else self.log_times, np.int64)

    def poses(self) -> Array:
        """(N, 7): m, then **wxyz**."""
        return np.array(self.values, float).reshape(-1, 7)[:, [0, 1, 2, 6, 3, 4, 5]]


class Frames:
    """All edges of a recording."""

    def __init__(self, file: str) -> None:
        self.file = file
        self.edges: dict[tuple[str, str, str], Edge] = {}

    def add_all(
        self, topic: str, kind: int, batch: Iterable[Samples], log_times: Sequence[int], names: Sequence[str] = ()
    ) -> None:
        """Append what many messages hold, in their order. names: of poses in a list; those beyond it are left out."""
        found: dict[tuple[str, str | int], list[Samples]] = {}
        for one in batch:
            found.setdefault((one.parent, one.child), []).append(one)
        recorded = np.clip(np.array(log_times, object), _LEAST, _LARGEST).astype(np.int64)
        for (parent, child), parts in found.items():
            edge = self._edge(topic, kind, parent, child, names)
            if edge is None:
                continue
            index = np.concatenate([part.message for part in parts])
            order = np.argsort(index, kind="stable")
            edge.stamps.frombytes(np.concatenate([part.stamps for part in parts])[order].tobytes())
            edge.log_times.frombytes(recorded[index[order]].tobytes())
            edge.values.frombytes(np.concatenate([part.values for part in parts])[order].tobytes())

    def add(self, topic: str, kind: int, poses: Iterable[Pose], log_time: int, names: Sequence[str] = ()) -> None:
        """Append what one message holds; as `add_all`."""
        for pose in poses:
            edge = self._edge(topic, kind, pose.parent, pose.child, names)
            if edge is None:
                continue
            edge.stamps.append(_int64(pose.stamp))
            edge.log_times.append(_int64(log_time))
            edge.values.extend(pose.values)

    def _edge(self, topic: str, kind: int, parent: str, child: str | int, names: Sequence[str]) -> Edge | None:
        """The edge of a pose as a message names it; None for one in a list that has no name."""
        if isinstance(child, int):
            if child >= len(names):
                return None
            child = names[child]
        child, parent = (child or topic_frame(topic)).lstrip("/"), parent.lstrip("/")
        key = (topic, parent, child)
        if key not in self.edges:
            static = kind == TREE and topic.rstrip("/").endswith("tf_static")
            self.edges[key] = Edge(parent, child, topic, kind, static)
        return self.edges[key]

    def chosen(self, kind: int | None = None) -> dict[str, Edge]:
        """Child frame → the edge it is taken from; of one kind only where `kind` is given."""
        found: dict[str, Edge] = {}
        for edge in self.edges.values():
            if (kind is None and edge.kind == LINKS) or (kind is not None and edge.kind != kind):
                continue
            other = found.get(edge.child)
            if other is None or _rank(edge) < _rank(other):
                found[edge.child] = edge
        return found


def _int64(value: int) -> int:
    return min(max(value, _LEAST), _LARGEST)


def _rank(edge: Edge) -> tuple[bool, int, int]:
    return edge.static, edge.kind, -len(edge.stamps)


def topic_frame(topic: str) -> str:
    """What a topic of single poses is called for its device: `waist` of `/waist_pose`."""
    name = topic.strip("/")
    for ending in ("_pose", "/pose", "_odom", "/odom", "_transform"):
        if name.lower().endswith(ending) and len(name) > len(ending):
            return name[: -len(ending)]
    return name


def chain(edges: Mapping[str, Edge], frame: str, root: str | None, file: str) -> list[Edge]:
    """The edges from the root to `frame`, in that order. Raises `FormatError` for a loop, and where `root` is not above the frame."""
    found: list[Edge] = []
    at = frame
    while at != root and at in edges:
        if len(found) >= _DEEPEST or any(edge.child == at for edge in found):
            raise FormatError(file, f"frames hang on each other in a loop: {' → '.join(e.child for e in found[:6])} …")
        found.append(edges[at])
        at = edges[at].parent
    if root is not None and at != root:
        above = ", ".join([frame, *(edge.parent for edge in found)])
        raise FormatError(file, f"frame '{frame}' does not hang on root '{root}': above it are {above}")
    return found[::-1]


def compose(outer: tuple[Array, Array], inner: tuple[Array, Array]) -> tuple[Array, Array]:
    """Position and quaternion of world ← inner from those of world ← outer and outer ← inner."""
    position = outer[0] + rotations.rotate(outer[1], inner[0])
    return position, rotations.multiply(outer[1], inner[1])
