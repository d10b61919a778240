"""TOCABI from its URDF beside TOCABI from an MJCF of the same robot."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from importlib.resources import files
from typing import Any

import mujoco
import numpy as np
import pytest
from retarget import robots
from retarget.core import pipeline, robot_model, rotations
from retarget.core.replay import kinematic
from retarget.core.replay import model as replay_model
from retarget.formats import read_motion

from tests.core.mjcf_robots import numbers


def as_mjcf(replay: Any) -> str:
    """A compiled model written with all digits, which MuJoCo's own writer doesn't; links that were merged stand as bodies without mass."""
    mj, robot = replay.mj, replay.robot
    root = ET.Element("mujoco", {"model": "twin"})
    ET.SubElement(root, "compiler", {"angle": "radian", "autolimits": "true"})
    elements = {0: ET.SubElement(root, "worldbody")}
    geom_kinds = {
        int(kind): kind.name.removeprefix("mjGEOM_").lower()
        for kind in (mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_CYLINDER)
    }
    for b in range(1, mj.nbody):
        placed = {"pos": numbers(mj.body_pos[b]), "quat": numbers(mj.body_quat[b])}
        body = elements[b] = ET.SubElement(elements[mj.body_parentid[b]], "body", {"name": mj.body(b).name, **placed})
        inertial = {
            "pos": numbers(mj.body_ipos[b]),
            "quat": numbers(mj.body_iquat[b]),
            "mass": numbers(mj.body_mass[b]),
        }
        ET.SubElement(body, "inertial", {**inertial, "diaginertia": numbers(mj.body_inertia[b])})
        for j in range(mj.body_jntadr[b], mj.body_jntadr[b] + mj.body_jntnum[b]):
            if mj.jnt_type[j] == mujoco.mjtJoint.mjJNT_FREE:
                ET.SubElement(body, "freejoint")
                continue
            dof, facts = mj.jnt_dofadr[j], {"name": mj.joint(j).name, "axis": numbers(mj.jnt_axis[j])}
            for key, value in (
                ("armature", mj.dof_armature),
                ("damping", mj.dof_damping),
                ("frictionloss", mj.dof_frictionloss),
            ):
                facts[key] = numbers(value[dof])
            ET.SubElement(body, "joint", {**facts, "range": numbers(mj.jnt_range[j])})
        for g in range(mj.body_geomadr[b], mj.body_geomadr[b] + mj.body_geomnum[b]):
            placed = {
                "pos": numbers(mj.geom_pos[g]),
                "quat": numbers(mj.geom_quat[g]),
                "size": numbers(mj.geom_size[g]),
            }
            ET.SubElement(body, "geom", {"type": geom_kinds[int(mj.geom_type[g])], "group": "3", **placed})
    for link, b in replay.body_of_link.items():
        if link != mj.body(b).name:
            _, turn, origin = robot.link_in_joint(link)
            placed = {"pos": numbers(origin), "quat": numbers(rotations.from_matrix(turn))}
            ET.SubElement(elements[b], "body", {"name": link, **placed})
    actuator = ET.SubElement(root, "actuator")
    for a in range(mj.nu):
        force = {"forcelimited": "true", "forcerange": numbers(mj.actuator_forcerange[a])}
        ET.SubElement(actuator, "motor", {"joint": mj.joint(mj.actuator_trnid[a, 0]).name, **force})
    return ET.tostring(root, encoding="unicode")


@pytest.fixture(scope="module")
def twins(build_robot: Any, tmp_path_factory: pytest.TempPathFactory) -> tuple[Any, Any]:
    """TOCABI, and TOCABI from what MuJoCo made of it, each as replay model with self-collision."""
    folder = tmp_path_factory.mktemp("twin")
    tocabi = build_robot("tocabi")
    original = replay_model.build(tocabi, base="floating", floor=True, self_collision=True, cache=folder)
    (folder / "tocabi.xml").write_text(as_mjcf(original), encoding="utf-8")
    speeds = "".join(
        f"{name} = {{ velocity_rad_s = {speed!r} }}\n"
        for name, speed in zip(tocabi.joint_names, tocabi.velocity_limit.tolist(), strict=True)
    )
    (folder / "twin.toml").write_text(
        f'extends = "tocabi"\n[model]\nfile = "tocabi.xml"\n[limits.joints]\n{speeds}', encoding="utf-8"
    )
    twin = robot_model.build(robots.load(str(folder / "twin.toml")))
    return original, replay_model.build(twin, base="floating", floor=True, self_collision=True, cache=folder)


def test_tocabi_from_mjcf_is_tocabi(twins: tuple[Any, Any]) -> None:
    original, twin = twins
    assert twin.robot.warnings == ()
    assert twin.robot.joint_names == original.robot.joint_names
    for field in ("lower", "upper", "velocity_limit", "reference_posture", "mass_kg"):
        np.testing.assert_allclose(
            getattr(twin.robot, field), getattr(original.robot, field), rtol=1e-12, err_msg=field
        )
    for field in ("torque_limit_nm", "armature", "friction_nm", "damping_nms_rad"):
        np.testing.assert_allclose(getattr(twin, field), getattr(original, field), rtol=1e-12, err_msg=field)
    assert twin.excluded == original.excluded
    assert twin.mj.ngeom == original.mj.ngeom
    np.testing.assert_allclose(twin.mj.geom_pos, original.mj.geom_pos, atol=1e-12)
    np.testing.assert_allclose(twin.mj.body_inertia, original.mj.body_inertia, rtol=1e-9)


def test_a_clip_on_tocabi_from_mjcf_moves_and_passes_alike(twins: tuple[Any, Any]) -> None:
    motion = read_motion(str(files("retarget.samples") / "reach.mvnx.gz"))
    original, twin = twins
    options = pipeline.ConvertOptions(start_s=0.0, end_s=2.0)
    expected = pipeline.convert(motion, original.robot, options).trajectory
    found = pipeline.convert(motion, twin.robot, options).trajectory
    np.testing.assert_allclose(found.position, expected.position, atol=1e-6)
    np.testing.assert_allclose(found.base_position, expected.base_position, atol=1e-6)
    reports = [
        kinematic.check(trajectory, replay, motion=motion)
        for trajectory, replay in ((expected, original), (found, twin))
    ]
    assert [check.passed for check in reports[1].checks] == [check.passed for check in reports[0].checks]
    assert reports[1].passed
