"""What is said of a recording's frames, for stamps that no clock shows."""

from __future__ import annotations

import warnings
from array import array

import pytest
from retarget.formats._ros_frames import Edge
from retarget.formats._ros_recording import _edge_line


@pytest.mark.parametrize(
    ("stamps", "line"),
    [
        ([], "waist in world 0 poses 0 Hz"),
        ([5], "waist in world 1 poses 0 Hz"),
        ([7, 7], "waist in world 2 poses 0 Hz"),
        ([20_000_000, 0, 10_000_000], "waist in world 3 poses 100 Hz"),
        ([-(2**63), 2**63 - 1], "waist in world 2 poses 5.421e-11 Hz"),
    ],
)
def test_rates_of_frames(stamps: list[int], line: str) -> None:
    """The last ones are 2⁶⁴ ns apart, which 64 bits don't hold."""
    edge = Edge("world", "waist", "/tf", 0, False, stamps=array("q", stamps))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert _edge_line(edge) == line
