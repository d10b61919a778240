"""`retarget calibrate`: from tracker logs and a suit, to a file, to stdout and to a picture; and what it refuses."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from click.testing import Result
from retarget import samples
from retarget.core import calibration
from retarget.core.types import TrackerRecording

from tests.core.calibrate.operators import ROLES, SERIAL, Operator, windows

Run = Callable[..., Result]

HELD = [f"--{pose}={start:.2f}:{end:.2f}" for pose, (start, end) in windows().items()]
NOISE_M = 1e-8
"""Enough for no two rows to be alike, which the reader would warn of."""
ROLE_OPTIONS = [f"--roles={SERIAL[name]}={name}" for name in ROLES]


def write_log(path: Path, recording: TrackerRecording) -> Path:
    """A wide CSV: time, then position and quaternion of each tracker, named by its serial; Z up."""
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        axes = ("x", "y", "z", "qw", "qx", "qy", "qz")
        writer.writerow(["time_s", *(f"{tracker}_{axis}" for tracker in recording.trackers for axis in axes)])
        values = np.concatenate([recording.position, recording.orientation], axis=-1).reshape(recording.frames, -1)
        for time, row in zip(recording.time, values, strict=True):
            writer.writerow([f"{time:.9f}", *(f"{value:.12f}" for value in row)])
    return path


@pytest.fixture(scope="module")
def person() -> Operator:
    return Operator.random(4)


@pytest.fixture
def log(tmp_path: Path, person: Operator) -> Path:
    return write_log(tmp_path / "poses.csv", person.record(rate_hz=60, noise_m=NOISE_M))


def offset_of(person: Operator) -> str:
    return "--hand-offset=" + ",".join(f"{value:.12f}" for value in person.offset)


def test_a_tracker_log_with_roles_and_windows(run: Run, log: Path, person: Operator) -> None:
    result = run("calibrate", log, "--up", "z", *ROLE_OPTIONS, *HELD, offset_of(person), "-o", "me.json")
    assert result.exit_code == 0, result.stderr
    assert result.stdout == ""
    assert result.stderr.startswith("Still pose 0.10:1.40, T-pose 2.60:3.90, Forward pose 5.10:6.40 s; left arm ")
    found = calibration.load("me.json")
    assert dict(found.trackers) == {name: SERIAL[name] for name in ROLES}
    for side in ("Left", "Right"):
        assert found.arms[side].length_m == pytest.approx(person.arm_length, abs=1e-6)
    assert np.cos(found.heading_rad - person.heading) == pytest.approx(1, abs=1e-9)


def test_nothing_told_but_the_axis(run: Run, log: Path, person: Operator) -> None:
    """Poses and trackers are found; the JSON on stdout is the file's."""
    result = run("calibrate", log, "--up", "z", offset_of(person), "--json")
    assert result.exit_code == 0, result.stderr
    record = json.loads(result.stdout)
    assert record == json.loads(Path("operator.json").read_text())
    assert record["trackers"] == {name: SERIAL[name] for name in ROLES}
    assert f"  Head: {SERIAL['Head']}, by " in result.stderr
    assert (
        run("calibrate", log, "--up", "z", offset_of(person), "-o", "-", "-q").stdout
        == Path("operator.json").read_text()
    )


def test_three_files_and_a_table_of_roles(run: Run, tmp_path: Path, person: Operator) -> None:
    files = [
        write_log(tmp_path / f"{pose}.csv", person.record((pose,), hold_s=2.0, rate_hz=30, noise_m=NOISE_M))
        for pose in ("still", "tpose", "forward")
    ]
    table = tmp_path / "roles.txt"
    table.write_text("# who wears what\n" + "\n".join(f"{SERIAL[name]} = {name}  # strap" for name in ROLES) + "\n\n")
    common = ("--up", "z", "--roles-file", table, offset_of(person), "-o", "-")
    result = run("calibrate", *files, *common)
    assert result.exit_code == 0, result.stderr
    assert json.loads(result.stdout)["arms"]["Left"]["length_m"] == pytest.approx(person.arm_length, abs=1e-6)
    swapped = run("calibrate", files[0], files[2], files[1], *common)
    assert swapped.exit_code == 1
    assert "what is given as T-pose looks like the Forward pose" in swapped.stderr
    assert swapped.stderr.count("\n") == 1
    table.write_text("LHR-1\n")
    assert "roles.txt, line 1: found 'LHR-1'; expected SERIAL=SEGMENT" in run("calibrate", *files, *common).stderr


def test_a_suit_and_its_picture(run: Run) -> None:
    sample = samples.sample_path("reach")
    held = ("--still=0:0.8", "--tpose=2:2.5", "--forward=3.55:3.7")
    result = run("calibrate", sample, *held, "--picture", "me.svg", "-v")
    assert result.exit_code == 0, result.stderr
    assert "shoulder_from_segment_m/Left: 0.012" in result.stderr
    assert calibration.load("operator.json").hand_offset_m["Left"].tolist() == [0, 0, 0]
    drawing = ElementTree.parse("me.svg").getroot()
    assert drawing.tag.endswith("svg")
    again = run("calibrate", sample, *held, "--picture", "me.png", "--force", "-q")
    assert again.exit_code == 0
    assert again.stderr == ""
    assert Path("me.png").read_bytes().startswith(b"\x89PNG")
    assert sorted(path.name for path in Path().iterdir()) == ["me.png", "me.svg", "operator.json"]


def test_outputs_are_never_lost(run: Run, log: Path) -> None:
    Path("operator.json").write_text("mine")
    common = ("calibrate", log, "--up", "z")
    for arguments, message in [
        ((), "operator.json: exists; --force replaces it"),
        (("-o", log, "--force"), "would replace the input"),
        (("-o", "a.json", "--picture", "a.jpg"), "--picture a.jpg: expected a file name ending in .png or .svg"),
        (("-o", "a.svg", "--picture", "a.svg"), "a.svg: would replace the output a.svg"),
        (("-o", "nowhere/a.json"), "nowhere: no such folder"),
        (("-o", "-", "--json"), "-o - and --json both want stdout"),
    ]:
        result = run(*common, *arguments)
        assert (result.exit_code, message in result.stderr) == (2, True), result.stderr
    assert Path("operator.json").read_text() == "mine"
    # A calibration that fails leaves neither file.
    failed = run(*common, *HELD[:2], "--forward=2.6:3.9", *ROLE_OPTIONS, "-o", "b.json", "--picture", "b.png")
    assert failed.exit_code == 1
    assert failed.stderr.startswith(f"retarget: {log}: ")
    assert not Path("b.json").exists()
    assert not Path("b.png").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--still", "3:2"), "found '3:2', expected START:END in seconds"),
        (("--still", "nan:2"), "found 'nan:2', expected START:END"),
        (("--tpose", "2"), "found '2', expected START:END"),
        (("--hand-offset", "1,2"), "found '1,2', expected three numbers X,Y,Z"),
        (("--hand-offset", "1,2,inf"), "expected three numbers"),
        (("--roles", "LHR-1"), "found 'LHR-1', expected SERIAL=SEGMENT"),
        (("--roles", "LHR-1=T8", "--roles", "LHR-1=Head"), "tracker 'LHR-1' is given as T8 and as Head"),
        (("--roles-file", "none.txt"), "--roles-file none.txt: no such file"),
    ],
)
def test_usage_errors(run: Run, log: Path, arguments: tuple[str, ...], message: str) -> None:
    result = run("calibrate", log, "--up", "z", *arguments)
    assert result.exit_code == 2
    assert message in result.stderr
    assert result.stderr.count("\n") == 1


def test_what_the_reader_found_comes_first(run: Run, log: Path, person: Operator) -> None:
    """An axis that can't be right explains why no pose is found."""
    result = run("calibrate", log, "--up", "y", *ROLE_OPTIONS, *HELD, offset_of(person))
    assert result.exit_code == 1
    lines = result.stderr.splitlines()
    assert any("up = y is unlikely" in line for line in lines[:-1])
    assert lines[-1].startswith(f"retarget: {log}: ")


def test_the_number_of_inputs(run: Run, log: Path) -> None:
    result = run("calibrate", log, log)
    assert result.exit_code == 2
    assert "found 2 inputs; expected one recording of all three poses, or three" in result.stderr


def test_a_trajectory_is_no_recording(run: Run, walk: Path) -> None:
    run("convert", walk, "--robot", "g1", "-q")
    result = run("calibrate", "walk_g1.mcap")
    assert result.exit_code == 2
    assert "holds robot trajectories, not a person's motion; expected one of" in result.stderr
