"""rosbag2 folders: what rosbags reads from ours, what we read from others', and metadata that lies."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from retarget import formats
from retarget.core.errors import FormatError, RetargetError, UsageError
from retarget.core.types import JointTrajectory
from retarget.formats._ros_messages import typestore
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability
from rosbags.rosbag2 import StoragePlugin, Writer

Maker = Callable[..., JointTrajectory]


@pytest.fixture
def bag(tmp_path: Path, make_trajectory: Maker) -> Path:
    formats.write_trajectory(tmp_path / "bag", make_trajectory(), format="rosbag2")
    return tmp_path / "bag"


def test_rosbags_reads_every_message_and_the_metadata_agrees(tmp_path: Path, make_trajectory: Maker) -> None:
    trajectory = make_trajectory(frames=200, base_position=None, base_orientation=None)
    formats.write_trajectory(tmp_path / "bag", trajectory, format="rosbag2")
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["bag", "metadata.yaml", "trajectory_0.mcap"]
    with AnyReader([tmp_path / "bag"]) as reader:
        counts = {c.topic: c.msgcount for c in reader.connections}
        found: dict[str, int] = dict.fromkeys(counts, 0)
        latched = {
            c.topic
            for c in reader.connections
            for q in c.ext.offered_qos_profiles
            if q.durability is QosDurability.TRANSIENT_LOCAL
        }
        times = []
        for connection, log_time, raw in reader.messages():
            found[connection.topic] += 1
            times.append(log_time)
            if connection.topic == "/joint_states":
                message = reader.deserialize(raw, connection.msgtype)
                i = found["/joint_states"] - 1
                np.testing.assert_array_equal(message.position, trajectory.position[i])
        assert found == counts
        assert counts["/joint_states"] == 200
        assert latched == {"/tf_static", "/robot_description"}
        assert (reader.start_time, reader.end_time) == (times[0], times[-1] + 1)
        assert reader.message_count == len(times)


def test_the_storage_is_the_mcap_file(bag: Path, make_trajectory: Maker) -> None:
    formats.write_trajectory(bag.parent / "walk.mcap", make_trajectory())
    assert (bag / "trajectory_0.mcap").read_bytes() == (bag.parent / "walk.mcap").read_bytes()


def test_a_moved_bag_still_reads(bag: Path, make_trajectory: Maker) -> None:
    back = formats.read_trajectory(bag.rename(bag.with_name("renamed")))
    np.testing.assert_array_equal(back.position, make_trajectory().position)
    assert formats.describe(bag.with_name("renamed"))["format"] == "rosbag2"


@pytest.mark.parametrize("storage", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
@pytest.mark.parametrize("version", [8, 9])
def test_bags_of_others(bag: Path, make_trajectory: Maker, storage: StoragePlugin, version: int) -> None:
    """Copied by rosbags into each of its storages, without our metadata record."""
    trajectory, copy = make_trajectory(), bag.with_name("copy")
    with AnyReader([bag]) as reader, Writer(copy, version=version, storage_plugin=storage) as writer:  # type: ignore[arg-type]  # 8 or 9
        out = {c.id: writer.add_connection(c.topic, c.msgtype, typestore=typestore()) for c in reader.connections}
        for connection, log_time, raw in reader.messages():
            writer.write(out[connection.id], log_time, raw)
    back = formats.read_trajectory(copy)
    assert back.joint_names == trajectory.joint_names
    np.testing.assert_allclose(back.time, trajectory.time, atol=1e-9)
    np.testing.assert_array_equal(back.position, trajectory.position)
    np.testing.assert_array_equal(back.velocity, trajectory.velocity)
    np.testing.assert_array_equal(back.base_position, trajectory.base_position)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no rosbag2_bagfile_information"),
        ("- a\n- b", "no rosbag2_bagfile_information"),
        ("rosbag2_bagfile_information: 3", "is no mapping"),
        ("a: [", "not YAML"),
        ("[" * 20_000, "brackets within brackets"),
        ("[" * 50, "not YAML"),
        ("!!python/object/apply:os.system [ls]", "not YAML|no rosbag2_bagfile_information"),
        ("rosbag2_bagfile_information: {storage_identifier: mcap}", "no relative_file_paths"),
        (
            "rosbag2_bagfile_information: {storage_identifier: mcap, relative_file_paths: [../secret.mcap]}",
            "file secret.mcap is missing",
        ),
        (
            "rosbag2_bagfile_information: {storage_identifier: mcap, relative_file_paths: ['..']}",
            r"file \.\. is missing",
        ),
        ("rosbag2_bagfile_information: {storage_identifier: sqlite3}", "no relative_file_paths"),
        ("rosbag2_bagfile_information: {version: 99}", "rosbag2 version 99; expected 1 to 9"),
        (
            "rosbag2_bagfile_information: {storage_identifier: csv}",
            "storage_identifier 'csv'; expected mcap or sqlite3",
        ),
        ("rosbag2_bagfile_information: {storage_identifier: mcap, compression_mode: all}", "compression_mode 'all'"),
        (
            "rosbag2_bagfile_information: {storage_identifier: mcap, compression_mode: FILE, compression_format: lz4}",
            "compression_format 'lz4'; expected zstd",
        ),
        (
            "rosbag2_bagfile_information: {storage_identifier: mcap, relative_file_paths: [trajectory_0.mcap, a/trajectory_0.mcap]}",
            "names a file twice",
        ),
        ("\xff\0", "no rosbag2_bagfile_information|not YAML"),
    ],
)
def test_metadata_that_is_none(bag: Path, text: str, message: str) -> None:
    (bag.parent / "secret.mcap").write_bytes((bag / "trajectory_0.mcap").read_bytes())
    (bag / "metadata.yaml").write_text(text, encoding="latin-1")
    with pytest.raises(FormatError, match=message) as caught:
        formats.read_trajectory(bag)
    assert "\n" not in str(caught.value)


def test_truncated_storage(bag: Path) -> None:
    data = (bag / "trajectory_0.mcap").read_bytes()
    (bag / "trajectory_0.mcap").write_bytes(data[:-100])
    with pytest.raises(FormatError, match=r"bag/trajectory_0\.mcap.*the file ends inside"):
        formats.read_trajectory(bag)


def test_topics_that_matter_to_nothing_are_named_and_not_read(bag: Path) -> None:
    """Of SQLite only messages of types that a trajectory is made of are asked for; cameras fill bags with gigabytes."""
    copy = bag.with_name("copy")
    with Writer(copy, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        camera = writer.add_connection("/camera", "sensor_msgs/msg/Image", typestore=typestore())
        writer.write(camera, 1, b"no image at all")
    with pytest.raises(FormatError, match=r"no sensor_msgs/msg/JointState; found /camera \(sensor_msgs/msg/Image\)"):
        formats.read_trajectory(copy)


def test_folders_that_are_no_bag(tmp_path: Path) -> None:
    (tmp_path / "plain").mkdir()
    with pytest.raises(UsageError, match="is no folder of format rosbag2"):
        formats.read_trajectory(tmp_path / "plain", format="rosbag2")
    with pytest.raises(RetargetError, match="is a directory"):
        formats.read_trajectory(tmp_path / "plain")
