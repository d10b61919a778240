"""What the controller is told to follow: a trajectory's joints, in the robot's order, at the control rate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from retarget.core.errors import MotionError
from retarget.core.replay.match import matched
from retarget.core.replay.spline import CubicSpline
from retarget.core.robot_model import RobotModel
from retarget.core.types import Array, JointTrajectory


@dataclass(frozen=True, eq=False)
class Reference:
    """Joint positions at any time, and the times at which the controller looks.

    spline: (n,) rad or m over the time since the first frame, s: clocks that count from 1970 would leave few digits to differences.
    start_s: the first frame on the trajectory's own clock. step_s: s. steps: N ≥ 1 control steps.
    """

    spline: CubicSpline
    start_s: float
    step_s: float
    steps: int

    @classmethod
    def of(cls, trajectory: JointTrajectory, robot: RobotModel, rate_hz: float) -> Reference:
        """The cubic spline through the trajectory's positions, looked at `rate_hz` times a second.

        Velocities that the file states are not used: positions and velocities that contradict each other would ask for two motions.
        Raises `MotionError` for a trajectory that is shorter than one control step, and what `match.matched` raises.
        """
        positions = matched(trajectory, robot).position
        duration = float(trajectory.time[-1] - trajectory.time[0])
        steps = int(np.floor(duration * rate_hz + 1e-6))
        if steps < 1:
            raise MotionError(
                f"the trajectory has {trajectory.frames} frame{'s' * (trajectory.frames > 1)} and lasts {duration:g} s; "
                f"replaying under torque needs at least {1 / rate_hz:g} s"
            )
        spline = CubicSpline.through(trajectory.time - trajectory.time[0], positions)
        return cls(spline, float(trajectory.time[0]), 1.0 / rate_hz, steps)

    def time(self, first: int, stop: int) -> Array:
        """Times (stop − first,) s of control steps `first` to `stop` − 1, on the trajectory's own clock."""
        return np.asarray(self.start_s + self.step_s * np.arange(first, stop), np.float64)

    def positions(self, first: int, stop: int) -> Array:
        """Positions (stop − first, n) at these control steps; before the first and after the last they are extrapolated."""
        return self.at(np.arange(first, stop))

    def at(self, steps: NDArray[np.int64]) -> Array:
        """Positions (K, n) at control steps (K,)."""
        return self.spline(np.asarray(self.step_s * steps, np.float64))
