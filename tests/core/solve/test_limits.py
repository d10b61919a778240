"""Boxes on steps: what may follow a posture, how speeds fade toward limits, the nearest posture that coupled rows allow."""

from __future__ import annotations

import numpy as np
import pytest
from retarget.core.errors import SolverError
from retarget.core.solve.limits import FREE_SPEED_RAD_S, DampedVelocityBounds, nearest_feasible, reachable
from scipy.optimize import minimize


def test_reachable_is_as_far_as_speed_and_limits_let() -> None:
    lower, upper = reachable(
        np.array([0.0, 0.95, -1.0]), np.full(3, -1.0), np.full(3, 1.0), np.array([2.0, 2.0, 4.0]), 0.1
    )
    np.testing.assert_allclose(lower, [-0.2, 0.75, -1.0])
    np.testing.assert_allclose(upper, [0.2, 1.0, -0.6])


class TestDampedVelocityBounds:
    LOWER, UPPER, SPEED = np.array([-1.0, -0.2, 0.0]), np.array([1.0, 3.0, 0.5]), np.array([2.0, 10.0, 1.0])

    def test_formula(self) -> None:
        """-v tanh(k (s - s_min)) ≤ ṡ ≤ v tanh(k (s_max - s)), k = 0.5, as the authors' code has it."""
        bounds = DampedVelocityBounds(2, self.LOWER, self.UPPER, self.SPEED)
        joints = np.array([0.3, 2.9, 0.25])
        bounds.update(joints, 1 / 60)
        np.testing.assert_allclose(bounds.low[2:], -self.SPEED * np.tanh(0.5 * (joints - self.LOWER)), atol=1e-14)
        np.testing.assert_allclose(bounds.high[2:], self.SPEED * np.tanh(0.5 * (self.UPPER - joints)), atol=1e-14)
        np.testing.assert_array_equal(
            [bounds.low[:2], bounds.high[:2]], FREE_SPEED_RAD_S * np.array([[-1.0] * 2, [1.0] * 2])
        )

    @pytest.mark.parametrize("step_s", [1e-3, 1 / 60, 0.5, 5.0])
    def test_no_step_passes_a_limit(self, step_s: float) -> None:
        bounds = DampedVelocityBounds(0, self.LOWER, self.UPPER, self.SPEED)
        rng = np.random.default_rng(0)
        for _ in range(200):
            joints = self.LOWER + (self.UPPER - self.LOWER) * rng.random(3)
            bounds.update(joints, step_s)
            assert (joints + step_s * bounds.low >= self.LOWER - 1e-12).all()
            assert (joints + step_s * bounds.high <= self.UPPER + 1e-12).all()
            assert (bounds.low <= 0).all()
            assert (bounds.high >= 0).all()
            assert (np.abs([bounds.low, bounds.high]) <= self.SPEED).all()

    def test_at_a_limit_there_is_only_the_way_back(self) -> None:
        bounds = DampedVelocityBounds(0, self.LOWER, self.UPPER, self.SPEED)
        bounds.update(self.LOWER, 0.01)
        assert (bounds.low == 0).all()
        assert (bounds.high > 0).all()


class TestNearestFeasible:
    ROWS = (np.array([[1.0, 1.0, 0.0], [0.0, 1.0, -2.0]]), np.array([-0.5, -1.0]), np.array([0.5, 1.0]))

    def test_without_rows_it_clips(self) -> None:
        found = nearest_feasible(np.array([2.0, -3.0]), np.full(2, -1.0), np.full(2, 1.0), None)
        np.testing.assert_array_equal(found, [1.0, -1.0])

    def test_what_is_feasible_stays(self) -> None:
        joints = np.array([0.1, 0.2, 0.1])
        np.testing.assert_array_equal(nearest_feasible(joints, -np.ones(3), np.ones(3), self.ROWS), joints)

    def test_is_the_projection(self) -> None:
        rng = np.random.default_rng(0)
        matrix, low, high = self.ROWS
        constraints = [
            {"type": "ineq", "fun": lambda x: matrix @ x - low},
            {"type": "ineq", "fun": lambda x: high - matrix @ x},
        ]
        for _ in range(20):
            joints = rng.uniform(-2, 2, 3)
            found = nearest_feasible(joints, -np.ones(3), np.ones(3), self.ROWS)
            assert (matrix @ found >= low).all()
            assert (matrix @ found <= high).all()
            expected = minimize(
                lambda x, at=joints: 0.5 * np.sum((x - at) ** 2),
                np.zeros(3),
                bounds=[(-1, 1)] * 3,
                constraints=constraints,
            ).x
            np.testing.assert_allclose(found, expected, atol=1e-5)

    def test_rows_that_no_posture_meets(self) -> None:
        rows = (np.array([[1.0, 1.0]]), np.array([5.0]), np.array([6.0]))
        with pytest.raises(SolverError, match="no posture satisfies"):
            nearest_feasible(np.zeros(2), -np.ones(2), np.ones(2), rows)
