"""A motion sampled at a frame rate: what the writer writes and the golden JSON states."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import Protocol

import numpy as np
from retarget.core import rotations
from retarget.core.types import Array, BoolArray
from retarget.samples import person


class Motion(Protocol):
    """Something that moves: pelvis position and joint rotations, and which parts of the feet touch the floor, at any times (T,)."""

    def pose(self, time: Array) -> tuple[Array, dict[str, Array]]: ...

    def contacts(self, time: Array) -> BoolArray: ...


@dataclass(frozen=True)
class Recording:
    """orientation: (T, 23, 4) world ← segment, T-pose invariant. position: (T, 23, 3) m. angular_velocity: (T, 23, 3) rad/s, world.
    foot_contacts: (T, 4) bool.
    """

    rate_hz: int
    orientation: Array
    position: Array
    angular_velocity: Array
    foot_contacts: BoolArray

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.orientation)


@cache
def record(motion: Motion, duration: float, rate_hz: int = 60) -> Recording:
    """Frames at 0, 1/rate, … up to `duration` s. Equal motions are computed once."""
    time = np.arange(round(duration * rate_hz) + 1) / rate_hz
    orientation, position = person.forward(*motion.pose(time))
    return Recording(rate_hz, orientation, position, _angular_velocity(motion, time), motion.contacts(time))


def turned(recording: Recording, heading: float) -> Recording:
    """The same motion of the same person facing `heading` rad to the left of +X: everything turned about the world's Z axis."""
    turn = rotations.exp(np.array([0.0, 0.0, heading]))
    return replace(
        recording,
        orientation=rotations.multiply(turn, recording.orientation),
        position=rotations.rotate(turn, recording.position),
        angular_velocity=rotations.rotate(turn, recording.angular_velocity),
    )


def _angular_velocity(motion: Motion, time: Array) -> Array:
    """The derivative of the orientations themselves, not of their samples: central differences of fourth order over ±1/240 s."""
    h = 1 / 480
    q = [person.forward(*motion.pose(time + k * h))[0] for k in (-2, -1, 0, 1, 2)]
    rate = (q[0] - 8 * q[1] + 8 * q[3] - q[4]) / (12 * h)
    # ω = 2 q̇ ⊗ q* for a unit quaternion body → world, in world axes.
    return np.asarray(2 * rotations.multiply(rate, rotations.conjugate(q[2]))[..., 1:])
