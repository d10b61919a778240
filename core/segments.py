"""The canonical human segments: 23 names of Xsens MVN, their tree, and the bones that limbs are made of.

Invariant of the house: every segment frame is the identity when the person stands in T-pose facing +X
(X forward, Y left, Z up). In these frames arm bones run along +Y (left) and -Y (right), leg bones along -Z.
"""

from __future__ import annotations

from typing import Final

PARENT: Final[dict[str, str | None]] = {
    "Pelvis": None,
    "L5": "Pelvis",
    "L3": "L5",
    "T12": "L3",
    "T8": "T12",
    "Neck": "T8",
    "Head": "Neck",
    "RightShoulder": "T8",
    "RightUpperArm": "RightShoulder",
    "RightForeArm": "RightUpperArm",
    "RightHand": "RightForeArm",
    "LeftShoulder": "T8",
    "LeftUpperArm": "LeftShoulder",
    "LeftForeArm": "LeftUpperArm",
    "LeftHand": "LeftForeArm",
    "RightUpperLeg": "Pelvis",
    "RightLowerLeg": "RightUpperLeg",
    "RightFoot": "RightLowerLeg",
    "RightToe": "RightFoot",
    "LeftUpperLeg": "Pelvis",
    "LeftLowerLeg": "LeftUpperLeg",
    "LeftFoot": "LeftLowerLeg",
    "LeftToe": "LeftFoot",
}
"""Child segment → parent segment, parents first, in the order Xsens numbers them."""

SEGMENTS: Final[tuple[str, ...]] = tuple(PARENT)

LIMB_END: Final[dict[str, str]] = {
    f"{side}{bone}": f"{side}{end}"
    for side in ("Left", "Right")
    for bone, end in (
        ("UpperArm", "ForeArm"),
        ("ForeArm", "Hand"),
        ("UpperLeg", "LowerLeg"),
        ("LowerLeg", "Foot"),
    )
}
"""Limb segment → the segment that starts where the limb's bone ends (a segment's origin is its proximal joint)."""

LOWER_BODY: Final[frozenset[str]] = frozenset(
    f"{side}{part}" for side in ("Left", "Right") for part in ("UpperLeg", "LowerLeg", "Foot", "Toe")
)

FOOT_CONTACTS: Final[tuple[str, ...]] = ("LeftFoot_Heel", "LeftFoot_Toe", "RightFoot_Heel", "RightFoot_Toe")
"""Order of the four columns of `HumanMotion.foot_contacts`."""
