"""From a tracking system's world to the house's, and whether the vertical that was declared can be right.

| file | up | map to X forward, Y left, Z up |
|---|---|---|
| OpenVR, SteamVR: X right, Y up, −Z forward | `y` | (x, y, z) → (−z, −x, y) |
| libsurvive, ROS: Z up | `z` | (x, y, z) → (x, y, z) |

Only the world's axes are renamed: orientations world ← tracker are turned by the same map from the left, a tracker's own axes stay as
the maker defines them. A left-handed file is mirrored first, to the right-handed world that its maker uses for the same scene (Unity
on SteamVR: z → −z; Unreal: y → −y); its tracker axes are mirrored with it, as no right-handed orientation exists otherwise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from retarget.core import rotations
from retarget.core.types import Array, BoolArray
from retarget.formats.base import Handedness, UpAxis

HOUSE_FROM_Y_UP: Array = np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""House world ← OpenVR world."""

_MIRRORED_AXIS: Mapping[UpAxis, int] = {"y": 2, "z": 1}

# The file's other candidate for up, seen in the house's axes after mapping with the declared one.
_OTHER_UP: Mapping[UpAxis, Array] = {"y": np.array([-1.0, 0.0, 0.0]), "z": np.array([0.0, 1.0, 0.0])}

PLANAR = 0.2
"""A motion is in a plane when it spreads across it less than this part of its second largest spread."""
_LEAST_SPREAD_M = 0.03
_NEAR = np.cos(np.radians(30.0))
_BELOW_FLOOR_M = -0.25
_ABOVE_FLOOR_M = (0.0, 2.5)

_UPPER_AND_LOWER = (
    ("Head", "Pelvis"),
    ("Head", "T8"),
    ("T8", "Pelvis"),
    ("Head", "LeftFoot"),
    ("Head", "RightFoot"),
    ("T8", "LeftFoot"),
    ("T8", "RightFoot"),
    ("Pelvis", "LeftFoot"),
    ("Pelvis", "RightFoot"),
)


def to_house(position: Array, orientation: Array, up: UpAxis, handedness: Handedness = "right") -> tuple[Array, Array]:
    """Positions (..., 3) and orientations (..., 4), wxyz, of a world with that vertical, in the house's world."""
    if handedness == "left":
        # Mirroring turns a rotation about n into the opposite one about the mirrored n.
        mirror = -np.ones(3)
        mirror[_MIRRORED_AXIS[up]] = 1.0
        position = position * -mirror
        orientation = orientation * np.array([1.0, *mirror])
    if up == "z":
        return position, orientation
    # As a permutation, so that values stay what they were to the last bit.
    turned = np.stack([-position[..., 2], -position[..., 0], position[..., 1]], axis=-1)
    return turned, rotations.multiply(rotations.from_matrix(HOUSE_FROM_Y_UP), orientation)


def doubt_up(position: Array, tracked: BoolArray, up: UpAxis, segments: Sequence[str | None]) -> str:
    """Why the declared vertical is unlikely, or "".

    position: (T, D, 3) m in the house's world, mapped with `up`. tracked: (T, D). segments: of each tracker, where known.

    What decides is the first of these that says anything, as a log has no gravity in it:
    1. Anatomy: of a pair such as head and pelvis the upper one is, in the median, higher along the declared axis, and not by less than
       along the other axis. Wrong only for people who lie, or stand on their hands, most of the time.
    2. A plane: where motion lies in one plane (`PLANAR`), whose normal is the other axis within 30°, rather than the declared one. Trackers
       on a robot, a cart or a table move so. A person tracked at the hands only, who draws nothing but flat figures on a wall, does not:
       there the warning is false.
    3. The floor: heights well below it along the declared axis, and all above it along the other.
    """
    seen = np.where(tracked[..., None], position, np.nan)
    other_axis = _OTHER_UP[up]
    other_name = "z" if up == "y" else "y"
    column = {segment: index for index, segment in enumerate(segments) if segment}
    for upper, lower in _UPPER_AND_LOWER:
        if upper not in column or lower not in column:
            continue
        both = tracked[:, column[upper]] & tracked[:, column[lower]]
        if not both.any():
            continue
        apart = np.median(position[both, column[upper]] - position[both, column[lower]], axis=0)
        along, across = float(apart[2]), float(apart @ other_axis)
        if along <= 0 or across > along:
            return f"up = {up} is unlikely: {upper} is {along:+.2f} m above {lower} along {up}, {across:+.2f} m along {other_name}"
        return ""
    normal = _plane_normal(seen)
    if normal is not None:
        along, across = abs(float(normal[2])), abs(float(normal @ other_axis))
        if across > _NEAR:
            return (
                f"up = {up} is unlikely: all motion lies in a plane across {other_name} (within "
                f"{np.degrees(np.arccos(min(across, 1.0))):.0f}°), as on a floor or a table"
            )
        if along > _NEAR:
            return ""
    with np.errstate(invalid="ignore"):
        heights, others = seen[..., 2][tracked], (seen @ other_axis)[tracked]
    if len(heights) and np.quantile(heights, 0.05) < _BELOW_FLOOR_M:
        low, high = _ABOVE_FLOOR_M
        if others.min() > low and others.max() < high:
            return (
                f"up = {up} is unlikely: heights go down to {heights.min():.2f} m, along {other_name} all are above 0"
            )
    return ""


def _plane_normal(seen: Array) -> Array | None:
    """The unit normal of the plane in which each tracker moves about its own mean; None when motion is no plane. NaN = not seen."""
    count = np.isfinite(seen[..., 0]).sum(axis=0)
    centre = np.nansum(seen, axis=0) / np.maximum(count, 1)[:, None]
    about = (seen - centre).reshape(-1, 3)
    about = about[np.isfinite(about[:, 0])]
    if len(about) < 3:
        return None
    variance, axes = np.linalg.eigh(about.T @ about / len(about))
    spread = np.sqrt(np.maximum(variance, 0.0))
    if spread[1] < _LEAST_SPREAD_M or spread[0] > PLANAR * spread[1]:
        return None
    return np.asarray(axes[:, 0])
