"""ROS recordings of a known motion, written by rosbags' own writers the way the drivers publish. Nothing of the reader under test."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.spatial.transform import Rotation

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
EVO_BAG, EVO_FOLDER = DATA / "bag" / "evo_tf_example.bag", DATA / "bag" / "evo_tf_example"
VICON_BAG = DATA / "bag" / "rigid-body-motion_test.bag"

Array = NDArray[np.float64]
START_NS = 1_714_741_164_111_822_142

LINK_STATE = "std_msgs/Header header\ngeometry_msgs/Pose pose\ngeometry_msgs/Twist twist\ngeometry_msgs/Accel accel\n"
LINK_STATE_ARRAY = "xsens_mvn_ros_msgs/LinkState[] states\n"
LINKS = "xsens_mvn_ros_msgs/msg/LinkStateArray"

XSENS = {
    "Pelvis": "pelvis",
    "L5": "l5",
    "L3": "l3",
    "T12": "t12",
    "T8": "t8",
    "Neck": "neck",
    "Head": "head",
    "RightShoulder": "right_shoulder",
    "RightUpperArm": "right_upper_arm",
    "RightForeArm": "right_forearm",
    "RightHand": "right_hand",
    "LeftShoulder": "left_shoulder",
    "LeftUpperArm": "left_upper_arm",
    "LeftForeArm": "left_forearm",
    "LeftHand": "left_hand",
    "RightUpperLeg": "right_upper_leg",
    "RightLowerLeg": "right_lower_leg",
    "RightFoot": "right_foot",
    "RightToe": "right_toe",
    "LeftUpperLeg": "left_upper_leg",
    "LeftLowerLeg": "left_lower_leg",
    "LeftFoot": "left_foot",
    "LeftToe": "left_toe",
}


class Sent(NamedTuple):
    """One message to be recorded: log_time in ns."""

    topic: str
    message_type: str
    log_time: int
    message: Any


class Ros:
    """Makes messages of one ROS version."""

    def __init__(self, version: int) -> None:
        self.version = version
        self.store = get_typestore(Stores.ROS1_NOETIC if version == 1 else Stores.ROS2_HUMBLE)
        if version == 1:
            text = "geometry_msgs/TransformStamped[] transforms"
            self.store.register(get_types_from_msg(text, "tf2_msgs/msg/TFMessage"))
        self.store.register(get_types_from_msg(LINK_STATE, "xsens_mvn_ros_msgs/msg/LinkState"))
        self.store.register(get_types_from_msg(LINK_STATE_ARRAY, LINKS))

    def make(self, name: str, *arguments: Any) -> Any:
        """An object of message type `package/Name`."""
        package, _, short = name.partition("/")
        return self.store.types[f"{package}/msg/{short}"](*arguments)

    def header(self, stamp: int, frame: str) -> Any:
        time = self.make("builtin_interfaces/Time", *(int(part) for part in divmod(stamp, 10**9)))
        return self.make("std_msgs/Header", *([0] if self.version == 1 else []), time, frame)

    def vector(self, values: Sequence[float], name: str = "Vector3") -> Any:
        return self.make(f"geometry_msgs/{name}", *(float(value) for value in values))

    def pose(self, position: Array, wxyz: Array) -> Any:
        return self.make(
            "geometry_msgs/Pose", self.vector(position, "Point"), self.vector(wxyz[[1, 2, 3, 0]], "Quaternion")
        )

    def transform(self, stamp: int, parent: str, child: str, position: Array, wxyz: Array) -> Any:
        turned = self.vector(wxyz[[1, 2, 3, 0]], "Quaternion")
        moved = self.make("geometry_msgs/Transform", self.vector(position), turned)
        return self.make("geometry_msgs/TransformStamped", self.header(stamp, parent), child, moved)

    def tf(self, *transforms: Any) -> Any:
        return self.make("tf2_msgs/TFMessage", list(transforms))

    def pose_stamped(self, stamp: int, parent: str, position: Array, wxyz: Array) -> Any:
        return self.make("geometry_msgs/PoseStamped", self.header(stamp, parent), self.pose(position, wxyz))

    def pose_with_covariance(self, stamp: int, parent: str, position: Array, wxyz: Array) -> Any:
        pose = self.make("geometry_msgs/PoseWithCovariance", self.pose(position, wxyz), np.zeros(36))
        return self.make("geometry_msgs/PoseWithCovarianceStamped", self.header(stamp, parent), pose)

    def odometry(self, stamp: int, parent: str, child: str, position: Array, wxyz: Array) -> Any:
        pose = self.make("geometry_msgs/PoseWithCovariance", self.pose(position, wxyz), np.zeros(36))
        twist = self.make("geometry_msgs/TwistWithCovariance", self._twist(), np.zeros(36))
        return self.make("nav_msgs/Odometry", self.header(stamp, parent), child, pose, twist)

    def pose_array(self, stamp: int, parent: str, position: Array, wxyz: Array) -> Any:
        poses = [self.pose(p, q) for p, q in zip(position, wxyz, strict=True)]
        return self.make("geometry_msgs/PoseArray", self.header(stamp, parent), poses)

    def joint_state(self, stamp: int, names: Sequence[str]) -> Any:
        position = np.zeros(len(names))
        return self.make(
            "sensor_msgs/JointState", self.header(stamp, ""), list(names), position, np.zeros(0), np.zeros(0)
        )

    def text(self, content: str) -> Any:
        return self.make("std_msgs/String", content)

    def link_states(self, stamp: int, names: Sequence[str], position: Array, wxyz: Array) -> Any:
        accel = self.make("geometry_msgs/Accel", self.vector([0, 0, 0]), self.vector([0, 0, 0]))
        states = [
            self.make("xsens_mvn_ros_msgs/LinkState", self.header(stamp, name), self.pose(p, q), self._twist(), accel)
            for name, p, q in zip(names, position, wxyz, strict=True)
        ]
        return self.make("xsens_mvn_ros_msgs/LinkStateArray", states)

    def _twist(self) -> Any:
        return self.make("geometry_msgs/Twist", self.vector([0, 0, 0]), self.vector([0, 0, 0]))


def write_bag(path: Path, ros: Ros, messages: Iterator[Sent] | Sequence[Sent]) -> Path:
    """A ROS 1 bag."""
    connections: dict[str, Any] = {}
    with Writer1(path) as writer:
        for sent in messages:
            if sent.topic not in connections:
                connections[sent.topic] = writer.add_connection(sent.topic, sent.message_type, typestore=ros.store)
            writer.write(
                connections[sent.topic], sent.log_time, ros.store.serialize_ros1(sent.message, sent.message_type)
            )
    return path


def write_folder(path: Path, ros: Ros, messages: Iterator[Sent] | Sequence[Sent], *, mcap: bool = False) -> Path:
    """A rosbag2 folder; its one storage file is beside metadata.yaml, see `storage`."""
    connections: dict[str, Any] = {}
    plugin = StoragePlugin.MCAP if mcap else StoragePlugin.SQLITE3
    with Writer2(path, version=9, storage_plugin=plugin) as writer:
        for sent in messages:
            if sent.topic not in connections:
                connections[sent.topic] = writer.add_connection(sent.topic, sent.message_type, typestore=ros.store)
            writer.write(
                connections[sent.topic], sent.log_time, ros.store.serialize_cdr(sent.message, sent.message_type)
            )
    return path


def storage(folder: Path) -> Path:
    """The storage file of a rosbag2 folder that has one."""
    (found,) = [path for path in folder.iterdir() if path.suffix in (".db3", ".mcap")]
    return found


def mcap_bytes(
    channels: Sequence[tuple[str, str, str, str, bytes]], messages: Sequence[tuple[str, int, bytes]]
) -> bytes:
    """An MCAP of (topic, schema name, schema encoding, message encoding, schema) and (topic, log time, payload)."""
    from mcap.writer import Writer

    stream = io.BytesIO()
    writer = Writer(stream)
    writer.start()
    ids = {}
    for topic, name, schema_encoding, encoding, schema in channels:
        ids[topic] = writer.register_channel(topic, encoding, writer.register_schema(name, schema_encoding, schema))
    for topic, log_time, payload in messages:
        writer.add_message(ids[topic], log_time, payload, log_time)
    writer.finish()
    return stream.getvalue()


def stamps(time: Array) -> list[int]:
    """Whole ns of times in s, from `START_NS`."""
    return [START_NS + int(ns) for ns in np.rint(np.asarray(time) * 1e9)]


def hanging_arms(segments: Sequence[str], wxyz: Array) -> Array:
    """Orientations (T, S, 4) as the Xsens drivers publish those of the arms: turned by ∓90° about their own X."""
    turned = wxyz.copy()
    for column, segment in enumerate(segments):
        if segment.endswith(("UpperArm", "ForeArm", "Hand")):
            by = Rotation.from_euler("x", -90 if segment.startswith("Right") else 90, degrees=True)
            own = Rotation.from_quat(wxyz[:, column], scalar_first=True)
            turned[:, column] = (own * by).as_quat(scalar_first=True)
    return turned


Select = Callable[[int, int], bool]


def flat_tf(
    ros: Ros, motion: Any, wxyz: Array, *, prefix: str = "skeleton_", root: str = "world", apart_ns: int = 0
) -> Iterator[Sent]:
    """`/tf` of every segment in the world, one message a segment, as `sendTransform` does, each stamped `apart_ns` later."""
    for frame, stamp in enumerate(stamps(motion.time)):
        for column, segment in enumerate(motion.segments):
            name = prefix + XSENS[segment]
            at = stamp + column * apart_ns
            one = ros.transform(at, root, name, motion.position[frame, column], wxyz[frame, column])
            yield Sent("/tf", "tf2_msgs/msg/TFMessage", at + 1000, ros.tf(one))


def tree_tf(ros: Ros, motion: Any, wxyz: Array, parents: dict[str, str | None], dropped: Select) -> Iterator[Sent]:
    """`/tf` of every segment in its parent, without those for which dropped(frame, column); one message a frame."""
    own = [Rotation.from_quat(wxyz[:, column], scalar_first=True) for column in range(len(motion.segments))]
    at = {segment: column for column, segment in enumerate(motion.segments)}
    local: dict[int, tuple[Array, Array]] = {}
    for segment, column in at.items():
        parent = parents[segment]
        if parent is None:
            local[column] = motion.position[:, column], wxyz[:, column]
        else:
            outer = own[at[parent]].inv()
            moved = outer.apply(motion.position[:, column] - motion.position[:, at[parent]])
            local[column] = moved, (outer * own[column]).as_quat(scalar_first=True)
    for frame, stamp in enumerate(stamps(motion.time)):
        transforms = []
        for segment, column in at.items():
            parent = parents[segment]
            if dropped(frame, column):
                continue
            name = "world" if parent is None else f"skeleton_{XSENS[parent]}"
            p, q = local[column]
            transforms.append(ros.transform(stamp, name, f"skeleton_{XSENS[segment]}", p[frame], q[frame]))
        if transforms:
            yield Sent("/tf", "tf2_msgs/msg/TFMessage", stamp + 1000, ros.tf(*transforms))


def link_states(ros: Ros, motion: Any, wxyz: Array) -> Iterator[Sent]:
    """`/link_states`, whose headers name the links."""
    names = [XSENS[segment] for segment in motion.segments]
    for frame, stamp in enumerate(stamps(motion.time)):
        message = ros.link_states(stamp, names, motion.position[frame], wxyz[frame])
        yield Sent("/link_states", LINKS, stamp + 1000, message)
