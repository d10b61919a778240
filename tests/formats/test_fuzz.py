"""Damaged files: whatever the bytes, a reader gives a valid trajectory or one `RetargetError` of one line."""

from __future__ import annotations

import io
import random
from collections.abc import Callable

import numpy as np
import pytest
import zstandard
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from retarget import formats
from retarget.core.errors import FormatError, RetargetError
from retarget.core.types import JointTrajectory
from retarget.formats._mcap_reader import MAGIC

Maker = Callable[..., JointTrajectory]
BOTH_WAYS = [name for name, f in formats.available().items() if f.read_trajectory and f.write_trajectory]


def damaged(data: bytes, rng: random.Random) -> bytes:
    """`data` cut short, with some bytes replaced, or with a stretch replaced by noise of another length."""
    out = bytearray(data)
    kind = rng.random()
    if kind < 0.2:
        return bytes(out[: rng.randrange(len(out))])
    if kind < 0.9:
        for _ in range(rng.choice([1, 1, 2, 5, 30])):
            out[rng.randrange(len(out))] = rng.choice([0, 1, 255, rng.randrange(256)])
        return bytes(out)
    at = rng.randrange(len(out))
    out[at : at + rng.randrange(40)] = rng.randbytes(rng.randrange(40))
    return bytes(out)


def refuses(data: bytes, name: str | None = None) -> bool:
    """Whether reading `data` is refused; anything but a trajectory or one line of error fails the test."""
    try:
        found = formats.read_trajectory(io.BytesIO(data), "walk", name)
    except RetargetError as error:
        message = str(error)
    else:
        assert np.isfinite(found.position).all()
        return False
    assert "\n" not in message
    assert message.startswith("walk")
    return True


@pytest.mark.parametrize("name", BOTH_WAYS)
def test_damaged_bytes(name: str, make_trajectory: Maker) -> None:
    rng = random.Random(name)
    out = io.BytesIO()
    format_ = formats.get(name)
    assert format_.write_trajectory is not None
    format_.write_trajectory(out, make_trajectory(frames=4, joints=2), format_.styles[0])
    variants = [damaged(out.getvalue(), rng) for _ in range(500)]
    refused = sum(refuses(data, name) for data in variants)
    assert refused > 100


def test_noise_is_of_no_format() -> None:
    rng = random.Random(1)
    for _ in range(200):
        with pytest.raises(FormatError):
            formats.read_trajectory(io.BytesIO(rng.randbytes(rng.randrange(1, 300))), "walk")


def test_damage_inside_mcap_messages_behind_valid_checksums(make_trajectory: Maker) -> None:
    """The checksums catch nearly all damage; here they are left out (0 = not computed), as some recorders do."""
    rng = random.Random(2)
    out = io.BytesIO()
    formats.write_trajectory_stream(out, make_trajectory(frames=4, joints=2))
    chunks = [r for r in StreamReader(io.BytesIO(out.getvalue()), emit_chunks=True).records if isinstance(r, Chunk)]
    content = b"".join(zstandard.decompress(chunk.data) for chunk in chunks)
    header = b"\x01" + (8).to_bytes(8, "little") + bytes(8)
    footer = b"\x02" + (20).to_bytes(8, "little") + bytes(20)

    def unchecked(records: bytes) -> bytes:
        return MAGIC + header + records + footer + MAGIC

    assert formats.read_trajectory(io.BytesIO(unchecked(content)), "walk").frames == 4
    refused = sum(refuses(unchecked(damaged(content, rng))) for _ in range(600))
    assert refused > 100
