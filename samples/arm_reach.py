"""An arm that reaches for a point: shoulder, elbow and palm as two bones, the elbow where people carry it.

The shoulder is rigid on the chest and the wrist straight, as [Lim2022 sec. II-B] takes them, so the second bone runs from the elbow to
the palm's centre. Everything is given in the chest's frame (X forward, Y left, Z up) from the arm's own shoulder. Directions and elbow
angles are kept rather than points: a straight arm is then exactly straight, where a point at full reach loses half its digits.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from retarget.core import rotations
from retarget.core.errors import InvalidDataError
from retarget.core.types import Array
from retarget.samples import person
from retarget.samples.person import about

PALM: Final = 0.45 * person.HAND
"""Distance of the palm's centre, the hand point, from the wrist."""

LOWER: Final = person.FOREARM + PALM
ARM_LENGTH: Final = person.UPPER_ARM + LOWER
"""Shoulder to hand point, the arm straight."""

LEFT: Final = {"Left": 1.0, "Right": -1.0}
"""Side → sign of Y on that side."""


class ArmReachError(InvalidDataError):
    """A hand point that the arm can't reach, or where the elbow's side is undefined."""


@dataclass(frozen=True, eq=False)
class Reach:
    """Where an arm is. direction: (T, 3) unit, chest frame, from shoulder to hand point. elbow: (T,) rad flexion, 0 = straight.
    inward: (T,) from 0, the palm as the upper arm carries it (down in T-pose, toward the thigh beside the body), to 1, facing the other hand.
    """

    direction: Array
    elbow: Array
    inward: Array

    @property
    def hand_point(self) -> Array:
        """(T, 3) m, chest frame, from the shoulder."""
        a, b = person.UPPER_ARM, LOWER
        distance = np.sqrt(a * a + b * b + 2 * a * b * np.cos(self.elbow))
        return np.asarray(distance[:, None] * self.direction)

    def rotations_of(self, side: str) -> dict[str, Array]:
        """Upper arm, forearm and hand of `side`: (T, 4), each in its parent's frame, as `person.forward` takes them.

        Raises `ArmReachError` within 11° of the direction in which the elbow has no side.
        """
        left = LEFT[side]
        back = -self._forward(left)
        frame = np.stack([-back, left * self.direction, np.cross(-back, left * self.direction)], axis=-1)
        # In the triangle shoulder, elbow, hand: how far the upper arm leaves the line from shoulder to hand.
        lead = np.arctan2(LOWER * np.sin(self.elbow), person.UPPER_ARM + LOWER * np.cos(self.elbow))
        upper = rotations.multiply(rotations.from_matrix(frame), about(2, left * lead))
        fore = about(2, -left * self.elbow)
        # The hand's palm is its -Z; turned about the forearm's Y by this angle it faces the body's middle as far as it can.
        middle = rotations.rotate(rotations.conjugate(rotations.multiply(upper, fore)), np.array([0.0, -left, 0.0]))
        turn = self.inward * np.arctan2(-middle[:, 0], -middle[:, 2])
        return {
            f"{side}UpperArm": upper,
            f"{side}ForeArm": rotations.multiply(fore, about(1, turn)),
        }

    def _forward(self, left: float) -> Array:
        """Unit (T, 3), at right angles to the direction: where the elbow does not point.

        The elbow points straight back while the arm hangs or is spread, and ever more down and outward the more it points forward.
        """
        ahead = self.direction[:, 0]
        pole = np.stack([np.full_like(ahead, -1.0), 0.6 * left * ahead, -ahead], axis=-1)
        pole /= np.linalg.norm(pole, axis=1, keepdims=True)
        across = pole - np.einsum("ti,ti->t", pole, self.direction)[:, None] * self.direction
        size = np.linalg.norm(across, axis=1, keepdims=True)
        if (size < 0.2).any():
            row = int(np.argmin(size))
            raise ArmReachError(
                f"hand in direction {np.round(self.direction[row], 3).tolist()} from the shoulder (row {row}); expected a "
                "direction in which the elbow can hang aside"
            )
        return np.asarray(-across / size)


def reach_for(points: Array, inward: Array) -> Reach:
    """The arm whose hand point is at `points` (T, 3) m, chest frame, from the shoulder. Raises `ArmReachError` beyond the arm's reach."""
    a, b = person.UPPER_ARM, LOWER
    distance = np.linalg.norm(points, axis=1)
    if not ((distance > abs(a - b) + 0.05) & (distance <= ARM_LENGTH)).all():
        row = int(np.argmax(np.where(distance > ARM_LENGTH, distance, -distance)))
        raise ArmReachError(
            f"hand planned {distance[row]:.4f} m from the shoulder (row {row}); expected {abs(a - b) + 0.05:.3f} to {ARM_LENGTH:.4f} m"
        )
    bend = np.arccos(np.clip((distance**2 - a * a - b * b) / (2 * a * b), -1.0, 1.0))
    return Reach(points / distance[:, None], bend, inward)


def between(start: Reach, end: Reach, fraction: Array) -> Reach:
    """From the first frame of `start` to that of `end` at `fraction` (T,): directions along the shortest arc, angles in proportion."""
    a, b = start.direction[0], end.direction[0]
    axis = np.cross(a, b)
    sine = float(np.linalg.norm(axis))
    angle = np.arctan2(sine, float(a @ b))
    turn = rotations.exp(fraction[:, None] * (angle / sine * axis if sine > 0 else axis))
    return Reach(
        rotations.rotate(turn, a),
        start.elbow[0] + fraction * (end.elbow[0] - start.elbow[0]),
        start.inward[0] + fraction * (end.inward[0] - start.inward[0]),
    )
