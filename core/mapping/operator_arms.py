"""The operator's shoulders, elbows and hands over time, and the plane of each arm: in the operator frame, metres."""

from __future__ import annotations

import numpy as np
from retarget.core import rotations
from retarget.core.calibration import Calibration
from retarget.core.errors import MotionError
from retarget.core.mapping.limb_twist import frame_from_bone, hinge_directions
from retarget.core.mapping.relative_orientation import mapped_orientation, turned_since_still
from retarget.core.types import Array, HumanMotion

UPPER_ARM_SHARE = 0.48
"""Shoulder to elbow over shoulder to hand point, of a stretched arm: 0.186 of the body's height over 0.186 + 0.146 + half a
hand's 0.108 [Winter, Biomechanics and Motor Control of Human Movement, fig. 4.1]. The arm's plane does not depend on it."""


def position_of(motion: HumanMotion, segment: str) -> Array:
    """Positions (T, 3) of a segment's point. Raises `MotionError` where it isn't measured."""
    if motion.has(segment):
        position = motion.position[:, motion.index(segment)]
        if np.isfinite(position).all():
            return position
    raise MotionError(
        f"a hand mapping needs the position of {segment}, which the motion doesn't have; expected measured positions of "
        "T8, LeftHand and RightHand"
    )


def hand_point(motion: HumanMotion, calibration: Calibration, side: str) -> Array:
    """The hand point (T, 3): a calibrated tracker's position, which contains the offset, else the segment's origin + R · offset."""
    segment = f"{side}Hand"
    position = position_of(motion, segment)
    offset = calibration.hand_offset_m.get(side)
    if calibration.trackers or offset is None:
        return position
    return position + rotations.rotate(motion.orientation[:, motion.index(segment)], offset)


def shoulder_point(motion: HumanMotion, calibration: Calibration, side: str) -> Array:
    """The live shoulder (T, 3), rigid with the chest: p_sh = p_ch + R_ch R_ch,initᵀ (p_sh,init - p_ch,init) [Lim2022 eq. 2]."""
    turned = turned_since_still(motion, calibration, "T8")
    arm = calibration.arms[side].shoulder - calibration.chest_position
    return position_of(motion, "T8") + rotations.rotate(turned, arm)


def hand_from_shoulder(motion: HumanMotion, calibration: Calibration, side: str) -> Array:
    """h = R_ch,init R_chᵀ (p_ha - p_sh), (T, 3): the hand seen from the shoulder, in the chest's axes of the Still pose."""
    line = hand_point(motion, calibration, side) - shoulder_point(motion, calibration, side)
    return rotations.rotate(rotations.conjugate(turned_since_still(motion, calibration, "T8")), line)


def elbow_line(motion: HumanMotion, calibration: Calibration, side: str) -> tuple[Array, Array]:
    """(shoulder, elbow), (T, 3) each. The elbow is tracked, or lies on the upper arm's axis at an average person's distance."""
    upper = f"{side}UpperArm"
    shoulder = motion.position[:, motion.index(upper)]
    if not np.isfinite(shoulder).all():
        shoulder = shoulder_point(motion, calibration, side)
    if motion.has(f"{side}ForeArm"):
        elbow = motion.position[:, motion.index(f"{side}ForeArm")]
        if np.isfinite(elbow).all():
            return shoulder, elbow
    out = UPPER_ARM_SHARE * calibration.arms[side].length_m * np.array([0.0, 1.0 if side == "Left" else -1.0, 0.0])
    return shoulder, shoulder + rotations.rotate(motion.orientation[:, motion.index(upper)], out)


def arm_plane(motion: HumanMotion, calibration: Calibration, side: str) -> Array:
    """Orientation (T, 4) wxyz of the upper arm, T-pose aligned: bone from shoulder to elbow, z the normal of shoulder, elbow and
    hand.

    [Lim2022 fig. 4 and sec. III-B] align this normal; the paper takes it from the tracker's relative orientation alone. Here that
    stands in only as far as the arm is straight and shows no plane, and blends in smoothly (`limb_twist`).
    """
    shoulder, elbow = elbow_line(motion, calibration, side)
    upper = _unit(elbow - shoulder, f"{side}UpperArm")
    fore = _unit(hand_point(motion, calibration, side) - elbow, f"{side}ForeArm")
    own = rotations.rotate(mapped_orientation(motion, calibration, f"{side}UpperArm"), [0.0, 0.0, 1.0])
    left = side == "Left"
    hinge = hinge_directions(motion.time, upper, fore, own, -1.0 if left else 1.0)
    return frame_from_bone(upper, hinge, left=left, arm=True)


def _unit(line: Array, segment: str) -> Array:
    length = np.linalg.norm(line, axis=1, keepdims=True)
    if (length < 1e-6).any():
        raise MotionError(f"{segment}: found no length in frame {int(length.argmin())}, expected a bone")
    return np.asarray(line / length)
