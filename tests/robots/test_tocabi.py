"""TOCABI against the figures it is made of: figures written here by hand, and the whole table where it is at hand."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from retarget.core.robot_model import RobotModel
from retarget.robots import tocabi_figures as figures

FACTS = Path(__file__).resolve().parents[3] / "shared" / "facts" / "tocabi.md"

MASSES_KG = {
    "Pelvis_Link": 12.1952, "Waist1_Link": 0.89722, "Waist2_Link": 3.752, "Upperbody_Link": 18.1338, "Neck_Link": 0.248, "Head_Link": 1.417,
    "HipRoll_Link": 2.679, "HipCenter_Link": 2.67, "Thigh_Link": 5.366, "Knee_Link": 3.883, "AnkleCenter_Link": 2.51,
    "AnkleRoll_Link": 1.26426, "Foot_Link": 2.326,
    "Shoulder1_Link": 1.6762, "Shoulder2_Link": 0.4016, "Shoulder3_Link": 2.90141, "Armlink_Link": 0.58517, "Elbow_Link": 2.06511,
    "Forearm_Link": 0.35234, "Wrist1_Link": 0.70923, "Wrist2_Link": 0.1,
}  # fmt: skip
"""Both sides alike."""

LEFT_ORIGINS_M = {
    "L_HipYaw_Joint": (0.11, 0.1025, -0.1025),
    "L_HipRoll_Joint": (0.11, 0.1025, -0.1025),
    "L_Knee_Joint": (0.11, 0.1025, -0.4525),
    "L_AnklePitch_Joint": (0.11, 0.1025, -0.8025),
    "Waist1_Joint": (0.11, 0.0, 0.1979),
    "Neck_Joint": (0.074, 0.0, 0.5774),
    "Head_Joint": (0.074, 0.0, 0.6049),
    "L_Shoulder1_Joint": (0.133, 0.154, 0.4254),
    "L_Shoulder2_Joint": (0.133, 0.1881, 0.4904),
    "L_Shoulder3_Joint": (0.133, 0.3031, 0.4904),
    "L_Armlink_Joint": (0.133, 0.4312, 0.4904),
    "L_Elbow_Joint": (0.133, 0.6382, 0.4579),
    "L_Forearm_Joint": (0.133, 0.7626, 0.4904),
    "L_Wrist1_Joint": (0.133, 0.9077, 0.4904),
    "L_Wrist2_Joint": (0.133, 0.9537, 0.4904),
}
"""Joint → its origin in the pelvis' frame, all joints at zero: the published offsets added up by hand."""


@pytest.fixture(scope="module")
def tocabi(build_robot: Callable[[str], Any]) -> RobotModel:
    model: RobotModel = build_robot("tocabi")
    return model


@pytest.fixture(scope="module")
def published() -> tuple[list[list[str]], list[list[str]]]:
    """Rows of the joint table and of the link table."""
    if not FACTS.is_file():
        pytest.skip("the table of facts (../shared/facts/tocabi.md) is not on this machine")
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in FACTS.read_text().splitlines() if line]
    joints = [row for row in rows if len(row) == 12 and row[1] in ("revolute", "fixed")]
    links = [row for row in rows if len(row) == 5 and row[0].endswith("_Link")]
    assert (len(joints), len(links)) == (35, 36)
    return joints, links


def numbers(text: str) -> np.ndarray:
    return np.array(text.split(), float)


def at_zero(model: RobotModel) -> Any:
    data = model.pin_model.createData()
    pin.framesForwardKinematics(model.pin_model, data, model.configuration(np.zeros(len(model.joint_names))))
    return data


def test_mass_of_every_link() -> None:
    found = {link: inertia.mass for link, inertia in figures.INERTIAS.items()}
    middle = {link: mass for link, mass in MASSES_KG.items() if link in found}
    pairs = {f"{side}_{link}": mass for link, mass in MASSES_KG.items() if link not in found for side in "LR"}
    assert found == {**middle, **pairs}


def test_the_whole_weighs_95_6_kg_on_33_joints(tocabi: RobotModel) -> None:
    assert tocabi.mass_kg == pytest.approx(95.62, abs=0.005)
    assert len(tocabi.joint_names) == 33


def test_joints_lie_where_the_offsets_put_them(tocabi: RobotModel) -> None:
    data = at_zero(tocabi)
    for name, origin in LEFT_ORIGINS_M.items():
        found = data.oMi[tocabi.pin_model.getJointId(name)].translation
        np.testing.assert_allclose(found, origin, atol=1e-9, err_msg=name)
        if name.startswith("L_"):
            other = data.oMi[tocabi.pin_model.getJointId("R_" + name.removeprefix("L_"))].translation
            np.testing.assert_allclose(other, np.array(origin) * [1, -1, 1], atol=1e-9)


def test_every_joint_is_the_published_one(published: Any) -> None:
    joints, _ = published
    ours = {joint.name: joint for joint in figures.JOINTS}
    assert list(ours) == [row[0] for row in joints]
    for name, kind, parent, child, xyz, rpy, axis, lower, upper, *_ in joints:
        joint = ours[name]
        assert (joint.parent, joint.child) == (parent, child)
        np.testing.assert_allclose(joint.xyz, numbers(xyz), atol=1e-15)
        np.testing.assert_allclose(joint.rpy, numbers(rpy), atol=1e-15)
        if kind == "fixed":
            assert joint.axis is None
        else:
            np.testing.assert_array_equal(joint.axis, numbers(axis))
            assert (joint.lower, joint.upper) == (float(lower), float(upper))


def test_every_link_is_the_published_one(published: Any) -> None:
    _, links = published
    assert list(figures.INERTIAS) == [row[0] for row in links]
    for name, mass, com, rpy, tensor in links:
        ours = figures.INERTIAS[name]
        assert ours.mass == float(mass)
        assert not numbers(rpy).any()
        np.testing.assert_array_equal(ours.com, numbers(com))
        np.testing.assert_array_equal(ours.tensor, numbers(tensor))


def test_the_model_has_the_published_inertias(published: Any, tocabi: RobotModel) -> None:
    """Through the text: body after body, in the frame of its joint. Feet and their links are one body."""
    _, links = published
    model = tocabi.pin_model
    for name, mass, com, _, tensor in links:
        if "AnkleRoll" in name or "Foot" in name:
            continue
        frame = model.frames[model.getFrameId(name)]
        body = model.inertias[frame.parentJoint]
        ixx, iyy, izz, ixy, ixz, iyz = numbers(tensor)
        assert body.mass == pytest.approx(float(mass))
        np.testing.assert_allclose(body.lever, numbers(com), atol=1e-9)
        expected = [[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]]
        np.testing.assert_allclose(body.inertia, expected, atol=1e-9, err_msg=name)


def test_rotors_stand_in_the_inertias() -> None:
    """What the figures' docstring warns of: tensors that no rigid body has, always too large about the joint's own axis."""
    axis_of = {joint.child: joint.axis for joint in figures.JOINTS if joint.axis is not None}
    broken = []
    for link, inertia in figures.INERTIAS.items():
        ixx, iyy, izz, ixy, ixz, iyz = inertia.tensor
        moments, axes = np.linalg.eigh([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])
        if moments[2] > moments[0] + moments[1]:
            broken.append(link)
            # The wrists' hand frames are turned; every other axis is one of the link's own.
            if "Wrist2" not in link:
                assert abs(axes[:, 2] @ np.array(axis_of[link])) > 0.99, link
    assert "R_HipRoll_Link" in broken
    assert len(broken) > 20


def test_motors(tocabi: RobotModel) -> None:
    """The profile's torque limits are those of the URDF, and these the published ones."""
    expected = {
        "L_HipYaw_Joint": 333, "R_HipRoll_Joint": 232, "L_HipPitch_Joint": 263, "R_Knee_Joint": 289, "L_AnklePitch_Joint": 222,
        "R_AnkleRoll_Joint": 166, "Waist1_Joint": 303, "Upperbody_Joint": 303, "L_Shoulder1_Joint": 64, "R_Armlink_Joint": 64,
        "L_Elbow_Joint": 23, "R_Forearm_Joint": 23, "L_Wrist2_Joint": 10, "Neck_Joint": 10, "Head_Joint": 10,
    }  # fmt: skip
    effort = dict(zip(tocabi.joint_names, tocabi.pin_model.effortLimit[-33:], strict=True))
    assert {name: effort[name] for name in expected} == expected
    torque = tocabi.profile.torque
    assert torque.torque_limit == effort
    assert set(torque.stiffness) == set(torque.damping) == set(tocabi.joint_names)
    arm = ["Shoulder1", "Shoulder2", "Shoulder3", "Armlink", "Elbow", "Forearm", "Wrist1", "Wrist2"]
    assert [torque.stiffness[f"R_{name}_Joint"] for name in arm] == [200, 400, 200, 200, 125, 125, 25, 25]
    assert [torque.damping[f"L_{name}_Joint"] for name in arm] == [7, 5, 2.5, 2.5, 2.5, 2, 2, 2]


def test_arms(tocabi: RobotModel) -> None:
    """Shoulder: origin of Shoulder1 + (0, ±0.1491, 0.065), where three axes meet; the hand lies 0.7806 m out to the side."""
    data = at_zero(tocabi)

    def world(link: str, point: tuple[float, float, float]) -> np.ndarray:
        return np.asarray(data.oMf[tocabi.pin_model.getFrameId(link)].act(np.array(point)))

    for side, sign in (("Left", 1), ("Right", -1)):
        arm, prefix = tocabi.profile.arms[side], side[0]
        shoulder, hand = world(arm.shoulder_link, arm.shoulder_m), world(arm.hand_link, arm.hand_m)
        first = data.oMi[tocabi.pin_model.getJointId(f"{prefix}_Shoulder1_Joint")].translation
        np.testing.assert_allclose(shoulder - first, [0, sign * 0.1491, 0.065], atol=1e-9)
        third = data.oMi[tocabi.pin_model.getJointId(f"{prefix}_Shoulder3_Joint")].translation
        np.testing.assert_allclose(shoulder, third, atol=1e-9)
        # 0.1281 + 0.207 + 0.1244 + 0.1451 + 0.046 + 0.13; the hand frame's angles are published with four decimals
        np.testing.assert_allclose(hand - shoulder, [0, sign * 0.7806, 0], atol=1e-4)


def test_priorities_are_those_of_the_paper(tocabi: RobotModel) -> None:
    """[Lim2022 table II]: 3, 12 + 2, 4 and 4 degrees of freedom, on 21 joints."""
    rows = {"orientation": 3, "position": 3, "axis": 2}
    hierarchy = tocabi.profile.hierarchy
    assert [sum(rows[task.kind] for task in level.tasks) for level in hierarchy.levels] == [3, 14, 4, 4]
    assert [level.weight for level in hierarchy.levels] == [50, 50, 5, 5]
    assert [level.acceleration_s2 for level in hierarchy.levels] == [0, 0, 4e-5, 4e-5]
    assert len(hierarchy.joints) == 21
    assert not any(part in joint for joint in hierarchy.joints for part in ("Hip", "Knee", "Ankle"))
    assert hierarchy.extra_inertia == {"L_Shoulder1_Joint": 10.0, "R_Shoulder1_Joint": 10.0}
    assert (hierarchy.limit_gain, hierarchy.hand_speed_m_s, hierarchy.hand_rate_rad_s) == (20.0, 2.0, 6.0)
    assert hierarchy.inertia_diagonal == 0.02


def test_elbows_flex_forward_in_t_pose(tocabi: RobotModel) -> None:
    """More flexion from the reference posture moves both hands forward."""
    joints = tocabi.reference_posture.copy()
    for name, more in (("L_Elbow_Joint", -0.3), ("R_Elbow_Joint", 0.3)):
        joints[tocabi.joint_index(name)] += more
    data = tocabi.pin_model.createData()
    for side in "LR":
        frame = tocabi.pin_model.getFrameId(f"{side}_Wrist2_Link")
        pin.framesForwardKinematics(tocabi.pin_model, data, tocabi.configuration(tocabi.reference_posture))
        before = data.oMf[frame].translation.copy()
        pin.framesForwardKinematics(tocabi.pin_model, data, tocabi.configuration(joints))
        assert data.oMf[frame].translation[0] > before[0] + 0.05


def test_soles_carry_the_robot(tocabi: RobotModel) -> None:
    """Standing straight, the centre of mass lies above the feet."""
    data = tocabi.pin_model.createData()
    q = tocabi.configuration(tocabi.reference_posture)
    com = pin.centerOfMass(tocabi.pin_model, data, q)
    pin.framesForwardKinematics(tocabi.pin_model, data, q)
    corners = np.concatenate(
        [
            foot.sole @ data.oMf[tocabi.pin_model.getFrameId(foot.link)].rotation.T
            + data.oMf[tocabi.pin_model.getFrameId(foot.link)].translation
            for foot in tocabi.profile.feet.values()
        ]
    )
    np.testing.assert_allclose(corners[:, 2], -0.961, atol=1e-9)
    assert (corners[:, :2].min(axis=0) < com[:2]).all()
    assert (com[:2] < corners[:, :2].max(axis=0)).all()
