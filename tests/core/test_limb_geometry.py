"""Joint centres, bones and hinges: a robot with known answers, and what must hold on every real one by forward kinematics alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from retarget import robots
from retarget.core import robot_model, rotations
from retarget.core.errors import ProfileError
from retarget.core.limb_geometry import Limb, find_limbs
from retarget.core.profile import ModelSource, RobotProfile
from retarget.core.robot_model import RobotModel
from retarget.core.types import Array, HumanMotion
from scipy.spatial.transform import Rotation

SHOULDER, ELBOW, WRIST = np.array([0.0, 0.2, 0.5]), np.array([0.02, 0.5, 0.5]), np.array([0.0, 0.75, 0.5])
HIP, KNEE, ANKLE = np.array([0.0, 0.1, 0.0]), np.array([0.03, 0.1, -0.4]), np.array([0.0, 0.1, -0.8])

# (joint, child link, where its axis passes, axis, range). Origins lie anywhere on their axes: only the axes may count.
ARM = [
    ("shoulder_x", "s1", SHOULDER + np.array([0.05, 0, 0]), (1, 0, 0), (-3, 3)),
    ("shoulder_z", "s2", SHOULDER - np.array([0, 0, 0.03]), (0, 0, 1), (-3, 3)),
    ("shoulder_y", "upper", SHOULDER + np.array([0, 0.1, 0]), (0, 1, 0), (-3, 3)),
    ("elbow", "lower", ELBOW + np.array([0, 0, 0.07]), (0, 0, 1), (-2.3, 0.2)),
    ("wrist_y", "w1", WRIST - np.array([0, 0.1, 0]), (0, 1, 0), (-2, 2)),
    ("wrist_x", "w2", WRIST + np.array([0.04, 0, 0]), (1, 0, 0), (-1, 1)),
    ("wrist_z", "hand", WRIST, (0, 0, 1), (-1, 1)),
]
LEG = [
    ("hip_z", "h1", HIP + np.array([0, 0, 0.1]), (0, 0, 1), (-2, 2)),
    ("hip_x", "h2", HIP, (1, 0, 0), (-1, 1)),
    ("hip_y", "thigh", HIP - np.array([0, 0.02, 0]), (0, 1, 0), (-2, 2)),
    ("knee", "shank", KNEE + np.array([0, 0.05, 0]), (0, 1, 0), (-0.1, 2.4)),
    ("ankle_y", "a1", ANKLE, (0, 1, 0), (-1, 1)),
    ("ankle_x", "foot", ANKLE, (1, 0, 0), (-1, 1)),
]
LINKS = {
    "UpperArm": "upper",
    "ForeArm": "lower",
    "Hand": "hand",
    "UpperLeg": "thigh",
    "LowerLeg": "shank",
    "Foot": "foot",
}


def unit(vector: Array) -> Array:
    return vector / np.linalg.norm(vector)


def urdf(*, mirrored: bool = False, flipped: tuple[str, ...] = (), frames: int | None = None) -> str:
    """The robot above; mirrored to the right side, with the axes of `flipped` joints turned round, with link frames turned at random."""
    generator = np.random.default_rng(frames)
    text = ["<link name='base'/>"]
    for chain in (ARM, LEG):
        parent, above, at = "base", np.eye(3), np.zeros(3)
        for joint, child, origin, axis, (low, high) in chain:
            point, direction = np.array(origin), np.array(axis, float)
            if mirrored:  # a mirrored turn goes the other way: the axis is mirrored and turned round
                point, direction = point * [1, -1, 1], direction * [-1, 1, -1]
            if joint in flipped:
                direction, low, high = -direction, -high, -low
            own = np.eye(3) if frames is None else Rotation.random(rng=generator).as_matrix()
            place, turn = above.T @ (point - at), Rotation.from_matrix(above.T @ own).as_euler("xyz")
            numbers = [" ".join(f"{x:.17g}" for x in v) for v in (place, turn, own.T @ direction)]
            text.append(
                f"<link name='{child}'/><joint name='{joint}' type='revolute'><parent link='{parent}'/>"
                f"<child link='{child}'/><origin xyz='{numbers[0]}' rpy='{numbers[1]}'/><axis xyz='{numbers[2]}'/>"
                f"<limit lower='{low}' upper='{high}' velocity='1' effort='1'/></joint>"
            )
            parent, above, at = child, own, point
    return f"<robot name='arm_and_leg'>{''.join(text)}</robot>"


def profile(side: str = "Left", **changed: Any) -> RobotProfile:
    links = {f"{side}{part}": link for part, link in LINKS.items()}
    facts: dict[str, Any] = {
        "name": "x",
        "description": "",
        "model": ModelSource("file"),
        "base": "fixed",
        "links": links,
    }
    return RobotProfile(**{**facts, **changed})


def limbs(text: str, of: RobotProfile, posture: dict[str, float] | None = None) -> dict[str, tuple[Limb, Any]]:
    """Segment → the limb and its link's placement (SE3) in the zero posture, in which link frames meet the points above."""
    model = pin.buildModelFromXML(text)
    joints = np.zeros(model.nq)
    for name, value in (posture or {}).items():
        joints[model.joints[model.getJointId(name)].idx_q] = value
    found = find_limbs(model, of, joints)
    data = model.createData()
    pin.framesForwardKinematics(model, data, np.zeros(model.nq))
    return {segment: (limb, data.oMf[model.getFrameId(limb.link)].copy()) for segment, limb in found.items()}


@pytest.mark.parametrize("frames", [None, 1, 2])
def test_centres_are_where_axes_meet_wherever_frames_and_origins_lie(frames: int | None) -> None:
    found = limbs(urdf(frames=frames), profile())
    ends = {
        "LeftUpperArm": (SHOULDER, ELBOW),
        "LeftForeArm": (ELBOW, WRIST),
        "LeftUpperLeg": (HIP, KNEE),
        "LeftLowerLeg": (KNEE, ANKLE),
    }
    assert set(found) == set(ends)
    for segment, (limb, placement) in found.items():
        for point, expected in zip((limb.proximal, limb.distal), ends[segment], strict=True):
            np.testing.assert_allclose(placement.act(point), expected, atol=2e-6)


def expected_rotation(bone: Array, hinge: Array, *, arm: bool, left: bool) -> Array:
    """World ← segment axes of a limb: y along the left arm's bone, z its hinge; a leg's z against the bone, y its hinge."""
    hinge = unit(hinge - (hinge @ bone) * bone)
    y, z = ((bone if left else -bone), hinge) if arm else (hinge, -bone)
    return np.column_stack([np.cross(y, z), y, z])


@pytest.mark.parametrize("frames", [None, 3])
@pytest.mark.parametrize("flipped", [(), ("elbow", "knee"), ("shoulder_y", "hip_x", "wrist_z")])
@pytest.mark.parametrize("side", ["Left", "Right"])
def test_the_constant_rotation_turns_segment_axes_onto_bone_and_hinge(
    side: str, flipped: tuple[str, ...], frames: int | None
) -> None:
    """H_R_R of a link = (world ← segment)ᵀ (world ← link); which way a joint's axis counts must not matter."""
    found = limbs(urdf(mirrored=side == "Right", flipped=flipped, frames=frames), profile(side))
    mirror = np.array([1.0, 1.0 if side == "Left" else -1.0, 1.0])
    points = {
        "UpperArm": (SHOULDER, ELBOW),
        "ForeArm": (ELBOW, WRIST),
        "UpperLeg": (HIP, KNEE),
        "LowerLeg": (KNEE, ANKLE),
    }
    for part, (start, end) in points.items():
        limb, placement = found[f"{side}{part}"]
        arm = part.endswith("Arm")
        hinge = np.array([0.0, 0.0, 1.0] if arm else [0.0, 1.0, 0.0])
        segment = expected_rotation(unit(mirror * (end - start)), hinge, arm=arm, left=side == "Left")
        assert limb.rotation is not None
        np.testing.assert_allclose(limb.rotation, segment.T @ placement.rotation, atol=1e-5)


def test_a_bent_reference_posture_gives_the_same_constants() -> None:
    """These axes meet, so the limb's own frame knows all; the elbow's side of flexion is counted from the straight arm."""
    posture = {
        "shoulder_x": 0.3,
        "shoulder_z": -0.2,
        "shoulder_y": 0.4,
        "elbow": -0.9,
        "knee": 1.1,
        "hip_y": -0.4,
        "wrist_x": 0.2,
    }
    straight, bent = limbs(urdf(frames=4), profile()), limbs(urdf(frames=4), profile(), posture)
    for segment, (limb, _) in straight.items():
        np.testing.assert_allclose(bent[segment][0].rotation, limb.rotation, atol=1e-4)
        np.testing.assert_allclose(bent[segment][0].distal, limb.distal, atol=1e-4)


def test_a_limb_may_end_at_a_link_of_its_own() -> None:
    of = profile(links={"LeftUpperArm": "upper", "LeftForeArm": "lower"}, limb_ends={"LeftForeArm": "w2"})
    limb, placement = limbs(urdf(), of)["LeftForeArm"]
    np.testing.assert_allclose(placement.act(limb.distal), WRIST + np.array([0.04, 0, 0]), atol=1e-9)


def test_a_forearm_without_hand_or_end_is_no_limb() -> None:
    found = limbs(urdf(), profile(links={"LeftUpperArm": "upper", "LeftForeArm": "lower"}))
    assert set(found) == {"LeftUpperArm"}
    np.testing.assert_allclose(found["LeftUpperArm"][1].act(found["LeftUpperArm"][0].proximal), SHOULDER, atol=2e-6)


def test_an_elbow_of_two_joints_has_no_hinge() -> None:
    of = profile(links={"LeftUpperArm": "upper", "LeftForeArm": "w1", "LeftHand": "hand"})
    limb, _ = limbs(urdf(), of)["LeftUpperArm"]
    assert limb.hinge is None
    assert limb.rotation is None


@pytest.mark.parametrize(
    "links",
    [
        {"LeftUpperArm": "lower", "LeftForeArm": "upper", "LeftHand": "hand"},
        {"LeftUpperArm": "upper", "LeftForeArm": "upper", "LeftHand": "hand"},
        {"LeftUpperArm": "upper", "LeftForeArm": "shank", "LeftHand": "hand"},
        {"LeftUpperArm": "upper", "LeftForeArm": "lower", "LeftHand": "lower"},
        {"T8": "hand", "LeftUpperArm": "upper", "LeftForeArm": "lower", "LeftHand": "hand"},
    ],
)
def test_links_that_do_not_follow_each_other_outward(links: dict[str, str]) -> None:
    with pytest.raises(
        ProfileError, match=r"\[links\]: no joint lies between links '.*' and '.*'; expected links that"
    ):
        limbs(urdf(), profile(links=links))


def straight_arm(elbow_m: float, wrist_m: float, axis: str) -> str:
    """Three joints along +y, the first in the base; the elbow turns about `axis`."""
    text = "<link name='base'/>"
    for joint, parent, child, ahead, about in (
        ("shoulder", "base", "upper", 0.2, "0 0 1"),
        ("elbow", "upper", "lower", elbow_m, axis),
        ("wrist", "lower", "hand", wrist_m, "1 0 0"),
    ):
        text += (
            f"<link name='{child}'/><joint name='{joint}' type='revolute'><parent link='{parent}'/><child link='{child}'/>"
            f"<origin xyz='0 {ahead} 0'/><axis xyz='{about}'/><limit lower='-2.3' upper='0.2' velocity='1' effort='1'/></joint>"
        )
    return f"<robot name='straight_arm'>{text}</robot>"


def arm_profile() -> RobotProfile:
    return profile(links={"LeftUpperArm": "upper", "LeftForeArm": "lower", "LeftHand": "hand"})


@pytest.mark.parametrize(
    ("elbow_m", "wrist_m", "bone"), [(0.0, 0.3, "LeftUpperArm"), (0.3, 0.0, "LeftForeArm"), (0.0, 0.0, "LeftUpperArm")]
)
def test_a_bone_without_length_is_refused(elbow_m: float, wrist_m: float, bone: str) -> None:
    with pytest.raises(ProfileError, match=rf"^x, \[links\]: {bone} has no length: .*; expected links with a bone"):
        limbs(straight_arm(elbow_m, wrist_m, "0 0 1"), arm_profile())


def test_a_joint_along_the_bone_is_no_hinge() -> None:
    """Turning about it twists the arm and bends nothing: there is no plane to take a hinge's direction from, least of all NaN."""
    for limb, _ in limbs(straight_arm(0.3, 0.25, "0 1 0"), arm_profile()).values():
        assert (limb.hinge, limb.rotation) == (None, None)
        np.testing.assert_allclose(limb.bone, [0.0, 1.0, 0.0], atol=1e-9)
    hinge, _ = limbs(straight_arm(0.3, 0.25, "0 0 1"), arm_profile())["LeftUpperArm"]
    np.testing.assert_allclose(hinge.rotation, np.eye(3), atol=1e-9)


# --- every robot ------------------------------------------------------------------------------------------------------


@pytest.fixture(params=robots.names())
def model(request: pytest.FixtureRequest, make_motion: Callable[..., HumanMotion]) -> RobotModel:
    return robot_model.build(robots.load(request.param), make_motion([0.0]))


def random_postures(model: RobotModel, count: int) -> Array:
    generator = np.random.default_rng(11)
    return model.lower + (model.upper - model.lower) * generator.random((count, len(model.joint_names)))


def test_upper_and_lower_bone_meet_at_the_hinge_in_every_posture(model: RobotModel) -> None:
    """The same point seen from both links stays one point while the elbow or knee turns: it lies on the axis."""
    data = model.pin_model.createData()
    for joints in random_postures(model, 20):
        pin.framesForwardKinematics(model.pin_model, data, model.configuration(joints))
        for upper, lower in (("UpperArm", "ForeArm"), ("UpperLeg", "LowerLeg")):
            for side in ("Left", "Right"):
                if f"{side}{upper}" in model.limbs:
                    first, second = model.limbs[f"{side}{upper}"], model.limbs[f"{side}{lower}"]
                    a = data.oMf[model.pin_model.getFrameId(first.link)].act(first.distal)
                    b = data.oMf[model.pin_model.getFrameId(second.link)].act(second.proximal)
                    np.testing.assert_allclose(a, b, atol=1e-6)


@pytest.mark.parametrize(
    ("robot", "segments"),
    [("icub", ("UpperArm", "UpperLeg")), ("talos", ("UpperLeg",)), ("human", ("UpperArm", "UpperLeg"))],
)
def test_a_ball_joints_centre_stands_still_while_its_limb_moves(
    robot: str, segments: tuple[str, ...], make_motion: Callable[..., HumanMotion]
) -> None:
    """Shoulders and hips whose axes meet: the limb's proximal end is fixed in the trunk, whatever the joints do."""
    model = robot_model.build(robots.load(robot), make_motion([0.0]))
    data = model.pin_model.createData()
    trunk = {"UpperArm": model.links.get("LeftShoulder", model.links["T8"]), "UpperLeg": model.links["Pelvis"]}
    for segment in segments:
        limb, seen = model.limbs[f"Left{segment}"], []
        for joints in random_postures(model, 20):
            pin.framesForwardKinematics(model.pin_model, data, model.configuration(joints))
            world = data.oMf[model.pin_model.getFrameId(limb.link)].act(limb.proximal)
            seen.append(data.oMf[model.pin_model.getFrameId(trunk[segment])].actInv(world))
        assert np.ptp(np.array(seen), axis=0).max() < 1e-5


def test_a_roughly_right_reference_posture_is_enough(model: RobotModel) -> None:
    """10° off in every joint moves no bone by more than 2°: TALOS' and G1's shoulders and wrists have axes that do not meet."""
    generator = np.random.default_rng(3)
    for _ in range(10):
        joints = model.reference_posture + np.radians(10) * generator.uniform(-1, 1, len(model.joint_names))
        moved = find_limbs(
            model.pin_model, model.profile, model.configuration(np.clip(joints, model.lower, model.upper))
        )
        for segment, limb in model.limbs.items():
            assert np.degrees(rotations.vector_angle(moved[segment].bone, limb.bone)) < 2.0


ORIGINS = {
    "g1": ("{side}_shoulder_roll_link", "{side}_elbow_link", "{side}_wrist_yaw_link", "{side}_hip_roll_link",
           "{side}_knee_link", "{side}_ankle_pitch_link"),
    "icub": ("{s}_shoulder_3", "{s}_elbow_1", "{s}_wrist_1", "{s}_hip_1", "{s}_lower_leg", "{s}_ankle_1"),
    "talos": ("arm_{side}_3_link", "arm_{side}_4_link", "arm_{side}_7_link", "leg_{side}_1_link", "leg_{side}_4_link",
              "leg_{side}_6_link"),
    "baxter": ("{side}_lower_shoulder", "{side}_lower_elbow", "{side}_lower_forearm"),
}  # fmt: skip
"""Links whose origins makers put at shoulder, elbow, wrist, hip, knee, ankle: not exactly the joint centres, but near them."""


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("robot", sorted(ORIGINS))
def test_bones_run_near_the_lines_between_link_origins(
    robot: str, side: str, build_robot: Callable[[str], RobotModel]
) -> None:
    model = build_robot(robot)
    data = model.pin_model.createData()
    pin.framesForwardKinematics(model.pin_model, data, model.configuration(model.reference_posture))
    names = [name.format(side=side, s=side[0]) for name in ORIGINS[robot]]
    origins = [data.oMf[model.pin_model.getFrameId(name)].translation for name in names]
    pairs = {"UpperArm": (0, 1), "ForeArm": (1, 2), "UpperLeg": (3, 4), "LowerLeg": (4, 5)}
    for part, (start, end) in pairs.items():
        if end < len(origins):
            limb = model.limbs[side.capitalize() + part]
            bone = data.oMf[model.pin_model.getFrameId(limb.link)].rotation @ limb.bone
            assert np.degrees(rotations.vector_angle(bone, origins[end] - origins[start])) < 2.0


def test_a_limb_on_the_wrong_side_of_the_elbow_is_seen(build_robot: Callable[[str], RobotModel]) -> None:
    """TALOS' forearm mapped to the link after the next joint: elbow and forearm twist together are no hinge."""
    profile_ = build_robot("talos").profile
    wrong = replace(profile_, links={**profile_.links, "LeftForeArm": "arm_left_5_link"})
    assert robot_model.build(wrong).limbs["LeftUpperArm"].hinge is None
