"""LeRobot datasets: as pyarrow, pandas and Rerun's reader see them, read back, and refused where they can't be."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from retarget import formats
from retarget.core.errors import FormatError, RetargetError, UsageError
from retarget.core.types import JointTrajectory
from retarget.formats import TrajectoryOptions, _parquet_count

pa = pytest.importorskip("pyarrow", reason="the extra lerobot is not installed")
import pyarrow.parquet as pq  # noqa: E402 - only where there is one

Maker = Callable[..., JointTrajectory]
DATA = "data/chunk-000/file-000.parquet"


@pytest.fixture
def dataset(tmp_path: Path, make_trajectory: Maker) -> Path:
    formats.write_trajectory(tmp_path / "walk", make_trajectory(frames=90), format="lerobot")
    return tmp_path / "walk"


def change(dataset: Path, file: str, **changes: Any) -> None:
    path = dataset / file
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


def test_a_trajectory_comes_back_within_single_precision(tmp_path: Path, make_trajectory: Maker) -> None:
    for i, changes in enumerate(
        (
            {},
            {"base_position": None, "base_orientation": None},
            {"joint_names": ("only",)},
            {"base_angular_velocity": None},
        )
    ):
        trajectory = make_trajectory(frames=90, joints=1 if "joint_names" in changes else 7, **changes)
        trajectory = replace(trajectory, time=trajectory.time + 1.25)
        formats.write_trajectory(tmp_path / str(i), trajectory, format="lerobot")
        back = formats.read_trajectory(tmp_path / str(i))
        np.testing.assert_allclose(back.time, trajectory.time, rtol=0, atol=1e-12)
        for field in ("position", "velocity", "base_position", "base_orientation"):
            old, new = getattr(trajectory, field), getattr(back, field)
            assert (old is None) == (new is None), field
            if old is not None:
                np.testing.assert_allclose(new, old, rtol=6e-8, atol=1e-7 if "orient" in field else 0, err_msg=field)
        assert (back.base_linear_velocity is None) == (changes.get("base_angular_velocity", ...) is None)
        np.testing.assert_array_equal(back.status, trajectory.status)
        for field in ("joint_names", "base_frame", "robot", "provenance", "robot_description"):
            assert getattr(back, field) == getattr(trajectory, field)


def test_the_layout_is_that_of_version_3(dataset: Path, make_trajectory: Maker) -> None:
    trajectory = make_trajectory(frames=90)
    assert sorted(str(p.relative_to(dataset)) for p in dataset.rglob("*") if p.is_file()) == [
        DATA,
        "meta/episodes/chunk-000/file-000.parquet",
        "meta/info.json",
        "meta/retarget.json",
        "meta/stats.json",
        "meta/tasks.parquet",
    ]
    info = json.loads((dataset / "meta/info.json").read_text())
    assert (info["codebase_version"], info["fps"], info["robot_type"]) == ("v3.0", 60, "g1")
    assert (info["total_episodes"], info["total_frames"], info["total_tasks"], info["splits"]) == (
        1,
        90,
        1,
        {"train": "0:1"},
    )
    assert info["data_path"].format(chunk_index=0, file_index=0) == DATA
    table = pq.read_table(dataset / DATA)
    assert table.column_names == list(info["features"])
    for name, feature in info["features"].items():
        kind = table.schema.field(name).type
        if feature["shape"] == [1]:
            assert str(kind) == {"float32": "float"}.get(feature["dtype"], feature["dtype"])
        else:
            assert (str(kind.value_type), kind.list_size) == ("float", feature["shape"][0])
            assert len(feature["names"]) == feature["shape"][0]
    np.testing.assert_array_equal(table["index"], np.arange(90))
    np.testing.assert_array_equal(table["timestamp"], (np.arange(90) / 60).astype(np.float32))
    np.testing.assert_array_equal(np.array(table["action"].to_pylist()), trajectory.position.astype(np.float32))
    pose = np.array(table["observation.base_pose"].to_pylist())
    np.testing.assert_array_equal(pose[:, 6], trajectory.base_orientation[:, 0].astype(np.float32))
    (episode,) = pq.read_table(dataset / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    assert (episode["length"], episode["dataset_from_index"], episode["dataset_to_index"]) == (90, 0, 90)
    stats = json.loads((dataset / "meta/stats.json").read_text())
    state = np.array(table["observation.state"].to_pylist())
    for key, value in (("min", state.min(0)), ("mean", state.mean(0)), ("std", state.std(0)), ("count", [90])):
        np.testing.assert_allclose(stats["observation.state"][key], value, rtol=1e-12)
        np.testing.assert_allclose(episode[f"stats/observation.state/{key}"], value, rtol=1e-12)


def test_pandas_finds_tasks_by_their_text(dataset: Path) -> None:
    pandas = pytest.importorskip("pandas", reason="LeRobot's own way to read tasks is not installed")
    tasks = pandas.read_parquet(dataset / "meta/tasks.parquet")
    (episode,) = pq.read_table(dataset / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    assert int(tasks.loc[episode["tasks"][0]].task_index) == 0


def test_rerun_reads_it(dataset: Path) -> None:
    experimental = pytest.importorskip("rerun.experimental", reason="the extra rerun is not installed")
    if not hasattr(experimental, "LeRobotReader"):
        pytest.skip("this rerun-sdk has no reader of LeRobot datasets")
    reader = experimental.LeRobotReader(dataset)
    assert reader.episodes() == [0]
    chunks = reader.stream(0).collect().stream().to_chunks()
    rows = {(str(chunk.entity_path), chunk.num_rows) for chunk in chunks}
    assert {("/observation.state", 90), ("/action", 90)} <= rows


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"time": np.array([0.0, 0.1, 0.25, 0.3])},
            r"frame 2 is 50 ms off its place at 10 frames/s; .*--rate resamples",
        ),
        ({"time": np.arange(4) / 59.94 * 20}, "expected evenly spaced frames, a whole number a second"),
        ({"position": np.full((4, 3), 1e300)}, r"observation\.state holds 1e\+300; expected what float32 can hold"),
    ],
)
def test_what_a_dataset_can_not_hold(
    tmp_path: Path, make_trajectory: Maker, changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(RetargetError, match=message):
        formats.write_trajectory(tmp_path / "x", make_trajectory(frames=4, rate_hz=10.0, **changes), format="lerobot")
    assert not list(tmp_path.iterdir())


def test_datasets_of_others(dataset: Path) -> None:
    """Without our file: names one level down, no velocity, no base."""
    (dataset / "meta/retarget.json").unlink()
    table = pq.read_table(dataset / DATA).select(["observation.state", "action", "timestamp"])
    pq.write_table(table, dataset / DATA)
    features = {"observation.state": {"dtype": "float32", "shape": [3], "names": {"motors": ["a", "b", "c"]}}}
    change(dataset, "meta/info.json", features=features, robot_type=None)
    back = formats.read_trajectory(dataset)
    assert (back.joint_names, back.base_position, back.robot) == (("a", "b", "c"), None, "")
    assert back.provenance["warnings"] == ["velocity missing: differentiated from the positions"]
    features["observation.state"]["names"] = None  # type: ignore[assignment]  # as some are
    change(dataset, "meta/info.json", features=features)
    with pytest.raises(FormatError, match="does not name its 3 joints; expected names; or the robot named"):
        formats.read_trajectory(dataset)
    assert (
        formats.read_trajectory(dataset, options=TrajectoryOptions(joint_names=("x", "y", "z"))).joint_names[0] == "x"
    )


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"codebase_version": "v2.1"}, r"version v2\.1; expected v3\.0"),
        ({"total_episodes": 2}, "2 episodes; expected a dataset of one"),
        ({"fps": 0}, "fps 0; expected a positive number"),
        ({"fps": "60"}, "fps 60; expected a positive number"),
        ({"features": []}, "does not name its 3 joints"),
    ],
)
def test_descriptions_that_are_refused(dataset: Path, changes: dict[str, Any], message: str) -> None:
    change(dataset, "meta/info.json", **changes)
    with pytest.raises(FormatError, match=message):
        formats.read_trajectory(dataset)


@pytest.mark.parametrize("start", ["1" + "0" * 30, "1e13", "NaN", "true", "null", '"now"'])
def test_starts_that_are_none(dataset: Path, start: str) -> None:
    ours = dataset / "meta/retarget.json"
    found = json.loads(ours.read_text())
    ours.write_text(json.dumps({**found, "start_s": "HERE"}).replace('"HERE"', start))
    with pytest.raises(FormatError, match=r"start_s .*expected a time in s"):
        formats.read_trajectory(dataset)


@pytest.mark.parametrize("file", ["meta/info.json", "meta/retarget.json", DATA])
@pytest.mark.parametrize("content", [b"", b"[]", b"\xff\xfe\x00", b"PAR1" + bytes(40) + b"PAR1"])
def test_damaged_files(dataset: Path, file: str, content: bytes) -> None:
    (dataset / file).write_bytes(content)
    with pytest.raises(FormatError) as caught:
        formats.read_trajectory(dataset)
    assert "\n" not in str(caught.value)


def test_a_small_file_of_very_many_numbers(dataset: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("retarget.formats.lerobot._LARGEST_COUNT", 90 * (3 + 3 + 7 + 6 + 1))
    formats.read_trajectory(dataset)
    state = pa.FixedSizeListArray.from_arrays(pa.array(np.zeros(3_000_000, np.float32)), 3)
    pq.write_table(pa.table({"observation.state": state}), dataset / DATA)
    assert (dataset / DATA).stat().st_size < 30_000
    with pytest.raises(FormatError, match="not readable data: 3000000 numbers; expected at most 1800"):
        formats.read_trajectory(dataset)


def test_a_column_that_contradicts_its_own_histogram(dataset: Path) -> None:
    """Required by its schema, counted as optional: pyarrow ends the process that looks at the column's metadata."""
    data = (dataset / DATA).read_bytes()
    optional, required = (b"\x35" + kind + b"\x18\x11observation.state" for kind in (b"\x02", b"\x00"))
    assert data.count(optional) == 1
    (dataset / DATA).write_bytes(data.replace(optional, required))
    with pytest.raises(FormatError, match=r"data: not readable data: .*Parquet library did not get through it"):
        formats.read_trajectory(dataset)


def test_numbers_are_counted_over_files_and_columns(tmp_path: Path) -> None:
    state = pa.FixedSizeListArray.from_arrays(pa.array(np.zeros(12, np.float32)), 3)
    lists = pa.array([[1.0], [2.0, 3.0], [], [4.0]])
    for name in ("a.parquet", "b.parquet"):
        pq.write_table(
            pa.table({"state": state, "lists": lists, "status": np.arange(4), "other": np.arange(4)}), tmp_path / name
        )
    paths = [tmp_path / "a.parquet", tmp_path / "b.parquet"]
    assert _parquet_count.count(paths, ["state"]) == 24
    assert _parquet_count.count(paths[:1], ["status", "state", "none"]) == 16
    assert _parquet_count.count(paths[:1], ["lists"]) == 5  # an empty list takes a place
    with pytest.raises(ValueError, match=r"[Nn]o such file"):
        _parquet_count.count([tmp_path / "c.parquet"], ["state"])


@pytest.mark.parametrize(
    ("state", "message"),
    [
        ([[1.0, 2.0, 3.0], [1.0, 2.0]], "lists of several lengths"),
        ([[1.0, 2.0, 3.0], None], "lists of several lengths"),
        (["1", "2"], "values of type string"),
        ([[1.0, 2.0, 3.0], [1.0, None, 3.0]], "found nan at"),
    ],
)
def test_features_that_are_no_rows_of_numbers(dataset: Path, state: list[Any], message: str) -> None:
    pq.write_table(pa.table({"observation.state": state}), dataset / DATA)
    with pytest.raises(FormatError, match=message):
        formats.read_trajectory(dataset)


def test_without_pyarrow_it_says_what_to_install(
    tmp_path: Path, make_trajectory: Maker, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(UsageError, match=r"pyarrow, which is not installed; .*pip install 'retarget\[lerobot\]'"):
        formats.write_trajectory(tmp_path / "x", make_trajectory(), format="lerobot")
    assert not list(tmp_path.iterdir())
