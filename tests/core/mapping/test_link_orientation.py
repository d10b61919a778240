"""[Darvish2019 eq. 2] by hand: a person in a posture that the arm can take gives the targets that the arm reaches there."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from retarget.core import rotations
from retarget.core.mapping.link_orientation import targets
from retarget.core.profile import MappingParameters
from retarget.core.segments import SEGMENTS
from retarget.core.types import Array, HumanMotion, Targets, Task

MotionFactory = Callable[..., HumanMotion]
RobotFactory = Callable[..., Any]
X, Y, Z = np.eye(3)


def turn(axis: Array, degrees: float) -> Array:
    return rotations.exp(np.radians(degrees) * axis)


def by_segment(found: Targets) -> dict[str, Task]:
    return {task.segment: task for task in found.tasks}


def link_rotation(model: Any, joints: dict[str, float], link: str) -> Array:
    """Rotation (3, 3) of `link` by pinocchio."""
    q = np.array([joints.get(name, 0.0) for name in model.joint_names])
    data = model.pin_model.createData()
    pin.framesForwardKinematics(model.pin_model, data, model.configuration(q))
    return np.array(data.oMf[model.pin_model.getFrameId(link)].rotation)


POSTURES = {
    # What the person does, segment → world ← segment, and what the arm's joints do for it, by hand.
    "T-pose": ({}, {"shoulder_roll": 90}),
    "hanging": ({"LeftUpperArm": turn(X, -90)}, {}),
    "elbow bent forward in T-pose": ({"LeftForeArm": turn(Z, -70)}, {"shoulder_roll": 90, "elbow": 70}),
    "hanging, elbow bent forward": (
        {"LeftUpperArm": turn(X, -90), "LeftForeArm": rotations.multiply(turn(Y, -50), turn(X, -90))},
        {"elbow": 50},
    ),
    "raised forward": (
        {"LeftUpperArm": rotations.multiply(turn(Y, -90), turn(X, -90))},
        {"shoulder_pitch": -90},
    ),
}


@pytest.mark.parametrize("posture", POSTURES)
def test_the_targets_are_where_the_arm_is_in_the_same_posture(
    arm_robot: RobotFactory, make_motion: MotionFactory, posture: str
) -> None:
    person, joints_deg = POSTURES[posture]
    model = arm_robot()
    joints = {name: float(np.radians(value)) for name, value in joints_deg.items()}
    found = by_segment(targets(make_motion([0.0], person), model))
    assert found.keys() == model.links.keys()
    for segment, task in found.items():
        expected = link_rotation(model, joints, model.links[segment])
        assert np.abs(rotations.to_matrix(task.value[0]) - expected).max() < 1e-15, segment
        assert (task.frame, task.kind) == (model.links[segment], "orientation")
        assert task.weight.tolist() == [1.0]
        assert task.twist_weight == 1


def test_a_person_in_t_pose_gives_every_real_robot_its_own(
    build_robot: Callable[[str], Any], make_motion: MotionFactory
) -> None:
    for name in ("g1", "icub", "talos", "baxter"):
        model = build_robot(name)
        data = model.pin_model.createData()
        pin.framesForwardKinematics(model.pin_model, data, model.configuration(model.reference_posture))
        for task in targets(make_motion([0.0]), model).tasks:
            expected = np.array(data.oMf[model.pin_model.getFrameId(task.frame)].rotation)
            assert np.abs(rotations.to_matrix(task.value[0]) - expected).max() < 1e-12, (name, task.frame)


def test_turning_the_person_turns_the_targets(arm_robot: RobotFactory, wandering: MotionFactory) -> None:
    """R* = R_segment · H: from the left, a turn of the world goes through."""
    motion, model = wandering(seed=1), arm_robot()
    by = turn(Z, 100)
    turned = HumanMotion(
        motion.time,
        motion.segments,
        rotations.make_continuous(rotations.multiply(by, motion.orientation)),
        rotations.rotate(by, motion.position),
    )
    for task, other in zip(targets(motion, model).tasks, targets(turned, model).tasks, strict=True):
        assert rotations.angle(rotations.multiply(by, task.value), other.value).max() < 1e-12


class TestFeedForward:
    def test_the_recordings_own_rates(self, arm_robot: RobotFactory, wandering: MotionFactory) -> None:
        omega = np.random.default_rng(1).normal(size=(120, 23, 3))
        motion = wandering(angular_velocity=omega)
        for task in targets(motion, arm_robot()).tasks:
            assert np.array_equal(task.feed_forward, omega[:, motion.index(task.segment)])  # type: ignore[arg-type]

    def test_differences_where_it_has_none(self, arm_robot: RobotFactory, make_motion: MotionFactory) -> None:
        time, rate = np.arange(50) / 60, np.array([0.5, -1.0, 0.3])
        motion = make_motion(time, {"LeftForeArm": rotations.exp(time[:, None] * rate)})
        found = by_segment(targets(motion, arm_robot()))
        assert found["LeftForeArm"].feed_forward == pytest.approx(np.tile(rate, (50, 1)), abs=1e-12)
        assert found["LeftUpperArm"].feed_forward == pytest.approx(np.zeros((50, 3)))


def test_only_measured_and_mapped_segments(arm_robot: RobotFactory, make_motion: MotionFactory) -> None:
    measured = np.array([name != "LeftForeArm" for name in SEGMENTS])
    found = targets(make_motion([0.0], measured=measured), arm_robot())
    assert [task.segment for task in found.tasks] == ["T8", "LeftUpperArm", "LeftHand"]
    assert found.mapping == "link_orientation"


def test_the_profiles_weights_and_links(arm_robot: RobotFactory, make_motion: MotionFactory) -> None:
    parameters = MappingParameters(weights={"LeftHand": 0.25}, links={"LeftUpperArm": "pitch", "Head": "roll"})
    model = arm_robot(mappings={"link_orientation": parameters})
    found = by_segment(targets(make_motion([0.0, 0.1]), model))
    assert found["LeftHand"].weight.tolist() == [0.25, 0.25]
    assert found["T8"].weight.tolist() == [1, 1]
    assert found["LeftUpperArm"].frame == "pitch"
    assert found["Head"].frame == "roll"
    assert np.abs(rotations.to_matrix(found["Head"].value[0]) - rotations.to_matrix(turn(X, 90))).max() < 1e-15
