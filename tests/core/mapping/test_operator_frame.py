"""The operator frame: the same whichever way the person faces, wherever they are, and however often it is applied."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from retarget.core import rotations
from retarget.core.mapping.heading import without_heading
from retarget.core.mapping.operator_frame import in_operator_frame
from retarget.core.types import HumanMotion

from tests.core.mapping.operators import calibration_of, moving, pose, turned

MotionFactory = Callable[..., HumanMotion]
TIME = np.arange(40) / 30


def same(a: HumanMotion, b: HumanMotion) -> None:
    assert rotations.angle(a.orientation, b.orientation).max() < 1e-9
    assert a.position == pytest.approx(b.position, abs=1e-12)


@pytest.mark.parametrize("segment", ["Pelvis", "T8"])
def test_turning_and_walking_away_changes_nothing(make_motion: MotionFactory, segment: str) -> None:
    motion, calibration = moving(make_motion, TIME), calibration_of(make_motion)
    away = turned(motion, 2.5, np.array([3.0, -1.0, 0.1]))
    same(in_operator_frame(away, calibration, segment), in_operator_frame(motion, calibration, segment))


@pytest.mark.parametrize("segment", ["Pelvis", "T8"])
def test_twice_is_once_and_a_heading_taken_out_before_does_not_matter(make_motion: MotionFactory, segment: str) -> None:
    calibration = calibration_of(make_motion)
    motion = turned(moving(make_motion, TIME), -1.2, np.array([1.0, 2.0, 0.0]))
    once = in_operator_frame(motion, calibration, segment)
    same(in_operator_frame(once, calibration, segment), once)
    same(in_operator_frame(without_heading(motion, segment), calibration, segment), once)


@pytest.mark.parametrize("segment", ["Pelvis", "T8", "L5"])
def test_the_still_pose_is_where_the_calibration_has_it(make_motion: MotionFactory, segment: str) -> None:
    calibration = calibration_of(make_motion)
    still = in_operator_frame(make_motion([0.0], pose("still")), calibration, segment)
    assert still.position[0, still.index("Pelvis")] == pytest.approx(np.zeros(3), abs=1e-12)
    assert still.position[0, still.index("T8")] == pytest.approx(calibration.chest_position)
    for side, arm in calibration.arms.items():
        assert still.position[0, still.index(f"{side}Hand")] == pytest.approx(arm.hand_points[0])


def test_without_a_pelvis_the_frame_stands_where_the_calibration_was(make_motion: MotionFactory) -> None:
    """Six trackers: the person then turns the chest by 0.4 rad, and that is what is left."""
    calibration = calibration_of(make_motion, yaw=1.1)
    start = turned(make_motion([0.0], pose("still")), 1.1, np.array([0.0, 0.0, 0.0]))
    measured = np.array([s not in ("Pelvis", "L5", "L3", "T12") for s in start.segments])
    later = replace(turned(start, 0.4, np.zeros(3)), measured=measured)
    calibration = replace(calibration, origin=start.position[0, 0])
    found = in_operator_frame(later, calibration, "Pelvis")
    chest = found.index("T8")
    assert rotations.yaw(found.orientation[0, chest]) == pytest.approx(0.4)
    assert found.position[0, chest] == pytest.approx(calibration.chest_position)
    # Calibrated trackers are handed over in this frame.
    assert in_operator_frame(found, replace(calibration, trackers={"T8": "LHR-1"}), "Pelvis") is found


def test_an_untracked_position_stays_untracked(make_motion: MotionFactory) -> None:
    motion = make_motion([0.0])
    position = np.array(motion.position)
    position[:, motion.index("LeftHand")] = np.nan
    found = in_operator_frame(replace(motion, position=position), calibration_of(make_motion))
    assert np.isnan(found.position[0, found.index("LeftHand")]).all()
    assert np.isfinite(found.position[0, found.index("RightHand")]).all()


def test_a_chest_that_leaned_in_the_still_pose_keeps_its_own_zero(make_motion: MotionFactory) -> None:
    """The Still pose's chest had a yaw of 0.2 in the operator frame: in the chest's frame it has it again."""
    yaw = rotations.exp(np.array([0.0, 0.0, 0.2]))
    calibration = replace(calibration_of(make_motion), chest_orientation=yaw)
    motion = turned(make_motion([0.0], {"T8": yaw}), 0.9, np.zeros(3))
    found = in_operator_frame(motion, calibration, "T8")
    assert rotations.angle(found.orientation[0, found.index("T8")], yaw) < 1e-9
