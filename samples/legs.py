"""Legs: from a pelvis and a planted foot to joint angles in closed form, and from joint angles to rotations.

A leg's angles are an array (T, 9) rad, columns `ANGLES`: flexion, abduction and outward rotation of the hip; flexion of the
knee and outward rotation of the shank about its own axis; dorsiflexion, eversion and outward rotation of the ankle; extension
of the toes. `left` is +1 for the left leg and −1 for the right one; the same angles on both sides are mirror images.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from retarget.core import rotations
from retarget.core.errors import RetargetError
from retarget.core.types import Array
from retarget.samples import person
from retarget.samples.person import about

ANGLES: Final = (
    "hip_flexion",
    "hip_abduction",
    "hip_rotation",
    "knee_flexion",
    "shank_rotation",
    "ankle_dorsiflexion",
    "ankle_eversion",
    "ankle_rotation",
    "toe_extension",
)


class LegReachError(RetargetError):
    """A planned foot that the leg can't reach: a mistake in a motion's plan."""


def rotations_of(angles: Array, side: str) -> dict[str, Array]:
    """Segment → (T, 4), each in its parent's frame, of one leg's `angles` (T, 9); `side` is "Left" or "Right"."""
    left = 1.0 if side == "Left" else -1.0
    a = dict(zip(ANGLES, np.moveaxis(angles, -1, 0), strict=True))
    return {
        f"{side}UpperLeg": _yxz(-a["hip_flexion"], left * a["hip_abduction"], left * a["hip_rotation"]),
        f"{side}LowerLeg": rotations.multiply(about(1, a["knee_flexion"]), about(2, left * a["shank_rotation"])),
        f"{side}Foot": _yxz(-a["ankle_dorsiflexion"], left * a["ankle_eversion"], left * a["ankle_rotation"]),
        f"{side}Toe": about(1, -a["toe_extension"]),
    }


def reach(knee_flexion: Array) -> Array:
    """Distance (T,) from hip to ankle at knee flexion (T,)."""
    l1, l2 = person.THIGH, person.SHANK
    return np.asarray(np.sqrt(l1 * l1 + l2 * l2 + 2 * l1 * l2 * np.cos(knee_flexion)))


def knee_flexion(hip: Array, ankle: Array) -> Array:
    """Knee flexion (T,) for hip and ankle joints (T, 3) m. Raises `LegReachError` when they are too far apart."""
    distance = np.linalg.norm(hip - ankle, axis=-1)
    l1, l2 = person.THIGH, person.SHANK
    cosine = (distance**2 - l1 * l1 - l2 * l2) / (2 * l1 * l2)
    if float(cosine.max()) >= 1.0:
        row = int(np.argmax(cosine))
        raise LegReachError(
            f"ankle planned {distance[row]:.4f} m from the hip (row {row}); expected below {l1 + l2:.4f} m"
        )
    return np.asarray(np.arccos(cosine))


def shank_rotation(knee_flexion: Array) -> Array:
    """The tibia's rotation (T,) about its own axis that goes with knee flexion (T,): inward, 8° at 90°."""
    return np.asarray(-np.radians(8.0) * (1 - np.cos(knee_flexion)))


def solve(hip: Array, pelvis: Array, ankle: Array, foot: Array, toe_extension: Array, side: str) -> Array:
    """Angles (T, 9) that bring the leg's ankle joint and foot where they are planned.

    hip, ankle: (T, 3) m world. pelvis, foot: (T, 4) world orientations. toe_extension: (T,) rad.
    The knee points half-way between where the pelvis and where the foot faces. Raises `LegReachError` when the foot is too far.
    """
    left = 1.0 if side == "Left" else -1.0
    up = hip - ankle
    distance = np.linalg.norm(up, axis=-1)
    knee = knee_flexion(hip, ankle)
    lean = np.arcsin(person.SHANK * np.sin(knee) / distance)
    z = up / distance[:, None]
    facing = rotations.to_matrix(pelvis)[..., 0] + rotations.to_matrix(foot)[..., 0]
    y = np.cross(z, facing)
    y /= np.linalg.norm(y, axis=-1, keepdims=True)
    plane = np.stack([np.cross(y, z), y, z], axis=-1)
    twist = shank_rotation(knee)
    thigh = plane @ _matrix(1, -lean)
    shank = plane @ _matrix(1, knee - lean) @ _matrix(2, left * twist)
    hip_y, hip_x, hip_z = _angles_yxz(np.swapaxes(rotations.to_matrix(pelvis), -1, -2) @ thigh)
    ankle_y, ankle_x, ankle_z = _angles_yxz(np.swapaxes(shank, -1, -2) @ rotations.to_matrix(foot))
    columns = [-hip_y, left * hip_x, left * hip_z, knee, twist, -ankle_y, left * ankle_x, left * ankle_z, toe_extension]
    return np.stack(columns, axis=-1)


def _yxz(y: Array, x: Array, z: Array) -> Array:
    return rotations.multiply(about(1, y), rotations.multiply(about(0, x), about(2, z)))


def _matrix(axis: int, angle: Array) -> Array:
    return rotations.to_matrix(about(axis, angle))


def _angles_yxz(matrix: Array) -> tuple[Array, Array, Array]:
    y = np.arctan2(matrix[..., 0, 2], matrix[..., 2, 2])
    x = np.arcsin(-matrix[..., 1, 2])
    z = np.arctan2(matrix[..., 1, 0], matrix[..., 1, 1])
    return y, x, z
