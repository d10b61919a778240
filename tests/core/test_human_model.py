"""The person as a robot: against the recording it is built from, SciPy's Euler angles and the facts of the authors' model."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from retarget import robots
from retarget.core import human_model, robot_model, rotations
from retarget.core.errors import MotionError
from retarget.core.robot_check import check
from retarget.core.robot_model import RobotModel
from retarget.core.segments import PARENT, SEGMENTS
from retarget.core.types import Array, HumanMotion
from scipy.spatial.transform import Rotation

MotionFactory = Callable[..., HumanMotion]
SIX_TRACKERS = ("Pelvis", "T8", "Head", "RightUpperArm", "RightHand", "LeftUpperArm", "LeftHand")


@pytest.fixture
def moving(make_motion: MotionFactory) -> HumanMotion:
    """Twenty frames, every segment turned at random but never by much: no joint near the middle hinge's 90°."""
    generator = np.random.default_rng(8)
    world: dict[str, Array] = {}
    for segment, parent in PARENT.items():
        own = rotations.exp(generator.uniform(-0.7, 0.7, (20, 3)))
        world[segment] = own if parent is None else rotations.multiply(world[parent], own)
    return make_motion(np.arange(20) / 60, world, pelvis=generator.normal(size=(20, 3)))


def only(motion: HumanMotion, segments: tuple[str, ...], **fields: object) -> HumanMotion:
    keep = [motion.index(segment) for segment in segments]
    facts: dict[str, object] = {
        "segments": segments,
        "orientation": motion.orientation[:, keep],
        "position": motion.position[:, keep],
        "measured": motion.measured[keep],
    }
    return replace(motion, **{**facts, **fields})  # type: ignore[arg-type]  # fields of HumanMotion


def build(motion: HumanMotion) -> RobotModel:
    return robot_model.build(robots.load("human"), motion)


def posture(model: RobotModel, motion: HumanMotion, frame: int) -> Array:
    """pinocchio's q that puts every segment as recorded: angles about x, y, z in turn, by SciPy."""
    joints = np.zeros(len(model.joint_names))
    for segment, name in human_model.JOINT.items():
        if segment in motion.segments:
            parent = PARENT[segment]
            while parent not in motion.segments:
                parent = PARENT[parent]  # type: ignore[index]  # the pelvis is there
            q = [motion.orientation[frame, motion.index(s)] for s in (parent, segment)]
            relative = Rotation.from_quat(q[0], scalar_first=True).inv() * Rotation.from_quat(q[1], scalar_first=True)
            for axis, angle in zip("xyz", relative.as_euler("XYZ"), strict=True):
                joints[model.joint_index(f"{name}_rot{axis}")] = angle
    root = motion.index(model.base_link)
    return model.configuration(joints, motion.orientation[frame, root], motion.position[frame, root])


@pytest.mark.parametrize("segments", [SEGMENTS, SIX_TRACKERS])
def test_every_posture_of_the_recording_is_reached_exactly(moving: HumanMotion, segments: tuple[str, ...]) -> None:
    """With joint offsets dropped where trackers skip segments, only rigid chains would fit: there T-pose distances must."""
    motion = moving if segments == SEGMENTS else only(moving, segments, joint_offsets={})
    model = build(motion)
    data = model.pin_model.createData()
    for frame in range(motion.frames):
        pin.framesForwardKinematics(model.pin_model, data, posture(model, motion, frame))
        for i, segment in enumerate(motion.segments):
            placement = data.oMf[model.pin_model.getFrameId(segment)]
            expected = rotations.to_matrix(motion.orientation[frame, i])
            np.testing.assert_allclose(placement.rotation, expected, atol=1e-12)
            if segments == SEGMENTS:
                np.testing.assert_allclose(placement.translation, motion.position[frame, i], atol=1e-12)


def test_zero_is_the_t_pose(make_motion: MotionFactory) -> None:
    motion = make_motion([0.0])
    model = build(motion)
    data = model.pin_model.createData()
    zero = model.configuration(np.zeros(66), base_position=motion.position[0, motion.index("Pelvis")])
    pin.framesForwardKinematics(model.pin_model, data, zero)
    for i, segment in enumerate(motion.segments):
        placement = data.oMf[model.pin_model.getFrameId(segment)]
        np.testing.assert_allclose(placement.rotation, np.eye(3), atol=1e-15)
        np.testing.assert_allclose(placement.translation, motion.position[0, i], atol=1e-12)


def test_the_solved_t_pose_reproduces_the_joint_offsets(make_motion: MotionFactory) -> None:
    motion = make_motion([0.0])
    model = build(motion)
    data = model.pin_model.createData()
    pin.framesForwardKinematics(model.pin_model, data, model.configuration(check(model).series["tpose_rad"]))
    for segment, offset in motion.joint_offsets.items():
        parent, child = (data.oMf[model.pin_model.getFrameId(s)] for s in (PARENT[segment], segment))
        np.testing.assert_allclose(parent.actInv(child.translation), offset, atol=1e-6)


def test_lengths_are_averaged_from_positions_where_the_recording_names_none(moving: HumanMotion) -> None:
    measured = human_model.joint_offsets(replace(moving, joint_offsets={}))
    named = human_model.joint_offsets(moving)
    assert set(measured) == set(named) == set(SEGMENTS) - {"Pelvis"}
    for segment, offset in named.items():
        np.testing.assert_allclose(measured[segment], offset, atol=1e-12)


def test_the_mean_is_taken_in_the_parents_frame(moving: HumanMotion) -> None:
    """Noise of zero mean on the positions, as the parent sees it, must cancel."""
    noise = np.where(np.arange(20) % 2, 0.03, -0.03)[:, None] * [1.0, 2.0, -1.0]
    position = np.array(moving.position)
    parent, hand = moving.index("LeftForeArm"), moving.index("LeftHand")
    position[:, hand] += rotations.rotate(moving.orientation[:, parent], noise)
    found = human_model.joint_offsets(replace(moving, position=position, joint_offsets={}))
    np.testing.assert_allclose(found["LeftHand"], moving.joint_offsets["LeftHand"], atol=1e-12)


class TestSparse:
    def test_links_hang_from_the_nearest_segment_there_is(self, make_motion: MotionFactory) -> None:
        model = build(only(make_motion([0.0]), SIX_TRACKERS))
        assert len(model.joint_names) == 3 * (len(SIX_TRACKERS) - 1)
        assert set(model.links) == set(SIX_TRACKERS)
        data = model.pin_model.createData()
        pin.framesForwardKinematics(model.pin_model, data, model.configuration(np.zeros(18)))
        hand, upper = (data.oMf[model.pin_model.getFrameId(s)].translation for s in ("LeftHand", "LeftUpperArm"))
        np.testing.assert_allclose(hand - upper, [0.0, 0.55, 0.0], atol=1e-12)  # upper arm 0.30 and forearm 0.25

    def test_an_offset_to_a_missing_parent_is_not_used(self, make_motion: MotionFactory) -> None:
        """The recording names where the hand starts on the forearm; here it hangs from the upper arm."""
        found = human_model.joint_offsets(only(make_motion([0.0]), SIX_TRACKERS))
        np.testing.assert_allclose(found["RightHand"], [0.0, -0.55, 0.0], atol=1e-12)

    def test_without_a_pelvis_the_chest_is_the_root(self, make_motion: MotionFactory) -> None:
        model = build(only(make_motion([0.0]), SIX_TRACKERS[1:]))
        assert model.base_link == "T8"

    def test_several_roots_are_refused(self, make_motion: MotionFactory) -> None:
        with pytest.raises(MotionError, match=r"^Head, RightHand hang from nothing"):
            build(only(make_motion([0.0]), ("Head", "RightHand")))

    def test_feet_without_toes_have_no_soles(self, make_motion: MotionFactory) -> None:
        legs = tuple(segment for segment in SEGMENTS if not segment.endswith("Toe"))
        assert build(only(make_motion([0.0]), legs)).profile.feet == {}


def test_a_segment_of_unknown_place_is_refused(make_motion: MotionFactory) -> None:
    motion = make_motion([0.0, 0.1])
    position = np.array(motion.position)
    position[:, motion.index("Head")] = np.nan
    known = build(replace(motion, position=position))
    assert "jC1Head_rotx" in known.joint_names
    with pytest.raises(MotionError, match="no length from Neck to Head: the recording has neither joint offsets nor"):
        build(replace(motion, position=position, joint_offsets={}))


def test_a_limb_without_length_is_refused(make_motion: MotionFactory) -> None:
    motion = make_motion([0.0])
    offsets = {**motion.joint_offsets, "LeftForeArm": np.zeros(3)}
    with pytest.raises(MotionError, match="LeftForeArm starts where LeftUpperArm does"):
        build(replace(motion, joint_offsets=offsets))


def test_masses_add_up_and_inertias_are_those_of_real_bodies(make_motion: MotionFactory) -> None:
    assert sum(human_model.MASS_FRACTION.values()) == pytest.approx(1.0, abs=1e-12)
    model = build(make_motion([0.0]))
    assert model.mass_kg == pytest.approx(human_model.BODY_MASS_KG)
    for link in ET.fromstring(model.urdf).iter("link"):
        inertial = link.find("inertial")
        if inertial is not None:
            entry = inertial.find("inertia").attrib  # type: ignore[union-attr]  # our own text
            tensor = np.array([[float(entry[f"i{min(a, b)}{max(a, b)}"]) for b in "xyz"] for a in "xyz"])
            principal = np.linalg.eigvalsh(tensor)
            assert principal[0] > 0
            assert principal[0] + principal[1] >= principal[2]  # no body has more: the triangle inequality


def test_a_cylinder_by_hand(make_motion: MotionFactory) -> None:
    """The left upper arm: 0.30 m along y, 3 % of 72 kg, density 1050 kg/m³."""
    root = ET.fromstring(human_model.human_urdf(make_motion([0.0])))
    link = next(link for link in root.iter("link") if link.get("name") == "LeftUpperArm")
    inertial = link.find("inertial")
    assert inertial is not None
    values = {e.tag: e.attrib for e in inertial}
    mass, squared = 2.16, 2.16 / (np.pi * 1050 * 0.30)
    assert float(values["mass"]["value"]) == pytest.approx(mass)
    np.testing.assert_allclose([float(x) for x in values["origin"]["xyz"].split()], [0.0, 0.15, 0.0], atol=1e-12)
    assert float(values["inertia"]["iyy"]) == pytest.approx(mass * squared / 2)
    assert float(values["inertia"]["ixx"]) == pytest.approx(mass * (3 * squared + 0.09) / 12)
    assert float(values["inertia"]["izz"]) == pytest.approx(mass * (3 * squared + 0.09) / 12)
    assert float(values["inertia"]["ixy"]) == pytest.approx(0.0, abs=1e-12)


def test_soles_are_level_with_the_balls_of_the_feet(make_motion: MotionFactory) -> None:
    feet = build(make_motion([0.0])).profile.feet
    assert set(feet) == {"Left", "Right"}
    for side, foot in feet.items():
        assert foot.link == f"{side}Foot"
        np.testing.assert_allclose(foot.sole[:, 2], -0.09)
        assert foot.sole[:, 0].max() == pytest.approx(0.15)  # the ball: in front of it the toes bend
        assert foot.sole[:, 0].min() < 0
        assert foot.sole[:, 1].max() == pytest.approx(-foot.sole[:, 1].min())


# --- the authors' model -----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def facts() -> tuple[list[list[str]], list[list[str]]]:
    """Rows of the two tables: joints (joint, type, parent, child, xyz, rpy, axis, …) and links (link, mass, com, …)."""
    path = Path(__file__).resolve().parents[3] / "shared" / "facts" / "human-66dof.md"
    if not path.is_file():
        pytest.skip("the facts of the authors' human model (../shared/facts) are not on this machine")
    rows = [
        [cell.strip() for cell in line.strip("|\n").split("|")] for line in path.read_text().splitlines() if "|" in line
    ]
    joints = [row for row in rows if re.match(r"j[A-Z]", row[0])]
    links = [row for row in rows if len(row) == 5 and re.match(r"[\d.]", row[1])]
    assert (len(joints), len(links)) == (68, 69)
    return joints, links


@pytest.fixture(scope="module")
def authors_twin(facts: tuple[list[list[str]], list[list[str]]]) -> ET.Element:
    """Our URDF of a person with the authors' joint offsets."""
    inverse = {f"{name}_rotx": segment for segment, name in human_model.JOINT.items()}
    offsets = {inverse[row[0]]: np.array(row[4].split(), float) for row in facts[0] if row[0] in inverse}
    position = {"Pelvis": np.zeros(3)}
    for segment, parent in PARENT.items():
        if parent is not None:
            position[segment] = position[parent] + offsets[segment]
    still = np.tile([1.0, 0.0, 0.0, 0.0], (1, 23, 1))
    motion = HumanMotion(
        np.zeros(1), SEGMENTS, still, np.array([[position[s] for s in SEGMENTS]]), joint_offsets=offsets
    )
    return ET.fromstring(human_model.human_urdf(motion))


def test_joints_are_the_authors(facts: tuple[list[list[str]], list[list[str]]], authors_twin: ET.Element) -> None:
    ours = {joint.get("name"): joint for joint in authors_twin.iter("joint")}
    assert set(ours) == {row[0] for row in facts[0]}
    for name, kind, parent, child, xyz, _, axis, *_ in facts[0]:
        joint = ours[name]
        assert joint.get("type") == kind
        found = {e.tag: e.attrib for e in joint}
        assert (found["parent"]["link"], found["child"]["link"]) == (parent, child)
        if kind == "revolute":
            np.testing.assert_allclose(
                [float(x) for x in found["origin"]["xyz"].split()], [float(x) for x in xyz.split()]
            )
            assert [float(x) for x in found["axis"]["xyz"].split()] == [float(x) for x in axis.split()]


def test_links_and_shares_of_mass_are_the_authors(
    facts: tuple[list[list[str]], list[list[str]]], authors_twin: ET.Element
) -> None:
    ours = {str(link.get("name")): link for link in authors_twin.iter("link")}
    assert set(ours) == {row[0] for row in facts[1]}
    total = sum(float(row[1]) for row in facts[1])
    for name, mass, centre, *_ in facts[1]:
        entry = ours[name].find("inertial/mass")
        share = 0.0 if entry is None else float(entry.attrib["value"]) / human_model.BODY_MASS_KG
        assert share == pytest.approx(float(mass) / total, abs=5e-5)
        if share > 0 and not name.endswith(
            ("Head", "Foot", "Toe", "Hand")
        ):  # theirs are boxes with bounds of their own
            origin = ours[name].find("inertial/origin")
            assert origin is not None
            ours_centre = [float(x) for x in origin.attrib["xyz"].split()]
            np.testing.assert_allclose(ours_centre, [float(x) for x in centre.split()], atol=1e-3)
