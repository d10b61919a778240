"""Mesh and picture files that an MJCF names, of which some may be missing: the robot is read all the same."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

STAND_IN = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)
"""Vertices in place of a mesh whose file is missing; only its name is used."""


def name_files(spec: Any) -> dict[str, Path | None]:
    """Mesh → its file, whether that is there or not; None for vertices that the MJCF itself holds. Gives each mesh the name that MuJoCo would."""
    found: dict[str, Path | None] = {}
    for mesh in spec.meshes:
        name = Path(str(mesh.file).replace("\\", "/"))
        if not mesh.name:
            mesh.name = name.stem
        path = Path(spec.modelfiledir) / mesh.compiler.meshdir / (name.name if spec.strippath else name)
        found[str(mesh.name)] = path if mesh.file else None
    return found


def replace_missing(spec: Any, files: Mapping[str, Path | None]) -> tuple[str, str] | None:
    """Puts a stand-in in place of each mesh whose file is missing, and of everything that is only for the eye.

    Returns (body, mesh file) when a body's mass follows from a mesh that is missing, else None.
    """
    import mujoco

    missing = {name: path for name, path in files.items() if path is not None and not path.is_file()}
    for mesh in spec.meshes:
        if mesh.name in missing:
            mesh.file, mesh.uservert = "", STAND_IN.ravel()
    for skin in list(spec.skins):
        spec.delete(skin)
    for texture in spec.textures:
        texture.file, texture.cubefiles = "", []
        texture.builtin, texture.width, texture.height = mujoco.mjtBuiltin.mjBUILTIN_FLAT, 8, 8
    for geom in list(spec.geoms):
        if geom.meshname not in missing:
            continue
        if _weighs(spec, geom):
            return str(geom.parent.name), missing[geom.meshname].name
        geom.mass = 0.0
        geom.type = mujoco.mjtGeom.mjGEOM_MESH  # not a box or capsule fitted around the stand-in: it is told as missing
    return None


def _weighs(spec: Any, geom: Any) -> bool:
    """Whether the mass of the geom's body follows from the geom."""
    import mujoco

    rule, (first, last) = spec.compiler.inertiafromgeom, spec.compiler.inertiagrouprange
    asked = rule == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE or (
        rule == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO and not geom.parent.explicitinertial
    )
    heavy = geom.mass > 0 if np.isfinite(geom.mass) else geom.density > 0
    return bool(geom.parent.name != "world" and asked and heavy and first <= geom.group <= last)
