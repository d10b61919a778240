"""Profile → kinematic model: pinocchio model, joint order, limits, link placements. Built once, never serialised."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from retarget.core import rotations
from retarget.core.errors import MotionError, ProfileError, UnknownNameError, nearest
from retarget.core.joint_patterns import control_patterns, matches, with_joint_names
from retarget.core.limb_geometry import Limb, find_limbs, link_frame
from retarget.core.profile import CoupledJoints, RobotProfile
from retarget.core.robot_urdf import prepared_urdf, read_model
from retarget.core.types import Array, HumanMotion


@dataclass(frozen=True)
class RobotModel:
    """A robot ready for retargeting. n joints in the model's own order; positions rad (m for sliding joints).

    profile: as loaded, with joint patterns of [hierarchy] and [torque] replaced by the names they match.
    pin_model: pinocchio model, free-flyer root when the base is floating; every joint has one degree of freedom.
    lower, upper, velocity_limit: (n,) rad, rad, rad/s. reference_posture: (n,), inside the limits.
    limbs: limb segment → its geometry. urdf: the text the model was built from, limits included.
    warnings: what of an MJCF could not be kept.
    """

    profile: RobotProfile
    pin_model: Any
    urdf: str
    joint_names: tuple[str, ...]
    lower: Array
    upper: Array
    velocity_limit: Array
    reference_posture: Array
    mass_kg: float
    base_link: str
    limbs: Mapping[str, Limb] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    @property
    def base_is_floating(self) -> bool:
        """Whether the base link moves in the world."""
        return self.profile.base == "floating"

    @cached_property
    def sha256(self) -> str:
        """Hash of the URDF text the model was built from."""
        return hashlib.sha256(self.urdf.encode()).hexdigest()

    @cached_property
    def links(self) -> Mapping[str, str]:
        """Segment → link of the profile."""
        return dict(self.profile.links)

    @property
    def base_rotation(self) -> Array:
        """Orientation (4,) wxyz of the base link when the robot stands upright facing +X."""
        return rotations.from_rpy(self.profile.base_rpy)

    @property
    def coupled(self) -> tuple[CoupledJoints, ...]:
        """Linear inequalities over joints."""
        return self.profile.coupled

    def joint_index(self, name: str) -> int:
        """Column of joint `name`."""
        return self.joint_names.index(name)

    def configuration(
        self, joints: Array, base_orientation: Array | None = None, base_position: Array | None = None
    ) -> Array:
        """pinocchio's q of joint values (n,); base pose as wxyz (4,) and m (3,), upright at the origin when None."""
        if not self.base_is_floating:
            return np.asarray(joints, float)
        orientation = self.base_rotation if base_orientation is None else np.asarray(base_orientation, float)
        position = np.zeros(3) if base_position is None else np.asarray(base_position, float)
        return np.concatenate([position, np.roll(orientation, -1), joints])  # pinocchio: x y z, then quaternion xyzw

    def link_in_joint(self, link: str) -> tuple[int, Array, Array]:
        """(index of the pinocchio joint that carries `link`, rotation (3, 3) and origin (3,) m of the link in that joint's frame)."""
        frame = self.pin_model.frames[link_frame(self.pin_model, link)]
        placement = frame.placement
        return int(frame.parentJoint), np.array(placement.rotation), np.array(placement.translation)


def build(profile: RobotProfile, motion: HumanMotion | None = None) -> RobotModel:
    """The model of `profile`; `motion` is needed for robots that are built from the person's own segments.

    Raises `ProfileError` for missing packages, files, links or joints (with the nearest name), contradicting limits.
    """
    import pinocchio as pin

    warnings: tuple[str, ...] = ()
    if profile.model.kind == "human":
        from retarget.core.human_model import human_urdf, person_profile

        if motion is None:
            raise MotionError(f"robot '{profile.name}' is built from a recording's segments; give a recording")
        profile = person_profile(profile, motion)
        urdf = prepared_urdf(profile, human_urdf(motion))
    else:
        text, warnings = read_model(profile)
        urdf = prepared_urdf(profile, text)
    arguments = (pin.JointModelFreeFlyer(),) if profile.base == "floating" else ()
    try:
        model = pin.buildModelFromXML(urdf, *arguments)
    except (ValueError, RuntimeError) as error:
        raise ProfileError(
            profile.origin or profile.name, f"pinocchio can't build the model: {error}", place="[model]"
        ) from None
    first = 2 if profile.base == "floating" else 1
    names = tuple(str(model.names[i]) for i in range(first, model.njoints))
    _check_names(profile, model, names)
    n = len(names)
    if n == 0:
        raise ProfileError(profile.origin or profile.name, "the model has no joint that moves", place="[model]")
    lower, upper = np.array(model.lowerPositionLimit[-n:]), np.array(model.upperPositionLimit[-n:])
    reference = np.clip([profile.reference_posture.get(name, 0.0) for name in names], lower, upper)
    root = next(str(f.name) for f in model.frames if str(f.type) == "BODY")
    built = RobotModel(
        profile=with_joint_names(profile, names),
        pin_model=model,
        urdf=urdf,
        joint_names=names,
        lower=lower,
        upper=upper,
        velocity_limit=np.array(model.velocityLimit[-n:]),
        reference_posture=reference,
        mass_kg=float(sum(inertia.mass for inertia in model.inertias)),
        base_link=root,
        warnings=warnings,
    )
    return _with_limbs(built)


def _with_limbs(model: RobotModel) -> RobotModel:
    return replace(
        model, limbs=find_limbs(model.pin_model, model.profile, model.configuration(model.reference_posture))
    )


def _check_names(profile: RobotProfile, model: Any, joints: tuple[str, ...]) -> None:
    from retarget.core.mapping import names as mapping_names  # mappings know robot models, not the other way round

    links = [str(frame.name) for frame in model.frames if str(frame.type) == "BODY"]
    wanted = [(link, f"[links] {segment}") for segment, link in profile.links.items()]
    for unknown in sorted(set(profile.mappings) - set(mapping_names())):
        raise UnknownNameError(
            "mapping", unknown, mapping_names(), where=f"{profile.origin or profile.name}, [mapping]"
        )
    for mapping, parameters in profile.mappings.items():
        wanted += [(link, f"[mapping.{mapping}.links] {segment}") for segment, link in parameters.links.items()]
    wanted += [(link, f"[limb_ends] {segment}") for segment, link in profile.limb_ends.items()]
    wanted += [(hand.link, f"[hands.{side}]") for side, hand in profile.hands.items()]
    wanted += [(foot.link, f"[feet.{side}]") for side, foot in profile.feet.items()]
    for side, arm in profile.arms.items():
        named_links = {"shoulder_link": arm.shoulder_link, "hand_link": arm.hand_link, "elbow_link": arm.elbow_link}
        wanted += [(link, f"[arms.{side}] {key}") for key, link in named_links.items() if link or key != "elbow_link"]
    for i, level in enumerate(profile.hierarchy.levels):
        wanted += [(task.link, f"hierarchy.levels[{i}] {task.segment}") for task in level.tasks if task.link]
    for name, place in wanted:
        if name not in links:
            raise _missing(profile, "link", name, links, place)
    named = [(joint, "[reference_posture_rad]") for joint in profile.reference_posture]
    named += [(joint, "[[coupled]] joints") for rows in profile.coupled for joint in rows.joints]
    named += [(entry.joint, "[tpose_exceptions]") for entry in profile.tpose_exceptions.values()]
    for name, place in named:
        if name not in joints:
            raise _missing(profile, "joint", name, list(joints), place)
    for name, place in control_patterns(profile):
        if not matches(name, joints):
            raise _missing(profile, "joint", name, list(joints), place)


def _missing(profile: RobotProfile, kind: str, name: str, valid: list[str], place: str) -> ProfileError:
    near = nearest(name, valid)
    hint = f"did you mean {' or '.join(near)}?" if near else f"one of {', '.join(valid[:40])}"
    return ProfileError(profile.origin or profile.name, f"the model has no {kind} '{name}'", place=place, expected=hint)
