"""Operators whose calibration is known: the authors' own figures, and the person of conftest.py, calibrated by hand."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from retarget.core import rotations
from retarget.core.calibration import ArmCalibration, Calibration
from retarget.core.types import Array, HumanMotion

IDENTITY = (1.0, 0.0, 0.0, 0.0)
AUTHORS_HANDS = {
    "Left": np.array([[-0.13517, 0.289845, -0.259223], [-0.284813, 0.803326, 0.356484], [0.430654, 0.263043, 0.36878]]),
    "Right": np.array(
        [[-0.0650479, -0.324795, -0.255538], [-0.146704, -0.806712, 0.357469], [0.463099, -0.198173, 0.373117]]
    ),
}
"""Still, T, Forward in the pelvis frame, m: comments in the authors' code."""
AUTHORS_SHOULDERS = {"Left": np.array([-0.1684, 0.2130, 0.3369]), "Right": np.array([-0.1162, -0.2262, 0.3165])}


def arm(points: Array, shoulder: Array) -> ArmCalibration:
    """Length and angles follow from the points."""
    lines = points - shoulder
    pairs = ((0, 1), (1, 2), (2, 0))
    angles = [float(np.degrees(rotations.vector_angle(lines[a], lines[b]))) for a, b in pairs]
    length = float(np.linalg.norm(lines, axis=1).mean())
    return ArmCalibration(points, shoulder, length, (angles[0], angles[1], angles[2]), (0.3, 0.3, 0.3))


def authors_arms() -> dict[str, ArmCalibration]:
    return {side: arm(AUTHORS_HANDS[side], AUTHORS_SHOULDERS[side]) for side in ("Left", "Right")}


def pose(name: str) -> dict[str, Array]:
    """Segment → orientation of Still ("still"), T ("tpose") and Forward ("forward") with straight arms."""
    turns = {"still": (-np.pi / 2, 0.0, 0.0), "tpose": (0.0, 0.0, 0.0), "forward": (0.0, 0.0, -np.pi / 2)}
    left = np.array(turns[name])
    return {"LeftUpperArm": rotations.exp(left), "RightUpperArm": rotations.exp(-left)}


def calibration_of(make_motion: Callable[..., HumanMotion], yaw: float = 0.0) -> Calibration:
    """The person of conftest.py, facing `yaw` in the world, who holds the three poses perfectly: hand points are the wrists, B_h
    = 0.55 m · axes."""
    points: dict[str, list[Array]] = {"Left": [], "Right": []}
    still = None
    for name in ("still", "tpose", "forward"):
        motion = make_motion([0.0], pose(name))
        still = still or motion
        for side, found in points.items():
            found.append(motion.position[0, motion.index(f"{side}Hand")] - motion.position[0, motion.index("Pelvis")])
    assert still is not None
    upper = {side: still.position[0, still.index(f"{side}UpperArm")] - still.position[0, 0] for side in points}
    return Calibration(
        arms={side: arm(np.stack(points[side]), upper[side]) for side in points},
        origin=still.position[0, 0],
        heading_rad=yaw,
        chest_position=still.position[0, still.index("T8")] - still.position[0, 0],
        chest_orientation=np.array(IDENTITY),
        still_orientation={s: still.orientation[0, still.index(s)] for s in still.segments},
    )


def turned(motion: HumanMotion, yaw: float, shift: Array) -> HumanMotion:
    """The same motion elsewhere, facing another way."""
    q = rotations.exp(np.array([0.0, 0.0, yaw]))
    return replace(
        motion,
        orientation=rotations.make_continuous(rotations.multiply(q, motion.orientation)),
        position=rotations.rotate(q, motion.position) + shift,
    )


def moving(
    make_motion: Callable[..., HumanMotion], time: Array, start: Mapping[str, Array] | None = None
) -> HumanMotion:
    """Arms, chest and head swinging smoothly and slowly about a posture with bent elbows, in front of the person."""
    wave = np.sin(1.5 * time)[:, None]
    left = rotations.exp(np.array([-0.7, 0.2, -0.5]) + wave * [0.2, 0.1, 0.2])
    right = rotations.exp(np.array([0.6, 0.1, 0.6]) + np.cos(1.1 * time)[:, None] * [0.2, -0.1, 0.2])
    world = {
        "T8": rotations.exp(wave * [0.05, 0.1, 0.2]),
        "Head": rotations.exp(wave * [0.0, 0.2, -0.3]),
        "LeftUpperArm": left,
        "LeftForeArm": rotations.multiply(left, rotations.exp(-(0.9 + 0.3 * wave) * [0.0, 0.0, 1.0])),
        "RightUpperArm": right,
        "RightForeArm": rotations.multiply(right, rotations.exp((0.8 + 0.3 * wave) * [0.0, 0.0, 1.0])),
    }
    return make_motion(time, {**world, **(start or {})})
