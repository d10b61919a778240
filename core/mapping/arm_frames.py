"""Where a robot's arms begin and end: the shoulder's centre on the trunk, the hand point, the length between them.

From the profile's [arms] where it has them, else from the geometry of the limbs: the centre in which the shoulder's axes meet,
carried by the chest's link, and the origin of the hand's link. So a robot needs no new table for hand mappings.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from retarget.core.calibration import SIDES
from retarget.core.errors import ProfileError
from retarget.core.kinematics import link_poses
from retarget.core.profile import Arm
from retarget.core.robot_model import RobotModel
from retarget.core.types import Array

STRETCH_SAMPLES = 2001
"""Elbow angles tried for the longest arm; half a step off, a metre of arm is 1e-7 m too short."""


@dataclass(frozen=True, eq=False)
class ArmFrame:
    """One arm. shoulder: (3,) m in the frame of `shoulder_link`, which the arm doesn't move. hand: (3,) m in that of `hand_link`.

    length_m: from shoulder to hand point, arm stretched. elbow: (3,) m in the frame of `elbow_link`; elbow_link is "" where it is
    unknown.
    """

    side: str
    shoulder_link: str
    shoulder: Array
    hand_link: str
    hand: Array
    length_m: float
    elbow_link: str
    elbow: Array

    @property
    def basis(self) -> Array:
        """B of [Lim2022 eq. 6] for the robot: (3, 3) m, columns Still, T, Forward, in the world axes of the robot standing
        upright facing +X."""
        out = 1.0 if self.side == "Left" else -1.0
        return self.length_m * np.array([[0.0, 0.0, 1.0], [0.0, out, 0.0], [-1.0, 0.0, 0.0]])


def arm_frames(model: RobotModel) -> dict[str, ArmFrame]:
    """Side → the robot's arm. Raises `ProfileError` where neither the profile nor the geometry tells."""
    return {side: _arm_frame(model, side) for side in SIDES}


def _arm_frame(model: RobotModel, side: str) -> ArmFrame:
    arm = model.profile.arms.get(side) or _derived(model, side)
    elbow_link, elbow = arm.elbow_link, np.zeros(3)
    upper = model.limbs.get(f"{side}UpperArm")
    if not elbow_link and upper is not None:
        elbow_link, elbow = upper.link, upper.distal
    shoulder, hand = np.array(arm.shoulder_m), np.array(arm.hand_m)
    length = arm.length_m
    if length is None:
        length = _stretched_length(model, side, (arm.shoulder_link, shoulder), (arm.hand_link, hand))
    return ArmFrame(side, arm.shoulder_link, shoulder, arm.hand_link, hand, length, elbow_link, elbow)


def _derived(model: RobotModel, side: str) -> Arm:
    """The arm from limb geometry and the links that the profile maps, at the reference posture."""
    upper = model.limbs.get(f"{side}UpperArm")
    hand = model.profile.hands[side].link if side in model.profile.hands else model.links.get(f"{side}Hand")
    if upper is None or hand is None:
        lacking = f"{side}UpperArm and {side}ForeArm" if upper is None else f"{side}Hand"
        raise ProfileError(
            model.profile.origin or model.profile.name,
            f"a hand mapping needs the {side.lower()} arm, but [links] lacks {lacking}",
            place="[links]",
            expected=f"these links or a table [arms.{side}]",
        )
    trunk = model.links.get("T8", model.base_link)
    rotation, origin = link_poses(model, [upper.link, trunk], model.reference_posture[None])
    centre = origin[0, 0] + rotation[0, 0] @ upper.proximal
    in_trunk = rotation[0, 1].T @ (centre - origin[0, 1])
    return Arm(trunk, (float(in_trunk[0]), float(in_trunk[1]), float(in_trunk[2])), hand, (0.0, 0.0, 0.0))


def _stretched_length(model: RobotModel, side: str, shoulder: tuple[str, Array], hand: tuple[str, Array]) -> float:
    """The largest distance (m) between two points, each (link, (3,) in its frame), over the elbow's range; other joints as in the
    reference posture."""
    joints = np.tile(model.reference_posture, (STRETCH_SAMPLES, 1))
    elbow = _elbow_joint(model, side)
    if elbow is not None:
        joints[:, elbow] = np.linspace(model.lower[elbow], model.upper[elbow], STRETCH_SAMPLES)
    else:
        joints = joints[:1]
    rotation, origin = link_poses(model, [shoulder[0], hand[0]], joints)
    ends = [origin[:, i] + rotation[:, i] @ point for i, (_, point) in enumerate((shoulder, hand))]
    return float(np.linalg.norm(ends[1] - ends[0], axis=1).max())


def _elbow_joint(model: RobotModel, side: str) -> int | None:
    """Column of the one joint that moves the forearm's link against the upper arm's, None unless there is exactly one."""
    links = [model.links.get(f"{side}{bone}") for bone in ("UpperArm", "ForeArm")]
    if None in links:
        return None
    upper, fore = (model.link_in_joint(str(link))[0] for link in links)
    if int(model.pin_model.parents[fore]) != upper or model.pin_model.joints[fore].nv != 1:
        return None
    return model.joint_index(str(model.pin_model.names[fore]))
