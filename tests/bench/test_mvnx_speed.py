"""MVNX reading: ours against mvnx-parser and against a bare lxml loop, on a recording of about 60 MB.

The lxml loop reads the same three fields as fast as lxml and NumPy allow: only whole frames are called back, texts are joined and converted at
once, elements are freed. It neither hashes, nor checks counts, nor turns orientations to T-pose frames; ours does all that.
mvnx-parser reads every field. The recording is the real upper-body one with its frames repeated, or where that is not at hand a
synthetic one of the same size. Ratios are recorded and printed, not asserted; that all read the same values is asserted.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from lxml import etree
from mvnx_parser.parser import Mvnx_p
from pytest_benchmark.fixture import BenchmarkFixture
from retarget.core.types import Array, HumanMotion
from retarget.formats.mvnx import read_motion

from tests.formats.mvnx_documents import mvnx
from tests.formats.mvnx_oracles import UPPER_BODY_V4

FILE_BYTES = 60_000_000
FIELDS = ("orientation", "position", "angularVelocity")


@pytest.fixture(scope="module")
def recording(make_motion: Callable[..., HumanMotion], tmp_path_factory: pytest.TempPathFactory) -> Path:
    if UPPER_BODY_V4.is_file():
        text = UPPER_BODY_V4.read_bytes()
    else:
        rng = np.random.default_rng(1)
        motion = make_motion(np.arange(100) / 60, angular_velocity=rng.normal(size=(100, 23, 3)))
        names = ("velocity", "acceleration", "angularAcceleration", "sensorOrientation", "jointAngle", "jointAngleXZY")
        values = " ".join(f"{value:.6f}" for value in rng.normal(size=69))
        text = mvnx(motion, extra=lambda _: "".join(f"<{name}>{values}</{name}>\n" for name in names)).encode()
    start, stop = text.rindex(b"<frame ", 0, text.index(b'type="normal"')), text.rindex(b"</frame>") + len(b"</frame>")
    frames = text[start:stop].split(b"</frame>")[:-1]
    path = tmp_path_factory.mktemp("mvnx") / "long.mvnx"
    with path.open("wb") as out:
        out.write(text[:start])
        for index in range(FILE_BYTES * len(frames) // (stop - start)):
            before, _, after = frames[index % len(frames)].partition(b'index="')
            out.write(before + b'index="%d' % index + after[after.index(b'"') :] + b"</frame>")
        out.write(text[stop:])
    return path


def ours(path: Path) -> HumanMotion:
    with path.open("rb") as stream:
        return read_motion(stream, path.name)


def bare_lxml(path: Path) -> dict[str, Array]:
    texts: dict[str, list[str]] = {field: [] for field in FIELDS}
    for _, frame in etree.iterparse(path, events=("end",), tag="{*}frame"):
        if frame.get("type") == "normal":
            for element in frame:
                wanted = texts.get(element.tag.rpartition("}")[2])
                if wanted is not None:
                    wanted.append(element.text)
        frame.clear()
        while frame.getprevious() is not None:
            del frame.getparent()[0]
    count = len(texts["orientation"])
    return {field: np.fromstring(" ".join(found), sep=" ").reshape(count, 23, -1) for field, found in texts.items()}


def seconds(read: Callable[[Path], object], path: Path) -> float:
    started = time.perf_counter()
    read(path)
    return time.perf_counter() - started


def test_against_bare_lxml(benchmark: BenchmarkFixture, recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lxml_s = []

    def measure_lxml() -> None:
        # Before each of our rounds, so that a machine busy with other things slows both down.
        lxml_s.append(seconds(bare_lxml, recording))

    motion = benchmark.pedantic(ours, args=(recording,), setup=measure_lxml, rounds=12, warmup_rounds=1)
    there = bare_lxml(recording)
    np.testing.assert_array_equal(motion.position, there["position"])
    np.testing.assert_array_equal(motion.angular_velocity, there["angularVelocity"])
    dots = np.abs(np.einsum("tsi,tsi->ts", motion.orientation, there["orientation"]))
    np.testing.assert_allclose(dots, 1.0, atol=2e-6)
    size, ours_s = recording.stat().st_size, benchmark.stats.stats.min
    report(benchmark, capsys, {
        "megabytes_per_second": size / ours_s / 1e6,
        "megabytes_per_second_lxml": size / min(lxml_s) / 1e6,
        "speed_relative_to_lxml": min(lxml_s) / ours_s,
    })  # fmt: skip


def test_against_mvnx_parser(benchmark: BenchmarkFixture, recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    started = time.perf_counter()
    there = Mvnx_p(str(recording))
    parser_s = time.perf_counter() - started
    motion = benchmark.pedantic(ours, args=(recording,), rounds=5, warmup_rounds=1)
    np.testing.assert_array_equal(motion.position, np.array(there.position, float))
    size, ours_s = recording.stat().st_size, benchmark.stats.stats.min
    report(benchmark, capsys, {
        "megabytes_per_second": size / ours_s / 1e6,
        "megabytes_per_second_mvnx_parser": size / parser_s / 1e6,
        "speed_relative_to_mvnx_parser": parser_s / ours_s,
    })  # fmt: skip


def report(benchmark: BenchmarkFixture, capsys: pytest.CaptureFixture[str], numbers: dict[str, float]) -> None:
    benchmark.extra_info |= numbers
    with capsys.disabled():
        print("\n" + "\n".join(f"{name}: {value:.2f}" for name, value in numbers.items()))
