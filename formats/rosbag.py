"""Recordings of ROS 1 (`.bag`) and ROS 2 (rosbag2 folders, bare `.db3`): a person's motion or trackers, from tf and other poses.

A rosbag2 folder is named itself; its storage may be SQLite or MCAP. Read are tf2_msgs/TFMessage (flat or a tree, with `/tf_static`),
geometry_msgs TransformStamped, PoseStamped, PoseWithCovarianceStamped and PoseArray, nav_msgs/Odometry, the Xsens drivers'
`LinkStateArray`, and Foxglove's FrameTransform, FrameTransforms and PoseInFrame. MCAP files and streams give the same, see `mcap`.

Positions are in metres, quaternions **xyzw**, as in ROS; the world has Z up unless declared otherwise. The drivers of Xsens, Vive and libsurvive are known by
their frames' names; a map (`--frames map.toml`) names any others:

```toml
root = "world"                   # poses are in this frame (default: the root of the tree)
[segments]                       # a suit: canonical segment = frame
Pelvis = "hips"
[rotations]                      # wxyz of a frame in T-pose facing +X (default the identity)
Pelvis = [0.5, 0.5, 0.5, 0.5]
[trackers]                       # or trackers: name or role = frame
waist = "tracker_LHR_1DB92FB1"
[poses]                          # names of a PoseArray's poses
"/mocap" = ["hips", "chest"]
```

`prefix = "skeleton_1_"` chooses one of several people. A leading `/` of a frame does not count. Time is the messages' own stamp
(`--clock header`) or the recorder's (`--clock log`). Frames with rates of their own are interpolated onto one time base; what was not
measured is interpolated, marked and counted. Old `.db3` hold no definitions: `--msg-def FOLDER` has those of `LinkStateArray`.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from typing import Any, BinaryIO

from retarget.core.errors import FormatError
from retarget.core.types import HumanMotion, TrackerRecording
from retarget.formats import _ros_source, rosbag2
from retarget.formats._describe import trajectory_facts
from retarget.formats._mcap_reader import Metadata
from retarget.formats._mcap_recording import METADATA
from retarget.formats._ros_recording import RosRecording, is_wanted
from retarget.formats.base import Format, TrackerOptions


def read_recording(stream: BinaryIO, name: str, options: TrackerOptions) -> HumanMotion | TrackerRecording | None:
    """The motion or the trackers in a bag, a `.db3`, or the folder whose metadata.yaml `stream` is; None for a robot's trajectory.

    Raises `FormatError` for a damaged recording and one without known frames, `UsageError` for options that don't fit.
    """
    recording, is_robot = _collected(stream, name, options)
    return None if is_robot else recording.result(_ros_source.digest(stream, name))[0]


def describe(stream: BinaryIO, name: str, options: TrackerOptions) -> Mapping[str, Any]:
    """Facts for `retarget info`: of a folder with a robot's trajectory, else of topics, frames, and what they are of a person."""
    recording, is_robot = _collected(stream, name, options)
    folder = _ros_source.folder_of(stream)
    if is_robot and folder is not None:
        with suppress(FormatError):  # joint states that make no trajectory
            return trajectory_facts(rosbag2.FORMAT.name, rosbag2.read_folder(folder, name))
    return recording.describe()


def _collected(stream: BinaryIO, name: str, options: TrackerOptions) -> tuple[RosRecording, bool]:
    """The recording, and whether it is a robot's: written here, or one by its joint states."""
    recording, own = RosRecording(name, FORMAT.name, options), False
    for item in _ros_source.read(stream, name, is_wanted):
        if not isinstance(item, Metadata):
            recording.add(item)
        elif item.name == METADATA:
            own = True
    return recording, own or recording.is_robot()


FORMAT = Format(
    name="rosbag",
    description="ROS 1 bags, rosbag2 folders and .db3: tf, poses, odometry, Xsens link states",
    suffixes=(".bag", ".db3"),
    magic=(_ros_source.BAG_MAGIC, _ros_source.SQLITE_MAGIC, _ros_source.FOLDER_MAGIC),
    read_recording=read_recording,
    describe_trackers=describe,
)
