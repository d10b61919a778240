"""Which segment a tracker sits on, as far as its name or role says so.

SteamVR's own roles (`TrackerRole_LeftElbow`, `left_elbow`), the spellings of log writers (`LeftHand`, `hand_l`, `hmd`) and canonical
segment names are understood. An elbow or knee tracker is strapped above the joint, a wrist or ankle tracker below it: SteamVR asks for
that. A `shoulder` tracker is taken at its word, on the shoulder blade; on the upper arm it needs `roles`. Serials say nothing.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from retarget.core.errors import UnknownNameError, UsageError
from retarget.core.segments import SEGMENTS

NONE = "none"
"""Given as a role: the tracker sits on no segment."""

_MIDDLE = {
    "Pelvis": "waist hip hips pelvis belt",
    "T8": "chest torso sternum upperback thorax",
    "Head": "head hmd headset",
    "Neck": "neck",
}
_SIDED = {
    "Shoulder": "shoulder",
    "UpperArm": "elbow upperarm arm",
    "ForeArm": "forearm lowerarm wrist",
    "Hand": "hand controller palm",
    "UpperLeg": "knee upperleg thigh",
    "LowerLeg": "lowerleg shin ankle",
    "Foot": "foot",
    "Toe": "toe toes",
}
_NO_SEGMENT = ("handed", "camera", "keyboard", "none", "invalid")


def _spellings() -> dict[str, str | None]:
    found: dict[str, str | None] = dict.fromkeys(_NO_SEGMENT)
    found |= {segment.lower(): segment for segment in SEGMENTS}
    found |= {word: segment for segment, words in _MIDDLE.items() for word in words.split()}
    for part, words in _SIDED.items():
        for word in words.split():
            for side in ("Left", "Right"):
                for named in (f"{side.lower()}{word}", f"{word}{side.lower()}"):
                    found[named] = f"{side}{part}"
    return found


SPELLINGS = _spellings()
"""Role or segment name, lower case without separators → canonical segment, None for a role that is on none."""

ROLES = [
    "head",
    "chest",
    "waist",
    "left_shoulder",
    "right_shoulder",
    "left_elbow",
    "right_elbow",
    "left_wrist",
    "right_wrist",
    "left_hand",
    "right_hand",
    "left_knee",
    "right_knee",
    "left_ankle",
    "right_ankle",
    "left_foot",
    "right_foot",
]
"""Roles that messages suggest."""


def segment_of(name: str) -> str | None:
    """The canonical segment that a tracker's name or role names; None when it names none."""
    words = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name)
    words = re.sub(r"(?i)(?:vive|htc)?_?tracker_?(?:role|handedness)?", " ", words)
    parts = [part for part in re.split(r"[^A-Za-z0-9]+", words.lower()) if part]
    sides = {"l": "left", "r": "right"}
    parts = [sides.get(part, part) for part in parts]
    return SPELLINGS.get("".join(parts))


def assign(
    trackers: Sequence[str], named: Mapping[str, str], chosen: Mapping[str, str], warnings: list[str]
) -> dict[str, str]:
    """Tracker → segment for those that have one.

    named: tracker → role that the file itself gives, where it does; else the tracker's own name is looked at.
    chosen: tracker → role or segment from the user, which goes first.
    Raises `UnknownNameError` for a tracker or role that doesn't exist, `UsageError` for two trackers chosen for one segment.
    Two trackers that the file gives one segment: the first keeps it, and that is added to `warnings`.
    """
    found: dict[str, str] = {}
    for tracker, role in chosen.items():
        if tracker not in trackers:
            raise UnknownNameError("tracker", tracker, trackers, where="roles")
        segment = segment_of(role)
        if segment is None:
            if role.strip().lower() in _NO_SEGMENT:
                continue
            raise UnknownNameError("role", role, [*ROLES, *SEGMENTS, NONE], where=f"roles, tracker '{tracker}'")
        if segment in found.values():
            other = next(name for name, taken in found.items() if taken == segment)
            raise UsageError(f"roles: both '{other}' and '{tracker}' are {segment}; expected one tracker a segment")
        found[tracker] = segment
    for tracker in trackers:
        if tracker in chosen:
            continue
        segment = segment_of(named.get(tracker, "")) or segment_of(tracker)
        if segment is None:
            continue
        if segment in found.values():
            other = next(name for name, taken in found.items() if taken == segment)
            if other not in chosen:
                warnings.append(f"trackers '{other}' and '{tracker}' both name {segment}: taken from '{other}'")
            continue
        found[tracker] = segment
    return {tracker: found[tracker] for tracker in trackers if tracker in found}
