"""First of all priorities: limits on joints and hands as inequalities on one velocity, which always allow to stand still.

K (q_min - q) ≤ q̇ ≤ K (q_max - q),   |q̇| ≤ q̇_max,   |J_hand q̇| ≤ box,   K (r_min - M q) ≤ M q̇ ≤ K (r_max - M q)      [Lim2022 eq. 14]
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from retarget.core.robot_model import RobotModel
from retarget.core.solve.limits import FREE_SPEED_RAD_S, ROW_MARGIN_RAD
from retarget.core.solve.problem import coupled_rows
from retarget.core.types import Array


class VelocityLimits:
    """lower, upper: (c + 6 H + m,) bounds on the velocities of the c joints solved for, H hands and m coupled rows, as of `update`.

    coupled: (m, c) rows. speed: (c,) rad/s, as given but never above `FREE_SPEED_RAD_S`. gain: K, 1/s, at most one over the time step.
    hand_box: (6,) m/s and rad/s.
    """

    def __init__(
        self, model: RobotModel, columns: NDArray[np.intp], hands: int, speed: Array, gain: float, hand_box: Array
    ) -> None:
        count = len(columns)
        self.gain, self.speed = gain, np.minimum(speed, FREE_SPEED_RAD_S)
        self._columns = columns
        self._position = np.stack([model.lower[columns], model.upper[columns]])
        self._matrix, self._rows = np.zeros((0, len(model.joint_names))), np.zeros((2, 0))
        if (rows := coupled_rows(model)) is not None:
            matrix, lower, upper = rows
            moved = (matrix[:, columns] != 0.0).any(axis=1)
            self._matrix = matrix[moved]
            self._rows = np.stack([lower[moved] + ROW_MARGIN_RAD, upper[moved] - ROW_MARGIN_RAD])
        self.coupled = np.ascontiguousarray(self._matrix[:, columns])
        self.hand_box = np.asarray(hand_box, float)
        self._bounds = np.zeros((2, count + 6 * hands + len(self.coupled)))
        self.lower, self.upper = self._bounds
        self._of_joints, self._of_rows = self._bounds[:, :count], self._bounds[:, count + 6 * hands :]
        self._bounds[:, count : count + 6 * hands] = np.stack([-np.tile(hand_box, hands), np.tile(hand_box, hands)])

    def update(self, joints: Array, step_s: float) -> None:
        """Write the bounds at all the robot's `joints` (n,), which satisfy the limits, for a step of `step_s` seconds."""
        gain = min(self.gain, 1.0 / step_s)
        np.multiply(self._position - joints[self._columns], gain, out=self._of_joints)
        np.maximum(self._of_joints[0], -self.speed, out=self._of_joints[0])
        np.minimum(self._of_joints[1], self.speed, out=self._of_joints[1])
        if len(self.coupled):
            np.multiply(self._rows - self._matrix @ joints, gain, out=self._of_rows)
        # Rounding, and nothing else, can put what satisfies the limits a little outside them.
        np.minimum(self.lower, 0.0, out=self.lower)
        np.maximum(self.upper, 0.0, out=self.upper)
