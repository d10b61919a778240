"""What is found in motions whose figures are known in closed form."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from retarget.core import inspection
from retarget.core.types import HumanMotion, TrackerRecording

Maker = Callable[..., HumanMotion]


def about(axis: str, angle: float | np.ndarray) -> np.ndarray:
    half = np.asarray(angle, float) / 2
    out = np.zeros((*half.shape, 4))
    out[..., 0], out[..., 1 + "xyz".index(axis)] = np.cos(half), np.sin(half)
    return out


def test_timing() -> None:
    timing = inspection.Timing.of(np.array([0.0, 0.1, 0.2, 0.5, 0.6]))
    assert (timing.usual_s, timing.longest_s, timing.uneven) == (pytest.approx(0.1), pytest.approx(0.3), 1)
    assert inspection.Timing.of(np.zeros(1)).uneven == 0


def test_a_standing_person(make_motion: Maker) -> None:
    """The person of the tests: head joint 1.70 m above the toes, whose balls are on the ground."""
    time = np.arange(60) / 60
    motion = make_motion(time)
    found = inspection.inspect_motion(motion)
    head = motion.position[0, motion.index("Head"), 2] - motion.position[0, motion.index("LeftToe"), 2]
    assert found.stature_m == pytest.approx(head / inspection.HEAD_JOINT_OF_STATURE)
    assert found.upright == pytest.approx(1.0)
    assert found.heading_deg == (0.0, 0.0, 0.0)
    assert found.travel_m == pytest.approx(0.0)
    assert found.turn_rad_s.max() == 0
    assert found.poses["T-pose"] == [(0.0, pytest.approx(59 / 60))]
    assert found.poses["arms down (N-pose)"] == []
    assert found.doubts == ()


def test_heading_travel_and_speeds(make_motion: Maker) -> None:
    """Someone who turns at 1 rad/s and goes along X at 2 m/s."""
    time = np.arange(121) / 60
    pelvis = np.stack([2 * time, 0 * time, 0.95 + 0 * time], axis=1)
    found = inspection.inspect_motion(make_motion(time, {"Pelvis": about("z", time)}, pelvis=pelvis))
    assert found.travel_m == pytest.approx(4.0)
    assert found.heading_deg is not None
    assert found.heading_deg[2] == pytest.approx(np.degrees(2.0))
    np.testing.assert_allclose(found.turn_rad_s, 1.0, atol=1e-9)
    np.testing.assert_allclose(found.speed_m_s[:, 0], 2.0, atol=1e-9)
    assert found.poses["T-pose"], "the pose is seen from the chest's heading"


@pytest.mark.parametrize(
    ("pose", "left", "right"),
    [
        ("arms down (N-pose)", about("x", -np.pi / 2), about("x", np.pi / 2)),
        ("arms forward", about("z", -np.pi / 2), about("z", np.pi / 2)),
    ],
)
def test_poses_of_the_arms(make_motion: Maker, pose: str, left: np.ndarray, right: np.ndarray) -> None:
    time = np.arange(60) / 60
    late = (time >= 0.5)[:, None]
    still = np.array([1.0, 0.0, 0.0, 0.0])
    world = {"LeftUpperArm": np.where(late, left, still), "RightUpperArm": np.where(late, right, still)}
    found = inspection.inspect_motion(make_motion(time, world)).poses
    assert found[pose] == [(pytest.approx(0.5), pytest.approx(59 / 60))]
    assert found["T-pose"] == [(0.0, pytest.approx(29 / 60))]


def test_doubts(make_motion: Maker) -> None:
    time = np.arange(60) / 60
    lying = inspection.inspect_motion(make_motion(time, {"Pelvis": about("y", np.pi / 2)}))
    assert any("lying" in doubt for doubt in lying.doubts)
    motion = make_motion(time)
    small = inspection.inspect_motion(make_motion(time, position=motion.position / 100))
    assert any("m tall; expected 1.2 to 2.2 m" in doubt for doubt in small.doubts)
    angle = np.where(np.arange(60) == 30, np.pi, 0.0)
    jumps = inspection.inspect_motion(make_motion(time, {"Head": about("z", angle)}))
    assert any("Head turns at 188 rad/s at 0.48 s" in doubt for doubt in jumps.doubts)


def test_segments_that_were_not_measured_are_left_out(make_motion: Maker) -> None:
    time = np.arange(60) / 60
    motion = make_motion(time)
    upper = np.array(["Leg" not in name and "Foot" not in name and "Toe" not in name for name in motion.segments])
    found = inspection.inspect_motion(make_motion(time, measured=upper))
    assert found.stature_m is None
    assert found.contacts is None
    assert inspection.inspect_motion(make_motion(time, measured=np.zeros(23, bool))).doubts == (
        "no segment was measured",
    )


def test_trackers() -> None:
    time = np.arange(50) / 50
    turned = np.stack([about("z", 2 * time), about("x", 0 * time)], axis=1)
    position = np.zeros((50, 2, 3))
    position[:, 1, 0] = 100 * time
    recording = TrackerRecording(time, ("a", "b"), turned, position, np.ones((50, 2), bool))
    found = inspection.inspect_trackers(recording)
    np.testing.assert_allclose(found.turn_rad_s, np.tile([2.0, 0.0], (50, 1)), atol=1e-9)
    np.testing.assert_allclose(found.speed_m_s, np.tile([0.0, 100.0], (50, 1)), atol=1e-9)
    assert "b moves at up to 100 m/s: a jump, or lengths in another unit" in found.doubts
    assert any("centimetres or millimetres" in doubt for doubt in found.doubts)


def test_steps_are_counted() -> None:
    contacts = np.zeros((10, 4), bool)
    contacts[[2, 3, 6], 0] = contacts[[3, 4], 1] = contacts[5:, 2] = True
    assert inspection.step_counts(contacts) == {"Left": 2, "Right": 1}
