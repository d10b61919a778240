"""The solid shapes of a URDF's links: boxes, spheres, cylinders, capsules and mesh files, placed in their link's frame."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from retarget.core import rotations
from retarget.core.errors import ProfileError
from retarget.core.replay.mesh_paths import MeshPaths
from retarget.core.robot_model import RobotModel
from retarget.core.types import Array

LARGEST_SIZE_M = 100.0


@dataclass(frozen=True, eq=False)
class Shape:
    """One shape of a link.

    kind: "box", "sphere", "cylinder", "capsule" or "mesh". size: m; three half edges; radius; radius and half length along z (of the capsule
    without its caps). rotation (3, 3) and origin (3,) m: link ← shape. mesh: the file, `scale` (3,) its factors. solid: whether it can collide, or is
    only seen.
    """

    link: str
    kind: str
    size: tuple[float, ...]
    rotation: Array
    origin: Array
    mesh: Path | None = None
    scale: tuple[float, ...] = (1.0, 1.0, 1.0)
    solid: bool = True


def shapes_of(robot: RobotModel, *, visuals: bool = False) -> tuple[list[Shape], list[str]]:
    """Shapes of all links, and one warning for each kind of shape that had to be left out, with their number.

    visuals: also what is only seen. Raises `ProfileError` for numbers that are none, naming the link.
    """
    paths = MeshPaths.of(robot.profile)
    found: list[Shape] = []
    lost: dict[str, list[str]] = {}
    for link in ET.fromstring(robot.urdf).findall("link"):
        for tag in ("collision", "visual") if visuals else ("collision",):
            for element in link.findall(tag):
                shape, problem = _shape(robot, str(link.get("name")), element, paths)
                if shape is not None:
                    found.append(shape)
                elif problem:
                    lost.setdefault(f"{problem[0]} ({tag})", []).append(problem[1])
    return found, [
        f"{len(names)} × {problem}: {names[0]}{', …' if len(names) > 1 else ''}" for problem, names in lost.items()
    ]


def _shape(
    robot: RobotModel, link: str, element: ET.Element, paths: MeshPaths
) -> tuple[Shape | None, tuple[str, str] | None]:
    """The shape; or None and (why it is left out, what it is)."""
    geometry = element.find("geometry")
    solid = next(iter(geometry), None) if geometry is not None else None
    if solid is None:
        return None, ("geometry without a shape", link)
    origin = element.find("origin")
    xyz = _numbers(robot, link, origin, "xyz", 3, (0.0, 0.0, 0.0))
    rpy = _numbers(robot, link, origin, "rpy", 3, (0.0, 0.0, 0.0))
    placed = (rotations.to_matrix(rotations.from_rpy(rpy)), np.array(xyz))
    collides = element.tag == "collision"
    if solid.tag == "mesh":
        scale = _numbers(robot, link, solid, "scale", 3, (1.0, 1.0, 1.0))
        path, problem = paths.resolve(str(solid.get("filename", "")))
        if path is None:
            return None, (problem, str(solid.get("filename", "")))
        return Shape(link, "mesh", (), *placed, mesh=path, scale=scale, solid=collides), None
    if solid.tag == "box":
        size = tuple(value / 2 for value in _numbers(robot, link, solid, "size", 3, (0.0, 0.0, 0.0)))
    elif solid.tag == "sphere":
        size = _numbers(robot, link, solid, "radius", 1, (0.0,))
    elif solid.tag in ("cylinder", "capsule"):
        (radius,) = _numbers(robot, link, solid, "radius", 1, (0.0,))
        (length,) = _numbers(robot, link, solid, "length", 1, (0.0,))
        size = (radius, length / 2)
    else:
        return None, (f"unknown shape <{solid.tag}>", link)
    if not all(0 < value < LARGEST_SIZE_M for value in size):
        return None, (f"{solid.tag} without a size", link)
    return Shape(link, solid.tag, size, *placed, solid=collides), None


def _numbers(
    robot: RobotModel, link: str, element: ET.Element | None, key: str, count: int, default: tuple[float, ...]
) -> tuple[float, ...]:
    text = element.get(key) if element is not None else None
    if text is None:
        return default
    try:
        values = tuple(float(word) for word in text.split())
    except ValueError:
        values = ()
    if len(values) != count or not all(map(math.isfinite, values)):
        raise ProfileError(
            robot.profile.origin or robot.profile.name,
            f"link '{link}' has {key}=\"{text}\"",
            place="[model]",
            expected=f"{count} finite number{'s' if count > 1 else ''}",
        )
    return values
