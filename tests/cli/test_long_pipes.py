"""Recordings of minutes through pipes: the memory of a block, what is cut off shows, and a file gives what a pipe gives."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from retarget import formats

from tests.long_recordings import write_long_walk, write_long_walk_mcap

RunProgram = Callable[..., "subprocess.CompletedProcess[bytes]"]
PROGRAM = str(Path(sys.executable).with_name("retarget"))
ALLOWED_MB = 64
RECORDINGS = ("walk45.mvnx", "walk60.mcap")
PEAK = """
import json, resource, subprocess, sys
done = subprocess.run(sys.argv[2:])
print(json.dumps(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024), file=open(sys.argv[1], "w"))
sys.exit(done.returncode)
"""
"""Runs a command and writes its peak of memory, MB, to a file."""


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the sample walk forth and back for half a minute and for more."""
    folder = tmp_path_factory.mktemp("long")
    for seconds in (29, 45, 120):
        write_long_walk(folder / f"walk{seconds}.mvnx", seconds)
    write_long_walk_mcap(folder / "walk60.mcap", 60, 20.0)
    return folder


def stages(folder: Path, recording: str, *validate: Sequence[str]) -> tuple[list[float], list[int], bytes]:
    """Peaks of memory of `convert -` and `validate -` in a pipe, exit codes of all stages, and what validate prints."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    peaks = [folder / f"{recording}.{stage}.peak" for stage in ("convert", "validate")]
    commands = [
        ["cat", f"{recording}.mvnx"],
        [sys.executable, "-c", PEAK, str(peaks[0]), PROGRAM, "convert", "-", "--robot", "g1", "-o", "-", "-q"],
        [sys.executable, "-c", PEAK, str(peaks[1]), PROGRAM, "validate", "-", "--json", "-q", *map(str, validate)],
    ]
    running: list[subprocess.Popen[bytes]] = []
    for command in commands:
        stdin = running[-1].stdout if running else subprocess.DEVNULL
        running.append(subprocess.Popen(command, stdin=stdin, stdout=subprocess.PIPE, cwd=folder, env=environment))
        if len(running) > 1:
            running[-2].stdout.close()  # type: ignore[union-attr]  # a pipe
    output, _ = running[-1].communicate(timeout=300)
    codes = [process.wait(60) for process in running]
    return [float(path.read_text()) for path in peaks], codes, output


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="ru_maxrss is in KB on Linux only")
def test_memory_does_not_grow_with_the_recording(recordings: Path) -> None:
    """Half a minute is converted as a whole, the longer one in blocks; MCAP keeps 5 KB of joints and poses of it a frame."""
    short, codes, _ = stages(recordings, "walk29", "--mode", "kinematic")
    assert codes == [0, 0, 0]
    long, codes, output = stages(recordings, "walk120", "--mode", "kinematic")
    assert codes == [0, 0, 0]
    record = json.loads(output)
    assert record["frames"] == 7200
    assert record["passed"]
    assert np.subtract(long, short).max() < ALLOWED_MB, f"{short} MB → {long} MB"


@pytest.mark.parametrize("recording", RECORDINGS)
def test_a_file_and_a_pipe_give_the_same_bytes(recordings: Path, program: RunProgram, recording: str) -> None:
    command = ("--robot", "g1", "-o", "-", "-q", "--end", "33", "--rate", "20")
    path = recordings / recording
    given = program("convert", path, *command)
    with path.open("rb") as stream:
        piped = program("convert", "-", *command, stdin=stream)
    assert given.returncode == piped.returncode == 0
    assert given.stdout == piped.stdout


def test_shorter_ones_are_converted_as_files_are(recordings: Path, program: RunProgram, tmp_path: Path) -> None:
    command = ("convert", recordings / "walk29.mvnx", "--robot", "g1", "-q", "--rate", "20")
    piped = program(*command, "-o", "-")
    program(*command, "-o", tmp_path / "o.mcap")
    assert piped.stdout == (tmp_path / "o.mcap").read_bytes()


@pytest.mark.parametrize("recording", RECORDINGS)
def test_blocks_are_the_file_to_rounding(recordings: Path, program: RunProgram, tmp_path: Path, recording: str) -> None:
    command = ("convert", recordings / recording, "--robot", "g1", "--rate", "20")
    piped, given = (program(*command, "-o", output) for output in ("-", tmp_path / "file.mcap"))
    (tmp_path / "pipe.mcap").write_bytes(piped.stdout)
    pipe, file = (formats.read_trajectory(tmp_path / f"{name}.mcap") for name in ("pipe", "file"))
    np.testing.assert_array_equal(pipe.time, file.time)
    np.testing.assert_allclose(pipe.position, file.position, rtol=0, atol=1e-6)
    assert pipe.provenance["solver"]["blocks"] == 4
    assert "blocks" not in file.provenance["solver"]
    assert pipe.provenance["input_sha256"] == file.provenance["input_sha256"] != ""
    # One line for people, the same as of a file, up to speed and name.
    lines = [done.stderr.decode().split(", ")[:2] for done in (piped, given)]
    assert lines[0] == lines[1]


@pytest.mark.parametrize(
    ("recording", "place", "problem"),
    [
        ("walk45.mvnx", "stdin, line ", "the document ends early, after 23"),
        ("walk60.mcap", "stdin, byte ", "the file ends inside"),
    ],
)
def test_what_is_cut_off_shows_in_every_stage(recordings: Path, recording: str, place: str, problem: str) -> None:
    """Eight ninths arrive: blocks are out by then, but neither stage calls it done."""
    data = (recordings / recording).read_bytes()
    convert = [PROGRAM, "convert", "-", "--robot", "g1", "-o", "-"]
    done = subprocess.run(convert, input=data[: len(data) * 8 // 9], capture_output=True, timeout=300)
    assert done.returncode == 1
    line = done.stderr.decode()
    assert line.startswith(f"retarget: -: {place}")
    assert problem in line
    assert line.count("\n") == 1
    assert len(done.stdout) > 150_000
    validate = [PROGRAM, "validate", "-", "--mode", "kinematic"]
    judged = subprocess.run(validate, input=done.stdout, capture_output=True, timeout=300)
    assert judged.returncode == 1
    assert judged.stdout == b""
    assert b"expected a complete MCAP (was the writer interrupted?)" in judged.stderr


def test_a_reader_that_leaves_after_the_first_block_is_no_error(recordings: Path) -> None:
    environment = {**os.environ, "PATH": f"{Path(PROGRAM).parent}:{os.environ['PATH']}"}
    script = "retarget convert walk45.mvnx --robot g1 -o - | head -c 1000 | wc -c; echo ${PIPESTATUS[@]}"
    done = subprocess.run(["bash", "-c", script], cwd=recordings, env=environment, capture_output=True, timeout=300)
    assert done.stdout == b"1000\n0 0 0\n"
    assert done.stderr == b""


@pytest.mark.parametrize(
    ("options", "blocks"),
    [([], True), (["--human"], False), (["--style", "joint_trajectory"], False), (["--online"], False)],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_what_needs_the_whole_gets_it(recordings: Path, program: RunProgram, options: list[str], blocks: bool) -> None:
    command = ("convert", recordings / "walk45.mvnx", "--robot", "g1", "-o", "-", "-q", "--rate", "10", *options)
    done = program(*command)
    assert done.returncode == 0, done.stderr
    path = recordings / "options.mcap"
    path.write_bytes(done.stdout)
    trajectory = formats.read_trajectory(path)
    assert trajectory.frames == 450
    assert ("blocks" in trajectory.provenance["solver"]) is blocks
