"""Puts together a joint trajectory from what an MCAP recording holds, ours or anyone's; `mcap.py` says what is taken from where."""

from __future__ import annotations

import re
from collections.abc import Mapping
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray
from retarget.core import rotations
from retarget.core.errors import FormatError
from retarget.core.types import Array, JointTrajectory
from retarget.formats import _cdr, _mcap_reader, _trajectory
from retarget.formats._ros_messages import (
    JOINT_STATE,
    JOINT_TRAJECTORY,
    TF_MESSAGE,
    JointStates,
    Stamps,
    Transforms,
    deserialize,
    joint_trajectory,
    stamps_of,
)

METADATA = "retarget"
"""Name of the metadata record that marks a recording as ours."""
WORLD = "world"
TWIST, INT8, STRING = "geometry_msgs/msg/TwistStamped", "std_msgs/msg/Int8", "std_msgs/msg/String"
USED = (JOINT_STATE, JOINT_TRAJECTORY, TF_MESSAGE, TWIST, INT8, STRING)
"""Types of messages of which anything is taken."""


class Recording:
    """What a recording brought that belongs to a joint trajectory."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.warnings: list[str] = []
        self.joints: dict[str, JointStates] = {}
        self.plans: dict[str, list[memoryview]] = {}
        self.moving = Transforms(name, "/tf")
        self.still = Transforms(name, "/tf_static")
        self.twists: list[tuple[Stamps, Array, Array]] = []
        self.statuses: list[tuple[Stamps, NDArray[np.int8]]] = []
        self.description = ""
        self.meta: Mapping[str, str] = {}
        self.topics: dict[str, str] = {}

    def add(self, item: _mcap_reader.Batch | _mcap_reader.Metadata) -> None:
        """Take in a batch of messages or a metadata record."""
        if isinstance(item, _mcap_reader.Metadata):
            if item.name == METADATA:
                self.meta = item.entries
            return
        self.topics[item.topic] = item.message_type or "no schema"
        if item.encoding != "cdr":
            return
        if item.message_type == JOINT_STATE:
            self.joints.setdefault(item.topic, JointStates(self.name, item.topic)).add(item.payloads, item.log_times)
        elif item.message_type == JOINT_TRAJECTORY:
            self.plans.setdefault(item.topic, []).extend(item.payloads)
        elif item.message_type == TF_MESSAGE and item.topic in ("/tf", "/tf_static"):
            (self.moving if item.topic == "/tf" else self.still).add(item.payloads)
        elif (item.topic, item.message_type) == ("/robot_description", STRING):
            text = deserialize(self.name, f"topic {item.topic}", item.payloads[-1], STRING)
            self.description = text.data
        elif (item.topic, item.message_type) == ("/base_twist", TWIST):
            self._add_twist(item)
        elif (item.topic, item.message_type) == ("/frame_status", INT8):
            layout = _cdr.Layout()
            _cdr.int8(layout)
            if (rows := layout.match(item.payloads)) is not None:
                self.statuses.append((np.array(item.log_times, np.uint64).astype(np.int64), rows["data"]))

    def trajectory(self) -> JointTrajectory:
        """Everything put together. Raises `FormatError` when it doesn't make a trajectory."""
        names, stamps, log_times, position, velocity = self._joints()
        stamps, position, velocity = self._in_time_order(stamps, log_times, position, velocity)
        own = bool(self.meta)
        if own:
            _trajectory.check_schema(self.name, self.meta.get("schema", ""))
            time = _seconds(stamps)
            provenance = _trajectory.parse_provenance(self.name, self.meta.get("provenance", ""))
            base_frame: str | None = self.meta.get("base_frame", "")
        else:
            time, provenance = _seconds(stamps - stamps[0]), {"start_stamp_ns": int(stamps[0])}
            base_frame = self._root_link()
        if (unknown := np.isnan(velocity).any(axis=0)).any():
            velocity = np.where(unknown, _trajectory.differentiate(time, position), velocity)
            self.warnings.append(
                f"velocity missing for {int(unknown.sum())} joints: differentiated from their positions"
            )
        fixed = self.meta.get("base") == "fixed"
        base_position, base_orientation = (None, None) if fixed else self._base(base_frame, stamps)
        if own and not fixed and base_position is None:
            raise FormatError(self.name, f"no transform of '{base_frame}' on /tf", expected="one for each joint state")
        linear, angular = self._twist(stamps)
        return _trajectory.build(
            self.name,
            self.warnings,
            time=time,
            joint_names=names,
            position=position,
            velocity=velocity,
            base_position=base_position,
            base_orientation=base_orientation,
            base_linear_velocity=linear,
            base_angular_velocity=angular,
            status=self._status(stamps),
            base_frame="base_link" if base_frame is None else base_frame,
            robot=self.meta.get("robot", ""),
            provenance=provenance,
            robot_description=self.description,
        )

    def _add_twist(self, batch: _mcap_reader.Batch) -> None:
        layout = _cdr.Layout()
        _cdr.twist(layout, WORLD)
        if (rows := layout.match(batch.payloads)) is None:
            self.warnings.append(f"/base_twist not used: its frame is not '{WORLD}'")
        else:
            self.twists.append((stamps_of(rows), rows["linear"].astype(float), rows["angular"].astype(float)))

    def _joints(self) -> tuple[tuple[str, ...], Stamps, Stamps, Array, Array]:
        """Joint names, stamps, log times, positions and velocities: of joint states, else of a joint trajectory."""
        if not self.joints and len(self.plans) == 1:
            ((topic, payloads),) = self.plans.items()
            names, stamps, position, velocity = joint_trajectory(self.name, topic, payloads)
            return names, stamps, stamps, position, velocity
        joints = self._joint_states()
        return joints.names, *joints.collected()

    def _joint_states(self) -> JointStates:
        if not self.joints:
            found = ", ".join(f"{topic} ({kind})" for topic, kind in sorted(self.topics.items())) or "no messages"
            raise FormatError(self.name, f"no {JOINT_STATE}; found {found}", expected="joint states on /joint_states")
        if "/joint_states" in self.joints:
            return self.joints["/joint_states"]
        if len(self.joints) > 1:
            topics = ", ".join(sorted(self.joints))
            raise FormatError(
                self.name, f"joint states on {topics}", expected="one such topic, or one named /joint_states"
            )
        return next(iter(self.joints.values()))

    def _in_time_order(
        self, stamps: Stamps, log_times: Stamps, position: Array, velocity: Array
    ) -> tuple[Stamps, Array, Array]:
        if len(stamps) > 1 and not stamps.any():
            self.warnings.append("joint states without stamps: the recorder's log time is used")
            stamps = log_times
        order = np.argsort(stamps, kind="stable")
        keep = order[np.diff(stamps[order], prepend=stamps[order[0]] - 1) > 0]
        if len(keep) < len(stamps):
            self.warnings.append(f"{len(stamps) - len(keep)} joint states repeat a stamp: the first of each is used")
        return stamps[keep], position[keep], velocity[keep]

    def _base(self, frame: str | None, stamps: Stamps) -> tuple[Array | None, Array | None]:
        """Pose of `frame` at `stamps`, or None twice where the recording doesn't tell."""
        child = None if frame is None else frame.lstrip("/")
        found = None if child is None else self.moving.pose(child) or self.still.pose(child)
        if found is None:
            if not self.meta:
                self.warnings.append(
                    "base taken as fixed: no transform of the root link of /robot_description was found"
                )
            return None, None
        _, at, pose = found
        if not np.isfinite(pose).all():
            raise FormatError(self.name, f"transform of '{frame}' that is not finite", place="topic /tf")
        quaternion = _trajectory.unit_quaternions(self.name, f"transforms of '{frame}'", pose[:, [6, 3, 4, 5]])
        if np.array_equal(at, stamps):
            return pose[:, :3], quaternion
        if len(at) > 1:
            self.warnings.append(f"base pose interpolated: '{frame}' has other stamps than the joint states")
        at, first = np.unique(at, return_index=True)
        return _interpolated(at, pose[first, :3], quaternion[first], stamps)

    def _twist(self, stamps: Stamps) -> tuple[Array | None, Array | None]:
        if not self.twists:
            return None, None
        at, linear, angular = (np.concatenate(parts) for parts in zip(*self.twists, strict=True))
        if not np.array_equal(at, stamps):
            self.warnings.append("/base_twist not used: its stamps are not those of the joint states")
            return None, None
        return (None if np.isnan(linear).all() else linear), (None if np.isnan(angular).all() else angular)

    def _status(self, stamps: Stamps) -> NDArray[np.int8]:
        status = np.zeros(len(stamps), np.int8)
        for at, values in self.statuses:
            place = np.clip(np.searchsorted(stamps, at), 0, len(stamps) - 1)
            same = stamps[place] == at
            status[place[same]] = values[same]
        return status

    def _root_link(self) -> str | None:
        """The link of the URDF in /robot_description that is no joint's child; None without one."""
        if not self.description or re.search(r"<!(DOCTYPE|ENTITY)", self.description):
            return None
        try:
            tree = ElementTree.fromstring(self.description)
        except ElementTree.ParseError as error:
            self.warnings.append(f"/robot_description is not XML: {error}")
            return None
        children = {child.get("link", "") for child in tree.findall("joint/child")}
        return next((n for link in tree.findall("link") if (n := link.get("name", "")) not in children), None)


def _seconds(stamps: Stamps) -> Array:
    """Stamps in s: one correctly rounded division while the integer is exact as a double, whole seconds apart beyond."""
    seconds, rest = np.divmod(stamps, 1_000_000_000)
    return np.where(stamps < 2**53, stamps / 1e9, seconds + rest / 1e9)


def _interpolated(at: Stamps, position: Array, quaternion: Array, stamps: Stamps) -> tuple[Array, Array]:
    """Positions linearly and quaternions along the shortest arc at `stamps`; held at both ends."""
    right = np.clip(np.searchsorted(at, stamps), 1, max(len(at) - 1, 1))
    left, right = right - 1, np.minimum(right, len(at) - 1)
    span = np.maximum(at[right] - at[left], 1)
    fraction = np.clip((stamps - at[left]) / span, 0.0, 1.0)
    moved = position[left] + fraction[:, None] * (position[right] - position[left])
    turned = rotations.slerp(quaternion[left], quaternion[right], fraction)
    return moved, rotations.make_continuous(turned)
