"""MCAP with profile `ros2`: the pipe format, opened by Foxglove, ROS 2 and rosbags alike.

| topic | type | holds |
|---|---|---|
| `/joint_states` | sensor_msgs/msg/JointState | position in rad, velocity in rad/s; effort empty |
| `/tf` | tf2_msgs/msg/TFMessage | pose of the base frame in `world` (ROS order: quaternion **xyzw**), with a moving base; pose of `human/<segment>` in `world` for each tracked segment of the person, where the motion is written along |
| `/tf_static` | tf2_msgs/msg/TFMessage | `world` → base frame, identity, once; only with a fixed base |
| `/base_twist` | geometry_msgs/msg/TwistStamped | twist of the base link's origin in `world`, m/s and rad/s; a half that is unknown is NaN |
| `/frame_status` | std_msgs/msg/Int8 | the frames' status; only when some frame is marked |
| `/robot_description` | std_msgs/msg/String | URDF, once; only when there is one |
| `/joint_trajectory` | trajectory_msgs/msg/JointTrajectory | style `joint_trajectory` only: all frames in one message, for a trajectory controller: positions and velocities, time from start 0 in the first, stamp 0 (begin when received) |

Joints stand in the robot's own order (that of its URDF), named in every message. The person's frames are the identity, all axes along the
world's, in T-pose facing +X. `retarget convert --human` writes them; readers of the trajectory don't need them.

Names, robot, kind of base and provenance stand in a metadata record named `retarget`. A recording that was converted in blocks as it arrived
(`retarget convert -o -`) has a second one at the end, complete, with what was not known before: the last one counts. There, `/frame_status`
is always declared. Time 0 of the trajectory is stamp 0, so the
same trajectory always gives the same bytes. Stamps are whole nanoseconds: times come back within 0.5 ns, everything else bit for bit.
Times must be in [0, 2³¹) s and at least a nanosecond apart.

Any other MCAP with JointState messages can be read too, and one without any but with a JointTrajectory. There, time starts at the first message; a missing or NaN velocity is
differentiated from the positions; and the base is the root link of `/robot_description`, its pose the transform from its direct
parent, interpolated to the joint states' stamps.

As a recording of a person, from a file or a pipe, MCAP gives what `rosbag` says of tf, poses and link states; messages may be ROS 2
(CDR) or ROS 1, Foxglove's FrameTransform, FrameTransforms and PoseInFrame also JSON or Protobuf. A suit whose frames are on one topic is
read in parts by `retarget convert -o -`: which frames there are, the time base and the person's size are then known from the first 30 s, and
messages may come 2 s late. Where times are uneven only later, an even grid begins there.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, BinaryIO, cast

from retarget.core.types import HumanMotion, JointTrajectory, TrackerRecording
from retarget.formats import _mcap_reader, _mcap_trajectory
from retarget.formats._describe import trajectory_facts
from retarget.formats._mcap_reader import MAGIC
from retarget.formats._mcap_recording import METADATA, Recording
from retarget.formats._ros_recording import RosRecording
from retarget.formats.base import Format, TrackerOptions, TrajectoryOptions


def write_trajectory(stream: BinaryIO, trajectory: JointTrajectory, style: str = "default") -> None:
    """Write `trajectory` as MCAP to a stream that need not seek. Raises `RetargetError` for times that MCAP can't hold."""
    _mcap_trajectory.write(stream, trajectory, style)


def write_with_motion(stream: BinaryIO, trajectory: JointTrajectory, style: str, motion: HumanMotion) -> None:
    """As `write_trajectory`, and the person beside the robot. Raises `RetargetError` also for a motion of other times."""
    _mcap_trajectory.write(stream, trajectory, style, motion)


def write_parts(stream: BinaryIO, parts: Iterable[JointTrajectory]) -> None:
    """Write a trajectory that comes in consecutive parts; see `Format.write_parts`. Raises `RetargetError` as `write_trajectory`."""
    _mcap_trajectory.write_parts(stream, parts)


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
    return next(stream_recording(stream, name, options, math.inf))


def stream_recording(
    stream: BinaryIO, name: str, options: TrackerOptions, first_s: float
) -> Iterator[HumanMotion | TrackerRecording | None]:
    """As `read_recording`, a suit's motion in parts as it arrives; see `Format.stream_recording`. Raises as it does, when it is met.

    Raises `FormatError` also for messages that come more than `_ros_stream.SLACK_S` behind later ones.
    """
    from retarget.formats._ros_stream import SuitStream

    hashed = _Hashed(stream)
    recording = RosRecording(name, FORMAT.name, options)
    suit = SuitStream(recording, first_s)
    for item in _mcap_reader.read(cast(BinaryIO, hashed), name):
        if isinstance(item, _mcap_reader.Batch):
            yield from suit.add(item)
        elif item.name == METADATA:
            yield None
            return
    if rest := _mcap_reader.count_rest(cast(BinaryIO, hashed)):
        recording.warnings.append(f"{rest} bytes after the end of the MCAP document were not read")
    yield suit.end(hashed.digest.hexdigest())


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
    stream_recording=stream_recording,
    describe_trackers=describe,
    is_own_output=_is_own_output,
    write_trajectory=write_trajectory,
    write_with_motion=write_with_motion,
    write_parts=write_parts,
    pipeable=True,
    styles=("default", _mcap_trajectory.WITH_JOINT_TRAJECTORY),
)
