"""The parametric person: published proportions, forward kinematics against SciPy, legs that reach where they are told to."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from retarget.core.segments import PARENT, SEGMENTS
from retarget.samples import feet, legs, person
from scipy.spatial.transform import Rotation

RANDOM = np.random.default_rng(7)


def _random_rotations(count: int, largest: float) -> np.ndarray:
    vectors = RANDOM.normal(size=(count, 3))
    vectors *= (largest * RANDOM.random(count) / np.linalg.norm(vectors, axis=1))[:, None]
    return Rotation.from_rotvec(vectors).as_quat()[:, [3, 0, 1, 2]]


def _scipy(wxyz: np.ndarray) -> Rotation:
    return Rotation.from_quat(wxyz[..., [1, 2, 3, 0]])


@pytest.mark.parametrize(
    ("start", "end", "fraction"),
    [
        ("LeftUpperArm", "LeftForeArm", 0.186),
        ("RightForeArm", "RightHand", 0.146),
        ("LeftUpperLeg", "LeftLowerLeg", 0.245),
        ("RightLowerLeg", "RightFoot", 0.246),
    ],
)
def test_bones_have_their_published_share_of_the_stature(
    start: str, end: str, fraction: float, document: Callable[[str], Any]
) -> None:
    content = document("walk")
    length = np.linalg.norm(content.at(end) - content.at(start), axis=1)
    assert length == pytest.approx(fraction * 1.75, abs=3e-6)


def test_reference_frame_shows_the_whole_person(document: Callable[[str], Any]) -> None:
    """Stature on top of a shoe's sole, arms spread about as wide, soles on the floor."""
    content = document("walk")
    position = dict(zip(content.segments, content.reference["identity"][1], strict=True))
    sole = 0.010
    assert position["Head"][2] + content.points["Head"]["pTopOfHead"][2] == pytest.approx(1.75 + sole, abs=1e-5)
    assert position["LeftUpperLeg"][2] == pytest.approx((0.039 + 0.246 + 0.245) * 1.75 + sole, abs=1e-5)
    assert position["LeftUpperArm"][2] == pytest.approx(0.818 * 1.75 + sole, abs=1e-5)
    span = 2 * (position["LeftHand"][1] + content.points["LeftHand"]["pLeftTopOfHand"][1])
    assert 0.98 < span / 1.75 < 1.10
    for side in ("Left", "Right"):
        heel = position[f"{side}Foot"] + content.points[f"{side}Foot"][f"p{side}HeelFoot"]
        tip = position[f"{side}Toe"] + content.points[f"{side}Toe"][f"p{side}Toe"]
        assert heel[2] == pytest.approx(0, abs=2e-6)
        assert tip[2] == pytest.approx(0, abs=2e-6)
        assert tip[0] - heel[0] == pytest.approx(0.152 * 1.75, abs=1e-5)


def test_left_and_right_are_mirror_images() -> None:
    for name, offset in person.JOINT_OFFSETS.items():
        if name.startswith("Left"):
            assert offset * [1, -1, 1] == pytest.approx(person.JOINT_OFFSETS[name.replace("Left", "Right")])


def test_forward_kinematics_agrees_with_scipy() -> None:
    count = 20
    joints = {segment: _random_rotations(count, 2.5) for segment in SEGMENTS}
    root = RANDOM.normal(size=(count, 3))
    orientation, position = person.forward(root, joints)
    world: dict[str, Rotation] = {}
    at: dict[str, np.ndarray] = {}
    for i, (segment, parent) in enumerate(PARENT.items()):
        local = _scipy(joints[segment])
        world[segment] = local if parent is None else world[parent] * local
        at[segment] = root if parent is None else at[parent] + world[parent].apply(person.JOINT_OFFSETS[segment])
        assert (world[segment].inv() * _scipy(orientation[:, i])).magnitude().max() < 1e-12
        assert position[:, i] == pytest.approx(at[segment], abs=1e-12)


@pytest.mark.parametrize("side", ["Left", "Right"])
def test_legs_reach_the_planned_ankle_and_foot(side: str) -> None:
    count = 200
    pelvis, foot = _random_rotations(count, 0.5), _random_rotations(count, 0.7)
    root = np.array([0.0, 0.0, 0.9]) + 0.05 * RANDOM.normal(size=(count, 3))
    hip = root + _scipy(pelvis).apply(person.JOINT_OFFSETS[f"{side}UpperLeg"])
    away = RANDOM.normal(size=(count, 3)) * [0.4, 0.15, 0.1] - [0, 0, 1]
    away *= (RANDOM.uniform(0.55, 0.85, count) / np.linalg.norm(away, axis=1))[:, None]
    toes = RANDOM.uniform(0, 0.8, count)
    angles = legs.solve(hip, pelvis, hip + away, foot, toes, side)
    orientation, position = person.forward(root, {"Pelvis": pelvis} | legs.rotations_of(angles, side))
    ankle, toe = SEGMENTS.index(f"{side}Foot"), SEGMENTS.index(f"{side}Toe")
    assert position[:, ankle] == pytest.approx(hip + away, abs=1e-12)
    assert (_scipy(foot).inv() * _scipy(orientation[:, ankle])).magnitude().max() < 1e-12
    bend = (_scipy(orientation[:, ankle]).inv() * _scipy(orientation[:, toe])).as_rotvec()
    assert bend == pytest.approx(-toes[:, None] * [0, 1, 0], abs=1e-12)
    # The knee is a hinge that bends backward only, and the shank turns about its own axis as the knee bends.
    assert (angles[:, legs.ANGLES.index("knee_flexion")] > 0).all()
    knee = position[:, SEGMENTS.index(f"{side}LowerLeg")]
    forward = _scipy(pelvis).apply([1.0, 0.0, 0.0]) + _scipy(foot).apply([1.0, 0.0, 0.0])
    assert (np.einsum("ti,ti->t", knee - (hip + hip + away) / 2, forward) > 0).all()


def test_a_foot_out_of_reach_is_refused() -> None:
    still = np.array([[1.0, 0.0, 0.0, 0.0]])
    hip, zero = np.array([[0.0, 0.0, 1.0]]), np.zeros(1)
    with pytest.raises(legs.LegReachError, match=r"planned 0\.9200 m from the hip \(row 0\); expected below 0\.8592 m"):
        legs.solve(hip, still, hip - [0.0, 0.0, 0.92], still, zero, "Left")


@pytest.mark.parametrize(
    ("rocker", "rise", "roll", "fixed"),
    [(0.3, 0.0, 0.0, "heel"), (0.0, 0.7, 0.0, "ball"), (0.0, 0.9, 0.4, "tip"), (0.0, 0.0, 0.0, "heel")],
)
def test_a_planted_foot_turns_about_the_point_that_carries_it(
    rocker: float, rise: float, roll: float, fixed: str
) -> None:
    spot = feet.Footprint(0.4, -0.2, 0.6)
    ankle, orientation = spot.pose(*(np.array([angle]) for angle in (rocker, rise, roll)))
    foot = _scipy(orientation[0])
    ball = ankle[0] + foot.apply([person.BALL_AHEAD_OF_ANKLE, 0, -person.ANKLE_HEIGHT])
    toes = Rotation.from_euler("z", 0.6) * Rotation.from_euler("y", roll)
    points = {
        "heel": ankle[0] + foot.apply([-person.HEEL_BEHIND_ANKLE, 0, -person.ANKLE_HEIGHT]),
        "ball": ball,
        "tip": ball + toes.apply([person.TOE_LENGTH, 0, 0]),
    }
    ahead = {
        "heel": -person.HEEL_BEHIND_ANKLE,
        "ball": person.BALL_AHEAD_OF_ANKLE,
        "tip": person.BALL_AHEAD_OF_ANKLE + person.TOE_LENGTH,
    }[fixed]
    assert points[fixed] == pytest.approx([0.4 + ahead * np.cos(0.6), -0.2 + ahead * np.sin(0.6), 0.0], abs=1e-12)
    assert all(point[2] > -1e-12 for point in points.values())
