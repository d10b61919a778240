"""A foot on the floor: where its joints are while it stands flat, rocks on the heel or rises onto the ball.

The floor is z = 0. A footprint is the spot below the ankle when the foot is flat, and where the foot points to.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from retarget.core import rotations
from retarget.core.types import Array
from retarget.samples import person
from retarget.samples.legs import about, reach

_HEEL = np.array([-person.HEEL_BEHIND_ANKLE, 0.0, -person.ANKLE_HEIGHT])
_BALL = np.array([person.BALL_AHEAD_OF_ANKLE, 0.0, -person.ANKLE_HEIGHT])


@dataclass(frozen=True)
class Footprint:
    """x, y: m, below the ankle of the flat foot. yaw: rad, where the foot points."""

    x: float
    y: float
    yaw: float

    @property
    def flat_ankle(self) -> Array:
        """(3,) m, world: the ankle joint while the foot is flat."""
        return np.array([self.x, self.y, person.ANKLE_HEIGHT])

    def pose(self, heel_rocker: Array, heel_rise: Array) -> tuple[Array, Array]:
        """Ankle (T, 3) m and foot orientation (T, 4) in the world.

        heel_rocker: (T,) rad ≥ 0, toes up, turning about the heel. heel_rise: (T,) rad ≥ 0, heel up, turning about the ball.
        One of the two is zero in every row; the point it turns about stays where it is.
        """
        rocker, rise = np.asarray(heel_rocker, float), np.asarray(heel_rise, float)
        yaw = about(2, np.full(len(rocker), self.yaw))
        orientation = rotations.multiply(yaw, about(1, rise - rocker))
        # The ankle moves by what turning about the heel or the ball adds: p − R(θ)p, and nothing where θ = 0.
        about_heel = _HEEL - rotations.rotate(about(1, -rocker), _HEEL)
        about_ball = _BALL - rotations.rotate(about(1, rise), _BALL)
        return self.flat_ankle + rotations.rotate(yaw, about_heel + about_ball), orientation

    def heel_rise(self, hip: Array, knee_flexion: Array) -> Array:
        """How far (T,) rad the heel must rise for a leg from `hip` (T, 3) m with `knee_flexion` (T,) to end on the planted ball.

        In the foot's vertical plane the ankle turns about the ball; its distance from the hip is given by the knee:
        the law of cosines for the triangle hip, ball, ankle, solved for the foot's angle.
        """
        cos, sin = np.cos(self.yaw), np.sin(self.yaw)
        dx, dy = hip[:, 0] - self.x, hip[:, 1] - self.y
        forward = cos * dx + sin * dy - person.BALL_AHEAD_OF_ANKLE
        left, up = cos * dy - sin * dx, hip[:, 2]
        size = np.hypot(_BALL[0], _BALL[2])
        k = (forward**2 + left**2 + up**2 + size**2 - reach(knee_flexion) ** 2) / 2
        bearing = np.arctan2(up, forward) + np.arccos(k / (size * np.hypot(forward, up)))
        return np.asarray(np.arctan2(-_BALL[2], -_BALL[0]) - bearing)
