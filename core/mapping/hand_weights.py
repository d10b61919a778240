"""How much of each calibration pose a hand position holds: the mapping vector w of [Lim2022 eqs 3-10], frame by frame.

h = B w, with the columns of B the three calibration hand points seen from the shoulder. w follows the hand by velocities,

    min over ẇ of ‖B ẇ - (ḣ + K_ha (h - B w))‖²   [eqs 9, 10]
    subject to |B ẇ| ≤ hand_speed on each axis, K_w (w_lower - w) ≤ ẇ ≤ K_w (w_upper - w), |ẇ| ≤ weight_rate,

because the pseudo-inverse alone would let the hand jump and w leave its box. Three decisions of ours:

- The authors' code adds 1e-5‖ẇ‖², which keeps ẇ small where B is nearly singular, and biases w everywhere. Here the same term
  weighs the distance from the unconstrained answer B⁻¹v, so that w = B⁻¹h exactly as long as no limit is active.
- Between two frames the hand moves along a straight line, and the feed-forward ḣ is its exact velocity there: no lag is left.
- A control step lasts at most 1 ms, whatever the recording's rate: a gain of 100/s needs gain · step ≤ 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from retarget.core.errors import InvalidDataError
from retarget.core.mapping.projection import Projection
from retarget.core.types import Array, BoolArray

CONTROL_STEP_S = 1e-3
REGULARIZATION = 1e-5
"""Factor on ‖ẇ - B⁻¹v‖², m²."""
WORST_CONDITION = 100.0
"""A basis whose longest and shortest direction differ by more has two poses that are nearly the same, or three in one plane."""
ON_TRACK = 1e-12
"""A weight that is this near to the hand's own is the hand's own."""
AT_BOUNDARY = 1e-9
"""A weight that holds the box's boundary changes by rounding; 1/s, far below any motion."""


@dataclass(frozen=True)
class HandLimits:
    """Gains and limits of [Lim2022 eq. 10]; defaults are the authors', with the paper's box of ±1 for the weights.

    hand_gain: K_ha, 1/s. weight_gain: K_w, 1/s. hand_speed_m_s: each axis of the operator's mapped hand. weight_rate: |ẇ|, 1/s.
    """

    hand_gain: float = 100.0
    weight_gain: float = 20.0
    hand_speed_m_s: float = 2.0
    weight_rate: float = 30.0
    weight_lower: float = -1.0
    weight_upper: float = 1.0

    def __post_init__(self) -> None:
        for name in ("hand_gain", "weight_gain", "hand_speed_m_s", "weight_rate"):
            if not 0 < getattr(self, name) < np.inf:
                raise InvalidDataError(f"HandLimits.{name}: found {getattr(self, name):g}, expected above 0, finite")
        if not -np.inf < self.weight_lower < self.weight_upper < np.inf:
            raise InvalidDataError(
                f"HandLimits: found weights from {self.weight_lower:g} to {self.weight_upper:g}, expected lower < upper"
            )


@dataclass(frozen=True, eq=False)
class HandWeights:
    """w over a clip. weights: (T, 3), of Still, T and Forward. rate: (T, 3) 1/s, mean over the step that led to the frame, 0 in
    the first.

    limited: (T,) whether a limit was active on the way to the frame.
    """

    weights: Array
    rate: Array
    limited: BoolArray


def mapping_weights(
    time: Array, hand: Array, basis: Array, *, feed_forward: bool = True, limits: HandLimits | None = None
) -> HandWeights:
    """The mapping vector of one hand.

    time: (T,) s. hand: (T, 3) m, h of [Lim2022 eq. 3]: from the shoulder to the hand point, in the shoulder's frame as it was in
    the Still pose. basis: (3, 3) m, columns Still, T, Forward in the same frame. Without `feed_forward` the hand is followed by
    feedback only, as in the authors' code. The first frame is the hand's own answer, as near as the weights' box allows.

    Raises `InvalidDataError` for a basis that doesn't span the space, and for a hand that is not finite.
    """
    limits = limits or HandLimits()
    if not np.isfinite(hand).all():
        raise InvalidDataError(f"hand position: found {hand[~np.isfinite(hand)][0]}, expected finite values")
    condition = np.linalg.cond(basis) if np.isfinite(basis).all() else np.inf
    if not condition <= WORST_CONDITION:
        raise InvalidDataError(
            f"calibration poses: found three arm vectors that nearly lie in one plane (condition {condition:.3g}), "
            f"expected Still, T and Forward at about right angles (at most {WORST_CONDITION:g})"
        )
    follower = _Follower(basis, limits)
    own = hand @ follower.inverse.T
    free = _free_steps(time, hand, own, follower) if feed_forward else np.zeros(len(time) - 1, bool)
    stops = np.append(np.flatnonzero(~free), len(time) - 1)
    weights, limited = np.array(own), np.zeros(len(time), bool)
    weights[0] = follower.start(own[0])
    limited[0] = np.abs(weights[0] - own[0]).max() > ON_TRACK
    k = 0
    while k < len(time) - 1:
        if feed_forward and np.abs(weights[k] - own[k]).max() <= ON_TRACK:
            k = int(stops[np.searchsorted(stops, k)])  # up to there w is B⁻¹h
            if k == len(time) - 1:
                break
        weights[k + 1], limited[k + 1] = follower.follow(
            time[k + 1] - time[k], weights[k], hand[k], hand[k + 1], feed_forward
        )
        k += 1
    # What the solution leaves to rounding at its own box.
    weights = weights.clip(limits.weight_lower, limits.weight_upper)
    rate = np.zeros_like(weights)
    rate[1:] = np.diff(weights, axis=0) / np.diff(time)[:, None]
    return HandWeights(weights, rate, limited)


def _free_steps(time: Array, hand: Array, own: Array, follower: _Follower) -> BoolArray:
    """Per step between frames (T - 1,): whether w, starting at the hand's own, stays there without touching a limit."""
    limits, dt = follower.limits, np.diff(time)[:, None]
    steps = np.array([follower.substeps(float(d)) for d in dt[:, 0]], float)[:, None]
    rate = np.diff(own, axis=0) / dt
    free = (np.abs(np.diff(hand, axis=0) / dt) <= limits.hand_speed_m_s) & (np.abs(rate) <= limits.weight_rate)
    # Along the straight line the barrier is tightest where its first or its last control step begins.
    for w in (own[:-1], own[1:] - rate * dt / steps):
        free &= limits.weight_gain * (limits.weight_lower - w) <= rate + AT_BOUNDARY
        free &= rate - AT_BOUNDARY <= limits.weight_gain * (limits.weight_upper - w)
    return np.asarray(free.all(axis=1))


class _Follower:
    """One control step after another, for one basis."""

    def __init__(self, basis: Array, limits: HandLimits) -> None:
        self.limits, self.basis, self.inverse = limits, basis, np.linalg.inv(basis)
        metric = basis.T @ basis + REGULARIZATION * np.eye(3)
        self._rows = np.concatenate([basis, np.eye(3)])
        self._velocity = Projection(metric, self._rows)
        self._box = Projection(metric, np.eye(3))

    def substeps(self, duration: float) -> int:
        """Control steps in a frame of `duration` s."""
        shortest = min(CONTROL_STEP_S, 1.0 / self.limits.hand_gain, 1.0 / self.limits.weight_gain)
        return max(1, int(np.ceil(duration / shortest - 1e-9)))

    def start(self, own: Array) -> Array:
        """Where the controller would come to rest: the point of the weights' box nearest to `own`."""
        low, high = np.full(3, self.limits.weight_lower), np.full(3, self.limits.weight_upper)
        return np.asarray(self._box.nearest(own, low, high).clip(low, high))

    def follow(self, duration: float, w: Array, begin: Array, end: Array, feed_forward: bool) -> tuple[Array, bool]:
        """w at the end of a frame in which the hand moves from `begin` to `end`, and whether a limit was active."""
        limits, count = self.limits, self.substeps(duration)
        step = duration / count
        own, own_step = self.inverse @ begin, self.inverse @ (end - begin) / count
        feed = own_step / step if feed_forward else np.zeros(3)
        upper, lower = np.full(6, limits.hand_speed_m_s), np.full(6, -limits.hand_speed_m_s)
        limited = False
        for i in range(count):
            # In terms of w: B⁻¹(ḣ + K (h - B w)).
            wanted = feed + limits.hand_gain * (own + i * own_step - w)
            upper[3:] = np.minimum(limits.weight_gain * (limits.weight_upper - w), limits.weight_rate)
            lower[3:] = np.maximum(limits.weight_gain * (limits.weight_lower - w), -limits.weight_rate)
            rate = self._velocity.nearest(wanted, lower, upper)
            if rate is not wanted:
                limited = True
                # The hand's speed to the last digit; standing still is always allowed, so that slower is, too.
                rate = rate * min(1.0, limits.hand_speed_m_s / max(np.abs(self.basis @ rate).max(), 1e-300))
            w = (w + step * rate).clip(limits.weight_lower, limits.weight_upper)
        return w, limited
