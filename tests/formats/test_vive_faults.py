"""What goes wrong in tracker logs: rejected, interpolated, held, marked and counted, against closed forms and SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from retarget.core.errors import FormatError
from retarget.core.timebase import minimum_jerk
from retarget.core.types import TrackerRecording
from scipy.spatial.transform import Rotation, Slerp

from tests.formats.tracker_logs import POSE, in_house, path_length, poses, read, rotation, text, wandering, wide

RATE = 100
TIME = np.arange(300) / RATE
Z_UP = (0.1, -0.4, 1.2)
POSES = wandering(300, about=Z_UP)
# In the house's axes already, so that expectations need no map.
UP: dict[str, str] = {"up": "z"}


def warnings_of(recording: TrackerRecording, word: str) -> list[str]:
    return [line for line in recording.source.warnings if word in line]


def lost(start: int, stop: int, values: np.ndarray = POSES) -> np.ndarray:
    out = values.copy()
    out[start:stop] = np.nan
    return out


def interpolated(start: int, stop: int, values: np.ndarray = POSES) -> tuple[np.ndarray, Rotation]:
    """What SciPy makes of rows start … stop - 1 from their neighbours."""
    keys = np.array([start - 1, stop])
    fractions = np.arange(start, stop)
    turned = Slerp(keys, rotation(values[keys, 3:]))(fractions)
    position = np.stack([np.interp(fractions, keys, values[keys, axis]) for axis in range(3)], axis=1)
    return position, turned


@pytest.mark.parametrize("kind", ["not finite", "left out", "no number"])
def test_short_gaps_are_interpolated_and_marked(kind: str) -> None:
    start, stop = 100, 140
    content = wide(TIME, waist=lost(start, stop), chest=POSES)
    if kind == "left out":
        lines = content.split("\n")
        content = "\n".join(lines[: 1 + start] + lines[1 + stop :])
    elif kind == "no number":
        content = content.replace("nan", "")
    found = read(content, **UP)
    assert found.frames == len(TIME)
    position, turned = interpolated(start, stop)
    np.testing.assert_allclose(found.position[start:stop, 0], position, atol=1e-9)
    assert (rotation(found.orientation[start:stop, 0]) * turned.inv()).magnitude().max() < 1e-7
    assert (~found.tracked[:, 0]).sum() == stop - start
    assert not found.tracked[start:stop, 0].any()
    assert found.source.interpolated_frames == stop - start
    assert not warnings_of(found, "lost for longer")
    assert warnings_of(found, "waist: 40 of 300 frames not measured")


def test_long_gaps_hold_the_last_pose_and_blend_back() -> None:
    """From 1.00 s on lost, back at 1.80 s, 0.32 m away: 1.875 · 0.32 / 0.5 = 1.2 s of blend, and that reaches the end."""
    time = np.arange(500) / RATE
    values = poses(np.outer(time, [0.4, 0, 0]))
    found = read(wide(time, left_hand=lost(101, 180, values), chest=wandering(500, about=Z_UP)), **UP)
    x = found.position[:, 0, 0]
    np.testing.assert_allclose(x[:101], 0.4 * time[:101], atol=1e-15)
    np.testing.assert_allclose(x[101:180], 0.4 * time[100], atol=1e-15)
    held, measured = 0.4 * time[100], 0.4 * time[180:]
    duration = 1.875 * (measured[0] - held) / 0.5
    weight = minimum_jerk((time[180:] - time[179]) / duration)
    np.testing.assert_allclose(x[180:], held + weight * (measured - held), atol=1e-12)
    back = int(np.flatnonzero(weight == 1)[0]) + 180
    assert not found.tracked[101:back, 0].any()
    assert found.tracked[:101, 0].all()
    assert found.tracked[back:, 0].all()
    assert found.tracked[:, 1].all()
    # As continuous as the motion itself: neither holding nor coming back makes a step.
    assert np.abs(np.diff(x)).max() < (0.4 + 0.5 + 0.4) / RATE
    assert warnings_of(found, "left_hand: lost for longer than 0.5 s (1.00-1.80 s)")


def test_orientation_is_held_and_blended_too() -> None:
    time = np.arange(500) / RATE
    values = poses(np.zeros((500, 3)), Rotation.from_euler("z", 0.6 * time[:, None]))
    found = read(wide(time, left_hand=lost(101, 180, values), chest=wandering(500, about=Z_UP)), **UP)
    angle = rotation(found.orientation[:, 0]).as_rotvec()[:, 2]
    np.testing.assert_allclose(angle[101:180], 0.6 * time[100], atol=1e-12)
    np.testing.assert_allclose(angle[400:], 0.6 * time[400:], atol=1e-12)
    assert np.abs(np.diff(angle)).max() < (0.6 + 1.5 + 0.6) / RATE


def test_a_second_loss_during_the_blend_holds_what_was_reached() -> None:
    time = np.arange(800) / RATE
    values = poses(np.outer(time, [0.4, 0, 0]))
    values[100:200], values[230:330] = np.nan, np.nan
    found = read(wide(time, left_hand=values, chest=wandering(800, about=Z_UP)), **UP)
    x = found.position[:, 0, 0]
    assert np.ptp(x[229:330]) == 0
    assert 0.4 * time[99] < x[229] < 0.4 * time[229]
    assert np.abs(np.diff(x)).max() < 1.3 / RATE
    np.testing.assert_allclose(x[-1], 0.4 * time[-1])
    assert found.tracked[-1, 0]


def test_gaps_at_the_ends_hold_the_nearest_pose() -> None:
    found = read(wide(TIME, waist=lost(250, 300, lost(0, 80)), chest=POSES), **UP)
    np.testing.assert_array_equal(found.position[:80, 0], np.broadcast_to(POSES[80, :3], (80, 3)))
    np.testing.assert_array_equal(found.position[250:, 0], np.broadcast_to(POSES[249, :3], (50, 3)))
    assert found.tracked[:, 0].tolist() == [80 <= i < 250 for i in range(300)]
    assert warnings_of(found, "lost for longer than 0.5 s (0.00-0.80 s")


@pytest.mark.parametrize("length", [0.0, 0.03, 0.98, 1.02, 3.0])
def test_bad_quaternions_are_rejected_never_normalised(length: float) -> None:
    values = POSES.copy()
    values[[50, 51, 200], 3:] *= length
    found = read(wide(TIME, waist=values), **UP)
    position, turned = interpolated(50, 52)
    np.testing.assert_array_equal(found.position[:, 0], POSES[:, :3])
    assert (rotation(found.orientation[50:52, 0]) * turned.inv()).magnitude().max() < 1e-12
    assert np.flatnonzero(~found.tracked[:, 0]).tolist() == [50, 51, 200]
    assert warnings_of(found, "waist: 3 quaternions rejected, length off by more than 0.01")
    assert np.abs(position - POSES[50:52, :3]).max() < 1e-3


def test_rounded_quaternions_are_taken() -> None:
    values = POSES.copy()
    values[:, 3:] = np.round(values[:, 3:], 3)
    found = read(wide(TIME, waist=values), **UP)
    assert found.tracked.all()
    assert found.source.warnings == ()


def test_held_samples_are_interpolated() -> None:
    """A tracker of 50 Hz logged at 100 Hz: every second row repeats the one before."""
    values = POSES[np.arange(300) // 2 * 2]
    found = read(wide(TIME, waist=values), **UP)
    expected = np.stack(
        [np.interp(np.arange(299), np.arange(0, 300, 2), POSES[::2, axis]) for axis in range(3)], axis=1
    )
    np.testing.assert_allclose(found.position[:299, 0], expected, atol=1e-12)
    assert found.tracked.all()
    assert path_length(found.position[:, 0]) == pytest.approx(path_length(values[:, :3]), rel=1e-12)
    assert warnings_of(found, "rows that repeat the pose before: waist 150 of 300")


def test_a_pose_that_stands_still_to_the_last_bit_is_kept_and_named() -> None:
    values = POSES.copy()
    values[100:200] = values[100]
    found = read(wide(TIME, waist=values), **UP)
    np.testing.assert_array_equal(found.position[:, 0], values[:, :3])
    assert warnings_of(found, "stood perfectly still, or the log froze: waist 1.00-1.99 s")


def test_jumps_are_named_and_kept() -> None:
    values = POSES.copy()
    values[120:, 0] += 0.035
    values[200, 1] += 0.2
    found = read(wide(TIME, waist=values), **UP)
    np.testing.assert_array_equal(found.position[:, 0], values[:, :3])
    assert warnings_of(found, "waist: 3 jumps over 30 mm between rows, at 1.200, 2.000, 2.010 s")


def test_a_fast_hand_does_not_jump() -> None:
    """A swing of 3.5 m/s at its fastest: 35 mm a row."""
    values = poses(np.outer(np.sin(7 * TIME), [0.5, 0, 0]))
    assert path_length(values[:2, :3]) > 0.03
    assert not warnings_of(read(wide(TIME, hand=values), **UP), "jump")


@pytest.mark.parametrize("what", [np.nan, np.inf, 1e300, -1e5])
def test_impossible_positions_are_not_measured(what: float) -> None:
    values = POSES.copy()
    values[77, 2] = what
    found = read(wide(TIME, waist=values), **UP)
    assert np.flatnonzero(~found.tracked[:, 0]).tolist() == [77]
    assert warnings_of(found, "waist: 1 rows with missing or impossible numbers")


@pytest.mark.parametrize("turn", [1.0, 0.0])
def test_the_origin_stands_for_a_lost_tracker(turn: float) -> None:
    values = POSES.copy()
    values[100:110] = [0, 0, 0, turn, 0, 0, 0]
    found = read(wide(TIME, waist=values), **UP)
    np.testing.assert_allclose(found.position[100:110, 0], interpolated(100, 110)[0], atol=1e-12)
    assert np.flatnonzero(~found.tracked[:, 0]).tolist() == list(range(100, 110))
    assert warnings_of(found, "waist: 10 rows at the origin, as written for a lost tracker")
    assert not warnings_of(found, "jump")


def test_the_origin_as_a_place_is_measured() -> None:
    values = poses(np.outer(np.sin(TIME), [0.1, 0, 0]))
    found = read(wide(TIME, waist=values, chest=poses(np.zeros((300, 3)))), **UP)
    np.testing.assert_array_equal(found.position[:, 0], values[:, :3])
    assert found.tracked.all()


@pytest.mark.parametrize(
    ("values", "why"),
    [
        (lost(0, 300), "is never tracked: of 300 rows 0 are marked invalid, 300 lack numbers"),
        (POSES * [1, 1, 1, 0, 0, 0, 0], "never has a usable quaternion"),
    ],
)
def test_a_tracker_never_tracked_is_an_error(values: np.ndarray, why: str) -> None:
    with pytest.raises(FormatError, match=f"log: tracker 'left_hand' {why}"):
        read(wide(TIME, waist=POSES, left_hand=values))


def test_time_going_backward_names_the_line() -> None:
    time = TIME.copy()
    time[120] = time[118]
    with pytest.raises(
        FormatError, match=r"log, line 122: time.* goes back from 1\.19 s to 1\.18 s; expected increasing times"
    ):
        read(wide(time, waist=POSES))
    time[120] = np.nan
    with pytest.raises(FormatError, match="line 122: the time is nan"):
        read(wide(time, waist=POSES))


def test_rows_of_one_time_are_counted_once() -> None:
    time = np.repeat(TIME[::2], 2)
    found = read(wide(time, waist=POSES), **UP)
    np.testing.assert_array_equal(found.position[:, 0], POSES[::2, :3])
    assert warnings_of(found, "waist: 150 rows with the time of the row before left out")


def test_uneven_times_go_onto_an_even_base() -> None:
    """A straight line stays one, wherever it is sampled."""
    rng = np.random.default_rng(3)
    time = np.cumsum(rng.uniform(0.002, 0.018, 400))
    velocity = np.array([0.3, -0.2, 0.1])
    turned = Rotation.from_euler("x", 2 * time[:, None])
    found = read(wide(time, waist=poses(np.outer(time, velocity), turned)), **UP)
    assert np.ptp(np.diff(found.time)) < 1e-9
    np.testing.assert_allclose(found.position[:, 0], np.outer(found.time, velocity), atol=1e-12)
    np.testing.assert_allclose(
        (rotation(found.orientation[:, 0]) * Rotation.from_euler("x", 2 * found.time[:, None]).inv()).magnitude(),
        0,
        atol=1e-7,
    )
    assert warnings_of(found, "interpolated onto an even")


def test_jitter_of_the_clock_is_left_alone() -> None:
    time = TIME + np.random.default_rng(1).uniform(-0.002, 0.002, 300)
    found = read(wide(time, waist=POSES), **UP)
    np.testing.assert_array_equal(found.time, time)
    np.testing.assert_array_equal(found.position[:, 0], POSES[:, :3])
    assert found.source.warnings == ()


def test_trackers_at_times_and_rates_of_their_own() -> None:
    velocity = np.array([0.3, -0.2, 0.1])
    clocks = {
        "waist": np.arange(0, 3, 0.01),
        "chest": 0.003 + np.arange(0, 3, 0.01),
        "LHR-1": np.arange(0.5, 2.5, 0.02),
    }
    rows = sorted(
        [[repr(float(t)), name, *poses(t * velocity)[0]] for name, clock in clocks.items() for t in clock],
        key=lambda row: float(row[0]),
    )
    found = read(text(["time", "device", *POSE], rows), **UP)
    assert found.rate_hz == pytest.approx(100)
    for name, clock in clocks.items():
        inside = (found.time >= clock[0]) & (found.time <= clock[-1])
        here = found.index(name)
        np.testing.assert_allclose(found.position[inside, here], np.outer(found.time[inside], velocity), atol=1e-9)
        assert found.tracked[inside, here].all()
        assert not found.tracked[~inside, here].any()
    assert warnings_of(found, "trackers log at 100, 50 Hz: interpolated onto an even 100 Hz")


def test_rows_left_out_of_the_long_form_are_a_gap() -> None:
    rows = [
        [repr(float(t)), name, *POSES[i]]
        for i, t in enumerate(TIME)
        for name in ("waist", "chest")
        if not (name == "chest" and 100 <= i < 120)
    ]
    found = read(text(["time", "device", *POSE], rows), **UP)
    np.testing.assert_array_equal(found.time, TIME)
    assert np.flatnonzero(~found.tracked[:, found.index("chest")]).tolist() == list(range(100, 120))
    np.testing.assert_allclose(found.position[100:120, 1], interpolated(100, 120)[0], atol=1e-12)


def test_a_row_far_away_in_time_is_refused() -> None:
    time = TIME.copy()
    time[-1] = 1e9
    with pytest.raises(FormatError, match=r"rows come every 0\.01 s but span 1e\+09 s"):
        read(wide(time, waist=POSES))


def test_a_single_row() -> None:
    found = read(wide(TIME[:1], waist=POSES[:1]))
    np.testing.assert_array_equal(found.position[0, 0], in_house(POSES[0, :3]))
    assert found.tracked.all()
