"""Which pairs of bodies are left out of collisions."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
from retarget.core.replay.model import ReplayModel, build

from tests.core.replay.conftest import RobotFactory, collision, hinge, link

BALL = collision('<sphere radius="0.1"/>')


def chain(names: str, shapes: dict[str, str], step: str = "0.3 0 0") -> str:
    links = "".join(link(name, shapes=shapes.get(name, "")) for name in names)
    return links + "".join(hinge(f"{p}{c}", p, c, at=step) for p, c in pairwise(names))


def pairs(replay: ReplayModel) -> set[frozenset[str]]:
    return {frozenset(pair) for pair in replay.excluded}


def test_two_joints_apart_is_near_and_three_is_not(robot_from: RobotFactory, tmp_path: Path) -> None:
    robot = robot_from(chain("abcde", dict.fromkeys("abcde", BALL)), base="floating")
    replay = build(robot, base="floating", self_collision=True, cache=tmp_path)
    assert pairs(replay) == {frozenset(pair) for pair in ("ab", "bc", "cd", "de", "ac", "bd", "ce")}
    assert replay.touching == ()


def test_links_without_a_shape_add_no_distance(robot_from: RobotFactory, tmp_path: Path) -> None:
    robot = robot_from(chain("abcdefg", dict.fromkeys("adefg", BALL)), base="floating")
    replay = build(robot, base="floating", self_collision=True, cache=tmp_path)
    assert pairs(replay) == {frozenset(pair) for pair in ("ad", "de", "ae", "ef", "df", "fg", "eg")}


def test_a_base_that_stands_still_is_a_neighbour_of_the_world(robot_from: RobotFactory, tmp_path: Path) -> None:
    robot = robot_from(chain("abc", dict.fromkeys("abc", BALL)))
    found = pairs(build(robot, base="fixed", floor=True, cache=tmp_path))
    assert found == {frozenset(pair) for pair in (("a", "b"), ("b", "c"), ("a", "c"), ("world", "a"), ("world", "b"))}


def test_pairs_that_touch_in_the_reference_posture_are_left_out(robot_from: RobotFactory, tmp_path: Path) -> None:
    """Bent by 60° at each joint the last of four links of 0.3 m touches nothing; by 120° it lies on the first."""
    robot = robot_from(
        chain("abcd", dict.fromkeys("abcd", BALL)), reference_posture={"ab": 2.0944, "bc": 2.0944, "cd": 0.0}
    )
    replay = build(robot, base="fixed", self_collision=True, cache=tmp_path)
    assert {frozenset(pair) for pair in replay.touching} == {frozenset("ad")}
    straight = robot_from(chain("abcd", dict.fromkeys("abcd", BALL)), reference_posture={"ab": 1.0472, "bc": 1.0472})
    assert build(straight, base="fixed", self_collision=True, cache=tmp_path).touching == ()


def test_hands_and_hips_and_the_two_legs_are_judged(replayed: Callable[..., ReplayModel]) -> None:
    """What can happen must be seen: iCub's forearm at its hip, which touches where all joints are 0."""
    for name, first, second in (
        ("icub", "l_forearm", "l_hip_2"),
        ("icub", "l_lower_leg", "r_lower_leg"),
        ("g1", "left_wrist_yaw_link", "torso_link"),
        ("g1", "left_ankle_roll_link", "right_ankle_roll_link"),
        ("talos", "arm_left_7_link", "leg_left_3_link"),
        ("baxter", "left_wrist", "right_wrist"),
    ):
        replay = replayed(name)
        assert {first, second} <= set(replay.body_of_link), (first, second)
        assert frozenset((first, second)) not in pairs(replay)


def test_every_kept_pair_is_apart_in_the_reference_posture(replayed: Callable[..., ReplayModel]) -> None:
    import mujoco

    replay = replayed("talos")
    data = mujoco.MjData(replay.mj)
    data.qpos[:] = replay.configuration(replay.robot.reference_posture)
    mujoco.mj_kinematics(replay.mj, data)
    left_out = {tuple(sorted((replay.mj.body(a).id, replay.mj.body(b).id))) for a, b in replay.excluded}
    segment = np.zeros(6)
    for i in range(replay.mj.ngeom):
        for j in range(i):
            bodies = tuple(sorted((int(replay.mj.geom_bodyid[i]), int(replay.mj.geom_bodyid[j]))))
            if bodies[0] != bodies[1] and bodies not in left_out:
                assert mujoco.mj_geomDistance(replay.mj, data, i, j, 0.01, segment) > 0
