"""Geoms of a compiled MJCF → <collision> and <visual> of a URDF link.

What can touch is solid: a contact type or affinity, or a contact pair that names the geom. What viewers show at first, groups 0 to 2, is seen. A
geom can be both. The world's own geoms are the scene, not the robot.
"""

from __future__ import annotations

import os
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from retarget.core import rotations
from retarget.core.types import Array
from retarget.core.urdf_text import numbers

SEEN_GROUPS = 3
MUJOCO_MESH = ".msh"


def add_shapes(
    link: ET.Element, model: Any, body: int, spec: Any, files: Mapping[str, Path | None], lost: dict[str, list[str]]
) -> None:
    """Adds to `link` all shapes of `body`. files: mesh → its file. What URDF has no word for is noted in `lost`: what it is → bodies."""
    paired = {int(g) for g in [*model.pair_geom1, *model.pair_geom2]}
    first = int(model.body_geomadr[body])
    for g in range(first, first + int(model.body_geomnum[body])):
        solid = bool(model.geom_contype[g] or model.geom_conaffinity[g] or g in paired)
        seen = bool(model.geom_group[g] < SEEN_GROUPS and _alpha(model, g) > 0)
        if not (solid or seen):
            continue
        shapes = _shapes(model, g, spec, files)
        if isinstance(shapes, str):
            lost.setdefault(f"{shapes}, left out", []).append(str(link.get("name")))
            continue
        for tag in ("visual",) * seen + ("collision",) * solid:
            for position, rotation, shape, attributes in shapes:
                element = ET.SubElement(link, tag)
                rpy = rotations.to_rpy(rotations.from_matrix(rotation))
                ET.SubElement(element, "origin", {"xyz": numbers(position), "rpy": numbers(rpy)})
                ET.SubElement(ET.SubElement(element, "geometry"), shape, attributes)


Placed = tuple[Array, Array, str, dict[str, str]]
"""Origin (3,) m and rotation (3, 3) in the link's frame, URDF's word for the shape, its attributes."""


def _shapes(model: Any, g: int, spec: Any, files: Mapping[str, Path | None]) -> list[Placed] | str:
    """What the geom is in URDF, or what it is that URDF has no word for."""
    import mujoco

    kinds = mujoco.mjtGeom
    position, rotation = np.array(model.geom_pos[g]), rotations.to_matrix(model.geom_quat[g])
    kind, size = int(model.geom_type[g]), np.array(model.geom_size[g])
    if kind == kinds.mjGEOM_BOX:
        return [(position, rotation, "box", {"size": numbers(2 * size)})]
    if kind == kinds.mjGEOM_SPHERE:
        return [(position, rotation, "sphere", {"radius": numbers(size[:1])})]
    if kind in (kinds.mjGEOM_CYLINDER, kinds.mjGEOM_CAPSULE):
        tube = {"radius": numbers(size[:1]), "length": numbers([2 * size[1]])}
        found: list[Placed] = [(position, rotation, "cylinder", tube)]
        if kind == kinds.mjGEOM_CAPSULE:  # URDF's readers know no capsule
            ends = (position + sign * size[1] * rotation[:, 2] for sign in (-1, 1))
            found += [(end, rotation, "sphere", {"radius": numbers(size[:1])}) for end in ends]
        return found
    if kind == kinds.mjGEOM_MESH:
        return _mesh(model, int(model.geom_dataid[g]), position, rotation, spec, files)
    return f"geom of type {mujoco.mjtGeom(kind).name.removeprefix('mjGEOM_').lower()}"


def _mesh(
    model: Any, number: int, position: Array, rotation: Array, spec: Any, files: Mapping[str, Path | None]
) -> list[Placed] | str:
    """MuJoCo moves a mesh into its principal axes and the geom with it: both are undone, so that the file's own vertices are meant."""
    name = str(model.mesh(number).name)
    file, mesh = files.get(name), spec.mesh(name)
    if file is None:
        return "mesh without a file"
    if file.suffix.lower() == MUJOCO_MESH:
        return "mesh in MuJoCo's own format"
    own = rotation @ rotations.to_matrix(model.mesh_quat[number]).T
    origin = position - own @ model.mesh_pos[number]
    # MuJoCo: vertex → scale · refquatᵀ (vertex − refpos)
    scale, turn = np.array(mesh.scale), rotations.to_matrix(rotations.normalize(mesh.refquat)).T
    if np.ptp(scale) > 0 and not np.allclose(turn, np.eye(3), atol=1e-12):
        return "mesh that is turned and then stretched"
    origin = origin - own @ (scale * (turn @ mesh.refpos))
    filename = Path(os.path.relpath(file.resolve(), Path(spec.modelfiledir).resolve())).as_posix()
    attributes = {"filename": filename}
    if (scale != 1).any():
        attributes["scale"] = numbers(scale)
    return [(origin, own @ turn, "mesh", attributes)]


def _alpha(model: Any, g: int) -> float:
    material = int(model.geom_matid[g])
    return float(model.geom_rgba[g, 3] if material < 0 else model.mat_rgba[material, 3])
