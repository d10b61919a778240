"""The operator's three poses: the angles asked for, and a shoulder that eq. 1 finds."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from retarget.samples.primitive_poses import RIGHT_ANGLED, Operator, intended

ARM = (0.186 + 0.146 + 0.45 * 0.108) * 1.75
SIDES = ("Left", "Right")


def _shoulders(points: np.ndarray) -> np.ndarray:
    """(2, 3): the two candidates of [Lim2022 eq. 1], on either side of the plane of three `points` (3, 3).

    The circle's centre solves three linear equations: equally far from all points, and in their plane.
    """
    a, b, c = points
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal)
    rows = np.array([b - a, c - a, normal])
    center = np.linalg.solve(rows, [(b - a) @ (a + b) / 2, (c - a) @ (a + c) / 2, normal @ a])
    radius2 = (a - center) @ (a - center)
    k = np.mean([np.sqrt((p - q) @ (p - q) / 2 - radius2) for p, q in combinations(points, 2)])
    return np.array([center + k * normal, center - k * normal])


@pytest.mark.parametrize("side", SIDES)
def test_poses_have_the_angles_they_claim(side: str) -> None:
    for operator in (Operator(), RIGHT_ANGLED, Operator((90.7, 82.24), (86.96, 88.09), (92.51, 102.49))):
        still, tpose, forward = operator.basis(side).T
        for (a, b), angle in zip(
            ((still, tpose), (tpose, forward), (forward, still)), operator.angles_deg(side), strict=True
        ):
            assert np.degrees(np.arccos(a @ b / (ARM * ARM))) == pytest.approx(angle, abs=1e-9)
        assert np.linalg.norm([still, tpose, forward], axis=1) == pytest.approx(ARM, abs=1e-12)
        assert tpose == pytest.approx([0, ARM if side == "Left" else -ARM, 0])
        assert still[2] < -0.9 * ARM
        assert forward[0] > 0.9 * ARM


def test_angles_of_the_paper_are_kept() -> None:
    operator = Operator((90.7, 82.24), (86.96, 88.09), (92.51, 102.49))
    assert operator.angles_deg("Left") == (90.7, 92.51, 86.96)
    assert operator.angles_deg("Right") == (82.24, 102.49, 88.09)


@pytest.mark.parametrize("side", SIDES)
def test_eq_1_finds_the_true_shoulder(side: str) -> None:
    """For the default operator, for one with right angles, and for any whose third angle is left open."""
    for operator in (Operator(), RIGHT_ANGLED, Operator((88.0, 94.0), (93.0, 89.0))):
        found = _shoulders(operator.basis(side).T)
        assert np.linalg.norm(found, axis=1).min() < 1e-9
    assert all(80 < angle < 103 and abs(angle - 90) > 0.5 for angle in Operator().angles_deg(side))


def test_both_arms_miss_alike_unless_told_otherwise() -> None:
    """So that the hands alone tell where the operator faces."""
    left, right = (Operator().directions(side) for side in SIDES)
    assert left * [1, -1, 1] == pytest.approx(right, abs=1e-15)
    uneven = Operator((92.5, 86.0), (86.5, 89.3))
    assert np.abs(uneven.directions("Left") * [1, -1, 1] - uneven.directions("Right")).max() > 0.05


def test_eq_1_misses_the_shoulder_when_the_angles_do_not_cancel() -> None:
    poses = Operator((84.0, 84.0), (84.0, 84.0), (84.0, 84.0)).basis("Left").T
    assert np.linalg.norm(_shoulders(poses), axis=1).min() > 0.03


def test_right_angled_operator_means_what_it_does() -> None:
    for side in SIDES:
        assert RIGHT_ANGLED.basis(side) == pytest.approx(intended(side), abs=1e-15)
