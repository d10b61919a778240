"""The part of the fuzzing that fits into every run: 20,000 mutated files over all readers, the same ones each time.

`python -m tests.fuzz` has as many more as there is time for.
"""

from __future__ import annotations

import math
import os
import signal
import struct
import time
import tracemalloc
from dataclasses import replace

import lz4.frame
import numpy as np
import pytest
import zstandard
from retarget.core.errors import FormatError, RetargetError
from retarget.formats._mcap_reader import MAGIC

from tests.fuzz import runner, seeds
from tests.fuzz.corpus import TARGETS, Target
from tests.fuzz.mutations import bomb

IN_TOTAL = 20_000
_EACH = IN_TOTAL / sum(1 / target.cost for target in TARGETS.values())
INPUTS = {name: math.ceil(_EACH / target.cost) for name, target in TARGETS.items()}
"""How many of each reader: the slower, the fewer."""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="readers are fuzzed in forked processes")
@pytest.mark.parametrize("name", TARGETS)
def test_mutated_files(name: str) -> None:
    outcome = runner.run(name, count=INPUTS[name])
    assert not outcome.findings, "\n".join(runner.minimal_report(outcome))
    assert outcome.inputs == INPUTS[name]
    assert outcome.accepted > 0, "no input was accepted: what is mutated isn't read"
    assert outcome.accepted < outcome.inputs, "no input was refused: nothing is mutated"


def test_inputs_are_as_many_as_promised() -> None:
    assert IN_TOTAL <= sum(INPUTS.values()) < IN_TOTAL + len(INPUTS)
    assert min(INPUTS.values()) >= 10


def test_seeds_are_good() -> None:
    for target in TARGETS.values():
        assert target.read(target.seeds()[0]) is not None, target.name


class TwoLines(RetargetError):
    """What `RetargetError` itself never shows."""

    def __str__(self) -> str:
        return "two\nlines"


@pytest.mark.parametrize(
    ("fault", "kind"),
    [
        (lambda: [][0], "IndexError"),
        (lambda: _raise(TwoLines()), "not one line"),
        (lambda: os.kill(os.getpid(), signal.SIGSEGV), "ended with -11"),
        (lambda: _loop(), "no answer"),
        (lambda: np.ones(8 << 20).sum(), "of memory"),
        (lambda: np.log(np.zeros(1)), "RuntimeWarning"),
    ],
)
def test_the_runner_notices(fault: object, kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A reader that breaks on every input that is no seed."""
    seed = b"seed"

    def read(data: bytes) -> object:
        return None if data == seed else fault()  # type: ignore[operator]  # a callable

    broken = Target("broken", lambda: [seed], read)
    monkeypatch.setattr(runner, "TARGETS", {"broken": broken})
    monkeypatch.setattr(runner, "HANG_S", 1.0)
    monkeypatch.setattr(runner, "MEMORY_BYTES", 32 << 20)
    outcome = runner.run("broken", count=2)
    assert any(kind in finding.kind for finding in outcome.findings), outcome.findings


def test_inputs_are_the_same_in_every_run() -> None:
    target = TARGETS["mvnx"]
    seeds = list(target.seeds())
    assert [runner.mutated(target, seeds, i) for i in (5, 6)] == [runner.mutated(target, seeds, i) for i in (5, 6)]
    assert runner.mutated(replace(target, name="other"), seeds, 5) != runner.mutated(target, seeds, 5)


def test_gzip_bomb(monkeypatch: pytest.MonkeyPatch) -> None:
    """A file of kilobytes is refused before it is unpacked as a whole; the limit is lowered for the test."""
    monkeypatch.setattr("retarget.formats._byte_chunks.LARGEST_TEXT_BYTES", 4 << 20)
    data = bomb(seeds.tracker_log("libsurvive"), 300_000)
    assert len(data) < 100_000
    with pytest.raises(FormatError, match=r"input: a text of more than 4 MB"):
        TARGETS["libsurvive"].read(data)


def test_zip_bomb_and_lying_header(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(FormatError, match="not a readable NPZ archive"):
        TARGETS["npz"].read(seeds.lying_npz())
    monkeypatch.setattr("retarget.formats.npz.LARGEST_ARRAY_BYTES", 16 << 20)
    data = seeds.npz_bomb()
    assert len(data) < 1 << 20
    with pytest.raises(FormatError, match=r"its arrays take 200 MB; expected at most 16 MB"):
        TARGETS["npz"].read(data)


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
@pytest.mark.parametrize(
    ("stated", "problem"),
    [(1000, r"chunk of 1001 bytes; expected 1000 as stated"), (1 << 31, r"a chunk of 2048 MB; expected at most 1024")],
)
def test_mcap_chunk_that_is_a_bomb(compression: str, stated: int, problem: str) -> None:
    """64 MB of zeros in a chunk that states another size: no more than that is unpacked."""
    zeros = bytes(64 << 20)
    packed = zstandard.compress(zeros) if compression == "zstd" else lz4.frame.compress(zeros)
    name = struct.pack("<I", len(compression)) + compression.encode()
    chunk = struct.pack("<QQQI", 0, 0, stated, 0) + name + struct.pack("<Q", len(packed)) + packed
    header, footer = (struct.pack("<BQ", opcode, size) + bytes(size) for opcode, size in ((1, 8), (2, 20)))
    data = MAGIC + header + struct.pack("<BQ", 6, len(chunk)) + chunk + footer + MAGIC
    assert len(data) < 1 << 20
    tracemalloc.start()
    with pytest.raises(FormatError, match=problem):
        TARGETS["mcap"].read(data)
    assert tracemalloc.get_traced_memory()[1] < 8 << 20
    tracemalloc.stop()


@pytest.mark.parametrize("checksums", [True, False])
def test_hdf5_array_that_is_declared_and_never_written(checksums: bool) -> None:
    with pytest.raises(FormatError, match=r"an array of 7629394 MB"):
        TARGETS["hdf5"].read(seeds.foreign_hdf5(checksums=checksums, time=(10**12,)))


def test_foreign_hdf5_gives_the_same_as_ours() -> None:
    found, own = TARGETS["hdf5"].read(seeds.foreign_hdf5()), seeds.trajectory()
    assert found.joint_names == own.joint_names
    for field in ("time", "position", "velocity", "base_position", "base_orientation"):
        np.testing.assert_array_equal(getattr(found, field), getattr(own, field))


def _raise(error: Exception) -> None:
    raise error


def _loop() -> None:
    start = time.process_time()
    while time.process_time() - start < 20:
        pass
