"""Do links really meet where their convex hulls do? Meshes triangle by triangle, by coal, the collision library that pinocchio brings along.

A hull holds its mesh, so hulls that are apart settle it at a hundredth of the cost, and this is asked about what is left in doubt. How deep a real
overlap is triangles don't tell.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray
from retarget.core.kinematics import link_poses
from retarget.core.replay.meshes import read_mesh
from retarget.core.replay.shapes import Shape, shapes_of
from retarget.core.robot_model import RobotModel
from retarget.core.types import Array

PROBES = 8
"""Vertices of a mesh that are looked for inside another one."""
MOST_INSIDE = 64
"""Rows in which that is done beyond one for every run of frames; one takes milliseconds."""


@dataclass(frozen=True, eq=False)
class _Solid:
    """One shape in its link's frame. geometry, placement: coal's. probes: (P, 3) m, points of it. corners: (F, 3, 3) m, its triangles, none of
    boxes and round shapes, which coal takes for solid.
    """

    geometry: Any
    rotation: Array
    origin: Array
    probes: Array
    corners: Array


class MeshContact:
    """The shapes of a robot's links, each read when it is first asked for."""

    def __init__(self, robot: RobotModel) -> None:
        self._robot = robot
        self._solids: dict[str, list[_Solid]] = {}
        self._shapes: dict[str, list[Shape]] | None = None

    def first_meeting(self, first: str, second: str, joints: Array, frames: NDArray[np.int64]) -> int | None:
        """The first row of joints (K, n) in which the two links meet or one is inside the other, None when they never do.

        frames: (K,), the rows' places in the clip. Whether one is inside the other does not change without their surfaces meeting, so it is asked
        once for every run of frames in which these don't, and, as links may jump, in `MOST_INSIDE` of the rows.
        """
        rotation, origin = link_poses(self._robot, [first, second], joints)
        pairs = [(a, b) for a in self._of(first) for b in self._of(second)]
        met = next((k for k in range(len(joints)) if _touch(pairs, rotation[k], origin[k])), None)
        apart = np.arange(len(joints) if met is None else met)
        in_time = apart[np.argsort(frames[apart])]
        runs = np.split(in_time, np.flatnonzero(np.diff(frames[in_time]) > 1) + 1) if len(apart) else []
        spread = apart[np.linspace(0, len(apart) - 1, min(MOST_INSIDE, len(apart))).astype(int)]
        for k in sorted({int(run.min()) for run in runs} | set(spread.tolist())):
            if _inside(pairs, rotation[k], origin[k]):
                return k
        return met

    def _of(self, link: str) -> list[_Solid]:
        if self._shapes is None:
            self._shapes = {}
            for shape in shapes_of(self._robot)[0]:
                self._shapes.setdefault(shape.link, []).append(shape)
        if link not in self._solids:
            self._solids[link] = [_solid(shape) for shape in self._shapes.get(link, [])]
        return self._solids[link]


def _coal() -> Any:
    """The collision library, which has no types; imported when it is needed."""
    return import_module("coal")


def _solid(shape: Shape) -> _Solid:
    coal = _coal()
    if shape.mesh is None:
        sizes = {
            "box": lambda s: coal.Box(*(2 * value for value in s)),
            "sphere": lambda s: coal.Sphere(s[0]),
            "cylinder": lambda s: coal.Cylinder(s[0], 2 * s[1]),
            "capsule": lambda s: coal.Capsule(s[0], 2 * s[1]),
        }
        return _Solid(
            sizes[shape.kind](shape.size), shape.rotation, shape.origin, shape.origin[None], np.empty((0, 3, 3))
        )
    mesh = read_mesh(shape.mesh, shape.mesh.read_bytes()).scaled(shape.scale)
    vertices = mesh.vertices @ shape.rotation.T + shape.origin
    tree = coal.BVHModelOBBRSS()
    tree.beginModel(len(mesh.faces), len(vertices))
    tree.addVertices(np.asfortranarray(vertices))
    tree.addTriangles(np.asfortranarray(mesh.faces.astype(np.uint32)))
    tree.endModel()
    probes = vertices[np.linspace(0, len(vertices) - 1, min(PROBES, len(vertices))).astype(int)]
    return _Solid(tree, np.eye(3), np.zeros(3), probes, vertices[mesh.faces])


def _touch(pairs: list[tuple[_Solid, _Solid]], rotation: Array, origin: Array) -> bool:
    """rotation (2, 3, 3), origin (2, 3) m: of the two links."""
    coal = _coal()
    request = coal.CollisionRequest()
    for solids in pairs:
        placed = [
            coal.Transform3s(rotation[i] @ solid.rotation, rotation[i] @ solid.origin + origin[i])
            for i, solid in enumerate(solids)
        ]
        (a, b), (at_a, at_b) = solids, placed
        if coal.collide(a.geometry, at_a, b.geometry, at_b, request, coal.CollisionResult()):
            return True
    return False


def _inside(pairs: list[tuple[_Solid, _Solid]], rotation: Array, origin: Array) -> bool:
    for solids in pairs:
        for inner, outer in ((0, 1), (1, 0)):
            corners = solids[outer].corners
            if not len(corners):
                continue
            points = (solids[inner].probes @ rotation[inner].T + origin[inner] - origin[outer]) @ rotation[outer]
            within = ((points > corners.min(axis=(0, 1))) & (points < corners.max(axis=(0, 1)))).all(axis=1)
            if within.any() and (np.abs(winding_number(points[within], corners)) > 0.5).any():
                return True
    return False


def winding_number(points: Array, corners: Array) -> Array:
    """(P,) how often the triangles `corners` (F, 3, 3) wind around each of `points` (P, 3): 1 inside a closed surface, 0 outside, between where it has
    holes. The sum of solid angles [VanOosterom1983], [Jacobson2013].
    """
    a, b, c = (corners[None, :, k] - points[:, None] for k in range(3))
    length_a, length_b, length_c = (np.linalg.norm(x, axis=-1) for x in (a, b, c))
    volume = (a * np.cross(b, c)).sum(axis=-1)
    rest = length_a * length_b * length_c
    rest += (a * b).sum(axis=-1) * length_c + (b * c).sum(axis=-1) * length_a + (c * a).sum(axis=-1) * length_b
    return np.asarray(np.arctan2(volume, rest).sum(axis=1) / (2 * np.pi))
