"""Trunk, head and arms: from anatomical angles to the rotation of each joint.

All angles are rad, arrays (T,). Flexion bends forward, rotation turns to the left, sidebend leans to the left.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from retarget.core import rotations
from retarget.core.types import Array
from retarget.samples.person import about


def trunk(flexion: Array, sidebend: Array, rotation: Array) -> dict[str, Array]:
    """L5, L3, T12 and T8: the bend of the chest against the pelvis, a quarter in each joint."""
    quarter = _bend(flexion / 4, sidebend / 4, rotation / 4)
    return dict.fromkeys(("L5", "L3", "T12", "T8"), quarter)


def head(flexion: Array, sidebend: Array, rotation: Array) -> dict[str, Array]:
    """Neck and head: the bend of the head against the chest, two fifths in the neck."""
    return {
        "Neck": _bend(0.4 * flexion, 0.4 * sidebend, 0.4 * rotation),
        "Head": _bend(0.6 * flexion, 0.6 * sidebend, 0.6 * rotation),
    }


@dataclass(frozen=True)
class Arm:
    """One arm's angles; the same numbers on both sides are mirror images.

    lowering: from T-pose (0) down to the side of the body (π/2), negative above the shoulder, in the frontal plane. flexion:
    then the lowered arm swings forward about the shoulder's lateral axis. across: then about the vertical, toward the other
    side. twist: of the upper arm about its bone, inward. elbow: flexion. pronation: of the forearm about its bone, 0 = palm
    down in T-pose, palm to the thigh beside the body. wrist: flexion toward the palm. deviation: toward the little finger.
    """

    lowering: Array
    flexion: Array
    across: Array
    twist: Array
    elbow: Array
    pronation: Array
    wrist: Array
    deviation: Array

    def rotations_of(self, side: str) -> dict[str, Array]:
        """Shoulder, upper arm, forearm and hand of `side` ("Left" or "Right"): (T, 4), each in its parent's frame."""
        left = 1.0 if side == "Left" else -1.0
        swing = rotations.multiply(about(1, -self.flexion), about(0, -left * self.lowering))
        upper = rotations.multiply(about(2, -left * self.across), rotations.multiply(swing, about(1, self.twist)))
        # The collar bone follows the arm: 11° down with the arm at the side, none in T-pose, 11° up overhead.
        raised = rotations.rotate(upper, np.array([0.0, left, 0.0]))[:, 2]
        collar = about(0, left * np.radians(11.0) * raised)
        # A real elbow is no perfect hinge: its carrying angle (10°, part of the straight arm that calibration calls zero)
        # fades as the elbow bends.
        carrying = np.radians(10.0) * (1 - np.cos(self.elbow)) / 2
        hinge = rotations.multiply(about(0, -left * carrying), about(2, -left * self.elbow))
        return {
            f"{side}Shoulder": collar,
            f"{side}UpperArm": rotations.multiply(rotations.conjugate(collar), upper),
            f"{side}ForeArm": rotations.multiply(hinge, about(1, self.pronation)),
            f"{side}Hand": rotations.multiply(about(0, -left * self.wrist), about(2, left * self.deviation)),
        }


def _bend(flexion: Array, sidebend: Array, rotation: Array) -> Array:
    return rotations.multiply(about(2, rotation), rotations.multiply(about(1, flexion), about(0, -sidebend)))
