"""Long trajectories are judged in chunks of frames: where these begin must not show, in no figure and no series, to the last bit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from retarget import formats, samples
from retarget.core import chunks, kinematics, metrics, rotations
from retarget.core.replay import kinematic
from retarget.core.replay.collisions import self_collisions
from retarget.core.replay.joint_checks import check_joints
from retarget.core.replay.thresholds import Thresholds
from retarget.core.report import ValidationReport
from retarget.core.robot_model import RobotModel
from retarget.core.types import JointTrajectory

Clip = Callable[..., tuple[JointTrajectory, RobotModel]]
SIZES = (2, 3, 7, 50)


def damaged(good: JointTrajectory) -> JointTrajectory:
    """With noise, two joints exchanged, and the base's quaternion in another order: every check has something to say."""
    random = np.random.default_rng(8)
    columns = np.arange(len(good.joint_names))
    columns[[3, 9]] = columns[[9, 3]]
    position = (good.position + random.normal(0, 0.02, good.position.shape))[:, columns]
    orientation = good.base_orientation
    if orientation is not None:
        orientation = rotations.make_continuous(orientation[:, [1, 2, 3, 0]])
    return replace(good, position=position, base_orientation=orientation, base_angular_velocity=None)


def assert_same(found: ValidationReport, expected: ValidationReport) -> None:
    assert found.checks == expected.checks
    assert found.facts == expected.facts
    assert found.series.keys() == expected.series.keys()
    for name, values in expected.series.items():
        np.testing.assert_array_equal(found.series[name], values, err_msg=name)


@pytest.mark.parametrize("broken", [False, True])
@pytest.mark.parametrize(("robot", "sample"), [("g1", "walk"), ("icub", "squat")])
def test_no_chunk_shows_in_a_report(
    clip: Clip, monkeypatch: pytest.MonkeyPatch, robot: str, sample: str, broken: bool
) -> None:
    trajectory, model = clip(robot, sample, 0.0, 4.0)
    assert trajectory.frames < chunks.CHUNK_FRAMES
    person = formats.read_motion(samples.sample_path(sample))
    judged = damaged(trajectory) if broken else trajectory
    # Matrix products round differently with the number of columns: chunks begin where those of the kinematics do, as ever.
    monkeypatch.setattr(kinematics, "CHUNK", 7)
    whole = kinematic.check_numbers(judged, model, motion=person)
    for size in (7, 56):
        monkeypatch.setattr(chunks, "CHUNK_FRAMES", size)
        assert_same(kinematic.check_numbers(judged, model, motion=person), whole)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("frames", [1, 2, 3, 4, 5, 9, 60])
def test_no_chunk_shows_in_the_joints(
    walking: tuple[JointTrajectory, RobotModel], monkeypatch: pytest.MonkeyPatch, frames: int, size: int
) -> None:
    good, model = walking
    position = np.random.default_rng(frames).uniform(-3, 3, (frames, len(model.joint_names)))
    random = JointTrajectory(good.time[:frames], good.joint_names, position, good.velocity[:frames])
    checks, series = check_joints(random, model, Thresholds("kinematic"))
    figures = metrics.limit_figures(random, model)
    monkeypatch.setattr(chunks, "CHUNK_FRAMES", size)
    again, series_again = check_joints(random, model, Thresholds("kinematic"))
    assert again == checks
    for name, values in series.items():
        np.testing.assert_array_equal(series_again[name], values, err_msg=name)
    assert metrics.limit_figures(random, model)[0] == figures[0]


def test_figures_of_random_joints_by_their_definitions(
    walking: tuple[JointTrajectory, RobotModel], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(chunks, "CHUNK_FRAMES", 7)
    good, model = walking
    random, time = np.random.default_rng(5), np.cumsum(np.random.default_rng(6).uniform(0.01, 0.03, 60))
    q, v = random.uniform(-3, 3, (60, len(model.joint_names))), random.uniform(-3, 3, (60, len(model.joint_names)))
    trajectory = JointTrajectory(time, good.joint_names, q, v)
    checks, series = check_joints(trajectory, model, Thresholds("kinematic"))
    value = {check.name: check.value for check in checks}
    step = np.diff(time)[:, None]
    speed = np.diff(q, axis=0) / step
    acceleration = np.diff(speed, axis=0) / ((step[1:] + step[:-1]) / 2)
    jerk = np.diff(acceleration, axis=0) / ((step[2:] + step[1:-1] + step[:-2]) / 3)
    excess = np.maximum(0, np.maximum(model.lower - q, q - model.upper))
    assert value["position_limit_violations"] == np.count_nonzero(excess > 1e-9)
    assert value["position_limit_excess_deg"] == np.degrees(excess).max()
    assert value["velocity_limit_violations"] == np.count_nonzero(np.abs(speed) > model.velocity_limit)
    assert value["velocity_ratio_max"] == (np.abs(speed) / model.velocity_limit).max()
    assert value["acceleration_max_rad_s2"] == np.abs(acceleration).max()
    assert value["jerk_max_rad_s3"] == np.abs(jerk).max()
    stored = (v[1:] + v[:-1]) / 2
    size = max(np.sqrt((stored**2).mean()), np.sqrt((speed**2).mean()))
    assert value["velocity_mismatch_percent"] == 100 * np.sqrt(((stored - speed) ** 2).mean()) / size
    np.testing.assert_array_equal(series["max_velocity_ratio"], (np.abs(speed) / model.velocity_limit).max(axis=1))


def test_no_chunk_shows_in_collisions(
    walking: tuple[JointTrajectory, RobotModel], replayed: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    (good, model), replay = walking, replayed("g1")
    squeezed = good.position[:40].copy()
    squeezed[:, model.joint_index("left_hip_roll_joint")] = -0.5
    squeezed[:, model.joint_index("right_hip_roll_joint")] = 0.4
    whole = self_collisions(replay, squeezed, doubted_m=0.02)
    assert len(whole.overlap_depth_m) > 40
    monkeypatch.setattr(chunks, "CHUNK_FRAMES", 7)
    parts = self_collisions(replay, squeezed, doubted_m=0.02)
    for name in ("depth_m", "pair", "overlap_frame", "overlap_pair", "overlap_depth_m"):
        np.testing.assert_array_equal(getattr(parts, name), getattr(whole, name), err_msg=name)
    assert parts.by_pair() == whole.by_pair()


def test_strips_are_kept_without_a_copy(walking: tuple[JointTrajectory, RobotModel]) -> None:
    _, series = check_joints(*walking, Thresholds("kinematic"))
    report = ValidationReport("g1", (), series)
    assert all(report.series[name] is values for name, values in series.items() if name.startswith("problem/"))
