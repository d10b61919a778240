"""What the three calibration poses look like: which is which, where the person faces, and which arm is not as it should be.

A hand point array is (3, 3) m: rows = the hand in the Still pose (arms down), the T-pose (arms out) and the Forward pose.
`Hands` holds one for each side; both belong to one world with Z up and to one place of the chest.
"""

from __future__ import annotations

from collections.abc import Mapping
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
    """One arm in one pose, seen from the shoulder that the other two poses imply.

    pose: index in `POSES`. length_m: shoulder to hand; usual_m: the same in the other two poses. deviation_rad: angle between the arm
    and the direction it should have.
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


def least_trusted(side: str, points: Array) -> Reach:
    """The pose of one arm that fits the other two least; `points` (3, 3) m in the operator frame.

    Any two poses of a straight arm in two perpendicular directions give the shoulder and the arm's length, with two equations to spare.
    The two poses that satisfy these best are taken as good, and the third is seen from their shoulder.
    """
    axes = directions(side)
    best: tuple[float, Reach] | None = None
    for pose in range(3):
        good = [i for i in range(3) if i != pose]
        # Shoulder and length are the least-squares solution of shoulder + length · axis_i = hand_i for the two good poses.
        matrix = np.vstack([np.column_stack([np.eye(3), axes[i]]) for i in good])
        wanted = points[good].ravel()
        solution = np.linalg.lstsq(matrix, wanted, rcond=None)[0]
        misfit = float(np.linalg.norm(matrix @ solution - wanted))
        arm = points[pose] - solution[:3]
        deviation = float(np.nan_to_num(rotations.vector_angle(arm, axes[pose]), nan=np.pi))
        reach = Reach(pose, float(np.linalg.norm(arm)), float(solution[3]), deviation)
        if best is None or misfit < best[0]:
            best = misfit, reach
    assert best is not None
    return best[1]


def check_arms(hands: Hands) -> None:
    """Raise `MotionError` naming arm and pose when an arm is bent or points elsewhere; `hands` in the operator frame."""
    side, worst = max(
        ((side, least_trusted(side, hands[side])) for side in SIDES), key=lambda found: float(found[1].badness)
    )
    if worst.badness <= 1:
        return
    where = f"{side.lower()} arm, {POSE_NAMES[POSES[worst.pose]]}"
    if worst.deviation_rad > LARGEST_DEVIATION_RAD:
        raise MotionError(
            f"{where}: the hand is {np.degrees(worst.deviation_rad):.0f}° away from straight {_DIRECTIONS[worst.pose]}; "
            f"expected at most {np.degrees(LARGEST_DEVIATION_RAD):.0f}°"
        )
    hint = "is the elbow bent?" if worst.length_m < worst.usual_m else "were the elbows bent in the other poses?"
    raise MotionError(
        f"{where}: the hand is {worst.length_m:.2f} m from the shoulder, {worst.usual_m:.2f} m in the other poses; {hint} "
        f"expected at least {SHORTEST_REACH:.0%} and at most {LONGEST_REACH:.0%} of it"
    )
