"""A person as a robot: every segment of a recording a link, every joint three hinges about x, y and z. 66 joints for all 23 segments.

Built like the human model of [Darvish2019]: zero posture = T-pose, link frames aligned with the world there, so that a link's frame is
its segment's. Lengths come from the recording. Masses are that model's fractions of the body mass; inertias are those of solid
cylinders (the head: a sphere) of the body's mean density, 1050 kg/m³, lying along the segments' bones.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from retarget.core import rotations
from retarget.core.errors import MotionError
from retarget.core.profile import Foot, RobotProfile
from retarget.core.segments import LIMB_END, PARENT, SEGMENTS
from retarget.core.types import Array, HumanMotion
from retarget.core.urdf_text import number, numbers

BODY_MASS_KG = 72.0
BODY_DENSITY_KG_M3 = 1050.0
LIMIT_RAD = 10.0
"""Three hinges in a row may wind up by more than a turn; nothing is meant to stop them."""
VELOCITY_LIMIT_RAD_S = 50.0
"""Near a half-turned middle hinge the outer two spin fast even in slow motion; people's joints stay below 30 rad/s."""
EFFORT_LIMIT_NM = 1000.0
SHORTEST_LIMB_M = 1e-3

_SIDES = ("Right", "Left")
MASS_FRACTION: Mapping[str, float] = {
    "Pelvis": 0.080, "L5": 0.102, "L3": 0.102, "T12": 0.102, "T8": 0.040, "Neck": 0.012, "Head": 0.036,
    **{
        f"{side}{part}": fraction
        for side in _SIDES
        for part, fraction in (
            ("Shoulder", 0.031), ("UpperArm", 0.030), ("ForeArm", 0.020), ("Hand", 0.006),
            ("UpperLeg", 0.125), ("LowerLeg", 0.0365), ("Foot", 0.013), ("Toe", 0.0015),
        )
    },
}  # fmt: skip
"""Segment → its share of the body's mass, after the human model of [Darvish2019]; they add up to 1."""

JOINT: Mapping[str, str] = {
    "L5": "jL5S1", "L3": "jL4L3", "T12": "jL1T12", "T8": "jT9T8", "Neck": "jT1C7", "Head": "jC1Head",
    **{
        f"{side}{part}": f"j{side}{joint}"
        for side in _SIDES
        for part, joint in (
            ("Shoulder", "C7Shoulder"), ("UpperArm", "Shoulder"), ("ForeArm", "Elbow"), ("Hand", "Wrist"),
            ("UpperLeg", "Hip"), ("LowerLeg", "Knee"), ("Foot", "Ankle"), ("Toe", "BallFoot"),
        )
    },
}  # fmt: skip
"""Segment → name of its proximal joint, as Xsens calls it; the hinges are `<name>_rotx`, `_roty`, `_rotz`, from parent to child."""

_TIP_LENGTH: Mapping[str, float] = {"Hand": 0.74, "Toe": 0.5}
"""Length of a segment that ends a chain, as a multiple of the bone before it. Hand and forearm: 0.108 and 0.146 of the stature
(Drillis and Contini 1966, as reprinted in Winter, Biomechanics and Motor Control of Human Movement)."""
SHORTEST_TIP_M = 0.02

HEEL_FRACTION, HALF_WIDTH_FRACTION = 0.3, 0.25
"""How far the sole reaches behind the ankle and to either side, as multiples of the way from ankle to ball."""


def human_urdf(motion: HumanMotion) -> str:
    """URDF text of the person in `motion`, with the segments that it has; a link hangs from its nearest ancestor among them.

    Raises `MotionError` when the recording does not tell where a segment starts, or when its segments are no single tree.
    """
    parents = _tree(motion)
    offsets = joint_offsets(motion)
    root = ET.Element("robot", name="human")
    for segment in parents:
        _add_link(root, segment, _bone(segment, parents, offsets))
    for segment, parent in parents.items():
        if parent is not None:
            _add_joints(root, parent, segment, offsets[segment])
        if segment.endswith("Hand"):
            _add_hand_centre(root, segment, _bone(segment, parents, offsets) / 2)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode")


def person_profile(profile: RobotProfile, motion: HumanMotion) -> RobotProfile:
    """`profile` cut down to the segments of `motion`, with the soles of that person's feet.

    The floor of the T-pose is at the balls of the feet, where Xsens puts it; a foot without its toe segment gets no sole.
    """
    present = set(_tree(motion))
    offsets = joint_offsets(motion)
    feet = {
        side: Foot(profile.links[f"{side}Foot"], _sole(offsets[f"{side}Toe"]))
        for side in _SIDES
        if {f"{side}Foot", f"{side}Toe"} <= present and f"{side}Foot" in profile.links
    }
    return replace(
        profile,
        links={segment: link for segment, link in profile.links.items() if segment in present},
        hands={side: hand for side, hand in profile.hands.items() if f"{side}Hand" in present},
        feet=feet,
    )


def joint_offsets(motion: HumanMotion) -> dict[str, Array]:
    """Segment → (3,) m, its proximal joint in the frame of its parent in the tree; for every segment of `motion` but the root.

    From the recording where it names them, else the mean over all frames of R_parentᵀ (p_child − p_parent).
    Raises `MotionError` where neither is known, or where a limb has no length.
    """
    offsets: dict[str, Array] = {}
    for segment, parent in _tree(motion).items():
        if parent is None:
            continue
        if segment in motion.joint_offsets and PARENT[segment] == parent:
            offsets[segment] = np.array(motion.joint_offsets[segment])
        else:
            child, above = motion.index(segment), motion.index(parent)
            between = motion.position[:, child] - motion.position[:, above]
            offsets[segment] = rotations.rotate(rotations.conjugate(motion.orientation[:, above]), between).mean(axis=0)
        if not np.isfinite(offsets[segment]).all():
            raise MotionError(
                f"no length from {parent} to {segment}: the recording has neither joint offsets nor both positions"
            )
        if segment in LIMB_END.values() and np.linalg.norm(offsets[segment]) < SHORTEST_LIMB_M:
            raise MotionError(f"{segment} starts where {parent} does: no limb between them")
    return offsets


def _tree(motion: HumanMotion) -> dict[str, str | None]:
    """Segment → its nearest ancestor among the motion's segments, parents first."""
    found: dict[str, str | None] = {}
    for segment in SEGMENTS:
        if segment in motion.segments:
            parent = PARENT[segment]
            while parent is not None and parent not in motion.segments:
                parent = PARENT[parent]
            found[segment] = parent
    roots = [segment for segment, parent in found.items() if parent is None]
    if len(roots) > 1:
        raise MotionError(
            f"{', '.join(roots)} hang from nothing; a person needs one segment that all others hang from, like Pelvis or T8"
        )
    return found


def _bone(segment: str, parents: Mapping[str, str | None], offsets: Mapping[str, Array]) -> Array:
    """(3,) m from the segment's joint to the next one outward; an estimate for the last of a chain."""
    children = [child for child, parent in parents.items() if parent == segment]
    # The trunk goes on along the midline: from the pelvis to L5, not to the legs, and from T8 to the neck.
    outward = [child for child in children if not child.startswith(_SIDES)] or children
    bone = np.mean([offsets[child] for child in outward], axis=0) if outward else np.zeros(3)
    if np.linalg.norm(bone) > SHORTEST_LIMB_M:
        return np.asarray(bone)
    before = float(np.linalg.norm(offsets[segment])) if segment in offsets else 0.0
    part = segment.removeprefix("Right").removeprefix("Left")
    return max(before, SHORTEST_TIP_M) * _TIP_LENGTH.get(part, 1.0) * _tpose_direction(segment)


def _tpose_direction(segment: str) -> Array:
    """Unit vector (3,) along which the segment lies in T-pose."""
    if segment.endswith("Leg"):
        return np.array([0.0, 0.0, -1.0])
    if segment.endswith(("Foot", "Toe")):
        return np.array([1.0, 0.0, 0.0])
    if segment.startswith(_SIDES):
        return np.array([0.0, 1.0 if segment.startswith("Left") else -1.0, 0.0])
    return np.array([0.0, 0.0, 1.0])


def _add_link(root: ET.Element, segment: str, bone: Array) -> None:
    link = ET.SubElement(root, "link", name=segment)
    mass, length = MASS_FRACTION[segment] * BODY_MASS_KG, float(np.linalg.norm(bone))
    if segment == "Head":
        radius = (3 * mass / (4 * np.pi * BODY_DENSITY_KG_M3)) ** (1 / 3)
        tensor, centre = 0.4 * mass * radius**2 * np.eye(3), radius * bone / length
    else:
        radius_squared = mass / (np.pi * BODY_DENSITY_KG_M3 * length)
        along, across = mass * radius_squared / 2, mass * (3 * radius_squared + length**2) / 12
        axis = bone / length
        tensor = across * np.eye(3) + (along - across) * np.outer(axis, axis)
        centre = bone / 2
    _add_inertial(link, mass, centre, tensor)


def _add_inertial(link: ET.Element, mass: float, centre: Array, tensor: Array) -> None:
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "mass", value=number(mass))
    ET.SubElement(inertial, "origin", xyz=numbers(centre), rpy="0 0 0")
    entries = {f"i{'xyz'[i]}{'xyz'[j]}": number(tensor[i, j]) for i in range(3) for j in range(i, 3)}
    ET.SubElement(inertial, "inertia", entries)


def _add_joints(root: ET.Element, parent: str, segment: str, offset: Array) -> None:
    """Three hinges about the parent's x, y and z in turn, with the massless links `<segment>_f1` and `_f2` between them."""
    links = (parent, f"{segment}_f1", f"{segment}_f2", segment)
    for name in links[1:3]:
        ET.SubElement(root, "link", name=name)
    for i, axis in enumerate("xyz"):
        joint = ET.SubElement(root, "joint", name=f"{JOINT[segment]}_rot{axis}", type="revolute")
        ET.SubElement(joint, "parent", link=links[i])
        ET.SubElement(joint, "child", link=links[i + 1])
        ET.SubElement(joint, "origin", xyz=numbers(offset if i == 0 else np.zeros(3)), rpy="0 0 0")
        ET.SubElement(joint, "axis", xyz=numbers(np.eye(3)[i]))
        ET.SubElement(
            joint, "limit", lower=number(-LIMIT_RAD), upper=number(LIMIT_RAD),
            velocity=number(VELOCITY_LIMIT_RAD_S), effort=number(EFFORT_LIMIT_NM),
        )  # fmt: skip


def _add_hand_centre(root: ET.Element, segment: str, centre: Array) -> None:
    """A frame in the middle of the hand, `<segment>COM`."""
    ET.SubElement(root, "link", name=f"{segment}COM")
    joint = ET.SubElement(root, "joint", name=f"j{segment}COM", type="fixed")
    ET.SubElement(joint, "parent", link=segment)
    ET.SubElement(joint, "child", link=f"{segment}COM")
    ET.SubElement(joint, "origin", xyz=numbers(centre), rpy="0 0 0")


def _sole(ball: Array) -> Array:
    """Corners (4, 3) m of a sole that runs from behind the ankle to the ball of the foot, at the ball's height."""
    ahead, left, up = (float(v) for v in ball)
    half = HALF_WIDTH_FRACTION * ahead
    return np.array([(x, left + y, up) for x in (-HEEL_FRACTION * ahead, ahead) for y in (half, -half)])
