"""A foot on the floor: where its joints are while it stands flat, rocks on the heel, rises onto the ball or rolls over the toes.

The floor is z = 0. A footprint is the spot below the ankle when the foot is flat, and where the foot points to.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from retarget.core import rotations
from retarget.core.types import Array
from retarget.samples import person
from retarget.samples.person import about

_HEEL = np.array([-person.HEEL_BEHIND_ANKLE, 0.0, -person.ANKLE_HEIGHT])
"""The heel seen from the ankle, foot frame."""
_BALL = np.array([person.BALL_AHEAD_OF_ANKLE, 0.0, -person.ANKLE_HEIGHT])
"""The ball seen from the ankle, foot frame."""
_TIP = np.array([person.TOE_LENGTH, 0.0, 0.0])
"""The toes' tip seen from the ball, toe frame."""


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

    def pose(self, heel_rocker: Array, heel_rise: Array, toe_roll: Array) -> tuple[Array, Array]:
        """Ankle (T, 3) m and foot orientation (T, 4) in the world.

        heel_rocker: (T,) rad ≥ 0, toes up, turning about the heel. heel_rise: (T,) rad ≥ 0, the foot's pitch, heel up.
        toe_roll: (T,) rad ≥ 0, the toes' own pitch, turning about their tips; while it is 0 the foot turns about the ball.
        Where heel_rocker is not zero the other two are. The point that is turned about stays where it is.
        """
        rocker, rise, roll = (np.asarray(angle, float) for angle in (heel_rocker, heel_rise, toe_roll))
        yaw = about(2, np.full(len(rocker), self.yaw))
        orientation = rotations.multiply(yaw, about(1, rise - rocker))
        # The ankle moves by what turning about each point adds: p − R(θ) p, p seen from that point; nothing where θ = 0.
        moved = _turned_about(_HEEL, -rocker) + _turned_about(_BALL, rise) + _turned_about(_TIP, roll)
        return self.flat_ankle + rotations.rotate(yaw, moved), orientation


def _turned_about(point: Array, pitch: Array) -> Array:
    """Displacement (T, 3) of what `point` (3,) is measured from, when that turns by `pitch` (T,) and the point stays."""
    return np.asarray(point - rotations.rotate(about(1, pitch), point))
