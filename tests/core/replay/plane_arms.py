"""A pendulum and a two-link arm in the x–z plane, whose dynamics fit on a line each.

Joints turn about +y; at zero everything hangs. `inertia`: about the link's own centre of mass.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from retarget.core import robot_model
from retarget.core.profile import ModelSource, RobotProfile, TorqueControl
from retarget.core.replay.model import ReplayModel, build
from retarget.core.types import Array, JointTrajectory

GRAVITY = 9.81


@dataclass(frozen=True)
class Link:
    mass: float
    length: float
    centre: float
    inertia: float


UPPER, FORE = Link(2.0, 0.5, 0.3, 0.02), Link(1.5, 0.4, 0.25, 0.01)


def arm(
    folder: Path,
    joints: int,
    *,
    damping: float = 0.0,
    friction: float = 0.0,
    effort: float = 500.0,
    limits: tuple[tuple[float, float], ...] = ((-3.0, 3.0), (-3.0, 3.0)),
    torque: TorqueControl | None = None,
    kind: str = "revolute",
) -> ReplayModel:
    """The first `joints` of joint0 and joint1 on a fixed base, in MuJoCo; its URDF and the compiled model land in `folder`."""
    parts = ['<robot name="arm"><link name="base"/>']
    parent, height = "base", 0.0
    for i, link in enumerate((UPPER, FORE)[:joints]):
        lower, upper = limits[i]
        parts.append(
            f'<link name="link{i}"><inertial><origin xyz="0 0 {-link.centre}"/><mass value="{link.mass}"/><inertia '
            f'ixx="{link.inertia}" iyy="{link.inertia}" izz="0.005" ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="joint{i}" type="{kind}"><parent link="{parent}"/><child link="link{i}"/>'
            f'<origin xyz="0 0 {height}"/><axis xyz="0 1 0"/><dynamics damping="{damping}" friction="{friction}"/>'
            f'<limit lower="{lower}" upper="{upper}" effort="{effort}" velocity="20"/></joint>'
        )
        parent, height = f"link{i}", -link.length
    file = folder / "arm.urdf"
    file.write_text("".join([*parts, "</robot>"]))
    source = ModelSource("file", str(file))
    profile = RobotProfile("arm", "", source, "fixed", links={}, torque=torque or TorqueControl())
    return build(robot_model.build(profile), base="fixed", cache=folder)


def moving(model: ReplayModel, position: Callable[[Array], ArrayLike], duration: float, rate: float) -> JointTrajectory:
    """The model's joints at `position`(time (T,)) (T, n) rad, `rate` times a second from 0 to `duration` s."""
    time = np.arange(round(duration * rate) + 1) / rate
    joints = np.asarray(position(time), float).reshape(len(time), -1)
    velocity = np.gradient(joints, time, axis=0) if len(time) > 1 else np.zeros_like(joints)
    return JointTrajectory(time, model.robot.joint_names, joints, velocity, robot="arm")


def gravity_torque(position: Array) -> Array:
    """(..., 2) Nm that holds the two-link arm at `position` (..., 2) rad, from its potential energy by hand."""
    first, both = np.sin(position[..., 0]), np.sin(position.sum(axis=-1))
    fore = FORE.mass * GRAVITY * FORE.centre * both
    upper = (UPPER.mass * UPPER.centre + FORE.mass * UPPER.length) * GRAVITY * first
    return np.stack([upper + fore, fore], axis=-1)


def moving_torque(position: Array, velocity: Array, acceleration: Array, armature: Array) -> Array:
    """(..., 2) Nm that accelerate the two-link arm without gravity: mass matrix and Coriolis terms of any textbook."""
    q2, (v1, v2) = position[..., 1], np.moveaxis(velocity, -1, 0)
    a1, a2 = np.moveaxis(acceleration, -1, 0)
    coupling = FORE.mass * UPPER.length * FORE.centre
    fore = FORE.inertia + FORE.mass * FORE.centre**2
    upper = UPPER.inertia + UPPER.mass * UPPER.centre**2 + FORE.mass * UPPER.length**2
    m11 = upper + fore + 2 * coupling * np.cos(q2) + armature[0]
    m12 = fore + coupling * np.cos(q2)
    twist = coupling * np.sin(q2)
    first = m11 * a1 + m12 * a2 - twist * (2 * v1 * v2 + v2**2)
    second = m12 * a1 + (fore + armature[1]) * a2 + twist * v1**2
    return np.stack([first, second], axis=-1)
