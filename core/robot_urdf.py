"""The URDF that everything downstream uses: the packaged one with the profile's limits written into it and its locked joints fixed.

What is retargeted, checked, embedded in the trajectory and replayed is then one and the same text.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from fnmatch import fnmatch
from importlib import metadata
from pathlib import Path

from retarget.core.errors import ProfileError, nearest
from retarget.core.profile import JointLimit, RobotProfile

ROBOTS_FOLDERS = ("cmeel.prefix/share/{package}/robots", "{module}/robots", "{module}")
"""Where an installed distribution may keep its robots, relative to site-packages."""

CONTINUOUS_LIMIT_RAD = 4 * math.pi
"""A joint without position limits gets ±2 turns: a finite range that no retargeted motion reaches."""


def find_urdf(profile: RobotProfile) -> Path:
    """Path of the profile's URDF. Raises `ProfileError` when the package or the file is missing."""
    source = profile.model
    if source.kind == "file":
        path = Path(source.path)
    else:
        path = _package_folder(profile) / source.path
    if not path.is_file():
        raise ProfileError(profile.origin or profile.name, f"no model file {source.path}", place="[model]")
    return path


def _package_folder(profile: RobotProfile) -> Path:
    package = profile.model.package
    try:
        distribution = metadata.distribution(package)
    except metadata.PackageNotFoundError:
        raise ProfileError(
            profile.origin or profile.name, f"package '{package}' is not installed", place="[model] package",
            expected=f"pip install {package}",
        ) from None  # fmt: skip
    for pattern in ROBOTS_FOLDERS:
        folder = Path(str(distribution.locate_file(pattern.format(package=package, module=package.replace("-", "_")))))
        if folder.is_dir():
            return folder
    raise ProfileError(
        profile.origin or profile.name, f"package '{package}' has no robots folder", place="[model] package"
    )


def prepared_urdf(profile: RobotProfile, text: str) -> str:
    """URDF `text` with locked joints fixed, continuous joints bounded, and the profile's limits in place of its own.

    Raises `ProfileError` for text that is no URDF, and for limits or locks of joints that it lacks.
    """
    origin = profile.origin or profile.name
    try:
        root = ET.fromstring(text)
    except ET.ParseError as error:
        raise ProfileError(origin, f"the model is not XML: {error}", place="[model]") from None
    if root.tag != "robot":
        raise ProfileError(
            origin, f"the model's root element is <{root.tag}>", place="[model]", expected="<robot> (URDF)"
        )
    joints = {str(joint.get("name")): joint for joint in root.findall("joint")}
    movable = [name for name, joint in joints.items() if joint.get("type") != "fixed"]
    for pattern in profile.locked_joints:
        matching = [name for name in movable if fnmatch(name, pattern)]
        if not matching:
            raise _unknown_joint(profile, pattern, movable, "[model] locked_joints")
        for name in matching:
            _fix(joints[name])
            movable.remove(name)
    for pattern in profile.joint_limits:
        if not any(fnmatch(name, pattern) for name in movable):
            raise _unknown_joint(profile, pattern, movable, "[limits.joints]")
    for name in movable:
        _set_limit(profile, joints[name])
    for tag in ("transmission", "gazebo"):
        for element in root.findall(tag):
            root.remove(element)
    return ET.tostring(root, encoding="unicode")


def _unknown_joint(profile: RobotProfile, name: str, joints: list[str], place: str) -> ProfileError:
    near = nearest(name, joints)
    hint = f"did you mean {' or '.join(near)}?" if near else f"one of {', '.join(joints)}"
    return ProfileError(profile.origin or profile.name, f"the model has no joint '{name}'", place=place, expected=hint)


def _fix(joint: ET.Element) -> None:
    joint.set("type", "fixed")
    for tag in ("axis", "limit", "mimic", "dynamics", "calibration", "safety_controller"):
        for element in joint.findall(tag):
            joint.remove(element)


def _set_limit(profile: RobotProfile, joint: ET.Element) -> None:
    name = str(joint.get("name"))
    limit = joint.find("limit")
    if limit is None:
        limit = ET.SubElement(joint, "limit", {"effort": "0", "velocity": "0"})
    if joint.get("type") == "continuous":
        joint.set("type", "revolute")
        limit.set("lower", repr(-CONTINUOUS_LIMIT_RAD))
        limit.set("upper", repr(CONTINUOUS_LIMIT_RAD))
    velocity = float(limit.get("velocity", "0"))
    if profile.default_velocity_limit is not None:
        velocity = min(velocity, profile.default_velocity_limit) if velocity > 0 else profile.default_velocity_limit
    override = JointLimit()
    for pattern, given in profile.joint_limits.items():
        if fnmatch(name, pattern):
            override = given
    lower = override.lower if override.lower is not None else float(limit.get("lower", "0"))
    upper = override.upper if override.upper is not None else float(limit.get("upper", "0"))
    velocity = override.velocity if override.velocity is not None else velocity
    if not lower <= upper or not velocity > 0:
        raise ProfileError(
            profile.origin or profile.name, f"joint '{name}' has range {lower:g}…{upper:g} and speed limit {velocity:g}",
            place="[limits]", expected="lower ≤ upper and a speed above 0",
        )  # fmt: skip
    limit.set("lower", repr(lower))
    limit.set("upper", repr(upper))
    limit.set("velocity", repr(velocity))
