"""Damaged, wrong and foreign ROS recordings: one clear line each."""

from __future__ import annotations

import contextlib
import io
import random
from pathlib import Path

import numpy as np
import pytest
from retarget import formats
from retarget.core.errors import FormatError, RetargetError, UsageError
from retarget.formats import TrackerOptions

from tests.formats.ros_recordings import (
    DATA,
    START_NS,
    Ros,
    Sent,
    link_states,
    mcap_bytes,
    stamps,
    storage,
    write_bag,
    write_folder,
)
from tests.formats.test_ros_suits import walk

TF = "tf2_msgs/msg/TFMessage"
POSE = np.array([0.1, 0.2, 1.0]), np.array([1.0, 0.0, 0.0, 0.0])


def _sent(ros: Ros, frames: int = 200) -> list[Sent]:
    found = []
    for stamp in stamps(np.arange(frames) / 90.0):
        found.append(Sent("/tf", TF, stamp, ros.tf(ros.transform(stamp, "world", "waist", *POSE))))
    return found


def _recordings(folder: Path) -> dict[str, Path]:
    ros, ros1 = Ros(2), Ros(1)
    return {
        "bag": write_bag(folder / "good.bag", ros1, _sent(ros1)),
        "db3": storage(write_folder(folder / "sqlite", ros, _sent(ros))),
        "mcap": storage(write_folder(folder / "mcap", ros, _sent(ros), mcap=True)),
    }


def _line(path: Path, options: TrackerOptions | None = None) -> str:
    """The message of the failure, which has to be one line that begins with the file's name."""
    with pytest.raises(RetargetError) as caught:
        formats.read_recording(path, options=options)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(str(path))
    return str(caught.value)


@pytest.mark.parametrize("kind", ["bag", "db3", "mcap"])
def test_a_truncated_recording(tmp_path: Path, kind: str) -> None:
    data = _recordings(tmp_path)[kind].read_bytes()
    for part in (0.02, 0.3, 0.7, 0.99):
        path = tmp_path / f"cut.{kind}"
        path.write_bytes(data[: int(part * len(data))])
        line = _line(path)
        assert "can't be read as a recording" in line or "the file ends inside" in line


@pytest.mark.parametrize("kind", ["bag", "db3", "mcap"])
def test_damaged_bytes_give_an_error_or_a_recording_but_no_crash(tmp_path: Path, kind: str) -> None:
    data = _recordings(tmp_path)[kind].read_bytes()
    random_ = random.Random(kind)
    path = tmp_path / f"damaged.{kind}"
    for _ in range(25):
        damaged = bytearray(data)
        for _ in range(random_.choice([1, 4, 40])):
            damaged[random_.randrange(16, len(data))] = random_.randrange(256)
        path.write_bytes(damaged)
        with contextlib.suppress(RetargetError):
            formats.read_recording(path)


def test_empty_files_wrong_content_and_no_folder(tmp_path: Path) -> None:
    for suffix, found in ((".bag", "empty file"), (".db3", "empty file"), (".mcap", "empty file")):
        path = tmp_path / f"empty{suffix}"
        path.write_bytes(b"")
        assert found in _line(path)
    text = tmp_path / "text.bag"
    text.write_text("not a bag at all")
    assert "can't be read as a recording" in _line(text)
    other = tmp_path / "other.db3"
    other.write_bytes(_recordings(tmp_path / "o")["bag"].read_bytes() if (tmp_path / "o").mkdir() is None else b"")
    assert "waist" in formats.read_trackers(other).trackers  # a bag all the same, whatever it is called
    assert "expected a file, or a rosbag2 folder with its metadata.yaml" in _line(tmp_path)
    with pytest.raises(FormatError, match="metadata of a rosbag2 folder, without the folder"):
        formats.read_recording(io.BytesIO(b"rosbag2_bagfile_information:\n  version: 5\n"), "-")


@pytest.mark.parametrize(
    ("metadata", "problem"),
    [
        ("rosbag2_bagfile_information:\n  version: 99\n", "rosbag2 version 99; expected 1 to 9"),
        ("rosbag2_bagfile_information:\n  version: 5\n", "storage_identifier None; expected mcap or sqlite3"),
        ("rosbag2_bagfile_information: [", "not YAML"),
        ("rosbag2_bagfile_information: !!python/object/apply:os.system ['true']", "not YAML"),
        (
            "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: sqlite3\n  relative_file_paths: [../../secret.db3]\n",
            "file secret.db3 is missing",
        ),
    ],
)
def test_metadata_of_a_folder_that_is_nonsense(tmp_path: Path, metadata: str, problem: str) -> None:
    folder = tmp_path / "recording"
    folder.mkdir()
    (folder / "metadata.yaml").write_text(metadata)
    (tmp_path / "secret.db3").write_bytes(b"")
    assert problem in _line(folder)


def test_nothing_of_a_person(tmp_path: Path) -> None:
    ros = Ros(2)
    text = write_folder(tmp_path / "text", ros, [Sent("/chatter", "std_msgs/msg/String", START_NS, ros.text("hello"))])
    assert "no poses: found /chatter (std_msgs/String); expected tf, poses, odometry or link states" in _line(text)
    fixed = ros.tf(ros.transform(START_NS, "world", "waist", *POSE))
    static = write_folder(tmp_path / "static", ros, [Sent("/tf_static", TF, START_NS, fixed)])
    assert "nothing moves: all transforms are static" in _line(static)
    near = [Sent("/tf", TF, s, ros.tf(ros.transform(s, "map", "pelvys", *POSE))) for s in stamps(np.arange(5) / 90)]
    line = _line(write_folder(tmp_path / "near", ros, near))
    assert 'found map, pelvys; nearest: Pelvis = "pelvys"; expected --frames map.toml' in line


@pytest.mark.parametrize(
    ("x", "w", "found"),
    [
        (0.1, np.nan, "[0.1, 0.2, 1.0, nan, 0.0, 0.0, 0.0]"),
        (0.1, 1e308, "[0.1, 0.2, 1.0, 1e+308, 0.0, 0.0, 0.0]"),
        (1e308, 1.0, "[1e+308, 0.2, 1.0, 1.0, 0.0, 0.0, 0.0]"),
    ],
)
def test_a_static_transform_that_is_none(tmp_path: Path, x: float, w: float, found: str) -> None:
    ros = Ros(2)
    fixed = ros.tf(ros.transform(START_NS, "map", "world", np.array([x, 0.2, 1.0]), np.array([w, 0.0, 0.0, 0.0])))
    path = write_folder(tmp_path / "static", ros, [Sent("/tf_static", TF, START_NS, fixed), *_sent(ros)])
    assert f"topic /tf_static, world in map: found {found}" in _line(path)


@pytest.mark.parametrize("x", [1e308, 1e200])
def test_a_moving_frame_that_is_beyond_numbers(tmp_path: Path, x: float) -> None:
    """Positions that overflow when composed with the frame above."""
    ros = Ros(2)
    sent = []
    for stamp in stamps(np.arange(20) / 90.0):
        for parent, child in (("map", "world"), ("world", "waist")):
            at = np.array([x, x, 1.0])
            sent.append(
                Sent("/tf", TF, stamp, ros.tf(ros.transform(stamp, parent, child, at, np.array([0.6, 0, 0.8, 0]))))
            )
    with np.errstate(all="raise"), contextlib.suppress(RetargetError):
        found = formats.read_trackers(write_folder(tmp_path / "far", ros, sent))
        assert np.isfinite(found.position).all()


def test_joint_angles_of_an_xsens_driver_alone(tmp_path: Path) -> None:
    ros = Ros(2)
    names = [f"skeleton_joint{i}_{axis}" for i in range(22) for axis in "xyz"]
    sent = [
        Sent("/joint_states", "sensor_msgs/msg/JointState", s, ros.joint_state(s, names)) for s in stamps([0.0, 0.1])
    ]
    for mcap in (False, True):
        folder = write_folder(tmp_path / str(mcap), ros, sent, mcap=mcap)
        for path in (folder, storage(folder)):
            assert "joint angles of an Xsens driver" in _line(path)
            assert "expected its /tf or /link_states recorded, too" in _line(path)


def test_a_robots_mcap_is_a_trajectory(tmp_path: Path) -> None:
    ros = Ros(2)
    sent = [
        Sent("/joint_states", "sensor_msgs/msg/JointState", s, ros.joint_state(s, ["knee"])) for s in stamps([0, 0.1])
    ]
    path = storage(write_folder(tmp_path / "robot", ros, sent, mcap=True))
    assert "mcap holds robot trajectories, not a person's motion" in _line(path)
    assert formats.describe(path)["kind"] == "trajectory"
    assert formats.read_trajectory(path).joint_names == ("knee",)


def test_messages_that_are_not_what_their_type_says(tmp_path: Path) -> None:
    good = Ros(2).store.serialize_cdr(_sent(Ros(2), 1)[0].message, TF)
    path = tmp_path / "a.mcap"
    for payload in (b"", b"\0\1\0\0", b"\7\7\0\0" + bytes(good[4:]), bytes(good[:-1]), b"\0\1\0\0\xff\xff\xff\xff"):
        path.write_bytes(
            mcap_bytes([("/tf", TF, "ros2msg", "cdr", b"")], [("/tf", 1, bytes(good)), ("/tf", 2, payload)])
        )
        assert "topic /tf, message 1: not a tf2_msgs/TFMessage: " in _line(path)


def test_a_definition_that_is_no_definition(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    name = "xsens_mvn_ros_msgs/msg/LinkStateArray"
    for schema, problem in (
        (b"this is $ no definition", "the recording's definition of xsens_mvn_ros_msgs/LinkStateArray can't be read"),
        (b"string[] other", "is not defined as the Xsens drivers do"),
    ):
        path.write_bytes(mcap_bytes([("/l", name, "ros2msg", "cdr", schema)], [("/l", 1, b"\0\1\0\0\0\0\0\0")]))
        assert problem in _line(path)
    path.write_bytes(mcap_bytes([("/l", name, "", "cdr", b"")], [("/l", 1, b"")]))
    options = TrackerOptions(msg_defs=(tmp_path / "none",))
    with pytest.raises(UsageError, match="no such file or folder"):
        formats.read_recording(path, options=options)


def test_with_tf_beside_them_link_states_without_definition_are_only_worth_a_warning(tmp_path: Path) -> None:
    ros, motion = Ros(2), walk()
    link = next(iter(link_states(ros, motion, motion.orientation)))
    payload = bytes(ros.store.serialize_cdr(link.message, link.message_type))
    tf = [(s.log_time, bytes(ros.store.serialize_cdr(s.message, TF))) for s in _sent(ros, 5)]
    path = tmp_path / "a.mcap"
    channels = [("/tf", TF, "ros2msg", "cdr", b""), ("/l", link.message_type, "", "cdr", b"")]
    path.write_bytes(mcap_bytes(channels, [("/l", START_NS, payload), *(("/tf", *one) for one in tf)]))
    recording = formats.read_trackers(path)
    assert recording.trackers == ("waist",)
    assert recording.source.warnings[0].startswith("topic /l not used: unknown message definition")


def test_options_of_ros_are_refused_by_other_formats(tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    log.write_text("time_s,waist_x,waist_y,waist_z,waist_qw,waist_qx,waist_qy,waist_qz\n0,0,0,1,1,0,0,0\n")
    for options, name in (
        (TrackerOptions(frames={}), "frames"),
        (TrackerOptions(clock="log"), "clock"),
        (TrackerOptions(msg_defs=(tmp_path,)), "msg-def"),
    ):
        for call in (formats.read_recording, formats.describe):
            with pytest.raises(UsageError, match=f"--{name} is for ROS recordings, not for vive"):
                call(log, options=options)
    with pytest.raises(UsageError, match="clock: found 'wall', expected header or log"):
        TrackerOptions(clock="wall")  # type: ignore[arg-type]  # what a caller without types may give


@pytest.mark.skipif(not DATA.exists(), reason=f"the real recordings are not at {DATA}")
def test_real_recordings_without_poses_say_what_they_hold() -> None:
    found = [
        DATA / "bag" / "rosbag2_talker",
        DATA / "bag" / "rosbag2_topics_and_services.db3",
        *sorted((DATA / "mcap").iterdir()),
    ]
    assert len(found) == 5
    for path in found:
        assert "no poses: found /" in _line(path)


@pytest.mark.parametrize("text", ["a = " + "9" * 5000, "a = " + "[" * 5000, "a = [", b"\xff".decode("latin-1"), "\0"])
def test_a_frames_map_that_is_no_toml(tmp_path: Path, text: str) -> None:
    frames = tmp_path / "map.toml"
    frames.write_text(text, encoding="latin-1")
    with pytest.raises(UsageError, match=r"^--frames .*/map\.toml: not TOML: "):
        formats.read_recording(_recordings(tmp_path)["bag"], options=TrackerOptions(frames=frames))


def test_names_that_break_lines_do_not(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    name = "std_msgs/msg/String"
    path.write_bytes(mcap_bytes([("/a\n\x1b[2Jb", name, "ros2msg", "cdr", b"")], [("/a\n\x1b[2Jb", 1, b"\0\1\0\0")]))
    assert r"found /a\n\x1b[2Jb (std_msgs/String)" in _line(path)
