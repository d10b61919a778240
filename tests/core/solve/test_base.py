"""Root motion against pinocchio: what is flagged as standing must stand, whatever the joints do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from retarget import robots
from retarget.core import robot_model, rotations
from retarget.core.segments import SEGMENTS
from retarget.core.solve import base
from retarget.core.types import Array, HumanMotion

FRAMES, RATE_HZ = 120, 60.0
TIME = np.arange(FRAMES) / RATE_HZ


@pytest.fixture(scope="module")
def g1() -> robot_model.RobotModel:
    return robot_model.build(robots.load("g1"))


def person(contacts: Array | None, pelvis: Array | None = None) -> HumanMotion:
    """A person of whom only the pelvis' path, the leg lengths and the contacts matter here."""
    position = np.zeros((FRAMES, len(SEGMENTS), 3))
    heights = {"UpperLeg": 0.9, "LowerLeg": 0.48, "Foot": 0.08}
    for side in ("Left", "Right"):
        for part, height in heights.items():
            position[:, SEGMENTS.index(side + part), 2] = height
    position[:, 0] = [0.0, 0.0, 0.95] if pelvis is None else pelvis
    return HumanMotion(
        time=TIME,
        segments=SEGMENTS,
        orientation=np.tile([1.0, 0.0, 0.0, 0.0], (FRAMES, len(SEGMENTS), 1)),
        position=position,
        foot_contacts=None if contacts is None else contacts.astype(bool),
    )


def swaying(model: robot_model.RobotModel) -> tuple[Array, Array]:
    """Joints (T, n) and base orientations (T, 4): legs, ankles and base all moving, left foot and right foot differently."""
    joints = np.tile(np.clip(np.zeros(29), model.lower, model.upper), (FRAMES, 1))
    for k, name in enumerate(n for n in model.joint_names if "hip" in n or "knee" in n or "ankle" in n):
        i = model.joint_index(name)
        middle, reach = 0.5 * (model.lower[i] + model.upper[i]), 0.2 * (model.upper[i] - model.lower[i])
        joints[:, i] = np.clip(
            middle + 0.3 * reach * np.sin(2 * np.pi * 0.7 * TIME + k), model.lower[i], model.upper[i]
        )
    turn = 0.4 * np.sin(2 * np.pi * 0.5 * TIME)
    zero = np.zeros_like(turn)
    return joints, np.stack([np.cos(turn / 2), zero, zero, np.sin(turn / 2)], axis=1)


def corners_by_pinocchio(model: robot_model.RobotModel, joints: Array, turn: Array, at: Array, side: str) -> Array:
    data, foot = model.pin_model.createData(), model.profile.feet[side]
    frame = model.pin_model.getFrameId(foot.link)
    found = []
    for q, quaternion, position in zip(joints, turn, at, strict=True):
        pin.framesForwardKinematics(model.pin_model, data, np.concatenate([position, np.roll(quaternion, -1), q]))
        found.append([data.oMf[frame].act(corner) for corner in foot.sole])
    return np.array(found)


def hip_height(model: robot_model.RobotModel) -> float:
    """Of the left hip's centre above the sole, standing in the reference posture, by pinocchio."""
    data = model.pin_model.createData()
    pin.framesForwardKinematics(model.pin_model, data, model.configuration(model.reference_posture))
    hip, foot = model.limbs["LeftUpperLeg"], model.profile.feet["Left"]
    top = data.oMf[model.pin_model.getFrameId(hip.link)].act(hip.proximal)
    sole = data.oMf[model.pin_model.getFrameId(foot.link)].act(foot.sole.mean(axis=0))
    return float(top[2] - sole[2])


def test_the_standing_foot_stays_where_it_is(g1: robot_model.RobotModel) -> None:
    """Left foot on the ground for the first second, the right one for the second: each sole's centre must not move meanwhile."""
    contacts = np.zeros((FRAMES, 4))
    contacts[: FRAMES // 2, :2] = 1
    contacts[FRAMES // 2 :, 2:] = 1
    joints, turn = swaying(g1)
    at = base.base_position("contact", g1, person(contacts), joints, turn)
    for side, frames in (("Left", slice(0, FRAMES // 2)), ("Right", slice(FRAMES // 2, None))):
        centre = corners_by_pinocchio(g1, joints, turn, at, side)[frames].mean(axis=1)
        np.testing.assert_allclose(centre[:, :2], np.tile(centre[0, :2], (len(centre), 1)), atol=1e-12)


def test_a_heel_alone_holds_the_heel(g1: robot_model.RobotModel) -> None:
    contacts = np.zeros((FRAMES, 4))
    contacts[:, 0] = 1
    joints, turn = swaying(g1)
    at = base.base_position("contact", g1, person(contacts), joints, turn)
    corners = corners_by_pinocchio(g1, joints, turn, at, "Left")
    heel = corners[:, g1.profile.feet["Left"].sole[:, 0] < 0].mean(axis=1)
    assert np.ptp(heel[:, :2], axis=0).max() < 1e-12
    assert np.ptp(corners.mean(axis=1)[:, :2], axis=0).max() > 1e-3  # the rest of the foot turns about it


def test_the_lowest_corner_is_on_the_ground(g1: robot_model.RobotModel) -> None:
    joints, turn = swaying(g1)
    at = base.base_position("contact", g1, person(np.ones((FRAMES, 4))), joints, turn)
    lowest = np.min(
        [corners_by_pinocchio(g1, joints, turn, at, side)[..., 2].min(axis=1) for side in ("Left", "Right")], axis=0
    )
    assert lowest.min() >= -0.002 - 1e-9  # what rounding off the height's kinks may press in
    assert lowest.max() <= 0.004 + 1e-9


def test_flight_follows_the_person(g1: robot_model.RobotModel) -> None:
    """Nothing on the ground: the horizontal path is the person's times the ratio of hip heights above the soles."""
    pelvis = np.stack([1.5 * TIME, 0.5 * TIME, 0.95 + 0.0 * TIME], axis=1)
    joints, turn = swaying(g1)
    motion = person(np.zeros((FRAMES, 4)), pelvis)
    at = base.base_position("contact", g1, motion, joints, turn)
    scale = hip_height(g1) / 0.9
    np.testing.assert_allclose(at[-1, :2] - at[0, :2], scale * (pelvis[-1] - pelvis[0])[:2], rtol=1e-4)


def test_a_jump_leaves_the_ground_by_the_scaled_height(g1: robot_model.RobotModel) -> None:
    rise = np.where((TIME > 0.8) & (TIME < 1.2), 0.2 * np.sin(np.pi * (TIME - 0.8) / 0.4), 0.0)
    contacts = np.tile((rise <= 0)[:, None], (1, 4))
    pelvis = np.stack([0 * TIME, 0 * TIME, 0.95 + rise], axis=1)
    joints = np.zeros((FRAMES, 29))
    upright = np.tile([1.0, 0.0, 0.0, 0.0], (FRAMES, 1))
    motion = person(contacts, pelvis)
    at = base.base_position("contact", g1, motion, joints, upright)
    assert np.ptp(at[:, 2]) == pytest.approx(0.2 * base.leg_scale(g1, motion), rel=1e-3)
    assert np.ptp(at[:, :2], axis=0).max() < 1e-12


def test_human_mode_is_the_scaled_path(g1: robot_model.RobotModel) -> None:
    pelvis = np.stack([0.8 * TIME, np.sin(TIME), 0.95 + 0.01 * np.sin(9 * TIME)], axis=1)
    motion = person(None, pelvis)
    joints, turn = swaying(g1)
    at = base.base_position("human", g1, motion, joints, turn)
    np.testing.assert_allclose(np.diff(at, axis=0), base.leg_scale(g1, motion) * np.diff(pelvis, axis=0), atol=1e-12)


def test_fixed_mode_stands_still_on_the_ground(g1: robot_model.RobotModel) -> None:
    joints = np.zeros((FRAMES, 29))
    upright = np.tile([1.0, 0.0, 0.0, 0.0], (FRAMES, 1))
    at = base.base_position("fixed", g1, person(None), joints, upright)
    assert not np.diff(at, axis=0).any()
    lowest = corners_by_pinocchio(g1, joints[:1], upright[:1], at[:1], "Left")[..., 2].min()
    assert lowest == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(("name", "rtol"), [("g1", 1e-4), ("icub", 1e-6), ("talos", 1e-6), ("tocabi", 1e-6)])
def test_leg_scale_compares_hips_above_soles(name: str, rtol: float) -> None:
    """The person's hips are 0.9 m above the soles, 80 mm of it below the ankle; how the legs and feet are held doesn't matter."""
    model = robot_model.build(robots.load(name))
    assert base.leg_scale(model, person(None)) == pytest.approx(hip_height(model) / 0.9, rel=rtol)
    stride = person(None)
    position, orientation = np.array(stride.position), np.array(stride.orientation)
    turn = rotations.exp(np.array([0.3, -0.8, 0.5]))
    legs = [i for i, segment in enumerate(SEGMENTS) if segment.endswith(("Leg", "Foot", "Toe"))]
    position[:, legs] = rotations.rotate(turn, position[:, legs])
    orientation[:, legs] = turn
    striding = replace(stride, position=position, orientation=orientation)
    assert base.leg_scale(model, striding) == pytest.approx(hip_height(model) / 0.9, rel=rtol)


def test_leg_scale_without_toes_compares_thighs_and_shanks(g1: robot_model.RobotModel) -> None:
    motion = person(None)
    measured = np.array(["Toe" not in name for name in SEGMENTS])
    bones = [g1.limbs[f"Left{part}"] for part in ("UpperLeg", "LowerLeg")]
    length = sum(np.linalg.norm(bone.distal - bone.proximal) for bone in bones)
    assert base.leg_scale(g1, replace(motion, measured=measured)) == pytest.approx(length / (0.9 - 0.08))


def test_leg_scale_is_one_without_legs(g1: robot_model.RobotModel) -> None:
    motion = person(None)
    unmeasured = np.array(["Leg" not in name for name in SEGMENTS])
    assert base.leg_scale(g1, replace(motion, measured=unmeasured)) == 1.0
