"""What a motion asks of the motors, against the two-link arm by hand and pinocchio's inverse dynamics."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from retarget.core.replay.fixed import FixedOptions, replay
from retarget.core.replay.model import build
from retarget.core.replay.reference import Reference
from retarget.core.replay.reference_torque import EVERY_STEPS, ReferenceTorque
from retarget.core.robot_model import RobotModel
from retarget.core.types import Array, JointTrajectory

from tests.core.replay.plane_arms import arm, gravity_torque, moving, moving_torque

RATE = 2000.0


def sines(time: Array) -> Array:
    return np.stack([0.9 * np.sin(3 * time), 0.5 * np.sin(5 * time + 0.7)], axis=1)


def sines_torque(time: Array, armature: Array) -> Array:
    """(T, 2) Nm, by hand."""
    velocity = np.stack([2.7 * np.cos(3 * time), 2.5 * np.cos(5 * time + 0.7)], axis=1)
    acceleration = np.stack([-8.1 * np.sin(3 * time), -12.5 * np.sin(5 * time + 0.7)], axis=1)
    position = sines(time)
    return gravity_torque(position) + moving_torque(position, velocity, acceleration, armature)


def test_it_is_the_arms_textbook_torque(tmp_path: Path) -> None:
    model = arm(tmp_path, 2, effort=20.0)
    found = ReferenceTorque.of(Reference.of(moving(model, sines, 3.0, 500), model.robot, RATE), model)
    time = np.arange(0, 3.0, EVERY_STEPS / RATE)
    torque = np.abs(sines_torque(time, model.armature))
    np.testing.assert_allclose(found.peak, torque.max(axis=0), rtol=1e-3)
    np.testing.assert_allclose(found.ratio, torque.max(axis=0) / 20.0, rtol=1e-3)
    np.testing.assert_allclose(found.time_s, time[torque.argmax(axis=0)], atol=0.005)
    np.testing.assert_allclose(found.over_percent, 100 * (torque > 20).mean(axis=0), atol=0.2)
    assert found.any_over_percent == pytest.approx(100 * (torque > 20).any(axis=1).mean(), abs=0.2)


def test_holding_still_takes_the_weight_and_no_friction(tmp_path: Path) -> None:
    model, posture = arm(tmp_path, 2, friction=3.0, damping=1.0), np.array([0.7, -1.9])
    motion = moving(model, lambda t: np.tile(posture, (len(t), 1)), 0.5, 50)
    found = ReferenceTorque.of(Reference.of(motion, model.robot, RATE), model)
    np.testing.assert_allclose(found.peak, np.abs(gravity_torque(posture)), rtol=1e-9)


def test_moving_on_takes_friction_and_damping_too(tmp_path: Path) -> None:
    """At constant speed through the lowest point nothing but them is left."""
    model = arm(tmp_path, 1, friction=3.0, damping=2.0)
    motion = moving(model, lambda t: 0.5 * t, 0.004, 1000)
    found = ReferenceTorque.of(Reference.of(motion, model.robot, RATE), model)
    assert found.peak[0] == pytest.approx(3.0 + 2.0 * 0.5, rel=0.01)


def test_it_is_pinocchios_inverse_dynamics(walking: tuple[JointTrajectory, RobotModel]) -> None:
    """G1, whose inertias are taken as they are; pinocchio knows no armature, which is added by hand."""
    import pinocchio as pin

    trajectory, robot = walking
    model = build(robot, base="fixed")
    reference = Reference.of(trajectory, robot, RATE)
    found = ReferenceTorque.of(reference, model)
    n, h = len(robot.joint_names), 0.0005
    steps = np.arange(0, reference.steps, EVERY_STEPS)
    before, now, after = (reference.at(steps + k) for k in (-1, 0, 1))
    data, torque = robot.pin_model.createData(), np.empty(now.shape)
    for k, posture in enumerate(now):
        velocity, acceleration = np.zeros(robot.pin_model.nv), np.zeros(robot.pin_model.nv)
        velocity[-n:] = (now[k] - before[k]) / h
        acceleration[-n:] = (after[k] - 2 * now[k] + before[k]) / h**2
        solved = pin.rnea(robot.pin_model, data, robot.configuration(posture), velocity, acceleration)
        torque[k] = solved[-n:] + model.armature * acceleration[-n:]
    np.testing.assert_allclose(found.peak, np.abs(torque).max(axis=0), rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(found.time_s, reference.start_s + h * steps[np.abs(torque).argmax(axis=0)], atol=1e-9)


def test_a_limit_that_is_unknown_or_zero_has_no_ratio(tmp_path: Path) -> None:
    model = arm(tmp_path, 2)
    reference = Reference.of(moving(model, sines, 1.0, 100), model.robot, RATE)
    found = ReferenceTorque.of(reference, replace(model, torque_limit_nm=np.array([np.inf, 0.0])))
    assert found.ratio.tolist() == [0.0, 0.0]
    assert found.over_percent[0] == 0.0
    assert found.over_percent[1] > 99
    check = replay(moving(model, sines, 0.1, 100), replace(model, torque_limit_nm=np.array([np.inf, np.inf]))).check(
        "reference_torque_ratio_max"
    )
    assert (check.value, check.passed) == (None, None)


def test_saturation_is_told_from_what_the_motion_asks_for(tmp_path: Path) -> None:
    """A motor too weak for the motion; and one strong enough, whose controller starts off as a hammer blow."""
    model = arm(tmp_path, 2)
    motion = moving(model, sines, 3.0, 100)
    asked = replay(motion, model).check("reference_torque_ratio_max")
    assert asked.value is not None
    assert asked.value < 1
    assert asked.where == "joint0"
    weak = replace(model, torque_limit_nm=model.torque_limit_nm * asked.value / 1.25)
    report = replay(motion, weak)
    check = report.check("reference_torque_ratio_max")
    assert check.value == pytest.approx(1.25)
    assert check.time_s == asked.time_s
    assert "above the limit" in check.note
    assert "the motion itself asks for 1.25 of the limit there" in report.check("torque_saturation_percent").note
    strong = replace(model, torque_limit_nm=model.torque_limit_nm * asked.value / 0.98)
    assert replay(motion, strong, FixedOptions(feed_forward=True)).check("torque_saturation_percent").value == 0
