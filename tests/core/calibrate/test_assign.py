"""Trackers told apart by where they are."""

from __future__ import annotations

import numpy as np
import pytest
from retarget.core.calibrate.assign import SMALLEST_MARGIN_M, assign
from retarget.core.errors import MotionError

from tests.core.calibrate.operators import ROLES, SERIAL, Operator

SEVEN = (*ROLES, "Pelvis")


def positions(person: Operator, pose: str) -> dict[str, np.ndarray]:
    return {SERIAL[name]: person.tracker(name, pose)[0] for name in person.roles}


@pytest.mark.parametrize("roles", [ROLES, SEVEN], ids=["six", "seven"])
@pytest.mark.parametrize("seed", range(40))
def test_any_person_anywhere(seed: int, roles: tuple[str, ...]) -> None:
    person = Operator.random(seed, roles=roles)
    found = assign(positions(person, "still"), positions(person, "forward"))
    assert found.segments == {SERIAL[name]: name for name in roles}
    assert set(found.margin_m) == set(found.segments)
    assert min(found.margin_m.values()) > SMALLEST_MARGIN_M


def test_the_margins_are_metres_to_the_next_tracker() -> None:
    person = Operator(hand_offset={"Left": (0, 0, 0), "Right": (0, 0, 0)})
    margin = {
        segment: assign(positions(person, "still"), positions(person, "forward")).margin_m[SERIAL[segment]]
        for segment in ROLES
    }
    # Chest tracker 0.12 below the shoulders, head 0.24 above; upper arms 0.17 below, 0.03 behind the midline of arm and 0.02 out.
    still = {name: person.tracker(name, "still")[0] for name in ROLES}
    assert margin["Head"] == pytest.approx(0.36)
    assert margin["LeftHand"] == margin["RightHand"]
    assert margin["LeftHand"] == pytest.approx(
        min(person.shoulder_half, still["LeftUpperArm"][2] - still["LeftHand"][2])
    )
    assert margin["LeftUpperArm"] == pytest.approx(still["LeftUpperArm"][1] - still["T8"][1])
    assert margin["T8"] == min(margin["LeftUpperArm"], margin["RightUpperArm"])


@pytest.mark.parametrize("count", [1, 5, 8])
def test_too_few_and_too_many(count: int) -> None:
    still = {f"T{i}": np.array([0.0, 0.1 * i, 0.2 * i]) for i in range(count)}
    with pytest.raises(MotionError, match=rf"found {count} trackers .*, expected six or seven: chest, head"):
        assign(still, still)


def test_what_can_not_be_told_apart_is_named() -> None:
    person = Operator()
    still, forward = positions(person, "still"), positions(person, "forward")
    close = {**still, SERIAL["Head"]: still[SERIAL["T8"]] + [0, 0, 0.01]}
    with pytest.raises(
        MotionError, match=rf"can't tell the trackers {SERIAL['Head']} and {SERIAL['T8']} apart: .* the head .*by 10 mm"
    ):
        assign(close, forward)
    arm = SERIAL["LeftUpperArm"]
    beside = {**still, arm: still[SERIAL["T8"]] + [0, 0.02, 0]}
    with pytest.raises(MotionError, match=rf"{arm} would be an upper arm \(beside the chest\), by 20 mm.*--roles"):
        assign(beside, forward)


def test_hands_that_do_not_go_ahead() -> None:
    person = Operator()
    still, tpose = positions(person, "still"), positions(person, "tpose")
    with pytest.raises(MotionError, match=r"Forward pose: .* get 0\.00 m ahead"):
        assign(still, tpose)
    aside = {name: point + np.array([0, 0.5, 0]) for name, point in still.items()}
    with pytest.raises(MotionError, match=r"can't tell left from right: .* 90°"):
        assign(still, aside)
