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
NATURAL_FREQUENCY_RAD_S = 60.0
"""Of a joint by itself, critically damped: a quarter of a degree behind on a walk, and damping well within what 2 kHz can hold stable."""


@dataclass(frozen=True, eq=False)
class Gains:
    """stiffness: (n,) Nm/rad (N/m for sliding joints). damping: (n,) Nm s/rad. from_profile: the joints whose gains the profile states.

    inertia: (n,) kg m² (kg for sliding joints), `joint_inertia`.
    """

    stiffness: Array
    damping: Array
    inertia: Array
    from_profile: tuple[str, ...] = ()

    @property
    def damping_ratio(self) -> Array:
        """(n,) of critical, of every joint moving by itself: below about a half it rings."""
        return np.asarray(self.damping / (2 * np.sqrt(self.stiffness * self.inertia)))


def gains(replay: ReplayModel, source: GainSource = "auto", frequency: float = NATURAL_FREQUENCY_RAD_S) -> Gains:
    """Gains of `replay`'s joints.

    source "profile": what the profile's [torque] states; raises `UsageError` when a joint lacks there. "inertia": I ω² and 2 I ω, ω = `frequency`
    rad/s, where I is `joint_inertia`.
    "auto": the profile's where it states both of a joint's gains, except of `standing_joints`, whose legs swing here; else from inertia.
    """
    if source not in GAIN_SOURCES:
        raise UnknownNameError("source of gains", source, GAIN_SOURCES)
    if not 0 < frequency < np.inf:
        raise UsageError(f"natural frequency {frequency:g} rad/s; expected a positive number")
    inertia = joint_inertia(replay)
    stiffness, damping = inertia * frequency**2, 2 * inertia * frequency
    if source == "inertia":
        return Gains(stiffness, damping, inertia)
    torque, names = replay.robot.profile.torque, replay.robot.joint_names
    stated = tuple(name for name in names if name in torque.stiffness and name in torque.damping)
    lacking = [name for name in names if name not in stated]
    if source == "profile" and lacking:
        raise UsageError(
            f"robot '{replay.robot.profile.name}' states no stiffness and damping of joint '{lacking[0]}' "
            f"({len(lacking)} of {len(names)} joints); expected [torque] to name every joint, or gains from inertia"
        )
    if source == "auto":
        stated = tuple(name for name in stated if name not in torque.standing_joints)
    for name in stated:
        i = names.index(name)
        stiffness[i], damping[i] = torque.stiffness[name], torque.damping[name]
    return Gains(stiffness, damping, inertia, stated)


def joint_inertia(replay: ReplayModel) -> Array:
    """Inertia (n,) kg m² about each joint (kg along sliding ones), all other joints locked, armature included.

    The larger of that with all joints at zero (clipped into their limits) and that in the reference posture: with the arms out to the
    side a shoulder's pitch axis runs along the arm, hanging it carries the arm's whole length.
    """
    robot, model = replay.robot, replay.mj
    data = mujoco.MjData(model)
    largest = np.zeros(len(replay.qvel))
    mass = np.zeros((model.nv, model.nv))
    for posture in (np.clip(0.0, robot.lower, robot.upper), robot.reference_posture):
        data.qpos[replay.qpos] = posture
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, mass)
        largest = np.maximum(largest, np.diag(mass)[replay.qvel])
    return largest
