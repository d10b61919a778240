"""URDFs of our own against the published figures, row by row, and the text's model against both."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pinocchio as pin
import pytest
from retarget.core.robot_model import RobotModel
from retarget.robots import atlas_figures, generate, tocabi_figures

from tests.robots.published_figures import numbers, published

TABLES = [("tocabi", tocabi_figures), ("atlas-v5", atlas_figures)]
"""Table and what we made of it."""
COUNTS = {"tocabi": (35, 36), "atlas-v5": (30, 31)}
"""Joints and links that are bodies."""


def left_out(name: str) -> bool:
    """Frames and cameras, which are no bodies; the pelvis needs no world to hang from."""
    return any(part in name for part in ("camera", "fake", "world"))


@pytest.mark.parametrize(("file", "figures"), TABLES)
class TestPublished:
    def test_every_joint(self, file: str, figures: ModuleType) -> None:
        joints, _ = published(file)
        kept = [row for row in joints if not left_out(row["joint"])]
        ours = {joint.name: joint for joint in figures.JOINTS}
        assert list(ours) == [row["joint"] for row in kept]
        assert len(ours) == COUNTS[file][0]
        for row in kept:
            joint = ours[row["joint"]]
            assert (joint.parent, joint.child) == (row["parent"], row["child"])
            np.testing.assert_allclose(joint.xyz, numbers(row["xyz"]), atol=1e-15)
            np.testing.assert_allclose(joint.rpy, numbers(row["rpy"]), atol=1e-15)
            if row["type"] == "fixed":
                assert joint.axis is None
            else:
                np.testing.assert_array_equal(joint.axis, numbers(row["axis"]))
                assert (joint.lower, joint.upper) == (float(row["lower"]), float(row["upper"]))

    def test_every_link(self, file: str, figures: ModuleType) -> None:
        _, links = published(file)
        kept = [row for row in links if not left_out(row["link"])]
        assert list(figures.INERTIAS) == [row["link"] for row in kept]
        assert len(kept) == COUNTS[file][1]
        for row in kept:
            ours = figures.INERTIAS[row["link"]]
            assert ours.mass == float(row["mass"])
            assert not numbers(row["inertial rpy"]).any()
            np.testing.assert_array_equal(ours.com, numbers(row["com"]))
            np.testing.assert_array_equal(ours.tensor, numbers(row["ixx iyy izz ixy ixz iyz"]))

    def test_the_model_has_them(self, file: str, figures: ModuleType) -> None:
        """Through the text: body after body, in the frame of its joint. Where a link is fixed to it, both are one body."""
        _, links = published(file)
        model = pin.buildModelFromXML((Path(generate.__file__).parent / f"{figures.NAME}.urdf").read_text())
        glued = {link for joint in figures.JOINTS if joint.axis is None for link in (joint.parent, joint.child)}
        root = figures.JOINTS[0].parent if file == "tocabi" else "pelvis"
        compared = 0
        for row in links:
            if left_out(row["link"]) or row["link"] in {*glued, root}:
                continue
            frame = model.frames[model.getFrameId(row["link"])]
            body = model.inertias[frame.parentJoint]
            ixx, iyy, izz, ixy, ixz, iyz = numbers(row["ixx iyy izz ixy ixz iyz"])
            assert body.mass == pytest.approx(float(row["mass"]))
            np.testing.assert_allclose(body.lever, numbers(row["com"]), atol=1e-9)
            expected = [[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]]
            np.testing.assert_allclose(body.inertia, expected, atol=1e-9, err_msg=row["link"])
            compared += 1
        assert compared >= 30


def test_atlas_has_its_published_motors() -> None:
    joints, _ = published("atlas-v5")
    for row in joints:
        if row["type"] == "revolute":
            drive = atlas_figures.DRIVES[row["joint"]]
            assert (drive.torque, drive.speed) == (float(row["effort"]), float(row["vel"]))


def test_atlas_by_hand() -> None:
    """A few figures typed here, so that something is checked where the tables are not at hand."""
    model = pin.buildModelFromXML((Path(generate.__file__).parent / "atlas.urdf").read_text())
    assert model.nq == 30
    data = model.createData()
    pin.forwardKinematics(model, data, np.zeros(30))
    origins = {
        "back_bkx": (-0.0125, 0.0, 0.212),
        "l_arm_shz": (0.1281, 0.2256, 0.6896),
        "l_arm_shx": (0.1281, 0.3356, 0.4446),
        "l_arm_ely": (0.1281, 0.5226, 0.4286),
        "l_arm_elx": (0.1281, 0.6416, 0.4378),
        "r_arm_wry": (0.1281, -0.94115, 0.42859),
        "l_leg_hpy": (0.05, 0.1115, -0.066),
        "r_leg_aky": (0.0, -0.1115, -0.862),
    }
    for name, origin in origins.items():
        np.testing.assert_allclose(data.oMi[model.getJointId(name)].translation, origin, atol=1e-9, err_msg=name)
    effort = dict(zip(model.names[1:], model.effortLimit, strict=True))
    assert (effort["l_leg_kny"], effort["r_arm_shx"], effort["back_bkz"]) == (890.0, 99.0, 106.0)


def test_atlas_t_pose_is_that_of_darvish(build_robot: Callable[[str], RobotModel]) -> None:
    """[Darvish2019]'s fixed link rotations for this robot, R_LF = rpy(0, -90°, 0) for both arms, met to the digits of π/2."""
    atlas = build_robot("atlas")
    data = atlas.pin_model.createData()
    pin.framesForwardKinematics(atlas.pin_model, data, atlas.configuration(atlas.reference_posture))
    turned = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])  # R_LF transposed: +90° about y
    for side in "lr":
        for link in ("uarm", "ufarm", "hand"):
            rotation = data.oMf[atlas.pin_model.getFrameId(f"{side}_{link}")].rotation
            np.testing.assert_allclose(rotation, turned, atol=1e-5)
    for link in ("pelvis", "utorso", "head", "l_uleg", "r_lleg", "l_foot"):
        np.testing.assert_allclose(data.oMf[atlas.pin_model.getFrameId(link)].rotation, np.eye(3), atol=1e-12)
