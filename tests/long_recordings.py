"""Recordings of minutes, made of a short sample that is walked forth and back: no jumps, and every frame a real one."""

from __future__ import annotations

import gzip
import re
from pathlib import Path

from retarget import samples


def write_long_walk(path: Path, seconds: float) -> None:
    """The sample walk, 60 Hz, forth and back for so long, as MVNX without compression."""
    text = gzip.decompress(samples.sample_path("walk").read_bytes()).decode()
    frames = re.findall(r"<frame .*?</frame>", text, re.DOTALL)
    once = [frame for frame in frames if 'type="normal"' in frame]
    cycle = once + once[-2:0:-1]
    start, stop = text.index(once[0]), text.rindex("</frame>") + len("</frame>")
    with path.open("w", encoding="utf-8") as out:
        out.write(text[:start])
        for index in range(round(seconds * 60)):
            out.write(re.sub(r'index="\d*"', f'index="{index}"', cycle[index % len(cycle)], count=1) + "\n")
        out.write(text[stop:])
