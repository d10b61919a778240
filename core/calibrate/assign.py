"""Which tracker is on which part of the body, told from where the trackers are, not from how they are called.

In the Still pose of a standing person the head is highest and the hands are lowest; between them the chest is in the middle, with an upper
arm on either side; a seventh tracker, low between the hands, is on the pelvis. Left and right follow from where the hands go in the Forward pose.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from retarget.core.errors import MotionError
from retarget.core.rotations import Array

SMALLEST_MARGIN_M = 0.04
"""Two trackers that differ by less can't be told apart: trackers slip and people stand askew by as much."""
SMALLEST_ADVANCE_M = 0.25
"""How far the hands must get ahead between the Still and the Forward pose, to say where ahead is."""

SIX = "chest, head, both upper arms and both hands (and the pelvis)"
_ADVICE = "; say which tracker is where (--roles SERIAL=SEGMENT)"


@dataclass(frozen=True)
class Assignment:
    """segments: tracker → segment. margin_m: tracker → by how much it is farther the way that decided than the next tracker, in metres."""

    segments: Mapping[str, str]
    margin_m: Mapping[str, float]


@dataclass(frozen=True)
class Body:
    """The trackers by their part of the body, sides not yet known. margin_m: as in `Assignment`; pelvis: "" for none."""

    head: str
    chest: str
    hands: tuple[str, str]
    upper_arms: tuple[str, str]
    pelvis: str
    margin_m: Mapping[str, float]


def body(still: Mapping[str, Array]) -> Body:
    """Head, chest, hands, upper arms and pelvis of tracker → position (3,) m, Z up, in the Still pose. hands[0] and upper_arms[0] are on one side.

    Raises `MotionError` when there are not six or seven trackers, and when two can't be told apart.
    """
    if len(still) not in (6, 7):
        raise MotionError(
            f"found {len(still)} trackers ({', '.join(sorted(still))}), expected six or seven: {SIX}{_ADVICE}"
        )
    height = {name: float(position[2]) for name, position in still.items()}
    by_height = sorted(still, key=lambda name: height[name])
    low, middle, highest = by_height[: len(still) - 4], by_height[len(still) - 4 : -1], by_height[-1]
    margin = {highest: height[highest] - height[middle[-1]]}
    _check(margin, highest, "the head (highest)", middle[-1])
    for name in low:
        margin[name] = height[middle[0]] - height[low[-1]]
    _check(margin, low[-1], f"a hand{' or the pelvis' if low[2:] else ''} (lowest)", middle[0])
    # The hands hang on either side of the pelvis: of the low ones they are the two that are farthest apart.
    first, second = max(
        itertools.combinations(low, 2), key=lambda pair: float(np.linalg.norm((still[pair[0]] - still[pair[1]])[:2]))
    )
    line = (still[first] - still[second])[:2]
    width = float(np.linalg.norm(line))
    if width < 4 * SMALLEST_MARGIN_M:
        raise MotionError(
            f"the lowest trackers {first} and {second}, taken for the hands, are {width:.2f} m apart; "
            f"expected them on either side of the body{_ADVICE}"
        )
    pelvis = ""
    for name in low:
        if name not in (first, second):
            pelvis = name
            beside = {hand: abs(float((still[hand] - still[name])[:2] @ line)) / width for hand in (first, second)}
            nearer = min(beside, key=lambda hand: beside[hand])
            margin[name] = min(margin[name], beside[nearer])
            _check(margin, name, "the pelvis (between the hands)", nearer)
            for hand in (first, second):
                margin[hand] = min(margin[hand], beside[hand])
    along = {name: float(still[name][:2] @ line) / width for name in middle}
    one, chest, other = sorted(middle, key=lambda name: along[name])
    for arm in (one, other):
        margin[arm] = abs(along[arm] - along[chest])
        _check(margin, arm, "an upper arm (beside the chest)", chest)
    margin[chest] = min(margin[one], margin[other])
    # `first` lies at the end of `line` toward which `along` grows.
    return Body(highest, chest, (first, second), (other, one), pelvis, margin)


def assign(still: Mapping[str, Array], forward: Mapping[str, Array]) -> Assignment:
    """Every tracker's segment, from tracker → position (3,) m in the Still and in the Forward pose, chest held in place, Z up.

    Raises `MotionError` as `body` does, and when the hands don't say where ahead is.
    """
    found = body(still)
    one, other = found.hands
    if missing := [hand for hand in found.hands if hand not in forward]:
        raise MotionError(f"Forward pose: tracker {missing[0]}, taken for a hand, is not tracked{_ADVICE}")
    advance = np.mean([forward[hand] - still[hand] for hand in found.hands], axis=0)[:2]
    distance = float(np.linalg.norm(advance))
    if distance < SMALLEST_ADVANCE_M:
        raise MotionError(
            f"Forward pose: the trackers {one} and {other}, taken for the hands, get {distance:.2f} m ahead of the Still pose; "
            f"expected at least {SMALLEST_ADVANCE_M:g} m{_ADVICE}"
        )
    to_left = np.array([-advance[1], advance[0]]) / distance
    lead = float((still[one] - still[other])[:2] @ to_left)
    width = float(np.linalg.norm((still[one] - still[other])[:2]))
    if abs(lead) < 0.7 * width:
        raise MotionError(
            f"can't tell left from right: the hands go ahead at {np.degrees(np.arccos(abs(lead) / width)):.0f}° to the perpendicular of "
            f"the line between them; expected at most 45°{_ADVICE}"
        )
    left, right = (0, 1) if lead > 0 else (1, 0)
    segments = {found.head: "Head", found.chest: "T8"}
    if found.pelvis:
        segments[found.pelvis] = "Pelvis"
    for side, index in (("Left", left), ("Right", right)):
        segments[found.hands[index]] = f"{side}Hand"
        segments[found.upper_arms[index]] = f"{side}UpperArm"
    margin = dict(found.margin_m)
    for hand in found.hands:
        margin[hand] = min(margin[hand], abs(lead) / 2)
    return Assignment(segments, margin)


def _check(margin: Mapping[str, float], tracker: str, taken_for: str, next_: str) -> None:
    if margin[tracker] < SMALLEST_MARGIN_M:
        raise MotionError(
            f"can't tell the trackers {tracker} and {next_} apart: {tracker} would be {taken_for}, by {1000 * margin[tracker]:.0f} mm; "
            f"expected at least {1000 * SMALLEST_MARGIN_M:.0f} mm{_ADVICE}"
        )
