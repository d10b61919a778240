"""Overlaps of hulls that the meshes don't share: a ball in the mouth of a channel, in its wall, and Baxter's elbow beside its hollow torso."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from retarget.core.kinematics import link_poses
from retarget.core.replay import kinematic
from retarget.core.replay.collisions import SelfCollisions, self_collisions
from retarget.core.replay.mesh_contact import winding_number
from retarget.core.replay.meshes import read_mesh
from retarget.core.replay.model import ReplayModel, build
from retarget.core.replay.shapes import shapes_of
from retarget.core.replay.thresholds import Thresholds
from retarget.core.robot_model import RobotModel
from retarget.core.types import Array, JointTrajectory

from tests.core.replay.conftest import RobotFactory, collision, link

OUTLINE = np.array([[0, 0], [3, 0], [3, 2], [2, 2], [2, 1], [1, 1], [1, 2], [0, 2]]) / 10
"""x, z m of a channel that opens upward, with walls and floor of 10 cm; it runs from y = -0.1 to 0.1 m."""
CAP = ((5, 6, 7), (0, 5, 7), (0, 1, 5), (1, 4, 5), (1, 2, 4), (2, 3, 4))
RADIUS = 0.03
MOUTH, WALL, BRIM, BESIDE = (0.15, 0.0, 0.15), (0.05, 0.0, 0.1), (0.1, 0.0, 0.15), (-0.1, 0.0, 0.1)


def channel() -> tuple[Array, np.ndarray]:
    """Vertices (16, 3) and triangles, counter-clockwise seen from outside."""
    front, back = (np.insert(OUTLINE, 1, y, axis=1) for y in (-0.1, 0.1))
    faces = [*CAP, *((c + 8, b + 8, a + 8) for a, b, c in CAP)]
    for i in range(8):
        j = (i + 1) % 8
        faces += [(i, i + 8, j), (j, i + 8, j + 8)]
    return np.concatenate([front, back]), np.array(faces)


def slide(name: str, parent: str, child: str, axis: str, at: str = "0 0 0") -> str:
    return (
        f'<joint name="{name}" type="prismatic"><parent link="{parent}"/><child link="{child}"/><origin xyz="{at}"/>'
        f'<axis xyz="{axis}"/><limit lower="-3" upper="3" effort="40" velocity="5"/></joint>'
    )


@pytest.fixture
def gantry(robot_from: RobotFactory, tmp_path: Path) -> ReplayModel:
    """A channel and, three slides away, a ball; what the slides carry in between is far off."""
    vertices, faces = channel()
    (tmp_path / "urdf").mkdir()
    lines = [f"v {x} {y} {z}" for x, y, z in vertices] + [f"f {a} {b} {c}" for a, b, c in faces + 1]
    (tmp_path / "urdf" / "channel.obj").write_text("\n".join(lines))
    far = collision('<sphere radius="0.01"/>', "5 5 5")
    body = (
        link("channel", shapes=collision('<mesh filename="channel.obj"/>'))
        + link("x", shapes=far)
        + link("y", shapes=far.replace("5 5 5", "6 6 6"))
        + link("ball", shapes=collision(f'<sphere radius="{RADIUS}"/>'))
        + slide("sx", "channel", "x", "1 0 0", "1 0 0")
        + slide("sy", "x", "y", "0 1 0")
        + slide("sz", "y", "ball", "0 0 1")
    )
    return build(robot_from(body), base="fixed", self_collision=True, cache=tmp_path)


def found_at(gantry: ReplayModel, *places: tuple[float, float, float], doubted_m: float | None) -> SelfCollisions:
    return self_collisions(gantry, np.array(places) - [1.0, 0.0, 0.0], doubted_m=doubted_m)


def test_winding_number_is_one_inside_and_zero_outside_and_in_the_mouth() -> None:
    vertices, faces = channel()
    rng = np.random.default_rng(3)
    points = rng.uniform([-0.1, -0.2, -0.1], [0.4, 0.2, 0.3], (500, 3))
    x, y, z = points.T
    inside = (np.abs(y) < 0.1) & (x > 0) & (x < 0.3) & (z > 0) & (z < 0.2) & ~((x > 0.1) & (x < 0.2) & (z > 0.1))
    assert 20 < inside.sum() < 300
    np.testing.assert_allclose(winding_number(points, vertices[faces]), inside, atol=1e-9)


def test_the_hull_alone_sees_the_ball_in_the_mouth(gantry: ReplayModel) -> None:
    hulls = found_at(gantry, MOUTH, doubted_m=None)
    assert hulls.depth_m[0] == pytest.approx(0.05 + RADIUS, abs=1e-6)
    assert hulls.hulls_only == {}
    found = found_at(gantry, MOUTH, doubted_m=0.02)
    assert found.depth_m.tolist() == [0.0]
    assert found.pair.tolist() == [[-1, -1]]
    assert found.by_pair() == {}
    ((pair, depth),) = found.hulls_only.items()
    assert set(pair) == {"channel", "ball"}
    assert depth == pytest.approx(0.05 + RADIUS, abs=1e-6)


@pytest.mark.parametrize("place", [WALL, BRIM], ids=["inside the wall", "through its surface"])
def test_what_is_in_the_wall_stays(gantry: ReplayModel, place: tuple[float, float, float]) -> None:
    found, hulls = (found_at(gantry, place, doubted_m=doubted) for doubted in (0.02, None))
    assert found.depth_m[0] == hulls.depth_m[0] > 0.05
    assert found.hulls_only == {}


def test_of_one_pair_only_what_is_deeper_than_the_deepest_real_overlap_goes(gantry: ReplayModel) -> None:
    """Brim and mouth are equally deep in the hull's top; lower in the mouth it is deeper, and empty."""
    low = (0.15, 0.0, 0.135)
    hulls = found_at(gantry, BESIDE, low, BRIM, BESIDE, doubted_m=None)
    assert hulls.depth_m[1] > hulls.depth_m[2] > 0.02
    found = found_at(gantry, BESIDE, low, BRIM, BESIDE, doubted_m=0.02)
    np.testing.assert_array_equal(found.depth_m, [0.0, 0.0, hulls.depth_m[2], 0.0])
    assert list(found.hulls_only.values()) == [hulls.depth_m[1]]


def test_shallow_overlaps_are_not_doubted(gantry: ReplayModel) -> None:
    found = found_at(gantry, (0.15, 0.0, 0.22), doubted_m=0.02)
    assert found.depth_m[0] == pytest.approx(0.01, abs=1e-6)
    assert found_at(gantry, (0.15, 0.0, 0.22), doubted_m=0.005).depth_m[0] == 0.0


def test_a_lower_limit_doubts_more(gantry: ReplayModel) -> None:
    time = np.arange(2) / 60
    joints = np.tile(np.array([0.15, 0.0, 0.22]) - [1.0, 0.0, 0.0], (2, 1))
    motion = JointTrajectory(time, gantry.robot.joint_names, joints, np.zeros((2, 3)))
    depths = [
        kinematic.check(motion, gantry, Thresholds("kinematic", {"self_collision_depth_mm": limit}))
        for limit in (None, 20.0, 5.0)
    ]
    assert [report.check("self_collision_depth_mm").value for report in depths] == pytest.approx([10, 10, 0], abs=1e-3)
    (left_out,) = depths[-1].facts["self_collision_hulls_only"]
    assert left_out["depth_mm"] == pytest.approx(10, abs=1e-3)


def test_the_fraction_counts_what_is_deep_and_real(gantry: ReplayModel) -> None:
    places = np.array([(0.15, 0.0, 0.135), WALL, BESIDE, BESIDE, (0.05, 0.0, 0.22)]) - [1.0, 0.0, 0.0]
    motion = JointTrajectory(np.arange(5) / 60, gantry.robot.joint_names, places, np.zeros((5, 3)))
    assert kinematic.collision_fraction(motion, gantry) == pytest.approx(1 / 5)


def test_baxters_elbow_passes_its_torso(
    clip: Callable[..., tuple[JointTrajectory, RobotModel]], replayed: Callable[..., ReplayModel]
) -> None:
    """The hull of its torso spans from the head's socket to the belly; by coal's distances the elbow stays 5 cm away and more."""
    import coal

    trajectory, robot = clip("baxter", "reach", 17.0, 18.0)
    found = self_collisions(replayed("baxter"), trajectory.position, doubted_m=0.02)
    assert found.hulls_only["torso", "right_upper_elbow"] > 0.06
    assert ("torso", "right_upper_elbow") not in found.by_pair()
    torso, elbow = (
        next(shape for shape in shapes_of(robot)[0] if shape.link == name) for name in ("torso", "right_upper_elbow")
    )
    assert torso.mesh is not None
    mesh = read_mesh(torso.mesh, torso.mesh.read_bytes()).scaled(torso.scale)
    tree = coal.BVHModelOBBRSS()
    tree.beginModel(len(mesh.faces), len(mesh.vertices))
    tree.addVertices(np.asfortranarray(mesh.vertices))
    tree.addTriangles(np.asfortranarray(mesh.faces.astype(np.uint32)))
    tree.endModel()
    tube = coal.Cylinder(elbow.size[0], 2 * elbow.size[1])
    rotation, origin = link_poses(robot, ["torso", "right_upper_elbow"], trajectory.position[::10])
    for turn, place in zip(rotation, origin, strict=True):
        at_torso, at_elbow = (
            coal.Transform3s(turn[i] @ shape.rotation, turn[i] @ shape.origin + place[i])
            for i, shape in enumerate((torso, elbow))
        )
        apart = coal.distance(tree, at_torso, tube, at_elbow, coal.DistanceRequest(), coal.DistanceResult())
        assert apart > 0.05
