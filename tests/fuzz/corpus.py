"""What is fuzzed: every reader, a few small files for each, and the mutations that reach into them."""

from __future__ import annotations

import atexit
import gzip
import io
import shutil
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from unittest.mock import patch

from retarget import formats, robots
from retarget.core import calibration
from retarget.core.replay.thresholds import Thresholds
from retarget.core.timebase import joined
from retarget.core.types import HumanMotion, JointTrajectory, TrackerRecording
from retarget.formats import TrackerOptions, TrajectoryOptions, _ros_stream

from tests.fuzz import ros_seeds, seeds
from tests.fuzz.mutations import (
    Mutation,
    bomb,
    in_gzip,
    in_records,
    in_sqlite,
    in_zip,
    of_bytes,
    of_text,
    over_bytes,
)

NAME = "input"


@dataclass(frozen=True)
class Target:
    """One reader. seeds: good files, most of which it accepts. read: gives anything, or raises. mutations: drawn from evenly. cost: how many times slower than others it is."""

    name: str
    seeds: Callable[[], Sequence[bytes]]
    read: Callable[[bytes], Any]
    mutations: tuple[Mutation, ...] = (of_bytes, of_text)
    cost: int = 1


ROLES_OPTIONS = TrackerOptions(up="y")
HEADERLESS = TrajectoryOptions(style="unitree", rate_hz=50.0, joint_names=("a", "b"), quaternion_order=None)


def _motion(data: bytes) -> HumanMotion:
    return formats.read_motion(io.BytesIO(data), NAME, "mvnx")


def _described(name: str) -> Callable[[bytes], Any]:
    return lambda data: formats.describe(io.BytesIO(data), NAME, name)


def _trackers(name: str) -> Callable[[bytes], TrackerRecording]:
    return lambda data: formats.read_trackers(io.BytesIO(data), NAME, name, ROLES_OPTIONS)


def _read_trajectory(name: str, options: TrajectoryOptions | None = None) -> Callable[[bytes], JointTrajectory]:
    return lambda data: formats.read_trajectory(io.BytesIO(data), NAME, name, options)


@cache
def _folder() -> Path:
    folder = tempfile.mkdtemp(prefix="retarget-fuzz-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


def _file(data: bytes, name: str) -> Path:
    path = _folder() / name
    path.write_bytes(data)
    return path


class _Pipe(io.RawIOBase):
    """A stream of bytes that can't seek."""

    def __init__(self, data: bytes) -> None:
        self._rest = io.BytesIO(data)

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        return self._rest.readinto(buffer)


def _recording(name: str, options: TrackerOptions | None = None) -> Callable[[bytes], Any]:
    """Reads bytes as a person's recording from a stream; names: of the format."""
    return lambda data: formats.read_recording(io.BytesIO(data), NAME, name, options)


def _recording_file(suffix: str) -> Callable[[bytes], Any]:
    """The same from a file, which libraries open by its path."""
    return lambda data: formats.read_recording(_file(data, f"recording{suffix}"), NAME)


def _piped(data: bytes) -> Any:
    return formats.describe(io.BufferedReader(_Pipe(data)), NAME)


def _in_parts(data: bytes) -> Any:
    """A recording of seconds in parts of tenths of them."""
    with patch.multiple(_ros_stream, PART_S=0.3, SLACK_S=0.1):
        parts = list(formats.stream_recording(io.BufferedReader(_Pipe(data)), 0.5, NAME))
    return joined(parts) if isinstance(parts[0], HumanMotion) else parts[0]


@cache
def _bag_folder(name: str) -> Path:
    """A rosbag2 folder without metadata.yaml, with storage of both kinds."""
    folder = _folder() / name
    folder.mkdir()
    for file, content in ros_seeds.folder_files().items():
        if not file.endswith(".yaml"):
            (folder / file).write_bytes(content)
    (folder / "trajectory_0.mcap").write_bytes(seeds.written("mcap"))
    return folder


def _bag_metadata(read: Callable[..., Any]) -> Callable[[bytes], Any]:
    def read_folder(data: bytes) -> Any:
        folder = _bag_folder("bag")
        (folder / "metadata.yaml").write_bytes(data)
        return read(folder, NAME)

    return read_folder


def _bag_storage(kind: str) -> Callable[[bytes], Any]:
    def read_folder(data: bytes) -> Any:
        folder = _bag_folder(f"{kind}-bag")
        (folder / "metadata.yaml").write_bytes(ros_seeds.folder_files()[f"{kind}.yaml"])
        (folder / ("sqlite.db3" if kind == "sqlite" else "mcap.mcap")).write_bytes(data)
        return formats.read_recording(folder, NAME)

    return read_folder


def _own_metadata() -> bytes:
    """metadata.yaml of a folder written here."""
    with tempfile.TemporaryDirectory() as folder:
        formats.write_trajectory(Path(folder) / "bag", seeds.trajectory(), format="rosbag2")
        return (Path(folder) / "bag" / "metadata.yaml").read_bytes()


def _frames(data: bytes) -> Any:
    options = TrackerOptions(frames=_file(data, "frames.toml"))
    return formats.read_recording(io.BytesIO(ros_seeds.mcaps()[0]), NAME, "mcap", options)


def _message_definition(data: bytes) -> Any:
    """The definition as a file of its own, beside that of what it refers to."""
    folder = _folder() / "definitions"
    folder.mkdir(exist_ok=True)
    (folder / "LinkState.msg").write_text(ros_seeds.LINK_STATE)
    (folder / "LinkStateArray.msg").write_bytes(data)
    return formats.read_recording(io.BytesIO(_undefined_links()), NAME, "mcap", TrackerOptions(msg_defs=(folder,)))


@cache
def _undefined_links() -> bytes:
    return ros_seeds.links_mcap()


def _embedded_definition(data: bytes) -> Any:
    """The definition as the recording holds it."""
    return formats.read_recording(io.BytesIO(ros_seeds.links_mcap(data)), NAME, "mcap")


@cache
def _dataset_files() -> dict[str, bytes]:
    """Files of a LeRobot dataset by their path in it."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "dataset"
        formats.write_trajectory(folder, seeds.trajectory(), format="lerobot")
        return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def _dataset(mutated: str) -> Callable[[bytes], Any]:
    def read_folder(data: bytes) -> Any:
        folder = _folder() / f"dataset-{Path(mutated).name}"
        if not folder.exists():
            for name, content in _dataset_files().items():
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                (folder / name).write_bytes(content)
        (folder / mutated).write_bytes(data)
        return formats.read_trajectory(folder, NAME)

    return read_folder


def _dataset_targets() -> Sequence[Target]:
    """Nothing where the extra is not installed. Reads of data start a process."""
    if find_spec("pyarrow") is None:
        return ()
    data = "data/chunk-000/file-000.parquet"
    return (
        Target("lerobot-info", lambda: [_dataset_files()["meta/info.json"]], _dataset("meta/info.json"), cost=20),
        Target(
            "lerobot-own", lambda: [_dataset_files()["meta/retarget.json"]], _dataset("meta/retarget.json"), cost=50
        ),
        Target("lerobot-data", lambda: [_dataset_files()[data]], _dataset(data), (of_bytes, over_bytes), cost=30),
    )


def _columns(data: bytes) -> Any:
    options = TrackerOptions(columns=_file(data, "columns.toml"))
    return formats.read_trackers(io.BytesIO(seeds.tracker_log("wide")), NAME, "vive", options)


def _calibration(data: bytes) -> Any:
    return calibration.load(_file(data, "calibration.json"))


def _robot(data: bytes) -> Any:
    return robots.load(str(_file(data, "robot.toml")))


def _thresholds(data: bytes) -> Any:
    return Thresholds.load(_file(data, "thresholds.toml"), "fixed")


def _calibrations() -> Sequence[bytes]:
    from tests.fuzz.small_calibration import small_calibration

    return [small_calibration().encode()]


def _profiles() -> Sequence[bytes]:
    folder = Path(str(files("retarget.robots")))
    return [(folder / f"{name}.toml").read_bytes() for name in ("icub", "tocabi", "g1")]


def _motions() -> Sequence[bytes]:
    return [seeds.short_mvnx("walk.mvnx.gz"), seeds.short_mvnx("walk_v3.mvnx.gz")]


TARGETS: Mapping[str, Target] = {
    target.name: target
    for target in (
        Target("mvnx", _motions, _motion, cost=2),
        Target("mvnx-describe", _motions, _described("mvnx"), cost=4),
        Target("mvnx.gz", lambda: [gzip.compress(m, 1, mtime=0) for m in _motions()], _motion, (in_gzip,), cost=3),
        Target("vive", lambda: [seeds.tracker_log("wide"), seeds.tracker_log("long")], _trackers("vive")),
        Target("columns", lambda: [seeds.COLUMNS_TOML], _columns),
        Target("libsurvive", lambda: [seeds.tracker_log("libsurvive")], _trackers("libsurvive")),
        Target(
            "libsurvive.gz",
            lambda: [
                gzip.compress(seeds.tracker_log("libsurvive"), mtime=0),
                bomb(seeds.tracker_log("libsurvive"), 2_000),
            ],
            _trackers("libsurvive"),
            (in_gzip,),
            cost=3,
        ),
        Target(
            "mcap", lambda: [seeds.written("mcap"), seeds.unchecked_mcap()], _read_trajectory("mcap"), (in_records,)
        ),
        Target(
            "hdf5",
            lambda: [seeds.written("hdf5"), seeds.foreign_hdf5(checksums=True, time=(10**12,))],
            _read_trajectory("hdf5"),
            (of_bytes,),
        ),
        # Every read starts a process.
        Target("hdf5-foreign", lambda: [seeds.foreign_hdf5()], _read_trajectory("hdf5"), (of_bytes,), cost=100),
        Target("csv", lambda: [seeds.written("csv")], _read_trajectory("csv")),
        Target("csv-unitree", lambda: [seeds.written("csv", "unitree")], _read_trajectory("csv", HEADERLESS)),
        Target("npz", lambda: [seeds.written("npz"), seeds.lying_npz()], _read_trajectory("npz"), (in_zip,)),
        Target("npz-gmr", lambda: [seeds.written("npz", "gmr")], _read_trajectory("npz"), (in_zip,)),
        Target("rosbag", ros_seeds.bags, _recording_file(".bag"), (of_bytes, over_bytes), cost=10),
        Target("db3", ros_seeds.databases, _recording_file(".db3"), (in_sqlite,), cost=10),
        Target(
            "rosbag2-metadata",
            lambda: [content for name, content in ros_seeds.folder_files().items() if name.endswith(".yaml")],
            _bag_metadata(formats.read_recording),
            cost=8,
        ),
        Target("rosbag2-metadata-robot", lambda: [_own_metadata()], _bag_metadata(formats.read_trajectory), cost=6),
        Target(
            "rosbag2-sqlite",
            lambda: [ros_seeds.folder_files()["sqlite.db3"]],
            _bag_storage("sqlite"),
            (in_sqlite,),
            cost=8,
        ),
        Target(
            "rosbag2-mcap",
            lambda: [ros_seeds.folder_files()["mcap.mcap"]],
            _bag_storage("mcap"),
            (in_records,),
            cost=7,
        ),
        Target("mcap-recording", ros_seeds.mcaps, _recording("mcap"), (in_records,), cost=4),
        Target("mcap-robot", lambda: [ros_seeds.robot_mcap()], _read_trajectory("mcap"), (in_records,)),
        Target("mcap-pipe", lambda: [*ros_seeds.mcaps(), seeds.written("mcap")], _piped, (in_records,), cost=5),
        Target("mcap-parts", ros_seeds.suits, _in_parts, (in_records,), cost=10),
        Target("frames", lambda: [ros_seeds.FRAMES_TOML, ros_seeds.SUIT_TOML], _frames, cost=2),
        Target("msg-def", lambda: ros_seeds.MESSAGE_DEFINITIONS, _message_definition, cost=12),
        Target("msg-def-recorded", lambda: [ros_seeds.LINKS_DEFINITION], _embedded_definition, cost=20),
        *_dataset_targets(),
        Target("calibration", _calibrations, _calibration),
        Target("robot", _profiles, _robot),
        Target("thresholds", lambda: [seeds.THRESHOLDS_TOML], _thresholds),
    )
}
