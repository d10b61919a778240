"""Ranges of joints as provenance keeps them: outward rounding, parts, sums that tell equal ranges apart, entries that are none."""

from __future__ import annotations

import json
import struct
import zlib
from typing import Any

import numpy as np
import pytest
from retarget.core.errors import InvalidDataError
from retarget.core.joint_ranges import JointRanges

NAMES = ("hip", "knee")
VALUES = np.array([[0.1234561, -0.0], [-0.5, 1e-7], [0.25, 1.0]])


def test_written_by_hand() -> None:
    """Bounds outward to a millionth; CRC-32 of the little-endian single-precision values, the negative zero as zero."""

    def crc(*values: float) -> str:
        return f"{zlib.crc32(struct.pack('<3f', *values)):08x}"

    assert JointRanges.of(NAMES, VALUES).provenance() == {
        "joint_ranges": {
            "frames": 3,
            "joints": {
                "hip": [-0.5, 0.25, crc(0.1234561, -0.5, 0.25)],
                "knee": [0.0, 1.0, crc(0.0, 1e-7, 1.0)],
            },
        }
    }
    outward = JointRanges.of(["a"], np.array([[0.1234561], [-0.1234561]]))
    assert (outward.lower.tolist(), outward.upper.tolist()) == ([-0.123457], [0.123457])
    assert str(JointRanges.of(["a"], np.array([[-0.0]])).lower[0]) == "0.0"


def test_bounds_enclose_the_values_and_lie_within_a_millionth() -> None:
    values = np.random.default_rng(1).normal(scale=[1e-3, 1.0, 50.0], size=(500, 3))
    ranges = JointRanges.of("abc", values)
    below, above = values.min(axis=0) - ranges.lower, ranges.upper - values.max(axis=0)
    assert (np.minimum(below, above) >= -1e-12).all()
    assert (np.maximum(below, above) <= 1e-6 + 1e-12).all()


@pytest.mark.parametrize("cuts", [(1,), (1, 2), (200,), (7, 300, 499)])
def test_parts_give_what_the_whole_gives(cuts: tuple[int, ...]) -> None:
    values = np.random.default_rng(2).normal(size=(500, 4))
    first, *rest = np.split(values, cuts)
    ranges = JointRanges.of("abcd", first)
    for part in rest:
        ranges = ranges.extended(part)
    assert ranges.provenance() == JointRanges.of("abcd", values).provenance()


def test_through_json_and_back() -> None:
    ranges = JointRanges.of(NAMES, VALUES)
    back = JointRanges.from_provenance(json.loads(json.dumps(ranges.provenance())))
    assert back is not None
    assert back.provenance() == ranges.provenance()
    assert JointRanges.from_provenance({"options": {}}) is None


def test_the_same_in_single_and_double_precision() -> None:
    values = np.random.default_rng(3).normal(size=(50, 2))
    assert JointRanges.of(NAMES, values).crc == JointRanges.of(NAMES, values.astype(np.float32).astype(float)).crc


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        (None, "expected frames, and"),
        ([], "expected frames, and"),
        ({"frames": 3}, "expected frames, and"),
        ({"frames": 3, "joints": 5}, "expected frames, and"),
        ({"frames": 3, "joints": {"hip": [0, 1]}}, "expected frames, and"),
        ({"frames": 3, "joints": {"hip": [0, 1, 7]}}, "expected frames, and"),
        ({"frames": 3, "joints": {"hip": [0, 1, "xyz"]}}, "expected frames, and"),
        ({"frames": 3, "joints": {"hip": [0, "high", "00000000"]}}, "expected frames, and"),
        ({"frames": 3, "joints": {"hip": [0, 10**400, "00000000"]}}, "expected frames, and"),
        ({"frames": True, "joints": {}}, "frames: found True"),
        ({"frames": 0, "joints": {}}, "frames: found 0"),
        ({"frames": 3, "joints": {"hip": [2, 1, "00000000"]}}, "of hip: found \\[2.0, 1.0\\]"),
        ({"frames": 3, "joints": {"hip": [0, float("nan"), "00000000"]}}, "of hip: found"),
        ({"frames": 3, "joints": {"hip": [0, float("inf"), "00000000"]}}, "of hip: found"),
    ],
)
def test_an_entry_of_another_kind(entry: Any, message: str) -> None:
    with pytest.raises(InvalidDataError, match=f"^provenance.joint_ranges.*{message}"):
        JointRanges.from_provenance({"joint_ranges": entry})
