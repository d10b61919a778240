"""The operator's `Calibration` from recordings of the Still, T and Forward pose [Lim2022 sec. II-B].

Only the person's body decides: where the person faces comes from the hands, the shoulders from the hands and the chest, and how each tracker
is strapped on from the pose it has in the Still pose (chest, head) and in the T-pose (arms). Any heading, any mount and any origin will do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from retarget.core import rotations
from retarget.core.calibrate import poses, shoulder
from retarget.core.calibrate.assign import Assignment, assign, body
from retarget.core.calibrate.windows import (
    MeanPose,
    Window,
    average,
    find,
    hand_points,
    in_chest_of,
    still_stretches,
)
from retarget.core.calibration import POSE_NAMES, POSES, SIDES, ArmCalibration, Calibration
from retarget.core.errors import MotionError, UsageError
from retarget.core.rotations import Array
from retarget.core.types import HumanMotion, TrackerRecording

Recording = TrackerRecording | HumanMotion
AssignBy = Literal["roles", "auto"]
OffsetFrame = Literal["tracker", "hand"]

TRACKER_HAND_OFFSET_M = (-0.08, 0.0, 0.0)
"""From a hand tracker to the hand point, in the tracker's own axes: the authors' code. It fits trackers that are mounted like theirs."""

NEEDED = ("T8", "LeftHand", "RightHand")
TRACKED = ("Pelvis", "T8", "Head", "LeftUpperArm", "LeftHand", "RightUpperArm", "RightHand")
"""Segments that a tracker may be on."""

ARM_PER_STATURE = 0.186 + 0.146 + 0.108 / 4
SHOULDER_OVER_HIP_PER_STATURE = 0.818 - 0.530
"""As parts of the stature, shoulder to hand point (taken midway between the wrist and the palm's centre, where offsets put it), and the height
of the shoulders over the hips: Drillis & Contini, "Body Segment Parameters" (1966), as reprinted in Winter, "Biomechanics and Motor
Control of Human Movement"."""

DOUBTFUL_SPREAD_M = 0.08
DOUBTFUL_FACING_DEG = 15.0
DOUBTFUL_MOTION_M = 0.03
DOUBTFUL_LENGTHS = 0.1
DOUBTFUL_OFFSET_DEG = 60.0


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
    _check_same_trackers(by_pose)
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
        trackers = _by_roles(by_pose["still"])
    _check_tracked(means, trackers)
    person = _Person.of(means, trackers, offset, hand_offset_frame, virtual=virtual)
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
        warnings=(*_warnings(residuals, person, trackers), *(_offset_warnings(person) if default_offset else ())),
    )


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


@dataclass(frozen=True, eq=False)
class _Person:
    """What the mean poses tell; points and orientations in the operator frame, but `origin` and `heading`, which place it in the world.

    means: Still, T, Forward, carried to the chest of the Still pose. turned: how far the chest had turned from there, degrees.
    """

    means: Sequence[MeanPose]
    turned_deg: Sequence[float]
    heading: float
    disagreement: float
    origin: Array
    arms: Mapping[str, ArmCalibration]
    chest_position: Array
    mounts: Mapping[str, Array]
    still_orientation: Mapping[str, Array]
    offsets: Mapping[str, Array]
    trackers: Mapping[str, str]
    shoulder_errors: Mapping[str, float]

    @classmethod
    def of(
        cls,
        measured: Sequence[MeanPose],
        trackers: Mapping[str, str],
        offset: Array,
        frame: OffsetFrame,
        *,
        virtual: bool,
    ) -> _Person:
        chest = trackers["T8"]
        still = measured[0]
        means = [still, *(in_chest_of(still, mean, chest) for mean in measured[1:])]
        turned = [
            float(np.degrees(rotations.angle(still.orientation[chest], mean.orientation[chest]))) for mean in measured
        ]
        # The offset in the hand's own axes needs the facing direction, which the trackers themselves tell well enough for that.
        hands = _hands(means, trackers, dict.fromkeys(SIDES, np.zeros(3)))
        poses.check_order(hands)
        heading, _ = poses.facing(hands)
        mounts = _mounts(means, trackers, heading, virtual=virtual)
        offsets = dict.fromkeys(SIDES, offset)
        if frame == "hand":
            offsets = {
                side: rotations.rotate(mounts[f"{side}Hand"], offset * [1.0, poses.outward(side), 1.0])
                for side in SIDES
            }
        hands = _hands(means, trackers, offsets)
        heading, disagreement = poses.facing(hands)
        mounts = _mounts(means, trackers, heading, virtual=virtual)
        to_operator = rotations.exp([0.0, 0.0, -heading])

        def turn(point: Array) -> Array:
            return rotations.rotate(to_operator, point)

        hands = {side: turn(points) for side, points in hands.items()}
        poses.check_arms(hands)
        arms = {side: shoulder.fit(side, hands, turn(still.position[chest])) for side in SIDES}
        origin = turn(still.position[trackers["Pelvis"]]) if "Pelvis" in trackers else _below_shoulders(arms)
        errors = {}
        if virtual:
            errors = {
                side: float(np.linalg.norm(turn(still.position[trackers[f"{side}UpperArm"]]) - arms[side].shoulder))
                for side in SIDES
                if f"{side}UpperArm" in trackers
            }
        # The circle's centre doesn't care where the origin is: only now is it known, and everything moves to it.
        hands = {side: points - origin for side, points in hands.items()}
        arms = {side: shoulder.fit(side, hands) for side in SIDES}
        return cls(
            means=means,
            turned_deg=turned,
            heading=heading,
            disagreement=disagreement,
            origin=rotations.rotate(rotations.conjugate(to_operator), origin),
            arms=arms,
            chest_position=turn(still.position[chest]) - origin,
            mounts=mounts,
            still_orientation={
                segment: rotations.multiply(
                    rotations.multiply(to_operator, still.orientation[tracker]), mounts[segment]
                )
                for segment, tracker in trackers.items()
                if tracker in still.orientation
            },
            offsets=offsets,
            trackers=trackers,
            shoulder_errors=errors,
        )

    def residuals(self) -> dict[str, float]:
        """Figures that tell how good the calibration is."""
        found = {"facing_disagreement_deg": float(np.degrees(self.disagreement))}
        for side, arm in self.arms.items():
            found[f"shoulder_spread_m/{side}"] = float(np.ptp(arm.offsets_m))
        for side, error in self.shoulder_errors.items():
            found[f"shoulder_from_segment_m/{side}"] = error
        for pose, mean, turned in zip(POSES, self.means, self.turned_deg, strict=True):
            found[f"chest_turned_deg/{pose}"] = turned
            for side in SIDES:
                found[f"hand_motion_m/{side}/{pose}"] = mean.motion_m[self.trackers[f"{side}Hand"]]
        return found


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
        roles = _by_roles(by_pose["still"])
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


def _by_roles(recording: TrackerRecording) -> dict[str, str]:
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


def _assigned(means: Sequence[MeanPose]) -> Assignment:
    still, forward = means[0], means[2]
    chest = body(still.position).chest
    if chest not in forward.position:
        raise MotionError(f"Forward pose: tracker {chest}, taken for the chest, is not tracked")
    return assign(still.position, in_chest_of(still, forward, chest).position)


def _check_same_trackers(by_pose: Mapping[str, TrackerRecording]) -> None:
    expected = set(by_pose["still"].trackers)
    for pose, recording in by_pose.items():
        if set(recording.trackers) != expected:
            raise MotionError(
                f"{POSE_NAMES[pose]}: found trackers {', '.join(recording.trackers)}, expected those of the Still pose: "
                f"{', '.join(by_pose['still'].trackers)}"
            )


def _check_tracked(means: Sequence[MeanPose], trackers: Mapping[str, str]) -> None:
    """Every tracker is seen in the window that its mount is derived from, and chest and hands in all three."""
    for pose, mean in zip(POSES, means, strict=True):
        for segment, tracker in trackers.items():
            needed = segment in NEEDED or pose == "still" or (pose == "tpose" and _is_arm(segment))
            if needed and tracker not in mean.position:
                start, end = mean.window
                raise MotionError(
                    f"{POSE_NAMES[pose]}: tracker {tracker} ({segment}) is not tracked from {start:g} to {end:g} s"
                )


def _is_arm(segment: str) -> bool:
    return segment.endswith(("UpperArm", "Hand"))


def _mounts(
    means: Sequence[MeanPose], trackers: Mapping[str, str], heading: float, *, virtual: bool
) -> dict[str, Array]:
    """Segment → (4,) tracker ← segment: chest, head and pelvis are upright in the Still pose, arms as in the house's T-pose in the T-pose."""
    if virtual:
        return {segment: np.array([1.0, 0.0, 0.0, 0.0]) for segment in trackers}
    to_operator = rotations.exp([0.0, 0.0, -heading])
    return {
        segment: rotations.conjugate(
            rotations.multiply(to_operator, means[1 if _is_arm(segment) else 0].orientation[tracker])
        )
        for segment, tracker in trackers.items()
    }


def _hands(means: Sequence[MeanPose], trackers: Mapping[str, str], offsets: Mapping[str, Array]) -> dict[str, Array]:
    """Side → (3, 3) m, hand points of the three poses."""
    return {side: hand_points(means, trackers[f"{side}Hand"], offsets[side]) for side in SIDES}


def _below_shoulders(arms: Mapping[str, ArmCalibration]) -> Array:
    """Where the pelvis is, without a tracker on it: below the shoulders' midpoint, as far as for a person of usual build with these arms."""
    stature = float(np.mean([arm.length_m for arm in arms.values()])) / ARM_PER_STATURE
    middle = (arms["Left"].shoulder + arms["Right"].shoulder) / 2
    return np.asarray(middle - [0.0, 0.0, SHOULDER_OVER_HIP_PER_STATURE * stature])


def _warnings(residuals: Mapping[str, float], person: _Person, trackers: Mapping[str, str]) -> list[str]:
    found = []
    hands = {side: arm.hand_points for side, arm in person.arms.items()}
    for side in SIDES:
        if (spread := residuals[f"shoulder_spread_m/{side}"]) > DOUBTFUL_SPREAD_M:
            pose = POSE_NAMES[POSES[poses.least_trusted(hands, [side])[1].pose]]
            found.append(
                f"{side.lower()} arm: the estimates of the shoulder lie {1000 * spread:.0f} mm apart; the {pose} fits least"
            )
        for pose in POSES:
            if (motion := residuals[f"hand_motion_m/{side}/{pose}"]) > DOUBTFUL_MOTION_M:
                found.append(f"{side.lower()} arm, {POSE_NAMES[pose]}: the hand moves by {1000 * motion:.0f} mm (RMS)")
    if (angle := residuals["facing_disagreement_deg"]) > DOUBTFUL_FACING_DEG:
        found.append(f"T-pose and Forward pose disagree by {angle:.0f}° about where the person faces")
    lengths = [arm.length_m for arm in person.arms.values()]
    if max(lengths) > (1 + DOUBTFUL_LENGTHS) * min(lengths):
        found.append(
            "arm lengths differ: " + ", ".join(f"{s.lower()} {a.length_m:.3f} m" for s, a in person.arms.items())
        )
    if lacking := [name for name in TRACKED if name not in trackers and name != "Pelvis"]:
        found.append(f"no tracker on {', '.join(lacking)}")
    return found


def _offset_warnings(person: _Person) -> list[str]:
    """The default offset belongs to one way of mounting: say when it points across the arm."""
    found = []
    for side, offset in person.offsets.items():
        if not offset.any():
            continue
        in_hand = rotations.rotate(rotations.conjugate(person.mounts[f"{side}Hand"]), offset)
        off = float(np.degrees(np.arccos(np.clip(abs(in_hand[1]) / np.linalg.norm(offset), 0, 1))))
        if off > DOUBTFUL_OFFSET_DEG:
            shown = ", ".join(f"{value:g}" for value in offset)
            found.append(
                f"{side.lower()} hand: the default hand offset ({shown}) m points {off:.0f}° off the arm with this mount; "
                "measure it and give --hand-offset, or --hand-offset-frame hand"
            )
    return found
