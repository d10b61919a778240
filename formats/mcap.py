"""MCAP with profile `ros2`: the pipe format, opened by Foxglove, ROS 2 and rosbags alike.

| topic | type | holds |
|---|---|---|
| `/joint_states` | sensor_msgs/msg/JointState | position in rad, velocity in rad/s; effort empty |
| `/tf` | tf2_msgs/msg/TFMessage | pose of the base frame in `world` (ROS order: quaternion **xyzw**); only with a moving base |
| `/tf_static` | tf2_msgs/msg/TFMessage | `world` → base frame, identity, once; only with a fixed base |
| `/base_twist` | geometry_msgs/msg/TwistStamped | twist of the base link's origin in `world`, m/s and rad/s; a half that is unknown is NaN |
| `/frame_status` | std_msgs/msg/Int8 | the frames' status; only when some frame is marked |
| `/robot_description` | std_msgs/msg/String | URDF, once; only when there is one |

Names, robot, kind of base and provenance stand in a metadata record named `retarget`. Time 0 of the trajectory is stamp 0, so the
same trajectory always gives the same bytes. Stamps are whole nanoseconds: times come back within 0.5 ns, everything else bit for bit.
Times must be in [0, 2³¹) s and at least a nanosecond apart.

Any other MCAP with JointState messages can be read too. There, time starts at the first message; a missing or NaN velocity is
differentiated from the positions; and the base is the root link of `/robot_description`, its pose the transform from its direct
parent, interpolated to the joint states' stamps.

As a recording of a person, from a file or a pipe, MCAP gives what `rosbag` says of tf, poses and link states; messages may be ROS 2
(CDR) or ROS 1, Foxglove's FrameTransform, FrameTransforms and PoseInFrame also JSON or Protobuf.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, BinaryIO, cast

import numpy as np
from numpy.typing import NDArray
from retarget.core.errors import RetargetError
from retarget.core.types import Array, HumanMotion, JointTrajectory, TrackerRecording
from retarget.formats import _cdr, _mcap_reader, _trajectory
from retarget.formats._describe import trajectory_facts
from retarget.formats._mcap_reader import MAGIC
from retarget.formats._mcap_recording import INT8, METADATA, STRING, TWIST, WORLD, Recording
from retarget.formats._mcap_writer import McapFile, Topic, message_record
from retarget.formats._ros_messages import JOINT_STATE, TF_MESSAGE, Stamps, typestore
from retarget.formats._ros_recording import RosRecording
from retarget.formats.base import Format, TrackerOptions, TrajectoryOptions

_CHUNK_BYTES = 1 << 20


def write_trajectory(stream: BinaryIO, trajectory: JointTrajectory, _style: str = "default") -> None:
    """Write `trajectory` as MCAP to a stream that need not seek. Raises `RetargetError` for times that MCAP can't hold."""
    stamps = _stamps(trajectory.time)
    frame = _frame_of(trajectory)
    once: list[tuple[int, bytes]] = []
    if trajectory.base_position is None:
        once.append((frame.declare("/tf_static", TF_MESSAGE), _static_identity(trajectory.base_frame)))
    if trajectory.robot_description:
        once.append((frame.declare("/robot_description", STRING), _text_message(trajectory.robot_description)))
    file = McapFile(stream, frame.topics, {METADATA: _metadata(trajectory)})
    if once:
        _write_once(file, once, int(stamps[0]))
    _write_frames(file, frame, stamps)
    file.finish()


class _Frame:
    """What every frame writes: one row that holds a message of each topic, and the arrays that go into its slots."""

    def __init__(self) -> None:
        self.topics: list[Topic] = []
        self.layout = _cdr.Layout()
        self.records: dict[int, tuple[str, int]] = {}
        """By channel id: the prefix of its slots, and where its record starts in the row."""
        self.values: dict[str, NDArray[np.generic]] = {}
        """Arrays (T, …) by slot."""

    def declare(self, topic: str, message_type: str) -> int:
        """Add a topic and return its channel id."""
        definition, _ = typestore().generate_msgdef(message_type, ros_version=2)
        self.topics.append(Topic(topic, message_type, definition))
        return len(self.topics)

    @contextmanager
    def message(self, topic: str, message_type: str, slot: str) -> Iterator[_cdr.Layout]:
        """Add a topic whose message, laid out in the body, every frame writes."""
        channel = self.declare(topic, message_type)
        self.records[channel] = slot, len(self.layout.template)
        with message_record(self.layout, channel, slot):
            yield self.layout


def _frame_of(trajectory: JointTrajectory) -> _Frame:
    frame = _Frame()
    count = len(trajectory.joint_names)
    with frame.message("/joint_states", JOINT_STATE, "joint.") as layout:
        _cdr.joint_state(layout, "", trajectory.joint_names, count, count, slot="joint.")
    frame.values |= {"joint.position": trajectory.position, "joint.velocity": trajectory.velocity}
    if trajectory.base_position is not None and trajectory.base_orientation is not None:
        with frame.message("/tf", TF_MESSAGE, "tf.") as layout:
            _cdr.transform(layout, _parent_of(trajectory.base_frame), trajectory.base_frame, slot="tf.")
        xyzw = trajectory.base_orientation[:, [1, 2, 3, 0]]
        frame.values |= {"tf.translation": trajectory.base_position, "tf.rotation": xyzw}
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
    return frame


def _write_frames(file: McapFile, frame: _Frame, stamps: Stamps) -> None:
    """Write every frame's messages, as many frames a chunk as fit; the rows of one chunk are the template of the next."""
    layout, size = frame.layout, len(frame.layout.template)
    count = min(max(1, _CHUNK_BYTES // size), len(stamps))
    rows = layout.rows(count)
    row_starts = np.arange(count, dtype=np.uint64) * np.uint64(size)
    seconds, nanoseconds = np.divmod(stamps, 1_000_000_000)
    for start in range(0, len(stamps), count):
        part = slice(start, min(start + count, len(stamps)))
        block, indexes = rows[: part.stop - start], {}
        for slot_name, array in frame.values.items():
            block[slot_name] = array[part]
        for channel, (slot, offset) in frame.records.items():
            block[f"{slot}sequence"] = np.arange(part.start, part.stop)
            block[f"{slot}log_time"] = block[f"{slot}publish_time"] = stamps[part]
            if f"{slot}sec" in layout.slots:
                block[f"{slot}sec"], block[f"{slot}nanosec"] = seconds[part], nanoseconds[part]
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
    _cdr.transform(layout, _parent_of(base_frame), base_frame)
    row = layout.rows(1)
    row["rotation"] = [0.0, 0.0, 0.0, 1.0]
    return row.tobytes()


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


def read_trajectory(stream: BinaryIO, name: str, _options: TrajectoryOptions | None = None) -> JointTrajectory:
    """The trajectory in an MCAP stream, read once without seeking; see the module for what other recordings give.

    Raises `FormatError` for a broken or truncated file, one without joint states, and joint states that don't fit together.
    """
    recording = Recording(name)
    for item in _mcap_reader.read(stream, name):
        recording.add(item)
    if rest := _mcap_reader.count_rest(stream):
        recording.warnings.append(f"{rest} bytes after the end of the MCAP document were not read")
    return recording.trajectory()


class _Hashed:
    """A stream whose bytes are hashed as they are read."""

    def __init__(self, stream: BinaryIO) -> None:
        self._stream, self.digest = stream, hashlib.sha256()

    def read(self, size: int = -1) -> bytes:
        """As the stream's."""
        block = self._stream.read(size)
        self.digest.update(block)
        return block


def read_recording(stream: BinaryIO, name: str, options: TrackerOptions) -> HumanMotion | TrackerRecording | None:
    """The motion or the trackers in an MCAP stream, read once without seeking; None for a robot's trajectory.

    Raises `FormatError` for a broken or truncated file and one without known frames, `UsageError` for options that don't fit.
    """
    hashed = _Hashed(stream)
    recording = RosRecording(name, FORMAT.name, options)
    for item in _mcap_reader.read(cast(BinaryIO, hashed), name):
        if isinstance(item, _mcap_reader.Batch):
            recording.add(item)
        elif item.name == METADATA:
            return None
    if rest := _mcap_reader.count_rest(cast(BinaryIO, hashed)):
        recording.warnings.append(f"{rest} bytes after the end of the MCAP document were not read")
    if recording.is_robot():
        return None
    return recording.result(hashed.digest.hexdigest())[0]


def describe(stream: BinaryIO, name: str, options: TrackerOptions) -> Mapping[str, Any]:
    """Facts for `retarget info`: of a robot's trajectory, else of topics, frames, and what they are of a person."""
    # What a robot's trajectory is made of is parsed only where it is one; a pipe can't be read again, so there both are.
    start = stream.tell() if stream.seekable() else None
    robot, recording = Recording(name), RosRecording(name, FORMAT.name, options)
    own = False
    for item in _mcap_reader.read(stream, name):
        own = own or (isinstance(item, _mcap_reader.Metadata) and item.name == METADATA)
        if own and start is not None:
            break
        if isinstance(item, _mcap_reader.Batch) and not own:
            recording.add(item)
        if start is None:
            robot.add(item)
    if not own and not recording.is_robot():
        return recording.describe()
    if start is not None:
        stream.seek(start)
        return trajectory_facts(FORMAT.name, read_trajectory(stream, name))
    if rest := _mcap_reader.count_rest(stream):
        robot.warnings.append(f"{rest} bytes after the end of the MCAP document were not read")
    return trajectory_facts(FORMAT.name, robot.trajectory())


def _is_own_output(head: bytes) -> bool:
    name = METADATA.encode()
    return len(name).to_bytes(4, "little") + name in head


FORMAT = Format(
    name="mcap",
    description="MCAP, profile ros2: JointState, TF and URDF, for Foxglove and ROS 2; recordings of tf, poses, link states",
    suffixes=(".mcap",),
    magic=(MAGIC,),
    read_trajectory=read_trajectory,
    read_recording=read_recording,
    describe_trackers=describe,
    is_own_output=_is_own_output,
    write_trajectory=write_trajectory,
    pipeable=True,
)
