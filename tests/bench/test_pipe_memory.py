"""Three stages in a pipe, `cat | retarget convert - | retarget validate -`, on half a minute and on five: memory, and when the first joints come out.

The recording, MVNX or an MCAP of tf, repeats the sample walk, 60 Hz, forth and back. Times are printed, not asserted; that no stage needs 64 MB more for ten times the
recording is asserted.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from retarget import formats, robots
from retarget.core.metrics import limit_figures
from retarget.core.robot_model import build

from tests.long_recordings import write_long_walk, write_long_walk_mcap

PROGRAM = str(Path(sys.executable).with_name("retarget"))
ALLOWED_MB = 64


def peak_mb(process: subprocess.Popen[bytes]) -> float:
    """The most memory that `process` has had, 0 when it is gone."""
    try:
        status = Path(f"/proc/{process.pid}/status").read_text()
        return float(status.partition("VmHWM:")[2].split()[0]) / 1024
    except (OSError, IndexError):
        return 0.0


def run(recording: Path, mode: str, copy: Path) -> dict[str, float]:
    """Peaks of both stages in MB, seconds until the first bytes leave `convert`, and in all. What leaves it is copied to `copy`."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    begin = time.perf_counter()
    cat = subprocess.Popen(["cat", str(recording)], stdout=subprocess.PIPE)
    convert = subprocess.Popen(
        [PROGRAM, "convert", "-", "--robot", "g1", "-o", "-", "-q"],
        stdin=cat.stdout,
        stdout=subprocess.PIPE,
        env=environment,
    )
    validate = subprocess.Popen(
        [PROGRAM, "validate", "-", "--mode", mode, "-q"],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        env=environment,
    )
    found = {"convert_mb": 0.0, "validate_mb": 0.0}

    def watch() -> None:
        while convert.poll() is None or validate.poll() is None:
            found["convert_mb"] = max(found["convert_mb"], peak_mb(convert))
            found["validate_mb"] = max(found["validate_mb"], peak_mb(validate))
            time.sleep(0.01)

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    assert convert.stdout is not None
    assert validate.stdin is not None
    with copy.open("wb") as out:
        while block := convert.stdout.read1(1 << 16):  # type: ignore[attr-defined]  # buffered
            found.setdefault("first_output_s", time.perf_counter() - begin)
            out.write(block)
            validate.stdin.write(block)
    validate.stdin.close()
    assert (cat.wait(), convert.wait(), validate.wait()) == (0, 0, 0)
    watcher.join()
    return found | {"seconds": time.perf_counter() - begin}


@pytest.mark.skipif(not Path("/proc/self/status").is_file(), reason="peaks of memory are read from /proc")
@pytest.mark.parametrize(
    ("write", "suffix", "mode"),
    [
        (write_long_walk, ".mvnx", "kinematic"),
        (write_long_walk, ".mvnx", "fixed"),
        (write_long_walk_mcap, ".mcap", "kinematic"),
    ],
)
def test_five_minutes_through_a_pipe(
    write: Callable[[Path, float], None], suffix: str, mode: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = {}
    for seconds in (29, 300):
        recording = tmp_path / f"walk{seconds}{suffix}"
        write(recording, seconds)
        found[seconds] = run(recording, mode, tmp_path / "copy.mcap")
    with capsys.disabled():
        for seconds, figures in found.items():
            print(
                f"\n{suffix}, {mode}, {seconds} s: "
                + ", ".join(f"{name} {value:.1f}" for name, value in figures.items())
            )
    for stage in ("convert_mb", "validate_mb"):
        assert found[300][stage] - found[29][stage] < ALLOWED_MB, stage
    figures, _ = limit_figures(formats.read_trajectory(tmp_path / "copy.mcap"), build(robots.load("g1")))
    assert figures["position_limit_violations"] == figures["velocity_limit_violations"] == 0
