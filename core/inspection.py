"""What a person wants to know of a recording before it is converted: times, speeds, posture, contacts, and whether it can be a person at all.

Everything is computed from the types, so it holds for every format. Nothing here refuses anything.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from retarget.core import contacts, rotations, timebase
from retarget.core.segments import FOOT_CONTACTS
from retarget.core.types import Array, BoolArray, HumanMotion, TrackerRecording

HEAD_JOINT_OF_STATURE = 0.88
"""Height of the joint between neck and head as a part of the stature; by it the stature is told, within some 3 %."""
STATURE_M = (1.2, 2.2)
"""What grown people measure."""
POSE_TOLERANCE_DEG = 30.0
"""How far each upper arm and forearm may be off a pose's direction."""
SHORTEST_POSE_S = 0.3
FASTEST_RAD_S = 35.0
"""Hands in the fastest throws turn at some 35 rad/s; faster ones are noise or swapped quaternions."""
FASTEST_M_S = 12.0
UNEVEN = 0.1
"""Times are uneven where some step differs by more than this part from the usual one."""

Span = tuple[float, float]

_ARM = {
    "T-pose": {"Left": (0.0, 1.0, 0.0), "Right": (0.0, -1.0, 0.0)},
    "arms down (N-pose)": {"Left": (0.0, 0.0, -1.0), "Right": (0.0, 0.0, -1.0)},
    "arms forward": {"Left": (1.0, 0.0, 0.0), "Right": (1.0, 0.0, 0.0)},
}
"""Pose → where the arms point, seen from the chest's heading."""


@dataclass(frozen=True)
class Timing:
    """Steps between frames, s. uneven: how many are off the usual one by more than `UNEVEN`."""

    usual_s: float
    shortest_s: float
    longest_s: float
    uneven: int

    @classmethod
    def of(cls, time: Array) -> Timing:
        """Of times (T,) s."""
        if len(time) < 2:
            return cls(0.0, 0.0, 0.0, 0)
        steps = np.diff(time)
        usual = float(np.median(steps))
        return cls(usual, float(steps.min()), float(steps.max()), int((np.abs(steps - usual) > UNEVEN * usual).sum()))


@dataclass(frozen=True, eq=False)
class MotionFindings:
    """What `inspect_motion` finds. T frames, S segments.

    turn_rad_s: (T, S) angular speeds; speed_m_s: (T, S), NaN where a segment has no position.
    pelvis_height_m: (T,) above the lowest point, or None. stature_m: estimate, or None where head or feet are not there.
    heading_deg: of the pelvis (else the chest), first frame and extremes. travel_m: way of the pelvis over ground.
    poses: pose → stretches (start, end) s in which both arms show it. contacts: (T, 4) or None; contacts_recorded: by the file itself.
    upright: mean cosine between trunk and vertical, None without a trunk. doubts: sentences.
    """

    timing: Timing
    turn_rad_s: Array
    speed_m_s: Array
    pelvis_height_m: Array | None
    stature_m: float | None
    heading_deg: tuple[float, float, float] | None
    travel_m: float | None
    poses: Mapping[str, Sequence[Span]]
    contacts: BoolArray | None
    contacts_recorded: bool
    upright: float | None
    doubts: tuple[str, ...] = field(default=())


def inspect_motion(motion: HumanMotion) -> MotionFindings:
    """Times, speeds, posture and contacts of a motion."""
    timing = Timing.of(motion.time)
    turn, speed = _turn_speeds(motion), _speeds(motion.time, motion.position)
    found_contacts = contacts.foot_contacts(motion)
    upright, stature, height = _upright(motion), _stature(motion), _pelvis_height(motion)
    doubts = [*_timing_doubts(timing), *_posture_doubts(upright, stature), *_speed_doubts(motion, turn, speed)]
    anchor = next((name for name in ("Pelvis", "T8") if motion.has(name)), None)
    heading = None
    if anchor is not None:
        yaw = np.degrees(np.unwrap(rotations.yaw(motion.orientation[:, motion.index(anchor)])))
        heading = (float(yaw[0]), float(yaw.min()), float(yaw.max()))
    return MotionFindings(
        timing=timing,
        turn_rad_s=turn,
        speed_m_s=speed,
        pelvis_height_m=height,
        stature_m=stature,
        heading_deg=heading,
        travel_m=_travel(motion),
        poses=arm_poses(motion),
        contacts=found_contacts,
        contacts_recorded=motion.foot_contacts is not None,
        upright=upright,
        doubts=tuple(doubts),
    )


@dataclass(frozen=True, eq=False)
class TrackerFindings:
    """What `inspect_trackers` finds. T frames, D trackers; turn_rad_s, speed_m_s: (T, D). doubts: sentences."""

    timing: Timing
    turn_rad_s: Array
    speed_m_s: Array
    doubts: tuple[str, ...] = ()


def inspect_trackers(recording: TrackerRecording) -> TrackerFindings:
    """Times and speeds of a tracker log."""
    timing = Timing.of(recording.time)
    turn = _angular_speeds(recording.time, recording.orientation)
    speed = _speeds(recording.time, recording.position)
    doubts = list(_timing_doubts(timing))
    for column, name in enumerate(recording.trackers):
        if (worst := float(speed[:, column].max(initial=0.0))) > FASTEST_M_S:
            doubts.append(f"{name} moves at up to {worst:.0f} m/s: a jump, or lengths in another unit")
        if (worst := float(turn[:, column].max(initial=0.0))) > FASTEST_RAD_S:
            doubts.append(f"{name} turns at up to {worst:.0f} rad/s: noise, or a quaternion in another order")
    spread = float(np.ptp(recording.position.reshape(-1, 3), axis=0).max())
    if spread > 50:
        doubts.append(f"positions spread over {spread:.0f} m: are they in centimetres or millimetres?")
    elif len(recording.trackers) > 2 and spread < 0.1:
        doubts.append(
            f"positions spread over {spread:.2g} m only: are they in kilometres, or is nobody wearing the trackers?"
        )
    return TrackerFindings(timing, turn, speed, tuple(doubts))


def arm_poses(motion: HumanMotion) -> dict[str, list[Span]]:
    """Pose → stretches (start, end) s of at least `SHORTEST_POSE_S` in which upper arms and forearms of both sides show it.

    Directions are seen from the chest's heading (the pelvis's without it); empty where arms or trunk were not measured.
    """
    trunk = next((name for name in ("T8", "Pelvis") if motion.has(name)), None)
    arms = [f"{side}{bone}" for side in ("Left", "Right") for bone in ("UpperArm", "ForeArm")]
    if trunk is None or not all(motion.has(name) for name in arms):
        return {}
    turn = rotations.about_z(-rotations.yaw(motion.orientation[:, motion.index(trunk)]))
    found = {}
    for pose, directions in _ARM.items():
        shows = np.ones(motion.frames, bool)
        for name in arms:
            side = "Left" if name.startswith("Left") else "Right"
            along = (0.0, 1.0 if side == "Left" else -1.0, 0.0)
            pointing = rotations.rotate(turn, rotations.rotate(motion.orientation[:, motion.index(name)], along))
            shows &= pointing @ np.array(directions[side]) > np.cos(np.radians(POSE_TOLERANCE_DEG))
        found[pose] = [
            (start, end)
            for start, end in spans(motion.time, shows)
            if end - start >= SHORTEST_POSE_S or motion.frames == 1
        ]
    return found


def spans(time: Array, mask: BoolArray) -> list[Span]:
    """(first, last) time of each run of true values in `mask` (T,)."""
    return [(float(time[first]), float(time[last])) for first, last in timebase.runs(mask)]


def _turn_speeds(motion: HumanMotion) -> Array:
    if motion.angular_velocity is not None:
        return np.asarray(np.linalg.norm(motion.angular_velocity, axis=-1))
    return _angular_speeds(motion.time, motion.orientation)


def _angular_speeds(time: Array, orientation: Array) -> Array:
    """(T, K) rad/s of orientations (T, K, 4): the step to the next frame, the last one repeated."""
    if len(time) < 2:
        return np.zeros(orientation.shape[:2])
    steps = rotations.angle(orientation[:-1], orientation[1:]) / np.diff(time)[:, None]
    return np.concatenate([steps, steps[-1:]])


def _speeds(time: Array, position: Array) -> Array:
    """(T, K) m/s of positions (T, K, 3): the step to the next frame, the last one repeated."""
    if len(time) < 2:
        return np.zeros(position.shape[:2])
    steps = np.linalg.norm(np.diff(position, axis=0), axis=-1) / np.diff(time)[:, None]
    return np.concatenate([steps, steps[-1:]])


def _origin(motion: HumanMotion, *names: str) -> Array | None:
    """Position (T, 3) of the first of these segments that was measured and tracked."""
    for name in names:
        if motion.has(name) and np.isfinite(motion.position[0, motion.index(name)]).all():
            return np.asarray(motion.position[:, motion.index(name)])
    return None


def _upright(motion: HumanMotion) -> float | None:
    top, bottom = _origin(motion, "Head", "Neck", "T8"), _origin(motion, "Pelvis", "L5")
    if top is None or bottom is None:
        return None
    trunk = top - bottom
    length = np.linalg.norm(trunk, axis=1)
    return float((trunk[:, 2] / np.maximum(length, 1e-9)).mean())


def _lowest(motion: HumanMotion) -> float | None:
    """Height (m) of the ground: the 2nd percentile of the feet's lowest points."""
    feet = [_origin(motion, f"{side}Toe", f"{side}Foot") for side in ("Left", "Right")]
    heights = [foot[:, 2] for foot in feet if foot is not None]
    return float(np.percentile(np.min(heights, axis=0), 2)) if heights else None


def _stature(motion: HumanMotion) -> float | None:
    head, ground = _origin(motion, "Head"), _lowest(motion)
    if head is None or ground is None:
        return None
    return float(np.percentile(head[:, 2] - ground, 98)) / HEAD_JOINT_OF_STATURE


def _pelvis_height(motion: HumanMotion) -> Array | None:
    pelvis, ground = _origin(motion, "Pelvis"), _lowest(motion)
    return None if pelvis is None else np.asarray(pelvis[:, 2] - (ground or 0.0))


def _travel(motion: HumanMotion) -> float | None:
    pelvis = _origin(motion, "Pelvis", "T8")
    if pelvis is None:
        return None
    # Ten times a second: noise and sway would add up over every frame.
    every = max(1, round(0.1 * motion.rate_hz)) if motion.rate_hz else 1
    return float(np.linalg.norm(np.diff(pelvis[::every, :2], axis=0), axis=1).sum())


def _timing_doubts(timing: Timing) -> list[str]:
    if not timing.uneven:
        return []
    return [
        f"{timing.uneven} steps between frames differ from the usual {1000 * timing.usual_s:.3g} ms, "
        f"by up to {1000 * max(timing.longest_s - timing.usual_s, timing.usual_s - timing.shortest_s):.3g} ms"
    ]


def _posture_doubts(upright: float | None, stature: float | None) -> list[str]:
    doubts = []
    if upright is not None and upright < 0.3:
        way = "upside down" if upright < -0.3 else "lying"
        doubts.append(f"the trunk is {way} on average: is another axis up?")
    elif stature is not None and not STATURE_M[0] <= stature <= STATURE_M[1]:
        doubts.append(
            f"the person would be {stature:.2f} m tall; expected {STATURE_M[0]:g} to {STATURE_M[1]:g} m: "
            "another unit, or somebody who never stands upright"
        )
    return doubts


def _speed_doubts(motion: HumanMotion, turn: Array, speed: Array) -> list[str]:
    doubts = []
    measured: NDArray[np.intp] = np.flatnonzero(motion.measured)
    if not len(measured):
        return ["no segment was measured"]
    worst = measured[int(np.argmax(turn[:, measured].max(axis=0)))]
    if turn[:, worst].max() > FASTEST_RAD_S:
        at = motion.time[int(np.argmax(turn[:, worst]))]
        doubts.append(
            f"{motion.segments[worst]} turns at {turn[:, worst].max():.0f} rad/s at {at:.2f} s: noise, a jump, or a wrong rate"
        )
    fastest = np.nan_to_num(speed[:, measured])
    if fastest.max() > FASTEST_M_S:
        frame, column = np.unravel_index(int(np.argmax(fastest)), fastest.shape)
        doubts.append(
            f"{motion.segments[measured[column]]} moves at {fastest.max():.0f} m/s at {motion.time[frame]:.2f} s: a jump, "
            "a wrong rate or unit"
        )
    return doubts


def step_counts(found: BoolArray) -> dict[str, int]:
    """Side → how often its foot came to the ground, of contacts (T, 4)."""
    counts = {}
    for side in ("Left", "Right"):
        columns = [i for i, name in enumerate(FOOT_CONTACTS) if name.startswith(side)]
        down = found[:, columns].any(axis=1)
        counts[side] = int((np.diff(down.astype(np.int8)) > 0).sum())
    return counts
