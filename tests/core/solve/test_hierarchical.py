"""Whole clips by strict priorities: limits on what is written, tracking, the first frame, other mappings' targets, failures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import daqp
import numpy as np
import pinocchio as pin
import pytest
from retarget.core import mapping, rotations, timebase
from retarget.core.errors import SolverError
from retarget.core.kinematics import link_poses, position_errors
from retarget.core.mapping.heading import without_heading
from retarget.core.profile import Hierarchy
from retarget.core.robot_model import RobotModel
from retarget.core.solve import hierarchical
from retarget.core.solve.hierarchical import HierarchicalOptions, HierarchicalSolution, HierarchicalSolver, solve
from retarget.core.solve.problem import coupled_rows
from retarget.core.types import FRAME_MARKED, Array, HumanMotion, Targets, Task
from scipy.spatial.transform import Rotation

from tests.core.solve.hierarchies import HAND_OFFSET, ROBOTS, paper_targets, upper_body_motion

FRAMES, RATE_HZ = 40, 60.0


@pytest.fixture(scope="module")
def wild(model: Callable[[str], RobotModel]) -> Callable[[str], tuple[Targets, HierarchicalSolution]]:
    """Targets beyond what joints and hands may, with the answer."""

    @cache
    def make(name: str) -> tuple[Targets, HierarchicalSolution]:
        robot = model(name)
        targets = paper_targets(robot, upper_body_motion(robot, FRAMES, reach=2.5), RATE_HZ, turned=0.3)
        return targets, solve(targets, robot, HierarchicalOptions(first_steps=300))

    return make


@pytest.mark.parametrize("name", [*ROBOTS, "baxter"])
class TestLimitsOnWrittenFrames:
    def test_joints(self, model: Callable, wild: Callable, name: str) -> None:
        robot, (_, solution) = model(name), wild(name)
        assert (solution.joints >= robot.lower).all()
        assert (solution.joints <= robot.upper).all()
        speed = np.abs(np.diff(solution.joints, axis=0)) * RATE_HZ
        assert (speed <= robot.velocity_limit).all()
        assert (speed > 0.9 * robot.velocity_limit).any() or solution.slowed_frames, "nothing here asks for the limits"

    def test_hands(self, model: Callable, wild: Callable, name: str) -> None:
        """Point velocity ±2 m/s, angular ±6 rad/s, on each world axis, between written frames."""
        robot, (targets, solution) = model(name), wild(name)
        for task in targets.tasks:
            if task.kind != "position":
                continue
            rotation, origin = (values[:, 0] for values in link_poses(robot, [task.frame], solution.joints))
            point = origin + rotation @ task.offset
            assert np.abs(np.diff(point, axis=0)).max() * RATE_HZ <= 2.0
            turns = Rotation.from_matrix(rotation[1:] @ rotation[:-1].transpose(0, 2, 1)).as_rotvec()
            assert np.abs(turns).max() * RATE_HZ <= 6.0
            error = np.linalg.norm(point - task.value, axis=1)
            found = position_errors(robot, targets, solution.joints)
            np.testing.assert_allclose(found[task.segment or task.frame], error, atol=1e-12)

    def test_coupled_joints(self, model: Callable, wild: Callable, name: str) -> None:
        robot, (_, solution) = model(name), wild(name)
        if (rows := coupled_rows(robot)) is None:
            pytest.skip(f"{name} has no coupled joints")
        value = solution.joints @ rows[0].T
        assert (value >= rows[1]).all()
        assert (value <= rows[2]).all()

    def test_no_step_failed_and_what_does_not_move_stays(self, model: Callable, wild: Callable, name: str) -> None:
        robot, (targets, solution) = model(name), wild(name)
        assert solution.failed_levels == 0
        assert not solution.status.any()
        for i, joint in enumerate(robot.joint_names):
            if any(part in joint.lower() for part in ("leg", "hip", "knee", "ankle")):
                np.testing.assert_array_equal(solution.joints[:, i], robot.reference_posture[i])
        assert solution.control_steps == (FRAMES - 1) * 17  # 1/60 s in steps of at most 1 ms
        assert solution.levels == tuple(sorted({task.level for task in targets.tasks}))
        assert solution.level_residual.shape == (FRAMES, len(solution.levels))


@pytest.mark.parametrize("name", ROBOTS)
def test_what_can_be_reached_is_tracked(model: Callable[[str], RobotModel], name: str) -> None:
    """Hands within 2 mm and 0.5° of targets that the robot can meet, from the first frame on; the chest within 0.5°."""
    robot = model(name)
    targets = paper_targets(robot, upper_body_motion(robot, FRAMES), RATE_HZ)
    solution = solve(targets, robot, HierarchicalOptions())
    assert solution.unconverged == 0
    for task in targets.tasks:
        rotation, origin = (values[:, 0] for values in link_poses(robot, [task.frame], solution.joints))
        if task.kind == "position":
            error = np.linalg.norm(origin + rotation @ HAND_OFFSET - task.value, axis=1)
            assert error[0] < 1e-4
            assert error.max() < 2e-3
        elif task.kind == "orientation":
            assert np.degrees(rotations.angle(rotations.from_matrix(rotation), task.value)).max() < 0.5
    assert len(solution.levels_without_freedom) == 4
    assert solution.levels_without_freedom[:2] == (0, 0)


def test_the_first_frame_holds_still(model: Callable[[str], RobotModel]) -> None:
    """Constant targets: the first frame is the answer, and nothing moves after it."""
    robot = model("talos")
    still = np.repeat(upper_body_motion(robot, 1), 20, axis=0)
    targets = paper_targets(robot, still, RATE_HZ)
    solution = solve(targets, robot, HierarchicalOptions())
    assert np.abs(np.diff(solution.joints, axis=0)).max() < 2e-4
    assert max(error.max() for error in position_errors(robot, targets, solution.joints).values()) < 1e-4


def test_feed_forward_removes_the_lag(model: Callable[[str], RobotModel]) -> None:
    """A hand target at 0.2 m/s lags by v / gain = 1 mm without feed-forward [Lim2022 table III has it]."""
    robot = model("talos")
    link, time = robot.links["LeftHand"], np.arange(30) / RATE_HZ
    bent = robot.reference_posture.copy()
    bent[robot.joint_index("arm_left_4_joint")] = -1.2
    _, origin = link_poses(robot, [link], bent[None])
    velocity = np.array([0.0, 0.0, 0.2])
    value = origin[0, 0] + time[:, None] * velocity
    last = {}
    for name, feed_forward in (("with", np.tile(velocity, (30, 1))), ("without", None)):
        task = Task(link, "position", value, feed_forward, gain=200.0, level=1)
        targets = Targets(time, (task,))
        solution = solve(targets, robot, HierarchicalOptions())
        last[name] = float(position_errors(robot, targets, solution.joints)[link][-1])
    assert last["with"] < 2e-4
    assert last["without"] == pytest.approx(1e-3, rel=0.2)


def test_control_steps_follow_the_largest_gain(model: Callable[[str], RobotModel]) -> None:
    """A gain of 5,000/s asks for steps of at most 0.2 ms, or it would swing; without any gain it is 100/s."""
    robot = model("talos")
    time = np.arange(2) / 50
    value = np.tile([1.0, 0, 0, 0], (2, 1))

    def steps(gain: float, options: HierarchicalOptions) -> int:
        task = Task(robot.links["LeftHand"], "orientation", value, gain=gain)
        return solve(Targets(time, (task,)), robot, options).control_steps

    assert steps(5000.0, HierarchicalOptions(first_steps=5)) == 100
    assert steps(100.0, HierarchicalOptions(first_steps=5)) == 20
    assert steps(0.0, HierarchicalOptions(control_step_s=1.0, first_steps=5)) == 2


@pytest.mark.parametrize("name", ROBOTS)
def test_compiled_it_is_the_same(model: Callable[[str], RobotModel], name: str) -> None:
    """Whole clips of reachable targets. (Far beyond reach a last bit of the start decides where NumPy's own goes.)"""
    pytest.importorskip("numba", reason="numba is not there for this Python")
    robot = model(name)
    targets = paper_targets(robot, upper_body_motion(robot, FRAMES), RATE_HZ, turned=0.1)
    by_numpy, compiled = (
        solve(targets, robot, HierarchicalOptions(first_steps=300, kernel=kernel)) for kernel in ("numpy", "compiled")
    )
    np.testing.assert_allclose(compiled.joints, by_numpy.joints, atol=1e-8)
    np.testing.assert_allclose(compiled.level_residual, by_numpy.level_residual, atol=1e-5)
    np.testing.assert_array_equal(compiled.iterations, by_numpy.iterations)
    assert compiled.levels_without_freedom == by_numpy.levels_without_freedom
    assert compiled.first_steps == by_numpy.first_steps


def test_the_kernel_goes_by_the_number_of_control_steps(
    model: Callable[[str], RobotModel], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two frames 20 ms apart at steps of 1 ms: 20."""
    pytest.importorskip("numba", reason="numba is not there for this Python")
    robot = model("talos")
    task = Task(robot.links["LeftHand"], "orientation", np.tile([1.0, 0, 0, 0], (2, 1)))
    targets = Targets(np.arange(2) / 50, (task,))
    for steps, kind in ((21, "Freedom"), (20, "CompiledFreedom")):
        monkeypatch.setattr(hierarchical, "COMPILED_STEPS", steps)
        monkeypatch.setattr(hierarchical, "UNKEPT_STEPS", steps)
        assert HierarchicalSolver(targets, robot, HierarchicalOptions()).freedom.__name__ == kind


def test_other_mappings_are_one_level(model: Callable[[str], RobotModel], motion: Callable[[str], HumanMotion]) -> None:
    """The whole-body mapping's orientation targets, twist weights and all, on standing legs that swing."""
    robot = model("g1")
    clip = timebase.cut(motion("walk"), 2.0, 2.25)
    targets = mapping.load("limb_plane").targets(without_heading(clip, robot.profile.base_segment), robot)
    solution = solve(targets, robot, HierarchicalOptions(control_step_s=1 / 100))
    assert solution.levels == (0,)
    assert not solution.status.any()
    errors = []
    for task in targets.tasks:
        if task.frame != robot.links["Pelvis"]:
            rotation, _ = link_poses(robot, [task.frame], solution.joints)
            achieved = np.einsum("tij,j->ti", rotation[:, 0], task.axis)
            errors.append(rotations.vector_angle(achieved, rotations.rotate(task.value, task.axis)))
    assert np.degrees(np.mean(errors)) < 5.0


def test_extra_inertia_slows_a_joint(model: Callable[[str], RobotModel]) -> None:
    """The regularisation ‖q̇‖²_A makes a heavy joint give way to the others."""
    robot = model("talos")
    time, value = np.arange(20) / RATE_HZ, np.tile([1.0, 0, 0, 0], (20, 1))
    start = link_poses(robot, [robot.links["LeftHand"]], robot.reference_posture[None])[0][0, 0]
    value = rotations.multiply(rotations.exp(np.outer(time, [0.0, 0.0, 1.0])), rotations.from_matrix(start))
    targets = Targets(time, (Task(robot.links["LeftHand"], "orientation", value),))
    heavy = Hierarchy(extra_inertia={"torso_*": 100.0})
    moved = {}
    for name, own in (("plain", robot), ("heavy", replace(robot, profile=replace(robot.profile, hierarchy=heavy)))):
        joints = solve(targets, own, HierarchicalOptions()).joints
        moved[name] = float(np.ptp(joints[:, robot.joint_index("torso_1_joint")]))
    assert moved["heavy"] < 0.3 * moved["plain"]


def test_frames_on_which_a_level_fails_are_marked(
    model: Callable[[str], RobotModel], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The levels before it go on being followed."""
    robot = model("talos")
    targets = paper_targets(robot, upper_body_motion(robot, 12), RATE_HZ)
    real, started = daqp.solve, [False]

    def failing(*problem: Array) -> tuple[Array, float, int, dict[str, float]]:
        x, value, flag, info = real(*problem)
        return x, value, (-1 if started[0] and len(problem[1]) < 10 else flag), info

    def progress(done: int, _: int) -> None:
        started[0] = done >= 5

    monkeypatch.setattr("retarget.core.solve.hierarchical.CHUNK", 1)
    monkeypatch.setattr(daqp, "solve", failing)
    solution = solve(targets, robot, HierarchicalOptions(), progress)
    np.testing.assert_array_equal(solution.status, np.where(np.arange(12) < 5, 0, FRAME_MARKED))
    assert solution.failed_levels == 7 * 17
    assert max(error.max() for error in position_errors(robot, targets, solution.joints).values()) < 3e-3


def test_a_first_frame_that_cant_be_solved(model: Callable[[str], RobotModel], monkeypatch: pytest.MonkeyPatch) -> None:
    robot = model("talos")
    monkeypatch.setattr(daqp, "solve", lambda *problem: (np.zeros(len(problem[1])), 0.0, -1, {}))
    with pytest.raises(SolverError, match="the first frame can't be solved for robot 'talos'"):
        solve(paper_targets(robot, upper_body_motion(robot, 1)), robot, HierarchicalOptions())


def test_input_that_is_not_finite(model: Callable[[str], RobotModel]) -> None:
    robot = model("talos")
    speed = robot.velocity_limit.copy()
    speed[3] = np.nan
    targets = paper_targets(robot, upper_body_motion(robot, 1))
    with pytest.raises(SolverError, match=r"'speed limits' holds nan at \(3,\)"):
        solve(targets, replace(robot, velocity_limit=speed), HierarchicalOptions())
    with pytest.raises(SolverError, match="control step of 0 s"):
        HierarchicalOptions(control_step_s=0.0)


def test_progress_and_floating_base(model: Callable[[str], RobotModel]) -> None:
    robot, seen = model("talos"), []
    targets = paper_targets(robot, upper_body_motion(robot, 3), RATE_HZ)
    solution = solve(targets, robot, HierarchicalOptions(), lambda done, all_: seen.append((done, all_)))
    assert seen == [(3, 3)]
    np.testing.assert_array_equal(solution.base_orientation, np.tile(robot.base_rotation, (3, 1)))
    fixed = model("baxter")
    assert (
        solve(paper_targets(fixed, upper_body_motion(fixed, 2)), fixed, HierarchicalOptions()).base_orientation is None
    )


def test_one_frame(model: Callable[[str], RobotModel]) -> None:
    robot = model("talos")
    targets = paper_targets(robot, upper_body_motion(robot, 1))
    solution = solve(targets, robot, HierarchicalOptions())
    data = robot.pin_model.createData()
    pin.framesForwardKinematics(robot.pin_model, data, robot.configuration(solution.joints[0]))
    hand = next(task for task in targets.tasks if task.kind == "position")
    placement = data.oMf[robot.pin_model.getFrameId(hand.frame)]
    np.testing.assert_allclose(placement.act(HAND_OFFSET), hand.value[0], atol=1e-4)
