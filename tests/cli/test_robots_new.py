"""`retarget robots new`: a file that can be read, checked and used as it is."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path

from click.testing import Result
from retarget import robots
from retarget.core.robot_urdf import find_urdf

Run = Callable[..., Result]
G1 = find_urdf(robots.load("g1"))


def test_the_profile_is_checked_and_converts(run: Run, walk: Path, tmp_path: Path) -> None:
    result = run("robots", "new", G1, "-o", "mine.toml")
    assert (result.exit_code, result.stdout) == (0, "mine: 32 checks, 0 failed\n")
    assert "14 links guessed" in result.stderr
    assert "retarget robots check ./mine.toml" in result.stderr
    assert robots.load(str(tmp_path / "mine.toml")).links == robots.load("g1").links
    text = (tmp_path / "mine.toml").read_text(encoding="utf-8")
    assert set(tomllib.loads(text)) == {"name", "description", "model", "links", "reference_posture_rad"}
    assert text.count("guess") >= 4
    assert 'LeftUpperArm = "left_shoulder_yaw_link"   # behind joint "left_shoulder_yaw_joint"' in text
    assert run("convert", walk, "--robot", "./mine.toml", "-q").exit_code == 0


def test_the_template_in_it_is_right_when_uncommented(run: Run, tmp_path: Path) -> None:
    run("robots", "new", G1, "-o", "mine.toml", "-q")
    path = tmp_path / "mine.toml"
    text = path.read_text(encoding="utf-8")
    for begin in ("[feet.Left]", "link = ", "sole_m = ", "[hands.Left]", "fingers = ", "palm = "):
        text = text.replace(f"# {begin}", begin)
    path.write_text(text, encoding="utf-8")
    profile = robots.load(str(path))
    assert (profile.feet["Left"].link, profile.hands["Left"].link) == ("left_ankle_roll_link", "left_wrist_yaw_link")


def test_nothing_is_replaced_without_force(run: Run, tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text("mine")
    result = run("robots", "new", G1, "-o", "mine.toml")
    assert (result.exit_code, result.stderr) == (2, "retarget: mine.toml exists; --force replaces it\n")
    assert (tmp_path / "mine.toml").read_text() == "mine"
    assert run("robots", "new", G1, "-o", "mine.toml", "--force", "-q").exit_code == 0


def test_what_can_not_be_read_is_one_line(run: Run, tmp_path: Path) -> None:
    (tmp_path / "bad.urdf").write_text("<robot")
    for words in (("bad.urdf",), ("none.urdf",), (G1, "-o", "mine.json"), (G1, "-o", "no/folder/mine.toml")):
        result = run("robots", "new", *words)
        assert result.exit_code == 2, words
        assert result.stderr.startswith("retarget: ")
        assert result.stderr.count("\n") == 1
    assert not list(tmp_path.glob("*.toml"))
