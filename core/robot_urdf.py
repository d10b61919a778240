"""The URDF that everything downstream uses: the packaged one with the profile's limits written into it and its locked joints fixed.

What is retargeted, checked, embedded in the trajectory and replayed is then one and the same text.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from fnmatch import fnmatchcase
from importlib import metadata
from pathlib import Path

from retarget.core.errors import ProfileError, nearest
from retarget.core.profile import RobotProfile
from retarget.core.robot_mjcf import is_mjcf, urdf_of_mjcf

ROBOTS_FOLDERS = ("cmeel.prefix/share/{package}/robots", "{module}/robots", "{module}")
"""Where an installed distribution may keep its robots, relative to site-packages."""

CONTINUOUS_LIMIT_RAD = 4 * math.pi
"""A joint without position limits gets ±2 turns: a finite range that no retargeted motion reaches."""


def find_urdf(profile: RobotProfile) -> Path:
    """Path of the profile's URDF or MJCF. Raises `ProfileError` when the package or the file is missing."""
    source = profile.model
    folder = Path() if source.kind == "file" else _package_folder(profile)
    path = folder / source.path
    if not path.is_file():
        others = (
            {str(other.relative_to(folder)) for suffix in ("*.urdf", "*.xml") for other in folder.rglob(suffix)}
            if source.kind == "package"
            else ()
        )
        near = nearest(source.path, others)
        raise _error(
            profile,
            f"no model file {source.path}",
            "[model] path",
            f"did you mean {' or '.join(near)}?" if near else "",
        )
    return path


def read_urdf(profile: RobotProfile) -> bytes:
    """The profile's URDF, or MJCF, as it stands on disk. Raises `ProfileError` when it is missing or can't be read."""
    path = find_urdf(profile)
    try:
        return path.read_bytes()
    except OSError as error:
        raise _error(profile, f"{profile.model.path} can't be read: {error.strerror}", "[model]") from None


def read_model(profile: RobotProfile) -> tuple[str | bytes, tuple[str, ...]]:
    """(the profile's URDF, warnings): as it stands on disk, or converted where the file is MJCF. Raises `ProfileError`."""
    content = read_urdf(profile)
    if is_mjcf(content):
        return urdf_of_mjcf(profile, find_urdf(profile))
    return content, ()


def prepared_urdf(profile: RobotProfile, text: str | bytes) -> str:
    """URDF `text` with locked joints fixed, continuous joints bounded, and the profile's limits in place of its own.

    Bytes are decoded as their XML declaration says. Raises `ProfileError` for text that is no URDF, for limits or locks of joints that
    it lacks, for limits that contradict each other, and for joints with more than one degree of freedom.
    """
    root = _parsed(profile, text)
    joints = {str(joint.get("name")): joint for joint in root.findall("joint")}
    movable = [name for name, joint in joints.items() if joint.get("type") != "fixed"]
    for pattern in profile.locked_joints:
        matching = [name for name in movable if fnmatchcase(name, pattern)]
        if not matching:
            raise _unknown_joint(profile, pattern, movable, "[model] locked_joints")
        for name in matching:
            _fix(joints[name])
            movable.remove(name)
    for pattern in profile.joint_limits:
        if not any(fnmatchcase(name, pattern) for name in movable):
            raise _unknown_joint(profile, pattern, movable, "[limits.joints]")
    for name in movable:
        _set_limit(profile, joints[name], name)
    for tag in ("transmission", "gazebo"):
        for element in root.findall(tag):
            root.remove(element)
    return ET.tostring(root, encoding="unicode")


def _parsed(profile: RobotProfile, text: str | bytes) -> ET.Element:
    try:
        root = ET.fromstring(text)
    except (ET.ParseError, LookupError, ValueError) as error:  # the last two: encodings that Python or expat lack
        raise _error(profile, f"the model is not XML: {error}", "[model]") from None
    if root.tag != "robot":
        raise _error(
            profile, f"the model's root element is <{root.tag}>", "[model]", "<robot> (URDF) or <mujoco> (MJCF)"
        )
    if macro := next(
        (element.tag for element in root.iter() if "ros.org" in element.tag and "xacro" in element.tag), ""
    ):
        raise _error(
            profile, f"the model holds the macro <xacro:{macro.partition('}')[2]}>", "[model]", "expanded URDF"
        )
    return root


def _package_folder(profile: RobotProfile) -> Path:
    package = profile.model.package
    try:
        distribution = metadata.distribution(package)
    except (metadata.PackageNotFoundError, ValueError):  # ValueError: an empty name
        raise _error(
            profile, f"package '{package}' is not installed", "[model] package", f"pip install {package}"
        ) from None
    for pattern in ROBOTS_FOLDERS:
        folder = Path(str(distribution.locate_file(pattern.format(package=package, module=package.replace("-", "_")))))
        if folder.is_dir():
            return folder
    raise _error(profile, f"package '{package}' has no robots folder", "[model] package")


def _fix(joint: ET.Element) -> None:
    joint.set("type", "fixed")
    for tag in ("axis", "limit", "mimic", "dynamics", "calibration", "safety_controller"):
        for element in joint.findall(tag):
            joint.remove(element)


def _set_limit(profile: RobotProfile, joint: ET.Element, name: str) -> None:
    kind = joint.get("type")
    if kind not in ("revolute", "continuous", "prismatic"):
        raise _error(
            profile, f"joint '{name}' is of type '{kind}'", "[model]", "revolute, continuous, prismatic or fixed"
        )
    limit = joint.find("limit")
    if limit is None:
        limit = ET.SubElement(joint, "limit", {"effort": "0", "velocity": "0"})
    if kind == "continuous":
        joint.set("type", "revolute")
        limit.set("lower", repr(-CONTINUOUS_LIMIT_RAD))
        limit.set("upper", repr(CONTINUOUS_LIMIT_RAD))
    try:
        lower, upper, velocity = (float(limit.get(key, "0")) for key in ("lower", "upper", "velocity"))
    except ValueError:
        raise _error(profile, f"joint '{name}' has the limits {limit.attrib}", "[model]", "numbers") from None
    cap = profile.default_velocity_limit
    if cap is not None:
        velocity = min(velocity, cap) if velocity > 0 else cap
    for pattern, given in profile.joint_limits.items():
        if fnmatchcase(name, pattern):
            lower = lower if given.lower is None else given.lower
            upper = upper if given.upper is None else given.upper
            velocity = velocity if given.velocity is None else given.velocity
    if not (-math.inf < lower <= upper < math.inf and 0 < velocity < math.inf):
        raise _error(
            profile, f"joint '{name}' has range {lower:g}…{upper:g} and speed limit {velocity:g}", "[limits]",
            "lower ≤ upper and a speed above 0, all finite" + (
                "" if velocity > 0 else "; default_velocity_rad_s stands in where the model states no speed"
            ),
        )  # fmt: skip
    for key, value in (("lower", lower), ("upper", upper), ("velocity", velocity)):
        limit.set(key, repr(value))


def _unknown_joint(profile: RobotProfile, name: str, joints: list[str], place: str) -> ProfileError:
    near = nearest(name, joints)
    hint = f"did you mean {' or '.join(near)}?" if near else f"one of {', '.join(joints)}"
    return _error(profile, f"the model has no joint '{name}'", place, hint)


def _error(profile: RobotProfile, problem: str, place: str, expected: str = "") -> ProfileError:
    return ProfileError(profile.origin or profile.name, problem, place=place, expected=expected)
