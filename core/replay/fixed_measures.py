"""What a torque replay was like: tracking, torques against limits, power and energy, measured as the steps come in."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from retarget.core.replay.model import ReplayModel
from retarget.core.replay.torque_loop import Signals
from retarget.core.types import Array

BIN_STEPS = (20, 40, 50, 80, 100, 200, 250, 400, 500, 1000, 2000)
"""Steps per point of the series, each a divisor of the loop's chunk: 100 points a second, fewer for long clips."""
MOST_POINTS = 6000
AT_LIMIT = 1.0 - 1e-9
"""A torque is clipped to its limit exactly; this much is left for rounding."""


class FixedMeasures:
    """Sums over all steps so far; n joints in the robot's order, errors in rad (m for sliding joints).

    steps: how many. peak_error, peak_torque: (n,) largest size, `peak_error_s`, `peak_torque_s` (n,) s when. saturated_steps: steps in which
    any joint's torque was at its limit; joint_saturated_steps: (n,), first_saturated_s: (n,) s, NaN for never.
    peak_power_w, peak_power_s: of what the motors give together; what they take back when they brake is not counted as gain.
    energy_j: the integral of that power.
    """

    def __init__(self, replay: ReplayModel, steps_in_all: int, step_s: float) -> None:
        """`steps_in_all`: how many are to come at most, for the series' resolution."""
        n = len(replay.qpos)
        self.limit = replay.torque_limit_nm
        self.steps = 0
        self.peak_error, self.peak_error_s = np.zeros(n), np.zeros(n)
        self.peak_torque, self.peak_torque_s = np.zeros(n), np.zeros(n)
        self.saturated_steps, self.joint_saturated_steps = 0, np.zeros(n, int)
        self.first_saturated_s = np.full(n, np.nan)
        self.peak_power_w, self.peak_power_s = 0.0, 0.0
        self._squared_error, self._squared_torque, self._power = np.zeros(n), np.zeros(n), 0.0
        self._step_s = step_s
        self._bin = next((size for size in BIN_STEPS if steps_in_all <= size * MOST_POINTS), BIN_STEPS[-1])
        self._points: list[tuple[Array, ...]] = []
        self._balance = EnergyBalance(replay, step_s)

    def add(self, signals: Signals) -> None:
        """Count the next steps in."""
        if not len(signals.time):
            return
        error, torque, t = signals.position - signals.reference, signals.torque, signals.time
        self.steps += len(t)
        self._squared_error += np.square(error).sum(axis=0)
        self._squared_torque += np.square(torque).sum(axis=0)
        _raise_peak(self.peak_error, self.peak_error_s, error, t)
        _raise_peak(self.peak_torque, self.peak_torque_s, torque, t)
        saturated = np.abs(torque) >= self.limit * AT_LIMIT
        self.saturated_steps += int(saturated.any(axis=1).sum())
        self.joint_saturated_steps += saturated.sum(axis=0)
        new = saturated.any(axis=0) & np.isnan(self.first_saturated_s)
        self.first_saturated_s[new] = t[saturated.argmax(axis=0)[new]]
        power = np.maximum(torque * signals.velocity, 0.0).sum(axis=1)
        self._power += float(power.sum())
        strongest = int(power.argmax())
        if power[strongest] > self.peak_power_w:
            self.peak_power_w, self.peak_power_s = float(power[strongest]), float(t[strongest])
        largest = [_largest(values, self._bin) for values in (error, torque, power[:, None])]
        # Copies: what is a view would keep every step's values.
        now = (values[:: self._bin].copy() for values in (t, signals.reference, signals.position))
        self._points.append((*now, *largest))
        self._balance.add(signals)

    @property
    def rms_error(self) -> Array:
        """(n,) root mean square over time of each joint's error."""
        return np.sqrt(self._squared_error / max(self.steps, 1))

    @property
    def rms_torque(self) -> Array:
        """(n,) Nm."""
        return np.sqrt(self._squared_torque / max(self.steps, 1))

    @property
    def torque_ratio(self) -> Array:
        """(n,) largest torque as a part of the limit, 0 where no limit is known or nothing is allowed."""
        return np.divide(self.peak_torque, self.limit, out=np.zeros(len(self.limit)), where=self.limit > 0)

    @property
    def energy_j(self) -> float:
        """What the motors gave, in J."""
        return self._power * self._step_s

    @property
    def mean_power_w(self) -> float:
        """W, over the simulated time."""
        return self._power / max(self.steps, 1)

    @property
    def energy_balance_j(self) -> tuple[float, float]:
        """(energy that came from nowhere or went nowhere, work that the motors gave or took in all), J."""
        return self._balance.result()

    def points(self) -> Points:
        """The series so far."""
        if not self._points:
            nothing = np.zeros((0, len(self.limit)))
            return Points(np.zeros(0), nothing, nothing, nothing, nothing, np.zeros(0))
        time, reference, position, error, torque, power = (np.concatenate(c) for c in zip(*self._points, strict=True))
        return Points(time, reference, position, error, torque, power[:, 0])


@dataclass(frozen=True, eq=False)
class Points:
    """One row for each run of some control steps: B rows, n joints.

    time: (B,) s, of the run's first step. reference, position: (B, n) at that time. error, torque, power: (B, n), (B, n), (B,), of the run's
    steps the value of the largest size, with its sign, so that no peak is lost.
    """

    time: Array
    reference: Array
    position: Array
    error: Array
    torque: Array
    power: Array


class EnergyBalance:
    """Does what motors, friction and stops did add up to the change of kinetic and potential energy?

    Power is integrated by the trapezoidal rule over the steps, and energies are taken at the same instants, so both are exact to the second order
    in the step. What is left is the integrator's own error: large means that the simulation can't be trusted.
    """

    def __init__(self, replay: ReplayModel, step_s: float) -> None:
        self._replay, self._step_s = replay, step_s
        self._damping = replay.damping_nms_rad
        self._work = self._gross = 0.0
        self._first: tuple[Array, Array, float] | None = None
        self._last: tuple[Array, Array, float] | None = None

    def add(self, signals: Signals) -> None:
        """Count the next steps in."""
        velocity = signals.velocity
        motors = signals.torque * velocity
        power = (motors + (signals.constraint_torque - self._damping * velocity) * velocity).sum(axis=1)
        if self._first is None:
            self._first = signals.position[0], velocity[0], float(power[0])
        self._last = signals.position[-1], velocity[-1], float(power[-1])
        self._work += float(power.sum())
        self._gross += float(np.abs(motors).sum())

    def result(self) -> tuple[float, float]:
        """(change of energy minus work, sum of the motors' work without its sign), J."""
        if self._first is None or self._last is None:
            return 0.0, 0.0
        work = (self._work - (self._first[2] + self._last[2]) / 2) * self._step_s
        change = self._energy(*self._last[:2]) - self._energy(*self._first[:2])
        return change - work, self._gross * self._step_s

    def _energy(self, position: Array, velocity: Array) -> float:
        """Kinetic plus potential energy, J."""
        model: Any = self._replay.mj
        data = mujoco.MjData(model)
        data.qpos[self._replay.qpos] = position
        data.qvel[self._replay.qvel] = velocity
        mujoco.mj_forward(model, data)
        mujoco.mj_energyPos(model, data)
        mujoco.mj_energyVel(model, data)
        return float(data.energy.sum())


def _raise_peak(peak: Array, when: Array, values: Array, time: Array) -> None:
    """Where `values` (K, n) exceed `peak` (n,) in size put the larger in, and its time into `when` (n,)."""
    size = np.abs(values)
    at = size.argmax(axis=0)
    largest = size[at, np.arange(len(at))]
    more = largest > peak
    peak[more], when[more] = largest[more], time[at[more]]


def _largest(values: Array, size: int) -> Array:
    """Of each run of `size` rows of `values` (K, m) the entry of the largest magnitude, sign kept; the last run may be shorter."""
    runs = -(-len(values) // size)
    padded = np.concatenate([values, np.repeat(values[-1:], runs * size - len(values), axis=0)])
    padded = padded.reshape(runs, size, -1)
    at = np.abs(padded).argmax(axis=1)[:, None]
    return np.take_along_axis(padded, at, axis=1)[:, 0]
