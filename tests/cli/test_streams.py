"""The program among other programs: pipes that close, terminals, Ctrl-C, colours. Real processes throughout."""

from __future__ import annotations

import os
import pty
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

RunProgram = Callable[..., "subprocess.CompletedProcess[bytes]"]
PROGRAM = str(Path(sys.executable).with_name("retarget"))


def read_all(descriptor: int) -> bytes:
    """Everything written to the other end of a pseudo-terminal until it is closed."""
    data = b""
    while True:
        try:
            block = os.read(descriptor, 65536)
        except OSError:  # how Linux says that the other end is closed
            return data
        if not block:
            return data
        data += block


def on_terminal(command: list[str], *, stdout: bool = False, env: dict[str, str] | None = None) -> tuple[int, bytes]:
    """(exit code, what the terminal shows) of `command` with stderr, and stdout if asked for, on a pseudo-terminal."""
    main, secondary = pty.openpty()
    environment = {**os.environ, "TERM": "xterm-256color", **(env or {})}
    process = subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=secondary if stdout else subprocess.DEVNULL,
        stderr=secondary,
        env=environment,
    )
    os.close(secondary)
    shown = read_all(main)
    os.close(main)
    return process.wait(60), shown


def test_binary_data_is_kept_from_terminals(walk: Path) -> None:
    code, shown = on_terminal([PROGRAM, "convert", str(walk), "--robot", "g1", "-o", "-"], stdout=True)
    assert code == 2
    assert b"-o - would write the trajectory to the terminal; redirect it, or use -o FILE" in shown
    assert b"\x89MCAP" not in shown


def shell(script: str, folder: Path) -> subprocess.CompletedProcess[bytes]:
    environment = {**os.environ, "PATH": f"{Path(PROGRAM).parent}:{os.environ['PATH']}"}
    return subprocess.run(["bash", "-c", script], cwd=folder, env=environment, capture_output=True, timeout=120)


def test_a_reader_that_leaves_early_is_no_error(walk: Path) -> None:
    """More than a pipe holds, so that the writer meets the closed end."""
    script = (
        f"retarget convert {walk.name} --robot g1 -o - --rate 2000 -q | head -c 100 | wc -c; echo ${{PIPESTATUS[@]}}"
    )
    done = shell(script, walk.parent)
    assert done.stdout == b"100\n0 0 0\n"
    assert done.stderr == b""


def test_help_and_json_into_a_closed_pipe_are_quiet(walk: Path) -> None:
    done = shell("retarget convert --help | true; echo ${PIPESTATUS[0]}", walk.parent)
    assert (done.stdout, done.stderr) == (b"0\n", b"")
    done = shell(f"retarget convert {walk.name} --robot g1 -q --json | true; echo ${{PIPESTATUS[0]}}", walk.parent)
    assert (done.stdout, done.stderr) == (b"0\n", b"")


def test_closed_streams_are_survived(walk: Path) -> None:
    done = shell(f"retarget convert {walk.name} --robot g1 -o - >&-; echo $?", walk.parent)
    assert done.stdout == b"2\n"
    assert done.stderr == b"retarget: walk.mvnx: stdout is closed\n"
    done = shell(f"retarget convert {walk.name} --robot g1 2>&-; echo $?", walk.parent)
    assert done.stdout == b"0\n"


def test_the_progress_bar_is_for_terminals_only(walk: Path, program: RunProgram) -> None:
    command = [
        PROGRAM,
        "convert",
        str(walk),
        "--robot",
        "g1",
        "--rate",
        "2000",
        "--force",
        "-o",
        str(walk.with_name("o.mcap")),
    ]
    code, shown = on_terminal(command)
    assert code == 0
    assert b"g1  [####" in shown
    assert shown.index(b"%") < shown.index(b"967 frames at 2000 Hz")
    assert b"[####" not in on_terminal([*command, "-q"])[1]
    done = program(*command[1:])
    assert b"\r" not in done.stderr
    assert b"[#" not in done.stderr
    assert done.stdout == b""


@pytest.mark.parametrize(("env", "coloured"), [({}, True), ({"NO_COLOR": "1"}, False), ({"TERM": "dumb"}, False)])
def test_colours_only_where_they_are_wanted(env: dict[str, str], coloured: bool) -> None:
    without = {"NO_COLOR": "", **env}
    code, shown = on_terminal([PROGRAM, "info", "no-such-file"], env=without)
    assert code == 2
    assert (b"\x1b[" in shown) is coloured
    assert b"no-such-file: no such file" in shown


def test_no_colours_in_a_pipe(program: RunProgram) -> None:
    assert program("info", "no-such-file").stderr == b"retarget: no-such-file: no such file\n"


def group_lives(group: int) -> bool:
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.parametrize("jobs", [1, 2])
@pytest.mark.parametrize("whole_group", [False, True], ids=["process", "terminal"])
def test_an_interrupt_keeps_what_is_finished_and_nothing_else(walk: Path, jobs: int, whole_group: bool) -> None:
    """SIGINT to the process alone (kill) and to the whole group (Ctrl-C in a terminal)."""
    folder = walk.parent
    names = [f"clip{i:02d}.mvnx" for i in range(60)]
    for name in names:
        shutil.copy(walk, folder / name)
    command = [PROGRAM, "convert", *names, "--robot", "g1", "--rate", "2000", "--jobs", str(jobs), "--base", "human"]
    process = subprocess.Popen(
        command, cwd=folder, stderr=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
    )
    deadline = time.monotonic() + 60
    while not (finished := list(folder.glob("*_g1.mcap"))) and time.monotonic() < deadline and process.poll() is None:
        time.sleep(0.01)
    assert finished, "nothing was finished in a minute"
    if whole_group:
        os.killpg(process.pid, signal.SIGINT)
    else:
        process.send_signal(signal.SIGINT)
    stdout, stderr = process.communicate(timeout=60)
    assert process.returncode == 130
    assert stdout == b""
    lines = stderr.decode().splitlines()
    assert lines[-1] == "retarget: interrupted"
    assert all(line.startswith("[") for line in lines[:-1]), stderr.decode()
    outputs = list(folder.glob("*_g1.mcap"))
    assert len(outputs) < len(names)
    from retarget import formats

    assert {formats.read_trajectory(path).robot for path in outputs} == {"g1"}
    left = {path.name for path in folder.iterdir()} - set(names) - {path.name for path in outputs} - {"walk.mvnx"}
    assert left == set()
    deadline = time.monotonic() + 20
    while group_lives(process.pid) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not group_lives(process.pid), "a worker is still there"
