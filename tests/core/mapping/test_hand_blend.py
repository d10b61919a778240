"""Hands that meet: exactly at contact, not at all far away, without a jump or a kink in between."""

from __future__ import annotations

import numpy as np
import pytest
from retarget.core.mapping.hand_blend import CONTACT_M, FAR_M, blended_hands, pulled_within_reach
from retarget.core.types import Array

LEFT, RIGHT = np.array([0.4, 0.15, 0.3]), np.array([0.42, -0.17, 0.28])


def apart(distance: Array) -> Array:
    """Operator's difference of hands (T, 3), mostly sideways."""
    return np.asarray(distance)[:, None] * np.array([0.0, 0.8, 0.6])


def gap(distance: Array) -> Array:
    """Vector between the robot's hands (T, 3) while its unblended targets stay put."""
    operator = apart(distance)
    left, right = blended_hands(np.tile(LEFT, (len(operator), 1)), np.tile(RIGHT, (len(operator), 1)), operator)
    return left - right


@pytest.mark.parametrize("distance", [0.0, 0.04, CONTACT_M])
def test_at_contact_the_robots_hands_are_as_far_apart_as_the_operators(distance: float) -> None:
    assert gap(np.array([distance]))[0] == pytest.approx(apart(np.array([distance]))[0], abs=1e-12)


def test_far_apart_nothing_changes() -> None:
    operator = apart(np.array([FAR_M, 0.5, 1.2]))
    left, right = blended_hands(np.tile(LEFT, (3, 1)), np.tile(RIGHT, (3, 1)), operator)
    assert (left == LEFT).all()
    assert (right == RIGHT).all()


def test_the_midpoint_stays() -> None:
    operator = apart(np.linspace(0, 0.5, 20))
    left, right = blended_hands(np.tile(LEFT, (20, 1)), np.tile(RIGHT, (20, 1)), operator)
    assert 0.5 * (left + right) == pytest.approx(np.tile(0.5 * (LEFT + RIGHT), (20, 1)), abs=1e-12)


def test_it_is_once_continuously_differentiable() -> None:
    """Central differences over the whole range: slopes stay below 1 + 1.5 |d - o| / (FAR - CONTACT), and change by O(step)."""
    step = 1e-5
    distance = np.arange(0.01, 0.5, step)
    slope = np.diff(gap(distance), axis=0) / step
    largest = 1 + 1.5 * np.linalg.norm(LEFT - RIGHT - apart(distance), axis=1).max() / (FAR_M - CONTACT_M)
    assert np.linalg.norm(slope, axis=1).max() < largest
    curvature = 6 / (FAR_M - CONTACT_M) ** 2 * 0.7 + 2 * 1.5 / (
        FAR_M - CONTACT_M
    )  # |s''| ≤ 6, |d - o| < 0.7, |s'| ≤ 1.5
    assert np.linalg.norm(np.diff(slope, axis=0), axis=1).max() < curvature * step * 1.01


def test_together_within_reach() -> None:
    """Both arms stretched forward, hands brought together: pulled back until the longer way fits, still together."""
    shoulders = np.array([[0.0, 0.2, 0.0]]), np.array([[0.0, -0.2, 0.0]])
    left, right = pulled_within_reach(
        np.array([[0.7, 0.02, 0.0]]), np.array([[0.7, -0.02, 0.0]]), shoulders, (0.7, 0.7)
    )
    assert left[0] == pytest.approx([np.sqrt(0.7**2 - 0.18**2), 0.02, 0.0], abs=1e-9)
    assert left - right == pytest.approx(np.array([[0.0, 0.04, 0.0]]), abs=1e-12)


def test_hands_within_reach_stay() -> None:
    shoulders = np.array([[0.0, 0.2, 0.4]]), np.array([[0.0, -0.2, 0.4]])
    left, right = pulled_within_reach(LEFT[None], RIGHT[None], shoulders, (0.6, 0.6))
    assert left[0] == pytest.approx(LEFT, abs=1e-12)
    assert right[0] == pytest.approx(RIGHT, abs=1e-12)
