"""Absolute and relative orientation mapping [Lim2022 sec. II-D, eqs 11, 12].

AOM: R_d = R. The robot's link is oriented as the person's segment is; with T-pose-aligned segments that is R · H, H the link's
rotation in the robot's own T-pose (`link_rotations`). Good where the device sits on the body the same way every time: hands.

ROM: R_d = ΔR · R̄_robot, ΔR = R R̄ᵀ, against the Still pose: the robot's Still pose is turned as the person's has turned since.
Good where an elastic band may sit askew: chest, head, upper arms, shoulders.

Chest, head and shoulders look the same in Still and T-pose, so their R̄_robot is H. Arms hang in the one and are stretched out in
the other, a quarter turn about X: R̄_robot = Q · H. ROM is then AOM of the segment R R̄ᵀ Q, and both agree when the person's own
Still pose is Q, arms straight down.
"""

from __future__ import annotations

import numpy as np
from retarget.core import rotations
from retarget.core.calibration import Calibration
from retarget.core.types import Array, HumanMotion

RELATIVE = frozenset({"T8", "Head", "LeftUpperArm", "RightUpperArm", "LeftShoulder", "RightShoulder"})
"""Segments that follow by relative orientation; the paper takes the head absolutely, the authors' code relatively."""


def ideal_still(segment: str) -> Array:
    """Orientation (4,) wxyz, operator frame ← segment, in a perfect Still pose: arms straight down, everything else as in
    T-pose."""
    if not segment.endswith(("UpperArm", "ForeArm", "Hand")):
        return np.array([1.0, 0.0, 0.0, 0.0])
    quarter = -np.pi / 2 if segment.startswith("Left") else np.pi / 2
    return rotations.exp(np.array([quarter, 0.0, 0.0]))


def turned_since_still(motion: HumanMotion, calibration: Calibration, segment: str) -> Array:
    """ΔR = R R̄ᵀ (T, 4) wxyz in the operator frame; R itself, over a perfect Still pose, where the calibration lacks the
    segment."""
    still = calibration.still_orientation.get(segment)
    if still is None:
        still = calibration.chest_orientation if segment == "T8" else ideal_still(segment)
    return rotations.multiply(motion.orientation[:, motion.index(segment)], rotations.conjugate(still))


def mapped_orientation(motion: HumanMotion, calibration: Calibration, segment: str) -> Array:
    """Orientation (T, 4) wxyz that the robot's counterpart of `segment` should have, T-pose aligned; times H it is the link's.

    motion: in the operator frame (`operator_frame`). A shoulder that isn't measured goes with the chest, as the paper assumes.
    """
    if segment.endswith("Shoulder") and not motion.has(segment):
        segment = "T8"
    if segment not in RELATIVE:
        return np.array(motion.orientation[:, motion.index(segment)])
    turned = turned_since_still(motion, calibration, segment)
    return rotations.make_continuous(rotations.multiply(turned, ideal_still(segment)))
