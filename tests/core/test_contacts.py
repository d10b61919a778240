"""Contacts of feet that are known to stand and swing in closed form."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from retarget.core import contacts
from retarget.core.segments import SEGMENTS
from retarget.core.timebase import minimum_jerk
from retarget.core.types import Array, BoolArray, HumanMotion

MotionFactory = Callable[..., HumanMotion]

PERIOD_S = 1.1
STRIDE_M = 1.3
LIFT_M = 0.12
SWINGS = {
    # Phase of the cycle (in periods) at which the point leaves the ground, and for how long.
    "LeftFoot": (0.60, 0.40),
    "LeftToe": (0.68, 0.30),
    "RightFoot": (0.10, 0.40),
    "RightToe": (0.18, 0.30),
}
STANDING_HEIGHT_M = {"Foot": 0.09, "Toe": 0.0}


def foot_point(time: Array, name: str) -> tuple[Array, BoolArray, Array]:
    """Path (T, 3) m of a point that stands still, swings one stride forward and stands again; whether it stands; s to the next change."""
    leaves, lasts = SWINGS[name]
    cycle = time / PERIOD_S - leaves
    phase = np.clip(np.mod(cycle, 1.0) / lasts, 0, 1)
    path = np.zeros((len(time), 3))
    path[:, 0] = STRIDE_M * (np.floor(cycle) + minimum_jerk(phase))
    path[:, 2] = (
        STANDING_HEIGHT_M[name.removeprefix("Left").removeprefix("Right")] + LIFT_M * np.sin(np.pi * phase) ** 2
    )
    into = np.mod(cycle, 1.0) * PERIOD_S
    edges = np.array([0.0, lasts * PERIOD_S, PERIOD_S])
    return path, phase == 1.0, np.abs(into[:, None] - edges).min(axis=1)


def walking(make_motion: MotionFactory, rate_hz: float) -> HumanMotion:
    motion = make_motion(np.arange(round(8 * rate_hz)) / rate_hz)
    position = np.array(motion.position)
    for name in SWINGS:
        position[:, motion.index(name)] = foot_point(motion.time, name)[0]
    return replace(motion, position=position)


@pytest.mark.parametrize("rate_hz", [60.0, 100.0, 240.0])
def test_walking(make_motion: MotionFactory, rate_hz: float) -> None:
    """Right everywhere but within 40 ms of lift-off and touch-down, where the foot is still as low and slow as a standing one."""
    motion = walking(make_motion, rate_hz)
    found = contacts.detect(motion)
    assert found is not None
    for column, name in enumerate(("LeftFoot", "LeftToe", "RightFoot", "RightToe")):
        _, stands, from_change = foot_point(motion.time, name)
        clear = from_change > 0.04
        assert clear.mean() > 0.8
        assert np.array_equal(found[clear, column], stands[clear]), name
        assert np.count_nonzero(np.diff(found[:, column].astype(int))) == np.count_nonzero(np.diff(stands.astype(int)))


@pytest.mark.parametrize("floor_m", [-3.0, 0.8])
def test_the_floor_may_lie_anywhere(make_motion: MotionFactory, floor_m: float) -> None:
    motion = walking(make_motion, 100.0)
    raised = replace(motion, position=motion.position + np.array([0, 0, floor_m]))
    expected = contacts.detect(motion)
    assert expected is not None
    assert np.array_equal(contacts.detect(raised), expected)


def test_standing(make_motion: MotionFactory) -> None:
    found = contacts.detect(make_motion(np.arange(100) / 60))
    assert found is not None
    assert found.shape == (100, 4)
    assert found.all()
    single = contacts.detect(make_motion([0.0]))
    assert single is not None
    assert single.all()


def test_a_foot_held_in_the_air_throughout_does_not_stand(make_motion: MotionFactory) -> None:
    motion = make_motion(np.arange(100) / 60)
    position = np.array(motion.position)
    position[:, [motion.index("RightFoot"), motion.index("RightToe")]] += [0.1, 0, 0.25]
    found = contacts.detect(replace(motion, position=position))
    assert found is not None
    assert found.all(axis=0).tolist() == [True, True, False, False]
    assert not found[:, 2:].any()


def test_centimetres_between_the_feet_are_the_recordings_error(make_motion: MotionFactory) -> None:
    motion = make_motion(np.arange(100) / 60)
    position = np.array(motion.position)
    position[:, [motion.index("RightFoot"), motion.index("RightToe")]] += [0, 0, 0.03]
    found = contacts.detect(replace(motion, position=position))
    assert found is not None
    assert found.all()


def test_sliding_is_not_standing(make_motion: MotionFactory) -> None:
    time = np.arange(120) / 60
    for speed, stands in ((0.3, True), (0.4, False)):
        found = contacts.detect(make_motion(time, pelvis=time[:, None] * [speed, 0, 0]))
        assert found is not None
        assert found.all() == stands
        assert found.any() == stands


def test_tiptoe(make_motion: MotionFactory) -> None:
    """Heels up for a second: the ankles rise, the balls of the feet stay."""
    motion = make_motion(np.arange(180) / 60)
    position = np.array(motion.position)
    risen = 0.07 * minimum_jerk((motion.time - 1) / 0.3) * minimum_jerk((2 - motion.time) / 0.3)
    for name in ("LeftFoot", "RightFoot"):
        position[:, motion.index(name), 2] += risen
    found = contacts.detect(replace(motion, position=position))
    assert found is not None
    assert found[:, [1, 3]].all()
    assert not found[risen > 0.045][:, [0, 2]].any()
    assert found[risen == 0][:, [0, 2]].all()


class TestWhatTheRecordingSays:
    def test_its_own_contacts_come_first(self, make_motion: MotionFactory) -> None:
        given = np.arange(400).reshape(100, 4) % 3 == 0
        motion = make_motion(np.arange(100) / 60, foot_contacts=given)
        assert contacts.foot_contacts(motion) is motion.foot_contacts
        assert np.array_equal(given, motion.foot_contacts)  # type: ignore[arg-type]  # just made of them

    def test_without_them_they_are_detected(self, make_motion: MotionFactory) -> None:
        found = contacts.foot_contacts(make_motion(np.arange(100) / 60))
        assert found is not None
        assert found.all()

    @pytest.mark.parametrize("foot", ["LeftFoot", "RightFoot"])
    def test_no_contacts_of_feet_that_were_not_measured(self, make_motion: MotionFactory, foot: str) -> None:
        measured = np.array([name != foot for name in SEGMENTS])
        motion = make_motion(np.arange(9) / 60, measured=measured, foot_contacts=np.ones((9, 4), bool))
        assert contacts.foot_contacts(motion) is None

    def test_no_contacts_of_feet_that_were_not_tracked(self, make_motion: MotionFactory) -> None:
        position = np.array(make_motion(np.arange(9) / 60).position)
        position[:, SEGMENTS.index("RightToe")] = np.nan
        motion = make_motion(np.arange(9) / 60, position=position)
        assert contacts.foot_contacts(motion) is None

    def test_where_a_toe_is_missing_both_feet_are_judged_by_the_ankle(self, make_motion: MotionFactory) -> None:
        motion = walking(make_motion, 100.0)
        bare = replace(motion, measured=np.array([name != "RightToe" for name in SEGMENTS]))
        found, whole = contacts.foot_contacts(bare), contacts.foot_contacts(motion)
        assert found is not None
        assert whole is not None
        assert np.array_equal(found, whole[:, [0, 0, 2, 2]])


class TestChatter:
    """At 60 Hz whatever lasts less than three frames (50 ms) is chatter."""

    def debounced(self, text: str, rate_hz: float = 60.0) -> str:
        found = contacts._debounced(np.array([c == "#" for c in text]), rate_hz)
        return "".join("#" if contact else "." for contact in found)

    @pytest.mark.parametrize(
        ("before", "after"),
        [
            ("####..####", "##########"),
            ("####...###", "####...###"),
            ("....##....", ".........."),
            ("....###...", "....###..."),
            ("..##.##...", "..#####..."),  # first gaps close, then blips go
            ("##......##", "##......##"),  # a run at an end may go on beyond it
            (".########.", ".########."),
            ("#", "#"),
            (".....", "....."),
        ],
    )
    def test_runs(self, before: str, after: str) -> None:
        assert self.debounced(before) == after

    def test_the_shortest_run_is_a_time_not_a_count(self) -> None:
        text = "." * 30 + "#" * 11 + "." * 30
        assert "#" not in self.debounced(text, 240.0)
        assert self.debounced(text, 200.0) == text
        assert self.debounced("..#..#.#", 20.0) == "..#..#.#"
