"""Profile → kinematic model, against iDynTree's kinematics of the same URDF text."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from retarget import robots
from retarget.core import robot_model, rotations
from retarget.core.errors import MotionError, ProfileError
from retarget.core.robot_model import RobotModel
from retarget.core.types import Array, HumanMotion

idyntree = pytest.importorskip("idyntree.bindings")


@pytest.fixture(params=robots.names())
def model(request: pytest.FixtureRequest, make_motion: Callable[..., HumanMotion]) -> RobotModel:
    return robot_model.build(robots.load(request.param), make_motion([0.0]))


class IDynTree:
    """Link poses of the URDF text by iDynTree: world from base, joints by name."""

    def __init__(self, model: RobotModel) -> None:
        loader = idyntree.ModelLoader()
        assert loader.loadReducedModelFromString(model.urdf, list(model.joint_names), "urdf")
        self.kinematics = idyntree.KinDynComputations()
        assert self.kinematics.loadRobotModel(loader.model())
        assert self.kinematics.setFloatingBase(model.base_link)
        own = self.kinematics.model()
        self.order = [model.joint_index(own.getJointName(i)) for i in range(own.getNrOfDOFs())]

    def link(self, name: str, joints: Array, base: Array) -> tuple[Array, Array]:
        n = len(joints)
        state = base, joints[self.order], np.zeros(6), np.zeros(n), np.array([0.0, 0.0, -9.81])
        assert self.kinematics.setRobotState(*state)
        pose = self.kinematics.getWorldTransform(name)
        return pose.getRotation().toNumPy(), pose.getPosition().toNumPy()


def test_link_placements_agree_with_idyntree(model: RobotModel) -> None:
    """Every mapped link, hand and foot, in random postures with a random base pose."""
    links = {*model.links.values(), *(hand.link for hand in model.profile.hands.values())}
    links |= {foot.link for foot in model.profile.feet.values()}
    other, data = IDynTree(model), model.pin_model.createData()
    generator = np.random.default_rng(5)
    for _ in range(5):
        joints = model.lower + (model.upper - model.lower) * generator.random(len(model.joint_names))
        base = np.eye(4)
        turn = np.array([1.0, 0.0, 0.0, 0.0])
        if model.base_is_floating:
            turn = rotations.normalize(generator.normal(size=4))
            base[:3, :3], base[:3, 3] = rotations.to_matrix(turn), generator.normal(size=3)
        configuration = model.configuration(joints, turn, base[:3, 3])
        pin.forwardKinematics(model.pin_model, data, configuration)
        for link in links:
            joint, rotation, origin = model.link_in_joint(link)
            carrier = data.oMi[joint]
            expected_rotation, expected_origin = other.link(link, joints, base)
            np.testing.assert_allclose(carrier.rotation @ rotation, expected_rotation, atol=1e-9)
            np.testing.assert_allclose(carrier.rotation @ origin + carrier.translation, expected_origin, atol=1e-9)


def test_mass_agrees_with_idyntree(model: RobotModel) -> None:
    assert model.mass_kg == pytest.approx(IDynTree(model).kinematics.model().getTotalMass(), rel=1e-9)


def test_upright_robots_face_x(model: RobotModel) -> None:
    """With the base upright, hips (or shoulders) lie left and right of the middle: left at +y."""
    data = model.pin_model.createData()
    pin.framesForwardKinematics(model.pin_model, data, model.configuration(model.reference_posture))
    part = "UpperLeg" if "LeftUpperLeg" in model.links else "UpperArm"
    left, right = (
        data.oMf[model.pin_model.getFrameId(model.links[f"{s}{part}"])].translation for s in ("Left", "Right")
    )
    across = left - right
    assert across[1] > 0.1
    assert abs(across[0]) < 1e-3 * across[1]
    assert abs(across[2]) < 1e-3 * across[1]


def test_configuration_puts_joints_behind_the_base(model: RobotModel) -> None:
    joints = np.arange(len(model.joint_names)) / 100
    configuration = model.configuration(joints)
    assert len(configuration) == model.pin_model.nq
    np.testing.assert_array_equal(configuration[-len(joints) :], joints)
    if model.base_is_floating:
        np.testing.assert_allclose(configuration[:3], 0)
        xyzw = np.roll(model.base_rotation, -1)
        np.testing.assert_array_equal(configuration[3:7], xyzw)


def test_the_hash_is_that_of_the_urdf_text(model: RobotModel) -> None:
    import hashlib

    assert model.sha256 == hashlib.sha256(model.urdf.encode("utf-8")).hexdigest()


def test_building_twice_gives_the_same_text() -> None:
    profile = robots.load("icub")
    assert robot_model.build(profile).urdf == robot_model.build(profile).urdf


def test_a_persons_robot_needs_a_person() -> None:
    with pytest.raises(MotionError, match="robot 'human' is built from a recording's segments; give a recording"):
        robot_model.build(robots.load("human"))


def test_a_reference_posture_beyond_the_limits_is_clipped() -> None:
    profile = replace(robots.load("g1"), reference_posture={"left_knee_joint": -3.0})
    model = robot_model.build(profile)
    assert model.reference_posture[model.joint_index("left_knee_joint")] == pytest.approx(-0.087267)


def test_a_model_without_joints_is_refused(tmp_path: Path) -> None:
    (tmp_path / "stone.urdf").write_text("<robot name='stone'><link name='all'/></robot>")
    (tmp_path / "stone.toml").write_text("[model]\nfile = 'stone.urdf'\n")
    with pytest.raises(ProfileError, match=r"stone\.toml, \[model\]: the model has no joint that moves"):
        robot_model.build(robots.load(str(tmp_path / "stone.toml")))


def test_a_model_that_is_no_tree_is_refused(tmp_path: Path) -> None:
    loose = "<robot name='x'><link name='a'/><link name='b'/></robot>"
    (tmp_path / "loose.urdf").write_text(loose)
    (tmp_path / "loose.toml").write_text("[model]\nfile = 'loose.urdf'\n")
    with pytest.raises(ProfileError, match=r"loose\.toml, \[model\]: pinocchio can't build the model"):
        robot_model.build(robots.load(str(tmp_path / "loose.toml")))
