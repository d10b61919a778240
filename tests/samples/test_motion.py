"""The person moves as people do: norms of walking, ranges of joints, speeds, smoothness. From the decoded files where a file can tell."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from retarget.core.segments import FOOT_CONTACTS, SEGMENTS
from retarget.samples import exercises, legs, normative, steps
from retarget.samples.gait import Walk
from scipy.spatial.transform import Rotation

NAMES = ["walk", "reach", "squat"]
Documents = Callable[[str], Any]


def _sagittal_deg(content: Any, segment: str, flexion_sign: float) -> np.ndarray:
    """Flexion (T,) in degrees: the first angle, about the lateral axis, of SciPy's intrinsic y-x-z sequence."""
    return np.asarray(flexion_sign * content.relative(segment).as_euler("YXZ", degrees=True)[:, 0])


@pytest.mark.parametrize("side", ["Left", "Right"])
@pytest.mark.parametrize(
    ("segment", "sign", "norm"),
    [
        ("UpperLeg", -1.0, normative.HIP_FLEXION_DEG),
        ("LowerLeg", 1.0, normative.KNEE_FLEXION_DEG),
        ("Foot", -1.0, normative.ANKLE_DORSIFLEXION_DEG),
    ],
)
def test_walking_joint_angles_are_normative(
    side: str, segment: str, sign: float, norm: tuple[int, ...], document: Documents
) -> None:
    """Steady strides on the straight, cut at the file's own heel strikes, within 10° of the published mean everywhere."""
    content = document("walk")
    angle = _sagittal_deg(content, f"{side}{segment}", sign)
    strides = _steady_strides(content, side)
    assert len(strides) >= 2
    published = np.interp(np.arange(100) / 100, np.arange(21) / 20, (*norm, norm[0]))
    for times in strides:
        stride = _sampled(content, angle, times)
        assert np.abs(stride - published).max() < 10.0
        assert np.corrcoef(stride, published)[0, 1] > 0.9


@pytest.mark.parametrize("side", ["Left", "Right"])
def test_landmarks_of_the_walk(side: str, document: Documents) -> None:
    content = document("walk")
    for times in _steady_strides(content, side):
        knee = _sampled(content, _sagittal_deg(content, f"{side}LowerLeg", 1.0), times)
        hip = _sampled(content, _sagittal_deg(content, f"{side}UpperLeg", -1.0), times)
        ankle = _sampled(content, _sagittal_deg(content, f"{side}Foot", -1.0), times)
        assert 57 < knee.max() < 68
        assert 68 < knee.argmax() < 78
        assert 12 < knee[:33].max() < 25
        assert 30 < np.ptp(hip) < 48
        assert -28 < ankle.min() < -12
        assert 55 < ankle.argmin() < 75
        assert 0.01 < np.ptp(_sampled(content, content.at("Pelvis")[:, 2], times)) < 0.05


def test_arms_swing_against_the_legs(document: Documents) -> None:
    content = document("walk")
    times, *_ = _steady_strides(content, "Left")
    start, end = (round(times[i] * content.rate_hz) for i in (0, -1))
    for side, other in (("Left", "Right"), ("Right", "Left")):
        hand = (content.at(f"{side}Hand") - content.at(f"{side}UpperArm"))[start:end, 0]
        assert np.corrcoef(hand, (content.at(f"{other}Foot") - content.at("Pelvis"))[start:end, 0])[0, 1] > 0.8
    shoulders = (content.at("LeftUpperArm") - content.at("RightUpperArm"))[start:end, 0]
    hips = (content.at("LeftUpperLeg") - content.at("RightUpperLeg"))[start:end, 0]
    assert np.corrcoef(shoulders, hips)[0, 1] < -0.8


def test_the_way_of_the_walk(document: Documents) -> None:
    content = document("walk")
    time = np.arange(len(content.frames)) / content.rate_hz
    pelvis, facing = content.at("Pelvis"), content.world("Pelvis").apply([1.0, 0.0, 0.0])
    assert time[-1] >= 10
    straight = pelvis[:, 0] < 5.5
    assert np.abs(pelvis[straight, 1]).max() < 0.04
    assert facing[0] @ [1, 0, 0] > 0.999
    assert facing[-1] @ [0, 1, 0] > 0.999
    assert pelvis[-1, 0] > 7
    assert pelvis[-1, 1] > 2
    speed = np.linalg.norm(np.diff(content.position, axis=0), axis=2) * content.rate_hz
    assert speed[time[1:] < 0.6].max() < 1e-3
    assert speed[time[1:] > time[-1] - 0.6].max() < 1e-3
    cruising = np.linalg.norm(pelvis[time == 7.0] - pelvis[time == 4.0], axis=1)[0] / 3.0
    assert cruising == pytest.approx(steps.SPEED, rel=0.03)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    ("segment", "sequence", "low", "high"),
    [
        # Ranges of healthy adults (American Academy of Orthopaedic Surgeons, 1965), degrees, in the axes of these frames; left side.
        ("LeftUpperLeg", "YXZ", (-120, -30, -45), (30, 45, 45)),
        ("LeftLowerLeg", "YXZ", (0, -1, -20), (135, 1, 20)),
        ("LeftFoot", "YXZ", (-36, -25, -25), (50, 25, 25)),
        ("LeftHand", "XZY", (-70, -20, -1), (70, 30, 1)),
        ("L5", "ZYX", (-10, -10, -10), (10, 20, 10)),
        ("Head", "ZYX", (-50, -30, -25), (50, 30, 25)),
    ],
)
def test_joints_stay_in_human_ranges(
    name: str, segment: str, sequence: str, low: tuple[float, ...], high: tuple[float, ...], document: Documents
) -> None:
    content = document(name)
    mirror = np.array([-1.0 if axis in "XZ" else 1.0 for axis in sequence])
    for side, signs in (("Left", 1.0), ("Right", mirror)) if segment.startswith("Left") else (("Left", 1.0),):
        angles = content.relative(segment.replace("Left", side)).as_euler(sequence, degrees=True) * signs
        assert (angles >= np.array(low)).all(), f"{side} {angles.min(axis=0)}"
        assert (angles <= np.array(high)).all(), f"{side} {angles.max(axis=0)}"


@pytest.mark.parametrize("side", ["Left", "Right"])
def test_elbow_is_a_hinge_but_for_some_degrees(side: str, document: Documents) -> None:
    """Flexion about the elbow's own axis, pronation about the forearm, and a carrying angle of some degrees left over."""
    content = document("reach")
    left = 1.0 if side == "Left" else -1.0
    bone = content.relative(f"{side}ForeArm").apply([0.0, left, 0.0])
    bend = np.degrees(np.arctan2(bone[:, 0], left * bone[:, 1]))
    off_hinge = np.degrees(np.arcsin(np.abs(bone[:, 2])))
    assert bend.min() > -0.01
    assert 115 < bend.max() < 145
    assert 3 < off_hinge.max() < 10
    unbent = Rotation.from_rotvec(np.radians(left * bend)[:, None] * [0.0, 0.0, 1.0]) * content.relative(
        f"{side}ForeArm"
    )
    pronation = unbent.as_euler("YXZ", degrees=True)[:, 0]
    assert 50 < pronation.max() < 80
    assert -80 < pronation.min() < -50


def test_shank_turns_about_its_axis_with_the_knee(document: Documents) -> None:
    knee = document("squat").relative("LeftLowerLeg").as_euler("YXZ", degrees=True)
    assert 5 < np.ptp(knee[:, 2]) < 15
    assert np.corrcoef(knee[:, 0], knee[:, 2])[0, 1] < -0.9


def test_reach_holds_the_poses_it_names(document: Documents) -> None:
    content = document("reach")
    time = np.arange(len(content.frames)) / content.rate_hz
    t_pose = (time >= exercises.REACH_T_POSE[0]) & (time <= exercises.REACH_T_POSE[1])
    n_pose = (time >= exercises.REACH_N_POSE[0]) & (time <= exercises.REACH_N_POSE[1])
    assert t_pose.sum() >= 30
    assert n_pose.sum() >= 30
    for segment in SEGMENTS[:15]:
        assert content.world(segment)[t_pose].magnitude().max() < 4e-6, segment
    for side, left in (("Left", 1.0), ("Right", -1.0)):
        for segment in ("UpperArm", "ForeArm", "Hand"):
            bone = content.world(f"{side}{segment}")[n_pose].apply([0.0, left, 0.0])
            assert np.degrees(np.hypot(bone[:, 0], bone[:, 1])).max() < 0.2
            palm = content.world(f"{side}{segment}")[n_pose].apply([0.0, 0.0, -1.0])
            assert (palm[:, 1] * left < -0.99).all()


def test_reach_goes_everywhere(document: Documents) -> None:
    content = document("reach")
    for side, left in (("Left", 1.0), ("Right", -1.0)):
        hand = content.world("T8").inv().apply(content.at(f"{side}Hand") - content.at(f"{side}UpperArm"))
        hand /= np.linalg.norm(hand, axis=1, keepdims=True)
        assert hand[:, 2].max() > 0.9, "overhead"
        assert hand[:, 2].min() < -0.99, "hanging"
        assert hand[:, 0].max() > 0.95, "forward"
        assert (left * hand[:, 1]).max() > 0.99, "sideways"
        assert (left * hand[:, 1]).min() < -0.3, "across"


def test_squats_get_deeper(document: Documents) -> None:
    content = document("squat")
    height = content.at("Pelvis")[:, 2]
    thirds = [height[a:b].min() for a, b in ((60, 240), (260, 480), (500, 730))]
    assert height[0] - np.array(thirds) == pytest.approx([0.16, 0.30, 0.42], abs=1e-3)
    deepest = int(height.argmin())
    assert content.at("LeftHand")[deepest, 0] > content.at("LeftToe")[deepest, 0] + 0.2


@pytest.mark.parametrize(("name", "limit"), [("reach", 4.0), ("squat", 4.0), ("walk", 8.5)])
def test_natural_joint_speeds(name: str, limit: float, document: Documents) -> None:
    content = document(name)
    for segment in SEGMENTS[1:]:
        turned = content.relative(segment)
        assert (turned[:-1].inv() * turned[1:]).magnitude().max() * content.rate_hz < limit, segment


def test_acceleration_has_no_jumps() -> None:
    """Where acceleration is continuous its change between neighbours shrinks with their distance; at a jump it would not."""
    walk = Walk.planned()

    def largest_change(rate: int) -> np.ndarray:
        time = np.arange(int(0.5 * rate), int(12.8 * rate)) / rate
        joints = np.concatenate([walk.leg("Left", time), walk.leg("Right", time), walk.pelvis.pose(time)[0]], axis=1)
        return np.asarray(np.abs(np.diff(np.diff(joints, 2, axis=0) * rate**2, axis=0)).max(axis=0))

    coarse, fine = largest_change(600), largest_change(2400)
    assert (fine < 0.45 * coarse + 0.05).all(), np.stack([coarse, fine])


@pytest.mark.parametrize("name", ["reach", "squat"])
def test_exercises_accelerate_gently(name: str, truth: Documents) -> None:
    omega = truth(name).angular_velocity
    assert np.abs(np.diff(omega, axis=0)).max() * 60 < 40


def test_walking_legs_accelerate_as_legs_do(truth: Documents) -> None:
    """Peaks of joint acceleration in walking lie near 100 rad/s²; an artefact of stitching phases together would be far above."""
    motion = truth("walk")
    for side in ("Left", "Right"):
        for child, parent in (("UpperLeg", "Pelvis"), ("LowerLeg", "UpperLeg"), ("Foot", "LowerLeg"), ("Toe", "Foot")):
            i, j = SEGMENTS.index(f"{side}{child}"), SEGMENTS.index(parent if parent == "Pelvis" else f"{side}{parent}")
            relative = motion.angular_velocity[:, i] - motion.angular_velocity[:, j]
            assert np.linalg.norm(np.diff(relative, axis=0), axis=1).max() * 60 < 175, f"{side}{child}"


def test_the_first_and_the_last_step_are_no_harder_than_the_others() -> None:
    """Thigh and shank: out of standing and into it a leg accelerates at most a quarter harder than in steady walking."""
    walk, time = Walk.planned(), np.arange(0, steps.DURATION, 1 / 240)
    steady = (time > 3.5) & (time < 9.0)
    for side in ("Left", "Right"):
        hip_and_knee = walk.leg(side, time)[:, [legs.ANGLES.index("hip_flexion"), legs.ANGLES.index("knee_flexion")]]
        acceleration = np.abs(np.gradient(np.gradient(hip_and_knee, time, axis=0), time, axis=0))
        assert (acceleration.max(axis=0) < 1.25 * acceleration[steady].max(axis=0)).all(), side


def _steady_strides(content: Any, side: str) -> list[np.ndarray]:
    """Times (100,) s of whole strides of one foot, at full pace on the straight, from the planned heel strikes.

    The file knows a heel strike only to the frame, 1.5 % of a stride; that the two agree is asserted here.
    """
    heel = content.contacts[:, FOOT_CONTACTS.index(f"{side}Foot_Heel")]
    landed = (np.flatnonzero(heel[1:] & ~heel[:-1]) + 1) / content.rate_hz
    planned = [stance.clock for stance in steps.plan() if stance.side == side and np.isfinite(stance.strike)]
    late = landed - planned
    assert (late >= 0).all()
    assert (late < 1 / content.rate_hz).all()
    return [
        start + np.arange(100) / 100 * (end - start)
        for start, end in itertools.pairwise(planned)
        if start > steps.START[1] and steps.distance(end) < steps.TURN_START
    ]


def _sampled(content: Any, values: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Values (T,) of the file's frames at other times."""
    return np.interp(times, np.arange(len(values)) / content.rate_hz, values)
