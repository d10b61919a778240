"""The two-bone arm: it ends where it was told to, keeps its lengths, and carries its elbow as people do."""

from __future__ import annotations

import numpy as np
import pytest
from retarget.samples import arm_reach
from retarget.samples.arm_reach import ArmReachError, Reach, between, reach_for
from scipy.spatial.transform import Rotation

UPPER_ARM, FOREARM, PALM = 0.186 * 1.75, 0.146 * 1.75, 0.45 * 0.108 * 1.75
SIDES = [("Left", 1.0), ("Right", -1.0)]


def _scipy(wxyz: np.ndarray) -> Rotation:
    return Rotation.from_quat(wxyz[..., [1, 2, 3, 0]])


def _chain(reach: Reach, side: str, left: float) -> tuple[np.ndarray, np.ndarray, Rotation, Rotation]:
    """Elbow and hand point (T, 3) from the shoulder, upper arm and forearm, by SciPy."""
    joints = reach.rotations_of(side)
    upper = _scipy(joints[f"{side}UpperArm"])
    fore = upper * _scipy(joints[f"{side}ForeArm"])
    elbow = upper.apply([0.0, left * UPPER_ARM, 0.0])
    return elbow, elbow + fore.apply([0.0, left * (FOREARM + PALM), 0.0]), upper, fore


def _points(left: float, count: int = 300) -> np.ndarray:
    """In front of the body, from the thigh to above the shoulder, also across the middle."""
    random = np.random.default_rng(5)
    points = random.uniform([0.15, -0.15, -0.45], [0.45, 0.35, 0.15], (count, 3))
    return points[np.linalg.norm(points, axis=1) < 0.6] * [1, left, 1]


@pytest.mark.parametrize(("side", "left"), SIDES)
@pytest.mark.parametrize("inward", [0.0, 1.0])
def test_the_hand_is_where_it_was_sent(side: str, left: float, inward: float) -> None:
    points = _points(left)
    reach = reach_for(points, np.full(len(points), inward))
    elbow, hand, _, _ = _chain(reach, side, left)
    assert hand == pytest.approx(points, abs=1e-12)
    assert reach.hand_point == pytest.approx(points, abs=1e-12)
    assert np.linalg.norm(elbow, axis=1) == pytest.approx(UPPER_ARM, abs=1e-12)
    assert np.linalg.norm(hand - elbow, axis=1) == pytest.approx(FOREARM + PALM, abs=1e-12)


@pytest.mark.parametrize(("side", "left"), SIDES)
def test_the_elbow_hangs_below_or_behind_and_bends_one_way(side: str, left: float) -> None:
    points = _points(left)
    elbow, hand, upper, fore = _chain(reach_for(points, np.zeros(len(points))), side, left)
    aside = elbow - hand * np.einsum("ti,ti->t", elbow, hand)[:, None] / np.einsum("ti,ti->t", hand, hand)[:, None]
    assert (aside @ [-1.0, 0.0, -1.0] > 0).all()
    hinge = (upper.inv() * fore).as_rotvec()
    assert (left * hinge[:, 2] < 0).all()
    assert np.abs(hinge[:, :2]).max() < 1e-9


@pytest.mark.parametrize(("side", "left"), SIDES)
def test_spread_straight_arm_is_the_reference_posture(side: str, left: float) -> None:
    reach = Reach(np.array([[0.0, left, 0.0]]), np.zeros(1), np.zeros(1))
    for quaternion in reach.rotations_of(side).values():
        assert quaternion == pytest.approx(np.array([[1.0, 0.0, 0.0, 0.0]]), abs=1e-15)
    assert reach.hand_point[0] == pytest.approx([0.0, left * 0.66605, 0.0], abs=1e-5)


def test_hanging_arm_is_turned_down_about_the_forward_axis() -> None:
    reach = Reach(np.array([[0.0, 0.0, -1.0]]), np.zeros(1), np.zeros(1))
    upper = _scipy(reach.rotations_of("Left")["LeftUpperArm"])[0]
    assert upper.as_rotvec(degrees=True) == pytest.approx([-90.0, 0.0, 0.0], abs=1e-12)


@pytest.mark.parametrize(("side", "left"), SIDES)
def test_palm_faces_the_middle_as_far_as_the_forearm_lets_it(side: str, left: float) -> None:
    points = _points(left)
    _, _, _, fore = _chain(reach_for(points, np.ones(len(points))), side, left)
    palm, bone = fore.apply([0.0, 0.0, -1.0]), fore.apply([0.0, 1.0, 0.0])
    middle = np.array([0.0, -left, 0.0])
    best = middle - (bone @ middle)[:, None] * bone
    assert palm == pytest.approx(best / np.linalg.norm(best, axis=1, keepdims=True), abs=1e-9)


def test_left_and_right_are_mirror_images() -> None:
    points = _points(1.0)
    left, right = (_chain(reach_for(points * [1, sign, 1], np.ones(len(points))), side, sign) for side, sign in SIDES)
    assert left[0] * [1, -1, 1] == pytest.approx(right[0], abs=1e-12)
    mirror = np.diag([1.0, -1.0, 1.0])
    assert mirror @ left[3].as_matrix() @ mirror == pytest.approx(right[3].as_matrix(), abs=1e-9)


def test_between_runs_along_the_arc_at_an_even_pace() -> None:
    start = Reach(np.array([[0.0, 0.0, -1.0]]), np.zeros(1), np.zeros(1))
    end = Reach(np.array([[1.0, 0.0, 0.0]]), np.ones(1), np.full(1, 0.5))
    path = between(start, end, np.array([0.0, 1 / 3, 1.0]))
    assert path.direction == pytest.approx(
        np.array([[0, 0, -1], [0.5, 0, -np.sqrt(0.75)], [1, 0, 0]], float), abs=1e-15
    )
    assert path.elbow == pytest.approx([0.0, 1 / 3, 1.0])
    assert path.inward == pytest.approx([0.0, 1 / 6, 0.5])
    assert between(start, start, np.array([0.7])).direction[0] == pytest.approx([0.0, 0.0, -1.0])


def test_points_out_of_reach_are_refused() -> None:
    near = np.array([[0.3, 0.0, 0.0], [0.7, 0.0, 0.0]])
    with pytest.raises(
        ArmReachError, match=r"planned 0\.7000 m from the shoulder \(row 1\); expected 0\.065 to 0\.6661 m"
    ):
        reach_for(near, np.zeros(2))
    with pytest.raises(ArmReachError, match=r"planned 0\.0100 m from the shoulder \(row 0\)"):
        reach_for(np.array([[0.01, 0.0, 0.0], [0.3, 0.0, 0.0]]), np.zeros(2))
    # Up, ahead and across, where the elbow's side, turning from behind to below, lies on the line from shoulder to hand.
    across = Reach(np.array([[0.752, -0.339, 0.565]]), np.zeros(1), np.zeros(1))
    with pytest.raises(ArmReachError, match=r"hand in direction \[0\.752, -0\.339, 0\.565\].*elbow can hang aside"):
        across.rotations_of("Left")


def test_arm_length() -> None:
    assert pytest.approx(UPPER_ARM + FOREARM + PALM) == arm_reach.ARM_LENGTH
