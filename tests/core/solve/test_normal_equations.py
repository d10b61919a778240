"""Errors, gradient and Hessian against SciPy's logarithm, finite differences, Jacobians written out and iDynTree's kinematics."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from retarget import robots
from retarget.core import rotations
from retarget.core.robot_model import RobotModel
from retarget.core.solve.normal_equations import NormalEquations, rotation_vector
from retarget.core.solve.problem import OrientationProblem, orientation_problem
from retarget.core.types import Array, Targets, Task
from scipy.spatial.transform import Rotation

ROBOTS = tuple(robots.names())
Models = Callable[[str], RobotModel]
Swinging = Callable[..., Targets]


def random_unit(rng: np.random.Generator, count: int) -> Array:
    vectors = rng.normal(size=(count, 3))
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


class TestRotationVector:
    @pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-8, 1e-4, 0.1, 1.0, 2.5, 3.0, 3.1, np.pi - 1e-3, np.pi - 1e-6])
    def test_is_scipys_logarithm(self, angle: float) -> None:
        for axis in [*np.eye(3), *random_unit(np.random.default_rng(1), 50)]:
            rotation = Rotation.from_rotvec(angle * axis)
            np.testing.assert_allclose(rotation_vector(rotation.as_matrix()), rotation.as_rotvec(), atol=1e-9)

    @pytest.mark.parametrize("short_of", [0.0, 1e-9, 1e-12])
    def test_half_turns_have_an_axis(self, short_of: float) -> None:
        """At 180° either sign is right, so what the vector does is compared."""
        for axis in [*np.eye(3), *random_unit(np.random.default_rng(2), 50)]:
            rotation = Rotation.from_rotvec((np.pi - short_of) * axis).as_matrix()
            found = rotation_vector(rotation)
            assert np.linalg.norm(found) == pytest.approx(np.pi, abs=1e-8)
            np.testing.assert_allclose(Rotation.from_rotvec(found).as_matrix(), rotation, atol=1e-7)


def direction_vector(present: Array, desired: Array) -> Array:
    """The smallest rotation vector (3,) that turns unit vector `present` to `desired`; exactly opposite ones have none: zero."""
    sine_axis = np.cross(present, desired)
    sine = float(np.linalg.norm(sine_axis))
    return np.asarray(sine_axis * (np.arctan2(sine, present @ desired) / sine if sine > 0 else 1.0))


def test_direction_vector_turns_one_onto_the_other_by_the_smallest_angle() -> None:
    rng = np.random.default_rng(3)
    for present, desired in zip(random_unit(rng, 100), random_unit(rng, 100), strict=True):
        turn = direction_vector(present, desired)
        np.testing.assert_allclose(Rotation.from_rotvec(turn).apply(present), desired, atol=1e-12)
        assert np.linalg.norm(turn) == pytest.approx(np.arccos(present @ desired), abs=1e-7)
        assert abs(turn @ present) < 1e-12


def posture(model: RobotModel, seed: int, spread: float = 0.5) -> Array:
    rng = np.random.default_rng(seed)
    joints = np.clip(model.reference_posture + rng.normal(0, spread, len(model.lower)), model.lower, model.upper)
    return model.configuration(joints, rotations.exp(rng.normal(0, 1, 3)) if model.base_is_floating else None)


def world_axes(problem: OrientationProblem, q: Array) -> Array:
    """(3, columns) of pinocchio's Jacobian."""
    data = problem.model.pin_model.createData()
    pin.computeJointJacobians(problem.model.pin_model, data, q)
    return np.array(data.J[3:, -problem.columns :])


def moved(problem: OrientationProblem, q: Array, step: Array) -> Array:
    """Configuration `q` moved by a step of the problem's unknowns."""
    full = np.zeros(problem.model.pin_model.nv)
    full[-problem.columns :] = step
    return np.asarray(pin.integrate(problem.model.pin_model, q, full))


def written_out(
    problem: OrientationProblem, k: int, q: Array
) -> tuple[float, list[tuple[Array, Array, Array, Array, Array]]]:
    """Cost by SciPy, and per link: its rotation error e, its direction error d, its bone, its world angular Jacobian by pinocchio, R."""
    model, first = problem.model.pin_model, problem.model.pin_model.nv - problem.columns
    data = model.createData()
    pin.computeJointJacobians(model, data, q)
    cost, parts = 0.0, []
    for link, joint in enumerate(problem.joint_ids):
        rotation = np.array(data.oMi[int(joint)].rotation)
        e = Rotation.from_matrix(problem.desired[k, link] @ rotation.T).as_rotvec()
        bone = rotation @ problem.bone[link]
        d = direction_vector(bone, problem.desired[k, link] @ problem.bone[link])
        weight, loss = problem.weight[k, link], problem.twist_loss[link]
        cost += 0.5 * weight * ((1 - loss) * e @ e + loss * d @ d)
        jacobian = pin.getJointJacobian(model, data, int(joint), pin.LOCAL_WORLD_ALIGNED)[3:, first:]
        parts.append((e, d, bone, np.array(jacobian), rotation))
    return float(cost), parts


def stacked(
    axes: Array, moves: Array, weight: Array, twist_loss: Array, pivot: Array, pull: Array
) -> tuple[Array, Array]:
    """H = JᵀWJ (c, c) and g = -Jᵀb (c,) from the Jacobians written out, one (3, c) block per link.

    axes (3, c), moves (L, c), weight and twist_loss (L,), pivot (3, L) direction of free twist, pull (3, L) b: world frame.
    """
    columns = axes.shape[1]
    hessian, gradient = np.zeros((columns, columns)), np.zeros(columns)
    for link in range(len(moves)):
        jacobian = axes * moves[link]
        metric = weight[link] * (np.eye(3) - twist_loss[link] * np.outer(pivot[:, link], pivot[:, link]))
        hessian += jacobian.T @ metric @ jacobian
        gradient -= jacobian.T @ pull[:, link]
    return hessian, gradient


@pytest.mark.parametrize("twist_weight", [1.0, 0.3, 0.0])
@pytest.mark.parametrize("robot", ROBOTS)
class TestAgainstJacobiansWrittenOut:
    def test_gram_form_is_the_stacked_form(
        self, robot: str, twist_weight: float, model: Models, swinging: Swinging
    ) -> None:
        """H and g of eq. 5, feed-forward included, from the axes and from one Jacobian per link: to 1e-9."""
        chosen, gain = model(robot), 7.0
        problem = orientation_problem(
            swinging(chosen, 3, twist_weight=twist_weight), chosen, free_base=chosen.base_is_floating
        )
        equations = NormalEquations(problem, np.zeros(problem.columns))
        for seed in range(10):
            q = posture(chosen, seed)
            equations.linearise_velocity(1, q, gain)
            _, parts = written_out(problem, 1, q)
            hessian, gradient = np.zeros((problem.columns,) * 2), np.zeros(problem.columns)
            pulls = np.empty((3, len(parts)))
            for link, (e, d, bone, jacobian, _) in enumerate(parts):
                weight, loss, ahead = problem.weight[1, link], problem.twist_loss[link], problem.feed_forward[1, link]
                across = np.eye(3) - np.outer(bone, bone)
                hessian += weight * jacobian.T @ ((1 - loss) * np.eye(3) + loss * across) @ jacobian
                pulls[:, link] = weight * ((1 - loss) * (gain * e + ahead) + loss * (gain * d + across @ ahead))
                gradient -= jacobian.T @ pulls[:, link]
            np.testing.assert_allclose(equations.hessian, hessian, atol=1e-9)
            np.testing.assert_allclose(equations.gradient, gradient, atol=1e-9)
            bones = np.stack([bone for _, _, bone, _, _ in parts], axis=1)
            shared = stacked(world_axes(problem, q), problem.moves, problem.weight[1], problem.twist_loss, bones, pulls)
            np.testing.assert_allclose(shared[0], hessian, atol=1e-9)
            np.testing.assert_allclose(shared[1], gradient, atol=1e-9)

    def test_cost_and_gradient(self, robot: str, twist_weight: float, model: Models, swinging: Swinging) -> None:
        """The cost by SciPy's logarithm; its gradient by the Jacobians (to 1e-9) and by central differences."""
        chosen = model(robot)
        problem = orientation_problem(
            swinging(chosen, 3, twist_weight=twist_weight), chosen, free_base=chosen.base_is_floating
        )
        equations = NormalEquations(problem, np.zeros(problem.columns))
        for seed in range(5):
            q = posture(chosen, seed)
            cost = equations.linearise(2, q)
            gradient = equations.gradient.copy()
            by_scipy, parts = written_out(problem, 2, q)
            assert cost == pytest.approx(by_scipy, abs=1e-9)
            pulls = [
                problem.weight[2, i] * ((1 - problem.twist_loss[i]) * e + problem.twist_loss[i] * d)
                for i, (e, d, *_) in enumerate(parts)
            ]
            by_jacobians = -sum(parts[i][3].T @ pull for i, pull in enumerate(pulls))
            np.testing.assert_allclose(gradient, by_jacobians, atol=1e-9)
            for column in np.random.default_rng(seed).choice(problem.columns, 6, replace=False):
                step = np.zeros(problem.columns)
                step[column] = 1e-5
                change = written_out(problem, 2, moved(problem, q, step))[0]
                change -= written_out(problem, 2, moved(problem, q, -step))[0]
                assert change / 2e-5 == pytest.approx(gradient[column], abs=2e-8 * (1 + abs(cost)))


@pytest.mark.parametrize("misalignment", [0.01, 0.1, 0.5])
@pytest.mark.parametrize("robot", ROBOTS)
def test_hessian_is_the_costs_second_derivative(
    robot: str, misalignment: float, model: Models, swinging: Swinging
) -> None:
    """Near the targets and far from them, against central differences of the gradient along straight lines from the posture."""
    chosen = model(robot)
    problem = orientation_problem(
        swinging(chosen, 3, twist_weight=0.1, misalignment=misalignment), chosen, free_base=chosen.base_is_floating
    )
    equations, h = NormalEquations(problem, np.zeros(problem.columns)), 1e-3
    q = posture(chosen, 4, spread=misalignment)
    equations.linearise(0, q)
    hessian = equations.hessian.copy()
    largest = float(equations._angle.max())
    rng = np.random.default_rng(5)
    for _ in range(20):
        along = rng.normal(size=problem.columns)
        along *= h / np.linalg.norm(along)
        ahead, here, behind = (equations.linearise(0, moved(problem, q, sign * along)) for sign in (1, 0, -1))
        curvature = (ahead - 2 * here + behind) / h**2
        expected = along @ hessian @ along / h**2
        # Up to SMALL_ANGLE the terms of second order are left out: θ²/12 of a Hessian whose entries are sums of weights.
        left_out = problem.weight[0].sum() * largest**2 / 12 if largest <= 0.1 else 0.0
        assert curvature == pytest.approx(expected, abs=2e-5 * (1 + abs(expected)) + left_out)


@pytest.mark.parametrize("robot", ["g1", "icub", "talos", "baxter", "tocabi"])
def test_idyntrees_kinematics_give_the_same_equations(robot: str, model: Models, swinging: Swinging) -> None:
    """An independent library's link rotations and free-floating Jacobians, in the stacked form, to 1e-9."""
    bindings = pytest.importorskip("idyntree.bindings", reason="idyntree is not installed")
    chosen = model(robot)
    targets = swinging(chosen, 3)
    problem = orientation_problem(targets, chosen, free_base=chosen.base_is_floating)
    equations = NormalEquations(problem, np.zeros(problem.columns))
    loader, kinematics = bindings.ModelLoader(), bindings.KinDynComputations()
    assert loader.loadReducedModelFromString(chosen.urdf, list(chosen.joint_names))
    kinematics.loadRobotModel(loader.model())
    assert kinematics.setFloatingBase(chosen.base_link)
    kinematics.setFrameVelocityRepresentation(bindings.MIXED_REPRESENTATION)
    n = len(chosen.joint_names)
    for seed in range(5):
        q = posture(chosen, seed)
        base = np.eye(4)
        if chosen.base_is_floating:
            base[:3, :3] = Rotation.from_quat(q[3:7]).as_matrix()
        assert kinematics.setRobotState(base, q[-n:], np.zeros(6), np.zeros(n), np.array([0.0, 0.0, -9.81]))
        hessian, gradient = np.zeros((problem.columns,) * 2), np.zeros(problem.columns)
        for task in targets.tasks:
            matrix = bindings.MatrixDynSize(6, 6 + n)
            assert kinematics.getFrameFreeFloatingJacobian(task.frame, matrix)
            angular = matrix.toNumPy()[3:]
            # iDynTree's base angular velocity is in the world frame, pinocchio's in the base's own.
            columns = [angular[:, 3:6] @ base[:3, :3]] if problem.base_columns else []
            jacobian = np.hstack([*columns, angular[:, 6:]])
            rotation = kinematics.getWorldTransform(task.frame).asHomogeneousTransform().toNumPy()[:3, :3]
            desired = rotations.to_matrix(task.value[1])
            assert task.feed_forward is not None
            pull = 10.0 * Rotation.from_matrix(desired @ rotation.T).as_rotvec() + task.feed_forward[1]
            hessian += task.weight[1] * jacobian.T @ jacobian
            gradient -= task.weight[1] * jacobian.T @ pull
        equations.linearise_velocity(1, q, 10.0)
        np.testing.assert_allclose(equations.hessian, hessian, atol=1e-9)
        np.testing.assert_allclose(equations.gradient, gradient, atol=1e-9)


def test_stacked_oracle_is_least_squares() -> None:
    """The oracle itself, against the normal equations of the rows written out by hand."""
    rng = np.random.default_rng(0)
    axes, moves = rng.normal(size=(3, 4)), np.array([[1.0, 1, 0, 0], [1, 0, 1, 1]])
    weight, pull = np.array([2.0, 0.5]), rng.normal(size=(3, 2))
    rows = np.vstack([np.sqrt(w) * axes * m for w, m in zip(weight, moves, strict=True)])
    hessian, gradient = stacked(axes, moves, weight, np.zeros(2), np.zeros((3, 2)), pull)
    np.testing.assert_allclose(hessian, rows.T @ rows, atol=1e-12)
    expected = -sum((axes * m).T @ pull[:, i] for i, m in enumerate(moves))
    np.testing.assert_allclose(gradient, expected, atol=1e-12)


class TestHalfTurns:
    @pytest.mark.parametrize("twist_weight", [1.0, 0.0])
    def test_a_link_that_faces_away_is_pulled_around(self, twist_weight: float, model: Models) -> None:
        """At exactly 180° the error's sine vanishes: the gradient must still be π times the weight about some axis."""
        g1 = model("g1")
        axis = np.array([0.0, 1.0, 0.0])
        for about in np.eye(3):
            value = rotations.multiply(rotations.exp(np.pi * about), g1.base_rotation)[None]
            task = Task("pelvis", "orientation", value, weight=np.asarray(0.7), twist_weight=twist_weight, axis=axis)
            problem = orientation_problem(Targets(np.zeros(1), (task,)), g1, free_base=True)
            equations = NormalEquations(problem, np.zeros(problem.columns))
            cost = equations.linearise(0, g1.configuration(g1.reference_posture))
            pulls = twist_weight == 1.0 or abs(about @ axis) < 0.5
            assert cost == pytest.approx(0.5 * 0.7 * np.pi**2 if pulls else 0.0, abs=1e-9)
            assert np.linalg.norm(equations.gradient[:3]) == pytest.approx(0.7 * np.pi if pulls else 0.0, abs=1e-6)
            if twist_weight == 1.0:
                assert abs(equations.gradient[:3] @ about) == pytest.approx(0.7 * np.pi, abs=1e-6)


def test_weights_may_change_from_frame_to_frame(model: Models, swinging: Swinging) -> None:
    g1 = model("g1")
    targets = swinging(g1, 4, twist_weight=0.2)
    rng = np.random.default_rng(0)
    tasks = tuple(replace(task, weight=rng.uniform(0.1, 1.0, 4)) for task in targets.tasks)
    problem = orientation_problem(replace(targets, tasks=tasks), g1, free_base=True)
    equations, q = NormalEquations(problem, np.zeros(problem.columns)), posture(g1, 0)
    for k in (2, 0, 3, 1):
        assert equations.linearise(k, q) == pytest.approx(written_out(problem, k, q)[0], abs=1e-9)
        alone = replace(problem, weight=np.tile(problem.weight[k], (4, 1)))
        again = NormalEquations(alone, np.zeros(problem.columns))
        again.linearise(k, q)
        np.testing.assert_allclose(equations.hessian, again.hessian, atol=1e-12)


def test_sliding_joints_turn_nothing(sliding_arm: RobotModel) -> None:
    """The diagonal's weight, and nothing else, stands at a sliding joint's place."""
    value = rotations.exp(np.array([[0.1, 0.2, 0.3]]))
    problem = orientation_problem(
        Targets(np.zeros(1), (Task("tip", "orientation", value),)), sliding_arm, free_base=False
    )
    equations = NormalEquations(problem, np.array([0.25, 0.25, 0.25]))
    equations.linearise(0, np.array([0.3, 0.1, -0.2]))
    slide = sliding_arm.joint_index("slide")
    assert equations.hessian[slide, slide] == 0.25
    assert not np.delete(equations.hessian[slide], slide).any()
    assert equations.gradient[slide] == 0.0
