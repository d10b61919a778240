"""Nobody stands perfectly still: how the operator breathes and sways, whatever else is done.

Millimetres and tenths of a degree, as usual for quiet standing (breathing some 16 times a minute, swaying below 1 Hz); the amounts and phases are
this project's own choice. All of it goes through its middle, in which the body is upright, at 1.0, 4.8 and 8.6 s and is odd in time about
these: averaged over a stretch around any of them, such as the calibration poses, it leaves the upright body.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from retarget.core.types import Array

MIDDLE: Final = 1.0
BETWEEN_MIDDLES: Final = 3.8
"""s. A sine that is zero in both of two neighbouring middles has a multiple of half a period between them."""

BREATHING_HZ: Final = 2 / (2 * BETWEEN_MIDDLES)
SWAYING_HZ: Final = 3 / (2 * BETWEEN_MIDDLES)
ROCKING_HZ: Final = 4 / (2 * BETWEEN_MIDDLES)
"""0.26, 0.39 and 0.53 Hz: no two of these sines ever turn round at the same time, so the body is never at rest."""


@dataclass(frozen=True, eq=False)
class Sway:
    """What comes on top of what is meant, each (T,). The pelvis in m; trunk and head as `upper_body` takes them, in rad."""

    forward: Array
    sideways: Array
    trunk_flexion: Array
    trunk_sidebend: Array
    trunk_turn: Array
    head_flexion: Array
    head_sidebend: Array
    head_turn: Array


def sway(time: Array) -> Sway:
    """The sway at `time` (T,) s."""
    breath, slow, quick = (
        np.sin(2 * np.pi * rate * (np.asarray(time, float) - MIDDLE)) for rate in (BREATHING_HZ, SWAYING_HZ, ROCKING_HZ)
    )
    degree = np.pi / 180
    return Sway(
        forward=0.003 * slow,
        sideways=0.002 * quick,
        # Breathing in stretches the trunk; the head keeps looking ahead.
        trunk_flexion=degree * (0.10 * slow - 0.25 * breath),
        trunk_sidebend=degree * -0.12 * quick,
        trunk_turn=degree * 0.15 * slow,
        head_flexion=degree * (0.20 * breath + 0.10 * quick),
        head_sidebend=degree * 0.10 * slow,
        head_turn=degree * 0.20 * quick,
    )
