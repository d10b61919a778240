"""What the mean poses tell of the person: where it faces, where the operator frame is, how trackers are mounted, shoulders and arms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from retarget.core import rotations
from retarget.core.calibrate import poses, shoulder
from retarget.core.calibrate.roles import is_arm
from retarget.core.calibrate.windows import MeanPose, hand_points, in_chest_of
from retarget.core.calibration import POSES, SIDES, ArmCalibration
from retarget.core.rotations import Array

OffsetFrame = Literal["tracker", "hand"]

ARM_PER_STATURE = 0.186 + 0.146 + 0.108 / 4
SHOULDER_OVER_HIP_PER_STATURE = 0.818 - 0.530
"""As parts of the stature, shoulder to hand point (taken midway between the wrist and the palm's centre, where offsets put it), and the height
of the shoulders over the hips: Drillis & Contini, "Body Segment Parameters" (1966), as reprinted in Winter, "Biomechanics and Motor
Control of Human Movement"."""


@dataclass(frozen=True, eq=False)
class Person:
    """What the mean poses tell; points and orientations in the operator frame, but `origin` and `heading`, which place it in the world.

    means: Still, T, Forward, carried to the chest of the Still pose. turned_deg: how far the chest had turned from there. heading,
    disagreement: rad, where the person faces, and by how much T and Forward pose differ about it. origin: (3,) m. mounts: segment → (4,)
    tracker ← segment. offsets: side → (3,) m, in the hand tracker's axes. trackers: segment → name. shoulder_errors: side → m, from a suit's own shoulder.
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
    ) -> Person:
        """From the mean poses as measured, Still, T, Forward, in the world.

        trackers: segment → tracker. offset: (3,) m, hand tracker to hand point, in the axes that `frame` names. virtual: trackers are a
        suit's segments, turned like them. Raises `MotionError` for poses that are mixed up or can't be used.
        """
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


def _mounts(
    means: Sequence[MeanPose], trackers: Mapping[str, str], heading: float, *, virtual: bool
) -> dict[str, Array]:
    """Segment → (4,) tracker ← segment: chest, head and pelvis are upright in the Still pose, arms as in the house's T-pose in the T-pose."""
    if virtual:
        return {segment: np.array([1.0, 0.0, 0.0, 0.0]) for segment in trackers}
    to_operator = rotations.exp([0.0, 0.0, -heading])
    return {
        segment: rotations.conjugate(
            rotations.multiply(to_operator, means[1 if is_arm(segment) else 0].orientation[tracker])
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
