"""The operator's `Calibration` from recordings of the Still, T and Forward pose [Lim2022 sec. II-B].

Only the person's body decides: where the person faces comes from the hands, the shoulders from the hands and the chest, and how each tracker
is strapped on from the pose it has in the Still pose (chest, head) and in the T-pose (arms). Any heading, any mount and any origin will do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
from retarget.core.calibrate.assign import Assignment, assign, body
from retarget.core.calibrate.doubts import offset_warnings, warnings_of
from retarget.core.calibrate.person import OffsetFrame, Person
from retarget.core.calibrate.roles import NEEDED, by_roles, check_same_trackers, is_arm, virtual_trackers
from retarget.core.calibrate.windows import MeanPose, Window, average, find, in_chest_of, still_stretches
from retarget.core.calibration import POSE_NAMES, POSES, Calibration
from retarget.core.errors import MotionError, UsageError
from retarget.core.rotations import Array
from retarget.core.types import HumanMotion, TrackerRecording

Recording = TrackerRecording | HumanMotion
AssignBy = Literal["roles", "auto"]

TRACKER_HAND_OFFSET_M = (-0.08, 0.0, 0.0)
"""From a hand tracker to the hand point, in the tracker's own axes: the authors' code. It fits trackers that are mounted like theirs."""


def calibrate(
    recordings: Recording | Mapping[str, Recording],
    *,
    windows: Mapping[str, Window] | None = None,
    assign_by: AssignBy | None = None,
    hand_offset_m: Sequence[float] | None = None,
    hand_offset_frame: OffsetFrame = "tracker",
) -> Calibration:
    """The operator in `recordings`: one that holds all three poses, or pose ("still", "tpose", "forward") → its own.

    Of a `HumanMotion` (MVNX) the segments' origins serve as trackers.
    windows: pose → (start, end) s on its recording's clock. Those not given are found: the still stretches whose arms fit best.
    assign_by: "roles" takes tracker → segment from the recording, "auto" tells it from geometry; None: roles where they name chest and hands.
    hand_offset_m: from the hand tracker to the hand point, (3,) m; default `TRACKER_HAND_OFFSET_M` for trackers, 0 for a `HumanMotion`.
    hand_offset_frame: "tracker" = the tracker's own axes (both hands alike); "hand" = the hand's axes in T-pose: ahead, outward along the
    arm, up, which needs no knowledge of the mount: (0, -0.08, 0) is 8 cm back toward the wrist on both sides.

    Raises `MotionError` for poses that aren't there, can't be used or are mixed up, naming arm and pose, and for trackers that are missing
    or can't be told apart; `UsageError` for arguments that contradict the recordings.
    """
    given = recordings if isinstance(recordings, Mapping) else dict.fromkeys(POSES, recordings)
    if set(given) != set(POSES):
        raise UsageError(f"found recordings of {', '.join(given)}, expected {', '.join(POSES)}")
    windows = dict(windows or {})
    if unknown := sorted(set(windows) - set(POSES)):
        raise UsageError(f"found a window of '{unknown[0]}', expected {', '.join(POSES)}")
    virtual = all(isinstance(given[pose], HumanMotion) for pose in POSES)
    if not virtual and any(isinstance(recording, HumanMotion) for recording in given.values()):
        raise UsageError("found tracker recordings beside suit recordings; expected all three poses from one system")
    # A recording given for several poses stays one: found by identity below.
    made: dict[int, TrackerRecording] = {}
    for recording in given.values():
        made.setdefault(id(recording), virtual_trackers(recording) if isinstance(recording, HumanMotion) else recording)
    by_pose = {pose: made[id(given[pose])] for pose in POSES}
    check_same_trackers(by_pose)
    if assign_by is None:
        assign_by = "roles" if set(NEEDED) <= set(by_pose["still"].segments.values()) else "auto"
    default_offset = hand_offset_m is None
    if hand_offset_m is None:
        hand_offset_m = (0.0, 0.0, 0.0) if virtual else TRACKER_HAND_OFFSET_M
    if np.shape(hand_offset_m) != (3,) or not np.isfinite(hand_offset_m).all():
        raise UsageError(f"hand offset {hand_offset_m}: expected three finite numbers in metres")
    offset = np.array(hand_offset_m, float)
    # Along the arm in the hand's axes: the trackers themselves then show the poses well enough to find them.
    windows = _windows(by_pose, windows, assign_by, offset if hand_offset_frame == "tracker" else np.zeros(3))
    means = [average(by_pose[pose], windows[pose], pose) for pose in POSES]
    margins: Mapping[str, float] = {}
    if assign_by == "auto":
        found = _assigned(means)
        trackers, margins = {segment: tracker for tracker, segment in found.segments.items()}, found.margin_m
    else:
        trackers = by_roles(by_pose["still"])
    _check_tracked(means, trackers)
    person = Person.of(means, trackers, offset, hand_offset_frame, virtual=virtual)
    residuals = {
        **person.residuals(),
        **{f"assignment_margin_m/{segment}": margins[name] for segment, name in trackers.items() if name in margins},
    }
    return Calibration(
        arms=person.arms,
        origin=person.origin,
        heading_rad=person.heading,
        chest_position=person.chest_position,
        chest_orientation=person.still_orientation["T8"],
        still_orientation=person.still_orientation,
        trackers={} if virtual else trackers,
        tracker_rotation={} if virtual else person.mounts,
        hand_offset_m=person.offsets,
        windows_s=windows,
        input_sha256={pose: by_pose[pose].source.sha256 for pose in POSES if by_pose[pose].source.sha256},
        residuals=residuals,
        warnings=(*warnings_of(residuals, person, trackers), *(offset_warnings(person) if default_offset else ())),
    )


def _windows(
    by_pose: Mapping[str, TrackerRecording], given: Mapping[str, Window], assign_by: AssignBy, offset: Array
) -> dict[str, Window]:
    """A window for each pose: those given, else found."""
    for pose, (start, end) in given.items():
        if not (np.isfinite([start, end]).all() and start <= end):
            raise UsageError(f"{POSE_NAMES[pose]}: found {start:g} to {end:g} s, expected a start before its end")
    if len(given) == len(POSES):
        return dict(given)
    if assign_by == "roles":
        roles = by_roles(by_pose["still"])
        return find(by_pose, given, (roles["LeftHand"], roles["RightHand"]), roles["T8"], offset)[0]
    return _found_without_roles(by_pose, given, offset)


def _found_without_roles(
    by_pose: Mapping[str, TrackerRecording], given: Mapping[str, Window], offset: Array
) -> dict[str, Window]:
    """The windows where nobody says which trackers are the hands: any still stretch may be the Still pose that tells."""
    still = by_pose["still"]
    guesses: dict[tuple[str, ...], None] = {}
    refusal: MotionError | None = None
    for window in [given["still"]] if "still" in given else still_stretches(still, still.trackers):
        try:
            found = body(average(still, window, "still").position)
        except MotionError as error:
            refusal = refusal or error
            continue
        guesses[(*sorted(found.hands), found.chest)] = None
    best: tuple[float, dict[str, Window]] | None = None
    for one, other, chest in guesses:
        try:
            windows, score = find(by_pose, given, (one, other), chest, offset)
        except MotionError as error:
            refusal = error
            continue
        if best is None or score < best[0]:
            best = score, windows
    if best is None:
        raise refusal or MotionError(
            "nobody stands still in this recording; name the times of the Still, T and Forward pose as START:END"
        )
    return best[1]


def _assigned(means: Sequence[MeanPose]) -> Assignment:
    still, forward = means[0], means[2]
    chest = body(still.position).chest
    if chest not in forward.position:
        raise MotionError(f"Forward pose: tracker {chest}, taken for the chest, is not tracked")
    return assign(still.position, in_chest_of(still, forward, chest).position)


def _check_tracked(means: Sequence[MeanPose], trackers: Mapping[str, str]) -> None:
    """Every tracker is seen in the window that its mount is derived from, and chest and hands in all three."""
    for pose, mean in zip(POSES, means, strict=True):
        for segment, tracker in trackers.items():
            needed = segment in NEEDED or pose == "still" or (pose == "tpose" and is_arm(segment))
            if needed and tracker not in mean.position:
                start, end = mean.window
                raise MotionError(
                    f"{POSE_NAMES[pose]}: tracker {tracker} ({segment}) is not tracked from {start:g} to {end:g} s"
                )
