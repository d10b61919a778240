"""An operator's own Still, T and Forward pose: held by feel, so not quite at right angles to each other.

[Lim2022 sec. IV-A] measures 82° to 102° between them. How the operator misses right angles is how the operator's sense of space is
distorted: a motion meant in the ideal axes (down, outward, forward) is carried out in those of the primitive poses.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from retarget.core.types import Array
from retarget.samples.arm_reach import ARM_LENGTH, LEFT

_SEARCHED_DEG: Final = 6.0


@dataclass(frozen=True)
class Operator:
    """Angles in degrees, (left, right). The T-pose is exact: in it every segment from the chest up has its reference orientation.

    tpose_forward_deg: None = the angle with which the shoulder of [Lim2022 eq. 1] is the true one. Eq. 1 takes all three angles for right
    ones and shifts the shoulder for others, except where they cancel; here they do, so there is one truth to compare with. Both
    arms are alike by default: unless their misses are mirror images, the hands do not tell quite where the operator faces.
    """

    still_tpose_deg: tuple[float, float] = (86.0, 86.0)
    forward_still_deg: tuple[float, float] = (91.0, 91.0)
    tpose_forward_deg: tuple[float, float] | None = None

    def angles_deg(self, side: str) -> tuple[float, float, float]:
        """Between Still and T, T and Forward, Forward and Still, in the order of `core.calibration.ArmCalibration`."""
        at = 0 if side == "Left" else 1
        first, last = self.still_tpose_deg[at], self.forward_still_deg[at]
        if self.tpose_forward_deg is not None:
            return first, self.tpose_forward_deg[at], last
        return first, _balancing(first, last), last

    def directions(self, side: str) -> Array:
        """(3, 3) unit rows, chest frame: from the shoulder to the hand point in the Still, T and Forward pose."""
        left = LEFT[side]
        st, tf, fs = np.cos(np.radians(self.angles_deg(side)))
        down = np.sqrt(1 - st * st)
        height = (st * tf - fs) / down
        rows = [
            [0.0, left * st, -down],
            [0.0, left, 0.0],
            [np.sqrt(1 - tf * tf - height * height), left * tf, height],
        ]
        return np.array(rows)

    def basis(self, side: str) -> Array:
        """(3, 3) m, chest frame, columns S - sh, T - sh, F - sh: B of [Lim2022 eq. 6]."""
        return ARM_LENGTH * self.directions(side).T


RIGHT_ANGLED: Final = Operator((90.0, 90.0), (90.0, 90.0), (90.0, 90.0))
"""An operator without distortion."""


def intended(side: str) -> Array:
    """(3, 3) m: what the basis is meant to be, columns down, outward and forward in the chest's frame."""
    return ARM_LENGTH * np.array([[0.0, 0.0, 1.0], [0.0, LEFT[side], 0.0], [-1.0, 0.0, 0.0]])


def candidate_distances(angles_deg: tuple[float, float, float]) -> Array:
    """(3,) for an arm of length 1: the k of [Lim2022 eq. 1], how far the three candidates for the shoulder are from the circle's centre.

    angles_deg: between Still and T, T and Forward, Forward and Still; the distances belong to the same pairs.
    """
    chord2, radius2 = _circle(angles_deg)
    return np.asarray(np.sqrt(np.maximum(chord2 / 2 - radius2, 0.0)))


def _circle(angles_deg: tuple[float, float, float]) -> tuple[Array, float]:
    """Squares of the triangle's three sides and of its circumradius, for an arm of length 1."""
    chord2 = 2 - 2 * np.cos(np.radians(angles_deg))
    x, y, z = chord2
    # The denominator is (4 · area)², by Heron.
    return chord2, float(x * y * z / (2 * (x * y + y * z + z * x) - x * x - y * y - z * z))


def _balancing(first_deg: float, last_deg: float) -> float:
    """The T-Forward angle for which the mean of eq. 1's three distances is the shoulder's true distance from the circle's centre."""

    def excess(angle_deg: float) -> float:
        angles = (first_deg, angle_deg, last_deg)
        return float(candidate_distances(angles).mean() - np.sqrt(1 - _circle(angles)[1]))

    # To first order the cosines cancel.
    cosines = np.cos(np.radians([first_deg, last_deg])).sum()
    middle = float(np.degrees(np.arccos(-cosines)))
    low, high = middle - _SEARCHED_DEG, middle + _SEARCHED_DEG
    for _ in range(60):
        half = (low + high) / 2
        low, high = (half, high) if excess(half) < 0 else (low, half)
    return (low + high) / 2
