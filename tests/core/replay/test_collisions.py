"""Overlaps and soles against closed forms, and hands that are put through a torso."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from retarget.core import rotations
from retarget.core.errors import UsageError
from retarget.core.replay.collisions import self_collisions
from retarget.core.replay.model import ReplayModel, build

from tests.core.replay.conftest import RobotFactory, collision, hinge, link

BALL = collision('<sphere radius="0.1"/>')
CHAIN = "".join(link(name, shapes=BALL) for name in "abcd") + "".join(
    hinge(f"{p}{c}", p, c, axis="0 0 1", at="0.3 0 0") for p, c in ("ab", "bc", "cd")
)


def ends_apart(joints: np.ndarray) -> np.ndarray:
    """Distance of the first and last ball of CHAIN, (T,) m, joints (T, 3) rad: three rods of 0.3 m in a plane."""
    turned = np.cumsum(np.concatenate([np.zeros((len(joints), 1)), joints[:, :2]], axis=1), axis=1)
    return np.asarray(0.3 * np.hypot(np.cos(turned).sum(axis=1), np.sin(turned).sum(axis=1)))


@pytest.mark.parametrize("base", ["fixed", "floating"])
def test_depth_is_that_of_two_balls(robot_from: RobotFactory, tmp_path: Path, base: str) -> None:
    replay = build(robot_from(CHAIN, base=base), base=base, self_collision=True, cache=tmp_path)  # type: ignore[arg-type]
    joints = np.stack([np.linspace(0, 2.4, 50), np.linspace(0, 2.4, 50), np.zeros(50)], axis=1)
    turn = rotations.exp(np.tile([0.3, 0.2, 0.1], (50, 1)))
    found = self_collisions(replay, joints, turn, np.tile([1.0, 2.0, 3.0], (50, 1)))
    depth = np.maximum(0.0, 0.2 - ends_apart(joints))
    assert 0 < np.count_nonzero(depth) < 50
    np.testing.assert_allclose(found.depth_m, depth, atol=1e-12)
    touching = depth > 0
    assert (found.pair[~touching] == -1).all()
    assert {tuple(found.links[i] for i in pair) for pair in found.pair[touching]} == {("a", "d")}
    deepest, frame, frames = found.by_pair()["a", "d"]
    assert deepest == pytest.approx(depth.max())
    assert (frame, frames) == (int(np.argmax(depth)), int(touching.sum()))


def test_hands_through_the_torso_are_seen_and_named(replayed: Callable[..., ReplayModel]) -> None:
    replay = replayed("g1")
    names = replay.robot.joint_names
    joints = np.tile(replay.robot.reference_posture, (3, 1))
    joints[1, names.index("left_shoulder_roll_joint")] = 0.0
    joints[1, names.index("left_shoulder_yaw_joint")] = -1.5
    joints[1, names.index("left_elbow_joint")] = 0.0
    found = self_collisions(replay, joints)
    assert found.depth_m[0] == found.depth_m[2] == 0.0
    assert found.depth_m[1] > 0.03
    (pair, _) = max(found.by_pair().items(), key=lambda item: item[1][0])
    assert "torso_link" in pair
    assert any(name.startswith("left_") for name in pair)


def test_a_robot_without_shapes_judges_nothing(replayed: Callable[..., ReplayModel]) -> None:
    replay = replayed("human")
    found = self_collisions(replay, np.zeros((4, len(replay.robot.joint_names))))
    assert found.links == ()
    assert not found.depth_m.any()
    assert found.by_pair() == {}


def test_a_model_without_self_collision_is_refused(robot_from: RobotFactory, tmp_path: Path) -> None:
    replay = build(robot_from(CHAIN), base="fixed", cache=tmp_path)
    with pytest.raises(UsageError, match="without self_collision"):
        self_collisions(replay, np.zeros((1, 3)))
