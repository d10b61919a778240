"""URDF text written from figures, read back by pinocchio and MuJoCo, which know nothing of the writer."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from retarget.robots import generate
from retarget.robots.urdf_writer import Box, Cylinder, Drive, Inertia, Joint, Sphere, urdf
from scipy.spatial.transform import Rotation

JOINTS = (
    Joint("hinge", "base", "arm", (0.1, 0.2, 0.3), (0.1, -0.2, 0.3), (0.0, 0.6, 0.8), -1.0, 2.0),
    Joint("glued", "arm", "tip", (0.0, 0.0, 0.5)),
)
INERTIAS = {
    "base": Inertia(3.0, (0.0, 0.0, 0.1), (0.02, 0.03, 0.04, 0.0, 0.0, 0.0)),
    "arm": Inertia(1.5, (0.01, 0.02, 0.03), (0.02, 0.03, 0.04, 0.001, -0.002, 0.003)),
    "tip": Inertia(0.25, (0.0, 0.0, 0.0), (0.001, 0.001, 0.001, 0.0, 0.0, 0.0)),
}
SHAPES = {
    "base": (Box((0.1, 0.2, 0.3), (0.0, 0.0, 0.1)), Sphere(0.05, (0.0, 0.1, 0.0), solid=False)),
    "arm": (Cylinder(0.02, (0.1, 0.2, -0.1), (0.3, -0.2, 0.4)), Cylinder(0.03, (0.0, 0.1, 0.0), (0.0, 0.3, 0.0))),
}


def text() -> str:
    return urdf("toy", "a toy", JOINTS, {"hinge": Drive(12.5, 3.0)}, INERTIAS, SHAPES)


def test_pinocchio_reads_what_was_meant() -> None:
    model = pin.buildModelFromXML(text())
    assert list(model.names) == ["universe", "hinge"]
    placement = model.jointPlacements[1]
    np.testing.assert_allclose(placement.translation, [0.1, 0.2, 0.3])
    np.testing.assert_allclose(placement.rotation, Rotation.from_euler("xyz", [0.1, -0.2, 0.3]).as_matrix(), atol=1e-9)
    assert (model.lowerPositionLimit[0], model.upperPositionLimit[0]) == (-1.0, 2.0)
    assert (model.effortLimit[0], model.velocityLimit[0]) == (12.5, 3.0)
    # The glued tip counts with the arm.
    assert model.inertias[1].mass == pytest.approx(1.75)
    # One joint, so its Jacobian is one column: the axis as the base sees it.
    column = np.ravel(pin.computeJointJacobians(model, model.createData(), np.zeros(1)))
    np.testing.assert_allclose(column[3:], placement.rotation @ [0.0, 0.6, 0.8], atol=1e-12)


def test_cylinders_reach_from_start_to_end() -> None:
    origins = ET.fromstring(text()).findall("link[@name='arm']/collision/origin")
    lengths = [
        float(c.get("length", ""))
        for c in ET.fromstring(text()).findall("link[@name='arm']/collision/geometry/cylinder")
    ]
    for shape, origin, length in zip(SHAPES["arm"], origins, lengths, strict=True):
        assert isinstance(shape, Cylinder)
        centre = np.array(origin.get("xyz", "").split(), float)
        turn = Rotation.from_euler("xyz", np.array(origin.get("rpy", "").split(), float))
        half = turn.apply([0.0, 0.0, length / 2])
        np.testing.assert_allclose(centre - half, shape.start, atol=1e-8)
        np.testing.assert_allclose(centre + half, shape.end, atol=1e-8)


def test_what_is_only_seen_does_not_collide() -> None:
    base = ET.fromstring(text()).find("link[@name='base']")
    assert base is not None
    assert len(base.findall("visual")) == 2
    assert len(base.findall("collision")) == 1


@pytest.mark.parametrize("name", list(generate.files()))
def test_the_committed_files_are_those_that_the_figures_give(name: str) -> None:
    """`python -m retarget.robots.generate` must change nothing."""
    committed = Path(generate.__file__).parent / name
    assert committed.read_text(encoding="utf-8") == generate.files()[name]


@pytest.mark.parametrize("name", list(generate.files()))
def test_mujoco_takes_them_and_no_part_stands_in_another(name: str) -> None:
    """Arms at zero, then with the elbows forward. Only neighbours in the tree may overlap, which MuJoCo leaves out."""
    root = ET.fromstring(generate.files()[name])
    root.append(ET.fromstring('<mujoco><compiler balanceinertia="true" fusestatic="false"/></mujoco>'))
    model = mujoco.MjModel.from_xml_string(ET.tostring(root, encoding="unicode"))
    data = mujoco.MjData(model)
    for forward in (0.0, np.pi / 2):
        for joint, sign in (("L_Armlink_Joint", -1), ("R_Armlink_Joint", 1)):
            if (index := mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, joint)) >= 0:
                data.qpos[model.jnt_qposadr[index]] = sign * forward
        mujoco.mj_forward(model, data)
        bodies = [
            tuple(model.body(model.geom_bodyid[geom]).name for geom in contact.geom)
            for contact in data.contact[: data.ncon]
        ]
        assert bodies == []
