"""The chain from motion to trajectory: options, base choices, provenance, smoothing."""

from __future__ import annotations

import json

import numpy as np
import pytest
from retarget import robots
from retarget.core import robot_model, rotations
from retarget.core.errors import MotionError, SolverError, UnknownNameError, UsageError
from retarget.core.pipeline import ConvertOptions, check_options, convert, mapping_names
from retarget.core.segments import SEGMENTS
from retarget.core.types import HumanMotion, Source

FRAMES, RATE_HZ = 60, 60.0
TIME = np.arange(FRAMES) / RATE_HZ


@pytest.fixture(scope="module")
def g1() -> robot_model.RobotModel:
    return robot_model.build(robots.load("g1"))


@pytest.fixture(scope="module")
def waving() -> HumanMotion:
    """A person in T-pose who turns left by 40° and swings the right arm forward and back by 30° about the vertical."""
    orientation = np.tile([1.0, 0.0, 0.0, 0.0], (FRAMES, len(SEGMENTS), 1))
    axis = np.array([0.0, 0.0, 1.0])
    swing = np.radians(30) * np.sin(2 * np.pi * TIME)
    for name in ("RightUpperArm", "RightForeArm", "RightHand"):
        orientation[:, SEGMENTS.index(name)] = rotations.exp(swing[:, None] * axis)
    turn = rotations.exp((np.radians(40) * TIME)[:, None, None] * axis)
    orientation = rotations.make_continuous(rotations.multiply(turn, orientation))
    position = np.full((FRAMES, len(SEGMENTS), 3), np.nan)
    position[:, 0] = [0.0, 0.0, 0.9]
    source = Source("test", sha256="ab" * 32)
    return HumanMotion(TIME, SEGMENTS, orientation, position, source=source)


def test_the_right_arm_swings_with_the_persons(g1: robot_model.RobotModel, waving: HumanMotion) -> None:
    """Raising the arm forward in the horizontal plane: on G1 no other limb may move relative to the base."""
    result = convert(waving, g1, ConvertOptions())
    arm = result.metrics["limb_direction_error_deg"]["per_limb"]["RightUpperArm"]
    # Held out straight, G1's arm lies near its shoulder's pitch axis: passing that axis is rounded off, the rest is exact.
    assert arm["mean"] < 1.0
    assert arm["max"] < 3.0
    moved = np.ptp(result.trajectory.position, axis=0)
    legs = [g1.joint_index(n) for n in g1.joint_names if "hip" in n or "knee" in n]
    right = [g1.joint_index(n) for n in g1.joint_names if n.startswith("right_shoulder")]
    assert moved[right].max() > np.radians(30)
    assert moved[legs].max() < np.radians(0.5)
    base = result.trajectory.base_orientation
    assert base is not None
    assert np.degrees(rotations.yaw(base)[-1]) == pytest.approx(40 * TIME[-1], abs=0.5)


def test_velocity_is_the_derivative_of_position(g1: robot_model.RobotModel, waving: HumanMotion) -> None:
    trajectory = convert(waving, g1, ConvertOptions()).trajectory
    steps = np.diff(trajectory.position, axis=0) * RATE_HZ
    np.testing.assert_allclose(trajectory.velocity[1:-1], 0.5 * (steps[:-1] + steps[1:]), atol=1e-9)
    assert trajectory.base_angular_velocity is not None
    np.testing.assert_allclose(trajectory.base_angular_velocity[5:-5, 2], np.radians(40), atol=0.02)


def test_fixed_base_takes_the_heading_out(g1: robot_model.RobotModel, waving: HumanMotion) -> None:
    fixed = convert(waving, g1, ConvertOptions(base="fixed"))
    assert fixed.trajectory.base_orientation is not None
    assert not np.diff(fixed.trajectory.base_orientation, axis=0).any()
    free = convert(waving, g1, ConvertOptions(base="human"))
    # An upright pelvis: the same joints do it, whether the base turns or the heading is taken out, but for what a free base gives way.
    np.testing.assert_allclose(fixed.trajectory.position, free.trajectory.position, atol=1e-4)


def test_rate_and_cut(g1: robot_model.RobotModel, waving: HumanMotion) -> None:
    result = convert(waving, g1, ConvertOptions(rate_hz=30.0, start_s=0.2, end_s=0.7))
    assert result.trajectory.rate_hz == pytest.approx(30.0)
    assert result.trajectory.time[0] == pytest.approx(0.2)
    assert result.trajectory.time[-1] <= 0.7 + 1e-9
    with pytest.raises(MotionError, match="runs from 0 s"):
        convert(waving, g1, ConvertOptions(start_s=30.0))


@pytest.mark.parametrize("window_s", [0.05, 0.25])
def test_smoothing_keeps_limits_and_lowers_jerk(
    g1: robot_model.RobotModel, waving: HumanMotion, window_s: float
) -> None:
    plain = convert(waving, g1, ConvertOptions()).metrics
    smooth = convert(waving, g1, ConvertOptions(smooth_s=window_s)).metrics
    assert smooth["position_limit_violations"] == smooth["velocity_limit_violations"] == 0
    assert smooth["jerk_rms_rad_s3"] < plain["jerk_rms_rad_s3"]


def test_provenance_says_how_and_names_nobody(g1: robot_model.RobotModel, waving: HumanMotion) -> None:
    provenance = convert(waving, g1, ConvertOptions()).trajectory.provenance
    assert json.loads(json.dumps(dict(provenance))) == dict(provenance)
    assert provenance["input_sha256"] == "ab" * 32
    assert provenance["robot_model_sha256"] == g1.sha256
    assert provenance["options"]["base"] == "contact"
    assert provenance["options"]["mapping"] == "limb_plane"


def test_the_same_input_gives_the_same_bits(g1: robot_model.RobotModel, waving: HumanMotion) -> None:
    first, second = (convert(waving, g1, ConvertOptions()).trajectory for _ in range(2))
    np.testing.assert_array_equal(first.position, second.position)
    assert first.provenance == second.provenance


def test_contradictions_are_refused_before_any_work(waving: HumanMotion) -> None:
    baxter = robot_model.build(robots.load("baxter"))
    with pytest.raises(UsageError, match="fixed base"):
        convert(waving, baxter, ConvertOptions(base="contact"))
    with pytest.raises(UnknownNameError, match="did you mean limb_plane"):
        check_options(ConvertOptions(mapping="limb_plain"))
    for wrong in (ConvertOptions(rate_hz=0.0), ConvertOptions(rate_hz=float("nan")), ConvertOptions(smooth_s=-1.0)):
        with pytest.raises(UsageError):
            check_options(wrong)
    with pytest.raises(UsageError, match="before start"):
        check_options(ConvertOptions(start_s=2.0, end_s=1.0))


def test_nothing_measured_is_an_error(g1: robot_model.RobotModel, waving: HumanMotion) -> None:
    from dataclasses import replace

    blind = replace(waving, measured=np.zeros(len(SEGMENTS), bool))
    with pytest.raises(SolverError, match="no task"):
        convert(blind, g1, ConvertOptions())


def test_mappings_are_found_by_listing() -> None:
    assert {"limb_plane", "link_orientation"} <= set(mapping_names())
