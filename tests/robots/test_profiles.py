"""Every robot profile: it loads, builds, fits its model, and the URDF that a trajectory carries says the same."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from retarget import robots
from retarget.core import robot_model, rotations
from retarget.core.mapping import limb_plane
from retarget.core.robot_check import check
from retarget.core.robot_model import RobotModel
from retarget.core.solve.dynamical import DynamicalOptions, solve
from retarget.core.solve.problem import orientation_problem
from retarget.core.types import HumanMotion

DEGREES_OF_FREEDOM = {"baxter": 15, "g1": 29, "human": 66, "icub": 32, "talos": 30, "tocabi": 33}
MASS_KG = {
    "baxter": (70, 140),
    "g1": (30, 40),
    "human": (70, 75),
    "icub": (22, 33),
    "talos": (85, 100),
    "tocabi": (95.5, 100),
}
"""Ranges around what makers and papers state; Baxter with and without its pedestal."""


@pytest.fixture(params=robots.names())
def model(request: pytest.FixtureRequest, make_motion: Callable[..., HumanMotion]) -> RobotModel:
    return _model(request.param, make_motion(np.arange(3) / 60))


_BUILT: dict[str, RobotModel] = {}


def _model(name: str, person: HumanMotion) -> RobotModel:
    if name not in _BUILT:
        _BUILT[name] = robot_model.build(robots.load(name), person)
    return _BUILT[name]


def test_every_robot_is_known_here() -> None:
    assert set(robots.names()) == set(DEGREES_OF_FREEDOM)


def test_degrees_of_freedom_and_mass(model: RobotModel) -> None:
    name = model.profile.name
    assert len(model.joint_names) == DEGREES_OF_FREEDOM[name]
    low, high = MASS_KG[name]
    assert low <= model.mass_kg <= high


def test_talos_has_its_two_grippers_when_they_are_not_locked() -> None:
    free = robot_model.build(replace(robots.load("talos"), locked_joints=()))
    assert len(free.joint_names) == 32


def test_limits_are_finite_and_leave_room(model: RobotModel) -> None:
    assert np.isfinite(model.lower).all()
    assert np.isfinite(model.upper).all()
    assert (model.upper > model.lower).all()
    assert ((model.velocity_limit > 0) & (model.velocity_limit <= 60)).all()
    assert ((model.reference_posture >= model.lower) & (model.reference_posture <= model.upper)).all()


def test_the_urdf_text_says_what_the_model_does(model: RobotModel) -> None:
    """Read with a fixed base: pinocchio's own order of joints, nothing of the profile."""
    again = pin.buildModelFromXML(model.urdf)
    assert tuple(again.names[1:]) == model.joint_names
    np.testing.assert_array_equal(again.lowerPositionLimit, model.lower)
    np.testing.assert_array_equal(again.upperPositionLimit, model.upper)
    np.testing.assert_array_equal(again.velocityLimit, model.velocity_limit)


def test_the_profile_passes_its_own_check(model: RobotModel) -> None:
    report = check(model)
    assert not [entry for entry in report.checks if not entry.passed]
    directions = [entry for entry in report.checks if entry.name.endswith("direction")]
    assert len(directions) == len(model.limbs) >= 4


def test_limbs_come_in_whole_pairs(model: RobotModel) -> None:
    parts = (
        ("UpperArm", "ForeArm") if model.profile.base == "fixed" else ("UpperArm", "ForeArm", "UpperLeg", "LowerLeg")
    )
    assert set(model.limbs) == {f"{side}{part}" for side in ("Left", "Right") for part in parts}


def test_elbows_and_knees_are_single_hinges(model: RobotModel) -> None:
    """So that the limb plane can be followed; a person's are not."""
    hinged = {segment for segment, limb in model.limbs.items() if limb.rotation is not None}
    assert hinged == (set() if model.profile.name == "human" else set(model.limbs))


def test_left_and_right_mirror_each_other(model: RobotModel) -> None:
    """In the reference posture: bones, fingers and soles of one side are those of the other, mirrored at the middle plane."""
    data = model.pin_model.createData()
    pin.framesForwardKinematics(model.pin_model, data, model.configuration(model.reference_posture))

    def world(link: str, vector: np.ndarray, *, point: bool = False) -> np.ndarray:
        placement = data.oMf[model.pin_model.getFrameId(link)]
        return np.asarray(placement.rotation @ vector + (placement.translation if point else 0))

    mirror = np.array([1.0, -1.0, 1.0])
    compared = 0
    for segment, limb in model.limbs.items():
        if segment.startswith("Left"):
            other = model.limbs["Right" + segment.removeprefix("Left")]
            np.testing.assert_allclose(world(limb.link, limb.bone), mirror * world(other.link, other.bone), atol=2e-3)
            compared += 1
    for left, right in (_pair(model.profile.hands), _pair(model.profile.feet)):
        if left is None or right is None:
            continue
        if hasattr(left, "palm"):
            for name in ("fingers", "palm"):
                ours, theirs = np.array(getattr(left, name)), np.array(getattr(right, name))
                np.testing.assert_allclose(world(left.link, ours), mirror * world(right.link, theirs), atol=2e-3)
        else:
            ours = np.array([world(left.link, corner, point=True) for corner in left.sole])
            theirs = np.array([mirror * world(right.link, corner, point=True) for corner in right.sole])
            gaps = np.linalg.norm(ours[:, None] - theirs[None], axis=2).min(axis=1)
            assert gaps.max() < 2e-3
        compared += 1
    assert compared >= 3


def _pair(sides: Mapping[str, Any]) -> tuple[Any, Any]:
    return sides.get("Left"), sides.get("Right")


def test_hands_point_outward_with_palms_down_when_the_wrists_are_straight(model: RobotModel) -> None:
    """The reference posture is an approximate T-pose, so fingers and palms must be roughly there without any solving."""
    data = model.pin_model.createData()
    pin.framesForwardKinematics(model.pin_model, data, model.configuration(model.reference_posture))
    assert set(model.profile.hands) == {"Left", "Right"}
    for side, hand in model.profile.hands.items():
        rotation = data.oMf[model.pin_model.getFrameId(hand.link)].rotation
        outward = np.array([0.0, 1.0 if side == "Left" else -1.0, 0.0])
        assert rotation @ np.array(hand.fingers) @ outward > np.cos(np.radians(35))
        assert (rotation @ np.array(hand.palm))[2] < -np.cos(np.radians(35))


def test_icub_stays_where_its_cables_let_it(make_motion: Callable[..., HumanMotion]) -> None:
    icub = _model("icub", make_motion(np.arange(3) / 60))
    joints = check(icub).series["tpose_rad"]
    for rows in icub.coupled:
        value = rows.matrix @ joints[[icub.joint_index(name) for name in rows.joints]]
        assert (value >= rows.lower).all()
        assert (value <= rows.upper).all()


ALL_SEVEN = """
[[coupled]]
joints = ["{s}_shoulder_pitch", "{s}_shoulder_roll", "{s}_shoulder_yaw", "{s}_elbow", "{s}_wrist_prosup"]
rows = [
    [1.7105, -1.7105, 0, 0, 0], [1.7105, -1.7105, -1.7105, 0, 0], [0, 1, 1, 0, 0], [0, 1, 0.0427, 0, 0], [0, 1, 0, 0, 0],
    [0, 0, 0, 2.5, 1], [0, 0, 0, -2.5, 1],
]
lower_rad = [-6.0563, -6.3979, -1.1623, 0.4611, -1000, -1000, -5.2796]
upper_rad = [1000, 1.9622, 3.7228, 1000, 1.7453, 5.2796, 1000]
"""


def test_a_variant_of_icub_keeps_its_arms_off_the_body(tmp_path: Path, make_motion: Callable[..., HumanMotion]) -> None:
    """All seven rows of [Darvish2019]; the zero posture breaks the fourth, and so would arms that hang straight down."""
    path = tmp_path / "guarded.toml"
    path.write_text('extends = "icub"\n' + "".join(ALL_SEVEN.format(s=side) for side in "lr"), encoding="utf-8")
    variant = robot_model.build(robots.load(str(path)))
    hanging = {
        f"{side}{part}": rotations.exp([sign * np.pi / 2, 0.0, 0.0])
        for side, sign in (("Left", -1), ("Right", 1))
        for part in ("UpperArm", "ForeArm", "Hand")
    }
    targets = limb_plane.targets(make_motion(np.arange(3) / 60, hanging), variant)
    joints = solve(orientation_problem(targets, variant, free_base=True), DynamicalOptions()).joints[-1]
    for rows in variant.coupled:
        value = rows.matrix @ joints[[variant.joint_index(name) for name in rows.joints]]
        assert (value >= rows.lower).all()
        assert (value <= rows.upper).all()
        assert value[3] == pytest.approx(0.4611, abs=1e-4)  # as far down as the row lets them
        assert not (rows.matrix @ np.zeros(5) >= rows.lower).all()
