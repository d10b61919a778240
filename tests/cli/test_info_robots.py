"""`retarget info`, `retarget robots` and shell completion."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result
from retarget import robots
from retarget.core import pipeline

Run = Callable[..., Result]
RunProgram = Callable[..., "subprocess.CompletedProcess[bytes]"]


def test_info_of_a_recording(run: Run, walk: Path) -> None:
    facts = json.loads(run("info", walk, "--json").stdout)
    expected = {
        "input": str(walk),
        "format": "mvnx",
        "version": "4",
        "frames": 30,
        "rate_hz": 60.0,
        "unmeasured_segments": [],
    }
    assert {key: facts[key] for key in expected} == expected
    assert facts["duration_s"] == pytest.approx(29 / 60)
    assert len(facts["segments"]) == 23
    assert {"gaps", "warnings"} <= set(facts)
    text = run("info", walk).stdout
    assert text.startswith(f"{walk}\n  format")
    assert "23: Pelvis L5 L3" in text


def test_info_of_a_trajectory_and_of_stdin(run: Run, walk: Path) -> None:
    run("convert", walk, "--robot", "g1", "-q")
    facts = json.loads(run("info", "walk_g1.mcap", "--json").stdout)
    assert (facts["format"], facts["robot"], facts["frames"], len(facts["joints"])) == ("mcap", "g1", 30, 29)
    piped = json.loads(run("info", "-", "--json", stdin=Path("walk_g1.mcap").read_bytes()).stdout)
    assert piped == {**facts, "input": "-"}


def test_info_goes_on_after_a_file_it_can_t_read(run: Run, walk: Path, tmp_path: Path) -> None:
    (tmp_path / "bad.mvnx").write_text("<mvnx")
    result = run("info", "bad.mvnx", walk, "--json")
    assert result.exit_code == 1
    assert [json.loads(line)["input"] for line in result.stdout.splitlines()] == [str(walk)]
    assert result.stderr.startswith("retarget: bad.mvnx")
    assert result.stderr.count("\n") == 1


def test_robots_list(run: Run) -> None:
    rows = [json.loads(line) for line in run("robots", "list", "--json").stdout.splitlines()]
    assert [row["name"] for row in rows] == robots.names()
    assert {row["name"]: row["dof"] for row in rows}.items() >= {"icub": 32, "g1": 29}.items()
    lines = run("robots", "list").stdout.splitlines()
    assert [line.split()[0] for line in lines] == ["robot", *robots.names()]


def test_robots_show(run: Run) -> None:
    facts = json.loads(run("robots", "show", "g1", "--json").stdout)
    assert facts["links"] == dict(robots.load("g1").links)
    assert len(facts["joints"]) == facts["dof"] == 29
    knee = next(joint for joint in facts["joints"] if joint["name"] == "left_knee_joint")
    assert knee["lower_rad"] < 0 < knee["upper_rad"]
    assert "left_knee_joint" in run("robots", "show", "g1").stdout
    assert run("robots", "show", "g2").stderr == "retarget: unknown robot 'g2'; did you mean g1?\n"


def test_robots_check(run: Run) -> None:
    result = run("robots", "check", "g1", "--json")
    report = json.loads(result.stdout)
    assert (report["robot"], report["passed"], result.exit_code) == ("g1", True, 0)
    assert report["checks"]
    assert set(report["checks"][0]) >= {"name", "value", "unit", "limit", "passed"}
    assert run("robots", "check").exit_code == 2
    assert run("robots", "check", "g1", "--all").exit_code == 2


def test_a_failed_check_exits_3_and_is_shown(run: Run, tmp_path: Path) -> None:
    """A G1 whose elbows are kept bent can't reach the T-pose, and does not say so."""
    limits = "".join(f"{side}_elbow_joint = {{ lower_rad = 1.2, upper_rad = 1.5 }}\n" for side in ("left", "right"))
    (tmp_path / "bent.toml").write_text(f'extends = "g1"\nname = "bent"\n[limits.joints]\n{limits}')
    result = run("robots", "check", "./bent.toml", "--json")
    report = json.loads(result.stdout)
    assert (report["passed"], result.exit_code) == (False, 3)
    text = run("robots", "check", "./bent.toml", "g1").stdout
    assert "FAILED" in text
    assert text.count("checks, 0 failed") == 1


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("retarget con", {"convert"}),
        ("retarget convert --robot ic", {"icub"}),
        ("retarget convert --mapping l", {n for n in pipeline.mapping_names() if n.startswith("l")}),
        ("retarget convert --format ", {"csv", "hdf5", "mcap", "npz"}),
        ("retarget convert --csv-style u", {"unitree"}),
        ("retarget robots show g", {"g1"}),
        ("retarget robots ch", {"check"}),
    ],
)
def test_completion_offers_names(program: RunProgram, words: str, expected: set[str]) -> None:
    env = {"_RETARGET_COMPLETE": "bash_complete", "COMP_WORDS": words, "COMP_CWORD": str(len(words.split(" ")) - 1)}
    done = program(env=env)
    assert done.stderr == b""
    assert {line.split(",")[1] for line in done.stdout.decode().splitlines()} >= expected
    assert all(line.split(",")[1].startswith(words.split(" ")[-1]) for line in done.stdout.decode().splitlines())


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_scripts(run: Run, shell: str) -> None:
    script = run("completion", shell).stdout
    assert f"_RETARGET_COMPLETE={shell}_complete" in script


def test_the_bash_script_is_accepted_by_bash(run: Run) -> None:
    script = run("completion", "bash").stdout
    done = subprocess.run(
        ["bash", "-c", script + "\ncomplete -p retarget"], capture_output=True, text=True, env=os.environ
    )
    assert done.returncode == 0, done.stderr
    assert "retarget" in done.stdout
