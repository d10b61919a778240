"""Exercises on the spot, both feet flat throughout: the arms through their ranges, and squats.

Every angle rests at its keys and moves between them with minimum jerk, so poses are held as they are named: N-pose (arms
down) and T-pose. The legs follow the pelvis in closed form.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from retarget.core import rotations
from retarget.core.types import Array, BoolArray
from retarget.samples import curves, legs, person, upper_body
from retarget.samples.curves import Keys
from retarget.samples.feet import Footprint
from retarget.samples.person import about


def _feet(half_width: float, toe_out_deg: float) -> dict[str, Footprint]:
    return {
        side: Footprint(0.0, left * half_width, left * float(np.radians(toe_out_deg)))
        for side, left in (("Left", 1.0), ("Right", -1.0))
    }


def _planted_legs(feet: dict[str, Footprint], position: Array, orientation: Array) -> dict[str, Array]:
    joints: dict[str, Array] = {}
    zero = np.zeros(len(position))
    for side, spot in feet.items():
        hip = position + rotations.rotate(orientation, person.JOINT_OFFSETS[f"{side}UpperLeg"])
        ankle, foot = spot.pose(zero, zero, zero)
        joints |= legs.rotations_of(legs.solve(hip, orientation, ankle, foot, zero, side), side)
    return joints


def _standing_height(knee_deg: float) -> float:
    return float(legs.reach(np.radians([knee_deg]))[0]) + person.ANKLE_HEIGHT


@dataclass(frozen=True)
class Reach:
    """Arms through their ranges: N-pose, T-pose, forward, elbows, overhead, across, pronation, wrists; head and trunk go along."""

    def pose(self, time: Array) -> tuple[Array, dict[str, Array]]:
        """Pelvis position (T, 3) m and joint rotations (T, 4) at `time` (T,) s, as `person.forward` takes them."""

        def angle(keys: Keys) -> Array:
            return np.radians(curves.keyed(time, keys))

        sway = curves.keyed(time, _SWAY)
        position = np.stack([0.3 * sway, sway, np.full_like(time, _standing_height(12.0) - 0.004)], axis=-1)
        orientation = rotations.multiply(about(2, angle(_PELVIS_TURN)), about(0, -0.6 * sway))
        joints = {"Pelvis": orientation} | _planted_legs(
            _feet(person.HIP_HALF_WIDTH + 0.02, 8.0), position, orientation
        )
        joints |= upper_body.trunk(angle(_TRUNK_FLEXION), angle(_TRUNK_SIDEBEND), angle(_TRUNK_TURN))
        joints |= upper_body.head(angle(_HEAD_FLEXION), angle(_HEAD_SIDEBEND), angle(_HEAD_TURN))
        for side, keys in _ARMS.items():
            joints |= upper_body.Arm(**{name: angle(rests) for name, rests in keys.items()}).rotations_of(side)
        return position, joints

    def contacts(self, time: Array) -> BoolArray:
        """(T, 4): both feet flat, always."""
        return np.ones((len(time), 4), bool)


REACH_DURATION: Final = 24.0
REACH_T_POSE: Final = (2.0, 2.5)
REACH_N_POSE: Final = (0.0, 0.8)
"""When the poses are held, s. In the T-pose all segments from the pelvis up are in their reference orientation; the legs are bent
by some 15° at the knee, the toes point a little outward."""


def _both(start: Keys, left: Keys, right: Keys) -> dict[str, Keys]:
    return {"Left": (*start, *left), "Right": (*start, *right)}


_LOWERING = _both(
    [(0.8, 90), (2.0, 0), (2.5, 0), (3.6, 88), (9.8, 88)],
    [(11.4, 15), (12.2, 15), (13.8, 85), (23.0, 85), (23.8, 90)],
    [(11.4, 30), (12.2, 30), (13.8, 85), (23.0, 85), (23.8, 90)],
)
_FLEXION = _both(
    [(2.5, 0), (3.6, 85), (4.3, 85), (5.5, 20), (6.6, 20)],
    [(8.2, 165), (8.8, 165), (10.4, 10), (12.6, 10), (14.2, 75), (17.6, 75), (19.0, 45), (22.4, 45), (23.6, 0)],
    [(8.2, 150), (8.8, 150), (10.4, 5), (12.6, 5), (14.6, 80), (17.2, 80), (19.0, 45), (22.4, 45), (23.6, 0)],
)
_ACROSS = _both(
    [(12.6, 0)],
    [(14.2, 0), (15.4, 40), (15.9, 40), (17.2, -30), (18.6, 0)],
    [(14.6, 0), (15.8, -25), (16.0, -25), (17.2, 42), (17.6, 42), (18.8, 0)],
)
_TWIST = _both(
    [(2.5, 0), (3.6, 8), (6.0, 8)],
    [(8.2, -20), (8.8, -20), (10.4, 10), (14.2, 25), (17.4, 10), (19.4, 0)],
    [(8.2, -15), (8.8, -15), (10.4, 15), (14.2, 20), (17.4, 15), (19.4, 0)],
)
_ELBOW = _both(
    [(2.5, 0), (3.4, 12), (3.9, 12), (5.2, 125), (5.6, 125), (6.8, 25)],
    [
        (8.2, 15),
        (8.8, 15),
        (10.2, 70),
        (11.4, 20),
        (12.6, 20),
        (14.0, 35),
        (15.4, 75),
        (17.2, 20),
        (18.6, 95),
        (22.2, 95),
        (23.6, 0),
    ],
    [
        (8.2, 25),
        (8.8, 25),
        (10.2, 60),
        (11.4, 30),
        (12.6, 30),
        (14.0, 30),
        (15.8, 20),
        (17.2, 80),
        (18.6, 85),
        (22.2, 85),
        (23.6, 0),
    ],
)
_PRONATION = _both(
    [(2.5, 0), (3.6, 15), (4.3, 15), (5.5, -50), (6.8, 0)],
    [(9.0, 0), (10.2, 20), (12.6, 20), (14.0, 0), (18.8, 0), (19.6, 60), (20.6, -60), (21.6, 40), (22.6, 0)],
    [(9.0, 0), (10.2, 10), (12.6, 10), (14.0, 0), (18.8, 0), (19.6, -55), (20.6, 55), (21.6, -20), (22.6, 0)],
)
_WRIST = _both(
    [(2.5, 0), (3.6, -15), (4.6, 20), (6.6, 0)],
    [(8.2, -25), (9.4, 5), (14.0, 5), (15.4, 25), (17.2, -20), (18.8, 0), (20.0, 30), (21.0, -30), (22.2, 0)],
    [(8.2, -20), (9.4, 8), (14.0, 8), (15.8, -20), (17.2, 25), (18.8, 0), (20.0, -30), (21.0, 30), (22.2, 0)],
)
_DEVIATION = _both(
    [(2.5, 0), (4.2, 8), (6.0, 0), (18.8, 0)],
    [(19.8, 12), (21.2, -10), (22.4, 0)],
    [(19.8, -10), (21.2, 12), (22.4, 0)],
)
_ARMS: Final = {
    side: {
        "lowering": _LOWERING[side],
        "flexion": _FLEXION[side],
        "across": _ACROSS[side],
        "twist": _TWIST[side],
        "elbow": _ELBOW[side],
        "pronation": _PRONATION[side],
        "wrist": _WRIST[side],
        "deviation": _DEVIATION[side],
    }
    for side in ("Left", "Right")
}
_SWAY: Final = (
    (2.5, 0.0),
    (4.2, 0.012),
    (6.2, -0.010),
    (8.6, 0.0),
    (11.8, 0.014),
    (15.4, -0.014),
    (17.4, 0.014),
    (20.0, 0.0),
)
_PELVIS_TURN: Final = ((2.6, 0), (4.2, 4), (6.2, -3), (8.6, 0), (14.0, 0), (15.5, -10), (17.4, 10), (19.2, 0))
_TRUNK_FLEXION: Final = (
    (2.6, 0),
    (3.8, 6),
    (5.4, 0),
    (7.0, 0),
    (8.4, -8),
    (10.4, 4),
    (13.8, 4),
    (15.4, 10),
    (17.4, 10),
    (19.2, 0),
)
_TRUNK_SIDEBEND: Final = ((2.6, 0), (4.4, 2), (6.4, -2), (9.0, 0), (11.6, 10), (13.6, -4), (15.4, 0))
_TRUNK_TURN: Final = ((2.6, 0), (4.2, 6), (6.2, -5), (8.6, 0), (14.0, 0), (15.5, -20), (17.4, 22), (19.2, 0))
_HEAD_FLEXION: Final = (
    (2.6, 0),
    (3.8, 8),
    (5.4, 18),
    (7.0, 0),
    (8.4, -20),
    (10.4, 8),
    (14.0, 5),
    (19.4, 25),
    (22.4, 25),
    (23.6, 0),
)
_HEAD_SIDEBEND: Final = ((2.6, 0), (4.6, -4), (6.4, 4), (9.0, 0), (11.6, -8), (13.6, 0))
_HEAD_TURN: Final = (
    (2.6, 0),
    (3.6, 15),
    (5.2, -20),
    (7.0, 0),
    (10.2, 0),
    (11.8, 45),
    (13.4, -45),
    (15.4, -25),
    (17.4, 30),
    (19.2, 0),
)


SQUAT_DURATION: Final = 13.0
_DEPTH: Final = (
    (1.0, 0.0),
    (2.3, 0.16),
    (2.6, 0.16),
    (3.8, 0.0),
    (4.4, 0.0),
    (6.0, 0.30),
    (6.4, 0.30),
    (7.9, 0.0),
    (8.4, 0.0),
    (10.1, 0.42),
    (10.5, 0.42),
    (12.1, 0.0),
)


@dataclass(frozen=True)
class Squat:
    """Three squats, each deeper than the last, the arms raised forward for balance."""

    def pose(self, time: Array) -> tuple[Array, dict[str, Array]]:
        """Pelvis position (T, 3) m and joint rotations (T, 4) at `time` (T,) s, as `person.forward` takes them."""
        depth = curves.keyed(time, _DEPTH)
        share = depth / 0.42
        position = np.stack(
            [-0.02 - 0.20 * share * (1 - 0.25 * share), 0 * time, _standing_height(12.0) - 0.004 - depth], axis=-1
        )
        tilt = np.radians(30.0) * share
        joints = {"Pelvis": about(1, tilt)}
        joints |= _planted_legs(_feet(person.HIP_HALF_WIDTH + 0.04, 14.0), position, joints["Pelvis"])
        joints |= upper_body.trunk(np.radians(14.0) * share, 0 * time, 0 * time)
        joints |= upper_body.head(-np.radians(30.0) * share, 0 * time, 0 * time)
        raised = share * (2 - share)
        for side in ("Left", "Right"):
            joints |= upper_body.Arm(
                lowering=np.radians(86.0) + 0 * time,
                flexion=np.radians(3.0 + 117.0 * raised),
                across=0 * time,
                twist=np.radians(5.0 + 5.0 * raised),
                elbow=np.radians(14.0 + 6.0 * raised),
                pronation=np.radians(8.0 + 30.0 * raised),
                wrist=0 * time,
                deviation=0 * time,
            ).rotations_of(side)
        return position, joints

    def contacts(self, time: Array) -> BoolArray:
        """(T, 4): both feet flat, always."""
        return np.ones((len(time), 4), bool)
