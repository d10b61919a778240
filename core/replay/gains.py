"""Stiffness and damping of every joint: the robot's own where the profile states them, else from inertia and a bandwidth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np
from retarget.core.errors import UnknownNameError, UsageError
from retarget.core.replay.model import ReplayModel
from retarget.core.types import Array

GainSource = Literal["auto", "profile", "inertia"]
GAIN_SOURCES: tuple[GainSource, ...] = ("auto", "profile", "inertia")
NATURAL_FREQUENCY_RAD_S = 30.0
"""Of a joint by itself, critically damped: a fifth of a degree behind on a walk, and soft enough for the lightest wrist at 2 kHz."""


@dataclass(frozen=True, eq=False)
class Gains:
    """stiffness: (n,) Nm/rad (N/m for sliding joints). damping: (n,) Nm s/rad. from_profile: the joints whose gains the profile states."""

    stiffness: Array
    damping: Array
    from_profile: tuple[str, ...] = ()


def gains(replay: ReplayModel, source: GainSource = "auto", frequency: float = NATURAL_FREQUENCY_RAD_S) -> Gains:
    """Gains of `replay`'s joints.

    source "profile": what the profile's [torque] states; raises `UsageError` when a joint lacks there. "inertia": I ω² and 2 I ω, ω = `frequency`
    rad/s, where I is what the joint's motor feels in the reference posture, all others locked: M(q)'s diagonal, armature included.
    "auto": the profile's where it states both of a joint's gains, else from inertia.
    """
    if source not in GAIN_SOURCES:
        raise UnknownNameError("source of gains", source, GAIN_SOURCES)
    if not 0 < frequency < np.inf:
        raise UsageError(f"natural frequency {frequency:g} rad/s; expected a positive number")
    inertia = joint_inertia(replay)
    stiffness, damping = inertia * frequency**2, 2 * inertia * frequency
    if source == "inertia":
        return Gains(stiffness, damping)
    torque, names = replay.robot.profile.torque, replay.robot.joint_names
    stated = tuple(name for name in names if name in torque.stiffness and name in torque.damping)
    lacking = [name for name in names if name not in stated]
    if source == "profile" and lacking:
        raise UsageError(
            f"robot '{replay.robot.profile.name}' states no stiffness and damping of joint '{lacking[0]}' "
            f"({len(lacking)} of {len(names)} joints); expected [torque] to name every joint, or gains from inertia"
        )
    for name in stated:
        i = names.index(name)
        stiffness[i], damping[i] = torque.stiffness[name], torque.damping[name]
    return Gains(stiffness, damping, stated)


def joint_inertia(replay: ReplayModel) -> Array:
    """Inertia (n,) kg m² about each joint (kg along sliding ones) in the reference posture, all other joints locked; armature included."""
    model = replay.mj
    data = mujoco.MjData(model)
    data.qpos[replay.qpos] = replay.robot.reference_posture
    mujoco.mj_forward(model, data)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    return np.diag(mass)[replay.qvel].copy()
