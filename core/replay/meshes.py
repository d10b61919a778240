"""Mesh files as vertices and triangles: STL (binary and text), OBJ, COLLADA."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from retarget.core.errors import FormatError
from retarget.core.replay.collada import read_collada
from retarget.core.types import Array

STL_HEADER, STL_TRIANGLE = 84, 50
STL_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
SUFFIXES = (".stl", ".obj", ".dae")


@dataclass(frozen=True, eq=False)
class Mesh:
    """vertices (V, 3) m, all used and no two the same; faces (F, 3) indices of triangles, counter-clockwise seen from outside."""

    vertices: Array
    faces: NDArray[np.int32]

    @classmethod
    def of(cls, corners: Array) -> Mesh:
        """Of triangles (F, 3, 3): corners in the same place become one vertex."""
        vertices, index = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
        faces = index.reshape(-1, 3).astype(np.int32)
        distinct = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 0] != faces[:, 2])
        return cls(vertices, faces[distinct])

    def scaled(self, scale: tuple[float, ...]) -> Mesh:
        """A negative factor mirrors the mesh; its triangles are turned over so that outside stays outside."""
        mirrored = np.prod(scale) < 0
        return Mesh(self.vertices * np.array(scale), self.faces[:, ::-1] if mirrored else self.faces)

    @property
    def is_flat(self) -> bool:
        """Whether all vertices lie in one plane (to 1 µm): no solid body."""
        if len(self.vertices) < 4:
            return True
        centred = self.vertices - self.vertices.mean(axis=0)
        _, _, axes = np.linalg.svd(centred.T @ centred)
        return bool(np.ptp(centred @ axes[2]) < 1e-6)


def read_mesh(path: Path, content: bytes) -> Mesh:
    """The mesh in `content`, which `path` only names. Raises `FormatError` for what can't be read, and for numbers that are not finite."""
    suffix = path.suffix.lower()
    try:
        if suffix == ".stl":
            corners = _stl(content)
        elif suffix == ".obj":
            corners = _obj(content)
        elif suffix == ".dae":
            corners = read_collada(content)
        else:
            raise FormatError(path, f"unknown mesh format '{suffix}'", expected=", ".join(SUFFIXES))
    except (ValueError, IndexError, KeyError) as error:
        raise FormatError(path, f"no readable mesh: {error}", expected=f"a {suffix} file") from None
    if not len(corners):
        raise FormatError(path, "the mesh has no triangles")
    if not np.isfinite(corners).all():
        raise FormatError(path, "the mesh has coordinates that are not finite")
    return Mesh.of(corners)


def _stl(content: bytes) -> Array:
    """Text files begin with "solid", but so do the headers of many binary ones: the size decides."""
    if len(content) >= STL_HEADER:
        count = int.from_bytes(content[80:STL_HEADER], "little")
        if len(content) >= STL_HEADER + count * STL_TRIANGLE and not _looks_like_text(content, count):
            return np.asarray(np.frombuffer(content, STL_RECORD, count, STL_HEADER)["corners"], float)
    if not content.lstrip().startswith(b"solid"):
        raise ValueError("the file is shorter than its header says")
    lines = (line.split() for line in content.decode("ascii", "replace").splitlines())
    values = [[float(word) for word in line[1:4]] for line in lines if line and line[0].lower() == "vertex"]
    return np.array(values, float).reshape(-1, 3, 3)


def _looks_like_text(content: bytes, count: int) -> bool:
    return content.lstrip().startswith(b"solid") and len(content) != STL_HEADER + count * STL_TRIANGLE


def _obj(content: bytes) -> Array:
    vertices, corners = [], []
    for line in content.decode("utf-8", "replace").replace("\\\n", " ").splitlines():
        words = line.split()
        if not words:
            continue
        if words[0] == "v":
            vertices.append([float(word) for word in words[1:4]])
        elif words[0] == "f":
            numbers = [int(word.partition("/")[0]) for word in words[1:]]
            if any(number == 0 or abs(number) > len(vertices) for number in numbers):
                raise ValueError(f"a face names a vertex that is not there: {line.strip()}")
            polygon = [number - 1 if number > 0 else len(vertices) + number for number in numbers]
            corners += [(polygon[0], b, c) for b, c in pairwise(polygon[1:])]
    points = np.array(vertices, float).reshape(-1, 3)
    return np.asarray(points[np.array(corners, int).reshape(-1, 3)])
