"""Which stretch of a recording shows which pose, and the mean pose of every tracker in it.

A window is (start, end) s on its recording's own clock. Windows are given, or found: of the stretches in which chest and hands stand still,
the three whose arms fit the Still, T and Forward pose best.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from retarget.core import rotations
from retarget.core.calibrate import poses, shoulder
from retarget.core.calibration import POSE_NAMES, POSES, SIDES
from retarget.core.errors import MotionError
from retarget.core.rotations import Array
from retarget.core.timebase import CLOCK_SLACK_S, runs
from retarget.core.types import BoolArray, TrackerRecording

Window = tuple[float, float]

STILL_SPEED_M_S = 0.12
"""A tracker slower than this stands still; held-out arms sway at up to some 0.05 m/s."""
SPEED_OVER_S = 0.2
"""Positions are averaged over this time, and speeds taken over twice that: 5 mm of noise at 90 Hz then looks like 0.01 m/s."""
SHORTEST_STILL_S = 0.4
LONGEST_WINDOW_S = 1.5
"""Of a longer still stretch its middle is taken."""
MOST_CANDIDATES = 8
"""Still stretches considered for each pose, best looking first."""


@dataclass(frozen=True, eq=False)
class MeanPose:
    """Every tracker's mean pose over a window: position (3,) m, orientation (4,) wxyz, world ← tracker.

    Trackers without a tracked frame in the window are left out. motion_m: each tracker's RMS distance from its mean position.
    """

    window: Window
    position: Mapping[str, Array]
    orientation: Mapping[str, Array]
    motion_m: Mapping[str, float]


def average(recording: TrackerRecording, window: Window, pose: str, trackers: Iterable[str] | None = None) -> MeanPose:
    """The mean over the tracked frames with start ≤ time ≤ end, of all trackers or of those named. `pose` names it in messages.

    Raises `MotionError` when no frame lies in the window.
    """
    start, end = window
    time = recording.time
    first = int(np.searchsorted(time, start - CLOCK_SLACK_S))
    stop = int(np.searchsorted(time, end + CLOCK_SLACK_S, side="right"))
    if first >= stop:
        raise MotionError(
            f"{POSE_NAMES[pose]}: no frame from {start:g} to {end:g} s; the recording runs from {time[0]:g} to {time[-1]:g} s"
        )
    position, orientation, motion = {}, {}, {}
    for tracker in recording.trackers if trackers is None else trackers:
        column = recording.index(tracker)
        rows = first + np.flatnonzero(recording.tracked[first:stop, column])
        if len(rows):
            points = recording.position[rows, column]
            position[tracker] = points.mean(axis=0)
            orientation[tracker] = rotations.mean(recording.orientation[rows, column])
            motion[tracker] = float(np.sqrt(((points - position[tracker]) ** 2).sum(axis=1).mean()))
    return MeanPose(window, position, orientation, motion)


def in_chest_of(still: MeanPose, other: MeanPose, chest: str) -> MeanPose:
    """`other` carried to where the chest was in `still`: every pose turned and moved with the chest tracker, however that is mounted.

    p' = p_ch,S + R_ch,S R_chᵀ (p − p_ch), R' = R_ch,S R_chᵀ R.
    """
    turn = rotations.multiply(still.orientation[chest], rotations.conjugate(other.orientation[chest]))
    origin = other.position[chest]
    return MeanPose(
        other.window,
        {name: still.position[chest] + rotations.rotate(turn, p - origin) for name, p in other.position.items()},
        {name: rotations.multiply(turn, q) for name, q in other.orientation.items()},
        other.motion_m,
    )


def hand_points(means: Sequence[MeanPose], tracker: str, offset: Array) -> Array:
    """(N, 3) m, the hand point of each mean pose: tracker + R · offset."""
    return np.array([mean.position[tracker] + rotations.rotate(mean.orientation[tracker], offset) for mean in means])


def still_stretches(recording: TrackerRecording, trackers: Iterable[str]) -> list[Window]:
    """Windows of at least `SHORTEST_STILL_S` and at most `LONGEST_WINDOW_S` in which all `trackers` are tracked and stand still, in order of time.

    Of each still stretch the middle is taken.
    """
    columns = [recording.index(name) for name in trackers]
    time = recording.time
    if len(time) < 3:
        return []
    slow = _speed(time, recording.position[:, columns]) < STILL_SPEED_M_S
    still: BoolArray = np.all(slow & recording.tracked[:, columns], axis=1)
    windows = []
    for first, last in runs(still):
        start, end = float(time[first]), float(time[last])
        # The speed at either end is already that of the movement, smoothed.
        start, end = start + SPEED_OVER_S / 2, end - SPEED_OVER_S / 2
        if end - start >= SHORTEST_STILL_S:
            middle, half = (start + end) / 2, min(end - start, LONGEST_WINDOW_S) / 2
            windows.append((middle - half, middle + half))
    return windows


def find(
    by_pose: Mapping[str, TrackerRecording],
    given: Mapping[str, Window],
    hands: Sequence[str],
    chest: str,
    hand_offset: Array,
) -> tuple[dict[str, Window], float]:
    """(pose → window, score) of the still stretches whose arms look most like Still, T and Forward; score 0 = perfect, 1 = at a limit.

    by_pose: pose → the recording that holds it, one for all or each its own. given: windows that are not to be looked for.
    hands: the two hand trackers, either first. hand_offset: (3,) m, hand tracker to hand point in the tracker's axes.
    Raises `MotionError` when a pose has no still stretch, and when no choice passes the checks of a calibration: then it says what the
    nearest lacked.
    """
    stretches = {
        pose: [given[pose]] if pose in given else still_stretches(by_pose[pose], (chest, *hands)) for pose in POSES
    }
    for pose, found in stretches.items():
        if not found:
            raise MotionError(
                f"{POSE_NAMES[pose]}: nowhere do chest and hands stand still for {SHORTEST_STILL_S + SPEED_OVER_S:g} s; "
                "name its time as START:END"
            )
    if all(len(found) == 1 for found in stretches.values()) and len({id(r) for r in by_pose.values()}) == len(POSES):
        return {
            pose: found[0] for pose, found in stretches.items()
        }, 0.0  # no choice: their calibration says what is wrong
    needed = (chest, *hands)
    means = {
        pose: [
            mean
            for mean in (average(by_pose[pose], window, pose, needed) for window in found)
            if all(name in mean.position for name in needed)
        ]
        for pose, found in stretches.items()
    }
    for pose, found_means in means.items():
        if not found_means:
            raise MotionError(f"{POSE_NAMES[pose]}: chest and hands are not tracked in the time given")
    best: tuple[float, tuple[MeanPose, ...]] | None = None
    reason, nearest = "", np.inf
    for triple in itertools.product(*_candidates(means, hands, chest)):
        if _same_stretch(triple, by_pose):
            continue
        score, problem = _score(triple, hands, chest, hand_offset)
        if problem and (score < nearest or not reason):
            nearest, reason = score, problem
        if not problem and (best is None or score < best[0]):
            best = score, triple
    if best is None:
        windows = sorted({window for found in stretches.values() for window in found})
        tried = ", ".join(f"{start:.1f}:{end:.1f}" for start, end in windows[:8]) + (" …" if windows[8:] else "")
        raise MotionError(
            f"no Still, T and Forward pose among {len(windows)} still stretches ({tried} s)"
            + (f"; the nearest: {reason}" if reason else "")
            + "; name their times as START:END"
        )
    return {pose: mean.window for pose, mean in zip(POSES, best[1], strict=True)}, best[0]


def _same_stretch(triple: Sequence[MeanPose], by_pose: Mapping[str, TrackerRecording]) -> bool:
    """Whether two poses would be taken from one stretch of one recording."""
    places = {(id(by_pose[pose]), mean.window) for pose, mean in zip(POSES, triple, strict=True)}
    return len(places) < len(POSES)


def _candidates(means: Mapping[str, Sequence[MeanPose]], hands: Sequence[str], chest: str) -> list[list[MeanPose]]:
    """For each pose the stretches that look most like it, from what needs no facing direction."""
    found = []
    for pose in POSES:
        left, right, body = (np.array([mean.position[name] for mean in means[pose]]) for name in (*hands, chest))
        middle = (left + right) / 2 - body
        badness = {
            "still": middle[:, 2],
            "tpose": -np.linalg.norm((left - right)[:, :2], axis=1),
            "forward": -np.linalg.norm(middle[:, :2], axis=1),
        }[pose]
        found.append([means[pose][i] for i in np.argsort(badness)[:MOST_CANDIDATES]])
    return found


def _score(means: Sequence[MeanPose], hands: Sequence[str], chest: str, offset: Array) -> tuple[float, str]:
    """(how far from perfect, what is wrong or "") of three mean poses taken as Still, T and Forward."""
    still = means[0]
    moved = [still, *(in_chest_of(still, mean, chest) for mean in means[1:])]
    points = {side: hand_points(moved, hand, offset) for side, hand in zip(SIDES, hands, strict=True)}
    try:
        try:
            heading, disagreement = poses.facing(points)
        except MotionError:  # either hand may come first: only one order faces ahead
            points = {"Left": points["Right"], "Right": points["Left"]}
            heading, disagreement = poses.facing(points)
        poses.check_order(points)
    except MotionError as error:
        return np.inf, str(error)
    turn = rotations.exp([0.0, 0.0, -heading])
    points = {side: rotations.rotate(turn, value) for side, value in points.items()}
    side, worst = poses.least_trusted(points)
    score = worst.badness + disagreement
    try:
        poses.check_arm(side, worst)
        body = rotations.rotate(turn, still.position[chest])
        arms = [shoulder.fit(side, points, body) for side in SIDES]
    except MotionError as error:
        return score, str(error)
    return score / 2 + max(float(np.ptp(arm.offsets_m)) for arm in arms) / shoulder.LARGEST_SPREAD_M / 2, ""


def _speed(time: Array, position: Array) -> Array:
    """Speed (T, D) m/s of positions (T, D, 3), averaged so that a tracker's noise doesn't look like movement."""
    rate = (len(time) - 1) / (time[-1] - time[0])
    half = int(np.clip(round(SPEED_OVER_S * rate / 2), 1, (len(time) - 1) // 2))
    padded = np.concatenate([np.repeat(position[:1], half, 0), position, np.repeat(position[-1:], half, 0)])
    sums = np.cumsum(np.concatenate([np.zeros_like(padded[:1]), padded]), axis=0)
    smooth = (sums[2 * half + 1 :] - sums[: -2 * half - 1]) / (2 * half + 1)
    before = np.maximum(np.arange(len(time)) - 2 * half, 0)
    after = np.minimum(np.arange(len(time)) + 2 * half, len(time) - 1)
    moved = np.linalg.norm(smooth[after] - smooth[before], axis=-1)
    return np.asarray(moved / (time[after] - time[before])[:, None])
