"""Reading needs no more memory than the arrays it returns plus 64 MB, whatever the length of the recording."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from retarget.core.types import HumanMotion

from tests.formats.mvnx_documents import mvnx

FRAMES = 20_000
ALLOWED_BYTES = 64 << 20

READ = """
import io, json, sys
from pathlib import Path
from retarget.formats.mvnx import read_motion

class Repeated(io.RawIOBase):
    '''A document with its last frame repeated, made while it is read.'''
    def __init__(self, text, frames):
        self.blocks, self.left, self.size = self.make(text, frames), b"", 0
    def make(self, text, frames):
        start, stop = text.rindex(b"<frame "), text.rindex(b"</frame>") + len(b"</frame>")
        before, after = text[start:stop].split(b'index="1"')
        yield text[:start]
        for index in range(1, frames, 100):
            yield b"".join(before + b'index="%d"' % at + after for at in range(index, min(index + 100, frames)))
        yield text[stop:]
    def read(self, size):
        parts, have = [self.left], len(self.left)
        while have < size and (block := next(self.blocks, b"")):
            parts.append(block)
            have += len(block)
        data = b"".join(parts)
        self.left = data[size:]
        self.size += len(data[:size])
        return data[:size]

def peak():
    status = Path("/proc/self/status").read_text()
    return 1024 * int(status.partition("VmHWM:")[2].split()[0])

text = Path(sys.argv[1]).read_bytes()
read_motion(io.BytesIO(text), "warm")
before = peak()
stream = Repeated(text, int(sys.argv[2]))
motion = read_motion(stream, "long")
arrays = sum(a.nbytes for a in (motion.time, motion.orientation, motion.position, motion.angular_velocity))
print(json.dumps({"frames": motion.frames, "arrays": arrays, "file": stream.size, "growth": peak() - before}))
"""


@pytest.mark.skipif(not Path("/proc/self/status").is_file(), reason="the peak of memory is read from /proc")
def test_peak_memory(make_motion: Callable[..., HumanMotion], tmp_path: Path) -> None:
    motion = make_motion([0.0, 1 / 60], angular_velocity=np.full((2, 23, 3), 0.123456))
    fields = ("velocity", "acceleration", "angularAcceleration", "jointAngle", "jointAngleXZY", "sensorOrientation")
    filler = "".join(f"<{field}>{'0.123456 ' * 69}</{field}>" for field in fields)
    path = tmp_path / "two.mvnx"
    path.write_text(mvnx(motion, extra=lambda _: filler))
    done = subprocess.run(
        [sys.executable, "-c", READ, str(path), str(FRAMES)], capture_output=True, text=True, check=True
    )
    found = json.loads(done.stdout)
    assert found["frames"] == FRAMES
    assert found["arrays"] == FRAMES * 8 * (1 + 23 * (4 + 3 + 3))
    assert found["growth"] <= found["arrays"] + ALLOWED_BYTES
    # The test could fail: a reader that held the text, or a second copy of all arrays and the text's floats, would need more.
    assert found["file"] > found["arrays"] + ALLOWED_BYTES
