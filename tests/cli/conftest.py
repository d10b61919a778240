"""A short recording cut from the sample walk, and two ways to run the program: in this process, and as a process of its own."""

from __future__ import annotations

import gzip
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from retarget import samples
from retarget.cli.main import cli

FRAMES = 30
PROGRAM = Path(sys.executable).with_name("retarget")

Run = Callable[..., Result]
RunProgram = Callable[..., "subprocess.CompletedProcess[bytes]"]


@pytest.fixture(scope="session")
def short_walk() -> str:
    """MVNX text of `FRAMES` frames in the middle of the sample walk, with all that stands before its first frame."""
    text = gzip.decompress(samples.sample_path("walk").read_bytes()).decode()
    frames = re.findall(r'<frame [^>]*type="normal".*?</frame>\n?', text, re.DOTALL)
    head, tail = text[: text.index(frames[0])], text[text.rindex("</frames>") :]
    return head + "".join(frames[120 : 120 + FRAMES]) + tail


@pytest.fixture
def walk(tmp_path: Path, short_walk: str) -> Path:
    """The short walk as a file in `tmp_path`."""
    path = tmp_path / "walk.mvnx"
    path.write_text(short_walk, encoding="utf-8")
    return path


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Runs `retarget` with arguments, in this process and in `tmp_path`."""
    monkeypatch.chdir(tmp_path)

    def invoke(*arguments: object, stdin: bytes | str | None = None) -> Result:
        result = CliRunner().invoke(cli, [str(argument) for argument in arguments], input=stdin)
        assert result.exception is None or isinstance(result.exception, SystemExit), result.exc_info
        return result

    return invoke


@pytest.fixture
def program(tmp_path: Path) -> RunProgram:
    """Runs the installed program as a process of its own, in `tmp_path`."""

    def start(
        *arguments: object, env: dict[str, str] | None = None, **rest: object
    ) -> subprocess.CompletedProcess[bytes]:
        command = [str(PROGRAM), *map(str, arguments)]
        environment = {**os.environ, "OMP_NUM_THREADS": "1", **(env or {})}
        options = {"capture_output": True, "cwd": tmp_path, "timeout": 120, **rest}
        return subprocess.run(command, env=environment, **options)  # type: ignore[call-overload,no-any-return]  # options vary

    return start
