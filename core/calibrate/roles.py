"""Which segments trackers may be on, and what the recordings themselves say of it: roles, or a suit's segments taken for trackers."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from retarget.core.calibration import POSE_NAMES
from retarget.core.errors import MotionError
from retarget.core.types import HumanMotion, TrackerRecording

NEEDED = ("T8", "LeftHand", "RightHand")
TRACKED = ("Pelvis", "T8", "Head", "LeftUpperArm", "LeftHand", "RightUpperArm", "RightHand")
"""Segments that a tracker may be on."""


def virtual_trackers(motion: HumanMotion) -> TrackerRecording:
    """The segments of `motion` as trackers of the same names, on chest, head, upper arms, hands and pelvis where they were measured.

    A tracker is at its segment's origin and turned like it. Raises `MotionError` when chest or hands are lacking.
    """
    names = [name for name in TRACKED if motion.has(name) and np.isfinite(motion.position[0, motion.index(name)]).all()]
    if missing := [name for name in NEEDED if name not in names]:
        raise MotionError(f"the recording doesn't track {missing[0]}; a calibration needs {', '.join(NEEDED)}")
    columns = [motion.index(name) for name in names]
    return TrackerRecording(
        time=motion.time,
        trackers=tuple(names),
        orientation=motion.orientation[:, columns],
        position=motion.position[:, columns],
        tracked=np.ones((motion.frames, len(names)), bool),
        segments={name: name for name in names},
        source=motion.source,
    )


def by_roles(recording: TrackerRecording) -> dict[str, str]:
    """Segment → tracker as the recording itself has it, in the order of `TRACKED`."""
    by_segment = {segment: tracker for tracker, segment in recording.segments.items()}
    roles = {segment: by_segment[segment] for segment in TRACKED if segment in by_segment}
    if missing := [segment for segment in NEEDED if segment not in roles]:
        known = ", ".join(f"{tracker} on {segment}" for segment, tracker in by_segment.items()) or "none"
        raise MotionError(
            f"no tracker on {missing[0]} (known: {known}; trackers: {', '.join(recording.trackers)}); name it (--roles SERIAL={missing[0]}), "
            "or let geometry tell (--assign auto)"
        )
    return roles


def check_same_trackers(by_pose: Mapping[str, TrackerRecording]) -> None:
    """Raise `MotionError` unless all poses were recorded with the Still pose's trackers."""
    expected = set(by_pose["still"].trackers)
    for pose, recording in by_pose.items():
        if set(recording.trackers) != expected:
            raise MotionError(
                f"{POSE_NAMES[pose]}: found trackers {', '.join(recording.trackers)}, expected those of the Still pose: "
                f"{', '.join(by_pose['still'].trackers)}"
            )


def is_arm(segment: str) -> bool:
    """Whether the segment is part of an arm: its tracker's mount shows in the T-pose."""
    return segment.endswith(("UpperArm", "Hand"))
