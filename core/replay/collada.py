"""COLLADA (.dae): the triangles of the whole scene, in metres, Z up.

Read is what robot descriptions hold: meshes of triangles and polygons, placed by the nodes of the visual scene. Colours, lights, cameras and
animations don't matter here. Source: the COLLADA 1.4.1 specification.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from itertools import count, pairwise

import numpy as np
from numpy.typing import NDArray
from retarget.core.types import Array

Z_UP = {
    "Z_UP": np.eye(3),
    "Y_UP": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    "X_UP": np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]),
}
"""What the file calls its up axis → rotation into a frame whose z points up. Without an entry the specification says Y_UP."""
DEEPEST_NODE = 100
MOST_NODES = 10_000
"""Nodes that are shown, each as often as it is placed: one that places the next one twice, which does the same, doubles with every step."""


def read_collada(content: bytes) -> Array:
    """Triangles (F, 3, 3) m of everything that the scene shows. Raises `ValueError` for what is no COLLADA."""
    try:
        root = ET.fromstring(content)
    except (ET.ParseError, LookupError) as error:
        raise ValueError(f"not XML: {error}") from None
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
    if root.tag != "COLLADA":
        raise ValueError(f"the root element is <{root.tag}>, not <COLLADA>")
    unit = root.find("asset/unit")
    metre = float(unit.get("meter", "1")) if unit is not None else 1.0
    up = Z_UP[root.findtext("asset/up_axis", "Y_UP").strip()]
    geometries = {str(g.get("id")): g for g in root.iterfind("library_geometries/geometry")}
    triangles = {name: _triangles(geometry) for name, geometry in geometries.items()}
    parts = [_transformed(matrix, triangles[name]) for name, matrix in _instances(root)]
    corners = np.concatenate([np.empty((0, 3, 3)), *parts])
    return np.asarray(metre * corners @ up.T)


def _instances(root: ET.Element) -> Iterator[tuple[str, Array]]:
    """(geometry, its placement (4, 4)) for everything in the scene; for all geometries where there is no scene."""
    instance = root.find("scene/instance_visual_scene")
    scenes = {str(s.get("id")): s for s in root.iterfind("library_visual_scenes/visual_scene")}
    scene = scenes.get(_reference(instance)) if instance is not None else next(iter(scenes.values()), None)
    if scene is None:
        for geometry in root.iterfind("library_geometries/geometry"):
            yield str(geometry.get("id")), np.eye(4)
        return
    library = {str(node.get("id")): node for node in root.iter("node")}
    shown = count(1)
    for node in scene.iterfind("node"):
        yield from _of_node(node, np.eye(4), library, 0, shown)


def _of_node(
    node: ET.Element, outer: Array, library: dict[str, ET.Element], depth: int, shown: Iterator[int]
) -> Iterator[tuple[str, Array]]:
    """As `_instances`, of one node placed at `outer` (4, 4). shown: counts the nodes."""
    if depth > DEEPEST_NODE:
        raise ValueError("nodes that contain themselves")
    if next(shown) > MOST_NODES:
        raise ValueError(f"more than {MOST_NODES:,} nodes are shown")
    matrix = outer
    for child in node:
        matrix = matrix @ _transform(child)
    for instance in node.iterfind("instance_geometry"):
        yield _reference(instance), matrix
    for child in node.iterfind("node"):
        yield from _of_node(child, matrix, library, depth + 1, shown)
    for instance in node.iterfind("instance_node"):
        yield from _of_node(library[_reference(instance)], matrix, library, depth + 1, shown)


def _transform(element: ET.Element) -> Array:
    """(4, 4) of a <matrix>, <translate>, <rotate> or <scale>; the identity for every other element."""
    result = np.eye(4)
    if element.tag == "matrix":
        return _floats(element).reshape(4, 4)
    if element.tag == "translate":
        result[:3, 3] = _floats(element)
    elif element.tag == "scale":
        result[:3, :3] = np.diag(_floats(element))
    elif element.tag == "rotate":
        *axis, degrees = _floats(element)
        x, y, z = np.array(axis) / (np.linalg.norm(axis) or 1.0)
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        angle = np.radians(degrees)
        result[:3, :3] += np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return result


def _triangles(geometry: ET.Element) -> Array:
    """(F, 3, 3) in the file's own unit and axes."""
    mesh = geometry.find("mesh")
    if mesh is None:  # splines and convex hulls of other geometries
        return np.empty((0, 3, 3))
    sources = {str(source.get("id")): source for source in mesh.iterfind("source")}
    positions = {
        str(vertices.get("id")): sources[_reference(place, "source")]
        for vertices in mesh.iterfind("vertices")
        for place in vertices.iterfind("input")
        if place.get("semantic") == "POSITION"
    }
    parts = [np.empty((0, 3, 3))]
    for primitive in mesh:
        if primitive.tag not in ("triangles", "polylist", "polygons", "trifans", "tristrips"):
            continue
        inputs = primitive.findall("input")
        vertex = next((i for i in inputs if i.get("semantic") == "VERTEX"), None)
        if vertex is None:
            raise ValueError(f"<{primitive.tag}> without vertices")
        stride = 1 + max(int(i.get("offset", "0")) for i in inputs)
        points = _positions(positions[_reference(vertex, "source")])
        for p in primitive.iterfind("p"):
            index = np.array((p.text or "").split(), int).reshape(-1, stride)[:, int(vertex.get("offset", "0"))]
            if index.size and not 0 <= index.min() <= index.max() < len(points):
                raise ValueError("a triangle names a vertex that is not there")
            parts.append(points[_faces(primitive, index)])
    return np.concatenate(parts)


def _faces(primitive: ET.Element, index: NDArray[np.int64]) -> NDArray[np.int64]:
    """Triangles (F, 3) of vertex indices; polygons become fans about their first corner."""
    if primitive.tag == "triangles":
        return index.reshape(-1, 3)
    if primitive.tag == "tristrips":
        strip = np.stack([index[:-2], index[1:-1], index[2:]], axis=1)
        strip[1::2] = strip[1::2, ::-1]
        return strip
    lengths = (
        [len(index)] if primitive.tag != "polylist" else [int(n) for n in primitive.findtext("vcount", "").split()]
    )
    if sum(lengths) != len(index):
        raise ValueError(f"<vcount> adds up to {sum(lengths)} corners, <p> holds {len(index)}")
    ends = np.cumsum(lengths)
    fans = [index[end - n : end] for end, n in zip(ends, lengths, strict=True)]
    faces = [(fan[0], b, c) for fan in fans for b, c in pairwise(fan[1:])]
    return np.array(faces, int).reshape(-1, 3)


def _positions(source: ET.Element) -> Array:
    accessor = source.find("technique_common/accessor")
    array = source.find("float_array")
    if array is None:
        raise ValueError("a <source> without <float_array>")
    stride = int(accessor.get("stride", "3")) if accessor is not None else 3
    start = int(accessor.get("offset", "0")) if accessor is not None else 0
    return _floats(array)[start:].reshape(-1, stride)[:, :3]


def _transformed(matrix: Array, corners: Array) -> Array:
    """Triangles (F, 3, 3) placed by (4, 4), turned over where it mirrors them."""
    placed = corners @ matrix[:3, :3].T + matrix[:3, 3]
    return np.asarray(placed[:, ::-1] if np.linalg.det(matrix[:3, :3]) < 0 else placed)


def _floats(element: ET.Element) -> Array:
    return np.array((element.text or "").split(), float)


def _reference(element: ET.Element, key: str = "url") -> str:
    return str(element.get(key, "")).removeprefix("#")
