"""The controller of [Lim2022 sec. III-C], wholly inside MuJoCo: τ = kp (q_d − q) + kv (q̇_d − q̇) + g(q) + feed-forward, clipped.

A step of the simulation is a step of the controller: the torque computed from the measured state is held for 0.5 ms, as a robot's
drives hold it. For this the integrator is semi-implicit Euler, which takes the torque as it is; implicit ones would treat kv q̇ as if the
controller saw the future, and the robot would feel another torque than the log shows.

Gravity is compensated at the measured posture: every body's weight is countered by MuJoCo's own `gravcomp`, counted among the motors' torques
and clipped with them. What does not depend on the state comes in as the control signal kp q_d + kv q̇_d + feed-forward, so one call
per step suffices.
"""

from __future__ import annotations

import copy
from typing import Any

import mujoco
import numpy as np
from retarget.core.errors import UsageError
from retarget.core.replay.gains import Gains
from retarget.core.replay.model import ReplayModel
from retarget.core.types import Array

CONTROL_RATE_HZ = 2000.0
"""[Lim2022 sec. III-C]"""
STICTION_SPEED_RAD_S = 0.01
"""Slower than this the direction of motion is in doubt, and friction is compensated in proportion to the speed."""


def controlled_model(replay: ReplayModel, gains: Gains, *, contacts: bool) -> Any:
    """A copy of `replay`'s MjModel whose actuators are the law, one control signal each; contacts only if wanted.

    Raises `UsageError` for a floating base, which compensating gravity would lift, and for contacts that the model was built without.
    """
    if replay.base_qvel is not None:
        raise UsageError("torque replay on a fixed base got a model with a floating base; build it with a fixed base")
    model = copy.deepcopy(replay.mj)
    robot_geoms = model.geom_bodyid > 0
    if contacts and not (model.geom_contype[robot_geoms].any() and model.geom_conaffinity[robot_geoms].any()):
        raise UsageError("self-collision was asked for, but the model was built without; build it with self_collision")
    option = model.opt
    option.timestep = 1.0 / CONTROL_RATE_HZ
    option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    # A state that blows up is reported as such; starting over silently would look like good tracking.
    option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    if not contacts:
        option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    model.body_gravcomp[:] = 1.0
    model.flg_gravcomp = 1
    actuators, joints = replay.actuators, model.dof_jntid[replay.qvel]
    model.jnt_actgravcomp[joints] = 1
    bounded = np.isfinite(replay.torque_limit_nm)
    model.jnt_actfrclimited[joints] = bounded
    limit = np.where(bounded, replay.torque_limit_nm, 0.0)
    model.jnt_actfrcrange[joints] = np.stack([-limit, limit], axis=1)
    model.actuator_ctrllimited[actuators] = 0
    model.actuator_forcelimited[actuators] = 0
    model.actuator_gear[actuators] = 0.0
    model.actuator_gear[actuators, 0] = 1.0
    model.actuator_dyntype[actuators] = mujoco.mjtDyn.mjDYN_NONE
    model.actuator_gaintype[actuators] = mujoco.mjtGain.mjGAIN_FIXED
    model.actuator_gainprm[actuators] = 0.0
    model.actuator_gainprm[actuators, 0] = 1.0
    model.actuator_biastype[actuators] = mujoco.mjtBias.mjBIAS_AFFINE
    model.actuator_biasprm[actuators] = 0.0
    model.actuator_biasprm[actuators, 1] = -gains.stiffness
    model.actuator_biasprm[actuators, 2] = -gains.damping
    return model


def friction_torque(replay: ReplayModel, velocity: Array, next_velocity: Array) -> Array:
    """Torque (K, n) Nm that overcomes the joints' friction while they move at `velocity` (K, n) rad/s, and at `next_velocity` a step later.

    Dry friction by the direction of motion, viscous friction by the speed at the end of the step, where MuJoCo's Euler takes it.
    """
    direction = np.tanh(velocity / STICTION_SPEED_RAD_S)
    return np.asarray(replay.friction_nm * direction + replay.damping_nms_rad * next_velocity)


class InverseDynamics:
    """M(q) q̈ + C(q, q̇) q̇ along a reference, what the law's gravity term and feedback leave to be asked for; on request + g(q)."""

    def __init__(self, replay: ReplayModel, *, gravity: bool = False) -> None:
        """`replay`: fixed base."""
        self._replay = replay
        self._model = copy.deepcopy(replay.mj)
        if not gravity:
            self._model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
        self._data = mujoco.MjData(self._model)

    def torque(self, position: Array, velocity: Array, acceleration: Array) -> Array:
        """(K, n) Nm for K states: positions, velocities, accelerations (K, n) in the robot's joint order."""
        model, data, count = self._model, self._data, len(position)
        qpos, qvel, qacc = (np.zeros((count, size)) for size in (model.nq, model.nv, model.nv))
        qpos[:] = data.qpos
        qpos[:, self._replay.qpos] = position
        qvel[:, self._replay.qvel] = velocity
        qacc[:, self._replay.qvel] = acceleration
        torque = np.empty((count, model.nv))
        # `mj_inverse` without constraints, passive forces and the mass matrix: twice as fast.
        for k in range(count):
            data.qpos[:] = qpos[k]
            data.qvel[:] = qvel[k]
            data.qacc[:] = qacc[k]
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_comVel(model, data)
            mujoco.mj_rne(model, data, 1, torque[k])
        torque += model.dof_armature * qacc
        return np.asarray(torque[:, self._replay.qvel])
