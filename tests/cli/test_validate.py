"""`retarget validate`: verdicts and exit codes, what is refused, what goes through pipes. The robot's replay itself is tested in tests/core/replay."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from click.testing import Result
from retarget import formats, robots
from retarget.cli import validate as command
from retarget.core.replay import match
from retarget.core.replay.gains import GAIN_SOURCES
from retarget.core.replay.thresholds import TABLE
from retarget.core.robot_model import RobotModel, build
from retarget.core.types import JointTrajectory

Run = Callable[..., Result]
PROGRAM = Path(sys.executable).with_name("retarget")
RATE_HZ = 60.0


@pytest.fixture(scope="module")
def model() -> RobotModel:
    return build(robots.load("g1"))


def waving(model: RobotModel, seconds: float = 0.5) -> JointTrajectory:
    """G1 in its reference posture, both elbows swinging by 0.2 rad; the base upright, its soles on the ground."""
    time = np.arange(round(seconds * RATE_HZ) + 1) / RATE_HZ
    swing, speed = 0.2 * (1 - np.cos(4 * time)), 0.8 * np.sin(4 * time)
    position = np.tile(model.reference_posture, (len(time), 1))
    velocity = np.zeros_like(position)
    for joint in ("left_elbow_joint", "right_elbow_joint"):
        position[:, model.joint_index(joint)] += swing
        velocity[:, model.joint_index(joint)] = speed
    return JointTrajectory(
        time=time,
        joint_names=model.joint_names,
        position=position,
        velocity=velocity,
        base_position=np.tile([0.0, 0.0, 0.79], (len(time), 1)),
        base_orientation=np.tile([1.0, 0.0, 0.0, 0.0], (len(time), 1)),
        base_frame=model.base_link,
        robot="g1",
    )


@pytest.fixture
def wave(model: RobotModel, tmp_path: Path) -> Path:
    path = tmp_path / "wave.mcap"
    formats.write_trajectory(path, waving(model))
    return path


def without_times(text: str) -> list[dict[str, Any]]:
    records = [json.loads(line) for line in text.splitlines()]
    for record in records:
        assert record.pop("wall_s") > 0
        assert record.pop("real_time_factor") > 0
    return records


def test_a_motion_within_all_limits_passes(run: Run, wave: Path) -> None:
    result = run("validate", wave, "--json")
    assert (result.exit_code, result.stderr) == (0, "")
    record = json.loads(result.stdout)
    assert (record["input"], record["robot"], record["mode"], record["passed"]) == (str(wave), "g1", "fixed", True)
    assert [check["name"] for check in record["checks"]] == [
        row.name
        for mode in ("kinematic", "fixed")
        for row in TABLE[mode]
        if not row.name.endswith("_mm") or mode == "kinematic"
    ]
    assert all(set(check) >= {"name", "value", "unit", "limit", "passed", "note"} for check in record["checks"])


def test_choices_are_those_of_the_replay() -> None:
    """--help asks nobody, so these could fall behind."""
    assert tuple(TABLE) == command.MODES
    assert command.GAINS == GAIN_SOURCES
    names = next(p for p in command.validate.params if p.name == "joint_order").metavar
    assert names == "|".join([*match.ORDERS, "FILE"])


def test_kinematic_mode_runs_no_dynamics(run: Run, wave: Path) -> None:
    record = json.loads(run("validate", wave, "--json", "--mode", "kinematic").stdout)
    assert [check["name"] for check in record["checks"]] == [row.name for row in TABLE["kinematic"]]


def test_the_same_input_gives_the_same_json_but_for_times(run: Run, wave: Path) -> None:
    first, second = (run("validate", wave, wave, "--json").stdout for _ in range(2))
    assert without_times(first) == without_times(second)
    (one, other) = first.splitlines()
    assert without_times(one) == without_times(other)


def test_workers_give_the_same_json(run: Run, wave: Path, program: Any) -> None:
    here = run("validate", wave, wave, "--json", "--mode", "kinematic").stdout
    done = program("validate", wave, wave, "--json", "--mode", "kinematic", "--jobs", "2")
    assert done.returncode == 0
    assert without_times(done.stdout.decode()) == without_times(here)


def test_people_get_a_table(run: Run, wave: Path) -> None:
    lines = run("validate", wave).stdout.splitlines()
    assert lines[0].startswith(f"{wave} on g1, fixed: passed (0.5 s, ")
    assert lines[1].split() == ["check", "value", "limit", "verdict", "where"]
    row = next(line for line in lines if line.startswith("  joint_tracking_rmse_deg"))
    assert row.split()[2:5] == ["deg", "3", "ok"]


def test_a_failed_threshold_is_exit_3_and_named_with_joint_and_time(
    run: Run, model: RobotModel, tmp_path: Path
) -> None:
    motion = waving(model)
    position = motion.position.copy()
    position[20:, model.joint_index("left_knee_joint")] += 0.5
    formats.write_trajectory(tmp_path / "jump.mcap", replace(motion, position=position))
    result = run("validate", "jump.mcap", "--mode", "kinematic")
    assert result.exit_code == 3
    jump = next(line for line in result.stderr.splitlines() if "joint_jump_max_rad" in line)
    assert jump == "retarget: jump.mcap: joint_jump_max_rad is 0.5 rad, limit 0.3: left_knee_joint at 0.333 s"
    assert "FAILED" in result.stdout


def test_limits_come_from_the_command_line_before_the_file(run: Run, wave: Path, tmp_path: Path) -> None:
    limits = tmp_path / "limits.toml"
    limits.write_text("[kinematic]\nvelocity_ratio_max = 1e-6\n[fixed]\njoint_tracking_rmse_deg = 1e-6\n")
    both = run("validate", wave, "--thresholds", limits)
    assert both.exit_code == 3
    assert "velocity_ratio_max is" in both.stderr
    assert "joint_tracking_rmse_deg is" in both.stderr
    one = run("validate", wave, "--thresholds", limits, "--max", "velocity_ratio_max=none")
    assert one.exit_code == 3
    assert "velocity_ratio_max is" not in one.stderr
    none = run(
        "validate", wave, "--thresholds", limits, "--max", "velocity_ratio_max=1", "--max", "joint_tracking_rmse_deg=2"
    )
    assert none.exit_code == 0


def test_feed_forward_tracks_closer(run: Run, wave: Path) -> None:
    def rmse(*more: str) -> float:
        checks = json.loads(run("validate", wave, "--json", *more).stdout)["checks"]
        return float(next(c["value"] for c in checks if c["name"] == "joint_tracking_rmse_deg"))

    assert rmse("--feed-forward") < 0.2 * rmse()


def test_the_log_holds_every_step(run: Run, wave: Path, model: RobotModel, tmp_path: Path) -> None:
    assert run("validate", wave, "--log", "{stem}.h5", "-q").exit_code == 0
    with h5py.File(tmp_path / "wave.h5") as log:
        assert log["time"].shape == (1000,)
        np.testing.assert_allclose(np.diff(log["time"]), 1 / 2000)
        assert log["torque"].shape == (1000, len(model.joint_names))
        assert log["torque"].attrs["unit"] == "Nm"
        assert tuple(log.attrs["joint_names"]) == model.joint_names
        assert log.attrs["robot"] == "g1"
        error = np.degrees(log["position"][:] - log["reference"][:])
    checks = json.loads(run("validate", wave, "--json").stdout)["checks"]
    value = next(c["value"] for c in checks if c["name"] == "joint_tracking_rmse_deg")
    assert value == pytest.approx(np.sqrt(np.mean(error**2)))


def test_through_a_shell_pipe(walk: Path, tmp_path: Path) -> None:
    environment = {**os.environ, "PATH": f"{PROGRAM.parent}:{os.environ['PATH']}", "OMP_NUM_THREADS": "1"}
    script = (
        "set -o pipefail; retarget convert walk.mvnx --robot g1 -q -o - | "
        "retarget validate - --json --mode kinematic --max self_collision_depth_mm=none"
    )
    done = subprocess.run(["bash", "-c", script], cwd=walk.parent, env=environment, capture_output=True, timeout=120)
    assert done.returncode == 0, done.stderr
    record = json.loads(done.stdout)
    assert (record["input"], record["robot"], record["frames"]) == ("-", "g1", 30)
    assert tmp_path == walk.parent


@pytest.mark.parametrize("part", [0.3, 0.6, 0.95])
def test_a_truncated_stream_is_one_line_and_exit_1(run: Run, wave: Path, part: float) -> None:
    data = wave.read_bytes()
    result = run("validate", "-", "--json", stdin=data[: int(part * len(data))])
    assert result.exit_code == 1
    assert result.stderr.startswith("retarget: stdin")
    assert result.stderr.count("\n") == 1
    record = json.loads(result.stdout)
    assert (record["status"], record["passed"], record["checks"]) == ("failed", False, [])


def changed(model: RobotModel, case: str) -> JointTrajectory:
    motion = waving(model)
    names = list(model.joint_names)
    if case == "unknown joint":
        names[3] = "left_kne_joint"
        return replace(motion, joint_names=tuple(names))
    if case == "missing joints":
        return replace(
            motion, joint_names=tuple(names[:-2]), position=motion.position[:, :-2], velocity=motion.velocity[:, :-2]
        )
    if case == "no robot":
        return replace(motion, robot="")
    if case == "robot of elsewhere":
        return replace(motion, robot="h1_2")
    assert case == "one frame"
    fields = ("time", "position", "velocity", "base_position", "base_orientation", "status")
    return replace(motion, **{name: getattr(motion, name)[:1] for name in fields})


BAD_CONTENT = {
    "unknown joint": (1, "robot 'g1' has no joint 'left_kne_joint'; did you mean left_knee_joint"),
    "missing joints": (1, "lacks 2 of the 29 joints of robot 'g1': right_wrist_pitch_joint, right_wrist_yaw_joint"),
    "no robot": (2, "names no robot; give --robot NAME|FILE.toml"),
    "robot of elsewhere": (2, "was made for robot 'h1_2', which is not known by name here; give --robot"),
    "one frame": (1, "1 frame"),
}


@pytest.mark.parametrize("case", BAD_CONTENT)
def test_content_that_can_t_be_judged(run: Run, model: RobotModel, tmp_path: Path, case: str) -> None:
    code, expected = BAD_CONTENT[case]
    formats.write_trajectory(tmp_path / "bad.npz", changed(model, case))
    result = run("validate", "bad.npz")
    assert result.exit_code == code
    assert result.stdout == ""
    assert result.stderr.startswith("retarget: bad.npz")
    assert result.stderr.count("\n") == 1
    assert expected in result.stderr


def test_nan_is_told_with_its_place(run: Run, model: RobotModel, tmp_path: Path) -> None:
    stream = io.BytesIO()
    formats.write_trajectory_stream(stream, waving(model), format="csv")
    lines = stream.getvalue().decode().splitlines()
    cells = lines[11].split(",")
    cells[lines[0].split(",").index("q_left_knee_joint_rad")] = "nan"
    (tmp_path / "nan.csv").write_text("\n".join([*lines[:11], ",".join(cells), *lines[12:]]) + "\n")
    result = run("validate", "nan.csv", "--robot", "g1")
    assert result.exit_code == 1
    assert (
        result.stderr == "retarget: nan.csv: JointTrajectory.position: found nan at (10, 3), expected finite values\n"
    )


REFUSED: dict[str, tuple[list[str], int, str]] = {
    "no input": ([], 2, "no input; give trajectories, or --files-from"),
    "missing file": (["wav.mcap"], 2, "wav.mcap: no such file; did you mean"),
    "empty": (["empty.mcap"], 1, "empty.mcap: empty file"),
    "recording": (["walk.mvnx"], 2, "walk.mvnx: mvnx holds recorded motion, not a robot trajectory"),
    "pickle": (["gmr.pkl", "--robot", "g1"], 1, "gmr.pkl: a pickle runs code of its author's when it is read, so it never is; expected"),
    "folder": (["sub"], 2, "sub: is a folder; -r judges all trajectories below it"),
    "unknown robot": (["wave.mcap", "--robot", "g2"], 2, "unknown robot 'g2'; did you mean g1"),
    "another robot": (["wave.mcap", "--robot", "icub"], 1, "robot 'icub'"),
    "unknown threshold": (["wave.mcap", "--max", "joint_tracking_rms_deg=1"], 2, "did you mean joint_tracking_rmse_deg"),
    "no number": (["wave.mcap", "--max", "joint_tracking_rmse_deg=much"], 2, "found 'much', expected a number"),
    "threshold of another mode": (["wave.mcap", "--mode", "kinematic", "--max", "energy_j=1"], 2, "belongs to --mode fixed, which is not run"),
    "missing thresholds": (["wave.mcap", "--thresholds", "no.toml"], 2, "no.toml"),
    "log without dynamics": (["wave.mcap", "--mode", "kinematic", "--log", "a.h5"], 2, "kinematic mode has none"),
    "log's name": (["wave.mcap", "--log", "a.txt"], 2, "expected a file name ending in .h5"),
    "video's name": (["wave.mcap", "--video", "a.avi"], 2, "--video"),
    "one log for two": (["wave.mcap", "sub/wave.mcap", "--log", "a.h5"], 2, "a.h5: would replace the output a.h5"),
    "report exists": (["wave.mcap", "--report", "old.html"], 2, "old.html: exists; --force replaces it"),
    "onto the input": (["wave.mcap", "--log", "x.h5", "--report", "wave.mcap.html", "--thresholds", "no.toml"], 2, "no.toml"),
    "calibration alone": (["wave.mcap", "--calibration", "me.json"], 2, "--calibration is of the --recording"),
    "missing recording": (["wave.mcap", "--recording", "wolk.mvnx"], 2, "wolk.mvnx: no such file; did you mean walk.mvnx"),
    "two to view": (["wave.mcap", "sub/wave.mcap", "--view"], 2, "--view"),
    "headerless without robot": (["line.csv", "--csv-style", "unitree"], 2, "names no robot; give --robot"),
    "headerless of other width": (
        ["line.csv", "--csv-style", "unitree", "--robot", "g1", "--rate", "30"], 1, "found 7 columns of the root and 2 of joints; expected 29"),
    "headerless without rate": (["line.csv", "--csv-style", "unitree", "--robot", "g1"], 2, "expected a rate in Hz"),
    "headerless unsaid": (["line.csv", "--robot", "g1"], 1, "without a header"),
    "joint order that is no text": (["line.csv", "--joint-order", "wave.mcap", "--robot", "g1"], 2, "--joint-order wave.mcap: not UTF-8 text; expected urdf, isaac"),
    "joint order": (["line.csv", "--joint-order", "isac", "--robot", "g1"], 2, "--joint-order isac: no such file; expected urdf, isaac"),
    "npz that names no joints": (["mimic.npz", "--robot", "g1"], 1, "no array 'joint_names'"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_a_bad_request_is_one_line(run: Run, wave: Path, walk: Path, tmp_path: Path, case: str) -> None:
    arguments, code, expected = REFUSED[case]
    (tmp_path / "empty.mcap").touch()
    (tmp_path / "gmr.pkl").write_bytes(b"\x80\x04K\x01.")
    (tmp_path / "old.html").write_text("old")
    (tmp_path / "line.csv").write_text("0,0,1,0,0,0,1,0.1,0.2\n" * 3)
    arrays = {
        "joint_vel": np.zeros((3, 29)),
        "body_pos_w": np.zeros((3, 1, 3)),
        "body_quat_w": np.tile([1.0, 0, 0, 0], (3, 1, 1)),
    }
    np.savez(tmp_path / "mimic.npz", fps=[50], joint_pos=np.zeros((3, 29)), **arrays)
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub/wave.mcap").write_bytes(wave.read_bytes())
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    result = run("validate", *arguments)
    assert result.exit_code == code, result.stderr
    assert result.stdout == ""
    assert result.stderr.startswith("retarget: ")
    assert result.stderr.count("\n") == 1
    assert expected in result.stderr
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before
    assert walk.exists()


def test_a_clip_that_fails_stops_no_other_and_outweighs_a_threshold(run: Run, wave: Path, tmp_path: Path) -> None:
    (tmp_path / "cut.mcap").write_bytes(wave.read_bytes()[:2000])
    result = run("validate", "cut.mcap", wave, "--json", "--mode", "kinematic", "--max", "velocity_ratio_max=0")
    assert result.exit_code == 1
    assert [json.loads(line)["status"] for line in result.stdout.splitlines()] == ["failed", "ok"]


def values_of(run: Run, *arguments: str) -> dict[str, Any]:
    result = run("validate", *arguments, "--mode", "kinematic", "--json")
    assert result.stdout, result.stderr
    return {check["name"]: check["value"] for check in json.loads(result.stdout)["checks"]}


def test_files_of_others_that_name_no_joints(run: Run, model: RobotModel, tmp_path: Path) -> None:
    """Unitree's and GMR's headerless CSV, and BeyondMimic's NPZ in Isaac Sim's joint order, are judged as the file that names its joints."""
    motion = waving(model)
    formats.write_trajectory(tmp_path / "named.npz", motion)  # MCAP's stamps are whole nanoseconds, these are not
    expected = values_of(run, "named.npz")
    table = np.hstack([motion.base_position, motion.base_orientation[:, [1, 2, 3, 0]], motion.position])  # type: ignore[index,list-item]
    np.savetxt(tmp_path / "unitree.csv", table, delimiter=",", fmt="%.17g")
    csv = values_of(run, "unitree.csv", "--csv-style", "unitree", "--robot", "g1", "--rate", "60")
    order = match.joint_order(model, "isaac")
    columns = [model.joint_index(name) for name in order]
    bodies = {"body_pos_w": motion.base_position, "body_quat_w": motion.base_orientation}
    still = np.zeros((motion.frames, 1, 3))
    np.savez(
        tmp_path / "mimic.npz",
        fps=[60],
        joint_pos=motion.position[:, columns],
        joint_vel=motion.velocity[:, columns],
        body_lin_vel_w=still,
        body_ang_vel_w=still,
        **{name: np.repeat(values[:, None], 2, axis=1) for name, values in bodies.items() if values is not None},
    )
    npz = values_of(run, "mimic.npz", "--joint-order", "isaac", "--robot", "g1")
    (tmp_path / "order.txt").write_text("\n".join(order) + "\n")
    listed = values_of(run, "mimic.npz", "--joint-order", "order.txt", "--robot", "g1")
    assert listed == npz
    for name, value in expected.items():
        if value is None:
            assert csv[name] is npz[name] is None
            continue
        if name != "velocity_mismatch_percent":  # velocities are differentiated in one, written in the other
            assert csv[name] == pytest.approx(value, abs=1e-9), name
        assert npz[name] == pytest.approx(value, abs=1e-9), name


def test_without_a_screen_there_is_no_view(run: Run, wave: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    result = run("validate", wave, "--view")
    assert (result.exit_code, result.stdout) == (2, "")
    assert "--view needs a screen" in result.stderr


def test_without_pyav_there_is_no_video(run: Run, wave: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("retarget.cli.video.find_spec", lambda _name: None)
    result = run("validate", wave, "--video", "wave.mp4")
    assert (result.exit_code, result.stdout) == (2, "")
    assert result.stderr == "retarget: --video needs PyAV, which is not installed; pip install 'retarget[video]'\n"


def test_a_film_shows_the_whole_clip_in_real_time(run: Run, wave: Path, tmp_path: Path) -> None:
    av = pytest.importorskip("av", reason="the extra [video] is not installed")
    result = run("validate", wave, "--video", "{stem}.mp4", "-q")
    if "no picture can be drawn" in result.stderr:
        pytest.skip(result.stderr)
    assert result.exit_code == 0
    with av.open(str(tmp_path / "wave.mp4")) as film:
        frames = [frame.to_ndarray(format="rgb24") for frame in film.decode(video=0)]
    assert len(frames) == 16  # 0.5 s at 30 Hz, both ends
    assert all(frame.std() > 10 for frame in frames)
    assert np.abs(frames[-1].astype(int) - frames[0]).max() > 50  # the arms moved
