"""The pelvis in walking: carried along the path, swaying over the standing foot, as high as the legs hold it.

Amplitudes lie within what Perry & Burnfield (2010) give for healthy adults: rotation about ±4°, obliquity about ±4°, tilt ±1 to 2°,
lateral sway about ±2 cm, rise and fall of some 2 to 4 cm in all.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial
from itertools import pairwise, zip_longest
from typing import Final

import numpy as np
from retarget.core import rotations
from retarget.core.types import Array
from retarget.samples import curves, legs, normative, person, rockers, steps
from retarget.samples.person import about
from retarget.samples.steps import STRIDE, Stance

STANDING_KNEE: Final = np.radians(8.0)
LEAST_KNEE: Final = np.radians(6.0)
STRIKE_KNEE: Final = np.radians(4.0)
"""Knee flexion in standing, and the least while both feet stand; and how much it is above its norm at heel strike."""
LANDED: Final = 0.12
"""From here on, as a fraction of the stride since heel strike, the front leg alone carries the pelvis."""
ROTATION: Final = np.radians(4.0)
OBLIQUITY: Final = np.radians(3.5)
TILT: Final = np.radians(1.0)
SWAY: Final = 0.022
SURGE: Final = 0.005


def stance_knee(stance: Stance, time: Array) -> Array:
    """Knee flexion (T,) rad that the leg of `stance` is to have: standing, and more and more normative as the pace rises."""
    norm = np.radians(normative.knee_flexion_deg(stance.phase(time)))
    return np.asarray(STANDING_KNEE + steps.pace(time) * (norm - STANDING_KNEE))


@dataclass(frozen=True)
class HandOver:
    """The pelvis' height while it passes from one leg to the next, from `start` to `end` (s): a quintic and a hump of `size` m."""

    start: float
    end: float
    before: curves.Jet
    after: curves.Jet
    size: float

    def height(self, time: Array) -> Array:
        """(T,) m."""
        quintic = curves.bridge(time, self.start, self.end, self.before, self.after)[:, 0]
        return np.asarray(quintic + self.size * curves.hump(time, self.start, self.end))


@dataclass(frozen=True)
class Pelvis:
    """The pelvis over time during a walk of these stances."""

    stances: tuple[Stance, ...]

    def phase(self, time: Array) -> Array:
        """The left leg's stride phase (T,), whole numbers at its heel strikes; the right leg is half a stride apart."""
        return next(s for s in self.stances if s.side == "Left").phase(time)

    def pose(self, time: Array) -> tuple[Array, Array]:
        """Position (T, 3) m and orientation (T, 4) in the world."""
        position, orientation = self._over_ground(time)
        position[:, 2] = self.height(time)
        return position, orientation

    def hip(self, side: str, time: Array) -> tuple[Array, Array]:
        """Position (T, 3) m of one hip joint, and the pelvis' orientation (T, 4)."""
        position, orientation = self.pose(time)
        return position + rotations.rotate(orientation, person.JOINT_OFFSETS[f"{side}UpperLeg"]), orientation

    def height(self, time: Array) -> Array:
        """Height (T,) m: held by each flat leg in turn, handed over in between."""
        height = np.empty(len(time))
        # The very first stance carries nothing: both feet stand then, and the second one's leg holds the pelvis.
        since = -np.inf
        for carrying, hand_over in zip_longest(self.stances[1 : len(self._hand_overs) + 2], self._hand_overs):
            until = hand_over.start if hand_over else np.inf
            held = (time >= since) & (time < until)
            if held.any():
                height[held] = self._held_height(carrying, time[held])[:, 0]
            if hand_over:
                since = hand_over.end
                passing = (time >= until) & (time < since)
                if passing.any():
                    height[passing] = hand_over.height(time[passing])
        return height

    @cached_property
    def _hand_overs(self) -> tuple[HandOver, ...]:
        return tuple(self._hand_over(a, b) for a, b in pairwise(self.stances[1:]) if np.isfinite(a.heel_off))

    def _hand_over(self, rear: Stance, front: Stance) -> HandOver:
        """Sized so that the landing knee is as planned at heel strike, or lower where a leg would be stretched too far."""
        start, end = rear.heel_off, front.clock + LANDED * STRIDE
        before, after = (
            curves.jet(partial(self._held_height, stance), at) for stance, at in ((rear, start), (front, end))
        )
        plain = HandOver(start, end, before, after, 0.0)

        def size(stance: Stance, time: Array, knee: Array) -> float:
            wanted = self._height_for(stance, time, knee)[:, 0] - plain.height(time)
            return float((wanted / curves.hump(time, start, end)).min())

        strike = np.array([front.strike])
        behind = np.linspace(start, min(end, rear.toe_off), 24)[1:-1]
        ahead = np.linspace(front.strike, end, 14)[1:-1]
        sizes = (
            size(front, strike, stance_knee(front, strike) + STRIKE_KNEE * steps.pace(strike)),
            size(rear, behind, np.full(len(behind), LEAST_KNEE)),
            size(front, ahead, np.full(len(ahead), LEAST_KNEE)),
        )
        return HandOver(start, end, before, after, min(sizes))

    def _held_height(self, stance: Stance, time: Array) -> Array:
        """Height (T, 1) m at which the leg of `stance` has the knee that it is to have."""
        return self._height_for(stance, time, stance_knee(stance, time))

    def _height_for(self, stance: Stance, time: Array, knee: Array) -> Array:
        """Height (T, 1) m at which the planted leg of `stance` has this knee flexion (T,)."""
        ground, orientation = self._over_ground(time)
        hip = ground + rotations.rotate(orientation, person.JOINT_OFFSETS[f"{stance.side}UpperLeg"])
        ankle, _ = stance.print.pose(rockers.heel_rocker(stance, time), *rockers.roll_off(stance, time))
        to_hip = hip - ankle
        rise = np.sqrt(legs.reach(knee) ** 2 - to_hip[:, 0] ** 2 - to_hip[:, 1] ** 2)
        return np.asarray(rise - to_hip[:, 2])[:, None]

    def _over_ground(self, time: Array) -> tuple[Array, Array]:
        """The pose with its height left at zero."""
        way, amount, angle = steps.distance(time), steps.pace(time), 2 * np.pi * self.phase(time)
        direction = steps.heading(way)
        aside = steps.early_pace(time) * SWAY * np.sin(angle - 0.3)
        ahead = amount * SURGE * np.sin(2 * angle - 0.6)
        x, y = steps.path(way).T
        x = x + ahead * np.cos(direction) - aside * np.sin(direction)
        y = y + ahead * np.sin(direction) + aside * np.cos(direction)
        turn = about(2, direction - amount * ROTATION * np.cos(angle))
        tilt = about(1, amount * TILT * np.cos(2 * angle))
        drop = about(0, amount * OBLIQUITY * np.cos(angle - 0.9))
        orientation = rotations.multiply(turn, rotations.multiply(tilt, drop))
        return np.stack([x, y, np.zeros_like(x)], axis=-1), orientation
