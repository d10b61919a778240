"""Hands by the operator's own calibration poses [Lim2022 sec. II-C]: holding a pose puts the robot into that pose.

The hand, seen from the shoulder, is a mixture w of the three calibration poses (`hand_weights`); the robot's hand is the same
mixture of its own three poses, arm down, out and forward at full length: p = B_r w, kept between 0.1 m and the arm's length from
the shoulder. The shoulder is the robot's own, where its waist puts it while the chest follows the person's, and the mixture turns
with the chest.
"""

from __future__ import annotations

import numpy as np
from retarget.core import rotations
from retarget.core.calibration import SIDES
from retarget.core.mapping import Mapping
from retarget.core.mapping.arm_frames import arm_frames
from retarget.core.mapping.hand_blend import blended_hands, pulled_within_reach
from retarget.core.mapping.hand_weights import HandLimits, mapping_weights
from retarget.core.mapping.operator_arms import hand_from_shoulder, hand_point
from retarget.core.mapping.relative_orientation import turned_since_still
from retarget.core.mapping.telemanipulation import operator_of, targets_of
from retarget.core.mapping.trunk import shoulder_points
from retarget.core.robot_model import RobotModel
from retarget.core.types import Array, HumanMotion, Targets

NEAREST_M = 0.1
"""No hand target nearer to the shoulder than this [the authors' code]."""


def targets(
    motion: HumanMotion,
    model: RobotModel,
    *,
    feed_forward: bool = True,
    weight_box: tuple[float, float] = (-1.0, 1.0),
    blend_hands: bool = False,
) -> Targets:
    """Tasks of all levels, hands by their mapping vectors.

    feed_forward: with ḣ of [Lim2022 eq. 9]; without it as in the authors' code. weight_box: bounds of w. blend_hands: let the
    robot's hands meet when the operator's do (`hand_blend`). Raises `MotionError` without a calibration or positions of chest and
    hands.
    """
    operator, calibration = operator_of(motion, model)
    limits = HandLimits(weight_lower=weight_box[0], weight_upper=weight_box[1])
    arms = arm_frames(model)
    turned = turned_since_still(operator, calibration, "T8")
    shoulders = shoulder_points(model, arms, turned)
    hands = {}
    for side in SIDES:
        seen = hand_from_shoulder(operator, calibration, side)
        found = mapping_weights(
            operator.time, seen, calibration.arms[side].basis, feed_forward=feed_forward, limits=limits
        )
        reached = within_reach(found.weights @ arms[side].basis.T, arms[side].length_m)
        hands[side] = shoulders[side] + rotations.rotate(turned, reached)
    if blend_hands:
        apart = hand_point(operator, calibration, "Left") - hand_point(operator, calibration, "Right")
        left, right = blended_hands(hands["Left"], hands["Right"], apart)
        both, reach = (shoulders["Left"], shoulders["Right"]), (arms["Left"].length_m, arms["Right"].length_m)
        hands["Left"], hands["Right"] = pulled_within_reach(left, right, both, reach)
    return targets_of("hand_position", operator, calibration, model, hands)


def within_reach(point: Array, length_m: float) -> Array:
    """Points (T, 3) m from the shoulder, moved along their rays to between NEAREST_M and `length_m`; one at the shoulder itself
    goes forward."""
    distance = np.linalg.norm(point, axis=1, keepdims=True)
    direction = np.where(distance > 1e-9, point / np.maximum(distance, 1e-9), [1.0, 0.0, 0.0])
    allowed = distance.clip(NEAREST_M, length_m)
    return np.where(allowed == distance, point, direction * allowed)


MAPPING = Mapping(
    "hand_position",
    "hands by the operator's calibration poses [Lim2022 eqs 3-10]",
    targets,
    settings=frozenset({"feed_forward", "weight_box", "blend_hands"}),
    needs_calibration=True,
)
