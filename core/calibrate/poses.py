"""What the three calibration poses look like: which is which, where the person faces, and which arm is not as it should be.

A hand point array is (3, 3) m: rows = the hand in the Still pose (arms down), the T-pose (arms out) and the Forward pose.
`Hands` holds one for each side; both belong to one world with Z up and to one place of the chest.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from retarget.core import rotations
from retarget.core.calibration import POSE_NAMES, POSES, SIDES
from retarget.core.errors import MotionError

Array = NDArray[np.float64]
Hands = Mapping[str, Array]

LARGEST_DEVIATION_RAD = float(np.radians(35.0))
"""How far an arm may point away from down, sideways or ahead. The authors' own arms were up to 16° off."""
SHORTEST_REACH, LONGEST_REACH = 0.88, 1.2
"""Distance of a hand from the shoulder, as a part of that in the other poses: 0.88 is an elbow bent by 57°; the authors' least is 0.92."""
LEAST_DROP_M = 0.15
"""How much lower than in any other pose the hands hang in the Still pose, at least."""

_DIRECTIONS = ("down", "sideways", "ahead")


@dataclass(frozen=True)
class Reach:
    """One arm in one pose, seen from the shoulder that the other hands imply.

    pose: index in `POSES`. length_m: shoulder to hand; usual_m: the same by the other hands. deviation_rad: angle between the arm and
    the direction it should have.
    """

    pose: int
    length_m: float
    usual_m: float
    deviation_rad: float

    @property
    def badness(self) -> float:
        """0 as it should be, 1 at the limits of what is accepted."""
        ratio = self.length_m / self.usual_m if self.usual_m > 0 else np.inf
        off = (1 - ratio) / (1 - SHORTEST_REACH) if ratio < 1 else (ratio - 1) / (LONGEST_REACH - 1)
        return float(max(off, self.deviation_rad / LARGEST_DEVIATION_RAD))

    def __str__(self) -> str:
        off = f"{np.degrees(self.deviation_rad):.0f}° off straight {_DIRECTIONS[self.pose]}"
        return f"the hand is {self.length_m:.2f} m from the shoulder, not {self.usual_m:.2f} m, and {off}"


def outward(side: str) -> float:
    """+1 for the left side, whose arm points along +Y in T-pose, and -1 for the right."""
    return 1.0 if side == "Left" else -1.0


def directions(side: str) -> Array:
    """(3, 3), rows: unit vectors from shoulder to hand in the three poses of a perfect operator, operator frame."""
    return np.array([[0.0, 0.0, -1.0], [0.0, outward(side), 0.0], [1.0, 0.0, 0.0]])


def facing(hands: Hands) -> tuple[float, float]:
    """(heading, disagreement) in rad: the person's yaw in the world of `hands`, and the angle between the two directions it was made of.

    They are the perpendicular of the line between the hands in T-pose, and the way from the hands' midpoint in the other poses to that
    in the Forward pose; each counts by its length. Only the person's anatomy takes part, never how a tracker is strapped on.
    Raises `MotionError` when the hand called left is on the right, and when the hands don't tell.
    """
    across = (hands["Left"][1] - hands["Right"][1])[:2]
    middle = (hands["Left"] + hands["Right"])[:, :2] / 2
    ahead = middle[2] - (middle[0] + middle[1]) / 2
    by_line = np.array([across[1], -across[0]])
    if min(np.linalg.norm(by_line), np.linalg.norm(ahead)) < 0.1:
        raise MotionError(
            f"can't tell where the person faces: the hands are {np.linalg.norm(across):.2f} m apart in the T-pose and move "
            f"{np.linalg.norm(ahead):.2f} m ahead in the Forward pose; expected at least 0.1 m of both"
        )
    if by_line @ ahead < 0:
        raise MotionError(
            "the hands are swapped: with the Forward pose ahead, the hand called left is on the right in the T-pose; "
            "expected LeftHand on the left"
        )
    both = by_line + ahead
    disagreement = float(rotations.vector_angle(np.append(by_line, 0.0), np.append(ahead, 0.0)))
    return float(np.arctan2(both[1], both[0])), disagreement


def check_order(hands: Hands) -> None:
    """Raise `MotionError` when the poses are not what they are called, and say what each looks like instead.

    Needs no facing direction: in the Still pose the hands are lowest, and of the other two the T-pose has them farther apart.
    """
    height = (hands["Left"] + hands["Right"])[:, 2] / 2
    apart = np.linalg.norm((hands["Left"] - hands["Right"])[:, :2], axis=1)
    still, *others = np.argsort(height).tolist()
    if height[others].min() - height[still] < LEAST_DROP_M:
        lowest, next_ = (POSE_NAMES[POSES[i]] for i in (still, others[0]))
        raise MotionError(
            f"no pose has the arms hanging: the hands are only {height[others].min() - height[still]:.2f} m lower in what is given "
            f"as {lowest} than in the {next_}; expected at least {LEAST_DROP_M:g} m in the Still pose"
        )
    forward, tpose = sorted(others, key=lambda i: float(apart[i]))
    looks_like = {still: 0, tpose: 1, forward: 2}
    if wrong := [given for given in range(3) if looks_like[given] != given]:
        found = ", ".join(
            f"what is given as {POSE_NAMES[POSES[i]]} looks like the {POSE_NAMES[POSES[looks_like[i]]]}" for i in wrong
        )
        detail = ", ".join(f"{POSES[i]} {height[i] - height[still]:.2f} and {apart[i]:.2f} m" for i in range(3))
        raise MotionError(f"the poses are swapped: {found} (hands' height over the lowest, and distance: {detail})")


def least_trusted(hands: Hands, among: Iterable[str] = SIDES) -> tuple[str, Reach]:
    """(side, pose) of the hand that fits all the others least, of the arms `among`; `hands` in the operator frame, of one arm or both.

    In the three poses straight arms of one length L are perpendicular, so that every hand is at
    `shoulder + L a + u (z × a)`, with the arm's ideal direction a and u = L · (a turn of the whole person): linear in the shoulders, L and
    u. That is solved without one hand, for each; the one whose absence leaves the smallest misfit is seen from what the others say.
    """
    sides = list(hands)
    rows, wanted, owner = [], [], []
    for column, side in enumerate(sides):
        for pose, axis in enumerate(directions(side)):
            block = np.zeros((3, 3 * len(sides) + 2))
            block[:, 3 * column : 3 * column + 3] = np.eye(3)
            block[:, -2], block[:, -1] = axis, np.cross([0.0, 0.0, 1.0], axis)
            rows.append(block)
            wanted.append(hands[side][pose])
            owner.append((side, pose))
    best: tuple[float, str, Reach] | None = None
    for index, (side, pose) in enumerate(owner):
        if side not in among:
            continue
        good = [i for i in range(len(owner)) if i != index]
        matrix, points = np.concatenate([rows[i] for i in good]), np.concatenate([wanted[i] for i in good])
        solution = np.linalg.lstsq(matrix, points, rcond=None)[0]
        misfit = float(np.linalg.norm(matrix @ solution - points))
        if best is not None and misfit >= best[0]:
            continue
        ideal = rows[index][:, -2:] @ solution[-2:]
        arm = wanted[index] - (rows[index] @ solution - ideal)
        deviation = float(np.nan_to_num(rotations.vector_angle(arm, ideal), nan=np.pi))
        usual = float(np.linalg.norm(solution[-2:]))
        best = misfit, side, Reach(pose, float(np.linalg.norm(arm)), usual, deviation)
    assert best is not None
    return best[1], best[2]


def check_arms(hands: Hands) -> None:
    """Raise `MotionError` naming arm and pose when an arm is bent or points elsewhere; `hands` of both arms in the operator frame."""
    check_arm(*least_trusted(hands))


def check_arm(side: str, worst: Reach) -> None:
    """Raise `MotionError` when the hand that `least_trusted` found is beyond what is accepted."""
    if worst.badness <= 1:
        return
    low, high = SHORTEST_REACH * worst.usual_m, LONGEST_REACH * worst.usual_m
    hint = "; is the elbow bent?" if worst.length_m < 0.95 * worst.usual_m else ""
    raise MotionError(
        f"{side.lower()} arm, {POSE_NAMES[POSES[worst.pose]]}: by the other poses {worst}; "
        f"expected {low:.2f} to {high:.2f} m and at most {np.degrees(LARGEST_DEVIATION_RAD):.0f}°{hint}"
    )
