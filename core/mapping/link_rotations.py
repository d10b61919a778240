"""The constant rotation segment ← link, H_R_R of [Darvish2019 eq. 2], for every mapped link.

With T-pose-aligned segments it is the link's world rotation while the robot itself stands in T-pose facing +X.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from retarget.core import rotations
from retarget.core.limb_geometry import link_frame
from retarget.core.profile import MappingParameters
from retarget.core.robot_model import RobotModel
from retarget.core.types import Array


def from_reference_posture(model: RobotModel, links: Mapping[str, str] | None = None) -> dict[str, Array]:
    """Segment → (3, 3) of `links` (the profile's own map when None), by forward kinematics of the profile's reference posture, an approximate T-pose: the paper's way."""
    import pinocchio as pin

    data = model.pin_model.createData()
    pin.framesForwardKinematics(model.pin_model, data, model.configuration(model.reference_posture))
    return {
        segment: np.array(data.oMf[link_frame(model.pin_model, link)].rotation)
        for segment, link in (links or model.links).items()
    }


def as_in_paper(model: RobotModel) -> dict[str, Array]:
    """Segment → (3, 3): what the profile types in for `link_orientation`, else from the reference posture."""
    parameters = model.profile.mappings.get("link_orientation", MappingParameters())
    found = from_reference_posture(model, {**model.links, **parameters.links})
    for segment, rpy in parameters.rotations_rpy.items():
        if segment in found:
            found[segment] = rotations.to_matrix(rotations.from_rpy(rpy))
    return found


def from_geometry(model: RobotModel) -> dict[str, Array]:
    """Segment → (3, 3): limbs from joint centres and hinge axes, hands from their fingers and palm, the rest from the reference posture."""
    found = from_reference_posture(model)
    for segment, limb in model.limbs.items():
        if limb.rotation is not None:
            found[segment] = limb.rotation
    for side, hand in model.profile.hands.items():
        if f"{side}Hand" in found:
            # T-pose: fingers outward (+y left, -y right), palms down; rows are the segment's axes in the link's frame.
            y = np.array(hand.fingers) * (1.0 if side == "Left" else -1.0)
            x = np.cross(y, -np.array(hand.palm))
            x /= np.linalg.norm(x)  # a profile's two directions are perpendicular only to its digits
            found[f"{side}Hand"] = np.stack([x, y, np.cross(x, y)])
    return found
