"""Frames of a suit as a motion: turned into the house's segment frames, joints found, bones checked.

Xsens' own frames are those of the house: identity in T-pose. The Xsens drivers for ROS turn the arms' frames, so that they are the
identity with the arms hanging; some forks don't. What a recording holds shows in its bones: along ±Y of an upper arm in the first case,
along −Z in the second.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from retarget.core import rotations
from retarget.core.segments import LIMB_END, PARENT, SEGMENTS
from retarget.core.types import Array, HumanMotion, Source
from retarget.formats._describe import motion_facts
from retarget.formats._frame_map import FrameMap
from retarget.formats._tracker_faults import usual_step
from retarget.formats._tracker_frames import to_house
from retarget.formats._tracker_recording import Log, Placed

_NEAR_DEG = 45.0
_RIGID_M = 0.01
"""A joint that keeps its place in the parent within this, rms, is one."""
_HALF = float(np.sqrt(0.5))
HANGING_ARMS = {"Right": (_HALF, -_HALF, 0.0, 0.0), "Left": (_HALF, _HALF, 0.0, 0.0)}
"""Side → world ← frame (wxyz) of an arm's segment in T-pose, where frames are the identity with the arms hanging."""


def motion_of(log: Log, placed: Placed, frame_map: FrameMap) -> tuple[HumanMotion, dict[str, Any]]:
    """The motion of segments on one time base, and JSON-able facts. The map's rotations apply; without any, the arms' are found."""
    segments, position, orientation = in_house(log, placed)
    warnings = [*log.warnings, *placed.warnings]
    references = dict(frame_map.rotations) or arm_references(segments, position, orientation, warnings)
    turned = orientation.copy()
    for segment, reference in references.items():
        if segment in segments:
            at = segments.index(segment)
            turned[:, at] = rotations.multiply(orientation[:, at], rotations.conjugate(np.array(reference)))
    orientation = rotations.make_continuous(turned)
    for limb, end in LIMB_END.items():
        bone = _bone(segments, position, orientation, limb, end)
        wanted = (0.0, 0.0, -1.0) if limb.endswith("Leg") else (0.0, 1.0 if limb.startswith("Left") else -1.0, 0.0)
        if bone is not None and (off := _angle(bone, wanted)) > _NEAR_DEG:
            warnings.append(
                f"{limb} → {end} is {off:.0f}° off its direction in T-pose: [rotations] of --frames turn frames"
            )
    interpolated = int((~placed.tracked).any(axis=1).sum())
    step = usual_step(placed.time)
    motion = HumanMotion(
        time=placed.time,
        segments=segments,
        orientation=orientation,
        position=position,
        joint_offsets=_offsets(segments, position, orientation),
        source=Source(
            format=log.format,
            rate_hz=1.0 / step if step else 0.0,
            sha256=log.sha256,
            warnings=tuple(warnings),
            interpolated_frames=interpolated,
        ),
    )
    return motion, dict(motion_facts(log.format, motion))


def in_house(log: Log, placed: Placed) -> tuple[tuple[str, ...], Array, Array]:
    """Segments in the house's order, and of their frames, as recorded, position (T, S, 3) and orientation (T, S, 4) wxyz in the house's world."""
    order = [placed.trackers.index(segment) for segment in SEGMENTS if segment in placed.trackers]
    segments = tuple(placed.trackers[index] for index in order)
    position, orientation = to_house(
        placed.position[:, order], rotations.normalize(placed.orientation[:, order]), log.up, log.handedness
    )
    return segments, position, orientation


def arm_references(
    segments: tuple[str, ...], position: Array, orientation: Array, warnings: list[str]
) -> dict[str, tuple[float, ...]]:
    """`HANGING_ARMS` by segment, of the sides whose bones show it, with a warning each.

    position (T, S, 3) m and orientation (T, S, 4) wxyz: of the segments' frames, as recorded, in the house's world.
    """
    references: dict[str, tuple[float, ...]] = {}
    bones = {end: _bone(segments, position, orientation, limb, end) for limb, end in LIMB_END.items()}
    for side in ("Left", "Right"):
        found = [bones[f"{side}{end}"] for end in ("ForeArm", "Hand") if bones[f"{side}{end}"] is not None]
        if found and all(_angle(bone, (0.0, 0.0, -1.0)) < _NEAR_DEG for bone in found):
            arm = [f"{side}{part}" for part in ("UpperArm", "ForeArm", "Hand") if f"{side}{part}" in segments]
            references |= dict.fromkeys(arm, HANGING_ARMS[side])
            warnings.append(f"{', '.join(arm)}: frames of hanging arms, turned into those of the T-pose")
    return references


def _offsets(segments: tuple[str, ...], position: Array, orientation: Array) -> dict[str, Array]:
    """Segment → its origin in its parent's frame (3,) m, where it keeps its place there."""
    found = {}
    for segment in segments:
        parent = PARENT[segment]
        if parent in segments:
            local = _local(segments, position, orientation, str(parent), segment)
            mean = local.mean(axis=0)
            if np.sqrt(((local - mean) ** 2).sum(axis=1).mean()) < _RIGID_M:
                found[segment] = mean
    return found


def _local(segments: tuple[str, ...], position: Array, orientation: Array, parent: str, child: str) -> Array:
    """The child's origin (T, 3) in the parent's frame."""
    up, at = segments.index(parent), segments.index(child)
    return rotations.rotate(rotations.conjugate(orientation[:, up]), position[:, at] - position[:, up])


def _bone(
    segments: tuple[str, ...], position: Array, orientation: Array, limb: str, end: str
) -> tuple[float, float, float] | None:
    """Mean direction of a limb in its own frame; None where it is not known or no one line."""
    if limb not in segments or end not in segments:
        return None
    mean = _local(segments, position, orientation, limb, end).mean(axis=0)
    length = float(np.linalg.norm(mean))
    x, y, z = (mean / length).tolist() if length > _RIGID_M else (0.0, 0.0, 0.0)
    return (x, y, z) if length > _RIGID_M else None


def _angle(bone: tuple[float, float, float] | None, wanted: tuple[float, float, float]) -> float:
    """Degrees between two unit vectors."""
    return float(np.degrees(np.arccos(np.clip(np.dot(bone or wanted, wanted), -1.0, 1.0))))
