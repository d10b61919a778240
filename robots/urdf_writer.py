"""URDF text from tables of figures: what links weigh, how joints lie, which boxes, cylinders and spheres stand for the body."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

Triple = tuple[float, float, float]
ZERO: Triple = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Joint:
    """xyz m and rpy rad: the child link's frame in the parent's. axis: unit, in the child's frame, None = fixed. Limits in rad."""

    name: str
    parent: str
    child: str
    xyz: Triple
    rpy: Triple = ZERO
    axis: Triple | None = None
    lower: float = 0.0
    upper: float = 0.0


@dataclass(frozen=True)
class Drive:
    """What a joint's motor can do: Nm and rad/s."""

    torque: float
    speed: float


@dataclass(frozen=True)
class Inertia:
    """mass kg, centre of mass m in the link's frame, and about it ixx iyy izz ixy ixz iyz, kg m², along the link's axes."""

    mass: float
    com: Triple
    tensor: tuple[float, float, float, float, float, float]


@dataclass(frozen=True)
class Box:
    """Edge lengths and centre, m, in the link's frame. solid: whether it counts in collisions, too, or is only seen."""

    size: Triple
    centre: Triple
    solid: bool = True


@dataclass(frozen=True)
class Cylinder:
    """Radius and the two ends of the axis, m, in the link's frame."""

    radius: float
    start: Triple
    end: Triple
    solid: bool = True


@dataclass(frozen=True)
class Sphere:
    """Radius and centre, m, in the link's frame."""

    radius: float
    centre: Triple
    solid: bool = True


Shape = Box | Cylinder | Sphere


def urdf(
    robot: str,
    comment: str,
    joints: Sequence[Joint],
    drives: Mapping[str, Drive],
    inertias: Mapping[str, Inertia],
    shapes: Mapping[str, Sequence[Shape]],
) -> str:
    """The text, links and joints in the order of the tables. drives: joint → motor; shapes: link → body, links without one are bare."""
    root = ET.Element("robot", {"name": robot})
    root.append(ET.Comment(f" {comment} "))
    for link, inertia in inertias.items():
        element = ET.SubElement(root, "link", {"name": link})
        _inertial(element, inertia)
        for shape in shapes.get(link, ()):
            _shape(ET.SubElement(element, "visual"), shape)
        for shape in shapes.get(link, ()):
            if shape.solid:
                _shape(ET.SubElement(element, "collision"), shape)
    for joint in joints:
        _joint(root, joint, drives)
    ET.indent(root, "  ")
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _inertial(link: ET.Element, inertia: Inertia) -> None:
    element = ET.SubElement(link, "inertial")
    _origin(element, inertia.com, ZERO)
    ET.SubElement(element, "mass", {"value": _number(inertia.mass)})
    names = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    ET.SubElement(element, "inertia", {key: _number(value) for key, value in zip(names, inertia.tensor, strict=True)})


def _joint(root: ET.Element, joint: Joint, drives: Mapping[str, Drive]) -> None:
    kind = "fixed" if joint.axis is None else "revolute"
    element = ET.SubElement(root, "joint", {"name": joint.name, "type": kind})
    ET.SubElement(element, "parent", {"link": joint.parent})
    ET.SubElement(element, "child", {"link": joint.child})
    _origin(element, joint.xyz, joint.rpy)
    if joint.axis is None:
        return
    drive = drives[joint.name]
    limit = {"lower": joint.lower, "upper": joint.upper, "effort": drive.torque, "velocity": drive.speed}
    ET.SubElement(element, "axis", {"xyz": _numbers(joint.axis)})
    ET.SubElement(element, "limit", {key: _number(value) for key, value in limit.items()})


def _shape(element: ET.Element, shape: Shape) -> None:
    geometry = ET.Element("geometry")
    if isinstance(shape, Box):
        _origin(element, shape.centre, ZERO)
        ET.SubElement(geometry, "box", {"size": _numbers(shape.size)})
    elif isinstance(shape, Sphere):
        _origin(element, shape.centre, ZERO)
        ET.SubElement(geometry, "sphere", {"radius": _number(shape.radius)})
    else:
        start, end = np.array(shape.start), np.array(shape.end)
        length = float(np.linalg.norm(end - start))
        x, y, z = (end - start) / length
        # A URDF cylinder runs along z: roll, then pitch turn z onto the axis.
        centre = tuple(((start + end) / 2).tolist())
        _origin(element, centre, (float(-np.arcsin(y)), float(np.arctan2(x, z)), 0.0))
        ET.SubElement(geometry, "cylinder", {"radius": _number(shape.radius), "length": _number(length)})
    element.append(geometry)


def _origin(element: ET.Element, xyz: Iterable[float], rpy: Iterable[float]) -> None:
    ET.SubElement(element, "origin", {"xyz": _numbers(xyz), "rpy": _numbers(rpy)})


def _numbers(values: Iterable[float]) -> str:
    return " ".join(_number(value) for value in values)


def _number(value: float) -> str:
    """Nine significant digits, the same text on every machine; zero without a sign."""
    return f"{value:.9g}" if abs(value) > 1e-12 else "0"
