"""A thousand kills at random moments of batch conversions: no output is ever broken. `pytest tests/bench/test_kills.py`, minutes."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

from retarget import samples

KILLING = Path(__file__).parents[1] / "cli" / "killing.py"
KILLS = 1000


def test_a_thousand_kills(tmp_path: Path) -> None:
    command = [sys.executable, str(KILLING), str(tmp_path / "work")]
    recording = tmp_path / "walk.mvnx"
    recording.write_bytes(_short_walk())
    done = subprocess.run(
        [*command, str(recording), str(KILLS), "7"],
        stdout=subprocess.PIPE,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        check=True,
    )
    counts = json.loads(done.stdout)
    print(counts)
    assert (counts["kills"], counts["broken"], counts["left_over"]) == (KILLS, 0, 0)


def _short_walk() -> bytes:
    import gzip
    import re

    text = gzip.decompress(samples.sample_path("walk").read_bytes()).decode()
    frames = re.findall(r'<frame [^>]*type="normal".*?</frame>\n?', text, re.DOTALL)
    return (text[: text.index(frames[0])] + "".join(frames[120:150]) + text[text.rindex("</frames>") :]).encode()
