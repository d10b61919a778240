"""When a person's heels and toes are on the ground: from the recording where it says so, else from height and speed."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from retarget.core.types import Array, BoolArray, HumanMotion

HEIGHT_M = 0.04
"""A foot point this near to its lowest height may be on the ground …"""
SPEED_M_S = 0.35
"""… if it also moves no faster than this; a foot in swing passes its lowest point at well over 1 m/s."""
SHORTEST_S = 0.05
"""Contacts and gaps shorter than this are chatter."""


def foot_contacts(motion: HumanMotion) -> BoolArray | None:
    """(T, 4) bool, columns `core.segments.FOOT_CONTACTS`; None when the feet were not measured or not tracked."""
    if not all(motion.has(f"{side}Foot") for side in ("Left", "Right")):
        return None
    if motion.foot_contacts is not None:
        return motion.foot_contacts
    return detect(motion)


def detect(motion: HumanMotion) -> BoolArray | None:
    """Contacts (T, 4) from the height and speed of the ankle (for the heel) and of the ball of the foot (for the toe).

    Each point is judged against its own low height over the clip (2nd percentile), so the floor need not be z = 0 and no foot size is
    assumed; a foot that never comes near the other's low height is held in the air. None when positions were not tracked.
    """
    columns: dict[str, BoolArray] = {}
    toes = all(motion.has(f"{side}Toe") for side in ("Left", "Right"))
    for part, tracked in (("Foot", "Foot"), ("Toe", "Toe" if toes else "Foot")):
        points = {side: motion.position[:, motion.index(f"{side}{tracked}")] for side in ("Left", "Right")}
        if any(np.isnan(point).any() for point in points.values()):
            return None
        low = {side: float(np.percentile(point[:, 2], 2)) for side, point in points.items()}
        for side, point in points.items():
            floor = low[side] if low[side] < min(low.values()) + HEIGHT_M else min(low.values())
            near = _low_and_slow(motion.time, point, floor)
            columns[f"{side}{part}"] = _debounced(near, motion.rate_hz)
    return np.stack([columns[name] for name in ("LeftFoot", "LeftToe", "RightFoot", "RightToe")], axis=1)


def _low_and_slow(time: Array, point: Array, floor: float) -> BoolArray:
    height = point[:, 2] - floor
    if len(time) < 2:
        return np.asarray(height < HEIGHT_M)
    speed = np.linalg.norm(np.gradient(point, time, axis=0), axis=1)
    return np.asarray((height < HEIGHT_M) & (speed < SPEED_M_S))


def _debounced(contact: BoolArray, rate_hz: float) -> BoolArray:
    """Runs shorter than SHORTEST_S take the value of what surrounds them; first gaps close, then blips go."""
    shortest = max(1, round(SHORTEST_S * rate_hz))
    out = contact.copy()
    for value in (False, True):
        edges = np.flatnonzero(np.diff(out.astype(np.int8)) != 0) + 1
        bounds = np.concatenate([[0], edges, [len(out)]])
        for start, stop in pairwise(bounds.tolist()):
            inside = start > 0 and stop < len(out)
            if inside and stop - start < shortest and out[start] == value:
                out[start:stop] = not value
    return out
