"""What a motion itself asks of the motors, whoever controls them: inverse dynamics along the reference, beside the motors' limits.

Where this is above the limit no controller can follow, and saturation is the motion's fault. Where it stays below and a motor saturates all the
same, the torque beyond it is the controller's: it corrects its own errors, or rings.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from retarget.core.replay.model import ReplayModel
from retarget.core.replay.reference import Reference
from retarget.core.replay.torque_law import InverseDynamics, friction_torque
from retarget.core.types import Array

EVERY_STEPS = 5
"""Of 2000 Hz: the reference's acceleration runs straight between frames, so its peak is missed by 1.25 ms at most."""
CHUNK = 2000
"""States evaluated together: a clip's length does not show in memory."""


@dataclass(frozen=True, eq=False)
class ReferenceTorque:
    """n joints in the robot's order; Nm (N for sliding joints), with the base held and friction overcome.

    ratio: (n,) largest torque as a part of the limit, 0 where no limit is known or nothing is allowed. peak, time_s: (n,) that torque's size, and when.
    over_percent: (n,) part of the time in which it is above the limit. any_over_percent: in which any joint's is.
    """

    ratio: Array
    peak: Array
    time_s: Array
    over_percent: Array
    any_over_percent: float

    @classmethod
    def of(cls, reference: Reference, replay: ReplayModel) -> ReferenceTorque:
        """τ = M(q) q̈ + C(q, q̇) q̇ + g(q) + friction at every `EVERY_STEPS`th control step of `reference`; `replay` with a fixed base."""
        n, limit = len(replay.qpos), replay.torque_limit_nm
        peak, when, over = np.zeros(n), np.full(n, reference.start_s), np.zeros(n, int)
        any_over = count = 0
        for time, torque in _torques(reference, replay):
            size = np.abs(torque)
            at = size.argmax(axis=0)
            largest = size[at, np.arange(n)]
            more = largest > peak
            peak[more], when[more] = largest[more], time[at[more]]
            beyond = size > limit
            over += beyond.sum(axis=0)
            any_over += int(beyond.any(axis=1).sum())
            count += len(time)
        ratio = np.divide(peak, limit, out=np.zeros(n), where=limit > 0)
        return cls(ratio, peak, when, 100.0 * over / count, 100.0 * any_over / count)


def _torques(reference: Reference, replay: ReplayModel) -> Iterator[tuple[Array, Array]]:
    """(times (K,) s, torques (K, n)), in order."""
    inverse, h = InverseDynamics(replay, gravity=True), reference.step_s
    steps = np.arange(0, reference.steps, EVERY_STEPS)
    for first, stop in pairwise([*range(0, len(steps), CHUNK), len(steps)]):
        chosen = steps[first:stop]
        # The same differences that the simulation takes for desired velocities and accelerations (`torque_loop.run`).
        before, now, after = (reference.at(chosen + k) for k in (-1, 0, 1))
        velocity, next_velocity = (now - before) / h, (after - now) / h
        torque = inverse.torque(now, velocity, (next_velocity - velocity) / h)
        time = np.asarray(reference.start_s + h * chosen, np.float64)
        yield time, torque + friction_torque(replay, velocity, next_velocity)
