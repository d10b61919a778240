"""A robot arm small enough to work out by hand, and a person in arbitrary smooth motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from retarget.core import robot_model, rotations
from retarget.core.profile import ModelSource, RobotProfile
from retarget.core.segments import PARENT
from retarget.core.types import Array, HumanMotion

ARM = """
<robot name="arm">
  <link name="trunk"/> <link name="roll"/> <link name="pitch"/> <link name="upper"/> <link name="fore"/> <link name="hand"/>
  <joint name="shoulder_roll" type="revolute">
    <parent link="trunk"/> <child link="roll"/> <origin xyz="0 0.2 0.4"/> <axis xyz="1 0 0"/>
    <limit lower="-0.5" upper="3" velocity="9" effort="1"/>
  </joint>
  <joint name="shoulder_pitch" type="revolute">
    <parent link="roll"/> <child link="pitch"/> <axis xyz="0 1 0"/> <limit lower="-3" upper="3" velocity="9" effort="1"/>
  </joint>
  <joint name="shoulder_yaw" type="revolute">
    <parent link="pitch"/> <child link="upper"/> <axis xyz="0 0 1"/> <limit lower="-3" upper="3" velocity="9" effort="1"/>
  </joint>
  <joint name="elbow" type="revolute">
    <parent link="upper"/> <child link="fore"/> <origin xyz="0 0 -0.3" rpy="1.5707963267948966 0 0"/> <axis xyz="0 0 1"/>
    <limit lower="0" upper="2.5" velocity="9" effort="1"/>
  </joint>
  <joint name="wrist" type="revolute">
    <parent link="fore"/> <child link="hand"/> <origin xyz="0 -0.25 0"/> <axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" velocity="9" effort="1"/>
  </joint>
</robot>
"""
"""A left arm that hangs along -z at zero. The forearm's frame is turned by 90° about x: its bone is -y, the elbow flexes about its z."""


@pytest.fixture
def arm_robot(tmp_path: Path) -> Callable[..., robot_model.RobotModel]:
    """`arm_robot(**fields)`: the model of ARM, T-pose at shoulder_roll = 90°; fields: those of `RobotProfile` to change."""
    (tmp_path / "arm.urdf").write_text(ARM)
    profile = RobotProfile(
        name="arm",
        description="",
        model=ModelSource("file", path=str(tmp_path / "arm.urdf")),
        base="fixed",
        links={"T8": "trunk", "LeftUpperArm": "upper", "LeftForeArm": "fore", "LeftHand": "hand"},
        reference_posture={"shoulder_roll": np.pi / 2},
    )
    return lambda **fields: robot_model.build(replace(profile, **fields))


@pytest.fixture(scope="session")
def wandering(make_motion: Callable[..., HumanMotion]) -> Callable[..., HumanMotion]:
    """`wandering(frames=…, seed=…)`: every segment turned smoothly about changing axes by up to some 60° against its parent, 60 Hz."""

    def make(*, frames: int = 120, seed: int = 0, rate_hz: float = 60.0, **fields: Any) -> HumanMotion:
        generator = np.random.default_rng(seed)
        time = np.arange(frames) / rate_hz
        world: dict[str, Array] = {}
        for segment, parent in PARENT.items():
            amplitude, phase = generator.uniform(-0.6, 0.6, size=(2, 3)), generator.uniform(0, 6, size=(2, 3))
            speed = generator.uniform(0.5, 4, size=(2, 3))
            own = rotations.exp((amplitude * np.sin(speed * time[:, None, None] + phase)).sum(axis=1))
            world[segment] = own if parent is None else rotations.multiply(world[parent], own)
        pelvis = np.stack([np.sin(time), 0.4 * time, 0.95 + 0.02 * np.cos(3 * time)], axis=1)
        motion = make_motion(time, world, pelvis=pelvis, **fields)
        if "angular_velocity" not in fields:
            motion = replace(motion, angular_velocity=rotations.angular_velocity(time, motion.orientation))
        return motion

    return make
