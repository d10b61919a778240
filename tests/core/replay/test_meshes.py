"""Mesh files: hand-written ones against the solids they describe, the robots' own against assimp (through coal)."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from retarget.core.errors import FormatError
from retarget.core.replay.meshes import Mesh, read_mesh
from retarget.core.replay.shapes import shapes_of
from retarget.core.robot_model import RobotModel
from retarget.core.types import Array
from scipy.spatial import cKDTree

TETRAHEDRON = np.array([[0, 0, 0], [2, 0, 0], [0, 3, 0], [0, 0, 4]], float)
FACES = ((0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3))
VOLUME = 2 * 3 * 4 / 6


def volume(mesh: Mesh) -> float:
    """Signed: positive when the triangles are counter-clockwise seen from outside."""
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    return float(np.einsum("fi,fi->", a, np.cross(b, c)) / 6)


def as_set(points: Array) -> set[tuple[float, ...]]:
    return {tuple(point) for point in np.round(points, 9).tolist()}


def binary_stl(header: bytes) -> bytes:
    triangles = [struct.pack("<12fH", 0, 0, 0, *TETRAHEDRON[list(face)].ravel(), 0) for face in FACES]
    return header.ljust(80, b"\0") + struct.pack("<I", len(FACES)) + b"".join(triangles)


def text_stl() -> bytes:
    facets = []
    for face in FACES:
        corners = "\n".join(f"      vertex {x:e} {y:e} {z:e}" for x, y, z in TETRAHEDRON[list(face)])
        facets.append(f"  facet normal 0 0 0\n    outer loop\n{corners}\n    endloop\n  endfacet")
    return ("solid tetrahedron\n" + "\n".join(facets) + "\nendsolid\n").encode()


def obj(faces: str) -> bytes:
    vertices = "\n".join(f"v {x} {y} {z} 1.0" for x, y, z in TETRAHEDRON)
    return f"# comment\nmtllib none.mtl\no part\n{vertices}\nvn 0 0 1\nusemtl red\ns off\n{faces}\n".encode()


OBJ_PLAIN = "\n".join("f " + " ".join(str(i + 1) for i in face) for face in FACES)
OBJ_SLASHES = "\n".join("f " + " ".join(f"{i + 1}//1" for i in face) for face in FACES)
OBJ_NEGATIVE = "\n".join("f " + " ".join(str(i - 4) for i in face) for face in FACES)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("part.stl", binary_stl(b"made by hand")),
        ("part.STL", binary_stl(b"solid says the header of a binary file")),
        ("part.stl", binary_stl(b"") + b"trailing"),
        ("part.stl", text_stl()),
        ("part.obj", obj(OBJ_PLAIN)),
        ("part.obj", obj(OBJ_SLASHES)),
        ("part.OBJ", obj(OBJ_NEGATIVE)),
    ],
)
def test_a_tetrahedron_is_read(name: str, content: bytes) -> None:
    mesh = read_mesh(Path(name), content)
    assert as_set(mesh.vertices) == as_set(TETRAHEDRON)
    assert volume(mesh) == pytest.approx(VOLUME)
    assert not mesh.is_flat


def test_polygons_of_an_obj_become_triangles() -> None:
    """A unit cube of six squares."""
    corners = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    faces = [(1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4)]
    text = "\n".join([*(f"v {x} {y} {z}" for x, y, z in corners), *("f {} {} {} {}".format(*f) for f in faces)])
    mesh = read_mesh(Path("cube.obj"), text.encode())
    assert len(mesh.faces) == 12
    assert volume(mesh) == pytest.approx(1.0)


@pytest.mark.parametrize("scale", [(1.0, 1.0, 1.0), (0.001, 0.001, 0.001), (1.0, -1.0, 1.0), (-2.0, -1.0, 1.0)])
def test_scaled_meshes_stay_turned_outside(scale: tuple[float, ...]) -> None:
    mesh = read_mesh(Path("part.stl"), text_stl()).scaled(scale)
    assert volume(mesh) == pytest.approx(VOLUME * abs(np.prod(scale)))


def test_a_sheet_is_flat_and_a_thin_plate_is_not() -> None:
    sheet = read_mesh(Path("sheet.obj"), b"v 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\nf 1 2 3 4\n")
    assert sheet.is_flat
    plate = read_mesh(Path("plate.obj"), b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0.001\nf 1 2 3 4\n")
    assert not plate.is_flat


def collada(asset: str, nodes: str, primitive: str = "", scene: str = "#scene") -> bytes:
    primitive = primitive or (
        '<triangles count="4"><input semantic="VERTEX" source="#v" offset="1"/><input semantic="NORMAL" source="#n" offset="0"/>'
        f"<p>{' '.join(f'0 {i}' for face in FACES for i in face)}</p></triangles>"
    )
    floats = " ".join(str(x) for x in TETRAHEDRON.ravel())
    return f"""<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset>{asset}</asset>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="pa" count="12">{floats}</float_array>
<technique_common><accessor source="#pa" count="4" stride="3"/></technique_common></source>
<source id="n"><float_array id="na" count="3">0 0 1</float_array></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>{primitive}
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="scene">{nodes}</visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="{scene}"/></scene></COLLADA>""".encode()


HERE = '<node><instance_geometry url="#g"/></node>'
METRES = '<unit meter="1"/><up_axis>Z_UP</up_axis>'


@pytest.mark.parametrize(
    ("asset", "nodes", "expected"),
    [
        (METRES, HERE, TETRAHEDRON),
        ('<unit meter="0.001" name="millimeter"/><up_axis>Z_UP</up_axis>', HERE, TETRAHEDRON / 1000),
        ("<up_axis>Y_UP</up_axis>", HERE, TETRAHEDRON[:, [0, 2, 1]] * [1, -1, 1]),
        ("", HERE, TETRAHEDRON[:, [0, 2, 1]] * [1, -1, 1]),
        ("<up_axis>X_UP</up_axis>", HERE, TETRAHEDRON[:, [1, 2, 0]] * [-1, -1, 1]),
        (
            METRES,
            '<node><translate>1 2 3</translate><rotate>0 0 1 90</rotate><scale>2 2 2</scale><node><instance_geometry url="#g"/></node></node>',
            2 * TETRAHEDRON[:, [1, 0, 2]] * [-1, 1, 1] + [1, 2, 3],
        ),
        (
            METRES,
            '<node><matrix>1 0 0 5  0 1 0 6  0 0 1 7  0 0 0 1</matrix><instance_geometry url="#g"/></node>',
            TETRAHEDRON + np.array([5, 6, 7]),
        ),
    ],
)
def test_collada_is_placed_in_metres_with_z_up(asset: str, nodes: str, expected: Array) -> None:
    mesh = read_mesh(Path("part.dae"), collada(asset, nodes))
    assert as_set(mesh.vertices) == as_set(expected)
    assert volume(mesh) > 0


def test_a_mirrored_node_stays_turned_outside() -> None:
    nodes = '<node><scale>1 -1 1</scale><instance_geometry url="#g"/></node>'
    assert volume(read_mesh(Path("part.dae"), collada(METRES, nodes))) == pytest.approx(VOLUME)


def test_collada_instances_count_as_often_as_they_are_placed() -> None:
    nodes = HERE + '<node><translate>10 0 0</translate><instance_geometry url="#g"/></node>'
    mesh = read_mesh(Path("part.dae"), collada(METRES, nodes))
    assert len(mesh.vertices) == 8
    assert volume(mesh) == pytest.approx(2 * VOLUME)


VERTEX = '<input semantic="VERTEX" source="#v" offset="0"/>'


@pytest.mark.parametrize(
    "primitive",
    [
        f"<polylist>{VERTEX}<vcount>3 3 3 3</vcount><p>0 2 1 0 1 3 1 2 3 2 0 3</p></polylist>",
        f"<polygons>{VERTEX}<p>0 2 1</p><p>0 1 3</p><p>1 2 3</p><p>2 0 3</p></polygons>",
        f"<tristrips>{VERTEX}<p>0 2 1 3 0 2</p></tristrips>",
        f"<trifans>{VERTEX}<p>3 0 1 2 0</p></trifans><triangles>{VERTEX}<p>0 2 1</p></triangles>",
    ],
)
def test_collada_polygons_strips_and_fans(primitive: str) -> None:
    mesh = read_mesh(Path("part.dae"), collada(METRES, HERE, primitive))
    assert as_set(mesh.vertices) == as_set(TETRAHEDRON)
    assert volume(mesh) == pytest.approx(VOLUME)


DOUBLING = "".join(f'<node id="n{i}">' + 2 * f'<instance_node url="#n{i + 1}"/>' + "</node>" for i in range(60))
DOUBLING += '<node id="n60"/>'
"""2⁶⁰ nodes in a few lines."""


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.stl", b"", "shorter than its header says"),
        ("a.stl", binary_stl(b"x")[:-1], "shorter than its header says"),
        ("a.stl", b"\0" * 80 + struct.pack("<I", 0), "no triangles"),
        ("a.stl", text_stl().replace(b"vertex 2", b"vertex nan 2", 1), "not finite"),
        ("a.stl", text_stl().replace(b"vertex 2.0", b"vertex two", 1), "could not convert"),
        ("a.obj", b"v 0 0 0\nf 1 2 3\n", "a face names a vertex that is not there: f 1 2 3"),
        ("a.obj", b"# nothing\n", "no triangles"),
        ("a.dae", b"<COLLADA", "not XML"),
        ("a.dae", b"<html/>", "the root element is <html>"),
        ("a.dae", collada(METRES, HERE, f"<triangles>{VERTEX}<p>0 1 9</p></triangles>"), "vertex that is not there"),
        (
            "a.dae",
            collada(METRES, HERE, f"<polylist>{VERTEX}<vcount>4</vcount><p>0 1 2</p></polylist>"),
            "adds up to 4",
        ),
        ("a.dae", collada(METRES, '<node><instance_geometry url="#other"/></node>'), "other"),
        ("a.dae", collada(METRES, '<node id="n"><instance_node url="#n"/></node>'), "contain themselves"),
        ("a.dae", collada(METRES, DOUBLING), "more than 10,000 nodes are shown"),
        ("a.dae", collada(METRES, ""), "no triangles"),
        ("a.glb", b"glTF", "unknown mesh format '.glb'; expected .stl, .obj, .dae"),
    ],
)
def test_what_cannot_be_read_is_one_clear_line(name: str, content: bytes, message: str) -> None:
    with pytest.raises(FormatError) as raised:
        read_mesh(Path(name), content)
    assert message in str(raised.value)
    assert str(raised.value).startswith(name)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("name", ["baxter", "g1", "icub", "talos"])
def test_meshes_of_the_robots_are_those_that_assimp_reads(build_robot: Callable[[str], RobotModel], name: str) -> None:
    """assimp, as coal calls it, leaves COLLADA files in their own axes: those that say "Y up" are turned here by hand."""
    coal = pytest.importorskip("coal")
    shapes, warnings = shapes_of(build_robot(name))
    paths = {shape.mesh for shape in shapes if shape.mesh is not None}
    assert warnings == []
    assert paths
    for path in paths:
        content = path.read_bytes()
        expected = np.array(coal.MeshLoader().load(str(path), np.ones(3)).vertices())
        if b"<up_axis>Y_UP" in content:
            expected = expected[:, [0, 2, 1]] * [1, -1, 1]
        mine = read_mesh(path, content).vertices
        for points, others in ((mine, expected), (expected, mine)):
            distance, _ = cKDTree(others).query(points)
            assert distance.max() < 1e-6, path.name
