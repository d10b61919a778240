"""Poses of devices and frames in ROS recordings: each kind of message, trees with static transforms, clocks, real bags."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from retarget import formats
from retarget.core.errors import FormatError, UnknownNameError, UsageError
from retarget.core.types import TrackerRecording
from retarget.formats import TrackerOptions, _frame_map
from rosbags.typesys import get_types_from_msg
from scipy.spatial.transform import Rotation

from tests.formats import protobuf
from tests.formats.ros_recordings import (
    EVO_BAG,
    EVO_FOLDER,
    START_NS,
    VICON_BAG,
    Ros,
    Sent,
    mcap_bytes,
    stamps,
    storage,
    write_bag,
    write_folder,
)

TIME = np.arange(60) / 90.0
POSITION = np.stack([np.sin(TIME), 0.2 * TIME, 1.0 + 0.1 * np.cos(3 * TIME)], axis=1)
ROTATION = Rotation.from_euler("xyz", np.stack([0.4 * np.sin(2 * TIME), 0.3 * TIME, TIME], axis=1))
WXYZ = ROTATION.as_quat(scalar_first=True)
WAIST = TrackerOptions(frames={"trackers": {"waist": "base_link"}})


def read(path: Path | str, options: TrackerOptions | None = None) -> TrackerRecording:
    return formats.read_trackers(path, options=options)


def assert_wandering(recording: TrackerRecording, tracker: str) -> None:
    """`tracker` moves as POSITION and WXYZ say."""
    column = recording.index(tracker)
    assert np.abs(recording.time - TIME).max() < 1e-9
    assert np.abs(recording.position[:, column] - POSITION).max() < 1e-12
    own = Rotation.from_quat(recording.orientation[:, column], scalar_first=True)
    assert np.degrees((own.inv() * ROTATION).magnitude()).max() < 1e-6
    assert recording.tracked[:, column].all()


Make = Callable[[Ros, int, int], Sent]


def _sent(topic: str, kind: str, method: str, *names: str) -> Make:
    def make(ros: Ros, frame: int, stamp: int) -> Sent:
        message = getattr(ros, method)(stamp, *names, POSITION[frame], WXYZ[frame])
        package, _, short = kind.partition("/")
        return Sent(topic, f"{package}/msg/{short}", stamp + 5_000_000, message)

    return make


KINDS: list[tuple[str, Make]] = [
    ("left_elbow", _sent("/left_elbow_pose", "geometry_msgs/PoseStamped", "pose_stamped", "vive_world")),
    ("waist", _sent("waist_pose", "geometry_msgs/PoseWithCovarianceStamped", "pose_with_covariance", "vive_world")),
    ("LHR_1", _sent("/LHR_1_odom", "nav_msgs/Odometry", "odometry", "vive_world", "LHR_1")),
    ("LHR-2", _sent("/pose", "geometry_msgs/TransformStamped", "transform", "/libsurvive_frame", "/LHR-2")),
    ("tracker_3", _sent("/tracker", "geometry_msgs/TransformStamped", "transform", "room", "tracker_3")),
]


@pytest.mark.parametrize(("tracker", "make"), KINDS, ids=[name for name, _ in KINDS])
@pytest.mark.parametrize("version", [1, 2])
def test_each_kind_of_message_is_a_tracker(tmp_path: Path, tracker: str, make: Make, version: int) -> None:
    ros = Ros(version)
    messages = [make(ros, frame, stamp) for frame, stamp in enumerate(stamps(TIME))]
    path = write_bag(tmp_path / "a.bag", ros, messages) if version == 1 else write_folder(tmp_path / "a", ros, messages)
    recording = read(path)
    assert_wandering(recording, tracker)
    assert recording.segments == {"left_elbow": {tracker: "LeftUpperArm"}, "waist": {tracker: "Pelvis"}}.get(
        tracker, {}
    )


@pytest.mark.parametrize("frame", ["#0", "#hest"])
@pytest.mark.parametrize(
    ("kind", "method"), [("nav_msgs/Odometry", "odometry"), ("geometry_msgs/TransformStamped", "transform")]
)
def test_a_name_that_looks_like_a_place_in_a_list(tmp_path: Path, frame: str, kind: str, method: str) -> None:
    ros = Ros(2)
    make = _sent("/pose", kind, method, "world", frame)
    path = write_folder(tmp_path / "a", ros, [make(ros, k, stamp) for k, stamp in enumerate(stamps(TIME))])
    assert_wandering(read(path, TrackerOptions(frames={"trackers": {"chest": frame}})), "chest")


def test_a_pose_array_needs_names(tmp_path: Path) -> None:
    ros = Ros(2)
    two = [np.stack([POSITION, POSITION + 1.0], axis=1), np.stack([WXYZ, WXYZ], axis=1)]
    messages = [
        Sent(
            "/mocap", "geometry_msgs/msg/PoseArray", stamp, ros.pose_array(stamp, "world", two[0][frame], two[1][frame])
        )
        for frame, stamp in enumerate(stamps(TIME))
    ]
    path = write_folder(tmp_path / "array", ros, messages)
    with pytest.raises(FormatError, match=r"no poses: found /mocap \(geometry_msgs/PoseArray\)"):
        read(path)
    assert 'name its poses in --frames, [poses] "/mocap"' in " ".join(formats.describe(path)["warnings"])
    recording = read(path, TrackerOptions(frames={"poses": {"mocap": ["chest", "waist"]}}))
    assert_wandering(recording, "chest")
    assert np.abs(recording.position[:, recording.index("waist")] - POSITION - 1.0).max() < 1e-12


def _tree(ros: Ros) -> list[Sent]:
    """world_vive → tracker moving, world → world_vive static, tracker → mount static."""
    half = np.array([0.5, -0.5, 0.5, 0.5])
    fixed = [
        ros.transform(START_NS - 10**12, "/world", "/world_vive", np.array([1.0, 2.0, 3.0]), half),
        ros.transform(START_NS - 10**12, "tracker_LHR_9", "mount", np.array([0.0, 0.0, 0.1]), half),
    ]
    messages = [Sent("/tf_static", "tf2_msgs/msg/TFMessage", START_NS - 50, ros.tf(*fixed))]
    for frame, stamp in enumerate(stamps(TIME)):
        one = ros.transform(stamp, "world_vive", "tracker_LHR_9", POSITION[frame], WXYZ[frame])
        messages.append(Sent("/tf", "tf2_msgs/msg/TFMessage", stamp + 3_000_000, ros.tf(one)))
    return messages


def test_trees_are_composed_to_their_root_and_roots_can_be_chosen(tmp_path: Path) -> None:
    ros = Ros(2)
    path = write_folder(tmp_path / "tree", ros, _tree(ros))
    fixed = Rotation.from_quat([0.5, -0.5, 0.5, 0.5], scalar_first=True)
    whole = read(path)
    assert whole.trackers == ("tracker_LHR_9",)
    assert np.abs(whole.position[:, 0] - (fixed.apply(POSITION) + np.array([1.0, 2.0, 3.0]))).max() < 1e-12
    own = Rotation.from_quat(whole.orientation[:, 0], scalar_first=True)
    assert ((fixed * ROTATION).inv() * own).magnitude().max() < 1e-7
    inner = read(path, TrackerOptions(frames={"root": "world_vive", "trackers": {"waist": "mount"}}))
    assert np.abs(inner.position[:, 0] - (POSITION + ROTATION.apply([0.0, 0.0, 0.1]))).max() < 1e-12
    with pytest.raises(
        FormatError, match="does not hang on root 'map': above it are mount, tracker_LHR_9, world_vive, world"
    ):
        read(path, TrackerOptions(frames={"root": "map", "trackers": {"waist": "mount"}}))


def test_a_loop_of_frames_is_an_error_and_no_endless_one(tmp_path: Path) -> None:
    ros, pose = Ros(2), (np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    both = [ros.transform(START_NS, "waist", "chest", *pose), ros.transform(START_NS, "chest", "waist", *pose)]
    path = write_folder(tmp_path / "loop", ros, [Sent("/tf", "tf2_msgs/msg/TFMessage", START_NS, ros.tf(*both))])
    with pytest.raises(FormatError, match="in a loop"):
        read(path)


def test_the_clock_is_the_headers_or_the_recorders(tmp_path: Path) -> None:
    ros = Ros(2)
    late = 56 * 365 * 86_400 * 10**9
    delays = [0 if frame % 2 else 2_000_000 for frame in range(len(TIME))]
    messages = [
        Sent("/waist_pose", "geometry_msgs/msg/PoseStamped", stamp + late + delay, ros.pose_stamped(stamp, "w", p, q))
        for stamp, p, q, delay in zip(stamps(TIME), POSITION, WXYZ, delays, strict=True)
    ]
    path = write_folder(tmp_path / "clock", ros, messages)
    assert_wandering(read(path), "waist")
    assert formats.describe(path)["start_stamp_ns"] == START_NS
    logged = read(path, TrackerOptions(clock="log"))
    assert np.abs(logged.time - (TIME + (np.array(delays) - delays[0]) * 1e-9)).max() < 1e-9
    assert formats.describe(path, options=TrackerOptions(clock="log"))["start_stamp_ns"] == START_NS + late + delays[0]


def test_without_stamps_the_recorders_time_is_used(tmp_path: Path) -> None:
    ros = Ros(2)
    messages = [
        Sent("/waist_pose", "geometry_msgs/msg/PoseStamped", stamp, ros.pose_stamped(0, "w", p, q))
        for stamp, p, q in zip(stamps(TIME), POSITION, WXYZ, strict=True)
    ]
    recording = read(write_folder(tmp_path / "none", ros, messages))
    assert_wandering(recording, "waist")
    assert recording.source.warnings[0] == "poses without stamps: the recorder's log time is used"


def test_frames_of_other_rates_come_onto_one_time_base_with_gaps_marked(tmp_path: Path) -> None:
    ros, messages = Ros(2), []
    for frame, stamp in enumerate(stamps(TIME)):
        if not 20 <= frame < 26:
            pose = ros.pose_stamped(stamp, "w", POSITION[frame], WXYZ[frame])
            messages.append(Sent("/waist_pose", "geometry_msgs/msg/PoseStamped", stamp, pose))
        if frame % 3 == 0:
            pose = ros.pose_stamped(stamp + 1_000_000, "w", POSITION[frame], WXYZ[frame])
            messages.append(Sent("/chest_pose", "geometry_msgs/msg/PoseStamped", stamp, pose))
        if frame % 2 == 0:
            pose = ros.pose_stamped(stamp, "w", POSITION[frame], WXYZ[frame])
            messages.append(Sent("/head_pose", "geometry_msgs/msg/PoseStamped", stamp, pose))
    recording = read(write_folder(tmp_path / "rates", ros, messages))
    assert abs(recording.rate_hz - 45.0) < 0.01
    waist, chest = recording.index("waist"), recording.index("chest")
    assert set(np.flatnonzero(~recording.tracked[:, waist])) == {10, 11, 12}
    straight = np.stack([np.interp(recording.time, TIME[::3] + 1e-3, POSITION[::3, axis]) for axis in range(3)], axis=1)
    inner = slice(1, -1)
    assert np.abs(recording.position[inner, chest] - straight[inner]).max() < 1e-9
    lines = " ".join(recording.source.warnings)
    assert "trackers log at 30, 45, 90 Hz: interpolated onto an even 45 Hz" in lines
    assert "waist in w: 3 of 30 frames not measured" in lines


def _foxglove_json(frame: int, stamp: int) -> dict[str, Any]:
    seconds, rest = divmod(stamp, 10**9)
    names = zip("xyz", POSITION[frame].tolist(), strict=True)
    w, x, y, z = WXYZ[frame].tolist()
    return {
        "timestamp": {"sec": seconds, "nsec": rest},
        "parent_frame_id": "room",
        "child_frame_id": "waist",
        "translation": dict(names),
        "rotation": {"x": x, "y": y, "z": z, "w": w},
    }


def _pose_in_frame(item: dict[str, Any]) -> dict[str, Any]:
    pose = {"position": item["translation"], "orientation": item["rotation"]}
    return {"timestamp": item["timestamp"], "frame_id": "room", "pose": pose}


def _foxglove_protobuf(frame: int, stamp: int) -> bytes:
    place, turned = protobuf.doubles(POSITION[frame]), protobuf.doubles(WXYZ[frame][[1, 2, 3, 0]])
    return protobuf.fields(protobuf.stamp(stamp), b"room", b"waist", place, turned)


def _foxglove_pose_protobuf(frame: int, stamp: int) -> bytes:
    place, turned = protobuf.doubles(POSITION[frame]), protobuf.doubles(WXYZ[frame][[1, 2, 3, 0]])
    return protobuf.fields(protobuf.stamp(stamp), b"room", protobuf.fields(place, turned))


def _foxglove_cdr(name: str, frame: int, stamp: int) -> bytes:
    """By rosbags, from the definitions of foxglove_msgs."""
    ros = _foxglove_ros()
    time = ros.header(stamp, "").stamp
    if name == "PoseInFrame":
        message = ros.make(f"foxglove_msgs/{name}", time, "room", ros.pose(POSITION[frame], WXYZ[frame]))
    else:
        moved = ros.transform(stamp, "", "", POSITION[frame], WXYZ[frame]).transform
        message = ros.make("foxglove_msgs/FrameTransform", time, "/room", "/waist", moved.translation, moved.rotation)
        if name == "FrameTransforms":
            message = ros.make("foxglove_msgs/FrameTransforms", [message])
    return bytes(ros.store.serialize_cdr(message, f"foxglove_msgs/msg/{name}"))


@cache
def _foxglove_ros() -> Ros:
    ros = Ros(2)
    for short, text in (
        ("FrameTransform", f"{TIMESTAMP}string parent_frame_id\nstring child_frame_id\n{TRANSFORM}"),
        ("FrameTransforms", "foxglove_msgs/FrameTransform[] transforms\n"),
        ("PoseInFrame", f"{TIMESTAMP}string frame_id\ngeometry_msgs/Pose pose\n"),
    ):
        ros.store.register(get_types_from_msg(text, f"foxglove_msgs/msg/{short}"))
    return ros


TIMESTAMP = "builtin_interfaces/Time timestamp\n"
TRANSFORM = "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n"

FOXGLOVE: list[tuple[str, str, str, Callable[[int, int], bytes]]] = [
    ("FrameTransform", "json", "/tf", lambda f, s: json.dumps(_foxglove_json(f, s)).encode()),
    ("FrameTransforms", "json", "/tf", lambda f, s: json.dumps({"transforms": [_foxglove_json(f, s)]}).encode()),
    ("PoseInFrame", "json", "/waist", lambda f, s: json.dumps(_pose_in_frame(_foxglove_json(f, s))).encode()),
    ("FrameTransform", "protobuf", "/tf", _foxglove_protobuf),
    ("FrameTransforms", "protobuf", "/tf", lambda f, s: protobuf.fields(_foxglove_protobuf(f, s))),
    ("PoseInFrame", "protobuf", "/waist", _foxglove_pose_protobuf),
    ("FrameTransform", "cdr", "/tf", lambda f, s: _foxglove_cdr("FrameTransform", f, s)),
    ("FrameTransforms", "cdr", "/tf", lambda f, s: _foxglove_cdr("FrameTransforms", f, s)),
    ("PoseInFrame", "cdr", "/waist", lambda f, s: _foxglove_cdr("PoseInFrame", f, s)),
]


@pytest.mark.parametrize(("name", "encoding", "topic", "make"), FOXGLOVE, ids=[f"{n}-{e}" for n, e, _, _ in FOXGLOVE])
def test_foxglove_messages_are_read_as_json_and_as_protobuf(
    tmp_path: Path, name: str, encoding: str, topic: str, make: Callable[[int, int], bytes]
) -> None:
    path = tmp_path / "fox.mcap"
    schema, package = {"json": ("jsonschema", "foxglove."), "cdr": ("ros2msg", "foxglove_msgs/msg/")}.get(
        encoding, ("protobuf", "foxglove.")
    )
    messages = [(topic, stamp, make(frame, stamp)) for frame, stamp in enumerate(stamps(TIME))]
    path.write_bytes(mcap_bytes([(topic, f"{package}{name}", schema, encoding, b"{}")], messages))
    assert_wandering(read(path), "waist")


def test_what_is_no_foxglove_message_is_named(tmp_path: Path) -> None:
    path = tmp_path / "fox.mcap"
    for encoding, payload in (("json", b"{}"), ("json", b"["), ("protobuf", b"\x0a\x7f"), ("protobuf", b"\x0b")):
        path.write_bytes(mcap_bytes([("/tf", "foxglove.FrameTransform", "", encoding, b"")], [("/tf", 1, payload)]))
        with pytest.raises(FormatError, match=r"topic /tf, message 0: not a foxglove.FrameTransform"):
            read(path)
    path.write_bytes(mcap_bytes([("/tf", "foxglove.FrameTransform", "", "flatbuffer", b"")], [("/tf", 1, b"")]))
    with pytest.raises(FormatError, match="no poses"):
        read(path)
    assert "as flatbuffer, expected one of cdr, ros1, json, protobuf" in " ".join(formats.describe(path)["warnings"])


real = pytest.mark.skipif(not EVO_BAG.exists(), reason=f"the real recordings are not at {EVO_BAG.parent}")


@real
def test_the_same_real_recording_as_bag_folder_and_db3_is_identical() -> None:
    first = read(EVO_BAG, WAIST)
    assert first.frames == 517
    assert first.segments == {"waist": "Pelvis"}
    for path in (EVO_FOLDER, EVO_FOLDER / "metadata.yaml", storage(EVO_FOLDER)):
        other = read(path, WAIST)
        for field in ("time", "position", "orientation", "tracked"):
            assert np.array_equal(getattr(first, field), getattr(other, field))
    # by rosbags alone: the first transform, odom → base_footprint, and base_link on it
    assert first.position[0, 0].tolist() == [1.1603796887148006, -2.942426888388735, 0.0]
    assert np.abs(first.orientation[0, 0] - [0.7324656905610344, 0, 0, 0.6808039454578293]).max() < 1e-15
    assert formats.describe(EVO_BAG, options=WAIST)["start_stamp_ns"] == 1714741164177519307


@real
def test_real_frames_that_are_nobodys_are_named() -> None:
    with pytest.raises(
        FormatError, match="no frame is a known segment or tracker: found base_footprint, base_link, odom"
    ):
        read(EVO_BAG)
    facts = formats.describe(EVO_FOLDER)
    assert facts["kind"] == "messages"
    assert facts["topics"] == ["/tf tf2_msgs/TFMessage 517 messages 10 Hz", "/tf_static tf2_msgs/TFMessage 1 messages"]
    assert "base_link in base_footprint static" in facts["frames_found"]
    with pytest.raises(UnknownNameError, match=r"unknown frame 'base_lnk'; did you mean base_link"):
        read(EVO_BAG, TrackerOptions(frames={"trackers": {"waist": "base_lnk"}}))


@real
def test_the_real_vicon_bag_with_leading_slashes_reads() -> None:
    frame = "vicon/t265_tracker/t265_tracker"
    recording = read(VICON_BAG, TrackerOptions(roles={frame: "waist"}))
    assert recording.trackers == (frame,)
    assert recording.segments == {frame: "Pelvis"}
    assert recording.frames == 57
    assert abs(recording.rate_hz - 50.0) < 0.1
    both = read(VICON_BAG, TrackerOptions(frames={"trackers": {"waist": "/" + frame}}))
    assert np.array_equal(both.position, recording.position)
    with pytest.raises(FormatError, match="different trees, with roots 'camera_odom_frame', 'world'"):
        read(VICON_BAG, TrackerOptions(frames={"trackers": {"waist": frame, "chest": "camera_pose_frame"}}))


@pytest.mark.parametrize(
    ("table", "problem"),
    [
        ({"segment": {}}, "unknown key 'segment'; did you mean segments"),
        ({"segments": {"Pelvi": "a"}}, r"\[segments\]: unknown segment 'Pelvi'; did you mean Pelvis"),
        ({"segments": {"Pelvis": 3}}, "found 3, expected a frame's name"),
        ({"segments": {"Pelvis": "a", "L5": "/a"}}, "frame 'a' is given to Pelvis and to L5"),
        ({"segments": {"Pelvis": "a"}, "trackers": {"b": "c"}}, r"found \[segments\] and \[trackers\]"),
        ({"rotations": {"Pelvis": [1, 0, 0]}}, r"found \[1, 0, 0\], expected a unit quaternion"),
        ({"rotations": {"Pelvis": [1, 1, 0, 0]}}, "expected a unit quaternion"),
        ({"poses": {"/a": "b"}}, "expected a list of names"),
        ({"root": ""}, "root is '', expected text"),
        ({"trackers": []}, r"\[trackers\] is \[\], expected a table"),
    ],
)
def test_a_map_that_says_nonsense_is_refused(table: dict[str, Any], problem: str) -> None:
    with pytest.raises(UsageError, match=problem):
        _frame_map.load(table)
