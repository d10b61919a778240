"""Swapped joints in files, without the recording: `retarget validate` names them wherever the file keeps what was written."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result
from retarget import formats, robots
from retarget.core import robot_model
from retarget.core.pipeline import ConvertOptions, convert
from retarget.core.types import JointTrajectory

Run = Callable[..., Result]
CHECK = "joints_off_written_range"
WRIST = ("left_wrist_pitch_joint", "left_wrist_yaw_joint")
WAIST = ("waist_roll_joint", "waist_pitch_joint")
FILES = {
    "mcap": "walk.mcap",
    "rosbag2": "walk_bag",
    "hdf5": "walk.h5",
    "npz": "walk.npz",
    "lerobot": "walk_set",
}
"""Formats that keep provenance, a name for each."""


@pytest.fixture(scope="module")
def good(short_walk: str, tmp_path_factory: pytest.TempPathFactory) -> JointTrajectory:
    path = tmp_path_factory.mktemp("recording") / "walk.mvnx"
    path.write_text(short_walk, encoding="utf-8")
    return convert(formats.read_motion(path), robot_model.build(robots.load("g1")), ConvertOptions()).trajectory


def swapped_columns(good: JointTrajectory, first: str, second: str) -> JointTrajectory:
    order = list(range(len(good.joint_names)))
    i, j = good.joint_names.index(first), good.joint_names.index(second)
    order[i], order[j] = j, i
    return replace(good, position=good.position[:, order], velocity=good.velocity[:, order])


def swapped_names(good: JointTrajectory, first: str, second: str) -> JointTrajectory:
    names = {first: second, second: first}
    return replace(good, joint_names=tuple(names.get(name, name) for name in good.joint_names))


def check_of(result: Result) -> dict[str, Any]:
    assert result.stdout, result.stderr
    found: dict[str, Any] = next(c for c in json.loads(result.stdout)["checks"] if c["name"] == CHECK)
    return found


@pytest.mark.parametrize("kind", FILES)
def test_every_format_that_keeps_provenance(run: Run, good: JointTrajectory, kind: str) -> None:
    if kind == "lerobot":
        pytest.importorskip("pyarrow", reason="datasets are Parquet")
    path = FILES[kind]
    formats.write_trajectory(path, good, format=kind)
    lifted = ("--mode", "kinematic", "--json", "--max", "self_collision_depth_mm=none")
    assert check_of(run("validate", path, *lifted)) == {
        "name": CHECK, "value": 0, "unit": "", "limit": 0, "passed": True, "note": "", "where": "", "time_s": None,
    }  # fmt: skip
    # What a tool does that reads a file and writes it again.
    read = formats.read_trajectory(path)
    formats.write_trajectory(path, swapped_columns(read, *WRIST), format=kind, overwrite=True)
    result = run("validate", path, *lifted)
    check = check_of(result)
    assert result.exit_code == 3
    assert (check["value"], check["passed"]) == (2, False)
    assert check["where"] in WRIST
    assert f"{WRIST[0]} and {WRIST[1]} look swapped" in check["note"]


@pytest.mark.parametrize("swap", [swapped_columns, swapped_names])
@pytest.mark.parametrize("pair", [WRIST, WAIST])
@pytest.mark.parametrize("mode", ["kinematic", "fixed"])
def test_pairs_within_wrist_and_waist(
    run: Run, good: JointTrajectory, pair: tuple[str, str], swap: Callable[..., JointTrajectory], mode: str
) -> None:
    formats.write_trajectory("bad.mcap", swap(good, *pair))
    result = run("validate", "bad.mcap", "--mode", mode)
    assert result.exit_code == 3
    (line,) = [line for line in result.stderr.splitlines() if CHECK in line]
    assert line.startswith(f"retarget: bad.mcap: {CHECK} is 2, limit 0: ")
    where, _, when = line.removeprefix(f"retarget: bad.mcap: {CHECK} is 2, limit 0: ").partition(" at ")
    assert where in pair
    assert float(when.partition(" s;")[0]) == pytest.approx(good.time[0], abs=0.5)
    assert f"{pair[0]} and {pair[1]} look swapped" in line or f"{pair[1]} and {pair[0]} look swapped" in line
    row = next(row for row in result.stdout.splitlines() if row.startswith(f"  {CHECK}"))
    assert "FAILED" in row or "failed" in row


def test_thresholds_know_it(run: Run, good: JointTrajectory, tmp_path: Path) -> None:
    formats.write_trajectory("bad.mcap", swapped_columns(good, *WAIST))
    rest = ("--mode", "kinematic", "--max", "self_collision_depth_mm=none")
    assert run("validate", "bad.mcap", *rest, "--max", f"{CHECK}=none").exit_code == 0
    (tmp_path / "limits.toml").write_text(f"[kinematic]\n{CHECK} = 2\n")
    assert run("validate", "bad.mcap", *rest, "--thresholds", "limits.toml").exit_code == 0
    assert run("validate", "bad.mcap", *rest, "--thresholds", "limits.toml", "--max", f"{CHECK}=1").exit_code == 3


def test_files_without_provenance_say_so(run: Run, good: JointTrajectory) -> None:
    formats.write_trajectory("walk.csv", good)
    formats.write_trajectory("gmr.npz", good, style="gmr")
    for path in ("walk.csv", "gmr.npz"):
        check = check_of(run("validate", path, "--robot", "g1", "--mode", "kinematic", "--json"))
        assert (check["value"], check["passed"]) == (None, None)
        assert check["note"] == "the file doesn't keep the ranges that its joints were written with"


def test_size_of_what_is_kept(good: JointTrajectory) -> None:
    assert len(json.dumps(good.provenance["joint_ranges"])) < 2000
