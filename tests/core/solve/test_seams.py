"""Where two windows meet: values at the ends of the fade, limits in between, speeds after it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from retarget.core import rotations
from retarget.core.solve.seams import Solved, faded, within_speed
from scipy.spatial.transform import Rotation, Slerp

RATE_HZ, SEAM_S = 50.0, 4.0


def windows(apart: float = 0.5, *, turn: float = 0.0) -> tuple[Solved, Solved]:
    """One from 0 to 8 s, one from 2 to 12 s, which are `apart` rad everywhere, and `turn` rad about z."""
    first, second = np.arange(401) / RATE_HZ, np.arange(100, 601) / RATE_HZ

    def solved(time: np.ndarray, more: float, angle: float) -> Solved:
        joints = np.stack([np.sin(time), np.cos(2 * time)], axis=1) + more
        base = rotations.exp(np.outer(0.1 * time + angle, [0.0, 0.0, 1.0]))
        return Solved(time, joints, base)

    return solved(first, 0.0, 0.0), solved(second, apart, turn)


def test_the_ends_of_a_fade() -> None:
    before, after = windows()
    found, apart = faded(before, after, SEAM_S, 2.0)
    assert apart == pytest.approx(0.5)
    written = found.time <= SEAM_S + 1e-9
    shared = np.isin(before.time, found.time[written])
    np.testing.assert_array_equal(found.joints[written], before.joints[shared])
    k = int(np.flatnonzero(written)[-1]) + 1
    np.testing.assert_array_equal(found.joints[k], before.joints[before.time == found.time[k]][0])
    later = found.time >= found.time[k] + 2.0
    np.testing.assert_array_equal(found.joints[later], after.joints[later])
    # A minimum-jerk change by 0.5 rad in 2 s: 15/8 of its mean speed at most, beside the motion's own.
    own = np.diff(np.stack([np.sin(found.time), np.cos(2 * found.time)], axis=1), axis=0)
    added = np.abs(np.diff(found.joints, axis=0) - own).max() * RATE_HZ
    assert added == pytest.approx(15 / 8 * 0.5 / 2.0, rel=1e-3)


def test_the_base_turns_along_the_shortest_arc() -> None:
    before, after = windows(turn=0.4)
    flipped = Solved(after.time, after.joints, -after.base_orientation if after.base_orientation is not None else None)
    found, _ = faded(before, flipped, SEAM_S, 2.0)
    assert found.base_orientation is not None
    assert before.base_orientation is not None
    assert (np.einsum("ti,ti->t", found.base_orientation[1:], found.base_orientation[:-1]) > 0).all()
    k = int(np.flatnonzero(found.time > SEAM_S + 1.0)[0])
    share = (found.time[k] - found.time[found.time > SEAM_S + 1e-9][0]) / 2.0
    share = share**3 * (10 - 15 * share + 6 * share**2)
    ends = np.stack([before.base_orientation[before.time == found.time[k]][0], after.base_orientation[k]])  # type: ignore[index]  # given above
    between = Slerp([0, 1], Rotation.from_quat(ends[:, [1, 2, 3, 0]]))(share)
    there = Rotation.from_quat(found.base_orientation[k, [1, 2, 3, 0]])
    assert (between.inv() * there).magnitude() < 1e-9


def test_a_short_overlap_and_none() -> None:
    before, after = windows()
    short = Solved(before.time[:211], before.joints[:211], before.base_orientation[:211])  # type: ignore[index]  # given above
    found, _ = faded(short, after, SEAM_S, 2.0)  # 0.2 s behind the seam are shared
    np.testing.assert_array_equal(found.joints[found.time > 4.2], after.joints[found.time > 4.2])
    none = Solved(before.time[:201], before.joints[:201], before.base_orientation[:201])  # type: ignore[index]  # given above
    found, apart = faded(none, after, SEAM_S, 2.0)
    assert apart == 0.0
    np.testing.assert_array_equal(found.joints[found.time > 4.0], after.joints[found.time > 4.0])


def test_posture_at_a_time() -> None:
    before, _ = windows()
    joints, base = before.at(1.0)
    np.testing.assert_array_equal(joints, before.joints[50])
    assert base is not None
    np.testing.assert_array_equal(before.at(1.005)[0], before.joints[50])
    np.testing.assert_array_equal(before.at(-1.0)[0], before.joints[0])


@given(seed=st.integers(0, 10_000), speed=st.floats(0.5, 20.0))
@settings(max_examples=40, deadline=None)
def test_speeds_hold_and_postures_stay_between(seed: int, speed: float) -> None:
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.uniform(0.005, 0.05, 120))
    joints = np.cumsum(rng.normal(size=(120, 3)) * 0.1, axis=0)
    limits = speed * np.array([1.0, 0.7, 1.3])
    seam = float(time[20])
    joints[:22] = joints[0]  # what is written, and the step behind it, is within the speeds
    found, shortened = within_speed(Solved(time, joints, None), seam, limits)
    ratio = np.abs(np.diff(found.joints, axis=0)) / np.diff(time)[:, None] / limits
    assert ratio.max() <= 1.0 + 1e-9
    np.testing.assert_array_equal(found.joints[:22], joints[:22])
    assert (found.joints >= joints.min(axis=0) - 1e-12).all()  # a box holds, and so does every other convex limit
    assert (found.joints <= joints.max(axis=0) + 1e-12).all()
    row = np.array([1.0, -2.0, 0.5])
    assert (found.joints @ row).max() <= (joints @ row).max() + 1e-9
    assert (shortened > 0) == bool((np.abs(np.diff(joints, axis=0)) > limits * np.diff(time)[:, None]).any())


def test_a_motion_within_its_speeds_is_left_alone() -> None:
    before, _ = windows()
    found, shortened = within_speed(before, SEAM_S, np.array([10.0, 10.0]))
    assert found is before
    assert shortened == 0
