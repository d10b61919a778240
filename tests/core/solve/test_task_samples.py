"""Targets between frames: SciPy's slerp, straight lines, and the values themselves on the frames."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from retarget.core import rotations
from retarget.core.robot_model import RobotModel
from retarget.core.solve.task_samples import TaskSamples
from retarget.core.types import Task
from scipy.spatial.transform import Rotation, Slerp


def test_between_frames(model: Callable[[str], RobotModel]) -> None:
    robot, rng = model("talos"), np.random.default_rng(0)
    hand, arm = robot.links["LeftHand"], robot.links["RightUpperArm"]
    turns = Rotation.from_rotvec(rng.normal(0, 0.5, (3, 3)))
    value = np.roll(turns.as_quat(), 1, axis=1)
    value[1] *= -1.0  # the same rotation: the way there must not go round the long side
    points, rates = rng.normal(size=(3, 3)), rng.normal(size=(3, 3))
    axis = np.array([[1.0, 0, 0], [np.cos(0.1), np.sin(0.1), 0], [0, 0, 1.0]])
    tasks = (
        Task(hand, "position", points, rates),
        Task(arm, "axis", axis),
        Task(hand, "orientation", rotations.make_continuous(value), rates),
    )
    samples = TaskSamples(tasks, robot)
    found, share = samples.between(0, 4), np.arange(4) / 4
    placement = robot.link_in_joint(hand)[1]
    expected = Slerp([0, 1], turns[:2])(share).as_matrix() @ placement.T
    np.testing.assert_allclose(found.orientation[:, 0], expected, atol=1e-12)
    np.testing.assert_allclose(found.position[:, 0], points[0] + share[:, None] * (points[1] - points[0]))
    np.testing.assert_allclose(found.position_rate[:, 0], rates[0] + share[:, None] * (rates[1] - rates[0]))
    np.testing.assert_array_equal(found.axis_rate, np.zeros((4, 1, 3)))
    np.testing.assert_allclose(np.linalg.norm(found.axis[:, 0], axis=1), 1.0)
    np.testing.assert_allclose(found.axis[2, 0], [np.cos(0.05), np.sin(0.05), 0.0], atol=1e-12)
    for name in ("orientation", "axis", "position", "position_rate"):
        np.testing.assert_allclose(getattr(samples.at(1), name), getattr(samples.between(1, 5)[0], name), atol=1e-15)
    assert not samples.at(1).standing().position_rate.any()


def test_opposite_axes_hold_until_the_next_frame(model: Callable[[str], RobotModel]) -> None:
    robot = model("talos")
    task = Task(robot.links["LeftHand"], "axis", np.array([[1.0, 0, 0], [-1.0, 0, 0]]))
    found = TaskSamples((task,), robot).between(0, 2).axis
    np.testing.assert_array_equal(found[:, 0], [[1.0, 0, 0], [1.0, 0, 0]])
