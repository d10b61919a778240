"""Our MCAP against the two independent readers, mcap_ros2 and rosbags, and against the structure that the mcap package expects."""

from __future__ import annotations

import io
import json
import warnings
import zlib
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zstandard
from mcap.reader import NonSeekingReader, SeekingReader, make_reader
from mcap.records import Chunk, Message, MessageIndex
from mcap.stream_reader import StreamReader, breakup_chunk
from retarget.core.errors import FormatError, RetargetError
from retarget.core.types import JointTrajectory
from retarget.formats import _cdr, _trajectory, mcap
from retarget.formats._ros_messages import typestore
from rosbags.highlevel import AnyReader

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)
    from mcap_ros2.reader import read_ros2_messages

Maker = Callable[..., JointTrajectory]
FRAMES = 2500
"""Enough for more than one chunk of each size of trajectory below."""


def encode(trajectory: JointTrajectory) -> bytes:
    out = io.BytesIO()
    mcap.write_trajectory(out, trajectory)
    return out.getvalue()


def decode(data: bytes) -> JointTrajectory:
    return mcap.read_trajectory(io.BytesIO(data), "walk.mcap")


@pytest.fixture(scope="module")
def long(make_trajectory: Maker) -> JointTrajectory:
    return make_trajectory(frames=FRAMES, joints=29, rate_hz=240)


@pytest.fixture(scope="module")
def data(long: JointTrajectory) -> bytes:
    return encode(long)


def stamp_ns(header: Any) -> int:
    return int(header.stamp.sec) * 10**9 + int(header.stamp.nanosec)


def check_against(trajectory: JointTrajectory, messages: dict[str, list[tuple[int, Any]]]) -> None:
    """Every number of every message of `trajectory` as an independent reader decoded it, (log time, message) by topic."""
    expected_ns = [round(t * 1e9) for t in trajectory.time.tolist()]
    for i, (log_time, message) in enumerate(messages["/joint_states"]):
        assert log_time == stamp_ns(message.header) == expected_ns[i]
        assert tuple(message.name) == trajectory.joint_names
        np.testing.assert_array_equal(message.position, trajectory.position[i])
        np.testing.assert_array_equal(message.velocity, trajectory.velocity[i])
        assert len(message.effort) == 0
    for i, (log_time, message) in enumerate(messages["/tf"]):
        (item,) = message.transforms
        assert log_time == stamp_ns(item.header) == expected_ns[i]
        assert (item.header.frame_id, item.child_frame_id) == ("world", trajectory.base_frame)
        t, q = item.transform.translation, item.transform.rotation
        np.testing.assert_array_equal([t.x, t.y, t.z], trajectory.base_position[i])
        np.testing.assert_array_equal([q.w, q.x, q.y, q.z], trajectory.base_orientation[i])
    for i, (log_time, message) in enumerate(messages["/base_twist"]):
        assert log_time == stamp_ns(message.header) == expected_ns[i]
        assert message.header.frame_id == "world"
        linear, angular = message.twist.linear, message.twist.angular
        np.testing.assert_array_equal([linear.x, linear.y, linear.z], trajectory.base_linear_velocity[i])
        np.testing.assert_array_equal([angular.x, angular.y, angular.z], trajectory.base_angular_velocity[i])
    assert [message.data for _, message in messages["/frame_status"]] == trajectory.status.tolist()
    assert [message.data for _, message in messages["/robot_description"]] == [trajectory.robot_description]
    per_frame = ("/joint_states", "/tf", "/base_twist", "/frame_status")
    assert {topic: len(found) for topic, found in messages.items()} == {
        **dict.fromkeys(per_frame, trajectory.frames),
        "/robot_description": 1,
    }


class TestIndependentReaders:
    def test_mcap_ros2_reads_exactly_what_was_written(self, long: JointTrajectory, data: bytes) -> None:
        messages: dict[str, list[tuple[int, Any]]] = {}
        for item in read_ros2_messages(io.BytesIO(data)):
            messages.setdefault(item.channel.topic, []).append((item.log_time_ns, item.ros_msg))
        check_against(long, messages)

    def test_rosbags_reads_exactly_what_was_written(self, tmp_path: Path, long: JointTrajectory, data: bytes) -> None:
        (tmp_path / "walk.mcap").write_bytes(data)
        messages: dict[str, list[tuple[int, Any]]] = {}
        with AnyReader([tmp_path / "walk.mcap"]) as reader:
            for connection, log_time, raw in reader.messages():
                message = reader.deserialize(raw, connection.msgtype)
                messages.setdefault(connection.topic, []).append((log_time, message))
        check_against(long, messages)

    def test_fixed_base_is_a_static_identity(self, make_trajectory: Maker) -> None:
        fixed = make_trajectory(base_position=None, base_orientation=None)
        found = {m.channel.topic: m.ros_msg for m in read_ros2_messages(io.BytesIO(encode(fixed)))}
        assert "/tf" not in found
        (item,) = found["/tf_static"].transforms
        assert (item.header.frame_id, item.child_frame_id) == ("world", "pelvis")
        t, q = item.transform.translation, item.transform.rotation
        assert (t.x, t.y, t.z, q.w, q.x, q.y, q.z) == (0, 0, 0, 1, 0, 0, 0)


class TestStructure:
    def test_header_and_metadata(self, data: bytes) -> None:
        reader = SeekingReader(io.BytesIO(data))
        assert reader.get_header().profile == "ros2"
        (record,) = SeekingReader(io.BytesIO(data)).iter_metadata()
        assert record.name == "retarget"
        assert record.metadata["robot"] == "g1"
        assert record.metadata["base_frame"] == "pelvis"
        assert json.loads(record.metadata["joint_names"])[3] == "left_joint_3"
        assert json.loads(record.metadata["provenance"])["options"]["names"] == ["é", "b"]

    def test_statistics_and_chunk_indexes(self, long: JointTrajectory, data: bytes) -> None:
        summary = SeekingReader(io.BytesIO(data), validate_crcs=True).get_summary()
        assert summary is not None
        assert summary.statistics is not None
        topics = {channel.id: channel.topic for channel in summary.channels.values()}
        counts = {topics[i]: n for i, n in summary.statistics.channel_message_counts.items()}
        assert counts.pop("/robot_description") == 1
        assert counts == dict.fromkeys(("/joint_states", "/tf", "/base_twist", "/frame_status"), FRAMES)
        assert summary.statistics.message_count == 4 * FRAMES + 1
        assert summary.statistics.chunk_count == len(summary.chunk_indexes) > 3
        assert summary.statistics.metadata_count == len(summary.metadata_indexes) == 1
        assert summary.statistics.message_start_time == 0
        assert summary.statistics.message_end_time == round(long.time[-1] * 1e9)
        for index in summary.chunk_indexes:
            assert data[index.chunk_start_offset] == 0x06
            size = int.from_bytes(data[index.chunk_start_offset + 1 : index.chunk_start_offset + 9], "little")
            assert size + 9 == index.chunk_length
            assert all(data[offset] == 0x07 for offset in index.message_index_offsets.values())
            end = index.chunk_start_offset + index.chunk_length
            assert end <= min(index.message_index_offsets.values()) <= end + index.message_index_length

    def test_message_indexes_point_at_their_messages(self, data: bytes) -> None:
        chunk = b""
        pointed: Counter[int] = Counter()
        for record in StreamReader(io.BytesIO(data), emit_chunks=True).records:
            if isinstance(record, Chunk):
                records = breakup_chunk(record, validate_crc=True)
                assert record.message_start_time == min(m.log_time for m in records if isinstance(m, Message))
                assert record.message_end_time == max(m.log_time for m in records if isinstance(m, Message))
                chunk = zstandard.decompress(record.data)
            elif isinstance(record, MessageIndex):
                for log_time, offset in record.records:
                    assert chunk[offset] == 0x05
                    assert int.from_bytes(chunk[offset + 9 : offset + 11], "little") == record.channel_id
                    assert int.from_bytes(chunk[offset + 15 : offset + 23], "little") == log_time
                    pointed[record.channel_id] += 1
        assert sorted(pointed.values()) == [1, *[FRAMES] * 4]

    def test_checksums_hold_front_to_back(self, data: bytes) -> None:
        messages = NonSeekingReader(io.BytesIO(data), validate_crcs=True).iter_messages(log_time_order=False)
        assert sum(1 for _ in messages) == 4 * FRAMES + 1

    def test_summary_offsets_and_summary_checksum(self, data: bytes) -> None:
        """The mcap package checks neither; both as https://mcap.dev/spec says."""
        footer = data[-8 - 29 : -8]
        assert footer[:9] == b"\x02" + (20).to_bytes(8, "little")
        summary_start, offsets_start = (int.from_bytes(footer[at : at + 8], "little") for at in (9, 17))
        checked = data[summary_start : len(data) - 8 - 4]
        assert int.from_bytes(footer[25:29], "little") == zlib.crc32(checked)
        groups = {}
        at = offsets_start
        while data[at] == 0x0E:
            opcode, start, size = data[at + 9], *(int.from_bytes(data[at + i : at + i + 8], "little") for i in (10, 18))
            groups[opcode] = (start, start + size)
            at += 9 + 17
        assert at == len(data) - 8 - 29
        assert sorted(groups) == [0x03, 0x04, 0x08, 0x0B, 0x0D]
        # Group after group without a hole, each beginning with a record of its own kind.
        spans = sorted(groups.values())
        assert [spans[0][0], *(stop for _, stop in spans)] == [*(start for start, _ in spans), offsets_start]
        assert spans[0][0] == summary_start
        assert all(data[start] == opcode for opcode, (start, _) in groups.items())

    def test_seeking_by_time_and_topic(self, long: JointTrajectory, data: bytes) -> None:
        start, stop = round(long.time[1000] * 1e9), round(long.time[1010] * 1e9)
        reader = make_reader(io.BytesIO(data), validate_crcs=True)
        found = list(reader.iter_messages("/tf", starting_at=start, ending_before=stop))
        assert [message.sequence for _, _, message in found] == list(range(1000, 1010))

    def test_messages_of_a_frame_lie_together(self, data: bytes) -> None:
        reader = NonSeekingReader(io.BytesIO(data))
        times = [message.log_time for _, _, message in reader.iter_messages(log_time_order=False)]
        assert times == sorted(times)

    def test_same_trajectory_same_bytes(self, long: JointTrajectory, data: bytes) -> None:
        assert encode(long) == data


class TestCdr:
    @pytest.mark.parametrize("names", [(), ("a",), ("ab", "é", "", "left_knee_joint"), tuple("abcdefg")])
    @pytest.mark.parametrize("frame_id", ["", "a", "world"])
    def test_layouts_are_what_rosbags_serializes(self, names: tuple[str, ...], frame_id: str) -> None:
        store = typestore()
        types = store.types
        rng = np.random.default_rng(len(names))
        numbers = [rng.normal(size=len(names)) for _ in range(3)]
        header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](7, 8), frame_id)
        vectors = rng.normal(size=(2, 3))
        linear, angular = (types["geometry_msgs/msg/Vector3"](*v) for v in vectors)
        rotation = rng.normal(size=4)
        pose = types["geometry_msgs/msg/Transform"](linear, types["geometry_msgs/msg/Quaternion"](*rotation))
        stamped = types["geometry_msgs/msg/TransformStamped"](header, "child", pose)
        twist = types["geometry_msgs/msg/Twist"](linear, angular)
        stamp = {"sec": 7, "nanosec": 8}
        joint = types["sensor_msgs/msg/JointState"](header, list(names), *numbers)
        cases: list[tuple[str, Any, Callable[[_cdr.Layout], None], dict[str, Any]]] = [
            (
                "sensor_msgs/msg/JointState",
                joint,
                lambda layout: _cdr.joint_state(layout, frame_id, names, *[len(names)] * 3),
                stamp | dict(zip(("position", "velocity", "effort"), numbers, strict=True)),
            ),
            (
                "tf2_msgs/msg/TFMessage",
                types["tf2_msgs/msg/TFMessage"]([stamped, stamped, stamped]),
                lambda layout: _cdr.transforms(layout, [(frame_id, "child")] * 3),
                {
                    f"{i}.{slot}": value
                    for i in range(3)
                    for slot, value in (stamp | {"translation": vectors[0], "rotation": rotation}).items()
                },
            ),
            (
                "geometry_msgs/msg/TwistStamped",
                types["geometry_msgs/msg/TwistStamped"](header, twist),
                lambda layout: _cdr.twist(layout, frame_id),
                stamp | {"linear": vectors[0], "angular": vectors[1]},
            ),
            ("std_msgs/msg/Int8", types["std_msgs/msg/Int8"](-3), _cdr.int8, {"data": -3}),
            ("std_msgs/msg/String", types["std_msgs/msg/String"]("é text"), lambda la: _cdr.string(la, "é text"), {}),
        ]
        for message_type, message, lay_out, values in cases:
            layout = _cdr.Layout()
            lay_out(layout)
            row = layout.rows(1)
            assert set(values) == set(layout.slots)
            for slot, value in values.items():
                row[slot] = value
            expected = bytes(store.serialize_cdr(message, message_type, little_endian=True))
            assert row.tobytes() == expected, message_type
            for padding in range(4):
                matched = layout.match([expected + bytes(padding)] * 2)
                assert matched is not None
                for slot, value in values.items():
                    np.testing.assert_array_equal(matched[slot][1], value)

    def test_messages_that_differ_in_a_name_or_length_do_not_match(self) -> None:
        layout = _cdr.Layout()
        _cdr.joint_state(layout, "", ["a", "b"], 2, 2)
        good = layout.rows(1).tobytes()
        other = _cdr.Layout()
        _cdr.joint_state(other, "", ["a", "c"], 2, 2)
        assert layout.match([good, good]) is not None
        assert layout.match([good, other.rows(1).tobytes()]) is None
        assert layout.match([good, good + b"\0"]) is None
        assert layout.match([good + bytes(4)]) is None
        assert layout.match([good[:-1]]) is None


class TestTimes:
    @pytest.mark.parametrize("start", [0.0, 1 / 3, 12345.678, 1.7e9, 2**31 - 100.0])
    @pytest.mark.parametrize("rate", [60.0, 240.0, 1000.0])
    def test_times_come_back_within_half_a_nanosecond(self, make_trajectory: Maker, start: float, rate: float) -> None:
        time = start + np.arange(300) / rate
        back = decode(encode(make_trajectory(frames=300, time=time))).time
        # A double of this size is itself no finer than this.
        resolution = np.spacing(time[-1])
        assert np.abs(back - time).max() <= max(0.5000001e-9, resolution)

    def test_times_of_whole_microseconds_come_back_bit_for_bit(self, make_trajectory: Maker) -> None:
        time = np.array([0.0, 0.1, 0.3, 12.345678, 86400.000001, 1e6 + 0.7])
        np.testing.assert_array_equal(decode(encode(make_trajectory(frames=6, time=time))).time, time)

    @pytest.mark.parametrize(
        ("time", "message"),
        [
            ([-0.5, 0.0], "time runs from -0.5 s"),
            ([0.0, 2.0**31], "expected within 0 and 2³¹ s"),
            ([1.0, 1.0 + 1e-10], "frames 0 and 1 are less than a nanosecond apart"),
        ],
    )
    def test_times_that_ros_cannot_hold(self, make_trajectory: Maker, time: list[float], message: str) -> None:
        out = io.BytesIO()
        with pytest.raises(RetargetError, match=message):
            mcap.write_trajectory(out, make_trajectory(frames=2, time=np.array(time)))
        assert not out.getvalue()


class TestWhatIsLeftOut:
    def test_no_status_topic_when_no_frame_is_marked(self, make_trajectory: Maker) -> None:
        trajectory = make_trajectory(status=np.zeros(6, np.int8), robot_description="", base_angular_velocity=None)
        topics = {m.channel.topic for m in read_ros2_messages(io.BytesIO(encode(trajectory)))}
        assert topics == {"/joint_states", "/tf", "/base_twist"}

    def test_half_a_twist_is_kept(self, make_trajectory: Maker) -> None:
        for known, unknown in (("linear", "angular"), ("angular", "linear")):
            trajectory = make_trajectory(**{f"base_{unknown}_velocity": None})
            back = decode(encode(trajectory))
            assert getattr(back, f"base_{unknown}_velocity") is None
            kept = getattr(back, f"base_{known}_velocity")
            np.testing.assert_array_equal(kept, getattr(trajectory, f"base_{known}_velocity"))

    def test_base_frame_called_world_has_another_parent(self, make_trajectory: Maker) -> None:
        back = decode(encode(make_trajectory(base_frame="world")))
        assert back.base_frame == "world"
        assert back.base_position is not None


class TestDamage:
    def test_truncated_anywhere_is_one_clear_error(self, make_trajectory: Maker) -> None:
        data = encode(make_trajectory())
        for size in range(1, len(data), 3):
            with pytest.raises(FormatError, match=r"^walk\.mcap.*the file ends inside.*expected a complete MCAP"):
                decode(data[:size])

    def test_any_changed_byte_of_the_data_section_is_noticed(self, make_trajectory: Maker) -> None:
        data = encode(make_trajectory())
        end = data.index(b"\x0f\x04\x00\x00\x00\x00\x00\x00\x00")
        for at in range(end):
            damaged = data[:at] + bytes([data[at] ^ 0x10]) + data[at + 1 :]
            with pytest.raises(FormatError):
                decode(damaged)

    def test_trailing_bytes_are_reported(self, make_trajectory: Maker) -> None:
        data = encode(make_trajectory())
        back = decode(data + data[:100])
        assert back.provenance["warnings"] == ["100 bytes after the end of the MCAP document were not read"]
        assert "warnings" not in decode(data).provenance

    def test_other_content(self) -> None:
        with pytest.raises(FormatError, match=r"starts with b'GIF89a..'; expected MCAP's magic"):
            decode(b"GIF89a  " + bytes(100))

    def test_newer_schema_is_refused(self, make_trajectory: Maker, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(_trajectory, "SCHEMA", "retarget.trajectory/2")
        data = encode(make_trajectory())
        monkeypatch.undo()
        with pytest.raises(
            FormatError, match=r"found schema 'retarget\.trajectory/2'; expected 'retarget\.trajectory/1'"
        ):
            decode(data)
