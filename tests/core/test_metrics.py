"""Figures whose answer is known: a posture turned by a known angle, a limit crossed by a known amount, a sole that slides at a known speed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from retarget import robots
from retarget.core import mapping, metrics, robot_model, rotations
from retarget.core.segments import PARENT, SEGMENTS
from retarget.core.types import HumanMotion, JointTrajectory

RATE_HZ = 50.0
OFFSETS = {
    "LeftUpperArm": (0, 0.15, 0.1), "LeftForeArm": (0, 0.3, 0), "LeftHand": (0, 0.25, 0),
    "RightUpperArm": (0, -0.15, 0.1), "RightForeArm": (0, -0.3, 0), "RightHand": (0, -0.25, 0),
    "LeftUpperLeg": (0, 0.1, 0), "LeftLowerLeg": (0, 0, -0.45), "LeftFoot": (0, 0, -0.4), "LeftToe": (0.15, 0, -0.07),
    "RightUpperLeg": (0, -0.1, 0), "RightLowerLeg": (0, 0, -0.45), "RightFoot": (0, 0, -0.4), "RightToe": (0.15, 0, -0.07),
}  # fmt: skip


def t_pose(frames: int = 6) -> HumanMotion:
    position = np.zeros((frames, len(SEGMENTS), 3))
    position[:, 0, 2] = 0.92
    for name, parent in PARENT.items():
        if parent is not None:
            offset = OFFSETS.get(name, (0, 0, 0.1))
            position[:, SEGMENTS.index(name)] = position[:, SEGMENTS.index(parent)] + offset
    return HumanMotion(
        time=np.arange(frames) / RATE_HZ,
        segments=SEGMENTS,
        orientation=np.tile([1.0, 0.0, 0.0, 0.0], (frames, len(SEGMENTS), 1)),
        position=position,
        joint_offsets={name: np.array(offset, float) for name, offset in OFFSETS.items()},
    )


@pytest.fixture(scope="module")
def g1() -> robot_model.RobotModel:
    return robot_model.build(robots.load("g1"))


def still(model: robot_model.RobotModel, joints: np.ndarray, frames: int = 6) -> JointTrajectory:
    return JointTrajectory(
        time=np.arange(frames) / RATE_HZ,
        joint_names=model.joint_names,
        position=np.tile(joints, (frames, 1)),
        velocity=np.zeros((frames, len(joints))),
        base_position=np.tile([0.0, 0.0, 1.0], (frames, 1)),
        base_orientation=np.tile(model.base_rotation, (frames, 1)),
    )


def moved(trajectory: JointTrajectory, frame: int, joint: int, by: float) -> JointTrajectory:
    position = trajectory.position.copy()
    position[frame, joint] += by
    return replace(trajectory, position=position)


def test_limb_direction_error_is_the_angle_a_joint_was_turned_by(g1: robot_model.RobotModel) -> None:
    """The knee turned by 0.2 rad: the shank's error grows by exactly that (its axis crosses the bone), the thigh's not at all."""
    upright = still(g1, np.zeros(29))
    knee = g1.joint_index("left_knee_joint")
    before = metrics.limb_direction_errors(upright, g1, t_pose())
    after = metrics.limb_direction_errors(moved(upright, 3, knee, 0.2), g1, t_pose())
    # Independent: the same two directions by pinocchio.
    data, limb = g1.pin_model.createData(), g1.limbs["LeftLowerLeg"]
    joints = np.zeros(29)
    joints[knee] = 0.2
    pin.framesForwardKinematics(g1.pin_model, data, g1.configuration(joints))
    direction = data.oMf[g1.pin_model.getFrameId(limb.link)].rotation @ limb.bone
    assert after["LeftLowerLeg"][3] == pytest.approx(np.degrees(np.arccos(direction @ [0, 0, -1])), abs=1e-9)
    np.testing.assert_allclose(np.delete(after["LeftLowerLeg"], 3), np.delete(before["LeftLowerLeg"], 3), atol=1e-12)
    np.testing.assert_allclose(after["LeftUpperLeg"], before["LeftUpperLeg"], atol=1e-12)


def test_limb_direction_uses_positions_before_orientations() -> None:
    """The measure people see is between joint centres: moving the person's wrist by hand must show, turning the segment must not."""
    motion = t_pose()
    position = motion.position.copy()
    position[:, motion.index("LeftHand")] += [0.0, 0.0, 0.25]  # forearm now points up by 45°
    person = metrics.person_limb(replace(motion, position=position), "LeftForeArm")
    np.testing.assert_allclose(person[0] / np.linalg.norm(person[0]), [0, np.sqrt(0.5), np.sqrt(0.5)], atol=1e-12)


def test_orientation_error_is_the_angle_between_target_and_link(g1: robot_model.RobotModel) -> None:
    targets = mapping.load("link_orientation").targets(t_pose(), g1)
    tpose = still(g1, g1.reference_posture)
    errors = metrics.orientation_errors(tpose, g1, targets)
    assert max(error.max() for error in errors.values()) < 1e-5  # constants come from this very posture
    waist = g1.joint_index("waist_yaw_joint")
    turned = metrics.orientation_errors(moved(tpose, 2, waist, np.radians(10)), g1, targets)
    for segment in ("T8", "LeftUpperArm", "RightHand"):
        assert turned[segment][2] == pytest.approx(10.0, abs=1e-6)
    assert turned["LeftFoot"][2] < 1e-5


def test_limits_are_counted_without_tolerance(g1: robot_model.RobotModel) -> None:
    joints = np.clip(np.zeros(29), g1.lower, g1.upper)
    joints[0] = g1.upper[0]
    inside = still(g1, joints)
    figures, _ = metrics.limit_figures(inside, g1)
    assert figures["position_limit_violations"] == 0
    assert figures["limit_active_fraction"] == 1.0
    figures, _ = metrics.limit_figures(moved(inside, 2, 0, 2e-9), g1)
    assert figures["position_limit_violations"] == 1


def test_speed_is_counted_between_frames(g1: robot_model.RobotModel) -> None:
    knee = g1.joint_index("left_knee_joint")
    step = g1.velocity_limit[knee] / RATE_HZ
    below, _ = metrics.limit_figures(moved(still(g1, np.full(29, 0.01)), 2, knee, step * (1 - 1e-9)), g1)
    above, _ = metrics.limit_figures(moved(still(g1, np.full(29, 0.01)), 2, knee, step * (1 + 1e-6)), g1)
    assert below["velocity_limit_violations"] == 0
    assert above["velocity_limit_violations"] == 2  # there and back
    assert above["max_velocity_ratio"] == pytest.approx(1.0, abs=1e-5)
    assert below["velocity_limit_active_fraction"] == {"left_knee_joint": pytest.approx(2 / 5)}


def test_jerk_of_a_cubic_is_its_third_derivative(g1: robot_model.RobotModel) -> None:
    trajectory = still(g1, np.zeros(29), frames=20)
    position = trajectory.position.copy()
    position[:, 4] = 0.7 * trajectory.time**3 - 0.2 * trajectory.time**2
    cubic = replace(trajectory, position=position)
    assert metrics.jerk_rms(cubic) == pytest.approx(0.7 * 6 / np.sqrt(29), rel=1e-6)


def test_feet_sliding_at_a_known_speed(g1: robot_model.RobotModel) -> None:
    standing = still(g1, np.zeros(29))
    data = g1.pin_model.createData()
    pin.framesForwardKinematics(g1.pin_model, data, g1.configuration(np.zeros(29)))
    foot = g1.profile.feet["Left"]
    placement = data.oMf[g1.pin_model.getFrameId(foot.link)]
    sole_height = min((placement.rotation @ corner + placement.translation)[2] for corner in foot.sole)
    height = -sole_height - 0.003  # 3 mm into the floor
    path = np.stack([0.3 * standing.time, 0.4 * standing.time, np.full(6, height)], axis=1)
    skate, penetration, series = metrics.foot_figures(replace(standing, base_position=path), g1)
    assert skate == {"mean": pytest.approx(0.5), "max": pytest.approx(0.5)}
    assert penetration == {"mean": pytest.approx(3.0), "max": pytest.approx(3.0)}
    np.testing.assert_allclose(series["foot_height_m/Left"], -0.003, atol=1e-12)
    raised = replace(standing, base_position=path + np.array([0.0, 0.0, 0.02]))
    skate, penetration, _ = metrics.foot_figures(raised, g1)
    assert skate == {"mean": 0.0, "max": 0.0}
    assert penetration == {"mean": 0.0, "max": 0.0}


def test_marked_frames_and_unmeasured_segments_are_reported(g1: robot_model.RobotModel) -> None:
    motion = t_pose()
    measured = np.array([not name.endswith("Toe") for name in SEGMENTS])
    motion = replace(motion, measured=measured)
    trajectory = replace(still(g1, np.zeros(29)), status=np.array([0, 0, 1, 0, 0, 1], np.int8))
    figures, _ = metrics.measure(trajectory, g1, motion, mapping.load("limb_plane").targets(motion, g1))
    assert figures["marked_frames"] == 2
    assert figures["unmeasured_segments"] == ["RightToe", "LeftToe"]


def test_turning_everything_changes_no_error(g1: robot_model.RobotModel) -> None:
    turn = rotations.exp([0.0, 0.0, 2.1])
    motion = t_pose()
    turned = replace(
        motion,
        orientation=rotations.make_continuous(rotations.multiply(turn, motion.orientation)),
        position=rotations.rotate(turn, motion.position),
    )
    trajectory = still(g1, np.full(29, 0.05))
    both = replace(trajectory, base_orientation=rotations.multiply(turn, trajectory.base_orientation))
    here = metrics.limb_direction_errors(trajectory, g1, motion)
    there = metrics.limb_direction_errors(both, g1, turned)
    for segment, error in here.items():
        np.testing.assert_allclose(there[segment], error, atol=1e-9)
