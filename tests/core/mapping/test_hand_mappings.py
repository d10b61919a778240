"""The three hand mappings on real robots: poses onto poses, no dependence on heading or place, nothing that is not finite."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from retarget.core import mapping, robot_model, rotations
from retarget.core.errors import InvalidDataError, MotionError, ProfileError
from retarget.core.mapping.arm_frames import arm_frames
from retarget.core.mapping.hand_blend import CONTACT_M
from retarget.core.mapping.hand_position import targets, within_reach
from retarget.core.profile import Hierarchy, Level, LevelTask
from retarget.core.types import Array, HumanMotion, Targets, Task

from tests.core.mapping.operators import arm, authors_arms, calibration_of, moving, pose, turned

MotionFactory = Callable[..., HumanMotion]
RobotBuilder = Callable[[str], Any]
TIME = np.arange(90) / 90
ROBOTS = ["tocabi", "g1", "icub", "talos", "baxter"]
MAPPINGS = ["hand_position", "proportional", "absolute"]
SIX = ("T8", "Head", "LeftUpperArm", "RightUpperArm", "LeftHand", "RightHand")
DIRECTIONS = {
    "still": {"Left": [0, 0, -1], "Right": [0, 0, -1]},
    "tpose": {"Left": [0, 1, 0], "Right": [0, -1, 0]},
    "forward": {"Left": [1, 0, 0], "Right": [1, 0, 0]},
}


def tasks_of(found: Targets, kind: str) -> dict[str, Task]:
    return {task.segment: task for task in found.tasks if task.kind == kind}


def shoulder(model: Any, side: str) -> Array:
    """The robot's shoulder centre in its reference posture, by pinocchio."""
    own = arm_frames(model)[side]
    data = model.pin_model.createData()
    pin.framesForwardKinematics(model.pin_model, data, model.configuration(model.reference_posture))
    return np.array(data.oMf[model.pin_model.getFrameId(own.shoulder_link)].act(own.shoulder))


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("held", ["still", "tpose", "forward"])
def test_a_held_pose_is_the_robots_own(
    make_motion: MotionFactory, build_robot: RobotBuilder, name: str, held: str
) -> None:
    """Hand at full arm's length, straight down, out or forward; the upper arm's plane and the hand as in that pose."""
    model = build_robot(name)
    motion = make_motion(TIME[:20], pose(held), calibration=calibration_of(make_motion))
    found = targets(motion, model)
    for side, own in arm_frames(model).items():
        task = tasks_of(found, "position")[f"{side}Hand"]
        expected = shoulder(model, side) + own.length_m * np.array(DIRECTIONS[held][side])
        assert task.value == pytest.approx(np.tile(expected, (20, 1)), abs=1e-6)
        assert (task.frame, task.gain) == (own.hand_link, 200.0)
        assert task.offset == pytest.approx(own.hand)


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("method", MAPPINGS)
@pytest.mark.parametrize("sparse", [False, True], ids=["suit", "trackers"])
def test_targets_are_finite_and_continuous(
    make_motion: MotionFactory, build_robot: RobotBuilder, name: str, method: str, sparse: bool
) -> None:
    model = build_robot(name)
    motion = replace(moving(make_motion, TIME), calibration=calibration_of(make_motion))
    if sparse:
        motion = replace(motion, measured=np.array([s in SIX for s in motion.segments]))
    found = mapping.load(method).targets(motion, model)
    assert found.mapping == method
    assert set(tasks_of(found, "position")) == {"LeftHand", "RightHand"}
    assert set(tasks_of(found, "axis")) >= {"LeftUpperArm", "RightUpperArm"}
    for task in found.tasks:
        assert np.isfinite(task.value).all()
        assert np.linalg.norm(np.diff(task.value, axis=0), axis=1).max() < 0.1
        assert task.feed_forward is not None
        assert np.isfinite(task.feed_forward).all()


@pytest.mark.parametrize("name", ["g1", "baxter"])
@pytest.mark.parametrize("method", MAPPINGS)
def test_heading_and_place_do_not_matter(
    make_motion: MotionFactory, build_robot: RobotBuilder, name: str, method: str
) -> None:
    """A person who has turned about and walked off since the calibration gives the same targets: not a twisted robot."""
    model, calibration = build_robot(name), calibration_of(make_motion)
    motion = replace(moving(make_motion, TIME), calibration=calibration)
    away = replace(turned(motion, -2.0, np.array([4.0, 1.0, 0.0])), calibration=calibration)
    here, there = (mapping.load(method).targets(m, model) for m in (motion, away))
    for a, b in zip(here.tasks, there.tasks, strict=True):
        if a.kind == "orientation":
            assert rotations.angle(a.value, b.value).max() < 1e-9
        else:
            assert a.value == pytest.approx(b.value, abs=1e-9)


@pytest.mark.parametrize("name", ["g1", "icub"])
def test_the_hand_goes_with_the_chest(make_motion: MotionFactory, build_robot: RobotBuilder, name: str) -> None:
    """A turned chest, arms as in T-pose on it: the chest's target is turned, and the hand's is that of a robot whose waist has
    turned."""
    model = build_robot(name)
    turn = rotations.exp(np.array([0.0, 0.1, 0.4]))
    motion = make_motion(TIME[:3], {"T8": turn}, calibration=calibration_of(make_motion))
    found = targets(motion, model)
    chest = tasks_of(found, "orientation")["T8"]
    joints = model.configuration(model.reference_posture)
    frame = model.pin_model.getFrameId(model.links["T8"])
    data = model.pin_model.createData()
    for _ in range(100):  # an independent inverse kinematics of the chest: pinocchio's own Jacobian, all joints
        pin.computeJointJacobians(model.pin_model, data, joints)
        pin.updateFramePlacements(model.pin_model, data)
        rest = pin.log3(rotations.to_matrix(chest.value[0]) @ data.oMf[frame].rotation.T)
        jacobian = pin.getFrameJacobian(model.pin_model, data, frame, pin.LOCAL_WORLD_ALIGNED)[3:]
        jacobian[:, :6] = 0
        joints = pin.integrate(model.pin_model, joints, np.linalg.pinv(jacobian) @ rest)
    assert np.linalg.norm(rest) < 1e-9
    upright = rotations.to_matrix(turn)
    for side, own in arm_frames(model).items():
        centre = data.oMf[model.pin_model.getFrameId(own.shoulder_link)].act(own.shoulder)
        expected = centre + upright @ (own.length_m * np.array(DIRECTIONS["tpose"][side]))
        assert tasks_of(found, "position")[f"{side}Hand"].value[0] == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize("name", ROBOTS)
def test_orientations_and_normals_in_t_pose_are_the_robots_own(
    make_motion: MotionFactory, build_robot: RobotBuilder, name: str
) -> None:
    """By definition of T-pose alignment: normals of arm planes point up, the head's axis forward, hands as `link_rotations` has
    them."""
    model = build_robot(name)
    found = targets(make_motion(TIME[:3], calibration=calibration_of(make_motion)), model)
    axes = tasks_of(found, "axis")
    for side in ("Left", "Right"):
        assert axes[f"{side}UpperArm"].value == pytest.approx(np.tile([0.0, 0.0, 1.0], (3, 1)), abs=1e-9)
        hand = model.profile.hands[side]
        task = tasks_of(found, "orientation")[f"{side}Hand"]
        out = [0.0, 1.0 if side == "Left" else -1.0, 0.0]
        assert rotations.rotate(task.value[0], hand.fingers) == pytest.approx(out, abs=1e-9)
        assert rotations.rotate(task.value[0], hand.palm) == pytest.approx([0, 0, -1], abs=1e-4)
    if "Head" in axes:
        assert axes["Head"].value == pytest.approx(np.tile([1.0, 0.0, 0.0], (3, 1)), abs=1e-9)
    levels = {(task.segment, task.level) for task in found.tasks}
    assert levels >= {("LeftHand", 1), ("RightHand", 1), ("LeftUpperArm", 2), ("RightUpperArm", 2)}
    light = 1.0 if name == "tocabi" else 0.01  # the paper's table has no weights within a level
    for task in found.tasks:
        turns_hand = task.kind == "orientation" and task.segment.endswith("Hand")
        assert task.weight == pytest.approx(light if turns_hand else 1.0)


def test_feed_forwards_are_the_targets_own_rates(make_motion: MotionFactory, build_robot: RobotBuilder) -> None:
    time = np.arange(400) / 400
    model = build_robot("icub")
    motion = replace(moving(make_motion, time), calibration=calibration_of(make_motion))
    for task in targets(motion, model).tasks:
        assert task.feed_forward is not None
        middle = slice(2, -2)
        step = (task.value[2:] - task.value[:-2]) * 200
        rate = step[1:-1]
        if task.kind == "position":
            assert task.feed_forward[middle] == pytest.approx(rate, abs=1e-9)
        elif task.kind == "axis":
            assert np.cross(task.feed_forward, task.value)[middle] == pytest.approx(rate, abs=1e-3)
        else:
            omega = 2 * rotations.multiply(step, rotations.conjugate(task.value[1:-1]))[1:-1, 1:]
            assert task.feed_forward[middle] == pytest.approx(omega, abs=1e-3)


@pytest.mark.parametrize("side", ["Left", "Right"])
def test_the_authors_operator_in_the_authors_poses(
    make_motion: MotionFactory, build_robot: RobotBuilder, side: str
) -> None:
    """Real calibrations are skewed: holding a pose still gives the robot's own, to 1e-6, in the first frame and after a second of
    holding."""
    model = build_robot("talos")
    calibration = replace(calibration_of(make_motion), arms=authors_arms())
    for column, held in enumerate(DIRECTIONS):
        motion = make_motion(np.arange(90) / 90, pose(held))
        position = np.array(motion.position)
        for name, own in calibration.arms.items():
            position[:, motion.index(f"{name}Hand")] = position[:, motion.index("Pelvis")] + own.hand_points[column]
        found = targets(replace(motion, position=position, calibration=calibration), model)
        own = arm_frames(model)[side]
        expected = shoulder(model, side) + own.length_m * np.array(DIRECTIONS[held][side])
        assert tasks_of(found, "position")[f"{side}Hand"].value == pytest.approx(np.tile(expected, (90, 1)), abs=1e-6)


def test_baselines_in_closed_form(make_motion: MotionFactory, build_robot: RobotBuilder) -> None:
    model = build_robot("g1")
    motion = replace(moving(make_motion, TIME), calibration=calibration_of(make_motion))
    length = np.mean([own.length_m for own in arm_frames(model).values()])
    for side in ("Left", "Right"):
        hand = motion.position[:, motion.index(f"{side}Hand")] - motion.position[:, motion.index("Pelvis")]
        one = tasks_of(mapping.load("absolute").targets(motion, model), "position")[f"{side}Hand"].value
        assert one == pytest.approx(hand + np.array([0, 0, 0.15]), abs=1e-9)
        scaled = tasks_of(mapping.load("proportional").targets(motion, model, height_m=0.1), "position")
        assert scaled[f"{side}Hand"].value == pytest.approx(
            0.9 * length / 0.55 * hand + np.array([0, 0, 0.1]), abs=1e-9
        )


@pytest.mark.parametrize("name", ["g1", "baxter"])
def test_baselines_with_shoulders_at_the_same_height(
    make_motion: MotionFactory, build_robot: RobotBuilder, name: str
) -> None:
    """In T-pose the hands are as high as the shoulders: the robot's are, too."""
    model = build_robot(name)
    motion = make_motion(TIME[:2], calibration=calibration_of(make_motion))
    for method in ("proportional", "absolute"):
        found = tasks_of(mapping.load(method).targets(motion, model, height_m=None), "position")
        for side in ("Left", "Right"):
            assert found[f"{side}Hand"].value[:, 2] == pytest.approx(shoulder(model, side)[2], abs=1e-3)


def test_hands_stay_between_ten_centimetres_and_an_arms_length() -> None:
    points = np.array([[2.0, 0, 0], [0.0, 0.02, 0], [0.0, 0, 0], [0.3, 0.1, -0.2]])
    found = within_reach(points, 0.6)
    assert found == pytest.approx(np.array([[0.6, 0, 0], [0, 0.1, 0], [0.1, 0, 0], [0.3, 0.1, -0.2]]))


@pytest.mark.parametrize("name", ["g1", "talos"])
def test_clapping_closes_the_gap_only_when_blended(
    make_motion: MotionFactory, build_robot: RobotBuilder, name: str
) -> None:
    """Hands that come from 0.7 m to 0.04 m apart in front of the chest and go back."""
    model, calibration = build_robot(name), calibration_of(make_motion)
    time = np.arange(270) / 90
    distance = 0.37 + 0.33 * np.cos(2 * np.pi * time / 3)
    motion = make_motion(time, calibration=calibration)
    position = np.array(motion.position)
    for side, out in (("Left", 0.5), ("Right", -0.5)):
        path = np.stack([0 * time + 0.35, out * distance, 0 * time + 0.3], axis=1)
        position[:, motion.index(f"{side}Hand")] = position[:, motion.index("Pelvis")] + path
    motion = replace(motion, position=position)
    plain, blended = (tasks_of(targets(motion, model, blend_hands=b), "position") for b in (False, True))
    gap, closed = (np.linalg.norm(t["LeftHand"].value - t["RightHand"].value, axis=1) for t in (plain, blended))
    touching = distance <= CONTACT_M
    assert touching.any()
    assert closed[touching] == pytest.approx(distance[touching], abs=1e-9)
    assert np.abs(gap - distance)[touching].mean() > 0.02
    apart = distance >= 0.4
    for side in ("LeftHand", "RightHand"):
        assert blended[side].value[apart] == pytest.approx(plain[side].value[apart], abs=1e-12)
        step = np.diff(blended[side].value, axis=0) * 90
        assert np.linalg.norm(step, axis=1).max() < 2.5


def test_levels_of_a_profile_are_followed(build_robot: RobotBuilder, make_motion: MotionFactory) -> None:
    """Shoulders follow where a level names their link; segments that were not measured leave their task out."""
    model = build_robot("icub")
    levels = (
        Level((LevelTask("LeftHand", "position", 7.0), LevelTask("RightHand", "position", 8.0)), 3.0),
        Level(
            (LevelTask("LeftShoulder", "axis", 9.0, "l_shoulder_1", (0.0, 0.0, 1.0)), LevelTask("Head", "axis", 1.0))
        ),
    )
    model = robot_model.build(replace(model.profile, hierarchy=Hierarchy(levels=levels)))
    chest = rotations.exp(np.array([0.0, 0.3, 0.0]))
    motion = make_motion(TIME[:2], {"T8": chest}, calibration=calibration_of(make_motion))
    motion = replace(motion, measured=np.array([s in SIX and s != "Head" for s in motion.segments]))
    found = targets(motion, model).tasks
    assert [(t.segment, t.level, t.gain) for t in found] == [
        ("LeftHand", 0, 7.0),
        ("RightHand", 0, 8.0),
        ("LeftShoulder", 1, 9.0),
    ]
    data = model.pin_model.createData()
    pin.framesForwardKinematics(model.pin_model, data, model.configuration(model.reference_posture))
    tpose = data.oMf[model.pin_model.getFrameId("l_shoulder_1")].rotation
    assert found[2].value[0] == pytest.approx(rotations.to_matrix(chest) @ tpose @ [0, 0, 1], abs=1e-9)


def test_requests_that_can_not_be_met(build_robot: RobotBuilder, make_motion: MotionFactory) -> None:
    model = build_robot("g1")
    with pytest.raises(MotionError, match=r"^hand mappings need the operator's calibration, and the motion has none"):
        targets(make_motion(TIME[:2]), model)
    motion = make_motion(TIME[:2], calibration=calibration_of(make_motion))
    no_hand = replace(motion, measured=np.array([s != "LeftHand" for s in motion.segments]))
    with pytest.raises(MotionError, match="needs the position of LeftHand"):
        targets(no_hand, model)
    for wrong, message in (
        (LevelTask("Head", "position", 1.0), "position task of segment 'Head'; expected LeftHand or RightHand"),
        (LevelTask("Head", "axis", 1.0), "the task of Head names no link; expected a link"),
    ):
        odd = replace(model, profile=replace(model.profile, hierarchy=Hierarchy(levels=(Level((wrong,)),))))
        with pytest.raises(ProfileError, match=message):
            targets(motion, odd)


def test_arms_that_nearly_lie_in_a_plane(build_robot: RobotBuilder, make_motion: MotionFactory) -> None:
    calibration = calibration_of(make_motion)
    flat = arm(np.array([[0, 0.5, 0.5], [0, 0.9, 0.1], [0, 0.2, 0.1]]), np.array([0, 0.2, 0.5]))
    motion = make_motion(TIME[:2], calibration=replace(calibration, arms={**calibration.arms, "Left": flat}))
    with pytest.raises(InvalidDataError, match="nearly lie in one plane"):
        targets(motion, build_robot("g1"))
