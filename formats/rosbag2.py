"""A rosbag2 folder with MCAP storage: `metadata.yaml` and one MCAP file, for `ros2 bag play` and whatever wants a bag's folder.

The MCAP file is byte for byte what format `mcap` writes: topics, joint order (the robot's own, named), quaternion order (**xyzw**, as ROS
has it), precision and the style `joint_trajectory` are described there. `metadata.yaml` is of version 5, which ROS 2 reads from Humble on;
`/tf_static` and `/robot_description` are noted as transient local, so that late subscribers get them in playback.

There is no suffix: name the format (`--format rosbag2 -o walk_bag`). The folder is written beside its place and renamed into it; `--force`
replaces one only where it holds these two files and nothing else, so a recorded bag never.

Bags of others are read as MCAP files of others are, whatever their storage (MCAP, SQLite) and compression; of SQLite only the topics that
matter. Folders can't be piped.
"""

from __future__ import annotations

from pathlib import Path

from retarget.core.types import HumanMotion, JointTrajectory
from retarget.formats import _bag_storage, _mcap_trajectory
from retarget.formats._bag_metadata import METADATA
from retarget.formats._folders import holds_only
from retarget.formats._mcap_recording import USED, Recording
from retarget.formats._mcap_writer import McapFile
from retarget.formats.base import Format, TrajectoryOptions

STORAGE = "trajectory_0.mcap"


def write_folder(folder: Path, trajectory: JointTrajectory, style: str, motion: HumanMotion | None = None) -> None:
    """Write a bag's files into the empty `folder`; errors as those of format `mcap`."""
    with (folder / STORAGE).open("xb") as stream:
        file = _mcap_trajectory.write(stream, trajectory, style, motion)
    (folder / METADATA).write_text(_metadata(file), encoding="utf-8")


def _metadata(file: McapFile) -> str:
    """The text of metadata.yaml. All that goes in is ours: nothing needs quoting, except the quality of service, YAML within YAML."""
    first, last = file.time_range()
    counts = file.message_counts()
    span = f"starting_time: {{nanoseconds_since_epoch: {first}}}", f"duration: {{nanoseconds: {last - first}}}"
    lines = [
        "rosbag2_bagfile_information:",
        "  version: 5",
        "  storage_identifier: mcap",
        f"  {span[1]}",
        f"  {span[0]}",
        f"  message_count: {sum(counts)}",
        "  topics_with_message_count:",
    ]
    for topic, count in zip(file.topics, counts, strict=True):
        lines += [
            "    - topic_metadata:",
            f"        name: {topic.topic}",
            f"        type: {topic.message_type}",
            "        serialization_format: cdr",
            f'        offered_qos_profiles: "{topic.qos}"',
            f"      message_count: {count}",
        ]
    lines += [
        '  compression_format: ""',
        '  compression_mode: ""',
        f"  relative_file_paths: [{STORAGE}]",
        "  files:",
        f"    - path: {STORAGE}",
        f"      {span[0]}",
        f"      {span[1]}",
        f"      message_count: {sum(counts)}",
    ]
    return "\n".join(lines) + "\n"


def recognises_folder(folder: Path) -> bool:
    """Whether there is a bag's metadata in `folder`."""
    return (folder / METADATA).is_file()


def is_own_folder(folder: Path) -> bool:
    """Whether `folder` holds the two files of a bag written here, and nothing else."""
    return recognises_folder(folder) and holds_only(folder, (METADATA, STORAGE))


def read_folder(folder: Path, name: str, _options: TrajectoryOptions | None = None) -> JointTrajectory:
    """The trajectory in a bag; see the module. Raises `FormatError` for a folder that is no bag, and as format `mcap` does."""
    recording = Recording(name)
    for item in _bag_storage.read_folder(folder, name, lambda message_type: message_type in USED):
        if isinstance(item, _bag_storage.Unread):
            recording.topics[item.topic] = item.message_type
        else:
            recording.add(item)
    return recording.trajectory()


FORMAT = Format(
    name="rosbag2",
    description="rosbag2 folder: metadata.yaml and one MCAP file, for ros2 bag play",
    suffixes=(),
    recognises_folder=recognises_folder,
    is_own_folder=is_own_folder,
    read_folder=read_folder,
    write_folder=write_folder,
    styles=("default", _mcap_trajectory.WITH_JOINT_TRAJECTORY),
)
