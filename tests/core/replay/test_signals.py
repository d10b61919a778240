"""Small figures over time, by hand."""

from __future__ import annotations

import numpy as np
import pytest
from retarget.core import chunks
from retarget.core.replay.signals import Signal, held, larger, lasting, local_jumps, worst
from scipy.ndimage import median_filter


def test_worst_names_column_and_time() -> None:
    values = np.array([[0.0, 1.0], [3.0, 2.0], [3.0, 0.0]])
    found = worst(values, np.array([0.0, 0.5, 1.0]), ("a", "b"))
    assert (found.value, found.where, found.time_s, found.index) == (3.0, "a", 0.5, (1, 0))
    assert worst(np.zeros((2, 2)), np.array([0.0, 1.0]), ("a", "b")).time_s is None
    assert worst(np.zeros((2, 0)), np.array([0.0, 1.0]), ()).value == 0


def test_held_fills_the_first_frames() -> None:
    np.testing.assert_array_equal(held(np.array([[1.0], [2.0]]), 4), [[0], [0], [1], [2]])


def test_steady_motion_has_no_jump_and_a_step_has_its_own_height() -> None:
    time = np.arange(20) / 50
    steady = 3.0 * time[:, None]
    np.testing.assert_allclose(local_jumps(steady, time), 0, atol=1e-12)
    for at in (1, 2, 10, 18, 19):
        stepped = steady + 0.5 * (np.arange(20) >= at)[:, None]
        jumps = local_jumps(stepped, time)[:, 0]
        np.testing.assert_allclose(jumps[at - 1], 0.5, atol=1e-12)
        np.testing.assert_allclose(np.delete(jumps, at - 1), 0, atol=1e-12)


def test_a_gap_in_time_is_no_jump() -> None:
    time = np.delete(np.arange(20) / 50, [8, 9, 10])
    np.testing.assert_allclose(local_jumps(3.0 * time[:, None], time), 0, atol=1e-12)


def test_lasting_levels_peaks_and_keeps_plateaus() -> None:
    time = np.arange(12) / 10
    values = np.array([0, 0, 9, 0, 0, 5, 6, 7, 5, 0, 0, 8.0])
    np.testing.assert_array_equal(lasting(values, time, 0.3), [0, 0, 0, 0, 0, 5, 5, 5, 5, 0, 0, 0])
    np.testing.assert_array_equal(lasting(values, time, 0.1), values)
    np.testing.assert_array_equal(lasting(values[5:9], time[5:9], 60.0), [5, 5, 5, 5])
    np.testing.assert_array_equal(lasting(values[:1], time[:1], 1.0), [0])


@pytest.mark.parametrize("size", [1, 2, 4, 100])
@pytest.mark.parametrize("frames", [4, 5, 6, 7, 40])
def test_usual_step_is_the_median_of_five_that_the_ends_mirror(
    monkeypatch: pytest.MonkeyPatch, frames: int, size: int
) -> None:
    monkeypatch.setattr(chunks, "CHUNK_FRAMES", size)
    values, time = np.random.default_rng(frames).normal(size=(frames, 3)), np.arange(frames) / 64
    steps = np.diff(values, axis=0)
    usual = median_filter(steps, size=(5, 1), mode="mirror")
    np.testing.assert_array_equal(local_jumps(values, time), steps - usual)


def test_few_steps_have_no_usual_one() -> None:
    values, time = np.array([[0.0], [1.0], [5.0]]), np.arange(3) / 64
    for frames in (1, 2, 3):
        np.testing.assert_array_equal(local_jumps(values[:frames], time[:frames]), np.diff(values[:frames], axis=0))


def test_worst_of_two_parts() -> None:
    time, values = np.arange(6.0), np.array([[0.0], [2.0], [1.0], [2.0], [3.0], [3.0]])
    first, second, third = (worst(values[k : k + 2], time, ("a",), k) for k in (0, 2, 4))
    assert larger(first, second) == first == Signal(2.0, "a", 1.0, (1, 0))
    assert larger(larger(first, second), third) == worst(values, time, ("a",))
    assert larger(Signal(0.0), Signal(0.0)) == Signal(0.0)
