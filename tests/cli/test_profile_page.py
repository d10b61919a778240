"""The walk-through of docs/profiles.md, walked: its profile grows as on the page, and every quoted line is one that is printed."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from click.testing import Result
from retarget.cli.profile_page import WALK_THROUGH

Run = Callable[..., Result]
PARTS = re.findall(r"```toml\n(.*?)```", WALK_THROUGH, re.DOTALL)
QUOTED = re.findall(r"```text\n(.*?)```", WALK_THROUGH, re.DOTALL)


def words(line: str) -> str:
    """The line's words: numbers may differ in their last digits from machine to machine."""
    return re.sub(r"[\d.]+", "#", line.strip())


def check(run: Run, folder: Path, parts: int) -> Result:
    (folder / "romeo.toml").write_text("\n".join(PARTS[:parts]), encoding="utf-8")
    return run("robots", "check", "./romeo.toml")


def test_the_walk_through(run: Run, tmp_path: Path) -> None:
    assert len(PARTS) == 5
    for parts, quoted in ((1, QUOTED[0]), (3, QUOTED[1])):
        result = check(run, tmp_path, parts)
        assert result.exit_code == 3
        printed = [words(line) for line in result.stdout.splitlines()]
        first, *others = quoted.splitlines()
        assert first in result.stdout  # how many checks, how many failed
        for line in others:
            begin = words(line.removesuffix("…"))
            assert any(p.startswith(begin) for p in printed), line
    assert check(run, tmp_path, 4).exit_code == 0
    final = check(run, tmp_path, 5)
    assert (final.exit_code, final.stdout) == (0, "romeo: 38 checks, 0 failed\n")


def test_the_profile_of_the_walk_through_converts(run: Run, walk: Path, tmp_path: Path) -> None:
    (tmp_path / "romeo.toml").write_text("\n".join(PARTS), encoding="utf-8")
    assert run("convert", walk, "--robot", "./romeo.toml", "-q").exit_code == 0
    assert (tmp_path / "walk_romeo.mcap").is_file()
