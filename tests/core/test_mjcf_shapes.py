"""Shapes of an MJCF in the URDF: which are solid, which are seen, and where they stand."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from retarget.core import rotations
from retarget.core.replay.shapes import shapes_of

from tests.core.mjcf_robots import arm, built


def test_shapes_by_group_and_contact_type(tmp_path: Path) -> None:
    more = """<geom type="box" size="1 2 3" group="3" mass="0"/>
      <geom type="sphere" size="0.4" contype="0" conaffinity="0" mass="0"/>
      <geom type="sphere" size="0.5" contype="0" conaffinity="0" group="4" mass="0"/>
      <geom type="ellipsoid" size="0.5 1 1" mass="0"/>
      <geom type="cylinder" size="0.3 0.6" euler="0 1.5707963267948966 0" pos="1 0 0" group="3" mass="0"/>"""
    robot = built(tmp_path, arm(more=more))
    shapes = [shape for shape in shapes_of(robot, visuals=True)[0] if shape.link == "link"]
    solid = [(shape.kind, shape.size) for shape in shapes if shape.solid]
    seen = [(shape.kind, shape.size) for shape in shapes if not shape.solid]
    capsule = [("cylinder", (0.05, 0.2)), ("sphere", (0.05,)), ("sphere", (0.05,))]
    assert solid == [*capsule, ("box", (1.0, 2.0, 3.0)), ("cylinder", (0.3, 0.6))]
    assert seen == [*capsule, ("sphere", (0.4,))]
    ends = [shape.origin.tolist() for shape in shapes if shape.solid and shape.kind == "sphere"]
    np.testing.assert_allclose(ends, [[0, 0, 0], [0, 0, 0.4]], atol=1e-15)
    lying = next(shape for shape in shapes if shape.size == (0.3, 0.6))
    np.testing.assert_allclose(lying.rotation[:, 2], [1, 0, 0], atol=1e-12)
    assert robot.warnings == ("1 × geom of type ellipsoid, left out: link",)


TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 2 0\nv 0 0 3\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"


@pytest.mark.parametrize(
    "asset", ['scale="0.1 0.2 -0.3"', 'refpos="1 2 3" refquat="1 1 0 0" scale="2 2 2"', 'refpos="1 2 3" scale="1 2 3"']
)
def test_mesh_files_stand_where_mujoco_puts_their_vertices(asset: str, tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "part.obj").write_text(TETRAHEDRON, encoding="utf-8")
    text = arm(
        more='<geom type="mesh" mesh="part" pos="0.1 0.2 0.3" euler="0.1 0.2 0.3" mass="1"/>',
        sections=f'<asset><mesh file="part.obj" {asset}/><texture name="t" type="2d" file="gone.png"/></asset>',
    ).replace("<compiler", '<compiler meshdir="parts"')
    robot = built(tmp_path, text)
    shapes, lost = shapes_of(robot)
    (mesh,) = (shape for shape in shapes if shape.kind == "mesh")
    assert (lost, mesh.mesh) == ([], (tmp_path / "parts" / "part.obj").resolve())
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]], float) * mesh.scale
    found = vertices @ mesh.rotation.T + mesh.origin
    spec = mujoco.MjSpec.from_string(
        text.replace(' file="gone.png"', ' builtin="flat" width="8" height="8"'),
        assets={"parts/part.obj": TETRAHEDRON.encode()},
    )
    mj = spec.compile()
    geom = mj.ngeom - 1
    turn = rotations.to_matrix(mj.geom_quat[geom])
    expected = mj.mesh_vert @ turn.T + mj.geom_pos[geom]
    for vertex in found:
        assert np.linalg.norm(expected - vertex, axis=1).min() < 1e-6  # MuJoCo keeps vertices as float32
