"""Where and when the feet stand during a walk: the path, the pace, and the footprints that follow from them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike
from retarget.core.errors import RetargetError
from retarget.core.timebase import minimum_jerk
from retarget.core.types import Array
from retarget.samples import normative, person
from retarget.samples.curves import ramp, ramp_integral
from retarget.samples.feet import Footprint

STRIDE: Final = 1.14
"""Duration of a stride in s (105 steps a minute)."""
SPEED: Final = 1.03
"""m/s, once under way."""
DURATION: Final = 13.2
START: Final = (1.0, 2.5)
STOP: Final = (10.5, 12.2)
"""When the pace rises from standing to walking, and falls again, s."""
TURN_START: Final = 5.6
TURN_LENGTH: Final = 4.0
TURN: Final = np.pi / 2
"""Where on the path the left turn begins and how far it stretches (m); its angle."""

FLAT: Final = 0.12
HEEL_OFF: Final = 0.37
ROLL: Final = 0.54
"""As fractions of the stride since heel strike: the foot is flat, the heel lifts, the ball lifts, the toes roll over their tips."""
UNDER_PELVIS: Final = 0.215
"""When, as a fraction of the stride since heel strike, the pelvis passes over the ankle."""
TOE_OUT: Final = np.radians(6.0)
STEP_HALF_WIDTH: Final = 0.055

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(32)


def pace(time: ArrayLike) -> Array:
    """Speed (T,) as a fraction of `SPEED`; also how far every angle of walking is away from standing."""
    return ramp(time, *START) - ramp(time, *STOP)


def early_pace(time: ArrayLike) -> Array:
    """Like `pace` but ahead of it at the start: weight shifts before the first foot lifts."""
    return ramp(time, START[0] - 0.3, START[0] + 0.6) - ramp(time, *STOP)


def distance(time: ArrayLike) -> Array:
    """Way (T,) m travelled along the path."""
    return SPEED * (ramp_integral(time, *START) - ramp_integral(time, *STOP))


def heading(way: ArrayLike) -> Array:
    """Direction (T,) rad of the path after `way` (T,) m, 0 = +X, positive to the left."""
    return TURN * minimum_jerk((np.asarray(way, float) - TURN_START) / TURN_LENGTH)


def path(way: ArrayLike) -> Array:
    """The point (T, 2) m of the path after `way` (T,) m: the integral of its direction, by Gauss-Legendre quadrature."""
    s = np.asarray(way, float)
    turning = np.clip(s - TURN_START, 0.0, TURN_LENGTH)[:, None]
    direction = heading(TURN_START + turning * (_NODES + 1) / 2)
    x = np.minimum(s, TURN_START) + (np.cos(direction) @ _WEIGHTS) * turning[:, 0] / 2
    y = (np.sin(direction) @ _WEIGHTS) * turning[:, 0] / 2
    beyond = np.maximum(s - TURN_START - TURN_LENGTH, 0.0)
    return np.stack([x + beyond * np.cos(TURN), y + beyond * np.sin(TURN)], axis=-1)


@dataclass(frozen=True)
class Stance:
    """One foot's stay on the floor. Times in s; the first stances have no strike (−inf), the last ones no end (inf).

    clock: where the stride that phases count from begins. strike: the heel lands. flat: the whole sole is down. heel_off: the heel
    lifts. roll: the ball lifts. toe_off: the toes' tips lift.
    """

    side: str
    print: Footprint
    clock: float
    strike: float
    flat: float
    heel_off: float
    roll: float
    toe_off: float

    def phase(self, time: Array) -> Array:
        """Strides (T,) since this foot's heel strike."""
        return (time - self.clock) / STRIDE


def plan() -> tuple[Stance, ...]:
    """All stances in the order of their clocks, right and left in turn, two open ones at either end. The right foot steps first."""
    # The right foot's first heel-off falls on the moment when the pace starts to rise.
    clock = START[0] - HEEL_OFF * STRIDE
    stances: list[Stance] = []
    end = float(distance(DURATION))
    while clock < DURATION:
        arrived = float(distance(clock + UNDER_PELVIS * STRIDE)) > end - 1e-3
        side = "Left" if len(stances) % 2 else "Right"
        stances.append(_stance(side, clock, first=len(stances) < 2, last=arrived))
        if arrived and stances[-2].toe_off == np.inf:
            return tuple(stances)
        clock += STRIDE / 2
    raise RetargetError(f"the walk's {DURATION} s end before both feet have arrived")


def _stance(side: str, clock: float, *, first: bool, last: bool) -> Stance:
    left = 1.0 if side == "Left" else -1.0
    over = np.array([0.0 if first else clock + UNDER_PELVIS * STRIDE])
    way = distance(over)
    (x, y), direction = path(way)[0], float(heading(way)[0])
    half = person.HIP_HALF_WIDTH + float(pace(over)[0]) * (STEP_HALF_WIDTH - person.HIP_HALF_WIDTH)
    aside_x, aside_y = -left * half * np.sin(direction), left * half * np.cos(direction)
    return Stance(
        side,
        Footprint(float(x + aside_x), float(y + aside_y), direction + left * TOE_OUT),
        clock,
        strike=-np.inf if first else clock,
        flat=-np.inf if first else clock + FLAT * STRIDE,
        heel_off=np.inf if last else clock + HEEL_OFF * STRIDE,
        roll=np.inf if last else clock + ROLL * STRIDE,
        toe_off=np.inf if last else clock + normative.TOE_OFF * STRIDE,
    )
