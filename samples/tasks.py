"""What the operator does: the three calibration poses, circles with eyes closed, carrying a box, clapping.

Hands are planned in the chest's frame and so go with the chest, which bends and turns a little and, beside what is planned here, breathes and
sways (`sway`). What is planned starts and ends at rest. Times are seconds, lengths metres, key angles degrees.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, Protocol

import numpy as np
from retarget.core.types import Array
from retarget.samples import curves
from retarget.samples.arm_reach import LEFT, Reach, between, reach_for
from retarget.samples.curves import Keys
from retarget.samples.person import SHOULDER_HALF_WIDTH
from retarget.samples.primitive_poses import Operator, intended

_UPRIGHT: Final[Keys] = ((0.0, 0.0),)


@dataclass(frozen=True)
class Body:
    """What the rest of the body does meanwhile: the pelvis shifts (m), the trunk and the head bend and turn (degrees)."""

    forward: Keys = _UPRIGHT
    sideways: Keys = _UPRIGHT
    trunk_flexion: Keys = _UPRIGHT
    trunk_turn: Keys = _UPRIGHT
    head_flexion: Keys = _UPRIGHT
    head_turn: Keys = _UPRIGHT


class Task(Protocol):
    """Something the operator does."""

    @property
    def operator(self) -> Operator: ...

    @property
    def duration(self) -> float:
        """Its length, s."""
        ...

    @property
    def windows(self) -> Mapping[str, tuple[float, float]]:
        """What happens when: name → (start, end) s."""
        ...

    @property
    def body(self) -> Body: ...

    def arm(self, side: str, time: Array) -> Reach:
        """The arm of `side` at `time` (T,)."""
        ...


@dataclass(frozen=True)
class Calibration:
    """Still, T and Forward pose, each held for 2 s, and back."""

    operator: Operator = field(default_factory=Operator)

    @property
    def duration(self) -> float:
        """Its length, s."""
        return 11.5

    @property
    def windows(self) -> Mapping[str, tuple[float, float]]:
        """When the three poses are held, with 0.2 s to spare at either end. In their middles the sway is in its own (`sway.MIDDLE`)."""
        return {"still": (0.2, 1.8), "tpose": (4.0, 5.6), "forward": (7.8, 9.4)}

    @property
    def body(self) -> Body:
        """Upright in the Still and the T-pose; in the Forward pose the chest leans back and turns a little."""
        return Body(
            forward=((2.0, 0.0), (3.8, -0.006), (5.8, -0.006), (7.6, 0.022), (9.6, 0.022), (11.2, 0.0)),
            sideways=((2.0, 0.0), (3.8, 0.008), (5.8, 0.008), (7.6, -0.004), (9.6, -0.004), (11.2, 0.0)),
            trunk_flexion=((2.0, 0.0), (2.9, 1.0), (3.8, 0.0), (5.8, 0.0), (7.6, -1.5), (9.6, -1.5), (11.2, 0.0)),
            trunk_turn=((5.8, 0.0), (7.6, 1.0), (9.6, 1.0), (11.2, 0.0)),
            head_flexion=((5.8, 0.0), (7.6, 4.0), (9.6, 4.0), (11.2, 0.0)),
            head_turn=((2.0, 0.0), (2.9, 12.0), (3.8, 0.0), (5.8, 0.0), (6.7, -10.0), (7.6, 0.0)),
        )

    def arm(self, side: str, time: Array) -> Reach:
        """Straight in the poses, bent a little on the way."""
        held = [_straight(direction) for direction in self.operator.directions(side)]
        bend = np.radians(curves.keyed(time, _CALIBRATION_ELBOW))
        moves = (
            (held[0], held[1], 2.0, 3.8),
            (held[1], held[2], 5.8, 7.6),
            (held[2], held[0], 9.6, 11.2),
        )
        directions = np.broadcast_to(held[0].direction, (len(time), 3))
        for start, end, begin, finish in moves:
            path = between(start, end, curves.ramp(time, begin, finish))
            directions = np.where((time >= begin)[:, None], path.direction, directions)
        return Reach(directions, bend, np.zeros(len(time)))


_CALIBRATION_ELBOW: Final[Keys] = (
    *((2.0, 0.0), (2.9, 14.0), (3.8, 0.0)),
    *((5.8, 0.0), (6.7, 18.0), (7.6, 0.0)),
    *((9.6, 0.0), (10.4, 14.0), (11.2, 0.0)),
)


@dataclass(frozen=True)
class Circles:
    """Both hands draw circles in the frontal plane, mirrored, at constant speed, with closed eyes [Lim2022 sec. IV-A].

    The circle is round as it is meant: in the axes of `intended`. The hand draws it in the operator's own, `p = B_h · B_intended⁻¹ · p_meant`,
    so a mapping B_r · B_h⁻¹ onto right-angled axes makes it round again. unsteadiness: m, root mean square per axis, by which the hand wavers
    beside that, slowly; no mapping can undo it.
    """

    operator: Operator = field(default_factory=Operator)
    turns: int = 3
    diameter: float = 0.30
    period: float = 2.2
    unsteadiness: float = 0.0

    @property
    def duration(self) -> float:
        """Its length, s."""
        return round(self.windows["circles"][1] + _SPEEDING + 0.3, 9)

    @property
    def windows(self) -> Mapping[str, tuple[float, float]]:
        """When the circles are drawn at constant speed, `turns` times round; just before and after, too, the hand is on the circle."""
        start = _CIRCLES_START + _SPEEDING
        return {"circles": (round(start, 9), round(start + self.turns * self.period, 9))}

    @property
    def body(self) -> Body:
        """Shifts the weight by millimetres."""
        beats = np.arange(_CIRCLES_START, self.duration - 1.0, 1.7)
        sway = (-1.0) ** np.arange(len(beats))
        shift = [(0.5, 0.0), *zip(beats.tolist(), (0.004 * sway).tolist(), strict=True), (self.duration - 0.2, 0.0)]
        turn = [(at, 150.0 * size) for at, size in shift]
        return Body(sideways=shift, trunk_turn=turn, head_flexion=((0.5, 0.0), (2.0, 6.0)))

    def center(self, side: str) -> Array:
        """(3,) m, chest frame, from the shoulder, as it is meant."""
        return np.array([0.45, 0.05 * LEFT[side], -0.10])

    def meant(self, side: str, time: Array) -> Array:
        """(T, 3) m, chest frame, from the shoulder: where the operator believes the hand point to be.

        At the circle's bottom when its window starts, from there outward.
        """
        start, end = self.windows["circles"]
        faster = curves.ramp_integral(time, start - _SPEEDING, start)
        slower = curves.ramp_integral(time, end, end + _SPEEDING)
        angle = 2 * np.pi * (faster - slower - _SPEEDING / 2) / self.period
        radius = self.diameter / 2
        path = [0 * angle, LEFT[side] * radius * np.sin(angle), -radius * np.cos(angle)]
        return np.asarray(self.center(side) + np.stack(path, axis=-1))

    def arm(self, side: str, time: Array) -> Reach:
        """From the Still pose onto the circle, and round."""
        distorted = self.operator.basis(side) @ np.linalg.inv(intended(side))
        still = _straight(self.operator.directions(side)[0])
        first, drawn = (
            reach_for(self.meant(side, at) @ distorted.T + self._wavering(side, at), np.full(len(at), 0.3))
            for at in (np.zeros(1), time)
        )
        return _switch(time, _CIRCLES_START, between(still, first, curves.ramp(time, 0.5, 2.0)), drawn)

    def _wavering(self, side: str, time: Array) -> Array:
        """(T, 3) m, nothing at either end: per axis three sines whose periods have no common multiple within any clip."""
        start, end = self.windows["circles"]
        amount = curves.ramp(time, start, start + 1.0) * (1 - curves.ramp(time, end - 1.0, end))
        phase = 2 * np.pi * time[:, None, None] * _WAVERING_HZ + LEFT[side] * np.arange(9).reshape(3, 3)
        return np.asarray(self.unsteadiness * amount[:, None] * np.sqrt(2 / 3) * np.sin(phase).sum(axis=-1))


_WAVERING_HZ: Final = np.array([[0.23, 0.37, 0.61], [0.19, 0.33, 0.53], [0.27, 0.41, 0.73]])
_CIRCLES_START: Final = 2.2
_SPEEDING: Final = 0.4


@dataclass(frozen=True)
class BoxCarrying:
    """Both hands take a box, lift it, carry it to the left and put it down [Lim2022 sec. IV-B]; held, they stay `width` apart."""

    operator: Operator = field(default_factory=Operator)
    width: float = 0.30

    @property
    def duration(self) -> float:
        """Its length, s."""
        return 8.8

    @property
    def windows(self) -> Mapping[str, tuple[float, float]]:
        """When the hands hold the box, and when it is off the ground."""
        return {"held": (2.4, 6.6), "lifted": (2.6, 6.4)}

    @property
    def body(self) -> Body:
        """Bends down to the box, looks at it, and turns with it."""
        down = ((0.4, 0.0), (1.8, 1.0), (2.6, 1.0), (3.8, 0.1), (5.2, 0.1), (6.4, 1.0), (7.0, 1.0), (8.4, 0.0))
        return Body(
            forward=[(at, 0.02 * share) for at, share in down],
            trunk_flexion=[(at, 14.0 * share) for at, share in down],
            trunk_turn=((3.7, 0.0), (5.2, 25.0), (7.0, 25.0), (8.4, 0.0)),
            head_flexion=[(at, 20.0 * share) for at, share in down],
            head_turn=((3.5, 0.0), (4.8, 10.0), (7.0, 10.0), (8.4, 0.0)),
        )

    def arm(self, side: str, time: Array) -> Reach:
        """Reach, close, lift, carry, lower, open, back to the Still pose."""
        still, take, leave = (
            _straight(self.operator.directions(side)[0]),
            self._beside_box(side, np.array([1.8])),
            self._beside_box(side, np.array([7.0])),
        )
        there = _switch(time, 1.8, between(still, take, curves.ramp(time, 0.4, 1.8)), self._beside_box(side, time))
        return _switch(time, 7.0, there, between(leave, still, curves.ramp(time, 7.0, 8.4)))

    def _beside_box(self, side: str, time: Array) -> Reach:
        around = self.width + 0.16
        gap = curves.keyed(time, ((1.8, around), (2.4, self.width), (6.6, self.width), (7.0, around)))
        middle = np.stack([curves.keyed(time, keys) for keys in _BOX_PATH], axis=-1)
        return reach_for(_beside(side, middle, gap), np.ones(len(time)))


_BOX_PATH: Final[tuple[Keys, Keys, Keys]] = (
    ((2.6, 0.42), (3.8, 0.35), (5.2, 0.35), (6.4, 0.42)),
    ((3.7, 0.0), (5.2, 0.10), (6.4, 0.10)),
    ((2.6, -0.34), (3.8, -0.14), (5.2, -0.14), (6.4, -0.34)),
)


@dataclass(frozen=True)
class Clapping:
    """Hands meet again and again in front of the chest; the palms' centres come to within 3 cm, as thick as two half hands are."""

    operator: Operator = field(default_factory=Operator)
    claps: int = 5

    @property
    def duration(self) -> float:
        """Its length, s."""
        return round(_CLAPS_START + self.claps * _CLAP + 0.4, 9)

    @property
    def windows(self) -> Mapping[str, tuple[float, float]]:
        """When the hands touch: touch_1, touch_2, …"""
        starts = [_CLAPS_START + n * _CLAP + _CLOSING for n in range(self.claps)]
        return {f"touch_{n}": (round(at, 9), round(at + _TOUCHING, 9)) for n, at in enumerate(starts, 1)}

    @property
    def body(self) -> Body:
        """Nods with the claps."""
        nods = [(_CLAPS_START + n * _CLAP / 2, 3.0 * (n % 2)) for n in range(2 * self.claps + 1)]
        return Body(trunk_flexion=((0.4, 0.0), (1.6, 2.0)), head_flexion=nods)

    def arm(self, side: str, time: Array) -> Reach:
        """Reach, then close and open."""
        still, ready = _straight(self.operator.directions(side)[0]), self._hand(side, np.zeros(1))
        return _switch(time, _CLAPS_START, between(still, ready, curves.ramp(time, 0.4, 1.6)), self._hand(side, time))

    def _hand(self, side: str, time: Array) -> Reach:
        keys = [(_CLAPS_START, _OPEN)]
        for n, (start, end) in enumerate(self.windows.values(), 1):
            keys += [(start, _TOUCH), (end, _TOUCH), (end + _CLOSING, _OPEN), (_CLAPS_START + n * _CLAP, _OPEN)]
        middle = np.broadcast_to([0.38, 0.0, -0.12], (len(time), 3))
        return reach_for(_beside(side, middle, curves.keyed(time, keys)), np.ones(len(time)))


_CLAPS_START: Final = 1.8
_CLAP: Final = 0.72
_CLOSING: Final = 0.28
_TOUCHING: Final = 0.06
_OPEN: Final = 0.40
_TOUCH: Final = 0.03


def _straight(direction: Array) -> Reach:
    return Reach(direction[None], np.zeros(1), np.zeros(1))


def _beside(side: str, middle: Array, gap: Array) -> Array:
    """(T, 3) m from the shoulder of `side`: the hand beside `middle` (T, 3), which is given from the point between the shoulders."""
    aside = LEFT[side] * (gap / 2 - SHOULDER_HALF_WIDTH)
    return np.asarray(middle + aside[:, None] * np.array([0.0, 1.0, 0.0]))


def _switch(time: Array, instant: float, before: Reach, after: Reach) -> Reach:
    """`before` until `instant`, `after` from then on; both rest there."""
    late = time >= instant
    return Reach(
        np.where(late[:, None], after.direction, before.direction),
        np.where(late, after.elbow, before.elbow),
        np.where(late, after.inward, before.inward),
    )
