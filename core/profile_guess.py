"""A first profile for a robot that has none: which links follow the person, guessed from the tree of its joints, their axes and their names.

Names only tell left from right, fingers from wrists, and arms from legs where they say so. The elbow or knee is the joint whose axis passes farthest from
both ends of its limb: an axis of the shoulder passes the shoulder, one of the wrist the hand, and one that twists a bone both of that bone's ends. The T-pose is
the solver's own. Everything is a guess that `core.robot_check` can judge.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from retarget.core import rotations
from retarget.core.errors import ProfileError, SolverError
from retarget.core.profile import MappingParameters, RobotProfile
from retarget.core.robot_model import RobotModel, build
from retarget.core.types import Array

SIDES = ("Left", "Right")
STATED_SPEED_RAD_S = 10.0
"""For models that state no speeds, or speeds that no joint has."""
SHORTEST_LIMB = 3
"""Joints: fewer are an eye, an ear or a finger."""
LONGEST_ARM = 8
UPRIGHT_TOLERANCE_RAD = 0.35
"""How far what legs and hips tell of up and left may be from the root link's own axes, to be taken for these."""
LEAST_ANGLE_RAD = 0.02
NO_LENGTH_M = 1e-6
TRUNK_WEIGHT = 10.0
MARKER_SHARE = 0.01
"""Of the mass of the heaviest link at a joint: lighter ones are frames with a token mass."""
ALIKE = 0.98
"""Cosine between a joint's axis and its mirror image's, from which on they are taken for a pair."""

_SIDE = tuple(
    (side, re.compile(pattern))
    for left, right in (
        (r"(?i:left)", r"(?i:right)"),
        (r"(?:^|[_.\-])[lL](?=[_.\-]|$)", r"(?:^|[_.\-])[rR](?=[_.\-]|$)"),
        (r"^L(?!EG|OWER|UMBAR|INK|IFT)(?=[A-Z])", r"^R(?!OLL|OOT|OT)(?=[A-Z])"),
    )
    for side, pattern in (("Left", left), ("Right", right))
)
"""What tells sides apart, surest first: words, letters of their own, a capital before a name."""
_FINGER = re.compile(
    r"finger|thumb|index|(?:middle|ring)_?(?:\d|prox|dist|inter)|pinky|little|knuckle|toe|eye", re.IGNORECASE
)
_GRASP = re.compile(r"gripper|hand", re.IGNORECASE)
_TURN = re.compile(r"yaw|pitch|roll", re.IGNORECASE)
_LEG = re.compile(r"leg|hip|knee|ankle|foot|thigh|shank", re.IGNORECASE)
_ARM = re.compile(r"arm|shoulder|elbow|wrist|hand", re.IGNORECASE)
_HEAD = re.compile(r"head|neck|skull", re.IGNORECASE)


@dataclass(frozen=True)
class Guess:
    """profile: complete, to be checked. joints: segment → the joint right before its link, which says why the link was taken."""

    profile: RobotProfile
    joints: Mapping[str, str]


@dataclass(frozen=True)
class _Limb:
    """chain: joint indices of pinocchio from the trunk outward; hinge: which of these is the elbow or knee."""

    chain: tuple[int, ...]
    hinge: int


def guess(source: RobotProfile) -> Guess:
    """The profile that `source`, of which only the model is used, may grow into.

    Raises `ProfileError` when the model can't be built, or has no pair of limbs that names call left and right.
    """
    model = _built(replace(source, base="floating", links={}))
    fingers = [name for name in model.joint_names if _is_finger(name)]
    limbs = _limbs(model)
    if not limbs:
        raise ProfileError(
            source.origin or source.name, f"no pair of limbs in {len(model.joint_names)} joints", place="[model]",
            expected=f"at least {SHORTEST_LIMB} joints in a row whose names tell left from right, as in left_…, L_… or LHip",
        )  # fmt: skip
    joints = _segments(model, limbs)
    legs, arms = "LeftUpperLeg" in joints, "LeftUpperArm" in joints
    profile = replace(
        model.profile,
        base="floating" if legs else "fixed",
        base_segment="Pelvis" if legs else "T8",
        base_rpy=_upright(model, limbs) if legs else (0.0, 0.0, 0.0),
        links={segment: _link(model, joint) for segment, joint in joints.items()},
        locked_joints=tuple(fingers),
    )
    if arms:
        profile = replace(profile, reference_posture=_tpose(profile, limbs, model))
    return Guess(profile, {s: str(model.pin_model.names[j]) if j > 1 else "" for s, j in joints.items()})


def _built(profile: RobotProfile) -> RobotModel:
    """The model; with a speed limit for all joints where it states none or one that is none."""
    from retarget.core.robot_check import FASTEST_JOINT_RAD_S

    try:
        model = build(profile)
    except ProfileError:
        return build(replace(profile, default_velocity_limit=STATED_SPEED_RAD_S))
    if (model.velocity_limit > FASTEST_JOINT_RAD_S).any():
        return build(replace(profile, default_velocity_limit=STATED_SPEED_RAD_S))
    return model


def _is_finger(name: str) -> bool:
    return bool(_FINGER.search(name)) or bool(_GRASP.search(name) and not _TURN.search(name))


def _side(name: str) -> str:
    """ "Left", "Right", or "" where the name tells none."""
    return next((side for side, pattern in _SIDE if pattern.search(name)), "")


def _children(pin_model: Any, joint: int) -> list[int]:
    return [j for j in range(2, pin_model.njoints) if int(pin_model.parents[j]) == joint]


def _limbs(model: RobotModel) -> dict[tuple[str, str], _Limb]:
    """(side, "Arm" or "Leg") → limb, of those that both sides have."""
    pin_model = model.pin_model
    names = [str(name) for name in pin_model.names]
    axes, origins, centres = _placed(model)
    found: dict[tuple[str, str], _Limb] = {}
    for root in range(2, pin_model.njoints):
        side, parent = _side(names[root]), int(pin_model.parents[root])
        if not side or (parent > 1 and _side(names[parent]) == side):
            continue
        chain = _chain(pin_model, names, root)
        if len(chain) < SHORTEST_LIMB:
            continue
        text = " ".join(names[j] for j in chain)
        links = " ".join(_link(model, j) for j in chain)
        kind = _kind(f"{text} {links}", down=float(origins[chain[0]][2] - centres[chain[-1]][2]))
        limb = _Limb(tuple(chain), _hinge(chain, axes, origins, centres))
        if (side, kind) not in found or len(chain) > len(found[side, kind].chain):
            found[side, kind] = limb
    return {key: limb for key, limb in found.items() if all((side, key[1]) in found for side in SIDES)}


def _kind(text: str, down: float) -> str:
    legs, arms = len(_LEG.findall(text)), len(_ARM.findall(text))
    return ("Leg" if legs > arms else "Arm") if legs != arms else ("Leg" if down > 0.3 else "Arm")


def _chain(pin_model: Any, names: list[str], root: int) -> list[int]:
    """Joints from `root` outward, up to where fingers begin or the tree branches."""
    chain = [root]
    while len(chain) < LONGEST_ARM:
        following = [j for j in _children(pin_model, chain[-1]) if not _is_finger(names[j])]
        if len(following) != 1:
            break
        chain.append(following[0])
    return chain


def _placed(model: RobotModel) -> tuple[dict[int, Array], dict[int, Array], dict[int, Array]]:
    """Joint index → its axis (3,), its origin (3,) m and its body's centre of mass (3,) m, in the root link's frame, all joints at 0 or nearest."""
    import pinocchio as pin

    pin_model = model.pin_model
    data = pin_model.createData()
    q = np.concatenate([[0, 0, 0, 0, 0, 0, 1.0], model.reference_posture])
    pin.computeJointJacobians(pin_model, data, q)
    indices = range(2, pin_model.njoints)
    axes = {j: data.J[3:, pin_model.joints[j].idx_v].copy() for j in indices}
    origins = {j: np.array(data.oMi[j].translation) for j in indices}
    centres = {j: np.array(data.oMi[j].act(pin_model.inertias[j].lever)) for j in indices}
    return axes, origins, centres


def _hinge(
    chain: list[int], axes: Mapping[int, Array], origins: Mapping[int, Array], centres: Mapping[int, Array]
) -> int:
    """Index in `chain` of the joint whose axis passes farthest from both ends, after the first one."""
    ends = (origins[chain[1]], centres[chain[-1]])

    def clearance(j: int) -> float:
        return min(float(np.linalg.norm(np.cross(end - origins[j], axes[j]))) for end in ends)

    return max(range(1, len(chain)), key=lambda i: clearance(chain[i]))


def _segments(model: RobotModel, limbs: Mapping[tuple[str, str], _Limb]) -> dict[str, int]:
    """Segment → index of the joint that carries its link (1: the root), trunk first."""
    pin_model = model.pin_model
    found: dict[str, int] = {}
    roots = {
        kind: {int(pin_model.parents[limb.chain[0]]) for (_, k), limb in limbs.items() if k == kind}
        for kind in ("Arm", "Leg")
    }
    if len(roots["Leg"]) == 1:
        found["Pelvis"] = next(iter(roots["Leg"]))
    chest = next(iter(roots["Arm"])) if len(roots["Arm"]) == 1 else 1
    # a chest that never moves against the pelvis, or against the world, has nothing to follow
    if chest != found.get("Pelvis", 1):
        found["T8"] = chest
    head = _head(model, chest)
    if head:
        found["Head"] = head
    for side in SIDES:
        for kind, parts in (("Arm", ("UpperArm", "ForeArm", "Hand")), ("Leg", ("UpperLeg", "LowerLeg", "Foot"))):
            if (side, kind) not in limbs:
                continue
            chain, hinge = limbs[side, kind].chain, limbs[side, kind].hinge
            found[f"{side}{parts[0]}"], found[f"{side}{parts[1]}"] = chain[hinge - 1], chain[hinge]
            if chain[-1] != chain[hinge]:
                found[f"{side}{parts[2]}"] = chain[-1]
    return found


def _head(model: RobotModel, chest: int) -> int | None:
    """The last joint of the chain at the chest that is named after head or neck."""
    names, joint = model.pin_model.names, chest
    found = None
    while True:
        heads = [j for j in _children(model.pin_model, joint) if _HEAD.search(f"{names[j]} {_link(model, j)}")]
        if not heads:
            return found
        found = joint = heads[0]


def _link(model: RobotModel, joint: int) -> str:
    """The link that `joint` moves: of all that are fixed to each other there the first whose mass is more than a marker's."""
    masses = _masses(model.urdf)
    links = [str(f.name) for f in model.pin_model.frames if str(f.type) == "BODY" and int(f.parentJoint) == joint]
    heaviest = max(masses.get(link, 0.0) for link in links)
    return next(link for link in links if masses.get(link, 0.0) >= MARKER_SHARE * heaviest)


@lru_cache(maxsize=4)
def _masses(urdf: str) -> dict[str, float]:
    found = {}
    for link in ET.fromstring(urdf).findall("link"):
        mass = link.find("inertial/mass")
        found[str(link.get("name"))] = 0.0 if mass is None else float(mass.get("value", "0"))
    return found


def _upright(model: RobotModel, limbs: Mapping[tuple[str, str], _Limb]) -> tuple[float, float, float]:
    """base_rpy: where the root link's axes point when hips are above feet and left is left."""
    _, origins, centres = _placed(model)
    left, right = (limbs[side, "Leg"].chain for side in SIDES)
    hips = [origins[left[0]], origins[right[0]]]
    up = np.mean(hips, axis=0) - np.mean([centres[left[-1]], centres[right[-1]]], axis=0)
    up, across = up / max(float(np.linalg.norm(up)), NO_LENGTH_M), hips[0] - hips[1]
    across = across - (across @ up) * up
    if not np.linalg.norm(across) > NO_LENGTH_M:  # hips in one place, or legs of no length: nothing to tell by
        return (0.0, 0.0, 0.0)
    across /= np.linalg.norm(across)
    stands = np.stack([np.cross(across, up), across, up])  # rows: world axes in the root link's frame
    square = np.round(stands)
    if (
        abs(np.linalg.det(square) - 1) < 1e-9
        and rotations.angle(rotations.from_matrix(square), rotations.from_matrix(stands)) < UPRIGHT_TOLERANCE_RAD
    ):
        stands = square
    pitch = -np.arcsin(np.clip(stands[2, 0], -1, 1))
    rpy = (np.arctan2(stands[2, 1], stands[2, 2]), pitch, np.arctan2(stands[1, 0], stands[0, 0]))
    roll, pitch, yaw = (float(np.round(angle, 6)) + 0.0 for angle in rpy)
    return (roll, pitch, abs(yaw) if abs(yaw) > np.pi - 1e-6 else yaw)


def _tpose(profile: RobotProfile, limbs: Mapping[tuple[str, str], _Limb], bare: RobotModel) -> dict[str, float]:
    """Joint → rad: shoulders and elbows as the solver finds them for a person in T-pose, the trunk held upright, hands left free.

    Both arms take the posture of the one that comes nearer.
    """
    from retarget.core.robot_check import solved_tpose

    weights = dict.fromkeys(("Pelvis", "T8"), TRUNK_WEIGHT) | dict.fromkeys((f"{side}Hand" for side in SIDES), 0.0)
    trial = replace(profile, mappings={"limb_plane": MappingParameters(weights=weights)})
    moved = {side: limbs[side, "Arm"].chain[: limbs[side, "Arm"].hinge + 1] for side in SIDES}
    names = [str(name) for name in bare.pin_model.names]
    for _ in range(2):  # joint centres are measured in the posture found before
        try:
            model = build(trial)
            joints, errors = solved_tpose(model)
        except (ProfileError, SolverError):
            return {}
        solved = dict(zip(model.joint_names, joints.tolist(), strict=True))
        angles = {side: {j: solved[names[j]] for j in moved[side]} for side in SIDES}
        left, right = (sum(errors[f"{side}{part}"] for part in ("UpperArm", "ForeArm")) for side in SIDES)
        better, other = SIDES if left <= right else SIDES[::-1]
        if (mirrored := _mirrored(bare, angles[better], moved[other], profile.base_rpy)) is not None:
            angles[other] = mirrored
        posture = {
            names[j]: angle for side in SIDES for j, angle in angles[side].items() if abs(angle) > LEAST_ANGLE_RAD
        }
        trial = replace(trial, reference_posture=_inside(posture, model))
    return dict(trial.reference_posture)


def _inside(posture: Mapping[str, float], model: RobotModel) -> dict[str, float]:
    """Angles of three digits that lie within the limits."""
    found = {}
    for name, angle in posture.items():
        lower, upper = (1000 * limit[model.joint_index(name)] for limit in (model.lower, model.upper))
        found[name] = float(np.clip(round(1000 * angle), np.ceil(lower), np.floor(upper))) / 1000
    return found


def _mirrored(
    bare: RobotModel, angles: Mapping[int, float], others: tuple[int, ...], base_rpy: tuple[float, float, float]
) -> dict[int, float] | None:
    """Joint index → rad of the other arm, joint by joint, or None where the arms are not built as mirror images."""
    if len(angles) != len(others):
        return None
    axes, _, _ = _placed(bare)
    upright = rotations.to_matrix(rotations.from_rpy(base_rpy))
    found = {}
    for (joint, angle), other in zip(angles.items(), others, strict=True):
        image = (upright @ axes[joint]) * [-1.0, 1.0, -1.0]  # an axis is no arrow: it is mirrored the other way
        alike = float(image @ (upright @ axes[other]))
        if abs(alike) < ALIKE:
            return None
        found[other] = angle * np.sign(alike)
    return found
