"""Shoulders: the authors' own two calibrations, closed forms, and every way in which hand points give none."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from retarget.core.calibrate import shoulder
from retarget.core.errors import MotionError

Array = NDArray[np.float64]

AUTHORS = {
    "Left": np.array([[-0.13517, 0.289845, -0.259223], [-0.284813, 0.803326, 0.356484], [0.430654, 0.263043, 0.36878]]),
    "Right": np.array(
        [[-0.0650479, -0.324795, -0.255538], [-0.146704, -0.806712, 0.357469], [0.463099, -0.198173, 0.373117]]
    ),
}
"""Hand points that stand in the comments of the authors' code, pelvis frame, m: rows Still, T, Forward."""


def perfect(side: str, at: tuple[float, float, float] = (0.0, 0.0, 0.0), length: float = 0.6) -> Array:
    left = 1.0 if side == "Left" else -1.0
    return np.array(at) + length * np.array([[0, 0, -1], [0, left, 0], [1, 0, 0]])


@pytest.mark.parametrize(
    ("side", "centre", "length", "angles", "offsets"),
    [
        ("Left", (-0.1684, 0.2130, 0.3369), 0.6020, (85.28, 96.27, 89.25), (0.2984, 0.3981, 0.3378)),
        ("Right", (-0.1162, -0.2262, 0.3165), 0.5828, (84.55, 95.34, 90.92), None),
    ],
)
def test_the_authors_calibrations(
    side: str,
    centre: tuple[float, ...],
    length: float,
    angles: tuple[float, ...],
    offsets: tuple[float, ...] | None,
) -> None:
    arm = shoulder.fit(side, AUTHORS)
    assert np.linalg.norm(arm.shoulder - centre) < 1e-3
    assert arm.length_m == pytest.approx(length, abs=5e-4)
    assert arm.angles_deg == pytest.approx(angles, abs=0.05)
    if offsets is not None:
        assert arm.offsets_m == pytest.approx(offsets, abs=1e-4)
    assert np.array_equal(arm.hand_points, AUTHORS[side])


def test_the_authors_calibration_does_not_depend_on_the_origin() -> None:
    """Their code takes the side of the origin: with the origin on the floor it gives the wrong one of the two."""
    floor = np.array([0.3, -0.2, 1.0])
    for side in AUTHORS:
        moved = {name: points + floor for name, points in AUTHORS.items()}
        assert shoulder.fit(side, moved).shoulder == pytest.approx(
            shoulder.fit(side, AUTHORS).shoulder + floor, abs=1e-12
        )


@pytest.mark.parametrize("side", ["Left", "Right"])
@pytest.mark.parametrize("at", [(0.0, 0.0, 0.0), (0.0, 0.2, 1.4), (-7.0, 3.0, 0.1)])
def test_a_perfect_arm(side: str, at: tuple[float, float, float]) -> None:
    arm = shoulder.fit(side, {side: perfect(side, at)}, np.array(at) + np.array([0.1, 0.0, -0.1]))
    assert arm.shoulder == pytest.approx(at, abs=1e-12)
    assert arm.length_m == pytest.approx(0.6, abs=1e-12)
    assert arm.angles_deg == pytest.approx((90, 90, 90), abs=1e-9)
    assert arm.offsets_m == pytest.approx(np.full(3, 0.6 / np.sqrt(3)), abs=1e-12)


def test_arms_of_right_angles_and_unequal_reach_stay_on_the_circles_axis() -> None:
    """Hands at 0.6, 0.58 and 0.62 m: all equally far from the shoulder all the same, and each k solves its own right angle."""
    points = np.diag([0.6, 0.58, 0.62]) @ perfect("Left", length=1.0)
    arm = shoulder.fit("Left", {"Left": points})
    assert np.ptp(np.linalg.norm(points - arm.shoulder, axis=1)) < 1e-12
    centre_to = arm.shoulder / np.linalg.norm(arm.shoulder - points.mean(axis=0))
    assert np.isfinite(centre_to).all()
    normal = np.cross(points[1] - points[0], points[2] - points[0])
    normal /= np.linalg.norm(normal)
    foot = arm.shoulder - normal * (normal @ (arm.shoulder - points[0]))
    for (a, b), k in zip(shoulder.PAIRS, arm.offsets_m, strict=True):
        candidate = foot + np.sign(normal @ (arm.shoulder - points[0])) * k * normal
        assert (points[a] - candidate) @ (points[b] - candidate) == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("side", ["Left", "Right"])
@pytest.mark.parametrize(("pose", "name"), [(0, "Still pose"), (1, "T-pose"), (2, "Forward pose")])
def test_no_real_k_names_arm_and_pose(side: str, pose: int, name: str) -> None:
    """One hand turned by 50° toward the next pose's: the triangle's smallest angle falls below 45°."""
    points = perfect(side)
    points[pose] = 0.6 * (np.cos(np.radians(50)) * points[pose] + np.sin(np.radians(50)) * points[(pose + 1) % 3]) / 0.6
    other = "Right" if side == "Left" else "Left"
    with pytest.raises(
        MotionError, match=rf"^{side.lower()} arm, {name}: no shoulder fits: .* 50° off .*expected 45° to 90°"
    ):
        shoulder.fit(side, {side: points, other: perfect(other, (0.0, -0.4, 0.0))})


def test_estimates_too_far_apart_say_by_how_much() -> None:
    points = perfect("Left")
    points[2] *= 0.78
    with pytest.raises(
        MotionError,
        match=r"^left arm, Forward pose: the hand is 0\.47 m .*not 0\.60 m.* lie 0\.\d+ m apart .* at most 0\.1 m$",
    ):
        shoulder.fit("Left", {"Left": points, "Right": perfect("Right", (0.0, -0.4, 0.0))})


def test_hands_at_one_place_and_on_a_line() -> None:
    points = perfect("Right")
    points[2] = points[1] + [0.003, 0, 0]
    with pytest.raises(
        MotionError, match=r"^right arm: the hand is at the same place in T-pose and Forward pose \(3 mm apart\)"
    ):
        shoulder.fit("Right", {"Right": points})
    line = np.outer([0.0, 0.5, 1.0], [0.3, 0.2, 0.4])
    with pytest.raises(
        MotionError, match=r"^right arm: the hand points of the three poses lie on a line \(to within 0 mm\)"
    ):
        shoulder.fit("Right", {"Right": line})
    with pytest.raises(MotionError, match="same place in Still pose and T-pose"):
        shoulder.fit("Right", {"Right": np.zeros((3, 3))})


def test_a_chest_on_the_wrong_side() -> None:
    with pytest.raises(MotionError, match=r"^left arm: the chest tracker is \d\.\d\d m from the shoulder"):
        shoulder.fit("Left", {"Left": perfect("Left")}, np.array([0.5, 0.5, -0.5]))
