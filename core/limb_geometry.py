"""Where a robot's limbs point, from its geometry alone: joint centres, bones, hinge axes.

A joint centre is where the axes of that joint meet or pass closest, not the origin of a link. An axis along the bone says nothing
about where across the bone the centre lies, so each axis counts by how much it crosses the bone.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from retarget.core.errors import ProfileError
from retarget.core.profile import RobotProfile
from retarget.core.types import Array

_CHAINS = tuple(
    (f"{side}{upper}", f"{side}{lower}", f"{side}{end}", roots)
    for side in ("Left", "Right")
    for upper, lower, end, roots in (
        ("UpperArm", "ForeArm", "Hand", (f"{side}Shoulder", "T8", "T12", "L3", "L5", "Pelvis")),
        ("UpperLeg", "LowerLeg", "Foot", ("Pelvis",)),
    )
)
"""Upper and lower bone of each limb, the segment after it, and the segments it may hang from, nearest first."""

ALONG_BONE_WEIGHT = 1e-6
"""What an axis along the bone still counts: it settles where on a hinge's axis the centre lies, and moves nothing off that axis."""
SHORTEST_BONE_M = 1e-3
"""Joint centres nearer than this are one: no bone lies between them."""
ALONG_BONE = 1.0 - 1e-6
"""Squared cosine from which on an axis runs along a bone, and turning about it bends nothing."""
UNDECIDED = 1e-9
"""A direction in which all axes together count less than this is left to the guess."""


@dataclass(frozen=True)
class Limb:
    """One limb bone on the robot, in the frame of the link that carries it.

    link: its name. proximal, distal: (3,) m, the joint centres at its ends. hinge: (3,) unit, the elbow's or knee's axis made
    orthogonal to the bone and signed so that it matches the segment's own hinge direction (+z for arms, +y for legs), or None
    where the next joint is no single hinge. rotation: (3, 3) segment ← link, H_R_R of [Darvish2019 eq. 2], or None without a hinge.
    """

    segment: str
    link: str
    proximal: Array
    distal: Array
    hinge: Array | None
    rotation: Array | None

    @property
    def bone(self) -> Array:
        """Unit vector (3,) from the proximal to the distal joint centre, in the link's frame."""
        line = self.distal - self.proximal
        return np.asarray(line / np.linalg.norm(line))


@dataclass(frozen=True)
class _Axis:
    joint: int
    origin: Array
    direction: Array


def find_limbs(model: Any, profile: RobotProfile, reference: Array) -> dict[str, Limb]:
    """Every limb of `profile.links` that has both ends, measured at pinocchio configuration `reference` (an approximate T-pose).

    Raises `ProfileError` where two mapped links of a limb coincide or do not follow each other in the tree, and where a bone has no length.
    """
    import pinocchio as pin

    data = model.createData()
    pin.computeJointJacobians(model, data, reference)
    pin.updateFramePlacements(model, data)
    limbs: dict[str, Limb] = {}
    for upper, lower, end, roots in _CHAINS:
        if upper not in profile.links or lower not in profile.links:
            continue
        tip_link = profile.limb_ends.get(lower)
        stations = [
            next((profile.links[s] for s in roots if s in profile.links), None),
            profile.links[upper],
            profile.links[lower],
        ]
        stations.append(tip_link or profile.links.get(end))
        groups = [
            _axes_between(model, data, profile, above, below)
            for above, below in pairwise(stations)
            if below is not None and below != tip_link
        ]
        tip = None if tip_link is None else np.array(data.oMf[link_frame(model, tip_link)].translation)
        centres = _centres(groups, tip)
        for segment, length in zip((upper, lower), _lengths(centres), strict=False):
            if not length >= SHORTEST_BONE_M:
                raise ProfileError(
                    profile.origin or profile.name, f"{segment} has no length: the joints on either side of it have one centre", place="[links]",
                    expected="links with a bone between their joints",
                )  # fmt: skip
        flexion = _flexion_axis(model, reference, groups[1], centres)
        for segment, ends in ((upper, centres[0:2]), (lower, centres[1:3])):
            if len(ends) == 2:
                link_placement = data.oMf[link_frame(model, profile.links[segment])]
                limbs[segment] = _limb(segment, profile.links[segment], link_placement, ends, flexion)
    return limbs


def link_frame(model: Any, link: str) -> int:
    """Index of the pinocchio frame of `link`: that of a joint of the same name, which MJCF allows, is another."""
    import pinocchio as pin

    return int(model.getFrameId(link, pin.FrameType.BODY))


def _axes_between(model: Any, data: Any, profile: RobotProfile, above: str | None, below: str) -> list[_Axis]:
    """World axes of the joints that move link `below` but not link `above` (None: the base), from the base outward."""
    stop = 0 if above is None else int(model.frames[link_frame(model, above)].parentJoint)
    joint = int(model.frames[link_frame(model, below)].parentJoint)
    path: list[int] = []
    while joint not in (0, stop) and model.joints[joint].nv == 1:
        path.append(joint)
        joint = int(model.parents[joint])
    if not path or (above is not None and joint != stop):
        raise ProfileError(
            profile.origin or profile.name, f"no joint lies between links '{above}' and '{below}'", place="[links]",
            expected="links that follow each other in the tree, outward",
        )  # fmt: skip
    jacobian = np.reshape(data.J, (6, -1))  # of a single joint pinocchio gives (6,)
    return [
        _Axis(i, np.array(data.oMi[i].translation), jacobian[3:, model.joints[i].idx_v].copy()) for i in reversed(path)
    ]


def _centres(groups: list[list[_Axis]], tip: Array | None) -> list[Array]:
    """Joint centres (3,) m, world, of consecutive joint groups; `tip` ends the limb where it is given."""
    last = [] if tip is None else [tip]
    centres = [np.mean([axis.origin for axis in group], axis=0) for group in groups]
    for _ in range(3):  # bones depend on the centres and the centres on the bones: settles in two rounds
        if min(_lengths(centres + last), default=np.inf) < SHORTEST_BONE_M:
            break  # for the caller to refuse
        bones = [(b - a) / np.linalg.norm(b - a) for a, b in pairwise(centres + last)]
        centres = [_centre(groups, centres + last, bones, i) for i in range(len(groups))]
    return centres + last


def _lengths(centres: list[Array]) -> list[float]:
    """m, between each centre and the next."""
    return [float(np.linalg.norm(b - a)) for a, b in pairwise(centres)]


def _centre(groups: list[list[_Axis]], centres: list[Array], bones: list[Array], i: int) -> Array:
    """The point (3,) m with the least weighted sum of squared distances to the axes of group `i`.

    Where they leave a direction open, as a hinge does, neighbouring joints' axes along a bone decide; where there are none, the limb's
    own plane: the line between the neighbouring centres. `centres` holds the previous round's.
    """
    near = np.mean([axis.origin for axis in groups[i]], axis=0)
    if 0 < i < len(centres) - 1:
        chord = centres[i + 1] - centres[i - 1]
        near = centres[i - 1] + chord * ((near - centres[i - 1]) @ chord) / (chord @ chord)
    before, after = (bones[i - 1] if i else None), (bones[i] if i < len(bones) else None)
    lines = []
    for k, axis in enumerate(groups[i]):
        # Only the group's outermost joints keep a fixed angle to a bone, whatever the posture.
        along = _along(axis, before) if k == 0 else 0.0
        along = max(along, _along(axis, after) if k == len(groups[i]) - 1 else 0.0)
        lines.append((axis, (1.0 - along) + ALONG_BONE_WEIGHT * along))
    if before is not None:
        lines.append((groups[i - 1][-1], ALONG_BONE_WEIGHT * _along(groups[i - 1][-1], before)))
    if after is not None and i + 1 < len(groups):
        lines.append((groups[i + 1][0], ALONG_BONE_WEIGHT * _along(groups[i + 1][0], after)))
    matrix, vector = np.zeros((3, 3)), np.zeros(3)
    for axis, weight in lines:
        across = weight * (np.eye(3) - np.outer(axis.direction, axis.direction))
        matrix = matrix + across
        vector = vector + across @ (axis.origin - near)
    return np.asarray(near + np.linalg.pinv(matrix, rcond=UNDECIDED, hermitian=True) @ vector)


def _along(axis: _Axis, bone: Array | None) -> float:
    """1 when the axis runs along the bone, 0 when it crosses it at a right angle or there is no bone."""
    return 0.0 if bone is None else float(axis.direction @ bone) ** 2


def _flexion_axis(model: Any, reference: Array, hinge: list[_Axis], centres: list[Array]) -> Array | None:
    """World direction (3,) about which the limb flexes, or None unless exactly one joint with a lopsided range bends it.

    The joint's range counted from the straight limb: the longer side flexes. A joint along either bone twists it, and bends nothing.
    """
    if len(hinge) != 1 or len(centres) < 3:
        return None
    if any(_along(hinge[0], (b - a) / np.linalg.norm(b - a)) > ALONG_BONE for a, b in pairwise(centres[:3])):
        return None
    axis = hinge[0].direction
    across = np.eye(3) - np.outer(axis, axis)
    upper, lower = across @ (centres[1] - centres[0]), across @ (centres[2] - centres[1])
    bend = float(np.arctan2(np.cross(upper, lower) @ axis, upper @ lower))
    index = model.joints[hinge[0].joint].idx_q
    straight = float(reference[index]) - bend
    return axis if model.upperPositionLimit[index] - straight > straight - model.lowerPositionLimit[index] else -axis


def _limb(segment: str, link: str, placement: Any, ends: list[Array], flexion: Array | None) -> Limb:
    rotation_link_world = np.array(placement.rotation).T
    proximal, distal = (rotation_link_world @ (end - placement.translation) for end in ends)
    if flexion is None:
        return Limb(segment, link, proximal, distal, None, None)
    bone = (distal - proximal) / np.linalg.norm(distal - proximal)
    hinge = rotation_link_world @ flexion
    hinge = hinge - (hinge @ bone) * bone
    hinge /= np.linalg.norm(hinge)
    # T-pose axes: arm bones along ±y with the elbow flexing about -z (left), +z (right); legs along -z, knees flexing about +y.
    if segment.endswith("Arm"):
        left = segment.startswith("Left")
        y, z = (bone, -hinge) if left else (-bone, hinge)
        hinge = z
    else:
        y, z = hinge, -bone
    return Limb(segment, link, proximal, distal, hinge, np.stack([np.cross(y, z), y, z]))
