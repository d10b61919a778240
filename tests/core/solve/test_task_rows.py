"""Rows of the three kinds of task against finite differences of pinocchio's kinematics, and commands in closed form."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest
from retarget.core import rotations
from retarget.core.robot_model import RobotModel
from retarget.core.solve.priorities import moving_columns
from retarget.core.solve.task_rows import TaskRows, across, rotation_vector, smallest_turn
from retarget.core.solve.task_samples import TaskSamples
from retarget.core.types import Array, Targets, Task
from scipy.spatial.transform import Rotation

OFFSET = np.array([0.03, -0.05, 0.1])
TILTED = np.array([0.6, 0.0, 0.8])
STEP = 1e-6


def pose(robot: RobotModel, joints: Array, frame: str) -> tuple[Array, Array]:
    """World rotation and origin of `frame`, by pinocchio's own frame placement."""
    data = robot.pin_model.createData()
    pin.framesForwardKinematics(robot.pin_model, data, robot.configuration(joints))
    placement = data.oMf[robot.pin_model.getFrameId(frame)]
    return np.array(placement.rotation), np.array(placement.translation)


def some_posture(robot: RobotModel) -> Array:
    rng = np.random.default_rng(1)
    middle, half = 0.5 * (robot.lower + robot.upper), 0.5 * (robot.upper - robot.lower)
    return middle + np.minimum(half, 1.0) * rng.uniform(-0.8, 0.8, len(middle))


def one_frame(link: str, kind: str, value: Array, **fields: object) -> Task:
    return Task(link, kind, np.asarray(value, float)[None], **fields)  # type: ignore[arg-type]  # parametrised


def tasks_on(robot: RobotModel) -> tuple[Task, ...]:
    """Each kind, twist weights, tilted axes, shifted points; on links that carry placements of their own."""
    hand, arm = robot.links["LeftHand"], robot.links["RightUpperArm"]
    quaternion, up = np.array([1.0, 0, 0, 0]), np.array([0.0, 0.0, 1.0])
    return (
        one_frame(hand, "position", np.zeros(3), offset=OFFSET),
        one_frame(hand, "orientation", quaternion),
        one_frame(arm, "axis", up),
        one_frame(arm, "axis", up, axis=np.array([0.0, 1.0, 0.0])),
        one_frame(robot.links["Head" if "Head" in robot.links else "T8"], "axis", up, axis=TILTED),
        one_frame(arm, "orientation", quaternion, axis=TILTED, twist_weight=0.25),
    )


def rows_of(robot: RobotModel, tasks: tuple[Task, ...], joints: Array, gain: float = 100.0) -> TaskRows:
    columns = moving_columns(Targets(np.zeros(1), tasks), robot)
    hand = (robot.links["RightHand"], tuple(OFFSET.tolist()))
    rows = TaskRows(tasks, robot, columns, [hand], np.full(len(tasks), gain))
    rows.linearise(robot.configuration(joints), TaskSamples(tasks, robot).at(0))
    return rows


@pytest.mark.parametrize("name", ["g1", "talos", "icub", "baxter"])
def test_jacobians_are_what_finite_differences_say(model: Callable[[str], RobotModel], name: str) -> None:
    robot = model(name)
    tasks, joints = tasks_on(robot), some_posture(robot)
    rows = rows_of(robot, tasks, joints)
    columns = moving_columns(Targets(np.zeros(1), tasks), robot)
    assert len(columns) < len(robot.joint_names) or name == "baxter"
    right = Task(robot.links["RightHand"], "position", np.zeros((1, 3)), offset=OFFSET)
    for i, column in enumerate(columns):
        plus, minus = joints.copy(), joints.copy()
        plus[column] += STEP
        minus[column] -= STEP

        def rates(task: Task, plus: Array = plus, minus: Array = minus) -> tuple[Array, Array]:
            """Velocity of the task's point and angular velocity of its frame, per unit of joint velocity."""
            (turn_a, at_a), (turn_b, at_b) = pose(robot, minus, task.frame), pose(robot, plus, task.frame)
            linear = (at_b + turn_b @ task.offset - at_a - turn_a @ task.offset) / (2 * STEP)
            return linear, Rotation.from_matrix(turn_b @ turn_a.T).as_rotvec() / (2 * STEP)

        for task, own in zip(tasks, rows.slices, strict=True):
            linear, angular = rates(task)
            turn, _ = pose(robot, joints, task.frame)
            if task.kind == "position":
                expected = linear
            elif task.kind == "axis":
                expected = across(task.axis) @ turn.T @ angular
            else:
                u = turn @ task.axis
                expected = angular - (1 - np.sqrt(task.twist_weight)) * (u @ angular) * u
            np.testing.assert_allclose(rows.jacobian[own, i], expected, atol=2e-8)
        np.testing.assert_allclose(rows.hand_rows[:, i], np.concatenate(rates(right)), atol=2e-8)


@pytest.mark.parametrize("name", ["talos", "baxter"])
def test_inertia_is_pinocchios(model: Callable[[str], RobotModel], name: str) -> None:
    robot = model(name)
    tasks, joints = tasks_on(robot), some_posture(robot)
    data = robot.pin_model.createData()
    whole = np.triu(pin.crba(robot.pin_model, data, robot.configuration(joints)))
    whole = whole + np.triu(whole, 1).T
    own = moving_columns(Targets(np.zeros(1), tasks), robot) + whole.shape[0] - len(robot.joint_names)
    np.testing.assert_allclose(rows_of(robot, tasks, joints).inertia, whole[np.ix_(own, own)], atol=1e-12)


class TestCommands:
    GAIN, RATE = 80.0, np.array([[0.1, -0.2, 0.3]])

    def command(self, robot: RobotModel, task: Task) -> Array:
        rows = rows_of(robot, (task,), some_posture(robot), self.GAIN)
        return rows.command.copy()

    @pytest.mark.parametrize("error", [[0.0, 0.0, 0.0], [0.2, -0.1, 0.4], [0.0, 0.0, 3.1], [0.0, np.pi, 0.0]])
    def test_orientation(self, model: Callable[[str], RobotModel], error: list[float]) -> None:
        """ω* + K log(R_d Rᵀ), by the logarithm up to a half turn, whose sign nobody knows."""
        robot = model("talos")
        link = robot.links["LeftHand"]
        turn, _ = pose(robot, some_posture(robot), link)
        value = rotations.from_matrix(Rotation.from_rotvec(error).as_matrix() @ turn)
        found = self.command(robot, Task(link, "orientation", value[None], self.RATE)) - self.RATE[0]
        expected = self.GAIN * np.array(error)
        np.testing.assert_allclose(found * np.sign(found @ expected or 1.0), expected, atol=1e-6)

    def test_position(self, model: Callable[[str], RobotModel]) -> None:
        robot = model("talos")
        link = robot.links["LeftHand"]
        turn, origin = pose(robot, some_posture(robot), link)
        task = Task(link, "position", (origin + turn @ OFFSET + [0.01, 0.02, -0.03])[None], self.RATE, offset=OFFSET)
        np.testing.assert_allclose(
            self.command(robot, task), self.RATE[0] + self.GAIN * np.array([0.01, 0.02, -0.03]), atol=1e-12
        )

    @pytest.mark.parametrize("axis", [[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0], TILTED.tolist()])
    @pytest.mark.parametrize("angle", [0.0, 0.3, 2.0, np.pi])
    def test_axis(self, model: Callable[[str], RobotModel], axis: list[float], angle: float) -> None:
        """Turned about a direction across the axis by `angle`, the command is that turn, seen in the link, and no more."""
        robot = model("talos")
        link, own = robot.links["LeftHand"], np.array(axis)
        turn, _ = pose(robot, some_posture(robot), link)
        about = turn @ across(own)[0]
        value = Rotation.from_rotvec(angle * about).apply(turn @ own)
        found = self.command(robot, Task(link, "axis", value[None], axis=own))
        if angle < np.pi:
            np.testing.assert_allclose(found, [self.GAIN * angle, 0.0], atol=1e-6)
        else:  # which way round is free
            assert np.linalg.norm(found) == pytest.approx(self.GAIN * np.pi)

    def test_rotation_about_an_aligned_axis_costs_nothing(self, model: Callable[[str], RobotModel]) -> None:
        robot = model("talos")
        link = robot.links["LeftHand"]
        turn, _ = pose(robot, some_posture(robot), link)
        spin = 3.0 * turn[:, 0]
        found = self.command(robot, Task(link, "axis", turn[:, 0][None], spin[None]))
        np.testing.assert_allclose(found, 0.0, atol=1e-9)


def test_across_of_x_are_y_and_z() -> None:
    """The selection matrix of [Lim2022 eq. 13]."""
    np.testing.assert_allclose(across(np.array([1.0, 0.0, 0.0])), [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    for axis in (*np.eye(3), *-np.eye(3), TILTED, np.full(3, -1 / np.sqrt(3))):
        frame = np.concatenate([axis[None], across(axis)])
        np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-15)
        assert np.linalg.det(frame) == pytest.approx(1.0)


def test_logarithms_agree_with_scipy() -> None:
    rng = np.random.default_rng(0)
    axis = rng.normal(size=(400, 3))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    angle = np.concatenate(
        [np.linspace(0, np.pi - 1e-6, 300), np.logspace(-14, -3, 50), np.pi - np.logspace(-9, -1, 50)]
    )
    matrix = Rotation.from_rotvec(angle[:, None] * axis).as_matrix()
    np.testing.assert_allclose(rotation_vector(matrix), Rotation.from_matrix(matrix).as_rotvec(), atol=1e-9)
    start = np.stack([across(u)[0] for u in axis])
    end = np.einsum("kij,kj->ki", matrix, start)
    sure = angle < np.pi - 1e-5  # nearer to a half turn two directions no longer tell the axis to this precision
    np.testing.assert_allclose(smallest_turn(start, end)[sure], (angle[:, None] * axis)[sure], atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(smallest_turn(start, end), axis=1), angle, atol=1e-9)
