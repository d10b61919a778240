"""`retarget convert --rerun`: what Rerun's own reader finds in the recording."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from retarget import formats

Run = Callable[..., Result]


def columns(path: Path) -> dict[str, dict[str, Any]]:
    """Entity → component → (times in s, values), of all chunks, by Rerun's reader."""
    chunk = pytest.importorskip("rerun.chunk", reason="rerun-sdk with its own reader of recordings is not installed")
    found: dict[str, dict[str, Any]] = {}
    for part in chunk.RrdReader(path).stream().to_chunks():
        batch = part.to_record_batch()
        for field, column in zip(batch.schema, batch.columns, strict=True):
            metadata = {key.decode(): value.decode() for key, value in (field.metadata or {}).items()}
            if metadata.get("rerun:kind") == "data":
                entity = found.setdefault(str(part.entity_path), {})
                times = None
                if not part.is_static:
                    times = np.array(batch.column(batch.schema.get_field_index("time")).cast("int64")) / 1e9
                entity.setdefault(metadata["rerun:component"], []).append((times, column))
    return found


def test_person_targets_robot_and_errors_on_one_timeline(run: Run, walk: Path, tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="the extra rerun is not installed")
    result = run("convert", walk, "--robot", "g1", "-o", "walk.mcap", "--rerun", "walk.rrd", "--json", "-q")
    assert result.exit_code == 0, result.stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["walk.mcap", "walk.mvnx", "walk.rrd"]
    trajectory = formats.read_trajectory("walk.mcap")
    found = columns(tmp_path / "walk.rrd")
    entities = set(found)
    assert {"/human/bones", "/robot/bones", "/robot/links", "/targets/orientations"} <= entities
    assert {f"/joints/{name}" for name in trajectory.joint_names} <= entities
    record = json.loads(result.stdout)
    limbs = record["metrics"]["limb_direction_error_deg"]["per_limb"]
    for segment, figures in limbs.items():
        ((times, values),) = found[f"/errors/limb_direction_error_deg/{segment}"]["Scalars:scalars"]
        np.testing.assert_allclose(times, trajectory.time, atol=1e-9)
        assert max(value[0] for value in values.to_pylist()) == pytest.approx(figures["max"], abs=1e-9)
    for i, name in enumerate(trajectory.joint_names):
        ((_, values),) = found[f"/joints/{name}"]["Scalars:scalars"]
        np.testing.assert_array_equal([value[0] for value in values.to_pylist()], trajectory.position[:, i])
    ((times, strips),) = found["/human/bones"]["LineStrips3D:strips"]
    assert len(times) == trajectory.frames
    assert len(strips[0].as_py()) == 22


def test_figures_are_at_most_60_a_second_numbers_at_every_frame(run: Run, walk: Path, tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="the extra rerun is not installed")
    result = run("convert", walk, "--robot", "g1", "-o", "w.mcap", "--rerun", "w.rrd", "--rate", 240, "-q")
    assert result.exit_code == 0, result.stderr
    trajectory, found = formats.read_trajectory("w.mcap"), columns(tmp_path / "w.rrd")
    ((times, _),) = found["/robot/bones"]["LineStrips3D:strips"]
    np.testing.assert_allclose(times, trajectory.time[::4], atol=1e-9)
    ((times, _),) = found[f"/joints/{trajectory.joint_names[0]}"]["Scalars:scalars"]
    assert len(times) == trajectory.frames


def test_a_folder_of_recordings_and_what_exists_is_kept(run: Run, walk: Path, tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="the extra rerun is not installed")
    (tmp_path / "logs").mkdir()
    arguments = ("convert", walk, "--robot", "g1", "--robot", "icub", "-o", "{robot}.mcap", "--rerun", "logs", "-q")
    assert run(*arguments).exit_code == 0
    assert sorted(path.name for path in (tmp_path / "logs").iterdir()) == ["walk_g1.rrd", "walk_icub.rrd"]
    (tmp_path / "g1.mcap").unlink()
    (tmp_path / "icub.mcap").unlink()
    result = run(*arguments)
    assert result.exit_code == 2
    assert "walk_g1.rrd: exists" in result.stderr


def test_without_the_sdk_it_says_so_before_any_work(
    run: Run, walk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    result = run("convert", walk, "--robot", "g1", "--rerun", "walk.rrd")
    assert result.exit_code == 2
    assert "rerun-sdk, which is not installed; expected it from pip install 'retarget[rerun]'" in result.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["walk.mvnx"]
