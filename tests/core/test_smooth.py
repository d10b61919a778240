"""Zero-lag smoothing: its kernel, its ends, uneven times."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from retarget.core import timebase
from retarget.core.types import Array


class TestSmooth:
    time = np.arange(200) / 60
    window_s = 0.25

    def kernel(self) -> Array:
        impulse = np.zeros(200)
        impulse[100] = 1
        return timebase.smooth(self.time, impulse, self.window_s)

    def test_the_kernel_is_symmetric_positive_and_of_sum_one(self) -> None:
        kernel = self.kernel()
        inside = kernel[85:116]
        assert (inside > 0).all()
        assert np.array_equal(inside, inside[::-1])
        assert kernel.sum() == pytest.approx(1, abs=1e-15)
        assert not kernel[:85].any()
        assert not kernel[116:].any()
        flank = 1 - timebase.minimum_jerk(np.arange(16) / 16)  # zero one frame beyond the window
        assert np.abs(inside[15:] / inside[15] - flank).max() < 1e-14

    @pytest.mark.parametrize("frequency_hz", [0.5, 1.0, 3.0])
    def test_a_sine_keeps_its_phase(self, frequency_hz: float) -> None:
        """A symmetric kernel multiplies a sine by a real number, its cosine sum, and shifts nothing."""
        phase = 2 * np.pi * frequency_hz * self.time + 0.4
        gain = self.kernel()[85:116] @ np.cos(2 * np.pi * frequency_hz * np.arange(-15, 16) / 60)
        found = timebase.smooth(self.time, np.sin(phase), self.window_s)
        assert np.abs(found - gain * np.sin(phase))[15:-15].max() < 1e-14
        assert 0 < gain < 1

    def test_a_straight_line_stays_to_its_very_ends(self) -> None:
        line = np.stack([3 * self.time - 2, np.full(200, 0.7)], axis=1)
        assert np.abs(timebase.smooth(self.time, line, self.window_s) - line).max() < 1e-13

    @pytest.mark.parametrize("count", [3, 4, 10, 29])
    def test_clips_shorter_than_the_window(self, count: int) -> None:
        line = 3 * self.time[:count] - 2
        assert np.abs(timebase.smooth(self.time[:count], line, self.window_s) - line).max() < 1e-14

    @pytest.mark.parametrize("ends", ["reflect", "hold"])
    @given(
        values=npst.arrays(float, st.integers(3, 60), elements=st.floats(-1, 1, allow_subnormal=False)),
        window_s=st.floats(0, 0.5),
    )
    def test_it_never_leaves_the_range_of_the_original(self, ends: str, values: Array, window_s: float) -> None:
        found = timebase.smooth(self.time[: len(values)], values, window_s, ends=ends)  # type: ignore[arg-type]
        assert found.max() <= values.max() + 1e-14
        assert found.min() >= values.min() - 1e-14

    @given(
        values=npst.arrays(float, st.integers(3, 60), elements=st.floats(-1, 1, allow_subnormal=False)),
        window_s=st.floats(0, 0.5),
    )
    def test_held_ends_keep_the_largest_step(self, values: Array, window_s: float) -> None:
        found = timebase.smooth(self.time[: len(values)], values, window_s, ends="hold")
        assert np.abs(np.diff(found)).max() <= np.abs(np.diff(values)).max() + 1e-14

    def test_time_reversal_changes_nothing(self) -> None:
        values = np.random.default_rng(0).normal(size=(200, 2, 3))
        for ends in ("reflect", "hold"):
            forward = timebase.smooth(self.time, values, self.window_s, ends=ends)  # type: ignore[arg-type]
            backward = timebase.smooth(self.time, values[::-1], self.window_s, ends=ends)  # type: ignore[arg-type]
            assert np.abs(forward - backward[::-1]).max() < 1e-15
            assert forward.shape == values.shape

    @pytest.mark.parametrize(("frames", "window_s"), [(1, 0.25), (2, 0.25), (50, 0.0), (50, 0.005)])
    def test_nothing_to_average(self, frames: int, window_s: float) -> None:
        values = np.random.default_rng(0).normal(size=(frames, 2))
        found = timebase.smooth(self.time[:frames], values, window_s)
        assert np.array_equal(found, values)
        assert found is not values
