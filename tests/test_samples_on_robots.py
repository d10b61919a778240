"""Every sample on every robot, end to end: limits, accuracy, smoothness, feet, invariances. What the README promises, measured."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pinocchio as pin
import pytest
from retarget import formats, robots, samples
from retarget.core import robot_model, rotations
from retarget.core.pipeline import ConvertOptions, ConvertResult, convert
from retarget.core.types import HumanMotion

CLIPS = ("walk", "reach", "squat")
ROBOTS = tuple(robots.names())
LIMBED = ("g1", "icub", "talos", "tocabi")
DEFAULT = ConvertOptions()


@cache
def motion(sample: str) -> HumanMotion:
    return formats.read_motion(samples.sample_path(sample))


@cache
def model(robot: str, sample: str = "walk") -> robot_model.RobotModel:
    return robot_model.build(robots.load(robot), motion(sample))


@cache
def converted(sample: str, robot: str, options: ConvertOptions = DEFAULT) -> ConvertResult:
    return convert(motion(sample), model(robot, sample), options)


@pytest.mark.parametrize("mapping", ["limb_plane", "link_orientation"])
@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("sample", CLIPS)
def test_no_limit_is_violated(sample: str, robot: str, mapping: str) -> None:
    """Counted here from the URDF text that the trajectory carries, not by the project's own metrics."""
    trajectory = converted(sample, robot, ConvertOptions(mapping=mapping)).trajectory
    urdf = pin.buildModelFromXML(trajectory.robot_description)
    index = [urdf.joints[urdf.getJointId(name)].idx_q for name in trajectory.joint_names]
    lower, upper, speed = urdf.lowerPositionLimit[index], urdf.upperPositionLimit[index], urdf.velocityLimit[index]
    assert ((trajectory.position >= lower - 1e-9) & (trajectory.position <= upper + 1e-9)).all()
    steps = np.abs(np.diff(trajectory.position, axis=0)) / np.diff(trajectory.time)[:, None]
    assert (steps <= speed * (1 + 1e-9)).all()
    assert (np.abs(trajectory.velocity) <= speed * (1 + 1e-9)).all()
    assert not trajectory.status.any()


@pytest.mark.parametrize("robot", LIMBED)
@pytest.mark.parametrize(("sample", "limit_deg"), [("walk", 2.0), ("reach", 3.0)])
def test_limbs_point_where_the_persons_do(sample: str, robot: str, limit_deg: float) -> None:
    assert converted(sample, robot).metrics["limb_direction_error_deg"]["mean"] <= limit_deg


@pytest.mark.parametrize("sample", CLIPS)
def test_human_model_tracks_its_own_recording(sample: str) -> None:
    result = converted(sample, "human", ConvertOptions(mapping="link_orientation"))
    assert result.metrics["orientation_error_deg"]["mean"] < 0.05


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("sample", CLIPS)
def test_limb_plane_is_as_smooth_as_the_papers_mapping(sample: str, robot: str) -> None:
    ours = converted(sample, robot).metrics
    paper = converted(sample, robot, ConvertOptions(mapping="link_orientation")).metrics
    assert ours["jerk_rms_rad_s3"] <= 1.2 * paper["jerk_rms_rad_s3"]


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("sample", CLIPS)
def test_no_joint_stays_at_its_velocity_limit(sample: str, robot: str) -> None:
    shares = converted(sample, robot).metrics["velocity_limit_active_fraction"]
    assert max(shares.values(), default=0.0) <= 0.01


@pytest.mark.parametrize("robot", LIMBED)
def test_stance_feet_stand_still_on_the_ground(robot: str) -> None:
    metrics = converted("walk", robot).metrics
    assert metrics["foot_skate_m_s"]["mean"] < 0.02
    assert metrics["ground_penetration_mm"]["max"] < 5.0


@pytest.mark.parametrize("robot", LIMBED)
def test_robot_walks_as_far_as_its_hips_are_high(robot: str) -> None:
    """The base must travel the person's path scaled by the height of the hips above the ground: planted feet that slip would fall short.

    Thigh and shank alone are not enough: TOCABI's ankle is 158 mm above its sole, the person's 78.
    """
    built, person = model(robot), motion("walk")
    data = built.pin_model.createData()
    pin.framesForwardKinematics(built.pin_model, data, built.configuration(built.reference_posture))
    hip, foot = built.limbs["LeftUpperLeg"], built.profile.feet["Left"]
    hip_z = data.oMf[built.pin_model.getFrameId(hip.link)].act(hip.proximal)[2]
    sole_z = data.oMf[built.pin_model.getFrameId(foot.link)].act(foot.sole.mean(axis=0))[2]
    person_hip_z = person.position[0, person.index("LeftUpperLeg"), 2]

    base, pelvis = converted("walk", robot).trajectory.base_position, person.position[:, person.index("Pelvis")]
    assert base is not None
    travelled, walked = (np.linalg.norm((path[-1] - path[0])[:2]) for path in (base, pelvis))
    assert travelled == pytest.approx(walked * (hip_z - sole_z) / person_hip_z, rel=0.05)


@pytest.mark.parametrize("robot", [name for name in ROBOTS if name != "atlas"])
def test_v3_and_v4_twins_agree(robot: str) -> None:
    """The same walk written in both conventions, six decimals each. v3 has no contacts, so bases may differ; joints may not.

    TALOS, TOCABI and Baxter are slower than the person: theirs are calmed, and agree all the same.
    """
    v4 = converted("walk", robot).trajectory.position
    v3 = converted("walk_v3", robot).trajectory.position
    np.testing.assert_allclose(v3, v4, rtol=0, atol=1e-5)


def test_twins_on_atlas_agree_less() -> None:
    """Six decimals of a quaternion are 4e-6 rad of an arm's target. Atlas swings its arms past a posture in which two shoulder axes nearly
    coincide: that alone makes 1.5e-5 rad of it, and the rounding off of kinks three times more."""
    v4 = converted("walk", "atlas").trajectory.position
    v3 = converted("walk_v3", "atlas").trajectory.position
    np.testing.assert_allclose(v3, v4, rtol=0, atol=1e-4)


@pytest.mark.parametrize("robot", ROBOTS)
def test_heading_does_not_matter(robot: str) -> None:
    facing_forward = converted("yaw_000", robot).trajectory.position
    for heading in range(45, 360, 45):
        turned = converted(f"yaw_{heading:03d}", robot).trajectory.position
        np.testing.assert_allclose(turned, facing_forward, atol=1e-4, err_msg=f"heading {heading}°")


@pytest.mark.parametrize("robot", ["g1", "icub", "talos", "baxter", "tocabi"])
@pytest.mark.parametrize("sample", ["walk", "reach"])
def test_the_start_frame_does_not_matter(sample: str, robot: str) -> None:
    """A clip cut anywhere gives the same joints once what the cut removed (the plane's 0.25 s window) is past."""
    whole = converted(sample, robot).trajectory
    for start in (1.0, 2.5, 4.3):
        part = converted(sample, robot, ConvertOptions(start_s=start)).trajectory
        settled = part.time >= part.time[0] + 0.5
        same = whole.position[np.searchsorted(whole.time, part.time[0] - 1e-9) :]
        np.testing.assert_allclose(part.position[settled], same[settled], atol=1e-4, err_msg=f"start {start} s")


@pytest.mark.parametrize("robot", LIMBED)
def test_a_start_facing_backward_converges(robot: str) -> None:
    """The first frame must not depend on which way the world's X points: the person turned by 180° about Z."""
    forward = motion("reach")
    half_turn = np.array([0.0, 0.0, 0.0, 1.0])
    backward = replace(
        forward,
        orientation=rotations.make_continuous(rotations.multiply(half_turn, forward.orientation)),
        position=rotations.rotate(half_turn, forward.position),
        angular_velocity=None
        if forward.angular_velocity is None
        else rotations.rotate(half_turn, forward.angular_velocity),
    )
    turned = convert(backward, model(robot, "reach"), ConvertOptions(end_s=0.5))
    same = converted("reach", robot, ConvertOptions(end_s=0.5))
    np.testing.assert_allclose(turned.trajectory.position, same.trajectory.position, atol=1e-4)
    np.testing.assert_allclose(
        turned.metrics["orientation_error_deg"]["mean"], same.metrics["orientation_error_deg"]["mean"], atol=1e-3
    )


@pytest.mark.parametrize("robot", LIMBED)
def test_online_holds_the_limits_and_follows(robot: str) -> None:
    """One QP a frame lags behind the converged answer but stays near it and inside every limit."""
    online = converted("walk", robot, ConvertOptions(online=True))
    assert online.metrics["position_limit_violations"] == online.metrics["velocity_limit_violations"] == 0
    assert (
        online.metrics["limb_direction_error_deg"]["mean"]
        < converted("walk", robot).metrics["limb_direction_error_deg"]["mean"] + 2.0
    )


def test_turning_left_turns_the_robot_left() -> None:
    """The walk ends after a left turn of 90°: so must the base, whatever its own axes."""
    for robot in LIMBED:
        trajectory = converted("walk", robot).trajectory
        assert trajectory.base_orientation is not None
        upright = rotations.conjugate(model(robot).base_rotation)
        heading = np.unwrap(rotations.yaw(rotations.multiply(trajectory.base_orientation, upright)))
        assert np.degrees(heading[-1] - heading[0]) == pytest.approx(90.0, abs=3.0)
