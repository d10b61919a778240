"""The person that all samples show: lengths from published body proportions, joints in T-pose axes, forward kinematics.

Segment lengths are fractions of stature after Drillis & Contini, "Body Segment Parameters" (1966), as reprinted in Winter,
"Biomechanics and Motor Control of Human Movement": ankle height 0.039, shank 0.246, thigh 0.245, upper arm 0.186, forearm
0.146, hand 0.108, shoulder height 0.818, foot length 0.152 of the stature. That source gives outer breadths and no spine;
where it is silent (distance of the hip and shoulder joint centres, the split of the trunk into six segments, the split of the
foot) the fractions below are this project's own choice, between the values that are usual for adults.

Frames: every segment frame is the identity in T-pose facing +X (X forward, Y left, Z up). Metres, radians, quaternions wxyz.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from retarget.core import rotations
from retarget.core.segments import PARENT, SEGMENTS
from retarget.core.types import Array

STATURE: Final = 1.75
SHOE_SOLE: Final = 0.010

THIGH: Final = 0.245 * STATURE
SHANK: Final = 0.246 * STATURE
ANKLE_HEIGHT: Final = 0.039 * STATURE + SHOE_SOLE
UPPER_ARM: Final = 0.186 * STATURE
FOREARM: Final = 0.146 * STATURE
HAND: Final = 0.108 * STATURE
FOOT: Final = 0.152 * STATURE

# The sole runs from the heel to the tip of the toes. As in Xsens' own model the joint at the ball of the foot lies on the sole.
HEEL_BEHIND_ANKLE: Final = 0.19 * FOOT
BALL_AHEAD_OF_ANKLE: Final = 0.53 * FOOT
TOE_LENGTH: Final = 0.28 * FOOT

HIP_HALF_WIDTH: Final = 0.050 * STATURE
SHOULDER_HALF_WIDTH: Final = 0.104 * STATURE
CLAVICLE_START: Final = 0.017 * STATURE

HIP_HEIGHT: Final = ANKLE_HEIGHT + SHANK + THIGH
"""Height of the hip joints above the floor in T-pose."""

# Pelvis to T8: shares of the way from the hips to the level of the shoulder joints, which is (0.818 − 0.530) of the stature.
_TRUNK: Final = (0.818 - 0.530) * STATURE
_SPINE: Final = {"L5": 0.22, "L3": 0.20, "T12": 0.19, "T8": 0.19}
_SHOULDER_ABOVE_T8: Final = (1 - sum(_SPINE.values())) * _TRUNK
_NECK_ABOVE_T8: Final = 0.069 * STATURE
_HEAD_ABOVE_NECK: Final = 0.049 * STATURE


def _joint_offsets() -> dict[str, Array]:
    offsets = {
        "L5": (0.0, 0.0, _SPINE["L5"] * _TRUNK),
        "L3": (0.0, 0.0, _SPINE["L3"] * _TRUNK),
        "T12": (0.0, 0.0, _SPINE["T12"] * _TRUNK),
        "T8": (0.0, 0.0, _SPINE["T8"] * _TRUNK),
        "Neck": (0.0, 0.0, _NECK_ABOVE_T8),
        "Head": (0.0, 0.0, _HEAD_ABOVE_NECK),
    }
    for side, left in (("Right", -1.0), ("Left", 1.0)):
        offsets |= {
            f"{side}Shoulder": (0.0, left * CLAVICLE_START, _SHOULDER_ABOVE_T8),
            f"{side}UpperArm": (0.0, left * (SHOULDER_HALF_WIDTH - CLAVICLE_START), 0.0),
            f"{side}ForeArm": (0.0, left * UPPER_ARM, 0.0),
            f"{side}Hand": (0.0, left * FOREARM, 0.0),
            f"{side}UpperLeg": (0.0, left * HIP_HALF_WIDTH, 0.0),
            f"{side}LowerLeg": (0.0, 0.0, -THIGH),
            f"{side}Foot": (0.0, 0.0, -SHANK),
            f"{side}Toe": (BALL_AHEAD_OF_ANKLE, 0.0, -ANKLE_HEIGHT),
        }
    return {name: np.array(offsets[name]) for name in SEGMENTS if name in offsets}


JOINT_OFFSETS: Final[Mapping[str, Array]] = _joint_offsets()
"""Segment → (3,) m, its proximal joint in its parent's frame; every segment but the pelvis."""

_HEAD_TOP: Final = STATURE + SHOE_SOLE - HIP_HEIGHT - sum(_SPINE.values()) * _TRUNK - _NECK_ABOVE_T8 - _HEAD_ABOVE_NECK


def _surface_points() -> dict[str, dict[str, Array]]:
    points: dict[str, dict[str, tuple[float, float, float]]] = {
        "Pelvis": {"pHipOrigin": (0.0, 0.0, 0.0)},
        "Head": {"pTopOfHead": (0.0, 0.0, _HEAD_TOP)},
    }
    for side, left in (("Right", -1.0), ("Left", 1.0)):
        points[f"{side}Hand"] = {f"p{side}TopOfHand": (0.0, left * HAND, 0.0)}
        points[f"{side}Foot"] = {f"p{side}HeelFoot": (-HEEL_BEHIND_ANKLE, 0.0, -ANKLE_HEIGHT)}
        points[f"{side}Toe"] = {f"p{side}Toe": (TOE_LENGTH, 0.0, 0.0)}
    return {segment: {label: np.array(xyz) for label, xyz in given.items()} for segment, given in points.items()}


SURFACE_POINTS: Final[Mapping[str, Mapping[str, Array]]] = _surface_points()
"""Segment → label → (3,) m in the segment's frame: the points beside the joints that the files name."""


def about(axis: int, angle: Array) -> Array:
    """Quaternions (T, 4) of rotations by `angle` (T,) about axis 0, 1 or 2 of a segment's frame."""
    return rotations.exp(np.asarray(angle, float)[:, None] * np.eye(3)[axis])


def forward(root_position: Array, joints: Mapping[str, Array]) -> tuple[Array, Array]:
    """World orientations (T, 23, 4) and positions (T, 23, 3) of `core.segments.SEGMENTS`.

    root_position: (T, 3) m, the pelvis. joints: segment → (T, 4) its rotation in its parent's frame (the pelvis: in the world);
    segments left out keep their T-pose rotation. Quaternions are only ever multiplied, so smooth input gives output that is
    continuous in sign.
    """
    count = len(root_position)
    orientation = np.zeros((count, len(SEGMENTS), 4))
    position = np.zeros((count, len(SEGMENTS), 3))
    still = np.broadcast_to(np.array([1.0, 0.0, 0.0, 0.0]), (count, 4))
    for i, (segment, parent) in enumerate(PARENT.items()):
        local = joints.get(segment, still)
        if parent is None:
            orientation[:, i], position[:, i] = local, root_position
            continue
        p = SEGMENTS.index(parent)
        orientation[:, i] = rotations.multiply(orientation[:, p], local)
        position[:, i] = position[:, p] + rotations.rotate(orientation[:, p], JOINT_OFFSETS[segment])
    return orientation, position
