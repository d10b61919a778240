"""Windows of a motion that arrives in parts: the blocks are the whole's frames, each once, and do not depend on the parts."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from retarget.core import timebase
from retarget.core.errors import MotionError
from retarget.core.segments import SEGMENTS
from retarget.core.stream_windows import Blocks, Windows
from retarget.core.types import HumanMotion, Source

BLOCKS = Blocks(first_s=1.0, block_s=3.0, lead_s=2.0)
RATE_HZ, SECONDS = 20.0, 12.0


def motion_at(time: np.ndarray, sha256: str = "") -> HumanMotion:
    """A person who stands; the pelvis' height counts the seconds."""
    frames = len(time)
    position = np.full((frames, len(SEGMENTS), 3), np.nan)
    position[:, 0] = np.stack([np.zeros(frames), np.zeros(frames), time], axis=1)
    orientation = np.tile([1.0, 0.0, 0.0, 0.0], (frames, len(SEGMENTS), 1))
    return HumanMotion(time, SEGMENTS, orientation, position, source=Source("test", sha256=sha256))


WHOLE = motion_at(np.arange(round(SECONDS * RATE_HZ)) / RATE_HZ, "ab" * 32)


def in_parts(whole: HumanMotion, sizes: list[int]) -> Iterator[HumanMotion]:
    """`whole` in parts of these sizes, over and over; only the last knows the hash."""
    begin, number = 0, 0
    while begin < whole.frames:
        size = min(sizes[number % len(sizes)], whole.frames - begin)
        is_last = begin + size == whole.frames
        yield motion_at(whole.time[begin : begin + size], whole.source.sha256 if is_last else "")
        begin, number = begin + size, number + 1


@given(
    sizes=st.lists(st.integers(1, 300), min_size=1, max_size=4),
    start=st.none() | st.floats(0, 11),
    lasts=st.none() | st.floats(0.1, 12),
    rate_hz=st.none() | st.floats(2, 60),
)
@settings(max_examples=60, deadline=None)
def test_blocks_are_the_whole(
    sizes: list[int], start: float | None, lasts: float | None, rate_hz: float | None
) -> None:
    end = None if lasts is None else (start or 0.0) + lasts
    expected = timebase.cut(WHOLE, start, end)
    if rate_hz is not None:
        led = timebase.cut(WHOLE, float(expected.time[0]) - 5, float(expected.time[-1]) + 5)
        led = timebase.resample(led, rate_hz, anchor_s=float(expected.time[0]))
        expected = timebase.cut(led, float(expected.time[0]), float(expected.time[-1]))
    windows = list(Windows(in_parts(WHOLE, sizes), BLOCKS, start, end, rate_hz))
    blocks = [window.motion.time[window.wanted] for window in windows]
    np.testing.assert_allclose(np.concatenate(blocks), expected.time, rtol=0, atol=1e-9)
    heights = np.concatenate([window.motion.position[window.wanted, 0, 2] for window in windows])
    np.testing.assert_allclose(heights, expected.time, rtol=0, atol=1e-9)
    assert [window.is_last for window in windows] == [False] * (len(windows) - 1) + [True]
    assert windows[-1].source == WHOLE.source


@pytest.mark.parametrize("size", [1, 7, 64, 1000])
def test_windows_do_not_depend_on_the_parts(size: int) -> None:
    windows = list(Windows(in_parts(WHOLE, [size]), BLOCKS))
    # One second, then threes; two seconds around, as far as there are any.
    edges = [(w.motion.time[0], w.motion.time[w.wanted.start], w.motion.time[-1]) for w in windows]
    np.testing.assert_allclose(edges, [(0, 0, 3), (0, 1, 6), (2, 4, 9), (5, 7, 11.95), (8, 10, 11.95)], atol=1e-9)


def test_only_what_is_needed_is_asked_for() -> None:
    asked: list[float] = []

    def parts() -> Iterator[HumanMotion]:
        for part in in_parts(WHOLE, [10]):
            asked.append(float(part.time[-1]))
            yield part

    windows = iter(Windows(parts(), BLOCKS))
    next(windows)
    assert asked[-1] == pytest.approx(3.45)
    next(windows)
    assert asked[-1] == pytest.approx(6.45)


def test_a_gap_longer_than_a_block_and_its_surroundings() -> None:
    time = np.concatenate([np.arange(40) / RATE_HZ, 50.0 + np.arange(40) / RATE_HZ])
    windows = list(Windows(in_parts(motion_at(time), [30]), BLOCKS))
    np.testing.assert_array_equal(np.concatenate([w.motion.time[w.wanted] for w in windows]), time)
    behind = next(w for w in windows if w.motion.time[w.wanted.start] >= 50)
    assert behind.motion.time[behind.wanted.start - 1] == time[39]  # where the motion has to go on from
    assert windows[-1].is_last


def test_no_frame_is_wanted() -> None:
    with pytest.raises(MotionError, match=r"^no frame from 20 s; the recording runs from 0 s to 11\.95 s$"):
        list(Windows(in_parts(WHOLE, [50]), BLOCKS, start_s=20.0))
    with pytest.raises(MotionError, match=r"^no frame from 1\.01 s and until 1\.02 s; the recording runs"):
        list(Windows(in_parts(WHOLE, [50]), BLOCKS, start_s=1.01, end_s=1.02))


def test_a_fault_behind_the_wanted_frames_is_met() -> None:
    def parts() -> Iterator[HumanMotion]:
        yield from in_parts(WHOLE, [50])
        raise OSError("gone")

    with pytest.raises(OSError, match="gone"):
        list(Windows(parts(), BLOCKS, end_s=2.0))
