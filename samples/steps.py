"""Where and when the feet stand during a walk: the path, the pace, and the footprints that follow from them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from retarget.core.timebase import minimum_jerk
from retarget.core.types import Array
from retarget.samples import normative, person
from retarget.samples.curves import ramp, ramp_integral
from retarget.samples.feet import Footprint

STRIDE: Final = 1.12
"""Duration of a stride in s (107 steps a minute)."""
SPEED: Final = 1.10
"""m/s, once under way."""
FLAT: Final = 0.11
HEEL_OFF: Final = 0.38
MID: Final = 0.245
"""Foot flat, heel off and the pelvis above the ankle, as fractions of the stride since heel strike."""
TOE_OUT: Final = np.radians(6.0)
STEP_HALF_WIDTH: Final = 0.055

START: Final = (1.0, 2.5)
STOP: Final = (10.5, 12.2)
"""When the pace rises from standing to walking and falls again, s."""
DURATION: Final = 13.2
TURN_START: Final = 5.6
TURN_LENGTH: Final = 4.0
TURN: Final = np.pi / 2
"""Where on the path the left turn begins, how far it stretches (m), and its angle."""


def pace(time: ArrayLike) -> Array:
    """Speed (T,) as a fraction of `SPEED`; also how far every angle of walking is away from standing."""
    return ramp(time, *START) - ramp(time, *STOP)


def distance(time: ArrayLike) -> Array:
    """Way (T,) m travelled along the path."""
    return SPEED * (ramp_integral(time, *START) - ramp_integral(time, *STOP))


def heading(way: ArrayLike) -> Array:
    """Direction (T,) rad of the path after `way` (T,) m, 0 = +X, positive to the left."""
    return TURN * minimum_jerk((np.asarray(way, float) - TURN_START) / TURN_LENGTH)


def path(way: ArrayLike) -> Array:
    """The point (T, 2) m of the path after `way` (T,) m: the integral of its direction."""
    s = np.asarray(way, float)
    nodes, weights = np.polynomial.legendre.leggauss(32)
    turning = np.clip(s - TURN_START, 0.0, TURN_LENGTH)[:, None]
    direction = heading(TURN_START + turning * (nodes + 1) / 2)
    x = np.minimum(s, TURN_START) + (np.cos(direction) @ weights) * turning[:, 0] / 2
    y = (np.sin(direction) @ weights) * turning[:, 0] / 2
    beyond = np.maximum(s - TURN_START - TURN_LENGTH, 0.0)
    return np.stack([x + beyond * np.cos(TURN), y + beyond * np.sin(TURN)], axis=-1)


@dataclass(frozen=True)
class Stance:
    """One foot's stay on the floor. Times in s; the first stances have no strike (−inf), the last ones no end (inf).

    clock: the time that counts as the stride's start, from which phases run.
    """

    side: str
    print: Footprint
    clock: float
    strike: float
    flat: float
    heel_off: float
    toe_off: float


def plan() -> list[Stance]:
    """All stances in the order of their clocks, left and right in turn. The right foot takes the first step."""
    first_strike = START[0] + (normative.TOE_OFF - HEEL_OFF + 1 - normative.TOE_OFF) * STRIDE
    stances = []
    for k in range(-2, 100):
        clock = first_strike + k * STRIDE / 2
        middle = clock + MID * STRIDE
        last = bool(distance(middle) >= distance(DURATION) - 1e-3) if k > 0 else False
        done = last and bool(stances) and stances[-1].toe_off == np.inf
        stances.append(_stance("Right" if k % 2 == 0 else "Left", clock, first=k < 0, last=last))
        if done:
            return stances
    raise AssertionError("the walk never ends")


def _stance(side: str, clock: float, *, first: bool, last: bool) -> Stance:
    left = 1.0 if side == "Left" else -1.0
    middle = np.array([clock + MID * STRIDE]) if not first else np.array([0.0])
    way = distance(middle)
    (x, y), direction = path(way)[0], float(heading(way)[0])
    half = person.HIP_HALF_WIDTH + float(pace(middle)[0]) * (STEP_HALF_WIDTH - person.HIP_HALF_WIDTH)
    spot = Footprint(
        float(x - left * half * np.sin(direction)),
        float(y + left * half * np.cos(direction)),
        direction + left * TOE_OUT,
    )
    return Stance(
        side,
        spot,
        clock,
        strike=-np.inf if first else clock,
        flat=-np.inf if first else clock + FLAT * STRIDE,
        heel_off=np.inf if last else clock + HEEL_OFF * STRIDE,
        toe_off=np.inf if last else clock + normative.TOE_OFF * STRIDE,
    )
