"""What is fuzzed: every reader, a few small files for each, and the mutations that reach into them."""

from __future__ import annotations

import atexit
import gzip
import io
import re
import shutil
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from retarget import formats, robots
from retarget.core import calibration
from retarget.core.replay.thresholds import Thresholds
from retarget.core.types import HumanMotion, JointTrajectory, TrackerRecording
from retarget.formats import TrackerOptions, TrajectoryOptions

from tests.fuzz import ros_seeds
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


def sample(name: str) -> bytes:
    """A file of `retarget.samples`."""
    return files("retarget.samples").joinpath(name).read_bytes()


def short_mvnx(name: str, frames: int = 4) -> bytes:
    """A sample recording cut down to its first frames."""
    text = gzip.decompress(sample(name))
    ends = [match.end() for match in re.finditer(rb"</frame>\s*", text)]
    return text[: ends[frames + 2]] + text[ends[-1] :]


def trajectory(joints: int = 2, frames: int = 4) -> JointTrajectory:
    """A small one with everything set."""
    time = np.arange(frames) / 50.0
    return JointTrajectory(
        time=time,
        joint_names=tuple(f"joint_{i}" for i in range(joints)),
        position=np.sin(time[:, None] + np.arange(joints)),
        velocity=np.cos(time[:, None] + np.arange(joints)),
        base_position=np.zeros((frames, 3)) + time[:, None],
        base_orientation=np.tile([1.0, 0.0, 0.0, 0.0], (frames, 1)),
        base_linear_velocity=np.ones((frames, 3)),
        base_angular_velocity=np.zeros((frames, 3)),
        status=np.arange(frames) == 1,
        base_frame="pelvis",
        robot="g1",
        provenance={"options": {"rate": 60}},
        robot_description='<robot name="g1"><link name="pelvis"/></robot>',
    )


@cache
def written(format_name: str, style: str | None = None) -> bytes:
    """The small trajectory as a file of that format."""
    out = io.BytesIO()
    format_ = formats.get(format_name)
    assert format_.write_trajectory is not None
    format_.write_trajectory(out, trajectory(), style or format_.styles[0])
    return out.getvalue()


def unchecked_mcap() -> bytes:
    """The MCAP without chunks and checksums, as some recorders write it: damage reaches the messages."""
    import zstandard
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader

    data = written("mcap")
    chunks = [r for r in StreamReader(io.BytesIO(data), emit_chunks=True).records if isinstance(r, Chunk)]
    content = b"".join(zstandard.decompress(chunk.data) for chunk in chunks)
    header = b"\x01" + (8).to_bytes(8, "little") + bytes(8)
    footer = b"\x02" + (20).to_bytes(8, "little") + bytes(20)
    return data[:8] + header + content + footer + data[:8]


def foreign_hdf5(*, checksums: bool = False, **changes: Any) -> bytes:
    """The same layout as h5py writes it by default: metadata without checksums, texts in a heap; or with them. Named datasets replaced:
    by an array, or by one that is declared of a shape and never written."""
    import h5py

    t = trajectory()
    data = {
        "time": t.time,
        "joint/position": t.position,
        "joint/velocity": t.velocity,
        "base/position": t.base_position,
        "base/orientation": t.base_orientation,
        **changes,
    }
    out = io.BytesIO()
    texts = {"schema": "retarget.trajectory/1", "quat_order": "wxyz", "joint_names": list(t.joint_names)}
    with h5py.File(out, "w", libver=("v108", "v110") if checksums else None) as file:
        for name, text in texts.items():
            file.attrs[name] = np.array(text, "S") if checksums else text
        for path, value in data.items():
            if isinstance(value, tuple):
                file.create_dataset(path, value, "f8", chunks=(1000,) * len(value))
            else:
                file[path] = value
    return out.getvalue()


def lying_npz() -> bytes:
    """An array header that claims 8 TB."""
    import zipfile

    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(written("npz"))) as source, zipfile.ZipFile(out, "w") as archive:
        for name in source.namelist():
            content = source.read(name)
            archive.writestr(
                name, content.replace(b"(4, 2), }", b"(1000000000000, 2), }") if "joint_pos" in name else content
            )
    return out.getvalue()


def npz_bomb(megabytes: int = 200) -> bytes:
    """A megabyte or less that unpacks to much more."""
    out = io.BytesIO()
    np.savez_compressed(out, fps=50.0, joint_pos=np.zeros((megabytes << 16, 2)), joint_names=np.array(["a", "b"]))
    return out.getvalue()


def tracker_log(kind: str) -> bytes:
    """A short log: "wide" and "long" columns, or lines of libsurvive."""
    if kind == "wide":
        return b"\n".join(sample("clap_trackers.csv").split(b"\n")[:5]) + b"\n"
    if kind == "libsurvive":
        return b"".join(
            b"0.%d %s POSE 0.1 %d.2 1.%d 1 0 0 0\n" % (i, device, i, i) for i in range(8) for device in (b"HMD", b"T20")
        )
    rows = [b"%.2f,%s,0.%d,1.%d,0.3,1,0,0,0,1" % (i / 50, dev, i, i) for i in range(6) for dev in (b"waist", b"LHR-1")]
    return b"\n".join([b"time,device,x,y,z,qw,qx,qy,qz,valid", *rows]) + b"\n"


COLUMNS_TOML = b"""delimiter = "comma"
skip_lines = 0
header = true
up = "y"
handedness = "right"
time = "time_s"
time_unit = "s"

[trackers.chest]
x = "chest_x_m"
y = "chest_y_m"
z = 4
qw = "chest_qw"
qx = "chest_qx"
qy = "chest_qy"
qz = "chest_qz"
unit = "m"
valid = "chest_valid"
role = "chest"

[roles]
"chest" = "T8"
"""
THRESHOLDS_TOML = b"""joint_jump_max_rad = 0.2
[kinematic]
ground_penetration_mm = 5
acceleration_max_rad_s2 = "none"
[fixed]
joint_tracking_rmse_deg = 0.5
"""
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


@cache
def _bag_folder(name: str) -> Path:
    """A rosbag2 folder without metadata.yaml, with storage of both kinds."""
    folder = _folder() / name
    folder.mkdir()
    for file, content in ros_seeds.folder_files().items():
        if not file.endswith(".yaml"):
            (folder / file).write_bytes(content)
    (folder / "trajectory_0.mcap").write_bytes(written("mcap"))
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
        formats.write_trajectory(Path(folder) / "bag", trajectory(), format="rosbag2")
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
        formats.write_trajectory(folder, trajectory(), format="lerobot")
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
    """Nothing where the extra is not installed."""
    if find_spec("pyarrow") is None:
        return ()
    data = "data/chunk-000/file-000.parquet"
    return (
        Target("lerobot-info", lambda: [_dataset_files()["meta/info.json"]], _dataset("meta/info.json"), cost=5),
        Target("lerobot-own", lambda: [_dataset_files()["meta/retarget.json"]], _dataset("meta/retarget.json"), cost=5),
        Target("lerobot-data", lambda: [_dataset_files()[data]], _dataset(data), (of_bytes, over_bytes), cost=5),
    )


def _columns(data: bytes) -> Any:
    options = TrackerOptions(columns=_file(data, "columns.toml"))
    return formats.read_trackers(io.BytesIO(tracker_log("wide")), NAME, "vive", options)


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
    return [short_mvnx("walk.mvnx.gz"), short_mvnx("walk_v3.mvnx.gz")]


TARGETS: Mapping[str, Target] = {
    target.name: target
    for target in (
        Target("mvnx", _motions, _motion, cost=2),
        Target("mvnx-describe", _motions, _described("mvnx"), cost=4),
        Target("mvnx.gz", lambda: [gzip.compress(m, 1, mtime=0) for m in _motions()], _motion, (in_gzip,), cost=3),
        Target("vive", lambda: [tracker_log("wide"), tracker_log("long")], _trackers("vive")),
        Target("columns", lambda: [COLUMNS_TOML], _columns),
        Target("libsurvive", lambda: [tracker_log("libsurvive")], _trackers("libsurvive")),
        Target(
            "libsurvive.gz",
            lambda: [gzip.compress(tracker_log("libsurvive"), mtime=0), bomb(tracker_log("libsurvive"), 2_000)],
            _trackers("libsurvive"),
            (in_gzip,),
            cost=3,
        ),
        Target("mcap", lambda: [written("mcap"), unchecked_mcap()], _read_trajectory("mcap"), (in_records,)),
        Target(
            "hdf5",
            lambda: [written("hdf5"), foreign_hdf5(checksums=True, time=(10**12,))],
            _read_trajectory("hdf5"),
            (of_bytes,),
        ),
        # Every read starts a process.
        Target("hdf5-foreign", lambda: [foreign_hdf5()], _read_trajectory("hdf5"), (of_bytes,), cost=100),
        Target("csv", lambda: [written("csv")], _read_trajectory("csv")),
        Target("csv-unitree", lambda: [written("csv", "unitree")], _read_trajectory("csv", HEADERLESS)),
        Target("npz", lambda: [written("npz"), lying_npz()], _read_trajectory("npz"), (in_zip,)),
        Target("npz-gmr", lambda: [written("npz", "gmr")], _read_trajectory("npz"), (in_zip,)),
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
        Target("mcap-pipe", lambda: [*ros_seeds.mcaps(), written("mcap")], _piped, (in_records,), cost=5),
        Target("frames", lambda: [ros_seeds.FRAMES_TOML, ros_seeds.SUIT_TOML], _frames, cost=2),
        Target("msg-def", lambda: ros_seeds.MESSAGE_DEFINITIONS, _message_definition, cost=12),
        Target("msg-def-recorded", lambda: [ros_seeds.LINKS_DEFINITION], _embedded_definition, cost=20),
        *_dataset_targets(),
        Target("calibration", _calibrations, _calibration),
        Target("robot", _profiles, _robot),
        Target("thresholds", lambda: [THRESHOLDS_TOML], _thresholds),
    )
}
