"""Absolute and relative orientation mapping, and when they are the same."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from retarget.core import rotations
from retarget.core.mapping.relative_orientation import RELATIVE, ideal_still, mapped_orientation
from retarget.core.types import HumanMotion

from tests.core.mapping.operators import calibration_of, moving

MotionFactory = Callable[..., HumanMotion]
TIME = np.arange(30) / 30

STILL_UPPER_ARM = {
    "Left": [[0, 0, -1], [1, 0, 0], [0, -1, 0]],
    "Right": [[0, 0, -1], [-1, 0, 0], [0, 1, 0]],
}
"""TOCABI's upper arm in its Still pose, world ← link, from the authors' code."""
TPOSE_UPPER_ARM = np.array([[0, 0, -1], [0, 1, 0], [1, 0, 0]])
"""The same link in T-pose with elbows that flex forward, by its joints: x, the elbow's axis, points up, y left."""


@pytest.mark.parametrize("segment", sorted(RELATIVE))
def test_both_agree_for_a_person_whose_still_pose_is_perfect(make_motion: MotionFactory, segment: str) -> None:
    motion, calibration = moving(make_motion, TIME), calibration_of(make_motion)
    found = mapped_orientation(motion, calibration, segment)
    assert rotations.angle(found, motion.orientation[:, motion.index(segment)]).max() < 1e-9


@pytest.mark.parametrize("segment", sorted(RELATIVE))
def test_relative_orientation_does_not_see_how_a_tracker_is_strapped_on(
    make_motion: MotionFactory, segment: str
) -> None:
    motion, calibration = moving(make_motion, TIME), calibration_of(make_motion)
    strapped = rotations.exp(np.array([0.4, -0.9, 1.3]))
    orientation = np.array(motion.orientation)
    orientation[:, motion.index(segment)] = rotations.multiply(orientation[:, motion.index(segment)], strapped)
    still = {
        **calibration.still_orientation,
        segment: rotations.multiply(calibration.still_orientation[segment], strapped),
    }
    skewed = replace(motion, orientation=rotations.make_continuous(orientation))
    found = mapped_orientation(skewed, replace(calibration, still_orientation=still), segment)
    assert rotations.angle(found, mapped_orientation(motion, calibration, segment)).max() < 1e-9


@pytest.mark.parametrize("side", ["Left", "Right"])
def test_the_authors_constant_of_the_upper_arm(side: str) -> None:
    """The robot's Still pose Q · H is the rotation in the authors' code, with H the link's rotation in T-pose."""
    still = rotations.to_matrix(ideal_still(f"{side}UpperArm"))
    assert still @ TPOSE_UPPER_ARM == pytest.approx(np.array(STILL_UPPER_ARM[side]), abs=1e-12)


def test_hands_are_taken_absolutely(make_motion: MotionFactory) -> None:
    motion, calibration = moving(make_motion, TIME), calibration_of(make_motion)
    other = {**calibration.still_orientation, "LeftHand": rotations.exp(np.array([1.0, 0, 0]))}
    found = mapped_orientation(motion, replace(calibration, still_orientation=other), "LeftHand")
    assert (found == motion.orientation[:, motion.index("LeftHand")]).all()


def test_an_unmeasured_shoulder_goes_with_the_chest(make_motion: MotionFactory) -> None:
    motion, calibration = moving(make_motion, TIME), calibration_of(make_motion)
    measured = np.array([not s.endswith("Shoulder") for s in motion.segments])
    found = mapped_orientation(replace(motion, measured=measured), calibration, "LeftShoulder")
    assert (found == mapped_orientation(motion, calibration, "T8")).all()


def test_a_segment_the_calibration_lacks_had_a_perfect_still_pose(make_motion: MotionFactory) -> None:
    motion, calibration = moving(make_motion, TIME), calibration_of(make_motion)
    bare = replace(calibration, still_orientation={})
    for segment in RELATIVE:
        found = mapped_orientation(motion, bare, segment)
        assert rotations.angle(found, motion.orientation[:, motion.index(segment)]).max() < 1e-9
