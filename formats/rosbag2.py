"""A rosbag2 folder with MCAP storage: `metadata.yaml` and one MCAP file, for `ros2 bag play` and whatever wants a bag's folder.

The MCAP file is byte for byte what format `mcap` writes: topics, joint order (the robot's own, named), quaternion order (**xyzw**, as ROS
has it), precision and the style `joint_trajectory` are described there. `metadata.yaml` is of version 5, which ROS 2 reads from Humble on;
`/tf_static` and `/robot_description` are noted as transient local, so that late subscribers get them in playback.

There is no suffix: name the format (`--format rosbag2 -o walk_bag`). The folder is written beside its place and renamed into it.

Bags of others are read as MCAP files of others are, whatever their storage (MCAP, SQLite) and compression. Folders can't be piped.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from retarget.core.errors import FormatError
from retarget.core.types import HumanMotion, JointTrajectory
from retarget.formats import _mcap_reader, _mcap_trajectory
from retarget.formats._mcap_recording import Recording
from retarget.formats._mcap_writer import McapFile
from retarget.formats.base import Format, TrajectoryOptions

METADATA = "metadata.yaml"
STORAGE = "trajectory_0.mcap"
_LARGEST_METADATA = 1 << 20
_DEEPEST_METADATA = 50
_OPENING, _CLOSING = list(b"[{"), list(b"]}")
_BATCH = 4096


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


def read_folder(folder: Path, name: str, _options: TrajectoryOptions | None = None) -> JointTrajectory:
    """The trajectory in a bag; see the module. Raises `FormatError` for a folder that is no bag, and as format `mcap` does."""
    information = _information(folder, name)
    recording = Recording(name)
    if information.get("storage_identifier") == "mcap" and not information.get("compression_format"):
        for path in _storage_files(folder, name, information):
            with path.open("rb") as stream:
                for item in _mcap_reader.read(stream, f"{name}/{path.name}"):
                    recording.add(item)
    else:
        for batch in _foreign(folder, name):
            recording.add(batch)
    return recording.trajectory()


def _information(folder: Path, name: str) -> dict[str, Any]:
    from ruamel.yaml import YAML
    from ruamel.yaml.error import YAMLError

    with (folder / METADATA).open("rb") as stream:
        text = stream.read(_LARGEST_METADATA + 1)
    if len(text) > _LARGEST_METADATA:
        raise FormatError(name, f"{METADATA} of more than {_LARGEST_METADATA >> 20} MiB", expected="a bag's metadata")
    # The parser takes seconds over thousands of open brackets.
    bytes_ = np.frombuffer(text, np.uint8)
    if len(text) and np.cumsum(np.isin(bytes_, _OPENING) * 1 - np.isin(bytes_, _CLOSING)).max() > _DEEPEST_METADATA:
        raise FormatError(
            name, "brackets within brackets", place=METADATA, expected="the metadata of a rosbag2 recording"
        )
    try:
        loaded = YAML(typ="safe", pure=True).load(text.decode())
        found = loaded["rosbag2_bagfile_information"]
    except YAMLError as error:
        raise FormatError(name, f"not YAML: {' '.join(str(error).split())}", place=METADATA) from error
    # Nesting beyond Python's depth, other types than mappings, text that is none: the loader's and ours.
    except (KeyError, TypeError, ValueError, RecursionError, AttributeError) as error:
        problem = f"no rosbag2_bagfile_information: {type(error).__name__}"
        raise FormatError(name, problem, place=METADATA, expected="the metadata of a rosbag2 recording") from error
    if not isinstance(found, dict):
        raise FormatError(name, "rosbag2_bagfile_information is no mapping", place=METADATA)
    return found


def _storage_files(folder: Path, name: str, information: dict[str, Any]) -> list[Path]:
    """The bag's files. Only names count: bags before version 4 put their folder's before, and nothing outside the folder is read."""
    listed = information.get("relative_file_paths")
    if not isinstance(listed, list) or not listed or not all(isinstance(item, str) for item in listed):
        raise FormatError(name, "no relative_file_paths", place=METADATA, expected="the names of the bag's files")
    paths = [folder / Path(item).name for item in listed]
    for path in paths:
        if not path.is_file():
            raise FormatError(name, f"file {path.name} is missing", place=METADATA)
    return paths


def _foreign(folder: Path, name: str) -> Iterator[_mcap_reader.Batch]:
    """The messages of a bag in a storage that rosbags reads, in batches."""
    from rosbags.rosbag2 import Reader

    batches: dict[int, _mcap_reader.Batch] = {}
    try:
        with Reader(folder) as reader:
            for connection, log_time, payload in reader.messages():
                if connection.id not in batches:
                    batches[connection.id] = _mcap_reader.Batch(connection.topic, connection.msgtype, "cdr")
                batch = batches[connection.id]
                batch.log_times.append(log_time)
                batch.payloads.append(memoryview(payload))
                if len(batch.payloads) >= _BATCH:
                    yield batches.pop(connection.id)
            yield from batches.values()
    except FormatError:
        raise  # the caller's, thrown in at the yield
    # Damage of a foreign file surfaces as whatever its parser trips over: rosbags' own errors, SQLite's and zstd's.
    except Exception as error:
        raise FormatError(name, f"not a readable bag: {error or type(error).__name__}") from error


FORMAT = Format(
    name="rosbag2",
    description="rosbag2 folder: metadata.yaml and one MCAP file, for ros2 bag play",
    suffixes=(),
    recognises_folder=recognises_folder,
    read_folder=read_folder,
    write_folder=write_folder,
    styles=("default", _mcap_trajectory.WITH_JOINT_TRAJECTORY),
)
