"""Lengths of paths that geometry knows: circles, lines, pauses; with noise, outliers and gaps on top."""

from __future__ import annotations

import numpy as np
import pytest
from retarget.formats._path_length import sampled_path, steady_path

from tests.formats.tracker_logs import Array

RATE_HZ = 150.0
TIME = np.arange(round(60 * RATE_HZ)) / RATE_HZ
CIRCLE = 0.5 * np.stack([np.cos(0.2 * TIME), np.sin(0.2 * TIME), 2.0 + 0 * TIME], axis=1)
AROUND_M = 0.5 * 0.2 * TIME[-1]
EVERYWHERE = np.ones(len(TIME), bool)


def test_a_circle_is_as_long_as_its_arc() -> None:
    assert sampled_path(TIME, CIRCLE, EVERYWHERE) == pytest.approx(AROUND_M, rel=1e-6)
    assert steady_path(TIME, CIRCLE, EVERYWHERE) == pytest.approx(AROUND_M, rel=2e-3)


def test_a_straight_line_keeps_its_ends() -> None:
    line = TIME[:, None] * np.array([0.03, -0.04, 0.0])
    assert steady_path(TIME, line, EVERYWHERE) == pytest.approx(0.05 * TIME[-1], rel=1e-9)


def test_noise_and_outliers_are_no_way() -> None:
    """1 mm of noise on each axis is 0.34 m/s of way at 150 Hz where a tracker stands; ten outliers of 0.1 m, each 0.2 s long, 2 m more."""
    rng = np.random.default_rng(0)
    noisy = CIRCLE + rng.normal(0.0, 1e-3, CIRCLE.shape)
    for start in range(500, 8500, 800):
        noisy[start : start + 30] += [0.0, 0.0, 0.1]
    assert sampled_path(TIME, noisy, EVERYWHERE) > 3 * AROUND_M
    assert steady_path(TIME, noisy, EVERYWHERE) == pytest.approx(AROUND_M, rel=0.01)


def test_what_was_not_tracked_is_no_way() -> None:
    tracked = (TIME < 10.0) | (TIME > 40.0)
    jumping = np.where(((TIME > 10.0) & (TIME < 40.0))[:, None], 7.0, CIRCLE)
    expected = 0.1 * (9.99 + TIME[-1] - 40.01)
    assert sampled_path(TIME, jumping, tracked) == pytest.approx(expected, rel=1e-3)
    assert steady_path(TIME, jumping, tracked) == pytest.approx(expected, rel=3e-3)


@pytest.mark.parametrize("frames", [0, 1, 2, 3])
def test_short_recordings(frames: int) -> None:
    position: Array = np.arange(frames)[:, None] * np.array([0.01, 0.0, 0.0])
    expected = 0.01 * max(frames - 1, 0)
    for length in (sampled_path, steady_path):
        assert length(TIME[:frames], position, EVERYWHERE[:frames]) == pytest.approx(expected, abs=1e-12)
