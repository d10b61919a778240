"""For each format a good file, and what can be wrong with one: each fault as a change of a file that is read without it."""

from __future__ import annotations

import random
import re
import shutil
import sqlite3
import struct
from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from retarget import formats

from tests.formats.ros_recordings import Ros, Sent, write_folder
from tests.fuzz import ros_seeds, seeds

Change = Callable[[Path], None]
DATA = "data/chunk-000/file-000.parquet"
RECORDING = ("convert", "--robot", "g1")
TRACKERS = (*RECORDING, "--calibration", "calibration.json")
TRAJECTORY = ("validate", "--robot", "g1", "--mode", "kinematic")


@dataclass(frozen=True)
class Sample:
    """A format's good file. name: its own. write: makes it, a file or a folder, at a path. command: what takes it.

    part: of a folder, the file that is emptied, cut and filled with noise. kept: how much of it is left when it is cut. faults: changes of the content, by kind.
    """

    name: str
    write: Callable[[Path], object]
    command: tuple[str, ...]
    faults: Mapping[str, Change] = field(default_factory=dict)
    part: str | None = None
    kept: float = 0.5

    def file(self, path: Path) -> Path:
        """The file that is damaged."""
        return path / self.part if self.part else path


def _bytes(content: Callable[[], bytes]) -> Callable[[Path], object]:
    return lambda path: path.write_bytes(content())


def replaced(old: bytes, new: bytes, count: int = 1) -> Change:
    """The first `count` places (-1 = all) changed; there have to be any."""

    def change(path: Path) -> None:
        data = path.read_bytes()
        assert old in data, old
        path.write_bytes(data.replace(old, new, count))

    return change


def within(part: str, change: Change) -> Change:
    """A change of one file of a folder."""
    return lambda path: change(path / part)


def instead(content: Callable[[], bytes]) -> Change:
    """Another content."""

    def change(path: Path) -> None:
        path.write_bytes(content())

    return change


def other_folder(write: Callable[[Path], object]) -> Change:
    """Another folder."""

    def change(path: Path) -> None:
        shutil.rmtree(path)
        write(path)

    return change


def arrays(**changes: Any) -> Change:
    """Arrays of an NPZ file replaced by what a function makes of them, or left out where that is None."""

    def change(path: Path) -> None:
        with np.load(path) as archive:
            content = dict(archive)
        for name, make in changes.items():
            old = content.pop(name)
            if make is not None:
                content[name] = make(old)
        np.savez(path, **content)

    return change


def datasets(**changes: Any) -> Change:
    """The same for an HDF5 file as h5py writes it; "/" of a path is "__"."""
    import h5py

    def change(path: Path) -> None:
        with h5py.File(path, "r+") as file:
            for name, make in changes.items():
                place = name.replace("__", "/")
                old = file[place][()]
                del file[place]
                if make is not None:
                    file[place] = make(old)

    return change


def columns(**changes: Any) -> Change:
    """The same for the frames of a LeRobot dataset; "." of a name is "_"."""

    def change(path: Path) -> None:
        import pyarrow as pa
        import pyarrow.parquet as pq

        table = pq.read_table(path)
        for name, make in changes.items():
            index = [column.replace(".", "_") for column in table.column_names].index(name)
            real, old = table.column_names[index], np.array(table.column(index).to_pylist())
            table = table.remove_column(index)
            if make is not None:
                table = table.append_column(real, pa.array(make(old).tolist()))
        pq.write_table(table, path)

    return change


def sql(statement: str) -> Change:
    """A database changed."""

    def change(path: Path) -> None:
        with closing(sqlite3.connect(path, isolation_level=None)) as connection:
            connection.execute(statement)

    return change


def with_nan(old: NDArray[Any]) -> NDArray[Any]:
    """The second frame's first number is none."""
    new = old.astype(float)
    new.reshape(len(new), -1)[1, 0] = np.nan
    return new


def backwards(old: NDArray[Any]) -> NDArray[Any]:
    """In reverse order."""
    return old[::-1]


def double(value: float) -> bytes:
    """As messages hold it."""
    return struct.pack("<d", value)


def noise() -> bytes:
    """The same 4 kB each time."""
    return random.Random(0).randbytes(4096)


def _robot_folder(path: Path) -> None:
    formats.write_trajectory(path, seeds.trajectory(), format="rosbag2")


def _person_folder(path: Path) -> None:
    write_folder(path, Ros(2), ros_seeds.trackers(Ros(2)))


def _dataset(path: Path) -> None:
    formats.write_trajectory(path, seeds.trajectory(), format="lerobot")


def _text_folder(path: Path) -> None:
    ros = Ros(2)
    write_folder(path, ros, [Sent("/chatter", "std_msgs/msg/String", 1, ros.text("hello"))])


def _mvnx() -> bytes:
    return seeds.short_mvnx("walk.mvnx.gz", 6)


def _swapped_lines(first: int, second: int) -> Change:
    def change(path: Path) -> None:
        lines = path.read_bytes().split(b"\n")
        lines[first], lines[second] = lines[second], lines[first]
        path.write_bytes(b"\n".join(lines))

    return change


def _column_left_out(index: int) -> Change:
    def change(path: Path) -> None:
        rows = [line.split(b",") for line in path.read_bytes().rstrip().split(b"\n")]
        path.write_bytes(b"\n".join(b",".join(cell for i, cell in enumerate(row) if i != index) for row in rows))

    return change


def _turned_back(path: Path) -> None:
    """Indexes of the normal frames in reverse order."""
    data, count = path.read_bytes(), 6
    for index in range(count):
        data = data.replace(b' index="%d"' % index, b' index="~%d"' % (count - 1 - index))
    path.write_bytes(data.replace(b'index="~', b'index="'))


def _no_pelvis(path: Path) -> None:
    """Orientations of the pelvis that are none, in all normal frames."""
    path.write_bytes(re.sub(rb"<orientation>\S+ \S+ \S+ \S+", b"<orientation>nan nan nan nan", path.read_bytes()))


def _never_tracked(path: Path) -> None:
    """The first coordinate of the first tracker is none in every row."""
    path.write_bytes(re.sub(rb"(?m)^([0-9.]+),[^,]+", rb"\1,nan", path.read_bytes()))


def _then(*changes: Change) -> Change:
    def change(path: Path) -> None:
        for one in changes:
            one(path)

    return change


def _trackers_left_out(path: Path) -> None:
    """Lines of libsurvive that are no poses."""
    path.write_bytes(path.read_bytes().replace(b"POSE", b"IMU"))


def _ros(name: str, data: Callable[[], bytes], without_poses: Change, other: str) -> Sample:
    """A ROS recording of trackers in one file. other: the format whose file takes its place."""
    return Sample(
        name,
        _bytes(data),
        TRACKERS,
        {NOT_FINITE: NAN_POSE, MISSING: without_poses, WRONG_KIND: instead(lambda: seeds.written(other))},
    )


NAN_POSE = replaced(double(1.0), double(np.nan), -1)
NAN_JOINT = replaced(double(float(seeds.trajectory().position[1, 1])), double(np.nan))
NOT_FINITE, MISSING, BACKWARDS, WRONG_KIND = "not finite", "missing part", "backwards", "wrong kind"
SAMPLES: Mapping[str, Sample] = {
    "mvnx": Sample(
        "walk.mvnx",
        _bytes(_mvnx),
        RECORDING,
        {
            NOT_FINITE: _no_pelvis,
            MISSING: replaced(b"orientation>", b"other>", -1),
            BACKWARDS: _turned_back,
            WRONG_KIND: instead(lambda: seeds.written("mcap")),
        },
    ),
    "vive": Sample(
        "log.csv",
        _bytes(lambda: seeds.tracker_log("wide")),
        TRACKERS,
        {
            NOT_FINITE: _never_tracked,
            MISSING: replaced(b"time_s", b"weather"),
            BACKWARDS: _swapped_lines(1, 3),
            WRONG_KIND: instead(lambda: seeds.written("csv")),
        },
        kept=0.02,  # in the header: a last row that is cut is left out and told
    ),
    "libsurvive": Sample(
        "log.rec",
        _bytes(lambda: seeds.tracker_log("libsurvive")),
        TRACKERS,
        {
            NOT_FINITE: replaced(b"POSE 0.1", b"POSE nan", -1),
            MISSING: _trackers_left_out,
            BACKWARDS: _swapped_lines(0, 8),
            WRONG_KIND: instead(lambda: seeds.written("csv")),
        },
        kept=0.02,  # in the first line: real logs end in the middle of one
    ),
    "rosbag": _ros("walk.bag", lambda: ros_seeds.bags()[0], instead(lambda: ros_seeds.talk()), "csv"),
    "rosbag of ROS 2": _ros("walk.db3", lambda: ros_seeds.databases()[0], sql("DELETE FROM messages"), "csv"),
    "rosbag of a folder": Sample(
        "walk",
        _person_folder,
        TRACKERS,
        {
            NOT_FINITE: within("walk.db3", NAN_POSE),
            MISSING: lambda path: (path / "walk.db3").unlink(),
            WRONG_KIND: other_folder(_text_folder),
        },
        part="walk.db3",
    ),
    "mcap of a person": _ros(
        "walk.mcap", lambda: ros_seeds.mcaps()[0], instead(lambda: ros_seeds.empty_mcap()), "mcap"
    ),
    "mcap": Sample(
        "walk.mcap",
        _bytes(seeds.unchecked_mcap),
        TRAJECTORY,
        {
            NOT_FINITE: NAN_JOINT,
            MISSING: replaced(b"msg/JointState", b"msg/JointStrip", -1),
            WRONG_KIND: instead(lambda: ros_seeds.mcaps()[0]),
        },
    ),
    "rosbag2": Sample(
        "walk_bag",
        _robot_folder,
        TRAJECTORY,
        {
            NOT_FINITE: within("trajectory_0.mcap", _then(instead(seeds.unchecked_mcap), NAN_JOINT)),
            MISSING: lambda path: (path / "trajectory_0.mcap").unlink(),
            WRONG_KIND: other_folder(_text_folder),
        },
        part="trajectory_0.mcap",
    ),
    "hdf5": Sample(
        "walk.h5",
        _bytes(seeds.foreign_hdf5),
        TRAJECTORY,
        {
            NOT_FINITE: datasets(joint__position=with_nan),
            MISSING: datasets(joint__position=None),
            BACKWARDS: datasets(time=backwards),
            WRONG_KIND: instead(_mvnx),
        },
    ),
    "csv": Sample(
        "walk.csv",
        _bytes(lambda: seeds.written("csv")),
        TRAJECTORY,
        {
            NOT_FINITE: replaced(b"0.852108021949363", b"nan"),
            MISSING: _column_left_out(2),
            BACKWARDS: _swapped_lines(1, 3),
            WRONG_KIND: instead(lambda: seeds.tracker_log("wide")),
        },
    ),
    "npz": Sample(
        "walk.npz",
        _bytes(lambda: seeds.written("npz")),
        TRAJECTORY,
        {
            NOT_FINITE: arrays(joint_pos=with_nan),
            MISSING: arrays(joint_pos=None),
            BACKWARDS: arrays(time=backwards),
            WRONG_KIND: instead(_mvnx),
        },
    ),
    "lerobot": Sample(
        "walk_dataset",
        _dataset,
        TRAJECTORY,
        {
            NOT_FINITE: within(DATA, columns(observation_state=with_nan)),
            MISSING: within(DATA, columns(observation_state=None)),
            BACKWARDS: within("meta/info.json", replaced(b'"fps": 50', b'"fps": -50')),
            WRONG_KIND: other_folder(_text_folder),
        },
        part=DATA,
    ),
}
