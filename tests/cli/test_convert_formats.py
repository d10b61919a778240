"""`retarget convert` into folders, styles, and with the person; `info` and `validate` on what came out."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from retarget import formats
from rosbags.highlevel import AnyReader

Run = Callable[..., Result]


def test_a_bag_is_made_replaced_skipped_and_described(run: Run, walk: Path, tmp_path: Path) -> None:
    arguments = ("convert", walk, "--robot", "g1", "--format", "rosbag2", "-o", "bag")
    assert run(*arguments).exit_code == 0
    assert run("convert", walk, "--robot", "g1", "-o", "walk.mcap").exit_code == 0
    bag, file = formats.read_trajectory("bag"), formats.read_trajectory("walk.mcap")
    np.testing.assert_array_equal(bag.position, file.position)
    result = run(*arguments)
    assert result.exit_code == 2
    assert "bag: exists; --force replaces it, --skip-existing leaves it" in result.stderr
    assert "bag: exists, skipped" in run(*arguments, "--skip-existing").stderr
    assert run(*arguments, "--force", "--human").exit_code == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bag", "walk.mcap", "walk.mvnx"]
    record = json.loads(run("info", "bag", "--json").stdout)
    assert (record["format"], record["frames"]) == ("rosbag2", 30)


@pytest.mark.parametrize("name", ["rosbag2", "lerobot"])
@pytest.mark.parametrize("human", [True, False])
def test_folders_of_trajectories_are_no_persons(run: Run, walk: Path, tmp_path: Path, name: str, human: bool) -> None:
    """The base of G1 is called as a segment is, and with --human there are frames of all."""
    if name == "lerobot":
        pytest.importorskip("pyarrow", reason="the extra lerobot is not installed")
    person = ["--human"] if human else []
    assert run("convert", walk, "--robot", "g1", "--format", name, "-o", "out", *person).exit_code == 0
    described = json.loads(run("info", "out", "--json").stdout)
    seen = json.loads(run("inspect", "out", "--no-report", "--json").stdout)
    assert (described["kind"], described["robot"], seen["checked_against"]) == ("trajectory", "g1", "g1")
    assert [row["option"] for row in seen["suggestions"]] == ["retarget validate out"]
    assert run("convert", "out", "--robot", "g1").exit_code == 2
    planned = run("convert", "-r", tmp_path, "--robot", "g1", "-o", "{stem}.mcap", "--dry-run").stdout
    assert planned == f"{walk} → walk.mcap\n"


def test_folders_that_hold_nothing(run: Run, walk: Path, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    for command in (["info"], ["inspect"], ["calibrate"]):
        result = run(*command, "empty")
        assert (result.exit_code, "empty: is a folder; expected files" in result.stderr) == (2, True)
        assert "-r" not in result.stderr
    listed = run("convert", walk, "--robot", "g1", "--files-from", "empty")
    assert (listed.exit_code, "--files-from empty: is a folder" in listed.stderr) == (2, True)


@pytest.mark.parametrize("command", [["info"], ["inspect"], ["validate"], ["convert", "--robot", "g1"]])
def test_names_longer_than_any_file_has(run: Run, command: list[str]) -> None:
    result = run(*command, "x" * 400)
    assert (result.exit_code, "file name too long" in result.stderr) == (2, True)


def test_the_default_name_of_a_folder_and_others_folders_are_safe(run: Run, walk: Path, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "precious").mkdir()
    (tmp_path / "precious" / "data").touch()
    assert run("convert", walk, "--robot", "g1", "--format", "rosbag2", "-o", "out").exit_code == 0
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["walk_g1"]
    result = run("convert", walk, "--robot", "g1", "--format", "rosbag2", "-o", "{stem}", "--dry-run")
    assert result.exit_code == 0
    (tmp_path / "walk").mkdir()
    (tmp_path / "walk" / "data").touch()
    result = run("convert", walk, "--robot", "g1", "--format", "rosbag2", "-o", "{stem}", "--force")
    assert result.exit_code == 2
    assert "walk: is a folder that is no rosbag2 written here, so it is never replaced" in result.stderr


@pytest.mark.parametrize("human", [True, False])
def test_person_and_robot_in_one_mcap(run: Run, walk: Path, tmp_path: Path, human: bool) -> None:
    arguments = ("--human",) if human else ()
    assert run("convert", walk, "--robot", "g1", "-o", "walk.mcap", *arguments).exit_code == 0
    motion = formats.read_motion(walk)
    with AnyReader([tmp_path / "walk.mcap"]) as reader:
        connections = [c for c in reader.connections if c.topic == "/tf"]
        first = next(reader.deserialize(raw, c.msgtype) for c, _, raw in reader.messages(connections))
    frames = {item.child_frame_id: item.transform.translation for item in first.transforms}
    assert set(frames) == {"pelvis"} | ({f"human/{segment}" for segment in motion.segments} if human else set())
    if human:
        hand = frames["human/LeftHand"]
        np.testing.assert_array_equal([hand.x, hand.y, hand.z], motion.position[0, motion.index("LeftHand")])


def test_styles(run: Run, walk: Path) -> None:
    assert run("convert", walk, "--robot", "g1", "-o", "walk.npz", "--style", "gmr").exit_code == 0
    with np.load("walk.npz") as archive:
        assert {"fps", "root_pos", "root_rot", "dof_pos"} <= set(archive.files)
    assert run("convert", walk, "--robot", "g1", "-o", "walk.csv", "--style", "unitree").exit_code == 0
    result = run("convert", walk, "--robot", "g1", "-o", "x.mcap", "--style", "joint_trajectry")
    assert result.exit_code == 2
    assert "--style: unknown mcap style 'joint_trajectry'; did you mean joint_trajectory" in result.stderr
    result = run("convert", walk, "--robot", "g1", "-o", "x.csv", "--style", "unitree", "--csv-style", "header")
    assert "--style unitree and --csv-style header contradict each other" in result.stderr


def test_folders_of_bags_are_searched_without_looking_inside(run: Run, walk: Path, tmp_path: Path) -> None:
    (tmp_path / "bags").mkdir()
    result = run("convert", walk, "--robot", "g1", "--format", "rosbag2", "-o", "bags/{stem}_bag")
    assert result.exit_code == 0
    result = run("validate", "-r", "bags", "--mode", "kinematic", "--json")
    (line,) = result.stdout.splitlines()
    assert json.loads(line)["input"] == "bags/walk_bag"


@pytest.mark.parametrize(
    "name", ["...mvnx", "..mvnx", "-o.mvnx", "a{robot}.mvnx", "x\ny.mvnx", "é ü.mvnx", "$(touch z).mvnx"]
)
def test_hostile_names_stay_in_their_folder(run: Run, walk: Path, tmp_path: Path, name: str) -> None:
    """Whatever a recording is called: its output stands where the template says, or nothing is done."""
    (tmp_path / "in").mkdir()
    (tmp_path / "out").mkdir()
    walk.rename(tmp_path / "in" / name)
    before = set(tmp_path.rglob("*"))
    result = run("convert", "in/" + name, "--robot", "g1", "-o", "out/{stem}/walk.mcap")
    new = set(tmp_path.rglob("*")) - before
    if result.exit_code == 0:
        assert all((tmp_path / "out") in path.parents for path in new)
        assert len(result.stderr.splitlines()) == 1
    else:
        assert result.exit_code == 2
        assert "which is no file name" in result.stderr
        assert not new
