"""Steps the simulation under the torque law along a reference, and hands over what happened second by second."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Any

import mujoco
import numpy as np
from retarget.core.replay.gains import Gains
from retarget.core.replay.model import ReplayModel
from retarget.core.replay.reference import Reference
from retarget.core.replay.torque_law import InverseDynamics, friction_torque
from retarget.core.types import Array

CHUNK_STEPS = 2000
"""Steps handed over together: a clip's length does not show in memory."""
RUNAWAY_RAD_S = 1e3
"""Root of the sum of squared joint speeds beyond which the simulation has blown up; motors' joints turn a hundred times slower."""


@dataclass(frozen=True, eq=False)
class Signals:
    """K consecutive control steps, n joints in the robot's order.

    time: (K,) s, the trajectory's clock. reference, position: (K, n) rad. reference_velocity, velocity: (K, n) rad/s at that very time: the
    mean of the steps before and after. torque: (K, n) Nm, of the motors, as applied for the step, compensation of gravity and friction included.
    constraint_torque: (K, n) Nm, of dry friction, joint stops and contacts.
    """

    time: Array
    reference: Array
    reference_velocity: Array
    position: Array
    velocity: Array
    torque: Array
    constraint_torque: Array

    @classmethod
    def joined(cls, parts: list[Signals]) -> Signals:
        """All steps of `parts` in one."""
        return cls(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(cls)))


def run(
    model: Any,
    replay: ReplayModel,
    reference: Reference,
    gains: Gains,
    *,
    friction_compensation: bool,
    feed_forward: bool,
) -> Iterator[Signals]:
    """Simulate `model`, a `controlled_model` of `replay`, from the reference's own first state; it ends early when the simulation blows up.

    Semi-implicit Euler moves positions by the velocity at a step's end, so step k's velocity is (q[k] − q[k−1]) / h. Desired velocities and
    accelerations are the same differences of desired positions: with exact feed-forward the simulation then repeats the reference to rounding.
    """
    data = mujoco.MjData(model)
    h = reference.step_s
    inverse = InverseDynamics(replay) if feed_forward else None
    to_qpos, to_qvel = replay.qpos, replay.qvel
    before = reference.positions(-1, 1)
    data.qpos[to_qpos] = before[1]
    data.qvel[to_qvel] = (before[1] - before[0]) / h
    for first in range(0, reference.steps, CHUNK_STEPS):
        count = min(CHUNK_STEPS, reference.steps - first)
        desired = reference.positions(first - 1, first + count + 1)
        velocity = np.diff(desired, axis=0) / h  # at this step's beginning, and in the last row at the last step's end
        desired = desired[1:-1]
        command = gains.stiffness * desired + gains.damping * velocity[:-1]
        if friction_compensation:
            command += friction_torque(replay, velocity[:-1], velocity[1:])
        if inverse is not None:
            command += inverse.torque(desired, velocity[:-1], np.diff(velocity, axis=0) / h)
        control = np.zeros((count, model.nu))
        control[:, replay.actuators] = command
        qpos, qvel, torque, constraint = _steps(model, data, control)
        done = len(torque)
        yield Signals(
            time=reference.time(first, first + done),
            reference=desired[:done],
            reference_velocity=(velocity[:done] + velocity[1 : done + 1]) / 2,
            position=qpos[:, to_qpos],
            velocity=((qvel[:-1] + qvel[1:]) / 2)[:, to_qvel],
            torque=torque[:, to_qvel],
            constraint_torque=constraint[:, to_qvel],
        )
        if done < count:
            return


def _steps(model: Any, data: Any, control: Array) -> tuple[Array, Array, Array, Array]:
    """Of each step: positions (K, nq) and, with one row more for the end, velocities (K + 1, nv) at its beginning, torques (K, nv) of motors
    and of constraints. K is less than the rows of `control` when the simulation blew up in step K.
    """
    count = len(control)
    qpos, qvel = np.empty((count, model.nq)), np.empty((count + 1, model.nv))
    torque, constraint = np.empty((count, model.nv)), np.empty((count, model.nv))
    # Looked up once: what is left of the loop is little more than the simulation itself.
    step, to_control, now_qpos, now_qvel = mujoco.mj_step, data.ctrl, data.qpos, data.qvel
    now_torque, now_constraint = data.qfrc_actuator, data.qfrc_constraint
    runaway = RUNAWAY_RAD_S**2
    qvel[0] = now_qvel
    for k in range(count):
        qpos[k] = now_qpos
        to_control[:] = control[k]
        step(model, data)
        torque[k] = now_torque
        constraint[k] = now_constraint
        qvel[k + 1] = now_qvel
        if not now_qvel.dot(now_qvel) < runaway:
            return qpos[:k], qvel[: k + 1], torque[:k], constraint[:k]
    return qpos, qvel, torque, constraint
