"""`retarget convert` on good input: what is written where, what is printed, and which clips are done."""

from __future__ import annotations

import gzip
import hashlib
import io
import json
import shutil
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from retarget import formats
from retarget.core.types import JointTrajectory

Run = Callable[..., Result]

FRAMES = 30

CONTRACT = {
    "input", "output", "robot", "method", "mapping", "status", "error", "frames", "rate_hz", "duration_s", "wall_s", "frames_per_second",
    "metrics", "provenance",
}  # fmt: skip
METRICS = {
    "limb_direction_error_deg", "orientation_error_deg", "hand_position_error_mm", "position_limit_violations", "velocity_limit_violations",
    "max_velocity_ratio", "limit_active_fraction", "jerk_rms_rad_s3", "foot_skate_m_s", "ground_penetration_mm",
    "self_collision_fraction", "marked_frames", "unmeasured_segments",
}  # fmt: skip


def assert_same(one: JointTrajectory, other: JointTrajectory) -> None:
    assert one.joint_names == other.joint_names
    np.testing.assert_array_equal(one.position, other.position)


def test_the_default_output_stands_here_and_is_a_finished_trajectory(run: Run, walk: Path, tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    shutil.move(walk, tmp_path / "sub/walk.mvnx")
    result = run("convert", "sub/walk.mvnx", "--robot", "g1")
    assert (result.exit_code, result.stdout) == (0, "")
    line = result.stderr
    assert line.startswith("sub/walk.mvnx → g1: 30 frames at 60 Hz, limbs ")
    assert ", limits kept, " in line
    assert line.endswith(" → walk_g1.mcap\n")
    trajectory = formats.read_trajectory("walk_g1.mcap")
    assert trajectory.frames == FRAMES
    assert trajectory.robot == "g1"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["sub", "walk_g1.mcap"]


def test_json_holds_the_contract_and_the_numbers_agree_with_the_file(run: Run, walk: Path) -> None:
    result = run("convert", walk, "--robot", "g1", "--json", "-q", "-o", "{stem}.mcap", "--base", "human")
    assert result.stderr == ""
    (line,) = result.stdout.splitlines()
    record = json.loads(line)
    assert set(record) >= CONTRACT
    assert set(record["metrics"]) >= METRICS
    assert set(record["metrics"]["limb_direction_error_deg"]) == {"mean", "p95", "max", "per_limb"}
    assert set(record["metrics"]["orientation_error_deg"]) == {"mean", "p95", "max", "per_link"}
    assert (record["input"], record["output"], record["robot"]) == (str(walk), "walk.mcap", "g1")
    assert (record["status"], record["error"], record["method"], record["mapping"]) == (
        "ok",
        None,
        "geometric",
        "limb_plane",
    )
    trajectory = formats.read_trajectory("walk.mcap")
    assert record["frames"] == trajectory.frames == FRAMES
    assert record["rate_hz"] == pytest.approx(60)
    assert record["duration_s"] == pytest.approx((FRAMES - 1) / 60)
    assert record["frames_per_second"] == pytest.approx(FRAMES / record["wall_s"])
    assert sum(record["stages_s"].values()) == pytest.approx(record["wall_s"], rel=0.2)
    assert record["provenance"]["input_sha256"] == hashlib.sha256(walk.read_bytes()).hexdigest()
    assert record["provenance"]["options"]["base"] == "human"
    assert record["provenance"]["retarget_version"] == version("retarget")
    assert record["provenance"]["robot_model_sha256"] == trajectory.provenance["robot_model_sha256"]


def test_self_collision_is_looked_for_on_request(run: Run, walk: Path) -> None:
    result = run("convert", walk, "--robot", "tocabi", "--json", "-o", "a.h5")
    assert json.loads(result.stdout)["metrics"]["self_collision_fraction"] is None
    result = run("convert", walk, "--robot", "tocabi", "--json", "-o", "b.h5", "--self-collision")
    record = json.loads(result.stdout)
    assert record["metrics"]["self_collision_fraction"] == 0.0
    assert record["stages_s"]["self-collision"] > 0
    assert_same(formats.read_trajectory("a.h5"), formats.read_trajectory("b.h5"))


@pytest.mark.parametrize("name", ["walk.csv", "walk.h5", "walk.npz", "walk.mcap"])
def test_the_suffix_chooses_the_format(run: Run, walk: Path, name: str) -> None:
    run("convert", walk, "--robot", "g1", "-o", "reference.mcap", "-q")
    assert run("convert", walk, "--robot", "g1", "-o", name).exit_code == 0
    assert_same(formats.read_trajectory(name), formats.read_trajectory("reference.mcap"))


def test_format_and_style(run: Run, walk: Path) -> None:
    assert run("convert", walk, "--robot", "g1", "--format", "csv").exit_code == 0
    header = Path("walk_g1.csv").read_text().splitlines()[0]
    assert header.startswith("time_s,")
    assert run("convert", walk, "--robot", "g1", "--csv-style", "unitree", "-o", "u.csv").exit_code == 0
    rows = Path("u.csv").read_text().splitlines()
    trajectory = formats.read_trajectory("walk_g1.csv")
    assert len(rows) == FRAMES
    values = np.array([[float(cell) for cell in row.split(",")] for row in rows])
    np.testing.assert_array_equal(values[:, 7:], trajectory.position)
    assert trajectory.base_orientation is not None
    np.testing.assert_array_equal(values[:, 3:7], trajectory.base_orientation[:, [1, 2, 3, 0]])


def test_several_robots_and_placeholders(run: Run, walk: Path, tmp_path: Path) -> None:
    arguments = [
        "convert",
        walk,
        "--robot",
        "g1",
        "--robot",
        "icub",
        "-o",
        "{robot}/{mapping}/{stem}.{format}",
        "--format",
        "npz",
    ]
    assert run(*arguments).exit_code == 0
    found = sorted(str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*.npz"))
    assert found == ["g1/limb_plane/walk.npz", "icub/limb_plane/walk.npz"]
    assert formats.read_trajectory(found[1]).robot == "icub"


def test_an_existing_folder_as_output(run: Run, walk: Path, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    run("convert", walk, "--robot", "g1", "-o", "out")
    assert (tmp_path / "out/walk_g1.mcap").is_file()


def test_a_profile_of_one_s_own(run: Run, walk: Path, tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text('extends = "g1"\nname = "slow_g1"\n[limits]\ndefault_velocity_rad_s = 0.4\n')
    result = run("convert", walk, "--robot", "./mine.toml", "--json", "-q")
    record = json.loads(result.stdout)
    assert (record["robot"], record["output"]) == ("slow_g1", "walk_slow_g1.mcap")
    assert record["metrics"]["velocity_limit_violations"] == 0
    trajectory = formats.read_trajectory("walk_slow_g1.mcap")
    assert np.abs(np.diff(trajectory.position, axis=0) * 60).max() <= 0.4 + 1e-9


def test_part_of_the_recording_at_another_rate(run: Run, walk: Path) -> None:
    run("convert", walk, "--robot", "g1", "--start", "2.1", "--end", "2.3", "--rate", "100", "-o", "part.mcap")
    trajectory = formats.read_trajectory("part.mcap")
    assert trajectory.frames == 21
    np.testing.assert_allclose(np.diff(trajectory.time), 0.01, atol=1e-8)


def test_smoothing_lowers_the_jerk_and_keeps_the_limits(run: Run, walk: Path) -> None:
    rough, smooth = (
        json.loads(run("convert", walk, "--robot", "g1", "--json", "-q", "--force", *options).stdout)["metrics"]
        for options in ([], ["--smooth", "0.1"])
    )
    assert smooth["jerk_rms_rad_s3"] < 0.5 * rough["jerk_rms_rad_s3"]
    assert smooth["position_limit_violations"] == smooth["velocity_limit_violations"] == 0


def test_stdin_and_stdout(program, walk: Path, tmp_path: Path) -> None:
    done = program("convert", "-", "--robot", "g1", "-o", "-", input=walk.read_bytes())
    assert done.returncode == 0
    assert done.stderr.startswith("- → g1: 30 frames".encode())
    piped = formats.read_trajectory(io.BytesIO(done.stdout), "pipe", "mcap")
    assert sorted(tmp_path.iterdir()) == [walk]
    program("convert", walk, "--robot", "g1", "-o", tmp_path / "file.mcap", check=True)
    assert_same(piped, formats.read_trajectory(tmp_path / "file.mcap"))


def test_a_compressed_recording_gives_the_same(run: Run, walk: Path, tmp_path: Path) -> None:
    (tmp_path / "packed.mvnx.gz").write_bytes(gzip.compress(walk.read_bytes()))
    assert run("convert", "packed.mvnx.gz", walk, "--robot", "g1").exit_code == 0
    assert_same(formats.read_trajectory("packed_g1.mcap"), formats.read_trajectory("walk_g1.mcap"))


def test_dry_run_checks_and_prints_but_does_nothing(run: Run, walk: Path, tmp_path: Path) -> None:
    result = run("convert", walk, "--robot", "g1", "--robot", "icub", "-n")
    assert result.stdout == f"{walk} → walk_g1.mcap\n{walk} → walk_icub.mcap\n"
    planned = [json.loads(line) for line in run("convert", walk, "--robot", "g1", "-n", "--json").stdout.splitlines()]
    assert planned == [{"input": str(walk), "output": "walk_g1.mcap", "robot": "g1", "status": "planned"}]
    assert list(tmp_path.iterdir()) == [walk]
    assert run("convert", walk, "--robot", "g1", "-n", "-o", "no/x.mcap").exit_code == 2


def test_skip_existing_and_force(run: Run, walk: Path, tmp_path: Path) -> None:
    old = tmp_path / "walk_g1.mcap"
    old.write_bytes(b"old")
    result = run("convert", walk, "--robot", "g1", "--robot", "icub", "--skip-existing", "--json")
    assert [json.loads(line)["robot"] for line in result.stdout.splitlines()] == ["icub"]
    assert "walk_g1.mcap: exists, skipped" in result.stderr
    assert old.read_bytes() == b"old"
    assert run("convert", walk, "--robot", "g1", "--robot", "icub", "--skip-existing").exit_code == 0
    assert run("convert", walk, "--robot", "g1", "--force").exit_code == 0
    assert formats.read_trajectory(old).frames == FRAMES


def many(walk: Path, folder: Path, count: int) -> list[Path]:
    paths = [folder / f"clip{i}.mvnx" for i in range(count)]
    for path in paths:
        shutil.copy(walk, path)
    return paths


def test_clips_in_parallel_keep_their_order_and_values(run: Run, walk: Path, tmp_path: Path) -> None:
    paths = many(walk, tmp_path, 4)
    paths[2].write_text("no recording")
    result = run("convert", *paths, "--robot", "g1", "--jobs", "2", "--json")
    records = [json.loads(line) for line in result.stdout.splitlines()]
    assert [record["input"] for record in records] == [str(path) for path in paths]
    assert [record["status"] for record in records] == ["ok", "ok", "failed", "ok"]
    assert result.exit_code == 1
    assert set(records[2]) >= CONTRACT
    assert records[2]["error"].startswith(f"{paths[2]}, line 1: not XML")
    assert result.stderr.count("\n") == 4
    assert result.stderr.splitlines()[2].startswith(f"retarget: [3/4] {paths[2]}, line 1: not XML")
    run("convert", walk, "--robot", "g1", "-q")
    for number in (0, 1, 3):
        assert_same(formats.read_trajectory(f"clip{number}_g1.mcap"), formats.read_trajectory("walk_g1.mcap"))
    assert not (tmp_path / "clip2_g1.mcap").exists()


def test_shards_do_everything_once(run: Run, walk: Path, tmp_path: Path) -> None:
    paths = many(walk, tmp_path, 5)
    outputs = []
    for number in (1, 2, 3):
        lines = run("convert", *paths, "--robot", "g1", "-n", "--shard", f"{number}/3", "--json").stdout.splitlines()
        outputs.append([json.loads(line)["output"] for line in lines])
    assert [len(part) for part in outputs] == [2, 2, 1]
    assert sorted(output for part in outputs for output in part) == [f"clip{i}_g1.mcap" for i in range(5)]


@pytest.mark.parametrize(("separator", "options"), [("\n", []), ("\r\n", []), ("\0", ["-0"])])
def test_inputs_from_a_file_and_from_stdin(
    run: Run, walk: Path, tmp_path: Path, separator: str, options: list[str]
) -> None:
    odd = tmp_path / "a clip.mvnx"
    shutil.copy(walk, odd)
    names = separator.join(["walk.mvnx", "a clip.mvnx"]) + separator
    (tmp_path / "list").write_text(names, newline="")
    expected = "walk.mvnx → walk_g1.mcap\na clip.mvnx → a clip_g1.mcap\n"
    assert run("convert", "--files-from", "list", *options, "--robot", "g1", "-n").stdout == expected
    assert run("convert", "--files-from", "-", *options, "--robot", "g1", "-n", stdin=names).stdout == expected


def test_folders_are_searched_with_r(run: Run, walk: Path, tmp_path: Path) -> None:
    for name in ("in/b/two.mvnx", "in/a/one.mvnx.gz", "in/three.MVNX", "in/notes.txt"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(walk, tmp_path / name)
    assert (
        run("convert", walk, "--robot", "g1", "-o", "in/old.mcap").exit_code == 0
    )  # what was written here is no recording
    result = run("convert", "in", "-r", "--robot", "g1", "-n")
    assert [line.split(" → ")[0] for line in result.stdout.splitlines()] == [
        "in/three.MVNX",
        "in/a/one.mvnx.gz",
        "in/b/two.mvnx",
    ]


def test_the_upper_body_recording_names_what_it_did_not_measure(run: Run) -> None:
    recording = Path(__file__).parents[3] / "shared/data/mvnx/upper_body_v4_60hz.mvnx"
    if not recording.is_file():
        pytest.skip(f"the real recording {recording.name} is not here")
    result = run("convert", recording, "--robot", "g1", "--json", "-o", "upper.mcap")
    assert result.exit_code == 0
    missing = json.loads(result.stdout)["metrics"]["unmeasured_segments"]
    assert {"LeftUpperLeg", "RightFoot"} <= set(missing)
    assert "warning: not measured, kept in the reference posture: left and right UpperLeg" in result.stderr.replace(
        "Right", "right"
    )
    trajectory = formats.read_trajectory("upper.mcap")
    legs = [i for i, name in enumerate(trajectory.joint_names) if "hip" in name or "knee" in name or "ankle" in name]
    assert len(legs) == 12
    assert np.ptp(trajectory.position[:, legs], axis=0).max() == 0


def test_report_beside_the_trajectory(run: Run, walk: Path, tmp_path: Path) -> None:
    assert run("convert", walk, "--robot", "g1", "--report", "page.html").exit_code == 0
    assert "walk.mvnx on g1" in (tmp_path / "page.html").read_text()
    (tmp_path / "pages").mkdir()
    assert run("convert", walk, "--robot", "icub", "--report", "pages", "-q").exit_code == 0
    assert (tmp_path / "pages/walk_icub.html").is_file()
