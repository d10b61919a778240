"""Bad input and bad requests: each is one clear line and the right exit code, and nothing is written."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result

Run = Callable[..., Result]

ENTITIES = (
    '<!DOCTYPE mvnx [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;"><!ENTITY c "&b;&b;&b;&b;&b;&b;">]>'
)


def with_orientations(text: str, pattern: str, replacement: str, count: int) -> str:
    """The recording with the first `count` orientations from the eleventh frame on changed: `pattern` by `replacement`."""
    frame = [found.start() for found in re.finditer('<frame [^>]*type="normal"', text)][10]
    return text[:frame] + re.sub(f"<orientation>{pattern}", f"<orientation>{replacement}", text[frame:], count=count)


def with_missing_orientations(text: str, count: int) -> str:
    """The recording without the pelvis' orientation in `count` frames."""
    return with_orientations(text, r"\S+ \S+ \S+ \S+", "nan nan nan nan", count)


BROKEN: dict[str, tuple[Callable[[str], str], str]] = {
    "empty": (lambda _: "", "empty file"),
    "truncated": (lambda text: text[: len(text) * 2 // 3], ", line 258: the document ends early, after 18 whole frames"),
    "wrong root": (lambda text: text.replace("<mvnx", "<bvh").replace("</mvnx", "</bvh"), ", line 3: root element <bvh>; expected <mvnx>"),
    "v2": (lambda text: text.replace('version="4"', 'version="2"'), ", line 3: MVNX of version 2 (Moven); expected version 3 or 4"),
    "zero frames": (lambda text: text[: text.index('<frame time="2000"')] + "</frames></subject></mvnx>", "no frame of type 'normal'"),
    "wrong quaternion count": (lambda text: with_orientations(text, r"\S+ ", "", 1), ", frame 130: 91 values in <orientation>; expected 92 values"),
    "too long without values": (lambda text: with_missing_orientations(text, 20), "<orientation> of Pelvis: values missing for 0.333 s from 2.150 s on"),
    "entity expansion": (lambda text: text.replace("<mvnx", f"{ENTITIES}<mvnx", 1).replace('label="synthetic', 'label="&c;synthetic'), ", line 3: entity 'a'; expected no entities"),
    "not XML": (lambda _: "time,x,y\n0,1,2\n", ", line 1: not XML"),
}  # fmt: skip


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_recording_fails_alone(run: Run, walk: Path, short_walk: str, case: str) -> None:
    change, expected = BROKEN[case]
    broken = walk.with_name("broken.mvnx")
    broken.write_text(change(short_walk))
    assert broken.read_text() != short_walk
    result = run("convert", broken, walk, "--robot", "g1", "--json")
    assert result.exit_code == 1
    first, second = (json.loads(line) for line in result.stdout.splitlines())
    assert (first["status"], second["status"]) == ("failed", "ok")
    message, _ = result.stderr.splitlines()
    assert message.startswith(f"retarget: [1/2] {broken}")
    assert expected in message.replace(str(broken), "")
    assert "internal error" not in message
    assert sorted(path.name for path in walk.parent.iterdir()) == ["broken.mvnx", "walk.mvnx", "walk_g1.mcap"]


def test_a_short_gap_is_filled_and_told(run: Run, walk: Path, short_walk: str) -> None:
    walk.write_text(with_missing_orientations(short_walk, 3))
    result = run("convert", walk, "--robot", "g1", "--json")
    assert result.exit_code == 0
    assert re.search(r"warning: .*3 frames", result.stderr)
    assert any("3 frames" in warning for warning in json.loads(result.stdout)["warnings"])


def test_a_cut_that_leaves_nothing(run: Run, walk: Path) -> None:
    result = run("convert", walk, "--robot", "g1", "--start", "100")
    assert result.exit_code == 1
    assert result.stderr == f"retarget: {walk}: no frame from 100 s; the recording runs from 2 s to 2.48333 s\n"


REFUSED: dict[str, tuple[list[str], str]] = {
    "missing file": (["wolk.mvnx", "--robot", "g1"], "wolk.mvnx: no such file; did you mean walk.mvnx"),
    "missing among others": (["walk.mvnx", "nothing", "--robot", "g1"], "nothing: no such file"),
    "folder": (["sub", "--robot", "g1"], "sub: is a folder; -r converts all recordings below it"),
    "folder without recordings": (["sub", "-r", "--robot", "g1"], "sub: no recordings below this folder; looked for .mcap, .mvnx.gz, .mvnx, .bag, .db3"),
    "no input": (["--robot", "g1"], "no input; give recordings, or --files-from"),
    "unknown robot": (["walk.mvnx", "--robot", "icup"], "unknown robot 'icup'; did you mean icub?"),
    "missing profile": (["walk.mvnx", "--robot", "./no.toml"], "no.toml: no such profile file"),
    "unknown key": (["walk.mvnx", "--robot", "bad.toml"], "unknown key 'link'; did you mean 'links'?"),
    "not TOML": (["walk.mvnx", "--robot", "broken.toml"], "broken.toml: not TOML"),
    "unknown link": (["walk.mvnx", "--robot", "nolink.toml"], "no link 'pelvi'"),
    "unknown mapping": (["walk.mvnx", "--robot", "g1", "--mapping", "limbplane"], "did you mean limb_plane"),
    "unknown format": (["walk.mvnx", "--robot", "g1", "--format", "mcp"], "unknown format 'mcp'; did you mean mcap"),
    "unknown suffix": (["walk.mvnx", "--robot", "g1", "-o", "walk.bag"], "walk.bag: no format has this suffix"),
    "unknown style": (["walk.mvnx", "--robot", "g1", "-o", "w.csv", "--csv-style", "unitre"], "did you mean unitree?"),
    "style without CSV": (["walk.mvnx", "--robot", "g1", "--csv-style", "unitree"], "--csv-style is for CSV; the output is mcap"),
    "unknown base": (["walk.mvnx", "--robot", "g1", "--base", "foot"], "'foot' is not one of 'auto', 'fixed', 'human', 'contact'"),
    "unknown placeholder": (["walk.mvnx", "--robot", "g1", "-o", "{name}.mcap"], "unknown placeholder 'name'"),
    "output exists": (["walk.mvnx", "--robot", "g1", "-o", "old.mcap"], "old.mcap: exists; --force replaces it"),
    "report exists": (["walk.mvnx", "--robot", "g1", "--report", "old.html"], "old.html: exists; --force replaces it"),
    "output is a folder": (["walk.mvnx", "--robot", "g1", "-o", "{stem}_d.mcap"], "walk_d.mcap: is a folder"),
    "empty output": (["walk.mvnx", "--robot", "g1", "-o", ""], "--output: found nothing; expected TEMPLATE|-"),
    "empty option": (["walk.mvnx", "--robot", "g1", "--calibration", ""], "--calibration: found nothing; expected FILE.json"),
    "one empty option of several": (["walk.mvnx", "--robot", "g1", "--msg-def", "a.msg", "--msg-def", ""], "--msg-def: found nothing; expected PATH"),
    "missing output folder": (["walk.mvnx", "--robot", "g1", "-o", "no/walk.mcap"], "no: no such folder; make it first"),
    "below a file": (["walk.mvnx", "--robot", "g1", "-o", "old.mcap/walk.mcap"], "old.mcap: not a folder"),
    "unwritable folder": (["walk.mvnx", "--robot", "g1", "-o", "/proc/walk.mcap"], "/proc: can't write into this folder"),
    "one output for two": (["walk.mvnx", "b/walk.mvnx", "--robot", "g1"], "walk_g1.mcap: one output for walk.mvnx and b/walk.mvnx"),
    "given twice": (["walk.mvnx", "./walk.mvnx", "--robot", "g1"], "walk_g1.mcap: one output for walk.mvnx"),
    "one for two robots": (["walk.mvnx", "--robot", "g1", "--robot", "icub", "-o", "w.mcap"], "robots g1 and icub; put {robot} into"),
    "onto the input": (["walk.mvnx", "--robot", "g1", "-o", "walk.mvnx", "--format", "csv", "--force"], "would replace the input"),
    "end before start": (["walk.mvnx", "--robot", "g1", "--start", "2", "--end", "1"], "--end 1 is not after --start 2"),
    "force and skip": (["walk.mvnx", "--robot", "g1", "--force", "--skip-existing"], "contradict each other"),
    "two to stdout": (["walk.mvnx", "b/walk.mvnx", "--robot", "g1", "-o", "-"], "-o - takes one recording and one robot; found 2"),
    "stdout twice": (["walk.mvnx", "--robot", "g1", "-o", "-", "--json"], "-o - and --json both want stdout"),
    "stdin twice": (["-", "--files-from", "-", "--robot", "g1"], "no file"),
    "no pipe for HDF5": (["walk.mvnx", "--robot", "g1", "-o", "-", "--format", "hdf5"], "hdf5 can't be written to a pipe"),
    "separator alone": (["walk.mvnx", "--robot", "g1", "-0"], "give --files-from too"),
    "empty list": (["--files-from", "empty", "--robot", "g1"], "--files-from empty: lists no file"),
    "output name too long": (["walk.mvnx", "--robot", "g1", "-o", f"{'x' * 400}.mcap"], "File name too long"),
    "report name too long": (["walk.mvnx", "--robot", "g1", "--report", f"{'x' * 400}.html"], "File name too long"),
    "shard of too many digits": (["walk.mvnx", "--robot", "g1", "--shard", f"1/{'9' * 5000}"], "expected I/N with 1 ≤ I ≤ N"),
    "missing list": (["--files-from", "nolist", "--robot", "g1"], "nolist: no such file"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_a_bad_request_is_refused_before_anything_is_written(run: Run, walk: Path, tmp_path: Path, case: str) -> None:
    arguments, expected = REFUSED[case]
    for name in ("b/walk.mvnx", "sub/keep.txt", "walk_d.mcap/keep"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(walk, tmp_path / name)
    (tmp_path / "old.mcap").write_bytes(b"old")
    (tmp_path / "old.html").write_bytes(b"old")
    (tmp_path / "empty").touch()
    (tmp_path / "bad.toml").write_text('extends = "g1"\nlink = 1\n')
    (tmp_path / "broken.toml").write_text("links = [\n")
    (tmp_path / "nolink.toml").write_text('extends = "g1"\n[links]\nPelvis = "pelvi"\n')
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    result = run("convert", *arguments)
    assert result.exit_code == 2
    assert result.stdout == ""
    assert result.stderr.startswith("retarget: ")
    assert result.stderr.count("\n") == 1
    assert expected in result.stderr
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


def test_options_that_no_clip_can_follow_are_usage_errors(run: Run, walk: Path) -> None:
    result = run("convert", walk, "--robot", "baxter", "--base", "contact")
    assert result.exit_code == 2
    assert "stands on a fixed base" in result.stderr
