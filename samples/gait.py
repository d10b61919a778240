"""Walking: normative joint curves, bent as little as needed for the feet to stand still while they stand.

Three rules make the motion:

* The pelvis is as high as the leg with the flat foot holds it, with that leg's knee on its normative curve; it is handed over from leg to leg
  while the rear foot rises and the front foot lands (`pelvis`).
* A planted foot is where its footprint says (`rockers`); the rest of its leg follows in closed form (`legs.solve`).
* In swing each angle is its normative curve plus what takes the difference at toe-off to zero and builds up the difference at the next heel
  strike, with equal velocity and acceleration at both.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial
from itertools import pairwise
from typing import Final

import numpy as np
from retarget.core.segments import FOOT_CONTACTS
from retarget.core.types import Array, BoolArray
from retarget.samples import curves, legs, normative, rockers, steps
from retarget.samples.pelvis import Pelvis
from retarget.samples.steps import Stance
from retarget.samples.walking_upper_body import upper_body_in_walking

FADE: Final = 0.42
"""Share of a swing in which the difference from the norm fades after toe-off, and in which it builds up before heel strike."""
FADE_AT_REST: Final = 0.65
"""The same for the swings out of standing and into it, whose differences are larger: faster, and the thigh would accelerate twice as hard as in
steady walking, which no person's does."""
TOES_AT_REST_DEG: Final = 14.0
"""What the ankle of these lifts the toes more: with the thigh sooner where it will stand, they would graze the floor."""
LIFT_DEG: Final = {"hip_flexion": 5.0, "knee_flexion": 8.0, "ankle_dorsiflexion": 4.0}
TOES_UP_DEG: Final = 24.0
"""What is added to the norm in swing to clear the floor: a hump on three joints, and toes held up (the norm has no toe joint)."""


@dataclass(frozen=True)
class Swing:
    """One foot's way through the air: norm plus what is left of the differences at both ends."""

    before: Stance
    after: Stance
    start: curves.Jet
    end: curves.Jet

    def angles(self, time: Array) -> Array:
        """(T, 9) rad, columns `legs.ANGLES`."""
        begin, finish, rest = self.before.toe_off, self.after.strike, curves.zero(len(legs.ANGLES))
        at_rest = np.isinf(self.before.strike) or np.isinf(self.after.toe_off)
        fade = (FADE_AT_REST if at_rest else FADE) * (finish - begin)
        faded, built = begin + fade, finish - fade
        fading = curves.bridge(np.minimum(time, faded), begin, faded, self.start, rest)
        building = curves.bridge(np.maximum(time, built), built, finish, rest, self.end)
        angles = swing_norm(self.before, time) + fading + building
        if at_rest:
            lift = np.radians(TOES_AT_REST_DEG) * 64 * curves.hump(np.clip(time, begin, finish), begin, finish)
            angles[:, legs.ANGLES.index("ankle_dorsiflexion")] += lift
        return np.asarray(angles)


@dataclass(frozen=True)
class Walk:
    """The walk of `steps.plan`: every quantity is a function of time (T,) s."""

    stances: tuple[Stance, ...]

    @classmethod
    def planned(cls) -> Walk:
        """The walk that `steps` lays out."""
        return cls(steps.plan())

    @cached_property
    def pelvis(self) -> Pelvis:
        """Where the pelvis is."""
        return Pelvis(self.stances)

    def pose(self, time: Array) -> tuple[Array, dict[str, Array]]:
        """Pelvis position (T, 3) m and the rotation (T, 4) of every joint, as `person.forward` takes them."""
        position, orientation = self.pelvis.pose(time)
        joints = {"Pelvis": orientation} | upper_body_in_walking(time, self.pelvis.phase(time))
        for side in ("Left", "Right"):
            joints |= legs.rotations_of(self.leg(side, time), side)
        return position, joints

    def contacts(self, time: Array) -> BoolArray:
        """(T, 4), columns `core.segments.FOOT_CONTACTS`: whether that part of the foot is on the floor and at rest.

        A heel rests from heel strike to heel-off; ball and toes from foot-flat until the ball lifts (the tips stay a little
        longer).
        """
        touching = np.zeros((len(time), 4), np.bool_)
        for s in self.stances:
            touching[:, FOOT_CONTACTS.index(f"{s.side}Foot_Heel")] |= (time >= s.strike) & (time <= s.heel_off)
            touching[:, FOOT_CONTACTS.index(f"{s.side}Foot_Toe")] |= (time >= s.flat) & (time <= s.roll)
        return touching

    def leg(self, side: str, time: Array) -> Array:
        """The angles (T, 9) rad of one leg, columns `legs.ANGLES`."""
        angles = np.zeros((len(time), len(legs.ANGLES)))
        for stance in self.stances:
            planted = (time >= stance.strike) & (time <= stance.toe_off)
            if stance.side == side and planted.any():
                angles[planted] = self._planted(stance, time[planted])
        for swing in self._swings:
            aloft = (time > swing.before.toe_off) & (time < swing.after.strike)
            if swing.before.side == side and aloft.any():
                angles[aloft] = swing.angles(time[aloft])
        return angles

    @cached_property
    def _swings(self) -> tuple[Swing, ...]:
        return tuple(
            self._swing(before, after)
            for side in ("Left", "Right")
            for before, after in pairwise(s for s in self.stances if s.side == side)
        )

    def _swing(self, before: Stance, after: Stance) -> Swing:
        def off_norm(stance: Stance, time: Array) -> Array:
            return self._planted(stance, time) - swing_norm(before, time)

        start = curves.jet(partial(off_norm, before), before.toe_off)
        return Swing(before, after, start, curves.jet(partial(off_norm, after), after.strike))

    def _planted(self, stance: Stance, time: Array) -> Array:
        hip, pelvis = self.pelvis.hip(stance.side, time)
        rise, roll = rockers.roll_off(stance, time)
        ankle, foot = stance.print.pose(rockers.heel_rocker(stance, time), rise, roll)
        return legs.solve(hip, pelvis, ankle, foot, rise - roll, stance.side)


def swing_norm(before: Stance, time: Array) -> Array:
    """Normative angles (T, 9) rad of the swing after stance `before`, with what this person lifts more to clear the floor."""
    phase = before.phase(time)
    swing = np.clip((phase - normative.TOE_OFF) / (1 - normative.TOE_OFF), 0.0, 1.0)
    hump = swing**6 * (1 - swing) ** 3 / ((2 / 3) ** 6 * (1 / 3) ** 3)
    degrees = {
        "hip_flexion": normative.hip_flexion_deg(phase),
        "knee_flexion": normative.knee_flexion_deg(phase),
        "ankle_dorsiflexion": normative.ankle_dorsiflexion_deg(phase),
    }
    angles = np.zeros((len(time), len(legs.ANGLES)))
    for name, norm in degrees.items():
        angles[:, legs.ANGLES.index(name)] = np.radians(norm + LIFT_DEG[name] * hump)
    angles[:, legs.ANGLES.index("toe_extension")] = np.radians(TOES_UP_DEG)
    knee = angles[:, legs.ANGLES.index("knee_flexion")]
    angles[:, legs.ANGLES.index("shank_rotation")] = legs.shank_rotation(knee)
    return angles
