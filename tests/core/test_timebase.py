"""Cutting, resampling and gaps on motions that are known in closed form."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from retarget.core import rotations, timebase
from retarget.core.errors import MotionError, UsageError
from retarget.core.segments import SEGMENTS
from retarget.core.types import Array, HumanMotion

MotionFactory = Callable[..., HumanMotion]
AXIS = np.array([2.0, -1.0, 2.0]) / 3
RATE_RAD_S = 2.5
DRIFT_M_S = np.array([0.7, -0.2, 0.1])


def walk_and_spin(make_motion: MotionFactory, time: Array, **fields: object) -> HumanMotion:
    """Everything turns as one body at a constant rate about AXIS while the pelvis moves straight: linear in every respect."""
    spin = rotations.exp(RATE_RAD_S * time[:, None] * AXIS)
    still = {name: [1.0, 0, 0, 0] for name in SEGMENTS}
    return make_motion(time, {**still, "Head": spin, "LeftHand": spin}, pelvis=time[:, None] * DRIFT_M_S, **fields)


def still(time: Array) -> HumanMotion:
    """One segment that does nothing."""
    return HumanMotion(time, ("Pelvis",), np.tile([1.0, 0, 0, 0], (len(time), 1, 1)), np.zeros((len(time), 1, 3)))


class TestCut:
    @pytest.mark.parametrize("rate_hz", [30, 50, 60, 72, 90, 100, 120, 148.8, 240])
    def test_whole_seconds_keep_both_boundary_frames_at_every_rate(
        self, make_motion: MotionFactory, rate_hz: float
    ) -> None:
        time = np.cumsum(np.full(round(4 * rate_hz), 1 / rate_hz))  # summing collects rounding, as clocks do
        start, end = time[round(rate_hz)], time[round(2 * rate_hz)]
        found = timebase.cut(make_motion(time), round(start, 6), round(end, 6))
        assert np.array_equal(found.time, time[round(rate_hz) : round(2 * rate_hz) + 1])

    def test_the_clock_is_kept_and_every_field_is_cut(self, make_motion: MotionFactory) -> None:
        time = 5 + np.arange(100) / 50
        contacts = np.arange(400).reshape(100, 4) % 3 == 0
        omega = np.random.default_rng(1).normal(size=(100, 23, 3))
        motion = walk_and_spin(make_motion, time, foot_contacts=contacts, angular_velocity=omega)
        found = timebase.cut(motion, 5.5, 6.0)
        rows = slice(25, 51)
        assert np.array_equal(found.time, time[rows])
        assert np.array_equal(found.orientation, motion.orientation[rows])
        assert np.array_equal(found.position, motion.position[rows])
        assert found.angular_velocity is not None
        assert found.foot_contacts is not None
        assert np.array_equal(found.angular_velocity, omega[rows])
        assert np.array_equal(found.foot_contacts, contacts[rows])
        assert found.segments == motion.segments
        assert found.source == motion.source

    def test_open_ends(self, make_motion: MotionFactory) -> None:
        motion = make_motion(np.arange(10) / 10)
        assert np.array_equal(timebase.cut(motion, None, None).time, motion.time)
        assert timebase.cut(motion, 0.35, None).time[0] == 0.4
        assert timebase.cut(motion, None, 0.35).time[-1] == pytest.approx(0.3)
        assert timebase.cut(motion, -3, 99).frames == 10

    def test_no_copy_is_made(self, make_motion: MotionFactory) -> None:
        motion = make_motion(np.arange(10) / 10)
        assert np.shares_memory(timebase.cut(motion, 0.2, 0.5).orientation, motion.orientation)

    def test_a_single_frame_may_be_left(self, make_motion: MotionFactory) -> None:
        assert timebase.cut(make_motion(np.arange(10) / 10), 0.5, 0.5).time.tolist() == [0.5]

    def test_nothing_left(self, make_motion: MotionFactory) -> None:
        motion = make_motion(np.arange(11) / 10)
        for limits, message in (
            ((2.0, None), "no frame from 2 s; the recording runs from 0 s to 1 s"),
            ((None, -1.0), "no frame until -1 s; the recording runs from 0 s to 1 s"),
            ((0.41, 0.49), "no frame from 0.41 s and until 0.49 s; the recording runs from 0 s to 1 s"),
        ):
            with pytest.raises(MotionError) as caught:
                timebase.cut(motion, *limits)
            assert str(caught.value) == message

    def test_end_before_start(self, make_motion: MotionFactory) -> None:
        with pytest.raises(UsageError, match=r"^end 0\.2 s is before start 0\.5 s$"):
            timebase.cut(make_motion(np.arange(11) / 10), 0.5, 0.2)


class TestResample:
    @pytest.mark.parametrize("rate_hz", [7.0, 24.0, 60.0, 59.94, 100.0, 133.7, 1000.0])
    def test_linear_motions_are_reproduced_exactly_at_any_rate(
        self, make_motion: MotionFactory, rate_hz: float
    ) -> None:
        """Constant velocity and constant angular velocity are what linear interpolation and slerp are exact for."""
        time = 3 + np.cumsum(np.random.default_rng(0).uniform(0.005, 0.03, size=200))  # jittering frame times
        spin_rate = np.tile(RATE_RAD_S * AXIS, (200, 23, 1)) * time[:, None, None]
        found = timebase.resample(walk_and_spin(make_motion, time, angular_velocity=spin_rate), rate_hz)
        expected = walk_and_spin(make_motion, found.time)
        assert np.abs(found.time - (time[0] + np.arange(found.frames) / rate_hz)).max() < 1e-9
        assert time[-1] - 1 / rate_hz < found.time[-1] <= time[-1]
        assert np.abs(found.position - expected.position).max() < 1e-13
        assert rotations.angle(found.orientation, expected.orientation).max() < 1e-13
        assert found.angular_velocity is not None
        assert np.abs(found.angular_velocity - RATE_RAD_S * AXIS * found.time[:, None, None]).max() < 1e-12

    @given(
        count=st.integers(2, 400),
        old_hz=st.sampled_from([25.0, 60.0, 90.0, 120.0, 148.8, 240.0]),
        new_hz=st.floats(0.5, 500),
        start=st.sampled_from([0.0, 1e4]),
    )
    def test_never_beyond_the_recording_and_no_frame_short(
        self, count: int, old_hz: float, new_hz: float, start: float
    ) -> None:
        time = start + np.arange(count) / old_hz
        found = timebase.resample(still(time), new_hz).time
        assert found[0] == time[0]
        assert found[-1] <= time[-1]
        assert time[-1] - found[-1] < 1 / new_hz
        assert len(found) == 1 or np.abs(np.diff(found) - 1 / new_hz).max() < 1.1e-6 / new_hz + 1e-11

    @given(new_hz=st.floats(0.5, 300), anchor=st.floats(0, 199 / 60))
    def test_a_frame_falls_on_the_anchor(self, new_hz: float, anchor: float) -> None:
        """Whatever the part of a clip: all of its frames that an anchored grid has, and no other."""
        time = np.arange(200) / 60
        found = timebase.resample(still(time), new_hz, anchor_s=anchor).time
        assert np.abs(found - anchor).min() < 1e-9
        steps = (found - anchor) * new_hz
        assert np.abs(steps - np.round(steps)).max() < 2e-6
        assert 0 <= found[0] < 1 / new_hz
        assert time[-1] - 1 / new_hz < found[-1] <= time[-1]

    @pytest.mark.parametrize("rate_hz", [60, 148.8, 240])
    def test_anchored_at_any_frame_the_own_rate_changes_nothing(self, rate_hz: float) -> None:
        """Rounding of the frame times must not cost the first frame or the last."""
        motion = still(5 + np.cumsum(np.full(200, 1 / rate_hz)))
        for anchor in motion.time:
            assert timebase.resample(motion, rate_hz, anchor_s=anchor) is motion

    def test_a_frame_that_rounding_puts_beyond_the_end_falls_on_the_end(self) -> None:
        time = 5 + np.arange(61) / 60
        found = timebase.resample(still(time), 30 - 5e-7).time  # 30 steps fit but for half a millionth
        assert len(found) == 31
        assert found[-1] == time[-1]

    def test_an_anchor_outside(self, make_motion: MotionFactory) -> None:
        with pytest.raises(UsageError, match=r"^anchor 1\.5 s; expected a time from 0 s to 1 s$"):
            timebase.resample(make_motion([0.0, 1.0]), 60, anchor_s=1.5)

    @pytest.mark.parametrize("rate_hz", [60, 148.8, 240])
    def test_the_recordings_own_rate_changes_nothing(self, make_motion: MotionFactory, rate_hz: float) -> None:
        milliseconds = make_motion(np.arange(300) / rate_hz)
        assert timebase.resample(milliseconds, rate_hz) is milliseconds
        summed = make_motion(np.cumsum(np.full(300, 1 / rate_hz)))
        assert timebase.resample(summed, rate_hz) is summed

    def test_halving_the_rate_takes_every_second_frame(self, make_motion: MotionFactory) -> None:
        angle = np.cumsum(np.random.default_rng(3).normal(scale=0.3, size=(121, 3)), axis=0)
        motion = make_motion(np.arange(121) / 120, {"T8": rotations.exp(angle)})
        found = timebase.resample(motion, 60)
        assert found.frames == 61
        assert rotations.angle(found.orientation, motion.orientation[::2]).max() < 1e-7
        assert np.abs(found.position - motion.position[::2]).max() < 1e-7

    def test_contacts_come_from_the_nearest_frame(self, make_motion: MotionFactory) -> None:
        contacts = np.array([[True], [False], [False], [True], [True]]) & np.ones(4, bool)
        motion = make_motion([0, 1, 2, 3, 4.0], foot_contacts=contacts)
        found = timebase.resample(motion, 2.5)  # frames at 0, 0.4, 0.8 … 4.0
        nearest = np.abs(found.time[:, None] - motion.time).argmin(axis=1)
        assert found.foot_contacts is not None
        assert np.array_equal(found.foot_contacts, contacts[nearest])
        assert found.foot_contacts[:3, 0].tolist() == [True, True, False]

    def test_fast_turns_stay_continuous_in_sign(self, make_motion: MotionFactory) -> None:
        time = np.arange(50) / 10
        spin = rotations.exp(25.0 * time[:, None] * AXIS)  # 2.5 rad a frame, just short of half a turn
        found = timebase.resample(make_motion(time, {"Head": spin}), 77)
        truth = rotations.exp(25.0 * found.time[:, None] * AXIS)
        assert rotations.angle(found.orientation[:, found.index("Head")], truth).max() < 1e-12

    def test_a_spin_of_more_than_half_a_turn_between_the_new_frames(self, make_motion: MotionFactory) -> None:
        time = np.arange(120) / 60
        found = timebase.resample(make_motion(time, {"Head": rotations.exp(20.0 * time[:, None] * AXIS)}), 5)
        truth = rotations.exp(
            20.0 * found.time[:, None] * AXIS
        )  # 4 rad a frame: neighbours lie in opposite hemispheres
        assert (np.einsum("ti,ti->t", truth[1:], truth[:-1]) < 0).any()
        assert rotations.angle(found.orientation[:, found.index("Head")], truth).max() < 1e-12

    def test_untracked_stays_untracked(self, make_motion: MotionFactory) -> None:
        position = np.zeros((5, 23, 3))
        position[:, 4] = np.nan
        found = timebase.resample(make_motion(np.arange(5.0), position=position), 3)
        assert np.isnan(found.position[:, 4]).all()
        assert np.isfinite(np.delete(found.position, 4, axis=1)).all()

    def test_one_frame_stays_one_frame(self, make_motion: MotionFactory) -> None:
        motion = make_motion([2.0])
        assert timebase.resample(motion, 100) is motion

    def test_slower_than_the_recording_is_long(self, make_motion: MotionFactory) -> None:
        assert timebase.resample(make_motion(np.arange(10) / 10), 0.5).time.tolist() == [0.0]

    @pytest.mark.parametrize("rate_hz", [0.0, -60.0, np.nan, np.inf])
    def test_rates_that_are_none(self, make_motion: MotionFactory, rate_hz: float) -> None:
        with pytest.raises(UsageError, match=r"^rate (0|-60|nan|inf) Hz; expected a positive number$"):
            timebase.resample(make_motion([0.0, 1.0]), rate_hz)

    @pytest.mark.parametrize("rate_hz", [1e9, 1e300])
    def test_rates_that_no_memory_holds(self, make_motion: MotionFactory, rate_hz: float) -> None:
        # 4 GiB of 23 quaternions of 32 bytes.
        with pytest.raises(UsageError, match=r"frames; expected at most 5,835,553$"):
            timebase.resample(make_motion([0.0, 1.0, 1e9]), rate_hz)


class TestFillGaps:
    time = np.arange(11) / 10

    def test_straight_lines_are_filled_exactly(self) -> None:
        truth = np.stack([2 * self.time - 1, 5 - self.time], axis=1)
        holed = truth.copy()
        holed[3], holed[6:8, 1], holed[8, 0] = np.nan, np.inf, -np.inf
        found, filled = timebase.fill_gaps(self.time, holed, longest_s=0.5)
        assert np.flatnonzero(filled).tolist() == [3, 6, 7, 8]
        assert np.abs(found - truth).max() < 1e-14
        assert np.isnan(holed[3]).all(), "the argument is left alone"

    def test_uneven_times(self) -> None:
        found, _ = timebase.fill_gaps([0, 1, 4, 5.0], np.array([[0], [np.nan], [np.nan], [10.0]]), longest_s=5)
        assert found[:, 0].tolist() == pytest.approx([0, 2, 8, 10])

    def test_ends_hold_the_nearest_row(self) -> None:
        values = np.stack([self.time, self.time**2], axis=1)
        holed = values.copy()
        holed[:2], holed[9:] = np.nan, np.nan
        found, filled = timebase.fill_gaps(self.time, holed, longest_s=0.2)
        assert filled.sum() == 4
        assert np.array_equal(found[:2], values[[2, 2]])
        assert np.array_equal(found[9:], values[[8, 8]])

    def test_constant_rates_of_turn_are_filled_exactly_whatever_the_signs(self) -> None:
        truth = rotations.exp(5.0 * self.time[:, None] * AXIS)
        holed = truth.copy()
        holed[0] = holed[4:7] = np.nan
        holed[7:] *= -1  # the other quaternion of the same rotation: the short way must still be taken
        found, _ = timebase.fill_gaps(self.time, holed, longest_s=1, quaternions=True)
        assert rotations.angle(found[1:], truth[1:]).max() < 1e-14
        assert rotations.angle(found[0], truth[1]) < 1e-15
        assert np.abs(np.linalg.norm(found, axis=1) - 1).max() < 1e-15

    def test_nothing_missing(self) -> None:
        values = np.random.default_rng(0).normal(size=(11, 3))
        found, filled = timebase.fill_gaps(self.time, values, longest_s=0)
        assert np.array_equal(found, values)
        assert not filled.any()

    @pytest.mark.parametrize(
        ("missing", "length_s", "start_s"),
        [(slice(3, 6), 0.4, 0.2), (slice(0, 4), 0.4, 0.0), (slice(7, 11), 0.4, 0.6)],
        ids=["inside", "start", "end"],
    )
    def test_the_longest_gap_allowed(self, missing: slice, length_s: float, start_s: float) -> None:
        """From good frame to good frame; at an end, from that end to the nearest good frame."""
        values = np.ones((11, 1))
        values[missing] = np.nan
        found, _ = timebase.fill_gaps(self.time, values, longest_s=length_s)
        assert np.array_equal(found, np.ones((11, 1)))
        with pytest.raises(MotionError) as caught:
            timebase.fill_gaps(self.time, values, longest_s=length_s - 0.01)
        assert str(caught.value) == (
            f"values missing for {length_s:g} s from {start_s:.3f} s on; gaps up to {length_s - 0.01:g} s are interpolated"
        )

    @pytest.mark.parametrize("frames", range(2, 40))
    def test_rounding_of_frame_times_decides_nothing(self, frames: int) -> None:
        """A gap of exactly the longest length is filled at every place of a 60 Hz clock."""
        time = 100 + np.arange(200) / 60
        for start in range(1, 150, 7):
            values = np.ones((200, 1))
            values[start : start + frames - 1] = np.nan
            timebase.fill_gaps(time, values, longest_s=frames / 60)
            with pytest.raises(MotionError):
                timebase.fill_gaps(time, values, longest_s=(frames - 0.5) / 60)

    def test_the_worst_of_several_gaps_is_named(self) -> None:
        values = np.ones((11, 1))
        values[[1, 4, 5, 6, 9]] = np.nan
        with pytest.raises(MotionError, match=r"^values missing for 0\.4 s from 0\.300 s on; gaps up to 0\.1 s"):
            timebase.fill_gaps(self.time, values, longest_s=0.1)

    def test_no_good_row_at_all(self) -> None:
        with pytest.raises(MotionError, match=r"^no frame holds finite values$"):
            timebase.fill_gaps(self.time, np.full((11, 4), np.nan), longest_s=99, quaternions=True)


class TestMinimumJerk:
    def test_values(self) -> None:
        assert timebase.minimum_jerk([-1, 0, 0.5, 1, 2]).tolist() == [0, 0, 0.5, 1, 1]
        assert timebase.minimum_jerk(0.25) == pytest.approx(10 / 64 - 15 / 256 + 6 / 1024)

    def test_velocity_and_acceleration_vanish_at_both_ends(self) -> None:
        """Near an end the curve is of third order: 10 h³ away from it."""
        h = np.array([1e-2, 1e-3, 1e-4])
        assert timebase.minimum_jerk(h) / h**3 == pytest.approx([10, 10, 10], rel=0.02)
        assert (1 - timebase.minimum_jerk(1 - h)) / h**3 == pytest.approx([10, 10, 10], rel=0.02)

    def test_it_is_the_quintic_with_these_ends(self) -> None:
        rows = [
            [1 if k == d else 0 for k in range(6)] for d in range(3)
        ]  # value, slope, second derivative (halved) at 0
        rows += [[1] * 6, list(range(6)), [k * (k - 1) for k in range(6)]]  # the same at 1
        coefficients = np.linalg.solve(rows, [0, 0, 0, 1, 0, 0])
        s = np.linspace(0, 1, 21)
        assert np.abs(timebase.minimum_jerk(s) - np.polyval(coefficients[::-1], s)).max() < 1e-13


@pytest.mark.parametrize(
    ("mask", "expected"),
    [
        ("", []),
        ("....", []),
        ("####", [(0, 3)]),
        ("#..#", [(0, 0), (3, 3)]),
        (".##.#", [(1, 2), (4, 4)]),
    ],
)
def test_runs(mask: str, expected: list[tuple[int, int]]) -> None:
    assert timebase.runs(np.array([mark == "#" for mark in mask], bool)) == expected


def test_rate_of_change_never_exceeds_the_largest_step() -> None:
    """At uneven times the derivative of a straight line is its slope, and of anything no more than a step's own."""
    rng = np.random.default_rng(4)
    time = np.cumsum(rng.uniform(0.001, 0.1, 50))
    slope = np.array([2.0, -3.0])
    np.testing.assert_allclose(timebase.rate_of_change(time, time[:, None] * slope), np.tile(slope, (50, 1)))
    values = rng.normal(size=(50, 4))
    steps = np.abs(np.diff(values, axis=0) / np.diff(time)[:, None]).max(axis=0)
    assert (np.abs(timebase.rate_of_change(time, values)) <= steps * (1 + 1e-12)).all()
    np.testing.assert_array_equal(timebase.rate_of_change(time[:1], values[:1]), np.zeros((1, 4)))
