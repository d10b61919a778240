"""Every check of `retarget robots check` can fail: G1's and iCub's profiles with one fact made wrong at a time."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from retarget import robots
from retarget.core import robot_model
from retarget.core.errors import ProfileError
from retarget.core.profile import (
    Arm,
    CoupledJoints,
    Foot,
    Hand,
    JointLimit,
    ModelSource,
    RobotProfile,
    TposeException,
)
from retarget.core.report import Check, ValidationReport
from retarget.core.robot_check import check, tpose
from retarget.core.robot_urdf import read_urdf
from retarget.core.types import HumanMotion

G1 = robots.load("g1")


def report(profile: RobotProfile, **changed: Any) -> ValidationReport:
    return check(robot_model.build(replace(profile, **changed)))


def failed(found: ValidationReport) -> dict[str, Check]:
    return {entry.name: entry for entry in found.checks if entry.passed is False}


def entry(found: ValidationReport, name: str) -> Check:
    return next(check for check in found.checks if check.name == name)


def test_the_person_of_the_check_stands_upright_in_t_pose() -> None:
    motion = tpose(robot_model.build(G1))
    np.testing.assert_array_equal(motion.orientation, np.broadcast_to([1.0, 0.0, 0.0, 0.0], motion.orientation.shape))
    assert motion.measured.all()


def test_a_good_profile_passes_and_reports_the_posture() -> None:
    found = report(G1)
    assert found.passed
    assert found.subject == "g1"
    assert found.series["tpose_rad"].shape == (29,)
    assert entry(found, "degrees of freedom").value == 29
    assert entry(found, "mass").value == pytest.approx(33.34, abs=0.01)


def test_errors_are_those_of_forward_kinematics_in_the_reported_posture() -> None:
    """G1's left forearm in the solved T-pose, without any of the project's kinematics."""
    model = robot_model.build(G1)
    found = check(model)
    data, limb = model.pin_model.createData(), model.limbs["LeftForeArm"]
    pin.framesForwardKinematics(model.pin_model, data, model.configuration(found.series["tpose_rad"]))
    bone = data.oMf[model.pin_model.getFrameId(limb.link)].rotation @ limb.bone
    # The base's own orientation is solved too; it stands upright within 0.001°.
    expected = np.degrees(np.arccos(np.clip(bone @ [0.0, 1.0, 0.0], -1, 1)))
    assert entry(found, "T-pose LeftForeArm direction").value == pytest.approx(expected, abs=0.002)


class TestTpose:
    def test_a_joint_limit_in_the_way_fails_and_is_named(self) -> None:
        limits = {"left_shoulder_roll_joint": JointLimit(upper=1.2)}
        found = report(G1, joint_limits=limits)
        assert set(failed(found)) >= {"T-pose LeftUpperArm direction"}
        assert not any("Right" in name for name in failed(found))
        assert "left_shoulder_roll_joint at its limit" in failed(found)["T-pose LeftUpperArm direction"].note

    def test_an_exception_that_states_it_passes(self) -> None:
        shorter = {
            "joint_limits": {
                "left_shoulder_roll_joint": JointLimit(upper=1.2),
                "right_shoulder_roll_joint": JointLimit(lower=-1.2),
            },
            "reference_posture": {
                **G1.reference_posture,
                "left_shoulder_roll_joint": 1.2,
                "right_shoulder_roll_joint": -1.2,
            },
        }
        stated = {
            wrong.name.split()[1]: TposeException("left_shoulder_roll_joint", round(wrong.value or 0.0, 2))
            for wrong in failed(report(G1, **shorter)).values()
        }
        assert {"LeftUpperArm", "RightUpperArm"} <= set(stated)
        found = report(G1, **shorter, tpose_exceptions=stated)
        assert found.passed
        assert "the profile states" in entry(found, "T-pose LeftUpperArm direction").note

    def test_an_exception_of_the_wrong_size_fails(self) -> None:
        stated = {"LeftUpperArm": TposeException("left_shoulder_roll_joint", 3.0)}
        assert set(failed(report(G1, tpose_exceptions=stated))) & {
            f"T-pose {s}UpperArm direction" for s in ("Left", "Right")
        }

    def test_an_exception_that_no_limit_causes_fails(self) -> None:
        error = entry(report(G1), "T-pose LeftUpperArm direction").value
        assert error is not None
        stated = {"LeftUpperArm": TposeException("left_shoulder_roll_joint", error)}
        found = failed(report(G1, tpose_exceptions=stated))["T-pose LeftUpperArm direction"]
        assert "but left_shoulder_roll_joint is at no limit" in found.note

    def test_the_mirrored_t_pose_is_as_good(self) -> None:
        icub = robots.load("icub")
        exchanged = {
            ("Right" if s.startswith("Left") else "Left") + s.removeprefix("Left").removeprefix("Right")
            if s != "T8"
            else s: stated
            for s, stated in icub.tpose_exceptions.items()
        }
        assert exchanged != icub.tpose_exceptions
        assert report(icub, tpose_exceptions=exchanged).passed

    def test_a_palm_on_the_back_of_the_hand_fails(self) -> None:
        hand = G1.hands["Left"]
        turned = Hand(hand.link, hand.fingers, (-hand.palm[0], -hand.palm[1], -hand.palm[2]))
        assert "T-pose LeftHand orientation" in failed(report(G1, hands={**G1.hands, "Left": turned}))

    def test_a_base_that_faces_backward_fails(self) -> None:
        """The trunk's constants come from the reference posture with the base turned as the profile says; the limbs' do not."""
        found = report(robots.load("icub"), base_rpy=(0.0, 0.0, 0.0))
        assert {"T-pose LeftUpperArm direction", "T-pose LeftUpperLeg direction"} & set(failed(found))

    def test_left_and_right_exchanged_fails(self) -> None:
        links = {
            s: G1.links[("Right" if s.startswith("Left") else "Left") + s[4 if s.startswith("Left") else 5 :]]
            if s.startswith(("Left", "Right"))
            else link
            for s, link in G1.links.items()
        }
        assert "UpperArm left of the right one" in failed(report(G1, links=links))


class TestSkewedHinges:
    """Atlas' shoulder axes miss each other by 16 mm, so its upper arm's bone is not square to the elbow's axis; the forearm's is."""

    def test_without_its_exceptions_it_fails_and_says_why(self) -> None:
        found = failed(report(robots.load("atlas"), tpose_exceptions={}))
        assert set(found) == {
            f"T-pose {s}{part} direction" for s in ("Left", "Right") for part in ("UpperArm", "ForeArm")
        }
        note = found["T-pose LeftUpperArm direction"].note
        told = re.search(r"l_arm_elx keeps its bones ([\d.]+)° out of line", note)
        assert told is not None
        # 16 mm across 0.361 m along the arm and 9 mm forward, from the shoulder's centre to the elbow's
        assert float(told[1]) == pytest.approx(np.degrees(np.arctan2(0.016, np.hypot(0.361, 0.0092))), abs=0.02)

    def test_an_exception_that_names_another_joint_fails(self) -> None:
        atlas = robots.load("atlas")
        stated = {s: TposeException("l_arm_wry", entry.error_deg) for s, entry in atlas.tpose_exceptions.items()}
        found = failed(report(atlas, tpose_exceptions=stated))
        assert "but l_arm_wry is at no limit" in found["T-pose LeftUpperArm direction"].note


class TestModel:
    def test_a_placeholder_speed_fails(self) -> None:
        found = report(G1, joint_limits={"waist_yaw_joint": JointLimit(velocity=100.0)})
        assert failed(found)["largest joint speed"].note == "waist_yaw_joint"

    def test_a_joint_without_range_fails(self) -> None:
        found = report(G1, joint_limits={"waist_yaw_joint": JointLimit(lower=0.0, upper=0.0)})
        assert failed(found)["smallest joint range"].note == "waist_yaw_joint"

    def test_a_reference_posture_beyond_the_limits_fails(self) -> None:
        posture = {**G1.reference_posture, "left_shoulder_roll_joint": 2.5}
        found = failed(report(G1, reference_posture=posture))["reference posture outside the joint limits"]
        assert found.value == pytest.approx(2.5 - 2.2515)
        assert found.note == "left_shoulder_roll_joint"

    def test_a_reference_posture_beyond_a_coupled_row_fails(self) -> None:
        row = CoupledJoints(
            ("left_elbow_joint", "left_wrist_roll_joint"), np.array([[1.0, 1.0]]), np.array([-9.0]), np.array([1.0])
        )
        found = failed(report(G1, coupled=(row,)))["reference posture outside the coupled rows"]
        assert found.value == pytest.approx(0.5708, abs=1e-4)


class TestHints:
    """What a failed check tells the one who writes the profile."""

    BENT = MappingProxyType({f"{side}_elbow_joint": JointLimit(1.0, 1.3, 20.0) for side in ("left", "right")})
    """Elbows that stay 15° short of straight."""

    def test_the_line_that_states_an_exception_makes_the_check_pass(self) -> None:
        posture = {**G1.reference_posture, "left_elbow_joint": 1.3, "right_elbow_joint": 1.3}
        found = report(G1, joint_limits=self.BENT, reference_posture=posture)
        told = [
            re.search(r'(\w+) = { joint = "(\w+)", error_deg = ([\d.]+) }$', c.note) for c in failed(found).values()
        ]
        assert told
        assert all(told)
        stated = {m[1]: TposeException(m[2], float(m[3])) for m in told if m}
        assert {name.removeprefix("T-pose ").split()[0] for name in failed(found)} == set(stated)
        assert report(G1, joint_limits=self.BENT, reference_posture=posture, tpose_exceptions=stated).passed

    def test_only_joints_that_move_the_segment_are_named(self) -> None:
        """The knees are at a limit, too, but no arm hangs on them."""
        knees = {f"{side}_knee_joint": JointLimit(0.0, 2.0, 20.0) for side in ("left", "right")}
        posture = {**G1.reference_posture, "left_elbow_joint": 1.3, "right_elbow_joint": 1.3}
        found = failed(report(G1, joint_limits={**self.BENT, **knees}, reference_posture=posture))
        for name, check_ in found.items():
            assert ("left_" in check_.note) == ("Left" in name)
            assert "knee" not in check_.note

    def test_a_wrong_link_is_suspected_where_no_joint_is_at_its_limit(self) -> None:
        """The upper arm twists behind this link, so it does not turn with its bone."""
        found = failed(report(G1, links={**G1.links, "LeftUpperArm": "left_shoulder_roll_link"}))
        assert "are the link, reference_posture_rad and base_rpy_rad right?" in " ".join(c.note for c in found.values())

    def test_a_robot_that_faces_away_is_asked_for_its_upright_pose(self) -> None:
        told = entry(report(G1, base_rpy=(0.0, 0.0, np.pi)), "UpperLeg left of the right one")
        assert told.passed is False
        assert "base_rpy_rad" in told.note

    def test_segments_without_a_link_are_listed(self) -> None:
        assert entry(report(G1), "segments without a link").note == "Head"

    def test_a_profile_that_maps_nothing_is_refused(self) -> None:
        with pytest.raises(ProfileError, match=r"\[links\]: no segment has a link; expected"):
            report(G1, links={}, hands={}, mappings={})


class TestHandsAndFeet:
    @pytest.mark.parametrize(
        ("move", "name"),
        [
            (lambda sole: sole + np.outer([0, 0, 0, 1], [0, 0, 0.003]), "Left sole out of level in T-pose"),
            (lambda sole: sole * [1, 1, -1], "Left ankle above its sole"),
            (lambda sole: sole - [0, 0, 0.003], "soles at different heights"),
        ],
    )
    def test_a_wrong_sole_fails(self, move: Callable[[Any], Any], name: str) -> None:
        foot = G1.feet["Left"]
        found = failed(report(G1, feet={**G1.feet, "Left": Foot(foot.link, move(foot.sole))}))
        assert name in found

    def test_fingers_along_the_palm_fail(self) -> None:
        tilted = Hand(G1.hands["Left"].link, (1.0, 0.0, 0.0), (0.1, -0.995, 0.0))
        found = report(G1, hands={**G1.hands, "Left": tilted})
        assert "Left hand: fingers and palm not unit and perpendicular" in failed(found)

    def test_limbs_of_different_lengths_fail(self) -> None:
        """The left wrist's centre taken from the wrong place: the forearm ends at the elbow's own link tip."""
        found = report(G1, limb_ends={"LeftForeArm": "left_wrist_yaw_link"})
        assert "ForeArm left against right" in failed(found)


class TestArms:
    def arms(self, **changed: Any) -> dict[str, Arm]:
        """G1's, the left one changed."""
        return {**G1.arms, "Left": replace(G1.arms["Left"], **changed)}

    def test_the_length_is_from_shoulder_to_hand_point(self) -> None:
        """G1's arm, stretched: its joints' offsets along the arm, added up by hand."""
        found = entry(report(G1), "Left arm length")
        # shoulder to yaw joint, to elbow, to wrist roll, pitch, yaw, hand point; 1 mm for offsets across the arm
        along = (0.2438 - 0.1387) + 0.0805 + 0.1 + 0.038 + 0.046 + 0.107
        assert found.value == pytest.approx(along, abs=1e-3)

    @pytest.mark.parametrize(("factor", "passes"), [(0.96, True), (1.04, True), (0.94, False), (1.06, False)])
    def test_a_typed_length_must_fit_the_geometry(self, factor: float, passes: bool) -> None:
        measured = entry(report(G1), "Left arm length").value
        assert measured is not None
        found = report(G1, arms=self.arms(length_m=factor * measured))
        off = entry(found, "Left arm length off")
        assert off.value == pytest.approx(100 * abs(factor - 1), abs=1e-6)
        assert off.passed is passes
        assert found.passed is passes

    def test_a_hand_point_at_the_shoulder_is_no_arm(self) -> None:
        arm = G1.arms["Left"]
        found = failed(report(G1, arms=self.arms(hand_link=arm.shoulder_link, hand_m=arm.shoulder_m, length_m=0.5)))
        assert {"Left arm length", "Left arm length off"} <= set(found)

    @pytest.mark.parametrize(("part", "name"), [("shoulder_m", "shoulder"), ("hand_m", "hand point")])
    def test_points_that_do_not_mirror_fail(self, part: str, name: str) -> None:
        x, y, z = getattr(G1.arms["Left"], part)
        moved = report(G1, arms=self.arms(**{part: (x, y, z + 0.003)}))
        assert set(failed(moved)) == {f"{name} left against right"}
        assert entry(moved, f"{name} left against right").value == pytest.approx(3.0, abs=0.05)
        assert report(G1, arms=self.arms(**{part: (x, y, z + 0.001)})).passed

    def test_one_arm_alone_is_not_compared(self) -> None:
        found = report(G1, arms={"Left": G1.arms["Left"]})
        assert found.passed
        assert not [c for c in found.checks if c.name.startswith(("Right arm", "hand point", "shoulder "))]


def test_a_robot_without_limbs_says_that_nothing_was_checked() -> None:
    found = report(G1, links={"Pelvis": "pelvis", "T8": "torso_link"}, hands={})
    assert entry(found, "T-pose directions").passed is None
    assert found.passed


def test_the_person_is_held_against_its_own_bones(make_motion: Callable[..., HumanMotion]) -> None:
    """Forearms that leave the wrist 3° off the axis, as Xsens' do: the robot has the same bones, so nothing is wrong."""
    motion = make_motion([0.0])
    offsets = {**motion.joint_offsets, "LeftHand": 0.25 * np.array([np.sin(0.05), np.cos(0.05), 0.0])}
    model = robot_model.build(robots.load("human"), replace(motion, joint_offsets=offsets))
    assert entry(check(model), "T-pose LeftForeArm direction").value == pytest.approx(0.0, abs=1e-3)


def test_the_simulation_model_is_checked() -> None:
    found = report(G1)
    assert entry(found, "simulated mass off").passed
    assert entry(found, "simulated degrees of freedom off").value == 0.0
    assert entry(found, "links with an inertia that no body can have").value == 0.0


def test_links_that_touch_in_the_reference_posture_fail() -> None:
    """Forearms folded back onto the upper arms, hands in the chest."""
    posture = {"left_shoulder_yaw_joint": -1.5, "left_elbow_joint": 0.0, "left_shoulder_pitch_joint": 0.0}
    found = failed(report(G1, reference_posture=posture))
    check = found["pairs of links touching in the reference posture"]
    assert check.value >= 1
    assert "torso_link" in check.note
    assert "left_wrist" in check.note


def test_shapes_that_are_not_there_are_counted(tmp_path: Path) -> None:
    path = tmp_path / "robot.urdf"
    path.write_bytes(read_urdf(G1))
    found = report(G1, model=ModelSource("file", str(path)))
    check = entry(found, "shapes left out")
    assert check.passed is None
    assert check.note.startswith("24 × mesh not found (collision): package://")


def test_a_model_that_cannot_be_simulated_fails_with_the_reason(tmp_path: Path) -> None:
    path = tmp_path / "robot.urdf"
    path.write_bytes(re.sub(rb'<mesh filename="[^"]*"', b'<mesh filename="bad.stl"', read_urdf(G1)))
    (tmp_path / "bad.stl").write_bytes(b"nothing")
    assert "bad.stl" in failed(report(G1, model=ModelSource("file", str(path))))["simulation model"].note
