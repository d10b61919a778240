"""Fuzzing that is led by coverage finds what lies behind several branches, where chance alone does not get."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("atheris") is None, reason="needs atheris, which has no wheel here: pip install '.[fuzz]'"
)

PLANTED = """
import sys
import atheris
from tests.fuzz import corpus, guided, mutations

@atheris.instrument_func
def read(data):
    if data[:1] == b"r":
        if data[1:2] == b"e":
            if data[2:3] == b"t":
                if data[3:4] == b"!":
                    {fault}
    return None

corpus.TARGETS = {{"planted": corpus.Target("planted", lambda: [b"seed"], read, (mutations.of_bytes,))}}
sys.argv = ["guided", "--seconds", "60", "--most", "1", "--findings", {folder!r}]
sys.exit(guided.main())
"""


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    root = Path(__file__).parents[2]
    return subprocess.run([sys.executable, *arguments], capture_output=True, text=True, cwd=root, check=False)


@pytest.mark.parametrize(("fault", "kind"), [("[][0]", "IndexError"), ("while True: pass", "no answer")])
def test_a_fault_behind_four_branches_is_found(fault: str, kind: str, tmp_path: Path) -> None:
    script = PLANTED.format(fault=fault, folder=str(tmp_path))
    done = run("-c", script)
    assert done.returncode == 1, done.stderr
    assert kind in done.stdout
    (found,) = tmp_path.glob("planted-*.bin")
    assert found.read_bytes()[:4] == b"ret!"
    assert kind in found.with_suffix(".txt").read_text(encoding="utf-8")


@pytest.mark.parametrize("reader", ["thresholds", "mcap"])
def test_a_reader_is_read(reader: str, tmp_path: Path) -> None:
    folder = tmp_path / "none"
    done = run("-m", "tests.fuzz.guided", "--reader", reader, "--seconds", "3", "--findings", str(folder))
    assert done.returncode == 0, done.stderr
    assert int(done.stdout.split()[1].replace(",", "")) > 10
    assert not folder.exists()
