"""Every writer with every reader, ours and others': times, names, positions, velocities and base come back as precisely as stated here.

test_roundtrip.py asks more of formats that keep everything (any trajectory, bit for bit); here stands what each of them promises, and what
the readers of others find in its files: mcap_ros2 and rosbags, h5py, pyarrow, NumPy and Python's csv. A format or style that is new fails until it
has a line and a reader.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from mcap_ros2.reader import read_ros2_messages
from numpy.typing import NDArray
from retarget import formats
from retarget.core.types import JointTrajectory
from retarget.formats import TrajectoryOptions
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

Maker = Callable[..., JointTrajectory]
Found = Mapping[str, Any]
RATE_HZ, FRAMES, JOINTS = 50.0, 40, 5


@dataclass(frozen=True)
class Promise:
    """What a file keeps. Tolerances: relative to the number; 0 = bit for bit, None = not kept. time: absolute, s.

    fixed: a fixed base comes back as one, not as one that stays at the origin. Names of joints always come back, or are given.
    """

    time: float = 0.0
    position: float = 0.0
    velocity: float | None = 0.0
    base: float = 0.0
    fixed: bool = True

    def with_other(self, other: Promise) -> Promise:
        """What is left behind both."""
        known = self.velocity is not None and other.velocity is not None
        return Promise(
            time=self.time + other.time,
            position=self.position + other.position,
            velocity=(self.velocity or 0.0) + (other.velocity or 0.0) if known else None,
            base=self.base + other.base,
            fixed=self.fixed and other.fixed,
        )


FLOAT32 = 6e-8
ROUNDED = 1e-15
"""Of times that are counted from a rate: one rounding each."""
PROMISES: Mapping[str, Promise] = {
    "mcap": Promise(time=0.5e-9),
    "mcap-joint_trajectory": Promise(time=0.5e-9),
    "rosbag2": Promise(time=0.5e-9),
    "rosbag2-joint_trajectory": Promise(time=0.5e-9),
    "hdf5": Promise(),
    "csv": Promise(),
    "csv-unitree": Promise(time=ROUNDED, velocity=None, fixed=False),
    "npz": Promise(),
    "npz-gmr": Promise(velocity=None, fixed=False),
    "lerobot": Promise(time=ROUNDED, position=FLOAT32, velocity=FLOAT32, base=FLOAT32),
}
NAMES = [
    name
    for f in formats.available().values()
    if f.writable
    for name in (f.name, *(f"{f.name}-{s}" for s in f.styles[1:]))
]


def write(folder: Path, name: str, trajectory: JointTrajectory) -> Path:
    """As the format or format-style `name`."""
    if name == "lerobot":
        pytest.importorskip("pyarrow", reason="the extra lerobot is not installed")
    format_name, _, style = name.partition("-")
    path = folder / f"{name}{''.join(formats.get(format_name).suffixes[:1])}"
    formats.write_trajectory(path, trajectory, format=format_name, style=style or None)
    return path


def read(name: str, path: Path, joint_names: tuple[str, ...]) -> JointTrajectory:
    """With what the file doesn't say of itself."""
    options = TrajectoryOptions(style="unitree", rate_hz=RATE_HZ, joint_names=joint_names)
    return formats.read_trajectory(path, options=options if name == "csv-unitree" else None)


def check(found: Found, expected: JointTrajectory, promise: Promise) -> None:
    """Fields of `found` against the trajectory that was written; of those that are there, but for the base all have to."""
    assert tuple(found["joint_names"]) == expected.joint_names
    np.testing.assert_allclose(
        found["time"], expected.time, rtol=0, atol=promise.time + np.spacing(expected.time[-1]) * (promise.time > 0)
    )
    same(found["position"], expected.position, promise.position, "position")
    if promise.velocity is not None:
        same(found["velocity"], expected.velocity, promise.velocity, "velocity")
    if expected.base_position is not None and expected.base_orientation is not None:
        same(found["base_position"], expected.base_position, promise.base, "base_position")
        # Made unit again by readers: the parts of the quaternion share its rounding.
        turned = np.asarray(found["base_orientation"], float)
        np.testing.assert_allclose(turned, expected.base_orientation, rtol=0, atol=2 * promise.base)
    elif promise.fixed:
        assert found.get("base_position") is None
    else:
        np.testing.assert_array_equal(found["base_position"], np.zeros((expected.frames, 3)))


def same(found: Any, expected: NDArray[np.float64], tolerance: float, field: str) -> None:
    if tolerance == 0:
        np.testing.assert_array_equal(found, expected, err_msg=field)
    else:
        np.testing.assert_allclose(np.asarray(found, float), expected, rtol=tolerance, err_msg=field)


def fields(trajectory: JointTrajectory) -> Found:
    names = ("time", "joint_names", "position", "velocity", "base_position", "base_orientation")
    return {name: getattr(trajectory, name) for name in names}


BASES: Mapping[str, Mapping[str, Any]] = {
    "moving": {},
    "fixed": dict.fromkeys(("base_position", "base_orientation", "base_linear_velocity", "base_angular_velocity")),
}


@pytest.fixture(params=BASES)
def trajectory(request: pytest.FixtureRequest, make_trajectory: Maker) -> JointTrajectory:
    return make_trajectory(frames=FRAMES, joints=JOINTS, rate_hz=RATE_HZ, **BASES[request.param])


def test_every_format_that_is_written_promises_something() -> None:
    assert set(PROMISES) == set(NAMES)
    assert set(PEERS) >= set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_our_own_reader(name: str, tmp_path: Path, trajectory: JointTrajectory) -> None:
    back = read(name, write(tmp_path, name, trajectory), trajectory.joint_names)
    check(fields(back), trajectory, PROMISES[name])


@pytest.mark.parametrize("second", NAMES)
@pytest.mark.parametrize("first", NAMES)
def test_one_after_the_other(first: str, second: str, tmp_path: Path, trajectory: JointTrajectory) -> None:
    between = read(first, write(tmp_path, first, trajectory), trajectory.joint_names)
    (tmp_path / "then").mkdir()
    back = read(second, write(tmp_path / "then", second, between), trajectory.joint_names)
    check(fields(back), trajectory, PROMISES[first].with_other(PROMISES[second]))


def _messages_of_mcap_ros2(path: Path) -> Any:
    with path.open("rb") as stream:
        yield from ((m.channel.topic, m.ros_msg) for m in read_ros2_messages(stream))


def _messages_of_rosbags(path: Path) -> Any:
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        for connection, _, raw in reader.messages():
            yield connection.topic, reader.deserialize(raw, connection.msgtype)


def _seconds(stamp: Any) -> float:
    return float(stamp.sec + 1e-9 * stamp.nanosec)


def _ros(messages: Any) -> Found:
    """Joint states and the base's transforms, as the ROS messages have them."""
    found: dict[str, Any] = {key: [] for key in ("time", "position", "velocity", "base_position", "base_orientation")}
    for topic, message in messages:
        if topic == "/joint_states":
            found["joint_names"] = message.name
            found["time"].append(_seconds(message.header.stamp))
            found["position"].append(message.position)
            found["velocity"].append(message.velocity)
        elif topic == "/tf":
            (one,) = message.transforms
            assert (one.header.frame_id, one.child_frame_id) == ("world", "pelvis")
            at, q = one.transform.translation, one.transform.rotation
            found["base_position"].append([at.x, at.y, at.z])
            found["base_orientation"].append([q.w, q.x, q.y, q.z])
        elif topic == "/joint_trajectory":
            assert list(message.joint_names) == list(found.get("joint_names", message.joint_names))
            assert len(message.points) == FRAMES
    return {key: value for key, value in found.items() if len(value)}


def _h5py(path: Path) -> Found:
    with h5py.File(path) as file:
        found = {"time": file["time"][:], "joint_names": [name.decode() for name in file.attrs["joint_names"]]}
        found |= {"position": file["joint/position"][:], "velocity": file["joint/velocity"][:]}
        if "base/position" in file:
            assert file.attrs["quat_order"] == b"wxyz"
            found |= {"base_position": file["base/position"][:], "base_orientation": file["base/orientation"][:]}
        return found


def _csv(path: Path) -> Found:
    with path.open(encoding="utf-8", newline="") as stream:
        header, *rows = csv.reader(stream)
    column = dict(zip(header, np.array(rows, float).T, strict=True))
    names = [name[2:-4] for name in header if name.startswith("q_") and name.endswith("_rad")]
    found: dict[str, Any] = {"time": column["time_s"], "joint_names": names}
    found["position"] = np.stack([column[f"q_{name}_rad"] for name in names], axis=1)
    found["velocity"] = np.stack([column[f"dq_{name}_rad_s"] for name in names], axis=1)
    if "base_x_m" in column:
        found["base_position"] = np.stack([column[f"base_{axis}_m"] for axis in "xyz"], axis=1)
        found["base_orientation"] = np.stack([column[f"base_q{axis}"] for axis in "wxyz"], axis=1)
    return found


def _headerless(path: Path) -> Found:
    """Root position, root quaternion x y z w, joints, as Unitree's own scripts slice it."""
    rows = np.loadtxt(path, delimiter=",")
    found = {
        "time": np.arange(len(rows)) / RATE_HZ,
        "position": rows[:, 7:],
        "joint_names": [f"left_joint_{i}" for i in range(JOINTS)],
    }
    return found | {"base_position": rows[:, :3], "base_orientation": rows[:, [6, 3, 4, 5]]}


def _npz(path: Path) -> Found:
    with np.load(path) as archive:
        found = {"time": archive["time"], "joint_names": archive["joint_names"].tolist()}
        found |= {"position": archive["joint_pos"], "velocity": archive["joint_vel"]}
        if not archive["base_fixed"]:
            found |= {"base_position": archive["body_pos_w"][:, 0], "base_orientation": archive["body_quat_w"][:, 0]}
        assert archive["fps"].shape == (1,)
        return found


def _gmr(path: Path) -> Found:
    """As GMR's viewer takes it, root_rot in x y z w."""
    with np.load(path) as archive:
        assert float(archive["fps"]) == pytest.approx(RATE_HZ)
        found = {
            "time": archive["time"],
            "joint_names": archive["joint_names"].tolist(),
            "position": archive["dof_pos"],
        }
        return found | {"base_position": archive["root_pos"], "base_orientation": archive["root_rot"][:, [3, 0, 1, 2]]}


def _pyarrow(path: Path) -> Found:
    parquet = pytest.importorskip("pyarrow.parquet", reason="the extra lerobot is not installed")
    info = json.loads((path / "meta/info.json").read_text())
    table = parquet.read_table(path / info["data_path"].format(chunk_index=0, file_index=0))
    found: dict[str, Any] = {"time": np.array(table["frame_index"]) / info["fps"]}
    np.testing.assert_array_equal(table["timestamp"], found["time"].astype(np.float32))
    found["joint_names"] = info["features"]["observation.state"]["names"]
    found["position"] = np.array(table["observation.state"].to_pylist())
    found["velocity"] = np.array(table["observation.velocity"].to_pylist())
    if "observation.base_pose" in table.column_names:
        pose = np.array(table["observation.base_pose"].to_pylist())
        found |= {"base_position": pose[:, :3], "base_orientation": pose[:, [6, 3, 4, 5]]}
    return found


def _both_on_mcap(path: Path) -> list[Found]:
    return [_ros(_messages_of_mcap_ros2(path)), _ros(_messages_of_rosbags(path))]


def _both_on_bag(path: Path) -> list[Found]:
    return [_ros(_messages_of_rosbags(path)), _ros(_messages_of_mcap_ros2(path / "trajectory_0.mcap"))]


PEERS: Mapping[str, Callable[[Path], list[Found]]] = {
    "mcap": _both_on_mcap,
    "mcap-joint_trajectory": _both_on_mcap,
    "rosbag2": _both_on_bag,
    "rosbag2-joint_trajectory": _both_on_bag,
    "hdf5": lambda path: [_h5py(path)],
    "csv": lambda path: [_csv(path)],
    "csv-unitree": lambda path: [_headerless(path)],
    "npz": lambda path: [_npz(path)],
    "npz-gmr": lambda path: [_gmr(path)],
    "lerobot": lambda path: [_pyarrow(path)],
}


@pytest.mark.parametrize("name", NAMES)
def test_readers_of_others(name: str, tmp_path: Path, trajectory: JointTrajectory) -> None:
    for found in PEERS[name](write(tmp_path, name, trajectory)):
        check(found, trajectory, PROMISES[name])
