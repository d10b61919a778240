"""Stick figures: the person's against the segment tree, the robot's against pinocchio."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from retarget.core import rotations
from retarget.core.segments import PARENT, SEGMENTS
from retarget.core.stick_figure import human_figure, robot_figure
from retarget.core.types import HumanMotion, JointTrajectory

MotionFactory = Callable[..., HumanMotion]


class TestHuman:
    def test_bones_join_child_and_parent(self, make_motion: MotionFactory) -> None:
        angle = np.linspace(0, 1, 7)[:, None]
        motion = make_motion(np.arange(7) / 60, {"LeftForeArm": rotations.exp(angle * [0, 0, -1.0])})
        points, bones = human_figure(motion)
        assert np.array_equal(points, motion.position)
        assert {(SEGMENTS[a], SEGMENTS[b]) for a, b in bones} == {(p, c) for c, p in PARENT.items() if p is not None}
        lengths = np.linalg.norm(points[:, bones[:, 0]] - points[:, bones[:, 1]], axis=2)
        assert np.ptp(lengths, axis=0).max() < 1e-15

    def test_a_bone_spans_segments_that_are_not_tracked(self, make_motion: MotionFactory) -> None:
        position = np.array(make_motion(np.arange(2) / 60).position)
        lost = ("Pelvis", "L5", "L3", "LeftHand")
        position[:, [SEGMENTS.index(name) for name in lost]] = np.nan
        motion = make_motion(np.arange(2) / 60, position=position)
        points, bones = human_figure(motion)
        names = [name for name in SEGMENTS if name not in lost]
        assert points.shape == (2, 19, 3)
        assert np.isfinite(points).all()
        joined = {(names[a], names[b]) for a, b in bones}
        assert joined == {(p, c) for c, p in PARENT.items() if p in names and c in names}
        # Nothing is left above T12 and the thighs for them to hang from.
        assert {names[b] for _, b in bones} == set(names) - {"T12", "LeftUpperLeg", "RightUpperLeg"}

    def test_trackers_far_apart_in_the_tree(self, make_motion: MotionFactory) -> None:
        whole = make_motion([0.0])
        names = ("Pelvis", "Head", "LeftHand", "RightFoot")
        columns = [whole.index(name) for name in names]
        motion = HumanMotion([0.0], names, whole.orientation[:, columns], whole.position[:, columns])  # type: ignore[arg-type]
        points, bones = human_figure(motion)
        assert np.array_equal(points, whole.position[:, columns])
        assert bones.tolist() == [[0, 1], [0, 2], [0, 3]]

    def test_one_point_has_no_bone(self) -> None:
        motion = HumanMotion([0.0], ("Head",), [[[1.0, 0, 0, 0]]], np.zeros((1, 1, 3)))  # type: ignore[arg-type]
        points, bones = human_figure(motion)
        assert points.shape == (1, 1, 3)
        assert bones.shape == (0, 2)


@pytest.mark.parametrize("name", ["g1", "icub", "talos", "baxter", "tocabi"])
def test_robot(build_robot: Callable[[str], Any], name: str) -> None:
    """Points are joint origins by pinocchio's own kinematics; every joint's bone leads to its parent joint; soles hang from the ankles."""
    model = build_robot(name)
    pin_model, frames = model.pin_model, 3
    generator = np.random.default_rng(4)
    low, high = np.maximum(model.lower, -2), np.minimum(model.upper, 2)
    joints = generator.uniform(low, high, size=(frames, len(low)))
    base = {}
    if model.base_is_floating:
        turned = rotations.exp(np.linspace(0, 1, frames)[:, None] * generator.normal(size=3))
        base = {"base_position": generator.normal(size=(frames, 3)), "base_orientation": turned}
    trajectory = JointTrajectory(np.arange(frames) / 60, model.joint_names, joints, np.zeros_like(joints), **base)
    points, bones = robot_figure(trajectory, model)

    first = 2 if model.base_is_floating else 1
    movable = list(range(first, pin_model.njoints))
    sole_corners = sum(len(foot.sole) for foot in model.profile.feet.values())
    assert points.shape == (frames, 1 + len(movable) + sole_corners, 3)
    data = pin_model.createData()
    for t in range(frames):
        q = model.configuration(joints[t], *(values[t] for values in reversed(base.values())))
        pin.framesForwardKinematics(pin_model, data, q)
        placed = [data.oMf[pin_model.getFrameId(model.base_link)]] + [data.oMi[i] for i in movable]
        expected = [placement.translation for placement in placed]
        for foot in model.profile.feet.values():
            expected += [data.oMf[pin_model.getFrameId(foot.link)].act(corner) for corner in foot.sole]
        assert np.abs(points[t] - np.array(expected)).max() < 1e-12

    column = {i: 1 + k for k, i in enumerate(movable)}
    joint_bones = {(column.get(int(pin_model.parents[i]), 0), column[i]) for i in movable}
    sole_bones, at = set(), 1 + len(movable)
    for foot in model.profile.feet.values():
        ankle = column[int(pin_model.frames[pin_model.getFrameId(foot.link)].parentJoint)]
        sole_bones |= {(ankle, at + k) for k in range(len(foot.sole))}
        at += len(foot.sole)
    assert {(int(a), int(b)) for a, b in bones} == joint_bones | sole_bones
    assert len(bones) == len(joint_bones) + len(sole_bones)
