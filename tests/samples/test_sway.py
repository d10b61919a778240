"""The sway alone: its pace, its size, and that it is odd in time about the middles of the calibration poses."""

from __future__ import annotations

from dataclasses import astuple

import numpy as np
import pytest
from retarget.samples import tasks
from retarget.samples.sway import sway


def at(time: np.ndarray) -> np.ndarray:
    """(8, T): pelvis in m, trunk and head in rad."""
    return np.array(astuple(sway(time)))


@pytest.mark.parametrize("window", ["still", "tpose", "forward"])
def test_it_averages_out_over_every_calibration_pose(window: str) -> None:
    start, end = tasks.Calibration().windows[window]
    apart = np.linspace(0.0, (end - start) / 2, 50)
    assert at((start + end) / 2 + apart) == pytest.approx(-at((start + end) / 2 - apart), abs=1e-14)


def test_breathing_and_swaying_have_their_pace_and_size() -> None:
    """In 7.6 s there are two breaths, three sways and four quicker ones, and nothing else."""
    spectrum = 2 * np.abs(np.fft.rfft(at(np.arange(684) / 90))) / 684
    beats = np.array(
        [[0, 3, 0], [0, 0, 2], [0.25, 0.1, 0], [0, 0, 0.12], [0, 0.15, 0], [0.2, 0, 0.1], [0, 0.1, 0], [0, 0, 0.2]]
    )
    units = np.array([1e-3] * 2 + [np.pi / 180] * 6)
    assert spectrum[:, 2:5] == pytest.approx(beats * units[:, None], abs=1e-12)
    assert np.delete(spectrum, [2, 3, 4], axis=1).max() < 1e-12
    assert np.array([2, 3, 4]) / 7.6 == pytest.approx([0.25, 0.4, 0.5], abs=0.03)


def test_it_is_never_at_rest() -> None:
    time = np.linspace(0.0, 7.6, 7601)
    speed = np.abs(np.gradient(at(time), time, axis=1))[:, 1:-1]
    assert speed[:2].max(axis=0).min() > 0.001  # m/s, of the pelvis
    assert speed[:2].max() < 0.01
    assert np.degrees(speed[2:].max()) < 1.0
