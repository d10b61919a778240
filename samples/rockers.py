"""How a planted foot rolls during its stance: heel rocker, flat, heel rise about the ball, roll-off over the toes' tips.

The sizes and shapes were chosen, within what is published for the foot's pitch (some 15° toes up at heel strike, 60° heel up at
toe-off), so that hip, knee and ankle of a leg that follows the foot stay near their normative curves.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from retarget.core.types import Array
from retarget.samples.steps import Stance, pace

STRIKE_PITCH: Final = np.radians(13.0)
"""Toes up at heel strike, at full pace."""
TOE_OFF_PITCH: Final = np.radians(62.0)
TOE_OFF_ROLL: Final = np.radians(21.0)
"""Pitch of the foot and of the toes at toe-off, at full pace."""
LEAST_PART: Final = 0.5
"""Of these two, what is left in the smallest steps."""


def heel_rocker(stance: Stance, time: Array) -> Array:
    """How far (T,) rad the foot is turned up about its heel: turning at heel strike already, at rest once flat."""
    if not np.isfinite(stance.strike):
        return np.zeros(len(time))
    u = np.minimum((time - stance.strike) / (stance.flat - stance.strike), 1.0)
    return np.asarray(STRIKE_PITCH * float(pace(stance.strike)) * (1 - u) ** 3 * (1 + 0.9 * u))


def roll_off(stance: Stance, time: Array) -> tuple[Array, Array]:
    """Pitch (T,) rad of the foot since heel-off and of the toes since the ball lifted, both starting from rest."""
    if not np.isfinite(stance.toe_off):
        return np.zeros(len(time)), np.zeros(len(time))
    part = LEAST_PART + (1 - LEAST_PART) * float(pace(stance.toe_off))

    def growth(start: float, shape: float) -> Array:
        u = np.maximum((time - start) / (stance.toe_off - start), 0.0)
        return np.asarray(u**3 * (shape - (shape - 1) * u))

    return part * TOE_OFF_PITCH * growth(stance.heel_off, 2.4), part * TOE_OFF_ROLL * growth(stance.roll, 1.8)
