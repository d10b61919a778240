"""Trajectories and motions for the tests of formats."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from retarget.core import rotations
from retarget.core.types import HumanMotion, JointTrajectory

from tests.formats.mvnx_documents import about


def _trajectory(frames: int = 6, joints: int = 3, *, rate_hz: float = 60.0, **changes: Any) -> JointTrajectory:
    rng = np.random.default_rng(frames * 100 + joints)
    time = np.arange(frames) / rate_hz
    phase = rng.uniform(0, 2 * np.pi, joints)
    fields: dict[str, Any] = {
        "time": time,
        "joint_names": tuple(f"left_joint_{i}" for i in range(joints)),
        "position": np.sin(3 * time[:, None] + phase),
        "velocity": 3 * np.cos(3 * time[:, None] + phase),
        "base_position": np.cumsum(rng.normal(scale=0.01, size=(frames, 3)), axis=0),
        "base_orientation": rotations.make_continuous(
            rotations.exp(np.cumsum(rng.normal(scale=0.1, size=(frames, 3)), 0))
        ),
        "base_linear_velocity": rng.normal(size=(frames, 3)),
        "base_angular_velocity": rng.normal(size=(frames, 3)),
        "status": np.arange(frames) == frames // 2,
        "base_frame": "pelvis",
        "robot": "g1",
        "provenance": {"input_sha256": "ab12", "options": {"rate": 60, "names": ["é", "b"]}},
        "robot_description": '<robot name="g1"><link name="pelvis"/></robot>',
    }
    return JointTrajectory(**(fields | changes))


@pytest.fixture(scope="session")
def make_trajectory() -> Callable[..., JointTrajectory]:
    """Makes a trajectory of so many frames and joints with every field set; keywords replace fields."""
    return _trajectory


@pytest.fixture
def moving(make_motion: Callable[..., HumanMotion]) -> HumanMotion:
    """A person who turns left by 120°, bends, swings arms and steps, 40 frames at 60 Hz."""
    time = np.arange(40) / 60
    turn = np.linspace(0, 120, 40)
    heading = about("z", turn)
    world = {
        "Pelvis": heading,
        "T8": rotations.multiply(heading, about("y", turn / 4)),
        "RightUpperArm": rotations.multiply(heading, about("x", 60 - turn)),
        "LeftForeArm": rotations.multiply(heading, about("z", -turn / 2)),
        "LeftHand": rotations.multiply(heading, about("y", turn)),
        "RightUpperLeg": rotations.multiply(heading, about("y", -turn / 3)),
    }
    spin = np.tile([0.1, -0.2, np.radians(120) / time[-1]], (40, 23, 1))
    return make_motion(time, world, pelvis=np.stack([time, 0 * time, 0.95 + 0 * time], 1), angular_velocity=spin)
