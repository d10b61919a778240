"""Whole `retarget convert` processes on a five-minute recording at 240 Hz: 72,000 frames, MVNX to MCAP on one core, by stage.

The recording repeats a clip forth and back, so that its motion has no jumps: the real upper-body one where it is at hand (7 kB a frame, every
field that MVN writes, here declared full-body, so that legs are retargeted too), else the squat sample. Figures are recorded and
printed, not asserted; that every frame arrives inside the limits is asserted.
"""

from __future__ import annotations

import gzip
import json
import os
import re
import subprocess
import sys
import time
from pathlib import Path

import pytest
from pytest_benchmark.fixture import BenchmarkFixture
from retarget import samples

from tests.formats.mvnx_oracles import UPPER_BODY_V4

FRAMES, RATE_HZ = 72_000, 240


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if UPPER_BODY_V4.is_file():
        text = UPPER_BODY_V4.read_text().replace('configuration="UpperBody"', 'configuration="FullBody"')
    else:
        text = gzip.decompress(samples.sample_path("squat").read_bytes()).decode()
    text = re.sub(r'frameRate="[^"]*"', f'frameRate="{RATE_HZ}"', text)
    frames = re.findall(r"<frame .*?</frame>", text, re.DOTALL)
    once = [frame for frame in frames if 'type="normal"' in frame]
    cycle = once + once[-2:0:-1]
    first, last = text.index(once[0]), text.rindex("</frame>") + len("</frame>")
    path = tmp_path_factory.mktemp("convert") / "five_minutes.mvnx"
    with path.open("w") as out:
        out.write(text[:first])
        for index in range(FRAMES):
            out.write(re.sub(r'index="\d*"', f'index="{index}"', cycle[index % len(cycle)], count=1) + "\n")
        out.write(text[last:])
    return path


@pytest.mark.parametrize("kernel", ["numpy", "compiled"])
def test_convert_five_minutes(benchmark: BenchmarkFixture, recording: Path, kernel: str) -> None:
    """The process as a user starts it: interpreter, imports, reading, solving, measuring, writing."""
    if kernel == "compiled":
        pytest.importorskip("numba", reason="numba is not there for this Python")
    output = recording.with_suffix(".mcap")
    command = [sys.executable, "-m", "retarget.cli", "convert", str(recording), "--robot", "g1", "-o", str(output)]
    command += ["--force", "--json", "-q", "--kernel", kernel]

    def convert() -> dict[str, object]:
        done = subprocess.run(
            command, capture_output=True, text=True, check=True, env=os.environ | {"OMP_NUM_THREADS": "1"}
        )
        found: dict[str, object] = json.loads(done.stdout)
        return found

    if kernel == "compiled":
        convert()  # compiles, once per machine
    begin = time.perf_counter()
    result = benchmark.pedantic(convert, rounds=1)
    wall_s = time.perf_counter() - begin
    metrics = result["metrics"]
    assert isinstance(metrics, dict)
    assert result["frames"] == FRAMES
    assert metrics["position_limit_violations"] == metrics["velocity_limit_violations"] == 0
    benchmark.extra_info.update({"frames_per_second": FRAMES / wall_s, "stages_s": result["stages_s"]})
    print(f"\n{kernel}: {FRAMES / wall_s:.0f} frames/s, whole process; stages in s: {result['stages_s']}")
