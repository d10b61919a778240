"""What the face of the program promises of bad input, for every format: exit code 1 or 2, one line on stderr that names the file, what was
found and what is expected, no traceback, nothing on stdout, no output left.

A format that is new fails here until it has a sample and a line for each kind of fault.
"""

from __future__ import annotations

import importlib.util
import os
import re
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from retarget import formats
from retarget.cli.main import cli
from retarget.core.types import HumanMotion, JointTrajectory, TrackerRecording

from tests.bad_input import BACKWARDS, MISSING, NOT_FINITE, SAMPLES, WRONG_KIND, Sample, noise
from tests.formats.ros_recordings import Ros, Sent, storage, write_bag, write_folder
from tests.fuzz import ros_seeds
from tests.fuzz.small_calibration import small_calibration

EMPTY, NOISE, CUT, ABSENT, FOLDER, UNREADABLE = "empty", "noise", "cut", "absent", "folder", "unreadable"
KINDS = (EMPTY, NOISE, CUT, NOT_FINITE, MISSING, BACKWARDS, WRONG_KIND, ABSENT, FOLDER, UNREADABLE)
ANY_ORDER = {"mcap", "mcap of a person", "rosbag", "rosbag of ROS 2", "rosbag of a folder", "rosbag2"}
"""Messages have stamps and are put into their order, see the last test: there is no wrong one."""
CONVERT_FOLDER = r"is a folder; -r converts all recordings below it"
VALIDATE_FOLDER = r"is a folder; -r judges all trajectories below it"
NO_MAGIC = (
    r"can't be read as a recording: starts with b'.*'; expected a bag of ROS 1 \(#ROSBAG V2\.0\) or a \.db3 of ROS 2 .*"
)
NO_MCAP = r"starts with b'.*'; expected MCAP's magic b'.*'"
CUT_MCAP = r", byte \d+: the file ends inside .*: \d+ of \d+ bytes; expected a complete MCAP .*"
NAN = r": JointTrajectory\.position: found nan at \(1, \d\), expected finite values"
TIME = r": JointTrajectory\.time: found frame 1 at 0\.0\d s after frame 0 at 0\.0\d s, expected increasing times"
NEVER = r": tracker '.*' is never tracked: of \d+ rows 0 are marked invalid, \d+ lack numbers, 0 have a bad quaternion"
NO_POSES = r": no poses; expected lines 't DEVICE POSE x y z qw qx qy qz'"
NO_JOINTS = r": no sensor_msgs/msg/JointState; found .*; expected joint states on /joint_states"
ROBOT_READERS = "csv, hdf5, lerobot, mcap, npz, rosbag2"
PERSON_READERS = "libsurvive, mcap, mvnx, rosbag, vive"

LINES: dict[str, dict[str, str]] = {
    "mvnx": {
        EMPTY: r": empty file",
        NOISE: r", line 1: not XML \(.*\); expected an MVNX document",
        CUT: r", line \d+: the document ends early, after 0 whole frames; expected an MVNX document",
        NOT_FINITE: r": <orientation> of Pelvis: no frame holds finite values",
        MISSING: r", line \d+, identity frame: no <orientation>; expected 92 values, 4 for each of 23 segments",
        BACKWARDS: r", line \d+: frame index 4 after 5; expected increasing numbers",
        WRONG_KIND: r": the suffix says mvnx, the content is mcap; expected a matching suffix \(\.mcap\) or the format 'mcap' named explicitly",
        FOLDER: CONVERT_FOLDER,
    },
    "vive": {
        EMPTY: r": empty file",
        NOISE: r", byte 0: not UTF-8 text: .*",
        CUT: r", line 1 'time_s,chest_x_m,.*': no header that names x, y, z and a quaternion's w, x, y, z of a tracker, each once; expected .*",
        NOT_FINITE: NEVER,
        MISSING: r": no time column among weather, chest_x_m, .*; expected a column such as time_s, or the rate: --rate 90",
        BACKWARDS: r", line 3: time of tracker 'chest' goes back from 0\.022222 s to 0\.011111 s; expected increasing times",
        WRONG_KIND: rf": csv holds robot trajectories, not a person's motion; expected one of {PERSON_READERS}",
        FOLDER: CONVERT_FOLDER,
    },
    "libsurvive": {
        EMPTY: r": empty file",
        NOISE: NO_POSES,
        CUT: NO_POSES,
        NOT_FINITE: NEVER,
        MISSING: NO_POSES,
        BACKWARDS: r", line 3: time of tracker 'HMD' goes back from 0\.4 s to 0\.1 s; expected increasing times",
        WRONG_KIND: NO_POSES,
        FOLDER: CONVERT_FOLDER,
    },
    "rosbag": {
        EMPTY: r": empty file",
        NOISE: rf": {NO_MAGIC}",
        CUT: r": can't be read as a recording: Bag index looks damaged: .*; expected a complete bag",
        NOT_FINITE: NEVER,
        MISSING: r": no poses: found /chatter \(std_msgs/String\); expected tf, poses, odometry or link states",
        WRONG_KIND: rf": {NO_MAGIC}",
        FOLDER: CONVERT_FOLDER,
    },
    "rosbag of ROS 2": {
        EMPTY: r": empty file",
        NOISE: rf": {NO_MAGIC}",
        CUT: r": can't be read as a recording: .*; expected a complete bag",
        NOT_FINITE: NEVER,
        MISSING: r": no poses: found .*; expected tf, poses, odometry or link states",
        WRONG_KIND: rf": {NO_MAGIC}",
        FOLDER: CONVERT_FOLDER,
    },
    "rosbag of a folder": {
        EMPTY: r"/walk\.db3: can't be read as a recording: .*; expected a complete bag",
        NOISE: r"/walk\.db3: can't be read as a recording: .*; expected a complete bag",
        CUT: r"/walk\.db3: can't be read as a recording: .*; expected a complete bag",
        NOT_FINITE: NEVER,
        MISSING: r", metadata\.yaml: file walk\.db3 is missing",
        WRONG_KIND: r": no poses: found /chatter \(std_msgs/String\); expected tf, poses, odometry or link states",
        FOLDER: CONVERT_FOLDER,
    },
    "mcap of a person": {
        EMPTY: r": empty file",
        NOISE: rf": {NO_MCAP}",
        CUT: CUT_MCAP,
        NOT_FINITE: NEVER,
        MISSING: r": no poses: found no messages; expected tf, poses, odometry or link states",
        WRONG_KIND: rf": mcap holds robot trajectories, not a person's motion; expected one of {PERSON_READERS}",
        FOLDER: CONVERT_FOLDER,
    },
    "mcap": {
        EMPTY: r": empty file",
        NOISE: rf": {NO_MCAP}",
        CUT: CUT_MCAP,
        NOT_FINITE: NAN,
        MISSING: NO_JOINTS,
        WRONG_KIND: NO_JOINTS,
        FOLDER: VALIDATE_FOLDER,
    },
    "rosbag2": {
        EMPTY: rf"/trajectory_0\.mcap{CUT_MCAP}",
        NOISE: rf"/trajectory_0\.mcap: {NO_MCAP}",
        CUT: rf"/trajectory_0\.mcap{CUT_MCAP}",
        NOT_FINITE: NAN,
        MISSING: r", metadata\.yaml: file trajectory_0\.mcap is missing",
        WRONG_KIND: r": no sensor_msgs/msg/JointState; found /chatter \(std_msgs/msg/String\); expected joint states on /joint_states",
        FOLDER: VALIDATE_FOLDER,
    },
    "hdf5": {
        EMPTY: r": empty file",
        NOISE: r": not a readable HDF5 file: .*file signature not found.*",
        CUT: r": not a readable HDF5 file: .*truncated file.*",
        NOT_FINITE: NAN,
        MISSING: r", /joint/position: no such dataset; expected an array of 2 dimensions",
        BACKWARDS: TIME,
        WRONG_KIND: r": the suffix says hdf5, the content is mvnx; expected a matching suffix \(.*\) or the format 'mvnx' named explicitly",
        FOLDER: VALIDATE_FOLDER,
    },
    "csv": {
        EMPTY: r": empty file",
        NOISE: r", byte 0: not UTF-8 text: .*",
        CUT: r", below the header: the number of columns changed from 19 to \d+ at row 2; expected 19 numbers a line",
        NOT_FINITE: NAN,
        MISSING: r", line 1: no column 'base_y_m' \(is it 'base_vy_m_s'\?\)",
        BACKWARDS: TIME,
        WRONG_KIND: rf": vive holds poses of trackers, not a robot trajectory; expected one of {ROBOT_READERS}",
        FOLDER: VALIDATE_FOLDER,
    },
    "npz": {
        EMPTY: r": empty file",
        NOISE: r": not a readable NPZ archive: starts with b'.*'; expected a ZIP archive of arrays",
        CUT: r": not a readable NPZ archive: File is not a zip file",
        NOT_FINITE: NAN,
        MISSING: r": no array 'joint_pos'; expected it beside those found: .*",
        BACKWARDS: TIME,
        WRONG_KIND: r": the suffix says npz, the content is mvnx; expected a matching suffix \(.*\) or the format 'mvnx' named explicitly",
        FOLDER: VALIDATE_FOLDER,
    },
    "lerobot": {
        EMPTY: r", data: not readable data: Parquet file size is 0 bytes",
        NOISE: r", data: not readable data: Parquet magic bytes not found.*",
        CUT: r", data: not readable data: Parquet magic bytes not found.*",
        NOT_FINITE: NAN,
        MISSING: r", data: no feature 'observation\.state'; expected joint positions of each frame",
        BACKWARDS: r", meta/info\.json: fps -50; expected a positive number below a million",
        WRONG_KIND: NO_JOINTS,
        FOLDER: VALIDATE_FOLDER,
    },
}  # fmt: skip
"""What stands behind the file's name: all of it."""
USAGE = {("vive", WRONG_KIND), ("csv", WRONG_KIND), ("mcap of a person", WRONG_KIND)}
"""The file is good, the request is not: exit code 2, as for files that are not there."""


def expected_line(name: str, kind: str) -> tuple[str, int]:
    """Pattern of what follows the file's name, and the exit code."""
    if kind == ABSENT:
        return r": no such file", 2
    if kind == UNREADABLE:
        return (r": can't be read: permission denied", 1) if SAMPLES[name].part else (r": not readable", 2)
    if kind == FOLDER:
        return f": {LINES[name][kind]}", 2
    return LINES[name][kind], 2 if (name, kind) in USAGE else 1


def damage(sample: Sample, path: Path, kind: str) -> None:
    """Make the good file at `path` one with that fault."""
    if kind in (EMPTY, NOISE):
        sample.file(path).write_bytes(noise() if kind == NOISE else b"")
    elif kind == CUT:
        data = sample.file(path).read_bytes()
        sample.file(path).write_bytes(data[: int(sample.kept * len(data))])
    elif kind in (ABSENT, FOLDER):
        shutil.rmtree(path) if path.is_dir() else path.unlink()
        if kind == FOLDER:
            path.mkdir()
    elif kind == UNREADABLE:
        sample.file(path).chmod(0)
    else:
        sample.faults[kind](path)


def skip_without_extra(name: str) -> None:
    if name == "lerobot" and importlib.util.find_spec("pyarrow") is None:
        pytest.skip("the extra lerobot is not installed")


def run(*arguments: str) -> Result:
    result = CliRunner().invoke(cli, list(arguments))
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exc_info
    return result


def check_refused(result: Result, exit_code: int, line: str) -> None:
    """One line that is that pattern, and nothing else."""
    assert result.exit_code == exit_code, result.stderr
    assert result.stdout == ""
    assert result.stderr.count("\n") == 1, result.stderr
    assert result.stderr.endswith("\n")
    assert "internal error" not in result.stderr
    assert re.fullmatch(f"retarget: {line}\n", result.stderr), result.stderr


def _reads_everything() -> bool:
    """Whether permissions don't hold, as for root."""
    with tempfile.NamedTemporaryFile() as file:
        Path(file.name).chmod(0)
        return os.access(file.name, os.R_OK)


CASES = [
    pytest.param(
        name,
        kind,
        marks=pytest.mark.skipif(
            kind == UNREADABLE and _reads_everything(), reason="who runs this may read everything"
        ),
    )
    for name in SAMPLES
    for kind in KINDS
    if not (kind == BACKWARDS and name in ANY_ORDER)
]


def test_every_format_is_here() -> None:
    assert {name.partition(" ")[0] for name in SAMPLES} == set(formats.available())
    assert set(LINES) == set(SAMPLES)
    for name in SAMPLES:
        assert set(LINES[name]) | {ABSENT, UNREADABLE} == set(KINDS) - ({BACKWARDS} if name in ANY_ORDER else set()), (
            name
        )


@pytest.mark.parametrize("name", SAMPLES)
def test_the_file_is_read_without_the_fault(name: str, tmp_path: Path) -> None:
    skip_without_extra(name)
    sample = SAMPLES[name]
    sample.write(tmp_path / sample.name)
    if sample.command[0] == "validate":
        found: object = formats.read_trajectory(tmp_path / sample.name)
        assert isinstance(found, JointTrajectory)
    else:
        assert isinstance(formats.read_recording(tmp_path / sample.name), HumanMotion | TrackerRecording)


@pytest.mark.parametrize(("name", "kind"), CASES)
def test_bad_input_is_one_line(name: str, kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    skip_without_extra(name)
    monkeypatch.chdir(tmp_path)
    sample, path = SAMPLES[name], Path(SAMPLES[name].name)
    Path("calibration.json").write_text(small_calibration())
    sample.write(path)
    damage(sample, path, kind)
    before = {place: place.stat().st_mtime_ns for place in Path().rglob("*")}
    result = run(sample.command[0], sample.name, *sample.command[1:])
    pattern, exit_code = expected_line(name, kind)
    check_refused(result, exit_code, re.escape(sample.name) + pattern)
    assert {place: place.stat().st_mtime_ns for place in Path().rglob("*")} == before


@pytest.mark.parametrize("name", [f.name for f in formats.available().values() if f.writable])
def test_unknown_styles_name_those_there_are(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    SAMPLES["mvnx"].write(Path("walk.mvnx"))
    result = run("convert", "walk.mvnx", "--robot", "g1", "--format", name, "-o", "out", "--style", "nope")
    styles = ", ".join(sorted(formats.get(name).styles))
    check_refused(result, 2, rf"--style: unknown {name} style 'nope'; (choose from {styles}|did you mean .*)")
    assert [path.name for path in Path().iterdir()] == ["walk.mvnx"]


@pytest.mark.parametrize("name", [f.name for f in formats.available().values() if not f.writable])
def test_formats_that_are_only_read_are_not_written(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    SAMPLES["mvnx"].write(Path("walk.mvnx"))
    result = run("convert", "walk.mvnx", "--robot", "g1", "--format", name, "-o", "out")
    check_refused(result, 2, rf"--format: unknown format '{name}'; (did you mean .*\?|choose from .*mcap.*)")
    assert [path.name for path in Path().iterdir()] == ["walk.mvnx"]


@pytest.mark.parametrize("name", [name for name in SAMPLES if name.partition(" ")[0] not in ("rosbag", "mcap")])
def test_options_of_ros_are_refused_by_the_others(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    skip_without_extra(name)
    if SAMPLES[name].command[0] == "validate":
        pytest.skip("validate has no such options")
    monkeypatch.chdir(tmp_path)
    sample = SAMPLES[name]
    Path("calibration.json").write_text(small_calibration())
    sample.write(Path(sample.name))
    result = run(sample.command[0], sample.name, *sample.command[1:], "--clock", "log")
    check_refused(result, 2, rf"{re.escape(sample.name)}: --clock is for ROS recordings, not for {name}")


def _bag(path: Path, sent: list[Sent]) -> Path:
    return write_bag(path / "a.bag", Ros(1), sent)


def _db3(path: Path, sent: list[Sent]) -> Path:
    return storage(write_folder(path / "a", Ros(2), sent))


def _folder(path: Path, sent: list[Sent]) -> Path:
    return write_folder(path / "a", Ros(2), sent)


def _mcap(path: Path, sent: list[Sent]) -> Path:
    return storage(write_folder(path / "a", Ros(2), sent, mcap=True))


@pytest.mark.parametrize(("version", "write"), [(1, _bag), (2, _db3), (2, _folder), (2, _mcap)])
def test_messages_of_a_recording_may_come_in_any_order(
    version: int, write: Callable[[Path, list[Sent]], Path], tmp_path: Path
) -> None:
    """Recorded one after the other, stamped in reverse."""
    sent = ros_seeds.trackers(Ros(version))
    turned = [one._replace(log_time=other.log_time) for one, other in zip(reversed(sent), sent, strict=True)]
    found = []
    for name, messages in (("straight", sent), ("turned", turned)):
        (tmp_path / name).mkdir()
        found.append(formats.read_trackers(write(tmp_path / name, messages)))
    straight, back = found
    assert sorted(straight.trackers) == sorted(back.trackers)
    columns = [back.trackers.index(tracker) for tracker in straight.trackers]
    np.testing.assert_array_equal(back.time, straight.time)
    np.testing.assert_array_equal(back.position[:, columns], straight.position)
    np.testing.assert_array_equal(back.orientation[:, columns], straight.orientation)
