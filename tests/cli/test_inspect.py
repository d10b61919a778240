"""`retarget inspect`: the summary, the record, and the page."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from retarget import formats, robots, samples
from retarget.core import robot_model

Run = Callable[..., Result]


def record(run: Run, *arguments: object) -> dict[str, object]:
    result = run("inspect", *arguments, "--json", "--no-report")
    assert result.exit_code == 0, result.output
    return dict(json.loads(result.stdout))


def test_a_suit_recording(run: Run, walk: Path) -> None:
    found = record(run, walk)
    assert found["kind"] == "motion"
    assert found["contacts"]["source"] == "recorded"  # type: ignore[index]
    assert 1.6 < found["person"]["stature_m"] < 1.9  # type: ignore[index]
    assert found["timing"]["uneven_steps"] == 0  # type: ignore[index]
    assert found["gaps"] == []
    assert found["page"] is None
    rows = {row["robot"]: row["lacks"] for row in found["robots"]}  # type: ignore[attr-defined]
    assert set(rows) == set(robots.names()) - {"human"}
    assert not rows["g1"]
    options = [suggestion["option"] for suggestion in found["suggestions"]]  # type: ignore[attr-defined]
    assert any(option.startswith(f"retarget convert {walk} --robot") for option in options)


def test_summary_and_page(run: Run, walk: Path, tmp_path: Path) -> None:
    result = run("inspect", walk)
    assert result.exit_code == 0
    assert result.stdout.startswith(f"{walk}\n  format")
    assert "about 1." in result.stdout
    assert "walk_inspect.html" in result.stderr
    page = (tmp_path / "walk_inspect.html").read_text()
    for heading in ("Person", "Measured", "Feet on the ground", "Angular speed", "Robots"):
        assert f">{heading}</h" in page
    assert not re.search(r"<script|(src|href)=\"(?!data:)", page), "the page fetches something"


def test_a_page_is_not_replaced_without_force(run: Run, walk: Path, tmp_path: Path) -> None:
    page = tmp_path / "p.html"
    page.write_text("mine")
    refused = run("inspect", walk, "--report", page)
    assert refused.exit_code == 2
    assert "exists" in refused.stderr
    assert page.read_text() == "mine"
    assert run("inspect", walk, "--report", page, "--force").exit_code == 0
    assert page.read_text().startswith("<!DOCTYPE html>")


def test_usage(run: Run, walk: Path) -> None:
    assert run("inspect", walk, "--report", "x.pdf").exit_code == 2
    assert run("inspect", walk, "--report", "x.html", "--no-report").exit_code == 2
    other = walk.with_name("other.mvnx")
    other.write_bytes(walk.read_bytes())
    two = run("inspect", walk, other, "--report", "x.html")
    assert two.exit_code == 2
    assert "x.html" in two.stderr


def test_one_bad_file_among_good_ones(run: Run, walk: Path, tmp_path: Path) -> None:
    (tmp_path / "bad.mvnx").write_text("<mvnx>")
    result = run("inspect", tmp_path / "bad.mvnx", walk, "--no-report")
    assert result.exit_code == 1
    assert "bad.mvnx" in result.stderr
    assert str(walk) in result.stdout


def test_stdin(run: Run, short_walk: str) -> None:
    result = run("inspect", "-", "--json", "--no-report", stdin=short_walk)
    assert json.loads(result.stdout)["frames"] == 30


def test_a_gap_too_long_to_read_is_still_shown(run: Run, short_walk: str, tmp_path: Path) -> None:
    """A quarter of a second is interpolated; here a hand is missing for 0.3 s."""
    frames = re.findall(r"<frame .*?</frame>", short_walk, re.DOTALL)
    text = short_walk
    for frame in frames[5:24]:
        values = re.search(r"<orientation>(.*?)</orientation>", frame, re.DOTALL)
        assert values is not None
        numbers = values[1].split()
        numbers[40:44] = ["nan"] * 4
        text = text.replace(frame, frame.replace(values[1], " ".join(numbers)))
    (tmp_path / "gap.mvnx").write_text(text)
    found = record(run, tmp_path / "gap.mvnx")
    assert any("missing for" in doubt for doubt in found["doubts"])  # type: ignore[attr-defined]
    assert found["gaps"][0]["segments"] == ["RightHand"]  # type: ignore[index]
    assert run("inspect", tmp_path / "gap.mvnx").exit_code == 0


def test_calibration_recording_of_trackers(run: Run, tmp_path: Path) -> None:
    log = samples.sample_path("calibration_trackers")
    found = record(run, log)
    poses = found["calibration_poses"]
    assert set(poses) == {"still", "tpose", "forward"}  # type: ignore[call-overload]
    truth = json.loads(log.with_suffix(".json").read_text())
    assert set(found["tracked_fraction"].values()) == {1.0}  # type: ignore[attr-defined]
    assert found["frames"] == truth.get("frames", found["frames"])
    options = [suggestion["option"] for suggestion in found["suggestions"]]  # type: ignore[attr-defined]
    assert any(option.startswith("retarget calibrate") for option in options)
    assert "--up y" in options
    assert run("inspect", log, "--up", "y").exit_code == 0
    page = (tmp_path / "calibration_trackers_inspect.html").read_text()
    assert ">Where the trackers went</h3>" in page


def test_trackers_with_their_operator_are_shown_as_a_person(run: Run, tmp_path: Path) -> None:
    run("calibrate", samples.sample_path("calibration_trackers"), "--up", "y", "-o", "me.json")
    log = samples.sample_path("clap_trackers")
    found = record(run, log, "--up", "y", "--calibration", "me.json")
    assert "poses" in found
    assert run("inspect", log, "--up", "y", "--calibration", "me.json").exit_code == 0
    assert ">Person</h3>" in (tmp_path / "clap_trackers_inspect.html").read_text()


@pytest.mark.parametrize("suffix", [".mcap", ".h5", ".csv", ".npz"])
def test_a_trajectory_against_its_limits(run: Run, walk: Path, tmp_path: Path, suffix: str) -> None:
    run("convert", walk, "--robot", "g1", "-o", f"out{suffix}", "-q")
    found = record(run, tmp_path / f"out{suffix}")
    assert found["checked_against"] == "g1"  # CSV doesn't say so: by its joints
    model, trajectory = robot_model.build(robots.load("g1")), formats.read_trajectory(tmp_path / f"out{suffix}")
    assert [row["joint"] for row in found["joint_ranges"]] == list(model.joint_names)  # type: ignore[attr-defined]
    for row in found["joint_ranges"]:  # type: ignore[attr-defined]
        column = trajectory.joint_names.index(row["joint"])
        assert row["max"] == trajectory.position[:, column].max()
        assert row["upper"] == model.upper[model.joint_index(row["joint"])]
        assert row["frames_outside"] == 0
    assert found["doubts"] == found["warnings"]


def test_a_trajectory_beyond_its_limits(run: Run, walk: Path, tmp_path: Path) -> None:
    from dataclasses import replace

    run("convert", walk, "--robot", "g1", "-o", "out.csv", "-q")
    trajectory = formats.read_trajectory(tmp_path / "out.csv")
    position = np.array(trajectory.position)
    position[3:5, 0] = 9.0
    with (tmp_path / "wrong.csv").open("wb") as file:
        formats.write_trajectory_stream(file, replace(trajectory, position=position), "csv")
    found = record(run, tmp_path / "wrong.csv")
    assert [row["frames_outside"] for row in found["joint_ranges"] if row["frames_outside"]] == [2]  # type: ignore[attr-defined]
    assert any(str(doubt).startswith("beyond their limits: ") for doubt in found["doubts"])  # type: ignore[attr-defined]
    assert run("inspect", tmp_path / "wrong.csv").exit_code == 0
    assert 'class="bad">2</td>' in (tmp_path / "wrong_inspect.html").read_text()


def test_a_file_name_that_would_leave_the_folder(run: Run, walk: Path) -> None:
    hostile = walk.with_name("...mvnx")
    hostile.write_bytes(walk.read_bytes())
    result = run("inspect", hostile, "--report", "{stem}/page.html")
    assert result.exit_code == 2
    assert "{stem} would be '..', which is no file name" in result.stderr
