"""Taking the heading out: what is left doesn't know which way the person faced, and its rates are those of its own orientations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from retarget.core import rotations
from retarget.core.mapping.heading import without_heading
from retarget.core.segments import SEGMENTS
from retarget.core.types import Array, HumanMotion

MotionFactory = Callable[..., HumanMotion]
Z = np.array([0.0, 0.0, 1.0])


def turned(motion: HumanMotion, yaw: Array | float, rate: Array | float = 0.0) -> HumanMotion:
    """The same person on a turntable at angle `yaw` (rad, turning at `rate` rad/s): everything turned about the world's z axis."""
    angle = np.broadcast_to(yaw, motion.time.shape)
    turn = rotations.exp(angle[:, None, None] * Z)
    omega = motion.angular_velocity
    return replace(
        motion,
        orientation=rotations.make_continuous(rotations.multiply(turn, motion.orientation)),
        position=rotations.rotate(turn, motion.position),
        angular_velocity=None if omega is None else rotations.rotate(turn, omega) + np.multiply.outer(rate, Z).reshape(-1, 1, 3),
    )  # fmt: skip


@pytest.mark.parametrize("segment", ["Pelvis", "T8"])
@pytest.mark.parametrize("degrees", [-170, -90, -1e-6, 45, 135, 180, 300])
def test_heading_invariance(wandering: MotionFactory, segment: str, degrees: float) -> None:
    motion = wandering(seed=3)
    expected = without_heading(motion, segment)
    found = without_heading(turned(motion, np.radians(degrees)), segment)
    assert rotations.angle(found.orientation, expected.orientation).max() < 1e-12
    assert np.abs(found.position - expected.position).max() < 1e-12
    assert found.angular_velocity is not None
    assert expected.angular_velocity is not None
    assert np.abs(found.angular_velocity - expected.angular_velocity).max() < 1e-12


def test_a_person_who_turns_around_several_times(wandering: MotionFactory) -> None:
    """A turn at constant rate, twice around: differences of the heading are exact for it, so its rate goes exactly, too."""
    motion = wandering(seed=4, frames=300)
    rate = 2.6
    expected = without_heading(motion, "Pelvis")
    found = without_heading(turned(motion, rate * motion.time, rate), "Pelvis")
    assert rotations.angle(found.orientation, expected.orientation).max() < 1e-12
    assert np.abs(found.position - expected.position).max() < 1e-12
    assert found.angular_velocity is not None
    assert expected.angular_velocity is not None
    assert np.abs(found.angular_velocity - expected.angular_velocity).max() < 1e-11


@pytest.mark.parametrize("segment", ["Pelvis", "T8"])
def test_the_segment_faces_forward_at_the_origin(wandering: MotionFactory, segment: str) -> None:
    motion = wandering(seed=5)
    found = without_heading(motion, segment)
    index = found.index(segment)
    assert np.abs(rotations.yaw(found.orientation[:, index])).max() < 1e-14
    assert np.abs(found.position[:, index]).max() < 1e-15
    for other in (1, 10, 20):
        before = np.linalg.norm(motion.position[:, other] - motion.position[:, index], axis=1)
        assert np.linalg.norm(found.position[:, other], axis=1) == pytest.approx(before, abs=1e-14)


def test_leaning_stays(make_motion: MotionFactory) -> None:
    """Forward by 40°, facing left: still forward by 40° once the heading is gone. Leaning sideways likewise."""
    left = rotations.exp(np.pi / 2 * Z)
    for lean in (np.radians(40) * np.array([0, 1.0, 0]), np.radians(-25) * np.array([1.0, 0, 0])):
        q = rotations.exp(lean)
        motion = make_motion([0.0, 0.1], {"Pelvis": rotations.multiply(left, q)})
        found = without_heading(motion, "Pelvis")
        assert rotations.angle(found.orientation, q).max() < 1e-15


@pytest.mark.parametrize("segment", ["Pelvis", "T8"])
def test_angular_velocities_are_those_of_the_new_orientations(wandering: MotionFactory, segment: str) -> None:
    """Against differences of the orientations that come out; the deviation falls with the square of the frame time."""

    def deviation(rate_hz: float) -> float:
        motion = wandering(seed=6, frames=round(2 * rate_hz), rate_hz=rate_hz)
        motion = turned(motion, np.sin(3 * motion.time), 3 * np.cos(3 * motion.time))
        found = without_heading(motion, segment)
        assert found.angular_velocity is not None
        difference = found.angular_velocity - rotations.angular_velocity(found.time, found.orientation)
        return float(np.abs(difference)[2:-2].max())

    assert deviation(120) < 0.02
    assert deviation(240) < deviation(120) / 3


def test_one_frame(make_motion: MotionFactory) -> None:
    omega = np.ones((1, 23, 3))
    motion = make_motion([0.0], {"Pelvis": rotations.exp(2.0 * Z)}, angular_velocity=omega)
    found = without_heading(motion, "Pelvis")
    assert rotations.angle(found.orientation, [1.0, 0, 0, 0]).max() < 1e-15
    assert found.angular_velocity is not None
    assert np.abs(found.angular_velocity - rotations.rotate(rotations.exp(-2.0 * Z), omega)).max() < 1e-15


def test_recordings_without_rates_or_positions(wandering: MotionFactory) -> None:
    position = np.array(wandering(seed=7).position)
    position[:, [0, 5]] = np.nan  # the pelvis itself is not tracked
    motion = wandering(seed=7, position=position, angular_velocity=None)
    found = without_heading(replace(motion, angular_velocity=None), "Pelvis")
    assert found.angular_velocity is None
    assert np.isnan(found.position[:, [0, 5]]).all()
    assert np.isfinite(np.delete(found.position, [0, 5], axis=1)).all()


def test_a_motion_without_the_segment_is_left_alone(wandering: MotionFactory) -> None:
    motion = replace(wandering(), measured=np.array([name != "T8" for name in SEGMENTS]))
    assert without_heading(motion, "T8") is motion
