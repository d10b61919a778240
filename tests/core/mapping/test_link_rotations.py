"""The constants segment ← link, worked out by hand on a small arm and checked on the real robots."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from retarget.core.mapping.link_rotations import as_in_paper, from_geometry, from_reference_posture
from retarget.core.profile import Hand, MappingParameters
from retarget.core.types import Array
from scipy.spatial.transform import Rotation

RobotFactory = Callable[..., Any]


def about_x(degrees: float) -> Array:
    return np.asarray(Rotation.from_euler("x", degrees, degrees=True).as_matrix())


BY_HAND = {
    "T8": about_x(0),
    "LeftUpperArm": about_x(90),  # hanging along -z at zero: in T-pose along +y
    "LeftForeArm": about_x(180),  # its frame stands turned by another 90°
    "LeftHand": about_x(180),
}


def test_from_the_posture_by_hand(arm_robot: RobotFactory) -> None:
    found = from_reference_posture(arm_robot())
    assert found.keys() == BY_HAND.keys()
    for segment, rotation in BY_HAND.items():
        assert np.abs(found[segment] - rotation).max() < 1e-15, segment


@pytest.mark.parametrize("roll_deg", [90, 80, 110])
@pytest.mark.parametrize("yaw_deg", [0, -20, 35])
def test_from_geometry_by_hand_whatever_the_posture(arm_robot: RobotFactory, roll_deg: float, yaw_deg: float) -> None:
    """Bone and elbow axis say it all: an arm that the profile holds 20° off its T-pose still gets the same constants."""
    model = arm_robot(reference_posture={"shoulder_roll": np.radians(roll_deg), "shoulder_yaw": np.radians(yaw_deg)})
    found = from_geometry(model)
    for segment in ("LeftUpperArm", "LeftForeArm"):
        assert np.abs(found[segment] - BY_HAND[segment]).max() < 1e-9, segment


def test_hands_from_fingers_and_palm(arm_robot: RobotFactory) -> None:
    """In T-pose a left hand's fingers point along +y and its palm looks along -z; hanging, along -z and to the body (-y)."""
    model = arm_robot(hands={"Left": Hand("hand", fingers=(0.0, -1.0, 0.0), palm=(0.0, 0.0, 1.0))})
    assert np.abs(from_geometry(model)["LeftHand"] - BY_HAND["LeftHand"]).max() < 1e-15


def test_a_right_hand_mirrors_a_left_one(arm_robot: RobotFactory) -> None:
    """Fingers of a right hand point along -y."""
    model = arm_robot(
        links={"T8": "trunk", "RightHand": "hand"}, hands={"Right": Hand("hand", (1.0, 0.0, 0.0), (0.0, 0.0, -1.0))}
    )
    rotation = from_geometry(model)["RightHand"]
    assert (rotation @ [1, 0, 0]).tolist() == [0, -1, 0]
    assert (rotation @ [0, 0, -1]).tolist() == [0, 0, -1]
    assert np.linalg.det(rotation) == pytest.approx(1)


def test_directions_that_are_perpendicular_only_to_their_digits(arm_robot: RobotFactory) -> None:
    palm = np.array([0.0, 8e-4, 1.0])
    model = arm_robot(hands={"Left": Hand("hand", (0.0, -1.0, 0.0), tuple(palm / np.linalg.norm(palm)))})
    rotation = from_geometry(model)["LeftHand"]
    assert np.abs(rotation @ rotation.T - np.eye(3)).max() < 1e-15
    assert (rotation @ [0, -1, 0]).tolist() == [0, 1, 0]


class TestAsInThePaper:
    def test_without_a_word_from_the_profile_it_is_the_posture(self, arm_robot: RobotFactory) -> None:
        model = arm_robot()
        found = as_in_paper(model)
        assert {k: v.tolist() for k, v in found.items()} == {
            k: v.tolist() for k, v in from_reference_posture(model).items()
        }

    def test_typed_rotations_come_first(self, arm_robot: RobotFactory) -> None:
        rpy = (0.3, -0.2, 1.1)
        parameters = MappingParameters(rotations_rpy={"LeftForeArm": rpy, "Head": (1.0, 1.0, 1.0)})
        found = as_in_paper(arm_robot(mappings={"link_orientation": parameters}))
        assert np.abs(found["LeftForeArm"] - Rotation.from_euler("xyz", rpy).as_matrix()).max() < 1e-15
        assert np.abs(found["LeftUpperArm"] - BY_HAND["LeftUpperArm"]).max() < 1e-15
        assert "Head" not in found, "the robot has no head"

    def test_other_links_for_this_mapping_only(self, arm_robot: RobotFactory) -> None:
        parameters = MappingParameters(links={"LeftUpperArm": "fore"})
        model = arm_robot(mappings={"link_orientation": parameters})
        assert np.abs(as_in_paper(model)["LeftUpperArm"] - BY_HAND["LeftForeArm"]).max() < 1e-15
        assert np.abs(from_reference_posture(model)["LeftUpperArm"] - BY_HAND["LeftUpperArm"]).max() < 1e-15


@pytest.mark.parametrize("name", ["g1", "icub", "talos", "baxter", "tocabi"])
def test_real_robots(build_robot: Callable[[str], Any], name: str) -> None:
    """Proper rotations that put each limb's bone on the segment's T-pose axis and its hinge on the segment's hinge."""
    model = build_robot(name)
    found = from_geometry(model)
    assert found.keys() == model.links.keys()
    for segment, rotation in found.items():
        assert np.abs(rotation @ rotation.T - np.eye(3)).max() < 1e-12, segment
        assert np.linalg.det(rotation) == pytest.approx(1, abs=1e-12), segment
    for segment, limb in model.limbs.items():
        side = 1.0 if segment.startswith("Left") else -1.0
        bone, hinge = ([0, side, 0], [0, 0, 1]) if segment.endswith("Arm") else ([0, 0, -1], [0, 1, 0])
        assert np.abs(found[segment] @ limb.bone - bone).max() < 1e-12, segment
        assert np.abs(found[segment] @ limb.hinge - hinge).max() < 1e-12, segment


@pytest.mark.parametrize("name", ["g1", "icub", "talos", "baxter", "tocabi"])
def test_posture_and_geometry_roughly_agree_on_real_robots(build_robot: Callable[[str], Any], name: str) -> None:
    """A sign error in either would show as 90° or 180°; hand-made T-poses are off by up to 21°, wrists included."""
    model = build_robot(name)
    posture, geometry = from_reference_posture(model), from_geometry(model)
    for segment in model.limbs:
        difference = Rotation.from_matrix(posture[segment] @ geometry[segment].T).magnitude()
        assert np.degrees(difference) < 35, segment
