"""The default mapping: the person's bone directions exactly, a hinge between the bones, and no dependence on side, heading or cut."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from retarget.core import rotations, timebase
from retarget.core.mapping.limb_plane import bone_direction, limb_orientations, targets
from retarget.core.profile import MappingParameters
from retarget.core.segments import LIMB_END, SEGMENTS
from retarget.core.types import Array, HumanMotion, Task

MotionFactory = Callable[..., HumanMotion]
RobotBuilder = Callable[[str], Any]
X, Y, Z = np.eye(3)
PAIRS = [(f"{side}{u}", f"{side}{w}") for side in ("Left", "Right") for u, w in (("UpperArm", "ForeArm"), ("UpperLeg", "LowerLeg"))]  # fmt: skip
ROBOTS = ["g1", "icub", "talos", "baxter", "tocabi"]


def by_segment(motion: HumanMotion, model: Any) -> dict[str, Task]:
    return {task.segment: task for task in targets(motion, model).tasks}


def hinge_of(segment: str) -> tuple[Array, float]:
    """The limb's hinge in T-pose, and the sense in which flexing turns about it: elbows about -z (left), +z (right), knees about +y."""
    if segment.endswith("Leg"):
        return Y, 1.0
    return Z, -1.0 if segment.startswith("Left") else 1.0


def joint_line(motion: HumanMotion, segment: str) -> Array:
    """Direction (T, 3) from the limb's proximal to its distal joint, from the tracked positions."""
    line = motion.position[:, motion.index(LIMB_END[segment])] - motion.position[:, motion.index(segment)]
    return np.asarray(line / np.linalg.norm(line, axis=1, keepdims=True))


@pytest.mark.parametrize("name", ROBOTS)
def test_the_robots_bones_point_where_the_persons_do(
    build_robot: RobotBuilder, wandering: MotionFactory, name: str
) -> None:
    motion, model = wandering(seed=11), build_robot(name)
    found = by_segment(motion, model)
    assert len(model.limbs) >= 4
    for segment, limb in model.limbs.items():
        bone = rotations.rotate(found[segment].value, limb.bone)
        assert rotations.vector_angle(bone, joint_line(motion, segment)).max() < 1e-9, segment
        assert found[segment].axis == pytest.approx(limb.bone)
        assert found[segment].frame == limb.link


def test_bones_that_do_not_lie_on_the_segments_axis(build_robot: RobotBuilder, wandering: MotionFactory) -> None:
    """Real bodies: the wrist is not straight below the elbow's axis. The joint-centre line counts."""
    motion = wandering(seed=12)
    offsets = {
        **motion.joint_offsets,
        "LeftHand": np.array([0.03, 0.24, -0.02]),
        "LeftFoot": np.array([0.02, 0.01, -0.4]),
    }
    position = np.array(motion.position)
    for segment in ("LeftHand", "LeftFoot"):
        parent = motion.index({"LeftHand": "LeftForeArm", "LeftFoot": "LeftLowerLeg"}[segment])
        position[:, motion.index(segment)] = position[:, parent] + rotations.rotate(
            motion.orientation[:, parent], offsets[segment]
        )
    motion = replace(motion, joint_offsets=offsets, position=position)
    model = build_robot("g1")
    found = by_segment(motion, model)
    for segment, limb in model.limbs.items():
        bone = rotations.rotate(found[segment].value, limb.bone)
        assert rotations.vector_angle(bone, joint_line(motion, segment)).max() < 1e-9, segment


@pytest.mark.parametrize("segment", LIMB_END)
def test_bone_direction_without_offsets_is_the_t_pose_axis(make_motion: MotionFactory, segment: str) -> None:
    q = rotations.exp(np.array([0.3, -0.8, 0.5]))
    expected = rotations.rotate(q, [0, 0, -1] if segment.endswith("Leg") else [0, 1 if segment.startswith("Left") else -1, 0])  # fmt: skip
    for offsets in ({}, {LIMB_END[segment]: np.zeros(3)}):
        motion = make_motion([0.0], {segment: q}, joint_offsets=offsets)
        assert bone_direction(motion, segment)[0] == pytest.approx(expected, abs=1e-15)


def hinged(make_motion: MotionFactory, upper: str, lower: str, low_deg: float, high_deg: float) -> HumanMotion:
    """The limb flexes as a perfect hinge while its upper bone turns freely, about its own axis too."""
    time = np.arange(240) / 60
    hinge, flexion = hinge_of(lower)
    q_upper = rotations.exp(np.stack([np.sin(time), 0.8 * np.cos(1.7 * time), 0.9 * np.sin(0.7 * time)], axis=1))
    bend = np.radians(low_deg + (high_deg - low_deg) * 0.5 * (1 - np.cos(3 * time)))
    q_lower = rotations.multiply(q_upper, rotations.exp(flexion * bend[:, None] * hinge))
    return make_motion(time, {upper: q_upper, lower: q_lower})


@pytest.mark.parametrize(("upper", "lower"), PAIRS)
@pytest.mark.parametrize(("low_deg", "high_deg"), [(30, 120), (0, 140), (-8, 90)])
def test_a_hinge_stays_a_pure_hinge(
    make_motion: MotionFactory, upper: str, lower: str, low_deg: float, high_deg: float
) -> None:
    motion = hinged(make_motion, upper, lower, low_deg, high_deg)
    q_upper, q_lower = limb_orientations(motion, upper, lower)
    relative = rotations.log(rotations.multiply(rotations.conjugate(q_upper), q_lower))
    hinge, flexion = hinge_of(lower)
    assert np.abs(relative - (relative @ hinge)[:, None] * hinge).max() < 1e-9
    bend = flexion * relative @ hinge
    assert np.degrees([bend.min(), bend.max()]) == pytest.approx([low_deg, high_deg], abs=0.1)
    assert rotations.angle(q_upper, motion.orientation[:, motion.index(upper)]).max() < 1e-9
    assert rotations.angle(q_lower, motion.orientation[:, motion.index(lower)]).max() < 1e-9


@pytest.mark.parametrize(("upper", "lower"), PAIRS)
def test_pronation_is_handed_on(make_motion: MotionFactory, upper: str, lower: str) -> None:
    """The lower bone spun about itself changes neither bone's target."""
    motion = hinged(make_motion, upper, lower, 10, 120)
    index = motion.index(lower)
    bone = bone_direction(motion, lower)
    orientation = np.array(motion.orientation)
    spin = rotations.exp(1.2 * np.sin(3 * motion.time)[:, None] * bone)
    orientation[:, index] = rotations.make_continuous(rotations.multiply(spin, orientation[:, index]))
    spun = replace(motion, orientation=orientation)
    for before, after in zip(
        limb_orientations(motion, upper, lower), limb_orientations(spun, upper, lower), strict=True
    ):
        assert rotations.angle(before, after).max() < 1e-9


@pytest.mark.parametrize(("upper", "lower"), PAIRS)
def test_an_elbow_that_also_twists_still_gives_nearly_a_hinge(
    make_motion: MotionFactory, upper: str, lower: str
) -> None:
    """A carrying angle of 12° and a strapping error of 20° in the upper bone: where bent, what isn't hinge is below 2°."""
    motion = hinged(make_motion, upper, lower, 60, 120)
    index = motion.index(upper)
    bone, before = bone_direction(motion, upper), motion.orientation[:, index]
    orientation = np.array(motion.orientation)
    orientation[:, index] = rotations.make_continuous(rotations.multiply(rotations.exp(np.radians(20) * bone), before))
    q_upper, q_lower = limb_orientations(replace(motion, orientation=orientation), upper, lower)
    relative = rotations.log(rotations.multiply(rotations.conjugate(q_upper), q_lower))
    hinge, _ = hinge_of(lower)
    assert np.degrees(np.abs(relative - (relative @ hinge)[:, None] * hinge).max()) < 2


def mirrored(motion: HumanMotion) -> HumanMotion:
    """The motion in a mirror that stands in the x-z plane: sides swapped, y reversed, turns about x and z reversed."""

    def other(name: str) -> str:
        return name.replace("Left", "*").replace("Right", "Left").replace("*", "Right")

    order = [motion.index(other(name)) for name in motion.segments]
    return replace(
        motion,
        orientation=motion.orientation[:, order] * np.array([1, -1, 1, -1]),
        position=motion.position[:, order] * np.array([1, -1, 1]),
        angular_velocity=None,
        joint_offsets={other(name): offset * [1, -1, 1] for name, offset in motion.joint_offsets.items()},
    )


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_left_and_right_mirror(wandering: MotionFactory, seed: int) -> None:
    motion = wandering(seed=seed)
    mirror = mirrored(motion)
    for upper, lower in PAIRS:
        if upper.startswith("Left"):
            others = (upper.replace("Left", "Right"), lower.replace("Left", "Right"))
            for q, p in zip(limb_orientations(motion, upper, lower), limb_orientations(mirror, *others), strict=True):
                assert rotations.angle(q * [1, -1, 1, -1], p).max() < 1e-12


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("degrees", [-135, 30, 180])
def test_turning_the_person_turns_the_targets(
    build_robot: RobotBuilder, wandering: MotionFactory, name: str, degrees: float
) -> None:
    motion, by = wandering(seed=21), rotations.exp(np.radians(degrees) * Z)
    turned = replace(
        motion,
        orientation=rotations.make_continuous(rotations.multiply(by, motion.orientation)),
        position=rotations.rotate(by, motion.position),
        angular_velocity=rotations.rotate(by, motion.angular_velocity),
    )
    model = build_robot(name)
    before, after = by_segment(motion, model), by_segment(turned, model)
    assert before.keys() == after.keys()
    for segment, task in before.items():
        assert rotations.angle(rotations.multiply(by, task.value), after[segment].value).max() < 1e-12, segment
        assert task.feed_forward is not None
        assert after[segment].feed_forward is not None
        assert np.abs(rotations.rotate(by, task.feed_forward) - after[segment].feed_forward).max() < 1e-10, segment
        assert np.array_equal(task.weight, after[segment].weight)


def test_a_cut_clip_has_the_same_targets_beyond_the_window(build_robot: RobotBuilder, wandering: MotionFactory) -> None:
    motion, model = wandering(seed=22, frames=240), build_robot("g1")
    whole, cut = by_segment(motion, model), by_segment(timebase.cut(motion, 1.0, 3.0), model)
    inside = slice(60 + 16, 181 - 16)  # 0.25 s and one frame at 60 Hz
    for segment, task in whole.items():
        other = cut[segment]
        assert len(other.value) == 121
        assert rotations.angle(task.value[inside], other.value[16:-16]).max() < 1e-12, segment
        assert task.feed_forward is not None
        assert other.feed_forward is not None
        assert np.abs(task.feed_forward[inside] - other.feed_forward[16:-16]).max() < 1e-10, segment


@pytest.mark.parametrize("name", ROBOTS)
def test_feed_forward_is_the_rate_of_the_target(build_robot: RobotBuilder, wandering: MotionFactory, name: str) -> None:
    motion = wandering(seed=23)
    for task in targets(motion, build_robot(name)).tasks:
        assert task.feed_forward == pytest.approx(rotations.angular_velocity(motion.time, task.value), abs=1e-10)


def test_everything_that_is_no_limb_keeps_its_own_orientation(
    build_robot: RobotBuilder, wandering: MotionFactory
) -> None:
    """T-pose gives the constants; against them every other target moves exactly as its segment does."""
    motion, model = wandering(seed=24), build_robot("icub")
    still = HumanMotion([0.0], SEGMENTS, np.tile([1.0, 0, 0, 0], (1, 23, 1)), np.zeros((1, 23, 3)))  # type: ignore[arg-type]
    constants, found = by_segment(still, model), by_segment(motion, model)
    others = found.keys() - model.limbs.keys()
    assert {"Pelvis", "T8", "Head", "LeftHand", "RightFoot"} <= others
    for segment in others:
        own = rotations.multiply(motion.orientation[:, motion.index(segment)], constants[segment].value)
        assert rotations.angle(found[segment].value, own).max() < 1e-14, segment
        assert (found[segment].twist_weight == 1) == (segment != "T8")
    # The chest may turn about the spine more easily than lean: upright in T-pose, its free axis is the vertical.
    upright = rotations.rotate(constants["T8"].value, found["T8"].axis)
    np.testing.assert_allclose(np.abs(upright), [[0, 0, 1]], atol=1e-12)


def test_segments_that_were_not_measured_have_no_target(build_robot: RobotBuilder, wandering: MotionFactory) -> None:
    legs = [name for name in SEGMENTS if "Leg" in name or "Foot" in name or "Toe" in name]
    motion = wandering(measured=np.array([name not in legs for name in SEGMENTS]))
    found = by_segment(motion, build_robot("g1"))
    assert not found.keys() & set(legs)
    assert "LeftForeArm" in found


@pytest.mark.parametrize(("measured", "missing"), [("LeftUpperArm", "LeftForeArm"), ("LeftForeArm", "LeftUpperArm")])
def test_a_limb_of_which_one_bone_is_measured_keeps_that_segments_orientation(
    build_robot: RobotBuilder, wandering: MotionFactory, measured: str, missing: str
) -> None:
    motion = wandering(measured=np.array([name != missing for name in SEGMENTS]))
    model = build_robot("g1")
    found = by_segment(motion, model)
    assert missing not in found
    own = rotations.multiply(
        motion.orientation[:, motion.index(measured)], rotations.from_matrix(model.limbs[measured].rotation)
    )
    assert rotations.angle(found[measured].value, own).max() < 1e-14


def test_weights(build_robot: RobotBuilder, make_motion: MotionFactory) -> None:
    model = build_robot("g1")
    found = by_segment(make_motion([0.0]), model)
    for segment in model.limbs:
        assert found[segment].weight.tolist() == [1.0], "bone directions weigh fully"
        assert found[segment].twist_weight < 0.2, "the twist weighs less"
    parameters = MappingParameters(weights={"LeftHand": 0.7}, twist_weights={"LeftUpperArm": 0.5, "LeftHand": 0.1})
    own = replace(model, profile=replace(model.profile, mappings={"limb_plane": parameters}))
    changed = by_segment(make_motion([0.0]), own)
    assert changed["LeftHand"].weight.tolist() == [0.7]
    assert changed["LeftUpperArm"].twist_weight == 0.5
    assert changed["RightUpperArm"].twist_weight == found["RightUpperArm"].twist_weight
