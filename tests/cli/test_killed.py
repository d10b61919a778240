"""A process that is killed leaves finished outputs and nothing else, and the same command does the rest."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from retarget import formats

KILLS = 60
"""tests/bench/test_kills.py does a thousand."""
KILLING = Path(__file__).with_name("killing.py")


@pytest.mark.slow
def test_every_output_is_complete_whenever_the_batch_is_killed(walk: Path, tmp_path: Path) -> None:
    command = [sys.executable, str(KILLING), str(tmp_path / "work"), str(walk), str(KILLS), "1"]
    env = {**os.environ, "OMP_NUM_THREADS": "1"}
    done = subprocess.run(command, capture_output=True, env=env, check=False, timeout=300)
    assert done.returncode == 0, done.stderr.decode()
    counts = json.loads(done.stdout)
    assert (counts["broken"], counts["left_over"]) == (0, 0), done.stderr.decode()
    assert counts["complete"] > 0
    assert counts["at_work"] > KILLS // 3


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc").is_dir(), reason="looks for processes in /proc")
def test_workers_go_with_a_killed_parent(walk: Path, tmp_path: Path) -> None:
    clips = [tmp_path / f"clip{i}.mvnx" for i in range(40)]
    for clip in clips:
        clip.write_bytes(walk.read_bytes())
    (tmp_path / "out").mkdir()
    marker = f"kill-test-{os.getpid()}-{time.monotonic_ns()}"
    command = [sys.executable, "-m", "retarget.cli", "convert", *map(str, clips), "--robot", "g1", "-j", "2"]
    env = {**os.environ, "OMP_NUM_THREADS": "1", "RETARGET_TEST": marker}
    output = ["-o", str(tmp_path / "out" / "{stem}.mcap")]
    process = subprocess.Popen([*command, *output], env=env, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 60
    while not any((tmp_path / "out").iterdir()) and time.monotonic() < deadline:
        time.sleep(0.05)
    process.send_signal(signal.SIGKILL)
    process.wait()
    while _processes(marker) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not _processes(marker)
    outputs = list((tmp_path / "out").iterdir())
    assert outputs
    assert all(path.suffix == ".mcap" and formats.read_trajectory(path).frames for path in outputs)


def _processes(marker: str) -> list[str]:
    """Processes with `marker` in their environment."""
    found = []
    for place in Path("/proc").glob("[0-9]*"):
        try:
            if marker.encode() in (place / "environ").read_bytes():
                found.append(place.name)
        except OSError:
            continue  # gone meanwhile, or another user's
    return found
