"""Hands that meet when the operator's meet: closing the gap of [Lim2022 sec. V].

Hands mapped from their own shoulders keep a gap, or cross, where the operator's touch, because shoulders and arms have other
proportions. Between FAR_M and CONTACT_M of distance D between the operator's hands, the vector d between the robot's hands turns
into the operator's own, o:

    d' = (1 - s) d + s o,    s = 3u² - 2u³,    u = (FAR_M - D) / (FAR_M - CONTACT_M) within 0 and 1,

about the unchanged midpoint. s has a continuous derivative, so the targets move without a jerk, by at most 1.5 |d - o| / (FAR_M -
CONTACT_M) more than unblended per metre that the operator's hands approach. Beyond FAR_M nothing changes, and from CONTACT_M
inward the robot's hands are exactly as far apart, in the same direction, as the operator's. No mode is switched and nothing
remembered.
"""

from __future__ import annotations

import numpy as np
from retarget.core.types import Array

FAR_M = 0.4
CONTACT_M = 0.06
"""Distance of the hand points when palms touch, with room for gloves."""


def blended_hands(left: Array, right: Array, operator: Array) -> tuple[Array, Array]:
    """The robot's hand points (T, 3) m, left and right, blended. operator: (T, 3) m, the operator's left hand point less the
    right one, same axes."""
    distance = np.linalg.norm(operator, axis=1, keepdims=True)
    near = ((FAR_M - distance) / (FAR_M - CONTACT_M)).clip(0.0, 1.0)
    share = near**2 * (3.0 - 2.0 * near)
    half = 0.5 * ((1.0 - share) * (left - right) + share * operator)
    middle = 0.5 * (left + right)
    # Untouched to the last digit where the hands are far apart.
    return np.where(share > 0, middle + half, left), np.where(share > 0, middle - half, right)


def pulled_within_reach(
    left: Array, right: Array, shoulders: tuple[Array, Array], reach: tuple[float, float]
) -> tuple[Array, Array]:
    """Both hand points moved together toward the point between the shoulders until each is within its arm's length (m); their
    difference stays.

    Arms stretched forward can't also meet: keeping hands together matters more than how far out they are.
    """
    between = 0.5 * (shoulders[0] + shoulders[1])
    middle = 0.5 * (left + right) - between
    scale = np.ones((len(left), 1))
    for hand, shoulder, length in zip((left, right), shoulders, reach, strict=True):
        rest = hand - middle - shoulder  # hand = shoulder + rest + scale · middle
        a = np.einsum("ti,ti->t", middle, middle)[:, None]
        b = np.einsum("ti,ti->t", middle, rest)[:, None]
        c = np.einsum("ti,ti->t", rest, rest)[:, None] - length**2
        root = np.sqrt(np.maximum(b * b - a * c, 0.0))
        scale = np.where(a + 2 * b + c > 0, np.minimum(scale, (root - b) / np.maximum(a, 1e-12)), scale)
    scale = scale.clip(0.0, 1.0)
    return left + (scale - 1.0) * middle, right + (scale - 1.0) * middle
