"""Which joints move, how tasks group into levels, what each level weighs, where hands are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from retarget.core.errors import ProfileError, SolverError
from retarget.core.profile import Arm, Hierarchy, Level
from retarget.core.robot_model import RobotModel
from retarget.core.solve.priorities import hand_points, moving_columns, narrowed, priorities, sorted_tasks
from retarget.core.types import Targets, Task

UPRIGHT = np.array([[1.0, 0.0, 0.0, 0.0]])


def with_hierarchy(robot: RobotModel, hierarchy: Hierarchy) -> RobotModel:
    return replace(robot, profile=replace(robot.profile, hierarchy=hierarchy))


def targets(*tasks: Task) -> Targets:
    return Targets(np.zeros(1), tasks, "test")


def turn(robot: RobotModel, segment: str, level: int = 0) -> Task:
    return Task(robot.links[segment], "orientation", UPRIGHT, level=level)


def test_joints_between_base_and_tasks_move(model: Callable[[str], RobotModel]) -> None:
    robot = model("talos")
    moving = moving_columns(targets(turn(robot, "LeftHand"), turn(robot, "Head")), robot)
    names = [robot.joint_names[i] for i in moving]
    assert names == [
        *(f"torso_{i}_joint" for i in (1, 2)),
        *(f"arm_left_{i}_joint" for i in range(1, 8)),
        *(f"head_{i}_joint" for i in (1, 2)),
    ]


def test_the_profile_says_who_moves(model: Callable[[str], RobotModel]) -> None:
    robot = with_hierarchy(model("talos"), Hierarchy(joints=("arm_left_*", "torso_1_joint")))
    moving = moving_columns(targets(turn(robot, "LeftHand")), robot)
    assert len(moving) == 8
    with pytest.raises(SolverError, match=r"no joint fits 'torso_9_joint'; did you mean torso_"):
        moving_columns(
            targets(turn(robot, "LeftHand")), with_hierarchy(robot, Hierarchy(joints=("arm_*", "torso_9_joint")))
        )


def test_tasks_out_of_reach_take_part_in_nothing(model: Callable[[str], RobotModel]) -> None:
    robot = with_hierarchy(model("talos"), Hierarchy(joints=("arm_left_*",)))
    wanted = targets(turn(robot, "Pelvis"), turn(robot, "LeftHand", 2), turn(robot, "Head", 1))
    assert [task.frame for task in sorted_tasks(wanted, robot, moving_columns(wanted, robot))] == [
        robot.links["LeftHand"]
    ]
    with pytest.raises(SolverError, match="mapping 'test' gives robot 'talos' no task that a joint of its hierarchy"):
        moving_columns(targets(turn(robot, "Pelvis"), turn(robot, "Head")), robot)


def test_unknown_frame(model: Callable[[str], RobotModel]) -> None:
    with pytest.raises(SolverError, match=r"robot 'talos' has no frame 'head_2_lnk'; did you mean head_2_link"):
        moving_columns(targets(Task("head_2_lnk", "orientation", UPRIGHT)), model("talos"))


def test_levels(model: Callable[[str], RobotModel]) -> None:
    """Numbers may have gaps; the profile's weights count, and the paper's (chest, hands, upper arms, shoulders) where it has none."""
    robot = model("talos")
    tasks = tuple(turn(robot, "LeftHand", level) for level in (0, 0, 1, 2, 3, 7))
    found = priorities(tasks, robot)
    assert [(p.number, p.tasks, p.weight, p.acceleration_s2) for p in found] == [
        (0, slice(0, 2), 50.0, 0.0),
        (1, slice(2, 3), 50.0, 0.0),
        (2, slice(3, 4), 5.0, 4e-5),
        (3, slice(4, 5), 5.0, 4e-5),
        (7, slice(5, 6), 5.0, 4e-5),
    ]
    own = with_hierarchy(robot, Hierarchy(levels=(Level((), 9.0), Level((), 3.0, 1e-4))))
    assert [(p.weight, p.acceleration_s2) for p in priorities(tasks[:4], own)] == [(9.0, 0.0), (3.0, 1e-4), (5.0, 4e-5)]


def test_hands_are_the_profiles_arms_and_what_position_tasks_lead(model: Callable[[str], RobotModel]) -> None:
    robot = model("talos")
    left, right = robot.links["LeftHand"], robot.links["RightHand"]
    arm = Arm("torso_2_link", (0.0, 0.2, 0.3), left, (0.0, 0.0, -0.1))
    robot = replace(robot, profile=replace(robot.profile, arms={"Left": arm}))
    tasks = (
        Task(left, "position", np.zeros((1, 3)), offset=np.array([0.0, 0.0, -0.1])),
        Task(right, "position", np.zeros((1, 3))),
        turn(robot, "Head"),
    )
    assert hand_points(tasks, robot) == ((left, (0.0, 0.0, -0.1)), (right, (0.0, 0.0, 0.0)))


def test_narrowed_limits_hold_the_reference_posture_too(model: Callable[[str], RobotModel]) -> None:
    """G1's elbow, straight at 1.5708 rad, must not bend backward where only the hand is told where to go."""
    g1 = model("g1")
    elbows = [g1.joint_index(f"{side}_elbow_joint") for side in ("left", "right")]
    assert (g1.upper[elbows] > 2.0).all()
    found = narrowed(g1)
    assert (found.upper[elbows] == 1.55).all()
    assert (found.reference_posture[elbows] == 1.55).all()
    others = [i for i in range(len(g1.joint_names)) if i not in elbows]
    np.testing.assert_array_equal(found.upper[others], g1.upper[others])
    np.testing.assert_array_equal(found.lower, g1.lower)
    assert narrowed(model("icub")) is model("icub")


def test_limits_that_leave_nothing(model: Callable[[str], RobotModel]) -> None:
    g1 = model("g1")
    profile = replace(g1.profile, hierarchy=replace(g1.profile.hierarchy, upper={"left_elbow_joint": -3.0}))
    with pytest.raises(ProfileError, match=r"left_elbow_joint would have to stay above .* below -3 rad"):
        narrowed(replace(g1, profile=profile))
