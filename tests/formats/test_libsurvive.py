"""libsurvive's recordings: poses among other lines, plain, gzip, and cut off."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest
from retarget import formats
from retarget.core.errors import FormatError, UsageError
from retarget.formats import TrackerOptions

from tests.formats.tracker_logs import read, rotation, wandering

CLOCKS = {"T20": np.arange(0, 1, 0.008), "HMD": 0.001 + np.arange(0, 1, 0.008)}
POSES = {
    name: wandering(len(clock), seed, 125, about=(0.1, -0.4, 1.2)) for seed, (name, clock) in enumerate(CLOCKS.items())
}


def recording() -> bytes:
    lines = [
        (t, f"{t:.6f} {name} POSE " + " ".join(map("{:.9f}".format, POSES[name][i])))
        for name, clock in CLOCKS.items()
        for i, t in enumerate(clock)
    ]
    lines += [(t, f'{t:.6f} T20 I 1 {{"POSE x": 1}} 0.1 0.2 9.8') for t in np.arange(0, 1, 0.004)]
    lines += [(-1, '0.000000 T20 CONFIG {"device": "T20", "note": " POSE "}'), (0.5, "0.5 LOG POSE found")]
    return (
        "\n".join(text for _, text in sorted(lines)).replace("0.5 LOG POSE found", "0.5 LOG info POSE").encode() + b"\n"
    )


def test_devices_on_one_time_base_with_z_up() -> None:
    found = read(recording(), format="libsurvive", up=None)
    assert set(found.trackers) == set(CLOCKS)
    assert dict(found.segments) == {"HMD": "Head"}
    assert found.rate_hz == pytest.approx(125, rel=1e-3)
    here = found.index("T20")
    count = min(found.frames, len(CLOCKS["T20"]))
    np.testing.assert_allclose(found.position[:count, here], POSES["T20"][:count, :3], atol=1e-6)
    difference = rotation(found.orientation[:count, here]) * rotation(POSES["T20"][:count, 3:]).inv()
    assert difference.magnitude().max() < 1e-5
    assert not any("up" in line for line in found.source.warnings)


@pytest.mark.parametrize("suffix", [".rec", ".rec.gz"])
def test_by_suffix(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"walk{suffix}"
    path.write_bytes(gzip.compress(recording()) if suffix.endswith("gz") else recording())
    assert formats.read_trackers(path).source.format == "libsurvive"
    facts = formats.describe(path, options=TrackerOptions(roles={"T20": "chest"}))
    assert (facts["kind"], facts["segments"]) == ("trackers", {"T20": "T8", "HMD": "Head"})


def test_a_gzip_stream_cut_off_is_read_up_to_there() -> None:
    whole = gzip.compress(recording())
    found = read(whole[: len(whole) // 2], format="libsurvive", up="z")
    assert 10 < found.frames < 100
    assert any(
        "ends before its end mark; the file was cut off: read up to there" in line for line in found.source.warnings
    )
    with pytest.raises(FormatError, match="cut off"):
        read(whole[:12], format="libsurvive")


def test_a_last_line_cut_short_is_left_out() -> None:
    """Its last number is one still, so that only the missing line end tells."""
    text = b"".join(b"%d.0 T20 POSE 0 0 1 1 0 0 0\n" % i for i in range(3)) + b"3.0 T20 POSE 0 0 1 1 0 0 0.70"
    found = read(text, format="libsurvive", up="z")
    assert found.frames == 3
    assert "line 4 is cut short and left out" in found.source.warnings


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"hello\n", "no poses; expected lines"),
        (b"0.1 T20 POSE 0 0 1 1 0 0\n", "line 1: 9 cells; expected t DEVICE POSE"),
        (b"0.1 T20 POSE 0 0 one 1 0 0 0\n", "line 1: 'one' in column 'z' is no number"),
        (b"0.2 T20 POSE 0 0 1 1 0 0 0\n0.1 T20 POSE 0 0 1 1 0 0 0\n", r"line 2: time of tracker 'T20' goes back"),
        (b"0.2 T20 POSE 0 0 1 0 0 0 0\n", "tracker 'T20' never has a usable quaternion"),
    ],
)
def test_one_line_for_each_fault(content: bytes, message: str) -> None:
    with pytest.raises(FormatError, match=f"log.*{message}"):
        read(content, format="libsurvive")


def test_columns_and_rates_have_no_place() -> None:
    with pytest.raises(UsageError, match="expected no columns file and no rate"):
        read(recording(), format="libsurvive", rate_hz=90)
