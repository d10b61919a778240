"""Walking: normative joint curves, bent as little as needed for the feet to stand still while they stand.

Three rules make the motion:

* The pelvis is as high as the leg with the flat foot holds it, with that leg's knee on its normative curve; a quintic carries the height
  from one leg to the next while the heel of the rear foot rises and the front foot lands.
* A planted foot is where its footprint says: turning about the heel after heel strike, flat, then turning about the ball, as far as the
  normative knee asks. The rest of the leg follows in closed form (`legs.solve`).
* In swing each angle is its normative curve plus a quintic that takes the difference at toe-off to the difference at the next heel
  strike, with equal velocity and acceleration at both.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from retarget.core import rotations
from retarget.core.segments import FOOT_CONTACTS
from retarget.core.types import Array, BoolArray
from retarget.samples import curves, legs, normative, person, steps, upper_body
from retarget.samples.legs import about
from retarget.samples.steps import STRIDE, Stance, heading, pace

STANDING_KNEE: Final = np.radians(8.0)
LEAST_KNEE: Final = np.radians(6.0)
EXTRA = np.radians(4.0)
C = 0.7
RA = 1.5
FADE = 0.5
FW = 0.006
STRIKE_PITCH: Final = np.radians(18.0)
"""How far the toes point up at heel strike."""
TOE_OFF_RISE: Final = np.radians([15.0, 55.0])
"""How far the heel has risen at toe-off: leaving the stand, and at full pace."""
LANDED: Final = 0.14
"""From here on, as a fraction of the stride, the front leg alone carries the pelvis."""


@dataclass(frozen=True)
class Walk:
    """The walk of `steps`: every quantity is a function of time (T,) s."""

    stances: tuple[Stance, ...]

    @classmethod
    def planned(cls) -> Walk:
        """The walk that `steps.plan` lays out."""
        return cls(tuple(steps.plan()))

    def pose(self, time: Array) -> tuple[Array, dict[str, Array]]:
        """Pelvis position (T, 3) m and the rotation (T, 4) of every joint, as `person.forward` takes them."""
        position, orientation = self.pelvis(time)
        joints = {"Pelvis": orientation}
        for side in ("Left", "Right"):
            joints |= legs.rotations_of(self.leg(side, time), side)
        return position, joints | _upper_body(time, self.phase(time))

    def contacts(self, time: Array) -> BoolArray:
        """(T, 4), columns `core.segments.FOOT_CONTACTS`: a heel touches from strike to heel-off, toes from foot-flat to toe-off."""
        touching: NDArray[np.bool_] = np.zeros((len(time), 4), bool)
        for s in self.stances:
            touching[:, FOOT_CONTACTS.index(f"{s.side}Foot_Heel")] |= (time >= s.strike) & (time <= s.heel_off)
            touching[:, FOOT_CONTACTS.index(f"{s.side}Foot_Toe")] |= (time >= s.flat) & (time <= s.toe_off)
        return touching

    def phase(self, time: Array) -> Array:
        """The left leg's stride phase (T,), 0 at heel strike; the right leg is half a stride apart."""
        clock = next(s.clock for s in self.stances if s.side == "Left")
        return (time - clock) / STRIDE

    def pelvis(self, time: Array) -> tuple[Array, Array]:
        """Position (T, 3) m and orientation (T, 4) of the pelvis."""
        position, orientation = self._pelvis_ground(time)
        position[:, 2] = self.height(time)
        return position, orientation

    def _pelvis_ground(self, time: Array) -> tuple[Array, Array]:
        """The pelvis with its height left at zero."""
        way, amount, angle = steps.distance(time), pace(time), 2 * np.pi * self.phase(time)
        direction = heading(way)
        shift = _early_pace(time) * 0.022 * np.sin(angle - 0.3)
        forward = amount * FW * np.sin(2 * angle - 0.6)
        xy = steps.path(way)
        x = xy[:, 0] + forward * np.cos(direction) - shift * np.sin(direction)
        y = xy[:, 1] + forward * np.sin(direction) + shift * np.cos(direction)
        turn = direction - amount * np.radians(4.0) * np.cos(angle)
        drop = amount * np.radians(3.5) * np.cos(angle - 0.9)
        tilt = amount * np.radians(2.0 + 1.0 * np.cos(2 * angle))
        orientation = rotations.multiply(about(2, turn), rotations.multiply(about(1, tilt), about(0, drop)))
        return np.stack([x, y, np.zeros_like(x)], axis=-1), orientation

    def height(self, time: Array) -> Array:
        """Height (T,) m of the pelvis: held by each flat leg in turn, quintic in between."""
        height = np.zeros(len(time))
        start = -np.inf
        for now, following in pairwise(self.stances[1:]):
            if np.isinf(now.heel_off):
                break
            end, resume = now.heel_off, following.clock + LANDED * STRIDE
            held = (time >= start) & (time < end)
            height[held] = self._held_height(now, time[held])[:, 0]
            moving = (time >= end) & (time < resume)
            if moving.any():
                height[moving] = self._handed_over(now, following, resume, time[moving])
            start = resume
        held = time >= start
        height[held] = self._held_height(now, time[held])[:, 0]
        return height

    def _held_height(self, stance: Stance, time: Array) -> Array:
        """Height (T, 1) m at which the leg of `stance`, not yet rising from its heel, has its normative knee."""
        ground, orientation = self._pelvis_ground(time)
        hip = ground + rotations.rotate(orientation, person.JOINT_OFFSETS[f"{stance.side}UpperLeg"])
        ankle, _ = stance.print.pose(_heel_rocker(stance, time), np.zeros(len(time)))
        to_hip = hip - ankle
        rise = np.sqrt(legs.reach(_stance_knee(stance, time)) ** 2 - to_hip[:, 0] ** 2 - to_hip[:, 1] ** 2)
        return np.asarray(rise - to_hip[:, 2])[:, None]

    def _handed_over(self, now: Stance, following: Stance, resume: float, time: Array) -> Array:
        """Height (T,) m between `now.heel_off` and `resume`: a quintic, and a hump on it of the size that suits both legs.

        The landing leg has its normative knee at heel strike, or less height where a leg would be stretched beyond `LEAST_KNEE`.
        """
        start = now.heel_off
        jets = (
            curves.jet(partial(self._held_height, now), start),
            curves.jet(partial(self._held_height, following), resume),
        )

        def size(t: Array, wanted: Array) -> Array:
            return np.asarray((wanted - curves.bridge(t, start, resume, *jets))[:, 0] / curves.hump(t, start, resume))

        strike = np.array([following.strike])
        rear = np.linspace(start, min(resume, now.toe_off), 24)[1:-1]
        front = np.linspace(following.strike, resume, 14)[1:-1]
        straight = np.full(1, LEAST_KNEE)
        humps = [
            size(strike, self._height_for(following, strike, _stance_knee(following, strike) + EXTRA * pace(strike))),
            size(rear, self._height_for(now, rear, straight)),
            size(front, self._height_for(following, front, straight)),
        ]
        bridge = curves.bridge(time, start, resume, *jets)[:, 0]
        return np.asarray(bridge + min(float(h.min()) for h in humps) * curves.hump(time, start, resume))

    def _held_height(self, stance: Stance, time: Array) -> Array:
        """Height (T, 1) m at which the leg of `stance` has its normative knee."""
        return self._height_for(stance, time, _stance_knee(stance, time))

    def _height_for(self, stance: Stance, time: Array, knee: Array) -> Array:
        """Height (T, 1) m of the pelvis at which the planted leg of `stance` has this knee flexion (T,)."""
        ground, orientation = self._pelvis_ground(time)
        hip = ground + rotations.rotate(orientation, person.JOINT_OFFSETS[f"{stance.side}UpperLeg"])
        ankle, _ = stance.print.pose(_heel_rocker(stance, time), _heel_rise(stance, time))
        to_hip = hip - ankle
        rise = np.sqrt(legs.reach(knee) ** 2 - to_hip[:, 0] ** 2 - to_hip[:, 1] ** 2)
        return np.asarray(rise - to_hip[:, 2])[:, None]

    def leg(self, side: str, time: Array) -> Array:
        """The angles (T, 9) of one leg, columns `legs.ANGLES`."""
        angles = np.zeros((len(time), len(legs.ANGLES)))
        own = [s for s in self.stances if s.side == side]
        for i, stance in enumerate(own):
            planted = (time >= stance.strike) & (time <= stance.toe_off)
            if planted.any():
                angles[planted] = self._planted(stance, time[planted])
            if i + 1 < len(own):
                following = own[i + 1]
                swinging = (time > stance.toe_off) & (time < following.strike)
                if swinging.any():
                    angles[swinging] = self._swing(stance, following, time[swinging])
        return angles

    def _hip(self, side: str, time: Array) -> tuple[Array, Array]:
        position, orientation = self.pelvis(time)
        return position + rotations.rotate(orientation, person.JOINT_OFFSETS[f"{side}UpperLeg"]), orientation

    def _planted(self, stance: Stance, time: Array) -> Array:
        hip, pelvis = self._hip(stance.side, time)
        rise = _heel_rise(stance, time)
        ankle, foot = stance.print.pose(_heel_rocker(stance, time), rise)
        return legs.solve(hip, pelvis, ankle, foot, rise, stance.side)

    def _swing(self, before: Stance, after: Stance, time: Array) -> Array:
        def norm(t: Array) -> Array:
            return _swing_norm(before, t)

        start = curves.difference(
            curves.jet(lambda t: self._planted(before, t), before.toe_off), curves.jet(norm, before.toe_off)
        )
        end = curves.difference(
            curves.jet(lambda t: self._planted(after, t), after.strike), curves.jet(norm, after.strike)
        )
        fade = FADE * (after.strike - before.toe_off)
        rest = curves.zero(len(legs.ANGLES))
        fading = curves.bridge(
            np.minimum(time, before.toe_off + fade), before.toe_off, before.toe_off + fade, start, rest
        )
        building = curves.bridge(np.maximum(time, after.strike - fade), after.strike - fade, after.strike, rest, end)
        return norm(time) + fading + building


def _early_pace(time: Array) -> Array:
    """Like `pace`, but half a stride ahead at the start: weight shifts before the first foot lifts."""
    return curves.ramp(time, steps.START[0] - 0.3, steps.START[0] + 0.6) - curves.ramp(time, *steps.STOP)


def _heel_rocker(stance: Stance, time: Array) -> Array:
    """How far (T,) rad the foot still turns up about its heel."""
    if not np.isfinite(stance.strike):
        return np.zeros(len(time))
    u = np.minimum((time - stance.strike) / (stance.flat - stance.strike), 1.0)
    return np.asarray(STRIKE_PITCH * float(pace(stance.strike)) * (1 - u) ** 3 * (1 + C * u))


def _heel_rise(stance: Stance, time: Array) -> Array:
    """How far (T,) rad the heel has risen: from rest at heel-off, at constant speed at toe-off."""
    if not np.isfinite(stance.toe_off):
        return np.zeros(len(time))
    low, high = TOE_OFF_RISE
    u = np.maximum((time - stance.heel_off) / (stance.toe_off - stance.heel_off), 0.0)
    return np.asarray((low + (high - low) * float(pace(stance.toe_off))) * u**3 * (RA - (RA - 1) * u))


def _stance_knee(stance: Stance, time: Array) -> Array:
    norm = np.radians(normative.knee_flexion_deg((time - stance.clock) / STRIDE))
    return np.asarray(STANDING_KNEE + pace(time) * (norm + np.radians(3.0) - STANDING_KNEE))


def _swing_norm(stance: Stance, time: Array) -> Array:
    """Normative angles (T, 9) of the swing that follows `stance`, shrunk for short steps, never below what clears the floor."""
    phase = (time - stance.clock) / STRIDE
    amount = 1.0
    angles = np.zeros((len(time), len(legs.ANGLES)))
    hip, knee = np.radians(normative.hip_flexion_deg(phase)), np.radians(normative.knee_flexion_deg(phase))
    angles[:, 0] = amount * hip
    angles[:, 3] = amount * knee
    angles[:, 4] = legs.shank_rotation(knee)
    angles[:, 5] = amount * np.radians(normative.ankle_dorsiflexion_deg(phase))
    return angles


def _upper_body(time: Array, phase: Array) -> dict[str, Array]:
    """Trunk against the pelvis, head level and looking ahead along the path, arms against the legs.

    Arm swing after Murray, Sepic & Barnard, "Patterns of sagittal rotation of the upper limbs in walking" (1967): shoulder some 30° in
    all, most extended at the same side's heel strike, elbow between about 20° and 45°.
    """
    amount, angle = pace(time), 2 * np.pi * phase
    way = steps.distance(time)
    look = heading(way + 0.45 * amount) - heading(way)
    turn = amount * np.radians(7.5) * np.cos(angle)
    joints = upper_body.trunk(
        np.radians(1.0) + amount * np.radians(2.0), -amount * np.radians(3.0) * np.cos(angle - 0.9), turn
    )
    joints |= upper_body.head(
        amount * np.radians(-3.0 - 1.0 * np.cos(2 * angle)),
        np.zeros_like(time),
        look - amount * np.radians(3.0) * np.cos(angle),
    )
    for side, shifted in (("Left", angle), ("Right", angle + np.pi)):
        arm = upper_body.Arm(
            lowering=np.radians(84.0) + 0 * time,
            flexion=np.radians(2.0) + amount * np.radians(-6.0 - 15.0 * np.cos(shifted)),
            across=0 * time,
            twist=np.radians(5.0) + 0 * time,
            elbow=np.radians(14.0) + amount * np.radians(16.0 - 12.0 * np.cos(shifted - 0.35)),
            pronation=np.radians(8.0) + amount * np.radians(6.0 - 6.0 * np.cos(shifted - 0.35)),
            wrist=np.radians(5.0) + 0 * time,
        )
        joints |= arm.rotations_of(side)
    return joints
