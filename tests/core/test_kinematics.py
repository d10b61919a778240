"""Batch kinematics against pinocchio, one frame at a time."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from retarget import formats, robots, samples
from retarget.core import kinematics, robot_model, rotations
from retarget.core.kinematics import Poses, axis_frames, link_poses
from retarget.core.profile import ModelSource, RobotProfile
from retarget.core.robot_model import RobotModel
from retarget.core.types import Array

SLIDING = """<robot name="arm"><link name="base"/><link name="a"/><link name="b"/><link name="tip"/>
<joint name="first" type="revolute"><parent link="base"/><child link="a"/><origin xyz="0 0 0.3" rpy="0 0.4 0"/><axis xyz="0 0.6 0.8"/>
<limit lower="-2" upper="2" velocity="3" effort="1"/></joint>
<joint name="slide" type="prismatic"><parent link="a"/><child link="b"/><origin xyz="0.1 0 0" rpy="0.2 0 0.5"/><axis xyz="0.6 0 -0.8"/>
<limit lower="-0.5" upper="0.5" velocity="1" effort="1"/></joint>
<joint name="last" type="revolute"><parent link="b"/><child link="tip"/><origin xyz="0.2 0 0" rpy="0.3 0.2 0.1"/>
<axis xyz="0 -1 0"/><limit lower="-2" upper="2" velocity="3" effort="1"/></joint></robot>"""


@cache
def model(name: str) -> RobotModel:
    return robot_model.build(robots.load(name), formats.read_motion(samples.sample_path("walk")))


def random_motion(robot: RobotModel, frames: int) -> tuple[Array, Array, Array]:
    rng = np.random.default_rng(frames)
    joints = rng.uniform(np.maximum(robot.lower, -2.0), np.minimum(robot.upper, 2.0), (frames, len(robot.lower)))
    return joints, rotations.normalize(rng.normal(size=(frames, 4))), rng.normal(size=(frames, 3))


def assert_as_pinocchio(
    robot: RobotModel, links: list[str], motion: tuple[Array, Array, Array], found: tuple[Array, Array]
) -> None:
    data = robot.pin_model.createData()
    for k, (joints, orientation, position) in enumerate(zip(*motion, strict=True)):
        pin.framesForwardKinematics(robot.pin_model, data, robot.configuration(joints, orientation, position))
        for i, link in enumerate(links):
            placement = data.oMf[robot.pin_model.getFrameId(link)]
            np.testing.assert_allclose(found[0][k, i], placement.rotation, atol=1e-12)
            np.testing.assert_allclose(found[1][k, i], placement.translation, atol=1e-12)


@pytest.mark.parametrize("name", robots.names())
def test_every_link_of_every_robot(name: str) -> None:
    robot = model(name)
    links = [str(frame.name) for frame in robot.pin_model.frames if str(frame.type) == "BODY"]
    motion = random_motion(robot, 20)
    found = link_poses(robot, links, *motion) if robot.base_is_floating else link_poses(robot, links, motion[0])
    assert_as_pinocchio(robot, links, motion, found)


def test_without_a_base_pose_it_stands_upright_at_the_origin() -> None:
    robot = model("icub")
    joints = random_motion(robot, 3)[0]
    upright = np.tile(robot.base_rotation, (3, 1))
    found = link_poses(robot, ["head", "l_foot"], joints)
    assert_as_pinocchio(robot, ["head", "l_foot"], (joints, upright, np.zeros((3, 3))), found)


@pytest.mark.parametrize("frames", [1, 6, 7, 8, 20])
def test_chunks_leave_no_seam(frames: int, monkeypatch: pytest.MonkeyPatch) -> None:
    robot = model("g1")
    motion = random_motion(robot, frames)
    monkeypatch.setattr(kinematics, "CHUNK", 7)
    found = link_poses(robot, ["torso_link", "left_knee_link"], *motion)
    assert_as_pinocchio(robot, ["torso_link", "left_knee_link"], motion, found)


def test_joints_that_slide_and_crooked_axes(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(SLIDING, encoding="utf-8")
    profile = RobotProfile("arm", "test", ModelSource("file", str(tmp_path / "arm.urdf")), "fixed", links={})
    robot = robot_model.build(profile)
    motion = random_motion(robot, 10)
    links = ["base", "a", "b", "tip"]
    assert_as_pinocchio(robot, links, motion, link_poses(robot, links, motion[0]))
    slide = [frame.sliding for frame in axis_frames(robot).values()]
    assert slide == [False, True, False]


@pytest.mark.parametrize("name", robots.names())
def test_axis_frames_have_the_joints_axis_as_z(name: str) -> None:
    robot = model(name)
    data = robot.pin_model.createData()
    pin.computeJointJacobians(robot.pin_model, data, pin.neutral(robot.pin_model))
    frames = axis_frames(robot)
    assert [frame.column for frame in frames.values()] == list(range(len(robot.joint_names)))
    for joint, frame in frames.items():
        np.testing.assert_allclose(frame.axes @ frame.axes.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(frame.axes) == pytest.approx(1.0)
        world = data.J[3:, robot.pin_model.joints[joint].idx_v]
        np.testing.assert_allclose(data.oMi[joint].rotation @ frame.axes[:, 2], world, atol=1e-12)


def test_poses_give_links_by_name() -> None:
    robot = model("g1")
    motion = random_motion(robot, 4)
    names = ["torso_link", "pelvis", "torso_link", "left_knee_link"]
    poses = Poses.of(robot, names, *motion)
    assert poses.links == ("torso_link", "pelvis", "left_knee_link")
    rotation, origin = link_poses(robot, names, *motion)
    np.testing.assert_array_equal(poses.rotations_of(names), rotation)
    np.testing.assert_array_equal(poses.at("left_knee_link")[1], origin[:, 3])
