"""Smoothing whole clips: what limits held before hold after, also where frames come at uneven times."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from retarget.core.robot_model import RobotModel
from retarget.core.solve import clip
from retarget.core.solve.dynamical import Solution
from retarget.core.types import Array

FRAMES = 120


def uneven_times(seed: int) -> Array:
    """60 Hz, every frame early or late by up to 40 % of a step."""
    return (np.arange(FRAMES) + np.random.default_rng(seed).uniform(-0.4, 0.4, FRAMES)) / 60.0


def solution(joints: Array) -> Solution:
    frames = len(joints)
    return Solution(joints, None, np.zeros(frames, np.int8), np.ones(frames, np.int64), start=0, fallbacks=0)


TIMES = [*(uneven_times(seed) for seed in range(4)), 1.7e9 + np.arange(FRAMES) / 60.0]
"""The last is even but for what a clock that counts from 1970 rounds."""


@pytest.mark.parametrize("window_s", [0.02, 0.1, 0.25])
@pytest.mark.parametrize("seed", range(len(TIMES)))
def test_speed_limits_hold_at_uneven_times(model: Callable[[str], RobotModel], window_s: float, seed: int) -> None:
    """Joints at their full speed to and fro: the step of a short interval must not become the mean of the long ones beside it."""
    g1, time = model("g1"), TIMES[seed]
    fast = g1.velocity_limit * (1.0 - 1e-6)
    way = np.sign(np.sin(2 * np.pi * 1.3 * time[1:] + seed))[:, None]
    swinging = np.cumsum(np.concatenate([np.zeros((1, len(fast))), way * np.diff(time)[:, None] * fast]), axis=0)
    wide = replace(g1, lower=np.full(len(fast), -1e3), upper=np.full(len(fast), 1e3))
    smooth = clip.smoothed(time, solution(swinging), window_s, wide).joints
    assert np.abs(smooth - swinging).max() > 0.01
    speed = np.abs(np.diff(smooth, axis=0)) / np.diff(time)[:, None]
    assert (speed <= g1.velocity_limit).all()


def test_a_steady_motion_stays_what_it_is_at_uneven_times(model: Callable[[str], RobotModel]) -> None:
    g1, time = model("g1"), uneven_times(0)
    steady = g1.reference_posture + time[:, None] * 0.01
    inside = np.clip(steady, g1.lower, g1.upper)
    steady[:, (steady != inside).any(axis=0)] = g1.reference_posture[(steady != inside).any(axis=0)]
    np.testing.assert_allclose(clip.smoothed(time, solution(steady), 0.1, g1).joints, steady, atol=1e-12)
