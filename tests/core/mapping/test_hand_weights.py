"""The mapping vector of a hand: exact without limits, inside its limits with them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from retarget.core.errors import InvalidDataError
from retarget.core.mapping.hand_weights import CONTROL_STEP_S, HandLimits, mapping_weights
from retarget.core.types import Array
from scipy.optimize import lsq_linear, minimize

from tests.core.mapping.operators import authors_arms

BASIS = authors_arms()["Left"].basis
RATE_HZ = 90.0


def clip(weights: Array) -> tuple[Array, Array]:
    """(time, hand) of a hand that passes through `weights` (T, 3) at 90 Hz."""
    return np.arange(len(weights)) / RATE_HZ, weights @ BASIS.T


def gentle(seconds: float = 2.0) -> Array:
    t = np.arange(int(seconds * RATE_HZ)) / RATE_HZ
    return np.stack([0.4 + 0.2 * np.sin(2 * t), 0.3 + 0.3 * np.cos(1.7 * t), 0.2 + 0.4 * np.sin(1.1 * t + 1)], axis=1)


def speeds(found: Array) -> Array:
    return np.asarray(np.abs(np.diff(found @ BASIS.T, axis=0) * RATE_HZ))


def test_without_limits_it_is_the_inverse() -> None:
    time, hand = clip(gentle())
    found = mapping_weights(time, hand, BASIS)
    assert found.weights == pytest.approx(np.linalg.solve(BASIS, hand.T).T, abs=1e-12)
    assert not found.limited.any()
    assert found.rate[1:] == pytest.approx(np.diff(found.weights, axis=0) * RATE_HZ, abs=1e-9)
    assert (found.rate[0] == 0).all()


def test_without_feed_forward_it_lags_by_one_over_the_gain() -> None:
    """A ramp followed by a first-order system of gain K is late by ramp / K, up to half a control step."""
    ramp = np.array([0.3, -0.2, 0.1])
    t = np.arange(180) / RATE_HZ
    time, hand = clip(0.1 + t[:, None] * ramp)
    found = mapping_weights(time, hand, BASIS, feed_forward=False)
    assert (0.1 + t[-1] * ramp - found.weights[-1]) == pytest.approx(ramp / 100.0, rel=CONTROL_STEP_S * 100.0)


@pytest.mark.parametrize("pose", range(3))
def test_a_primitive_pose_is_reached_and_held(pose: int) -> None:
    """From elsewhere at a person's pace, then held for 1.5 s: exactly one of the pose, nothing of the others."""
    t = np.arange(270) / RATE_HZ
    share = (3 * (t / 1.5).clip(0, 1) ** 2 - 2 * (t / 1.5).clip(0, 1) ** 3)[:, None]
    time, hand = clip((1 - share) * [0.3, 0.3, 0.3] + share * np.eye(3)[pose])
    found = mapping_weights(time, hand, BASIS)
    assert found.weights[-1] == pytest.approx(np.eye(3)[pose], abs=1e-6)
    held = mapping_weights(time[-50:], hand[-50:], BASIS)
    assert held.weights == pytest.approx(np.tile(np.eye(3)[pose], (50, 1)), abs=1e-12)
    assert not held.limited.any()


@pytest.mark.parametrize("box", [(-1.0, 1.0), (-1.1, 1.0), (-0.2, 0.6)])
@pytest.mark.parametrize("feed_forward", [True, False])
def test_neither_box_nor_speed_is_ever_left(box: tuple[float, float], feed_forward: bool) -> None:
    """Jumps of metres, out of reach and back."""
    random = np.random.default_rng(3)
    hand = np.repeat(random.normal(scale=0.8, size=(30, 3)), 9, axis=0)
    time = np.arange(len(hand)) / RATE_HZ
    limits = HandLimits(weight_lower=box[0], weight_upper=box[1])
    found = mapping_weights(time, hand, BASIS, feed_forward=feed_forward, limits=limits)
    assert found.weights.min() >= box[0]
    assert found.weights.max() <= box[1]
    assert speeds(found.weights).max() <= limits.hand_speed_m_s * (1 + 1e-9)
    assert np.abs(found.rate).max() <= limits.weight_rate * (1 + 1e-9)
    assert found.limited.any()


def test_a_jump_is_followed_at_the_speed_limit_along_each_axis() -> None:
    """The hand jumps by 0.2 m along x only: at 2 m/s it takes 0.1 s, and the other axes stay."""
    begin = BASIS @ [0.3, 0.3, 0.2]
    hand = np.tile(begin, (60, 1))
    hand[10:, 0] += 0.2
    found = mapping_weights(np.arange(60) / RATE_HZ, hand, BASIS, feed_forward=False)
    path = found.weights @ BASIS.T - begin
    assert np.abs(path[:, 1:]).max() < 1e-6
    during = slice(12, 16)
    assert np.diff(path[during, 0]) * RATE_HZ == pytest.approx(np.full(3, 2.0), abs=1e-9)
    assert path[-1, 0] == pytest.approx(0.2, abs=1e-9)


def test_one_control_step_solves_the_papers_programme() -> None:
    """[Lim2022 eq. 10] by SciPy's general solver, for one step of 1 ms from random states, without feed-forward."""
    random = np.random.default_rng(5)
    for _ in range(30):
        w = random.uniform(-0.99, 0.99, size=3)
        hand = BASIS @ (w + random.normal(scale=0.05, size=3))
        found = mapping_weights(
            np.array([0.0, 1e-3, 2e-3]), np.array([BASIS @ w, hand, hand]), BASIS, feed_forward=False
        )
        rate = found.rate[2]
        wanted = 100.0 * (hand - BASIS @ w)
        rows = [
            {"type": "ineq", "fun": lambda x: 2.0 - BASIS @ x},
            {"type": "ineq", "fun": lambda x: 2.0 + BASIS @ x},
            {"type": "ineq", "fun": lambda x, w=w: 20.0 * (1.0 - w) - x},
            {"type": "ineq", "fun": lambda x, w=w: x - 20.0 * (-1.0 - w)},
        ]
        bound = [(-30.0, 30.0)] * 3
        truth = minimize(
            lambda x, v=wanted: np.sum((BASIS @ x - v) ** 2), np.zeros(3), bounds=bound, constraints=rows,
            method="SLSQP", options={"ftol": 1e-15, "maxiter": 500},
        )  # fmt: skip
        assert rate == pytest.approx(truth.x, abs=2e-3 * max(1.0, np.abs(truth.x).max()))


def test_the_first_frame_is_the_nearest_in_the_box() -> None:
    hand = (BASIS @ np.array([1.4, -0.3, 1.2]))[None]
    found = mapping_weights(np.array([0.0]), hand, BASIS)
    root = np.linalg.cholesky(BASIS.T @ BASIS + 1e-5 * np.eye(3)).T
    truth = lsq_linear(root, root @ np.array([1.4, -0.3, 1.2]), (-1, 1), tol=1e-15).x
    assert found.weights[0] == pytest.approx(truth, abs=1e-6)
    assert found.limited.tolist() == [True]


def test_out_of_reach_it_rests_where_it_would_start() -> None:
    """The controller's rest is the constrained optimum, so a clip may be cut anywhere."""
    outside = np.array([1.4, -0.3, 1.2])
    t = np.arange(180) / RATE_HZ
    time, hand = clip(np.where(t[:, None] < 0.2, [0.3, 0.3, 0.3], outside))
    late = mapping_weights(time, hand, BASIS).weights[-1]
    assert late == pytest.approx(mapping_weights(time[:1], hand[-1:], BASIS).weights[0], abs=1e-6)


@given(st.integers(0, 10_000), st.sampled_from([30.0, 90.0, 240.0, 1000.0]))
@settings(max_examples=15)
def test_after_a_limit_it_returns_to_the_hand(seed: int, rate_hz: float) -> None:
    """A lunge beyond the limits, then a second of gentle motion: the hand's own weights to 1e-9, whatever the frame rate."""
    random = np.random.default_rng(seed)
    t = np.arange(int(1.5 * rate_hz)) / rate_hz
    weights = 0.3 + 0.2 * np.sin(t[:, None] * random.uniform(0.5, 2, 3) + random.uniform(0, 6, 3))
    weights[: int(0.2 * rate_hz)] += random.normal(size=3)
    found = mapping_weights(t, weights @ BASIS.T, BASIS)
    assert found.weights[-1] == pytest.approx(weights[-1], abs=1e-9)


@pytest.mark.parametrize(
    "basis", [np.diag([0.6, 0.6, 1e-4]), np.ones((3, 3)), np.full((3, 3), np.nan)], ids=["flat", "same", "nan"]
)
def test_a_basis_that_does_not_span_the_space(basis: Array) -> None:
    with pytest.raises(
        InvalidDataError, match=r"^calibration poses: found three arm vectors that nearly lie in one plane"
    ):
        mapping_weights(np.array([0.0]), np.zeros((1, 3)), basis)


def test_bad_numbers_are_named() -> None:
    with pytest.raises(InvalidDataError, match=r"^hand position: found nan, expected finite values$"):
        mapping_weights(np.array([0.0]), np.full((1, 3), np.nan), BASIS)
    with pytest.raises(InvalidDataError, match=r"^HandLimits.hand_gain: found 0, expected above 0, finite$"):
        HandLimits(hand_gain=0.0)
    with pytest.raises(InvalidDataError, match=r"weights from 1 to -1, expected lower < upper$"):
        HandLimits(weight_lower=1.0, weight_upper=-1.0)
