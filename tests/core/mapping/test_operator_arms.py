"""Shoulders, elbows, hands and arm planes of a person whose joints are known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from retarget.core import rotations
from retarget.core.errors import MotionError
from retarget.core.mapping import operator_arms
from retarget.core.mapping.operator_frame import in_operator_frame
from retarget.core.types import Array, HumanMotion

from tests.core.mapping.operators import calibration_of, moving, pose

MotionFactory = Callable[..., HumanMotion]
TIME = np.arange(60) / 60
SIDES = ("Left", "Right")


def joint(motion: HumanMotion, segment: str) -> Array:
    return motion.position[:, motion.index(segment)]


def only(motion: HumanMotion, *segments: str) -> HumanMotion:
    """What six trackers leave of it."""
    return replace(motion, measured=np.array([s in segments for s in motion.segments]))


@pytest.mark.parametrize("side", SIDES)
def test_the_shoulder_goes_with_the_chest(make_motion: MotionFactory, side: str) -> None:
    calibration = calibration_of(make_motion)
    motion = in_operator_frame(moving(make_motion, TIME), calibration)
    found = operator_arms.shoulder_point(motion, calibration, side)
    assert found == pytest.approx(joint(motion, f"{side}UpperArm"), abs=1e-12)


@pytest.mark.parametrize("side", SIDES)
def test_the_hand_from_the_shoulder_is_seen_by_the_chest(make_motion: MotionFactory, side: str) -> None:
    """Whatever the chest does, a hand that stays where it is on the body stays where it is."""
    calibration = calibration_of(make_motion)
    chest = rotations.exp(np.sin(2 * TIME)[:, None] * [0.2, 0.5, 0.9])
    motion = in_operator_frame(make_motion(TIME, {"T8": chest}), calibration)
    found = operator_arms.hand_from_shoulder(motion, calibration, side)
    out = 1 if side == "Left" else -1
    assert found == pytest.approx(np.tile([0.0, 0.55 * out, 0.0], (len(TIME), 1)), abs=1e-12)


@pytest.mark.parametrize(("name", "column"), [("still", 0), ("tpose", 1), ("forward", 2)])
@pytest.mark.parametrize("side", SIDES)
def test_a_pose_is_its_column_of_the_basis(make_motion: MotionFactory, side: str, name: str, column: int) -> None:
    calibration = calibration_of(make_motion)
    motion = in_operator_frame(make_motion([0.0], pose(name)), calibration)
    found = operator_arms.hand_from_shoulder(motion, calibration, side)[0]
    assert found == pytest.approx(calibration.arms[side].basis[:, column], abs=1e-12)


def test_the_hand_point_of_a_suit_has_an_offset_and_that_of_trackers_contains_it(make_motion: MotionFactory) -> None:
    offset = np.array([0.01, 0.08, -0.02])
    calibration = replace(calibration_of(make_motion), hand_offset_m={"Left": offset})
    q = rotations.exp(np.array([0.3, 0.5, -0.2]))
    motion = make_motion([0.0], {"LeftHand": q})
    wrist = joint(motion, "LeftHand")
    assert operator_arms.hand_point(motion, calibration, "Left") == pytest.approx(wrist + rotations.rotate(q, offset))
    assert operator_arms.hand_point(motion, calibration, "Right") == pytest.approx(joint(motion, "RightHand"))
    trackers = replace(calibration, trackers={"LeftHand": "LHR-1"})
    assert operator_arms.hand_point(motion, trackers, "Left") == pytest.approx(wrist)


@pytest.mark.parametrize("side", SIDES)
def test_an_elbow_that_is_not_tracked_lies_on_the_upper_arms_axis(make_motion: MotionFactory, side: str) -> None:
    calibration = calibration_of(make_motion)
    motion = in_operator_frame(moving(make_motion, TIME), calibration)
    shoulder, elbow = operator_arms.elbow_line(motion, calibration, side)
    assert elbow == pytest.approx(joint(motion, f"{side}ForeArm"))
    sparse = only(motion, "T8", f"{side}UpperArm", f"{side}Hand")
    from_axis = operator_arms.elbow_line(sparse, calibration, side)[1]
    assert rotations.vector_angle(from_axis - shoulder, elbow - shoulder).max() < 1e-9
    assert np.linalg.norm(from_axis - shoulder, axis=1) == pytest.approx(0.48 * 0.55)


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("elbows", [True, False], ids=["suit", "trackers"])
def test_a_bent_arms_plane_is_spanned_by_its_points(make_motion: MotionFactory, side: str, elbows: bool) -> None:
    """The z-axis is the unit normal of shoulder, elbow and hand, on the side about which the elbow flexes."""
    calibration = calibration_of(make_motion)
    motion = in_operator_frame(moving(make_motion, TIME), calibration)
    points = [joint(motion, f"{side}{s}") for s in ("UpperArm", "ForeArm", "Hand")]
    normal = np.cross(points[1] - points[0], points[2] - points[1]) * (-1 if side == "Left" else 1)
    seen = motion if elbows else only(motion, "T8", "Head", f"{side}UpperArm", f"{side}Hand")
    q = operator_arms.arm_plane(seen, calibration, side)
    assert rotations.vector_angle(rotations.rotate(q, [0, 0, 1]), normal).max() < 1e-3
    out = 1 if side == "Left" else -1
    assert rotations.vector_angle(rotations.rotate(q, [0, out, 0]), points[1] - points[0]).max() < 1e-9


@pytest.mark.parametrize("side", SIDES)
def test_a_nearly_straight_arm_does_not_turn_its_plane_about(make_motion: MotionFactory, side: str) -> None:
    """The elbow trembles by ±3° through straight: the normal stays within a degree or two of the upper arm's own hinge."""
    time = np.arange(120) / 60
    tremble = np.radians(3.0) * np.sin(20 * time)[:, None]
    bend = rotations.exp(tremble * [0.3, 0.0, 1.0])
    motion = make_motion(time, {f"{side}ForeArm": bend})
    calibration = calibration_of(make_motion)
    q = operator_arms.arm_plane(in_operator_frame(motion, calibration), calibration, side)
    assert np.degrees(rotations.vector_angle(rotations.rotate(q, [0, 0, 1]), [0.0, 0.0, 1.0])).max() < 2.0


def test_what_is_missing_is_named(make_motion: MotionFactory) -> None:
    motion, calibration = make_motion([0.0]), calibration_of(make_motion)
    with pytest.raises(
        MotionError, match=r"^a hand mapping needs the position of T8, which the motion doesn't have; expected"
    ):
        operator_arms.shoulder_point(only(motion, "LeftHand"), calibration, "Left")
    position = np.array(motion.position)
    position[:, motion.index("LeftHand")] = np.nan
    with pytest.raises(MotionError, match="needs the position of LeftHand"):
        operator_arms.hand_point(replace(motion, position=position), calibration, "Left")
