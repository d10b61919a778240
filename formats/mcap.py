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
world's, in T-pose facing +X. `retarget convert` writes them unless told `--no-human`; readers of the trajectory don't need them.

Names, robot, kind of base and provenance stand in a metadata record named `retarget`. Time 0 of the trajectory is stamp 0, so the
same trajectory always gives the same bytes. Stamps are whole nanoseconds: times come back within 0.5 ns, everything else bit for bit.
Times must be in [0, 2³¹) s and at least a nanosecond apart.

Any other MCAP with JointState messages can be read too, and one without any but with a JointTrajectory. There, time starts at the first message; a missing or NaN velocity is
differentiated from the positions; and the base is the root link of `/robot_description`, its pose the transform from its direct
parent, interpolated to the joint states' stamps.
"""

from __future__ import annotations

from typing import BinaryIO

from retarget.core.types import HumanMotion, JointTrajectory
from retarget.formats import _mcap_reader, _mcap_trajectory
from retarget.formats._mcap_reader import MAGIC
from retarget.formats._mcap_recording import Recording
from retarget.formats.base import Format, TrajectoryOptions


def write_trajectory(stream: BinaryIO, trajectory: JointTrajectory, style: str = "default") -> None:
    """Write `trajectory` as MCAP to a stream that need not seek. Raises `RetargetError` for times that MCAP can't hold."""
    _mcap_trajectory.write(stream, trajectory, style)


def write_with_motion(stream: BinaryIO, trajectory: JointTrajectory, style: str, motion: HumanMotion) -> None:
    """As `write_trajectory`, and the person beside the robot. Raises `RetargetError` also for a motion of other times."""
    _mcap_trajectory.write(stream, trajectory, style, motion)


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


FORMAT = Format(
    name="mcap",
    description="MCAP, profile ros2: JointState, TF and URDF, for Foxglove and ROS 2",
    suffixes=(".mcap",),
    magic=(MAGIC,),
    read_trajectory=read_trajectory,
    write_trajectory=write_trajectory,
    write_with_motion=write_with_motion,
    pipeable=True,
    styles=("default", _mcap_trajectory.WITH_JOINT_TRAJECTORY),
)
