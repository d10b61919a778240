"""Faults put into good clips: each must be caught, and named with the joint and the time it was put at."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from retarget import formats, samples
from retarget.core import rotations, timebase
from retarget.core.errors import InvalidDataError
from retarget.core.replay import kinematic
from retarget.core.replay import model as replay_model
from retarget.core.replay.thresholds import Thresholds
from retarget.core.report import ValidationReport
from retarget.core.types import JointTrajectory

from tests.trajectory_fields import ARRAYS

Clip = Callable[..., tuple[JointTrajectory, Any]]
A_STEP_S = (1.6, 2.6)
Walking = tuple[JointTrajectory, Any]


def with_position(trajectory: JointTrajectory, joint: str, frames: Any, by: float) -> np.ndarray:
    """A copy of the joint values (T, n) with `by` rad added to one joint in those frames."""
    position = trajectory.position.copy()
    position[frames, trajectory.joint_names.index(joint)] += by
    return position


@pytest.fixture(scope="module")
def g1_replay(clip: Clip, tmp_path_factory: pytest.TempPathFactory) -> Any:
    _, model = clip("g1", "walk")
    return replay_model.build(model, base="floating", self_collision=True, cache=tmp_path_factory.mktemp("models"))


def failures(report: ValidationReport) -> set[str]:
    return {check.name for check in report.failures}


@pytest.mark.parametrize(
    ("robot", "sample", "part"),
    [
        ("g1", "walk", ()),
        ("g1", "squat", ()),
        ("icub", "walk", ()),
        ("talos", "walk", A_STEP_S),
        ("tocabi", "walk", A_STEP_S),
    ],
)
def test_good_clips_raise_no_alarm(clip: Clip, robot: str, sample: str, part: tuple[float, ...]) -> None:
    report = kinematic.check_numbers(*clip(robot, sample, *part))
    assert [(check.name, check.value, check.note) for check in report.failures] == []
    unjudged = {check.name: check.note for check in report.checks if check.passed is None}
    assert all(unjudged.values())


def test_fixed_robot_has_no_base_and_no_feet_to_judge(build_robot: Callable[[str], Any]) -> None:
    model = build_robot("baxter")
    time = np.arange(100) / 50
    swing = 0.3 * np.sin(2 * np.pi * 0.5 * time)[:, None]
    still = JointTrajectory(
        time=time,
        joint_names=model.joint_names,
        position=np.clip(model.reference_posture + swing, model.lower, model.upper),
        velocity=np.gradient(np.clip(model.reference_posture + swing, model.lower, model.upper), time, axis=0),
    )
    report = kinematic.check_numbers(still, model)
    assert report.passed
    assert {c.note for c in report.checks if c.name.startswith(("base", "foot", "feet", "ground"))} == {
        "the base is fixed"
    }


def test_jump_of_half_a_radian(walking: Walking) -> None:
    """From frame 300 (5 s) on one joint stands half a radian elsewhere: no speed limit of G1's wrist is crossed by it alone."""
    good, model = walking
    bad = replace(good, position=with_position(good, "left_wrist_yaw_joint", slice(300, None), 0.5))
    check = kinematic.check_numbers(bad, model).check("joint_jump_max_rad")
    assert not check.passed
    assert check.value == pytest.approx(0.5, abs=0.02)
    assert (check.where, check.time_s) == ("left_wrist_yaw_joint", good.time[300])
    assert check.note.startswith("left_wrist_yaw_joint at 5.000 s")


@pytest.mark.parametrize("frame", [1, 2, 400, 792])
def test_single_frame_that_stands_out(walking: Walking, frame: int) -> None:
    good, model = walking
    bad = replace(good, position=with_position(good, "right_elbow_joint", frame, -0.5))
    check = kinematic.check_numbers(bad, model).check("joint_jump_max_rad")
    assert not check.passed
    assert check.where == "right_elbow_joint"
    assert check.time_s in good.time[frame : frame + 2]


def test_limit_crossed_by_a_hundredth(walking: Walking) -> None:
    """A knee that bends further throughout, so that its deepest bend is 0.01 rad over the limit: nothing else about it is odd."""
    good, model = walking
    joint = "right_knee_joint"
    i = model.joint_index(joint)
    frame = int(np.argmax(good.position[:, i]))
    position = good.position.copy()
    position[:, i] += model.upper[i] + 0.01 - position[frame, i]
    report = kinematic.check_numbers(replace(good, position=position), model)
    count, excess = report.check("position_limit_violations"), report.check("position_limit_excess_deg")
    assert count.value == (position[:, i] > model.upper[i]).sum()
    assert (count.passed, count.where, count.time_s) == (False, joint, good.time[frame])
    assert excess.value == pytest.approx(np.degrees(0.01), abs=1e-9)
    assert (excess.where, excess.time_s) == (joint, good.time[frame])
    strip = report.series[f"problem/{joint}"]
    assert np.argmax(strip) == frame
    assert strip[frame] == pytest.approx(1 + np.degrees(0.01))


def test_limit_touched_in_single_precision_is_no_violation(walking: Walking) -> None:
    """A learning pipeline's file: values clipped to the limit, stored as float32, which may round outward."""
    good, model = walking
    position = good.position.copy()
    for i, limit in enumerate(model.upper):
        position[i, i] = limit
    rounded = position.astype(np.float32).astype(float)
    assert (rounded > model.upper + 1e-9).any()
    report = kinematic.check_numbers(replace(good, position=rounded), model)
    assert report.check("position_limit_violations").passed
    assert report.check("position_limit_excess_deg").passed
    # The same values in a file of doubles would have been written so.
    position[0, 0] = model.upper[0] + 1e-7
    assert (
        not kinematic.check_numbers(replace(good, position=position), model).check("position_limit_violations").passed
    )


def test_feet_three_centimetres_under_the_floor(walking: Walking) -> None:
    good, model = walking
    sunk = good.base_position.copy()
    sunk[240:300, 2] -= 0.03
    check = kinematic.check_numbers(replace(good, base_position=sunk), model).check("ground_penetration_mm")
    assert not check.passed
    assert check.value == pytest.approx(30, abs=1.5)
    assert check.where in ("Left foot", "Right foot")
    assert good.time[240] <= check.time_s < good.time[300]


def test_feet_in_the_air(walking: Walking) -> None:
    good, model = walking
    raised = good.base_position + np.array([0.0, 0.0, 0.05])
    check = kinematic.check_numbers(replace(good, base_position=raised), model).check("feet_floating_mm")
    assert not check.passed
    assert check.value == pytest.approx(50, abs=1)
    jump = good.base_position.copy()
    jump[300:330, 2] += 0.3  # half a second of flight is a jump
    assert kinematic.check_numbers(replace(good, base_position=jump), model).check("feet_floating_mm").passed


@pytest.mark.parametrize(("order", "words"), [
    ([1, 2, 3, 0], "x y z w was read as w x y z"),
    ([3, 0, 1, 2], "w x y z was read as x y z w"),
])  # fmt: skip
@pytest.mark.parametrize("robot", ["g1", "icub"])
def test_swapped_quaternion_order(clip: Clip, robot: str, order: list[int], words: str) -> None:
    good, model = clip(robot, "walk")
    swapped = rotations.make_continuous(good.base_orientation[:, order])
    report = kinematic.check_numbers(replace(good, base_orientation=swapped), model)
    check = report.check("base_quaternion_swapped")
    assert (check.value, check.passed, check.where) == (1, False, model.base_link)
    assert words in check.note
    assert len(failures(report)) > 1  # and what it does to the robot


def test_a_fall_is_not_taken_for_a_swapped_quaternion(walking: Walking) -> None:
    good, model = walking
    over = rotations.exp(np.outer(np.linspace(0, 2.5, good.frames), [1.0, 0.0, 0.0]))
    fallen = rotations.make_continuous(rotations.multiply(over, good.base_orientation))
    report = kinematic.check_numbers(replace(good, base_orientation=fallen), model)
    assert not report.check("base_tilt_deg").passed
    assert report.check("base_quaternion_swapped").passed


def test_clip_at_double_rate_contradicts_its_velocities(walking: Walking) -> None:
    """G1's limits are far from what walking needs, at double speed too: the stored velocities tell."""
    good, model = walking
    report = kinematic.check_numbers(replace(good, time=good.time / 2), model)
    check = report.check("velocity_mismatch_percent")
    assert not check.passed
    factor = re.search(r"positions move ([\d.]+) times as fast as the stored velocities", check.note)
    assert factor is not None
    assert float(factor[1]) == pytest.approx(2.0, abs=0.05)
    assert report.check("velocity_limit_violations").passed
    # What grows with the square and the cube of the speed.
    assert {"acceleration_max_rad_s2", "jerk_rms_rad_s3"} < failures(report)


@pytest.mark.parametrize(("robot", "joint"), [("talos", "leg_"), ("tocabi", "Knee")])
def test_clip_at_double_rate_crosses_speed_limits(clip: Clip, robot: str, joint: str) -> None:
    """Also where no velocities were stored: they are then the differences of what is there."""
    good, model = clip(robot, "walk", *A_STEP_S)
    time = good.time / 2
    bad = replace(good, time=time, velocity=np.gradient(good.position, time, axis=0))
    report = kinematic.check_numbers(bad, model)
    check = report.check("velocity_limit_violations")
    assert not check.passed
    assert joint in check.where
    assert check.value == (np.abs(np.diff(bad.position, axis=0)) > model.velocity_limit * (time[1] - time[0])).sum()


@pytest.mark.parametrize(
    ("first", "second", "caught_by"),
    [
        ("left_knee_joint", "left_hip_pitch_joint", "position_limit_violations"),
        ("right_ankle_pitch_joint", "right_knee_joint", "position_limit_violations"),
        ("left_hip_yaw_joint", "left_hip_roll_joint", "foot_skate_m_s"),
        ("left_shoulder_roll_joint", "right_shoulder_roll_joint", "self_collision_depth_mm"),
    ],
)
def test_two_swapped_joints(walking: Walking, g1_replay: Any, first: str, second: str, caught_by: str) -> None:
    """Values of one joint under the other's name: shows where they leave the other's range, slide a foot, drive an arm into the body.

    Two joints of one arm that hangs can change places without any of it: what then differs is the pose, and that needs the recording.
    """
    good, _ = walking
    names = list(good.joint_names)
    i, j = names.index(first), names.index(second)
    names[i], names[j] = second, first
    check = kinematic.check(replace(good, joint_names=tuple(names)), g1_replay).check(caught_by)
    assert not check.passed
    side = first.partition("_")[0]
    assert (
        check.where in (first, second)
        if caught_by.startswith("position")
        else side in check.where.lower() or "right" in check.where
    )


@pytest.mark.parametrize(
    ("first", "second"),
    [("left_shoulder_pitch_joint", "left_elbow_joint"), ("left_shoulder_yaw_joint", "left_shoulder_roll_joint")],
)
def test_joints_swapped_within_one_arm_show_beside_the_recording(clip: Clip, first: str, second: str) -> None:
    good, model = clip("g1", "reach", 0.0, 10.0)
    person = formats.read_motion(samples.sample_path("reach"))
    names = list(good.joint_names)
    i, j = names.index(first), names.index(second)
    names[i], names[j] = second, first
    swapped = replace(good, joint_names=tuple(names))
    check = kinematic.check_numbers(swapped, model, motion=person).check("limb_direction_error_deg")
    assert not check.passed
    assert check.where in ("LeftUpperArm", "LeftForeArm")
    right = kinematic.check_numbers(good, model, motion=person).check("limb_direction_error_deg")
    assert right.passed
    assert right.value < 5
    without = kinematic.check_numbers(swapped, model).check("limb_direction_error_deg")
    assert (without.passed, without.note) == (None, "no recording is at hand")


def test_recording_of_another_time_or_rate(clip: Clip) -> None:
    good, model = clip("g1", "reach", 0.0, 10.0)
    person = formats.read_motion(samples.sample_path("reach"))
    slower = timebase.resample(person, 40.0)
    assert kinematic.check_numbers(good, model, motion=slower).check("limb_direction_error_deg").value < 5
    later = replace(person, time=person.time + 1000)
    check = kinematic.check_numbers(good, model, motion=later).check("limb_direction_error_deg")
    assert (check.passed, check.note) == (None, "the recording is of another time")


def test_hand_through_the_torso(walking: Walking, g1_replay: Any) -> None:
    """The left arm folded over the chest and further, for a second."""
    good, model = walking
    position = good.position.copy()
    pose = {"shoulder_pitch": 0.3, "shoulder_roll": 0.2, "shoulder_yaw": -1.2, "elbow": -0.3}
    for joint, value in pose.items():
        position[300:360, model.joint_index(f"left_{joint}_joint")] = value
    report = kinematic.check(replace(good, position=position), g1_replay)
    check = report.check("self_collision_depth_mm")
    assert not check.passed
    assert set(check.where.split(" and ")) == {"torso_link", "left_wrist_pitch_link"}
    assert good.time[300] <= check.time_s < good.time[360]
    assert np.argmax(report.series["self_collision_depth_mm"]) in range(300, 360)
    deepest = report.facts["self_collision_pairs"][0]
    assert set(deepest["links"]) == {"torso_link", "left_wrist_pitch_link"}
    assert deepest["depth_mm"] == check.value
    assert deepest["frames"] == 60


def test_the_walk_itself_has_no_deep_collision(walking: Walking, g1_replay: Any) -> None:
    report = kinematic.check(walking[0], g1_replay)
    assert report.passed
    unjudged = {check.name for check in report.checks if check.value is None}
    assert unjudged == {
        "coupled_limit_excess_deg",
        "limb_direction_error_deg",
    }  # it has none, and no recording was given


def test_teleporting_and_spinning_base(walking: Walking) -> None:
    good, model = walking
    away = good.base_position.copy()
    away[500:] += [0.4, 0.0, 0.0]
    check = kinematic.check_numbers(replace(good, base_position=away), model).check("base_jump_max_m")
    assert (check.passed, check.time_s) == (False, good.time[500])
    assert check.value == pytest.approx(0.4, abs=0.01)
    turn = np.where(np.arange(good.frames) >= 500, 1.0, 0.0)[:, None] * [0.0, 0.0, 1.0]
    spun = rotations.make_continuous(rotations.multiply(rotations.exp(turn), good.base_orientation))
    check = kinematic.check_numbers(replace(good, base_orientation=spun), model).check("base_turn_max_rad_s")
    assert (check.passed, check.time_s) == (False, good.time[500])
    assert check.value == pytest.approx(60.0, rel=0.02)


def test_sliding_feet(walking: Walking) -> None:
    """The robot stands for its first frames; it is drawn over the floor at 0.3 m/s."""
    good, model = walking
    still = {
        name: getattr(good, name)[:1].repeat(60, axis=0) for name in ("position", "base_position", "base_orientation")
    }
    drawn = JointTrajectory(
        time=np.arange(60) / 60, joint_names=good.joint_names, velocity=np.zeros((60, 29)), base_frame=good.base_frame,
        **still | {"base_position": still["base_position"] + np.outer(np.arange(60) / 60, [0.3, 0.0, 0.0])},
    )  # fmt: skip
    check = kinematic.check_numbers(drawn, model).check("foot_skate_m_s")
    assert not check.passed
    assert check.value == pytest.approx(0.3, abs=1e-6)


def test_lost_frames_and_marked_frames(walking: Walking) -> None:
    good, model = walking
    keep = np.r_[0:400, 406 : good.frames]
    status = np.zeros(len(keep), np.int8)
    status[[100, 101]] = 1
    report = kinematic.check_numbers(replace(good, status=status, **{n: getattr(good, n)[keep] for n in ARRAYS}), model)
    gap, marked = report.check("time_gap_ratio"), report.check("marked_frames")
    assert gap.value == pytest.approx(7)
    assert (gap.passed, gap.time_s) == (False, good.time[399])
    assert (marked.value, marked.passed, marked.time_s) == (2, False, good.time[100])
    assert report.check("joint_jump_max_rad").passed  # a gap is a gap, not a jump as well


def test_nan_and_time_that_runs_backward_never_get_here(walking: Walking) -> None:
    good, _ = walking
    bad = good.position.copy()
    bad[3, 4] = np.nan
    with pytest.raises(InvalidDataError, match=r"position: found nan at \(3, 4\)"):
        replace(good, position=bad)
    with pytest.raises(InvalidDataError, match="increasing times"):
        replace(good, time=good.time[::-1])


def test_joints_of_another_robot_are_refused(walking: Walking) -> None:
    good, model = walking
    renamed = tuple(name.replace("left_elbow_joint", "left_elbow_jiont") for name in good.joint_names)
    with pytest.raises(InvalidDataError, match=re.escape("no joint 'left_elbow_jiont'; did you mean left_elbow_joint")):
        kinematic.check_numbers(replace(good, joint_names=renamed), model)
    fewer = replace(
        good, joint_names=good.joint_names[:23], position=good.position[:, :23], velocity=good.velocity[:, :23]
    )
    with pytest.raises(InvalidDataError, match="lacks 6 of the 29 joints of robot 'g1': right_shoulder_roll_joint, "):
        kinematic.check_numbers(fewer, model)


def test_single_frame_and_two_frames(walking: Walking) -> None:
    good, model = walking
    names = (*ARRAYS, "status")
    for frames in (1, 2, 3, 4):
        part = replace(good, **{name: getattr(good, name)[:frames] for name in names})
        report = kinematic.check_numbers(part, model)
        assert report.passed
        assert all(len(values) == frames for key, values in report.series.items() if key.startswith("problem/"))
        assert (report.check("velocity_ratio_max").value is None) == (frames == 1)


def test_limits_that_are_set_decide(walking: Walking) -> None:
    good, model = walking
    strict = Thresholds("kinematic").overridden(["acceleration_max_rad_s2=100", "jerk_max_rad_s3=1e4"])
    report = kinematic.check_numbers(good, model, strict)
    assert failures(report) == {"acceleration_max_rad_s2"}
    assert report.check("jerk_max_rad_s3").passed


def test_the_same_input_gives_the_same_report(walking: Walking) -> None:
    first, second = (kinematic.check_numbers(*walking) for _ in range(2))
    assert first.checks == second.checks
    assert all(np.array_equal(first.series[key], second.series[key]) for key in first.series)
