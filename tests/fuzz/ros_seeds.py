"""Small ROS recordings to mutate, by the writers of rosbags and mcap: a person's tf, poses, link states, Foxglove's messages; a robot's."""

from __future__ import annotations

import io
import json
import sqlite3
import tempfile
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType, Writer

from tests.formats import protobuf
from tests.formats.ros_recordings import (
    LINK_STATE,
    LINK_STATE_ARRAY,
    LINKS,
    START_NS,
    XSENS,
    Ros,
    Sent,
    storage,
    write_bag,
    write_folder,
)

TF, POSE, JOINTS = "tf2_msgs/msg/TFMessage", "geometry_msgs/msg/PoseStamped", "sensor_msgs/msg/JointState"
ODOMETRY, ARRAY = "nav_msgs/msg/Odometry", "geometry_msgs/msg/PoseArray"
_FRAMES = 5
_WXYZ = np.array([1.0, 0.0, 0.0, 0.0])
_TURNED = np.array([0.6, 0.0, 0.8, 0.0])

FRAMES_TOML = b"""root = "world"
prefix = "skeleton_"

[trackers]
waist = "waist"
"chest" = "chest"

[poses]
"/mocap" = ["hips", "chest"]
"""
SUIT_TOML = b"""root = "world"
[segments]
Pelvis = "waist"
RightHand = "chest"
[rotations]
Pelvis = [1, 0, 0, 0.0]
RightHand = [0.5, 0.5, 0.5, 0.5]
"""
MESSAGE_DEFINITIONS = (
    LINK_STATE_ARRAY.encode(),
    b"# states of all links\n" + LINK_STATE_ARRAY.encode() + b"uint8 GOOD=1\nstring<=5 note\nfloat64[3] gravity\n",
)


def _stamp(frame: int) -> int:
    return START_NS + frame * 10_000_000


def trackers(ros: Ros) -> list[Sent]:
    """A tree of three frames, one of them static, and poses beside it."""
    fixed = ros.transform(START_NS, "world", "room", np.array([0.0, 0.0, 0.1]), _TURNED)
    sent = [Sent("/tf_static", TF, START_NS, ros.tf(fixed))]
    for frame in range(_FRAMES):
        at, stamp = np.array([0.1 * frame, 0.2, 1.0]), _stamp(frame)
        waist = ros.transform(stamp, "room", "waist", at, _WXYZ)
        sent.append(Sent("/tf", TF, stamp, ros.tf(waist, ros.transform(stamp, "waist", "chest", at, _TURNED))))
        sent.append(Sent("/left_foot_pose", POSE, stamp, ros.pose_stamped(stamp, "world", at, _WXYZ)))
        sent.append(Sent("/odom", ODOMETRY, stamp, ros.odometry(stamp, "world", "right_foot", at, _WXYZ)))
    return sent


def _suit(ros: Ros) -> list[Sent]:
    """Link states of all segments in three frames."""
    names = list(XSENS.values())
    at, turned = np.linspace(0.0, 1.0, 3 * len(names)).reshape(-1, 3), np.tile(_WXYZ, (len(names), 1))
    return [
        Sent("/link_states", LINKS, _stamp(frame), ros.link_states(_stamp(frame), names, at + 0.01 * frame, turned))
        for frame in range(3)
    ]


@cache
def bags() -> Sequence[bytes]:
    """ROS 1: trackers in a bag without compression and in one packed by LZ4, and a suit's link states."""
    from rosbags.rosbag1 import Writer as Writer1

    ros = Ros(1)
    with tempfile.TemporaryDirectory() as folder:
        plain = write_bag(Path(folder) / "a.bag", ros, trackers(ros)).read_bytes()
        links = write_bag(Path(folder) / "b.bag", ros, _suit(ros)).read_bytes()
        packed = Writer1(Path(folder) / "c.bag")
        packed.set_compression(Writer1.CompressionFormat.LZ4)
        with packed:
            connection = packed.add_connection("/tf", TF, typestore=ros.store)
            for sent in trackers(ros):
                if sent.topic == "/tf":
                    packed.write(connection, sent.log_time, ros.store.serialize_ros1(sent.message, TF))
        return [plain, links, (Path(folder) / "c.bag").read_bytes()]


def talk() -> bytes:
    """A bag of one message that is no pose."""
    ros = Ros(1)
    with tempfile.TemporaryDirectory() as folder:
        text = Sent("/chatter", "std_msgs/msg/String", START_NS, ros.text("hello"))
        return write_bag(Path(folder) / "a.bag", ros, [text]).read_bytes()


@cache
def databases() -> Sequence[bytes]:
    """`.db3` in small pages: with the definitions of its messages, and an old one without."""
    ros, found = Ros(2), []
    with tempfile.TemporaryDirectory() as folder:
        for name, sent in (("trackers", trackers(ros)), ("suit", _suit(ros))):
            path = storage(write_folder(Path(folder) / name, ros, sent))
            connection = sqlite3.connect(path, isolation_level=None)
            if name == "trackers":
                for statement in ("DROP TABLE schema", "DROP TABLE metadata", "DROP TABLE message_definitions"):
                    connection.execute(statement)
            connection.execute("PRAGMA page_size = 512")
            connection.execute("VACUUM")
            connection.close()
            found.append(path.read_bytes())
    return found


@cache
def folder_files() -> dict[str, bytes]:
    """Files of rosbag2 folders by name: `sqlite.yaml` and `mcap.yaml` stand for the metadata.yaml of each."""
    ros, found = Ros(2), {}
    with tempfile.TemporaryDirectory() as folder:
        for name, mcap in (("sqlite", False), ("mcap", True)):
            path = write_folder(Path(folder) / name, ros, trackers(ros), mcap=mcap)
            found[f"{name}.yaml"] = (path / "metadata.yaml").read_bytes()
            found[storage(path).name] = storage(path).read_bytes()
    return found


def _mcap(
    channels: dict[str, tuple[str, str, str, bytes]], messages: Sequence[tuple[str, int, bytes]], packing: str = ""
) -> bytes:
    """channels: topic → name and encoding of its schema, encoding of its messages, schema. packing: "" = no chunks and no checksums; "chunks" = chunks, but no checksums."""
    stream = io.BytesIO()
    kind = {"zstd": CompressionType.ZSTD, "lz4": CompressionType.LZ4}.get(packing, CompressionType.NONE)
    writer = Writer(
        stream,
        chunk_size=2000,
        compression=kind,
        use_chunking=bool(packing),
        enable_crcs=packing not in ("", "chunks"),
        enable_data_crcs=packing not in ("", "chunks"),
    )
    writer.start("ros2")
    ids = {}
    for topic, (name, schema_encoding, encoding, schema) in channels.items():
        ids[topic] = writer.register_channel(topic, encoding, writer.register_schema(name, schema_encoding, schema))
    for topic, log_time, payload in messages:
        writer.add_message(ids[topic], log_time, payload, log_time)
    writer.finish()
    return stream.getvalue()


def _ros_mcap(ros: Ros, sent: Sequence[Sent], packing: str = "", definition: bytes = b"") -> bytes:
    channels = {one.topic: (one.message_type, "ros2msg", "cdr", definition) for one in sent}
    return _mcap(
        channels,
        [(s.topic, s.log_time, bytes(ros.store.serialize_cdr(s.message, s.message_type))) for s in sent],
        packing,
    )


def links_mcap(definition: bytes = b"") -> bytes:
    """Link states whose definition is that, or missing."""
    ros = Ros(2)
    return _ros_mcap(ros, _suit(ros), definition=definition)


LINKS_DEFINITION = (
    f"{LINK_STATE_ARRAY}{'=' * 80}\nMSG: xsens_mvn_ros_msgs/LinkState\n{LINK_STATE}".encode()
)  # what the message refers to stands behind it, as recorders write it


@cache
def mcaps() -> Sequence[bytes]:
    """A person's recordings: trackers, link states with their definition, an array of poses that nobody names, Foxglove's messages."""
    ros = Ros(2)
    sent = trackers(ros)
    at = np.array([[0.1, 0.2, 1.0], [0.0, 0.0, 1.3]])
    several = [
        Sent("/mocap", ARRAY, _stamp(i), ros.pose_array(_stamp(i), "world", at + 0.1 * i, np.tile(_WXYZ, (2, 1))))
        for i in range(_FRAMES)
    ]
    return [
        _ros_mcap(ros, sent),
        _ros_mcap(ros, [*sent, *several], "zstd"),
        links_mcap(LINKS_DEFINITION),
        _foxglove("json"),
        _foxglove("protobuf"),
    ]


@cache
def suits() -> Sequence[bytes]:
    """Three seconds of a suit's tf in chunks, for a reader in parts: whole, and with a segment that is lost for a second."""
    ros, segments = Ros(2), ("pelvis", "t8", "head", "right_upper_arm", "right_forearm", "left_upper_arm")
    at, found = np.linspace(0.0, 1.0, 3 * len(segments)).reshape(-1, 3), []
    for lost in (range(0), range(25, 45)):
        sent = []
        for frame in range(60):
            stamp = START_NS + frame * 50_000_000
            turned = np.array([np.cos(0.01 * frame), 0.0, np.sin(0.01 * frame), 0.0])
            frames = [
                ros.transform(stamp, "world", f"skeleton_{name}", at[column] + 0.01 * frame, turned)
                for column, name in enumerate(segments)
                if name != "head" or frame not in lost
            ]
            sent.append(Sent("/tf", TF, stamp, ros.tf(*frames)))
        found.append(_ros_mcap(ros, sent, "chunks"))
    return found


def empty_mcap() -> bytes:
    """A recording without messages."""
    return _mcap({}, [])


def robot_mcap() -> bytes:
    """A robot's recording as others make it: joints in changing order, without velocities, tf of its base, its URDF."""
    ros = Ros(2)
    urdf = '<robot name="r"><link name="arm"/><link name="base"/><joint><parent link="base"/><child link="arm"/></joint></robot>'
    sent = [Sent("/robot_description", "std_msgs/msg/String", START_NS, ros.text(urdf))]
    for frame in range(_FRAMES):
        stamp = _stamp(frame)
        joints = ["knee", "hip"] if frame == 3 else ["hip", "knee"]
        moved = ros.transform(stamp, "odom", "base", np.array([0.1 * frame, 0.0, 0.9]), _TURNED)
        sent.append(Sent("/joint_states", JOINTS, stamp, ros.joint_state(stamp, joints)))
        sent.append(Sent("/tf", TF, stamp, ros.tf(moved)))
    return _ros_mcap(ros, sent)


def _foxglove(encoding: str) -> bytes:
    json_ = encoding == "json"
    channels = {
        "/tf": ("foxglove.FrameTransforms", "jsonschema" if json_ else "protobuf", encoding, b"{}"),
        "/left_foot": ("foxglove.PoseInFrame", "jsonschema" if json_ else "protobuf", encoding, b"{}"),
    }
    messages = []
    for frame in range(_FRAMES):
        at, turned = [0.1 * frame, 0.2, 1.0], [0.0, 0.8, 0.0, 0.6]
        transform, pose = (_json_messages if json_ else _protobuf_messages)(_stamp(frame), at, turned)
        messages += [("/tf", _stamp(frame), transform), ("/left_foot", _stamp(frame), pose)]
    return _mcap(channels, messages)


def _json_messages(stamp: int, at: list[float], xyzw: list[float]) -> tuple[bytes, bytes]:
    seconds, nanoseconds = divmod(stamp, 10**9)
    time: dict[str, Any] = {"timestamp": {"sec": seconds, "nsec": nanoseconds}}
    place, turned = dict(zip("xyz", at, strict=True)), dict(zip("xyzw", xyzw, strict=True))
    transform = {"parent_frame_id": "world", "child_frame_id": "waist", "translation": place, "rotation": turned}
    pose = {"frame_id": "world", "pose": {"position": place, "orientation": turned}}
    return json.dumps({"transforms": [time | transform]}).encode(), json.dumps(time | pose).encode()


def _protobuf_messages(stamp: int, at: list[float], xyzw: list[float]) -> tuple[bytes, bytes]:
    time, values = protobuf.stamp(stamp), [protobuf.doubles(part, zeros=True) for part in (at, xyzw)]
    transform = protobuf.fields(time, b"world", b"waist", *values)
    pose = protobuf.fields(time, b"world", protobuf.fields(*values))
    return protobuf.fields(transform), pose
