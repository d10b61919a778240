"""MCAP files that others recorded: joint states in any order, with gaps, other clocks and other topics around them."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import CompressionType, Writer
from retarget.core import rotations
from retarget.core.errors import FormatError
from retarget.core.types import JointTrajectory
from retarget.formats import mcap
from retarget.formats._ros_messages import typestore

REAL = Path(__file__).parents[3] / "shared" / "data" / "mcap"
TYPES = typestore().types
URDF = '<robot name="r"><link name="arm"/><link name="torso"/><joint><parent link="torso"/><child link="arm"/></joint></robot>'


class Recorder:
    """Records messages as a ROS 2 recorder does, through the mcap package's own writer and rosbags' serialisation."""

    def __init__(self, **options: Any) -> None:
        self.out = io.BytesIO()
        self.writer = Writer(self.out, **options)
        self.writer.start("ros2")
        self.channels: dict[str, int] = {}

    def add(self, topic: str, message: Any, log_time: int = 0, *, little_endian: bool = True) -> None:
        kind = message.__msgtype__
        if topic not in self.channels:
            text, _ = typestore().generate_msgdef(kind, ros_version=2)
            schema = self.writer.register_schema(kind, "ros2msg", text.encode())
            self.channels[topic] = self.writer.register_channel(topic, "cdr", schema)
        raw = bytes(typestore().serialize_cdr(message, kind, little_endian=little_endian))
        self.writer.add_message(self.channels[topic], log_time, raw, log_time)

    def read(self) -> JointTrajectory:
        self.writer.finish()
        return mcap.read_trajectory(io.BytesIO(self.out.getvalue()), "walk.mcap")


def header(stamp: int, frame: str = "") -> Any:
    return TYPES["std_msgs/msg/Header"](TYPES["builtin_interfaces/msg/Time"](*divmod(stamp, 10**9)), frame)


def joints(stamp: int, values: dict[str, float], velocity: Sequence[float] = ()) -> Any:
    kind = TYPES["sensor_msgs/msg/JointState"]
    return kind(
        header(stamp), list(values), np.array(list(values.values()), float), np.array(velocity, float), np.zeros(0)
    )


def transform(
    stamp: int, parent: str, child: str, position: Sequence[float], wxyz: Sequence[float] = (1, 0, 0, 0)
) -> Any:
    w, x, y, z = (float(v) for v in wxyz)
    vector, quaternion = TYPES["geometry_msgs/msg/Vector3"], TYPES["geometry_msgs/msg/Quaternion"]
    pose = TYPES["geometry_msgs/msg/Transform"](vector(*map(float, position)), quaternion(x, y, z, w))
    return TYPES["geometry_msgs/msg/TransformStamped"](header(stamp, parent), child, pose)


def tf(*items: Any) -> Any:
    return TYPES["tf2_msgs/msg/TFMessage"](list(items))


def text(value: str) -> Any:
    return TYPES["std_msgs/msg/String"](value)


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize("use_chunking", [True, False])
def test_any_packing_is_read(compression: CompressionType, use_chunking: bool) -> None:
    recorder = Recorder(compression=compression, use_chunking=use_chunking, chunk_size=500)
    expected = np.arange(9000.0).reshape(4500, 2)
    for i, (a, b) in enumerate(expected):
        recorder.add("/joint_states", joints(10**9 + i * 10**6, {"a": a, "b": b}, [b, a]), i)
    back = recorder.read()
    np.testing.assert_array_equal(back.position, expected)
    np.testing.assert_array_equal(back.velocity, expected[:, ::-1])
    np.testing.assert_allclose(back.time, np.arange(4500) / 1000, rtol=0, atol=1e-15)


def test_order_of_joints_may_change_between_messages() -> None:
    recorder = Recorder()
    recorder.add("/joint_states", joints(0, {"a": 1, "b": 2, "c": 3}, [10, 20, 30]))
    recorder.add("/joint_states", joints(10, {"c": 6, "a": 4, "b": 5}, [60, 40, 50]))
    back = recorder.read()
    assert back.joint_names == ("a", "b", "c")
    np.testing.assert_array_equal(back.position, [[1, 2, 3], [4, 5, 6]])
    np.testing.assert_array_equal(back.velocity, [[10, 20, 30], [40, 50, 60]])


@pytest.mark.parametrize("velocity", [(), (np.nan, np.nan)])
def test_missing_velocity_is_differentiated_and_said(velocity: Sequence[float]) -> None:
    recorder = Recorder()
    stamps = [0, 10_000_000, 25_000_000, 40_000_000]
    # A parabola: central differences with unequal steps are exact inside.
    for stamp in stamps:
        t = stamp * 1e-9
        recorder.add("/joint_states", joints(1_700_000_000 * 10**9 + stamp, {"a": 3 * t**2, "b": 5 * t}, velocity))
    back = recorder.read()
    time = np.array(stamps) * 1e-9
    np.testing.assert_allclose(back.time, time, rtol=0, atol=1e-15)
    np.testing.assert_allclose(back.velocity[1:-1, 0], 6 * time[1:-1], atol=1e-12)
    np.testing.assert_allclose(back.velocity[:, 1], 5, atol=1e-12)
    assert "velocity missing for 2 joints" in back.provenance["warnings"][0]
    assert back.provenance["start_stamp_ns"] == 1_700_000_000 * 10**9


def test_velocity_missing_in_one_message_only() -> None:
    recorder = Recorder()
    for i, velocity in enumerate([(7.0,), (), (7.0,)]):
        recorder.add("/joint_states", joints(i * 10**9, {"a": 2.0 * i}, velocity))
    np.testing.assert_allclose(recorder.read().velocity, 2.0)


def test_unsorted_and_repeated_stamps() -> None:
    recorder = Recorder()
    rng = np.random.default_rng(0)
    # Each stamp three times, in any order; the first to come counts.
    order = rng.permutation(np.repeat(np.arange(50), 3))
    first: dict[int, int] = {}
    for i, stamp in enumerate(order.tolist()):
        recorder.add("/joint_states", joints(100 + stamp, {"a": i}, [0.0]))
        first.setdefault(stamp, i)
    back = recorder.read()
    assert back.position[:, 0].tolist() == [first[stamp] for stamp in range(50)]
    assert "100 joint states repeat a stamp" in back.provenance["warnings"][0]


def test_chunk_that_contradicts_its_checksum() -> None:
    """Most recorders leave the checksum of the whole file out but give one for each chunk."""
    recorder = Recorder(compression=CompressionType.NONE)
    recorder.add("/joint_states", joints(0, {"a": 1.2345}, [0.0]))
    recorder.writer.finish()
    data = recorder.out.getvalue()
    at = data.index(np.float64(1.2345).tobytes())
    assert mcap.read_trajectory(io.BytesIO(data), "walk.mcap").position[0, 0] == 1.2345
    with pytest.raises(FormatError, match="damaged chunk: crc validation failed"):
        mcap.read_trajectory(io.BytesIO(data[:at] + b"\x42" + data[at + 1 :]), "walk.mcap")


def test_without_stamps_the_log_time_counts() -> None:
    recorder = Recorder()
    for i in range(3):
        recorder.add("/joint_states", joints(0, {"a": i}, [0.0]), log_time=10**9 + i * 5_000_000)
    back = recorder.read()
    np.testing.assert_allclose(back.time, [0, 0.005, 0.01], atol=1e-15)
    assert "log time" in back.provenance["warnings"][0]


def test_big_endian_messages() -> None:
    recorder = Recorder()
    for i in range(3):
        recorder.add("/joint_states", joints(i, {"a": i + 0.5}, [-i]), little_endian=False)
    np.testing.assert_array_equal(recorder.read().position[:, 0], [0.5, 1.5, 2.5])


def test_joint_states_under_another_name() -> None:
    recorder = Recorder()
    recorder.add("/robot/joints", joints(5, {"a": 1.0}, [0.0]))
    assert recorder.read().joint_names == ("a",)


def test_several_topics_of_joint_states() -> None:
    both = Recorder()
    both.add("/left", joints(0, {"a": 1.0}, [0.0]))
    both.add("/right", joints(0, {"b": 2.0}, [0.0]))
    with pytest.raises(
        FormatError, match=r"joint states on /left, /right; expected one such topic, or one named /joint_states"
    ):
        both.read()
    named = Recorder()
    named.add("/commands", joints(0, {"a": 1.0}, [0.0]))
    named.add("/joint_states", joints(0, {"a": 2.0}, [0.0]))
    assert named.read().position[0, 0] == 2


@pytest.mark.parametrize(
    ("second", "message"),
    [
        (joints(1, {"a": 1.0}, [0.0]), r"message 1: joint 'b' is in only some of the messages"),
        (joints(1, {"a": 1.0, "c": 1.0}), r"message 1: joint 'b' is in only some"),
        (
            joints(1, {"a": 1.0, "b": 1.0}, [0.0]),
            r"message 1: 2 positions and 1 velocities; expected one for each of 2",
        ),
        (joints(1, {"a": np.nan, "b": 1.0}), r"position: found nan at \(1, 0\)"),
    ],
)
def test_joint_states_that_do_not_fit_together(second: Any, message: str) -> None:
    recorder = Recorder()
    recorder.add("/joint_states", joints(0, {"a": 1.0, "b": 2.0}))
    recorder.add("/joint_states", second)
    with pytest.raises(FormatError, match=message):
        recorder.read()


def test_velocities_without_positions() -> None:
    recorder = Recorder()
    kind = TYPES["sensor_msgs/msg/JointState"]
    recorder.add("/joint_states", kind(header(0), ["a"], np.zeros(0), np.ones(1), np.zeros(0)))
    with pytest.raises(FormatError, match="message 0: 0 positions and 1 velocities"):
        recorder.read()


def test_base_is_the_root_of_the_urdf_between_other_transforms() -> None:
    """A base moving at 2 m/s along X and turning at 1 rad/s about Z, recorded at other times than the joints."""
    recorder = Recorder()
    second = 10**9
    recorder.add("/robot_description", text(URDF))
    for i in range(11):
        at = i * second // 10
        turn = rotations.exp([0, 0, at / second])
        arm = transform(at, "torso", "arm", [0, 0, 9])
        recorder.add("/tf", tf(transform(at, "/odom", "/torso", [2 * at / second, 0, 1], turn), arm))
    for i in range(6):
        recorder.add("/joint_states", joints(25_000_000 + i * second // 8, {"a": 0.0}, [0.0]))
    back = recorder.read()
    at = 0.025 + np.arange(6) / 8
    assert back.base_frame == "torso"
    assert back.base_position is not None
    assert back.base_orientation is not None
    np.testing.assert_allclose(back.base_position, np.stack([2 * at, 0 * at, 0 * at + 1], axis=1), atol=1e-12)
    np.testing.assert_allclose(rotations.log(back.base_orientation)[:, 2], at, atol=1e-12)
    assert any("base pose interpolated" in warning for warning in back.provenance["warnings"])


def test_static_base_pose() -> None:
    recorder = Recorder()
    recorder.add("/tf_static", tf(transform(0, "world", "torso", [1, 2, 3], [0, 0, 0, 1])))
    recorder.add("/robot_description", text(URDF))
    for i in range(3):
        recorder.add("/joint_states", joints(100 + i, {"a": 0.0}, [0.0]))
    back = recorder.read()
    np.testing.assert_array_equal(back.base_position, [[1, 2, 3]] * 3)
    np.testing.assert_array_equal(np.abs(back.base_orientation), [[0, 0, 0, 1]] * 3)


@pytest.mark.parametrize(
    "description", [None, "no XML", '<!DOCTYPE r [<!ENTITY a "b">]><robot><link name="torso"/></robot>']
)
def test_base_that_is_not_known_is_said(description: str | None) -> None:
    recorder = Recorder()
    if description:
        recorder.add("/robot_description", text(description))
    recorder.add("/tf", tf(transform(0, "world", "torso", [1, 2, 3])))
    recorder.add("/joint_states", joints(0, {"a": 0.0}, [0.0]))
    back = recorder.read()
    assert back.base_position is None
    assert "base taken as fixed" in back.provenance["warnings"][-1]


def test_quaternion_that_is_none() -> None:
    recorder = Recorder()
    recorder.add("/robot_description", text(URDF))
    recorder.add("/tf", tf(transform(0, "world", "torso", [1, 2, 3], [0.5, 0, 0, 0])))
    recorder.add("/joint_states", joints(0, {"a": 0.0}, [0.0]))
    with pytest.raises(FormatError, match=r"transforms of 'torso', frame 0: found quaternion \[0\.5 .*expected a unit"):
        recorder.read()


def test_no_joint_states_names_the_topics_found() -> None:
    recorder = Recorder()
    recorder.add("/tf", tf(transform(0, "a", "b", [0, 0, 0])))
    recorder.add("/chat", text("hello"))
    expected = r"walk\.mcap: no sensor_msgs/msg/JointState; found /chat \(std_msgs/msg/String\), /tf \(tf2_msgs/msg/TFMessage\)"
    with pytest.raises(FormatError, match=expected):
        recorder.read()
    with pytest.raises(FormatError, match="found no messages"):
        Recorder().read()


def test_messages_that_are_not_what_their_type_says() -> None:
    recorder = Recorder()
    recorder.add("/joint_states", joints(0, {"a": 0.0}, [0.0]))
    recorder.writer.add_message(recorder.channels["/joint_states"], 0, b"\0\1\0\0" + b"\xff" * 20, 0)
    with pytest.raises(FormatError, match=r"topic /joint_states, message 1: not a sensor_msgs/msg/JointState"):
        recorder.read()


@pytest.mark.parametrize("name", ["rosbag2_cdr_test_0", "rosbag2_talker", "rosbag2_topics_and_services"])
def test_real_recordings_without_joints(name: str) -> None:
    path = REAL / f"{name}.mcap"
    if not path.exists():
        pytest.skip("the real recordings are not on this machine")
    with path.open("rb") as stream, pytest.raises(FormatError, match="no sensor_msgs/msg/JointState; found /"):
        mcap.read_trajectory(stream, path.name)
