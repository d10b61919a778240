"""A shoulder from three hand points: on the axis of their circle, where arms in the three poses are perpendicular [Lim2022 eq. 1].

The paper prints the mean of the three candidates as a sum over two; it is over three.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from retarget.core import rotations
from retarget.core.calibrate.poses import Hands, least_trusted, outward
from retarget.core.calibration import POSE_NAMES, POSES, ArmCalibration
from retarget.core.errors import MotionError

Array = NDArray[np.float64]

PAIRS = ((0, 1), (1, 2), (2, 0))
"""Still and T-pose, T-pose and Forward, Forward and Still: the order of `angles_deg` and `offsets_m`."""
LARGEST_SPREAD_M = 0.1
"""How far apart the three candidates may lie. The authors' own calibration comes to 0.0997 m on one side."""
SMALLEST_HEIGHT_M = 0.05
"""Least height of the triangle of hand points: below it they are as good as on a line."""


def fit(side: str, hands: Hands, chest: Array | None = None) -> ArmCalibration:
    """The arm's shoulder, length and angles.

    side: "Left" or "Right". hands: side → (3, 3) m, operator frame (X ahead, Y left, Z up), rows = hand points in Still, T and Forward
    pose; those of the other side, where they are given, only help to tell which pose to blame.
    chest: (3,) m, a point of the chest in the same frame, or None: the shoulder must be the candidate nearer to it.

    With circumcentre c, circumradius r and unit normal n of the triangle, `k_ab = √(‖a − b‖²/2 − r²)` for each pair of points, and the
    shoulder is c ± n·mean(k). The sign is anatomy's: medial of and behind the hands' centroid. (The authors take the side of their
    frame's origin, which is wrong when the origin is on the floor.)

    Raises `MotionError`, naming the arm and the pose that fits least, when the points are on a line, when no real k exists (an angle of the
    triangle below 45°), when the k differ by more than `LARGEST_SPREAD_M`, and when the chest is on the wrong side.
    """
    points = np.asarray(hands[side], float)
    arm = f"{side.lower()} arm"
    centre, radius, normal = _circle(arm, points)
    squares = np.array([np.sum((points[a] - points[b]) ** 2) / 2 - radius**2 for a, b in PAIRS])
    if squares.min() < 0:
        a, b = PAIRS[int(np.argmin(squares))]
        bad, third = least_trusted(hands, [side])[1], 3 - a - b
        corner = np.degrees(rotations.vector_angle(points[a] - points[third], points[b] - points[third]))
        raise MotionError(
            f"{arm}, {_name(bad.pose)}: no shoulder fits: {bad}; the triangle of the hand points has {corner:.0f}° at the {_name(third)}, "
            "expected 45° to 90°"
        )
    offsets = np.sqrt(squares)
    spread = float(np.ptp(offsets))
    if spread > LARGEST_SPREAD_M:
        bad = least_trusted(hands, [side])[1]
        found = ", ".join(f"{_name(a)}–{_name(b)} {k:.3f} m" for (a, b), k in zip(PAIRS, offsets, strict=True))
        raise MotionError(
            f"{arm}, {_name(bad.pose)}: {bad}; the three estimates of the shoulder lie {spread:.3f} m apart ({found}), "
            f"expected at most {LARGEST_SPREAD_M:g} m"
        )
    # Medial and behind: against the way that the arm points sideways in T-pose and ahead in the Forward pose.
    toward_body = np.array([-1.0, -outward(side), 0.0])
    normal = normal if normal @ toward_body > 0 else -normal
    shoulder, other = centre + normal * offsets.mean(), centre - normal * offsets.mean()
    if chest is not None and np.linalg.norm(chest - shoulder) > np.linalg.norm(chest - other):
        raise MotionError(
            f"{arm}: the chest tracker is {np.linalg.norm(chest - shoulder):.2f} m from the shoulder and outside of the arms; expected it on "
            "the chest; are trackers swapped?"
        )
    arms = points - shoulder
    angles = [float(np.degrees(rotations.vector_angle(arms[a], arms[b]))) for a, b in PAIRS]
    return ArmCalibration(
        hand_points=points,
        shoulder=shoulder,
        length_m=float(np.linalg.norm(arms, axis=1).mean()),
        angles_deg=(angles[0], angles[1], angles[2]),
        offsets_m=(float(offsets[0]), float(offsets[1]), float(offsets[2])),
    )


def _circle(arm: str, points: Array) -> tuple[Array, float, Array]:
    """Centre, radius and unit normal of the circle through three points."""
    ab, ac = points[1] - points[0], points[2] - points[0]
    normal = np.cross(ab, ac)
    sides = np.array([np.linalg.norm(points[a] - points[b]) for a, b in PAIRS])
    doubled_area = float(np.linalg.norm(normal))
    if doubled_area < SMALLEST_HEIGHT_M * sides.max() or sides.max() < SMALLEST_HEIGHT_M:
        a, b = PAIRS[int(np.argmin(sides))]
        if sides.min() < SMALLEST_HEIGHT_M:
            problem = f"the hand is at the same place in {_name(a)} and {_name(b)} ({1000 * sides.min():.0f} mm apart)"
        else:
            height = doubled_area / sides.max()
            problem = f"the hand points of the three poses lie on a line (to within {1000 * height:.0f} mm)"
        raise MotionError(f"{arm}: {problem}; expected three different directions")
    centre = points[0] + np.cross(ab @ ab * ac - ac @ ac * ab, normal) / (2 * doubled_area**2)
    return centre, float(np.linalg.norm(points[0] - centre)), normal / doubled_area


def _name(pose: int) -> str:
    return POSE_NAMES[POSES[pose]]
