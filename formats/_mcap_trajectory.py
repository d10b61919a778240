"""Encodes a joint trajectory, and the person it was made from, as the messages and chunks of an MCAP file; `mcap.py` says which."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray
from retarget.core.errors import RetargetError
from retarget.core.types import Array, HumanMotion, JointTrajectory
from retarget.formats import _cdr, _trajectory
from retarget.formats._mcap_recording import INT8, METADATA, STRING, TWIST, WORLD
from retarget.formats._mcap_writer import McapFile, Topic, message_record
from retarget.formats._ros_messages import JOINT_STATE, JOINT_TRAJECTORY, TF_MESSAGE, Stamps, typestore

HUMAN = "human/"
"""What the frames of the person's segments begin with."""
WITH_JOINT_TRAJECTORY = "joint_trajectory"
"""Style that adds the whole trajectory as one message."""
_CHUNK_BYTES = 1 << 20


def write(
    stream: BinaryIO, trajectory: JointTrajectory, style: str = "default", motion: HumanMotion | None = None
) -> McapFile:
    """Write `trajectory`, beside `motion` where it is given, as MCAP to a stream that need not seek; what was written.

    motion: frame for frame with the trajectory. Raises `RetargetError` for times that MCAP can't hold and a motion of other times.
    """
    if motion is not None and not np.array_equal(motion.time, trajectory.time):
        raise RetargetError("mcap: the person's motion has other times than the trajectory; expected the same frames")
    stamps = _stamps(trajectory.time)
    frame = _frame_of(trajectory, motion)
    once = _declare_once(frame, trajectory)
    if style == WITH_JOINT_TRAJECTORY:
        once.append((frame.declare("/joint_trajectory", JOINT_TRAJECTORY), _whole_trajectory(trajectory, stamps)))
    file = McapFile(stream, frame.topics, {METADATA: _metadata(trajectory)})
    if once:
        _write_once(file, once, int(stamps[0]))
    _write_frames(file, frame, stamps)
    file.finish()
    return file


def write_parts(stream: BinaryIO, parts: Iterable[JointTrajectory]) -> McapFile | None:
    """Write a trajectory that comes in consecutive parts, each before the next is asked for, to a stream that need not seek; what was written.

    What only the end can tell stands in a second metadata record there: the last part's provenance, where it is another than the first one's.
    The record is complete, and readers take the last. `/frame_status` has messages in parts of which some frame is marked. Raises
    `RetargetError` as `write`, and for parts that don't fit together; without any part nothing is written.
    """
    file: McapFile | None = None
    topics: list[Topic] = []
    said, last = dict[str, str](), dict[str, str]()
    frames, last_stamp = 0, -1
    for part in parts:
        stamps, frame, last = _stamps(part.time), _frame_of(part, None, may_be_marked_later=True), _metadata(part)
        if file is None:
            topics, said = list(frame.topics), last
            once = _declare_once(frame, part)
            file = McapFile(stream, frame.topics, {METADATA: said})
            if once:
                _write_once(file, once, int(stamps[0]))
        elif (
            stamps[0] <= last_stamp or frame.topics != topics or last | {"provenance": ""} != said | {"provenance": ""}
        ):
            raise RetargetError(f"mcap: the part from {part.time[0]:g} s on does not continue the one before")
        _write_frames(file, frame, stamps, frames)
        stream.flush()
        frames, last_stamp = frames + part.frames, int(stamps[-1])
    if file is not None:
        if last != said:
            file.metadata(METADATA, last)
        file.finish()
    return file


class _Frame:
    """What every frame writes: one row that holds a message of each topic, and the arrays that go into its slots."""

    def __init__(self) -> None:
        self.topics: list[Topic] = []
        self.layout = _cdr.Layout()
        self.records: dict[int, tuple[str, int]] = {}
        """By channel id: the prefix of its slots, and where its record starts in the row."""
        self.values: dict[str, NDArray[np.generic]] = {}
        """Arrays (T, …) by slot."""

    def declare(self, topic: str, message_type: str, *, latched: bool = False) -> int:
        """Add a topic and return its channel id."""
        definition, _ = typestore().generate_msgdef(message_type, ros_version=2)
        self.topics.append(Topic(topic, message_type, definition, latched))
        return len(self.topics)

    @contextmanager
    def message(self, topic: str, message_type: str, slot: str) -> Iterator[_cdr.Layout]:
        """Add a topic whose message, laid out in the body, every frame writes."""
        channel = self.declare(topic, message_type)
        self.records[channel] = slot, len(self.layout.template)
        with message_record(self.layout, channel, slot):
            yield self.layout


def _declare_once(frame: _Frame, trajectory: JointTrajectory) -> list[tuple[int, bytes]]:
    """Adds the topics that hold a single message to `frame`: their channel ids and messages."""
    once: list[tuple[int, bytes]] = []
    if trajectory.base_position is None:
        channel = frame.declare("/tf_static", TF_MESSAGE, latched=True)
        once.append((channel, _static_identity(trajectory.base_frame)))
    if trajectory.robot_description:
        channel = frame.declare("/robot_description", STRING, latched=True)
        once.append((channel, _text_message(trajectory.robot_description)))
    return once


def _frame_of(trajectory: JointTrajectory, motion: HumanMotion | None, *, may_be_marked_later: bool = False) -> _Frame:
    frame = _Frame()
    count = len(trajectory.joint_names)
    with frame.message("/joint_states", JOINT_STATE, "joint.") as layout:
        _cdr.joint_state(layout, "", trajectory.joint_names, count, count, slot="joint.")
    frame.values |= {"joint.position": trajectory.position, "joint.velocity": trajectory.velocity}
    if poses := _moving_frames(trajectory, motion):
        with frame.message("/tf", TF_MESSAGE, "tf.") as layout:
            _cdr.transforms(layout, [(parent, child) for parent, child, _, _ in poses], slot="tf.")
        for i, (_, _, position, wxyz) in enumerate(poses):
            frame.values |= {f"tf.{i}.translation": position, f"tf.{i}.rotation": wxyz[:, [1, 2, 3, 0]]}
    linear, angular = trajectory.base_linear_velocity, trajectory.base_angular_velocity
    if linear is not None or angular is not None:
        with frame.message("/base_twist", TWIST, "twist.") as layout:
            _cdr.twist(layout, WORLD, slot="twist.")
        unknown = np.full((trajectory.frames, 3), np.nan)
        frame.values["twist.linear"] = unknown if linear is None else linear
        frame.values["twist.angular"] = unknown if angular is None else angular
    if trajectory.status.any():
        with frame.message("/frame_status", INT8, "status.") as layout:
            _cdr.int8(layout, slot="status.")
        frame.values["status.data"] = trajectory.status
    elif may_be_marked_later:
        frame.declare("/frame_status", INT8)
    return frame


def _moving_frames(trajectory: JointTrajectory, motion: HumanMotion | None) -> list[tuple[str, str, Array, Array]]:
    """(parent, child, position (T, 3) m, orientation (T, 4) wxyz): the robot's base where it moves, then the person's tracked segments."""
    poses = []
    if trajectory.base_position is not None and trajectory.base_orientation is not None:
        base = trajectory.base_frame
        poses.append((_parent_of(base), base, trajectory.base_position, trajectory.base_orientation))
    for i, segment in enumerate(motion.segments if motion is not None else ()):
        assert motion is not None
        if np.isfinite(motion.position[:, i]).all():
            poses.append((WORLD, HUMAN + segment, motion.position[:, i], motion.orientation[:, i]))
    return poses


def _write_frames(file: McapFile, frame: _Frame, stamps: Stamps, before: int = 0) -> None:
    """Write every frame's messages, as many frames a chunk as fit; the rows of one chunk are the template of the next.

    before: frames that the file holds already.
    """
    layout, size = frame.layout, len(frame.layout.template)
    count = min(max(1, _CHUNK_BYTES // size), len(stamps))
    rows = layout.rows(count)
    row_starts = np.arange(count, dtype=np.uint64) * np.uint64(size)
    seconds, nanoseconds = np.divmod(stamps, 1_000_000_000)
    headers = [slot.removesuffix("sec") for slot in layout.slots if slot.endswith(".sec")]
    for start in range(0, len(stamps), count):
        part = slice(start, min(start + count, len(stamps)))
        block, indexes = rows[: part.stop - start], {}
        for slot_name, array in frame.values.items():
            block[slot_name] = array[part]
        for slot in headers:
            block[f"{slot}sec"], block[f"{slot}nanosec"] = seconds[part], nanoseconds[part]
        for channel, (slot, offset) in frame.records.items():
            block[f"{slot}sequence"] = np.arange(before + part.start, before + part.stop)
            block[f"{slot}log_time"] = block[f"{slot}publish_time"] = stamps[part]
            places = row_starts[: len(block)] + np.uint64(offset)
            indexes[channel] = np.stack([stamps[part].astype(np.uint64), places], axis=1)
        file.chunk(block.view(np.uint8).data, indexes)


def _stamps(time: Array) -> Stamps:
    """Whole nanoseconds of `time`, rounded to nearest; seconds are split off first so that no digit is lost in the product."""
    if time[0] < 0 or time[-1] >= 2**31 - 1:
        raise RetargetError(
            f"mcap: time runs from {time[0]:g} s to {time[-1]:g} s; expected within 0 and 2³¹ s (ROS stamps)"
        )
    seconds = np.floor(time)
    stamps: Stamps = seconds.astype(np.int64) * 1_000_000_000 + np.rint((time - seconds) * 1e9).astype(np.int64)
    if (close := np.diff(stamps) <= 0).any():
        frame = int(np.argmax(close)) + 1
        raise RetargetError(
            f"mcap: frames {frame - 1} and {frame} are less than a nanosecond apart, at {time[frame]!r} s"
        )
    return stamps


def _parent_of(base_frame: str) -> str:
    # A frame can't be its own parent: tf would drop the transform.
    return WORLD if base_frame.lstrip("/") != WORLD else "map"


def _static_identity(base_frame: str) -> bytes:
    layout = _cdr.Layout()
    _cdr.transforms(layout, [(_parent_of(base_frame), base_frame)])
    row = layout.rows(1)
    row["0.rotation"] = [0.0, 0.0, 0.0, 1.0]
    return row.tobytes()


def _whole_trajectory(trajectory: JointTrajectory, stamps: Stamps) -> bytes:
    """All frames as one JointTrajectory, to begin when it is received; the first is at 0 from the start."""
    head, joints = _cdr.Layout(), len(trajectory.joint_names)
    _cdr.joint_trajectory_head(head, trajectory.joint_names, trajectory.frames)
    first = head.continued()
    _cdr.joint_trajectory_point(first, joints)
    # Padding before the numbers depends on where a point begins: all but the first begin alike.
    other = _cdr.Layout(origin=first.origin - len(first.template))
    _cdr.joint_trajectory_point(other, joints)
    seconds, nanoseconds = np.divmod(stamps - stamps[0], 1_000_000_000)
    data = bytes(head.template)
    for layout, part in ((first, slice(0, 1)), (other, slice(1, None))):
        rows = layout.rows(len(stamps[part]))
        rows["positions"], rows["velocities"] = trajectory.position[part], trajectory.velocity[part]
        rows["sec"], rows["nanosec"] = seconds[part], nanoseconds[part]
        data += rows.tobytes()
    return data


def _text_message(text: str) -> bytes:
    layout = _cdr.Layout()
    _cdr.string(layout, text)
    return bytes(layout.template)


def _write_once(file: McapFile, messages: list[tuple[int, bytes]], stamp: int) -> None:
    """Write single messages, at the trajectory's first stamp, as a chunk of their own at the start."""
    data, indexes = b"", {}
    for channel, payload in messages:
        layout = _cdr.Layout()
        with message_record(layout, channel, ""):
            layout.raw(payload)
        row = layout.rows(1)
        row["log_time"] = row["publish_time"] = stamp
        indexes[channel] = np.array([[stamp, len(data)]], np.uint64)
        data += row.tobytes()
    file.chunk(memoryview(data), indexes)


def _metadata(trajectory: JointTrajectory) -> dict[str, str]:
    return {
        "schema": _trajectory.SCHEMA,
        "robot": trajectory.robot,
        "base": "fixed" if trajectory.base_position is None else "floating",
        "base_frame": trajectory.base_frame,
        "joint_names": json.dumps(trajectory.joint_names),
        "provenance": _trajectory.provenance_json(trajectory),
    }
