"""A task done by the operator, known exactly, and what six trackers showed of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike
from retarget.core import rotations
from retarget.core.segments import SEGMENTS
from retarget.core.types import Array, HumanMotion, Source, TrackerRecording
from retarget.samples import curves, person, upper_body
from retarget.samples.arm_reach import LEFT, PALM
from retarget.samples.tasks import Body, Calibration, Keys, Task
from retarget.samples.trackers import NO_FAULTS, Faults, Mount, measure, mounts

TRUTH_SEGMENTS: Final = (
    "Pelvis",
    "T8",
    "Head",
    *(f"{side}{part}" for side in ("Left", "Right") for part in ("UpperArm", "ForeArm", "Hand")),
)

SHOULDER: Final[Mapping[str, Array]] = {
    side: person.JOINT_OFFSETS[f"{side}Shoulder"] + person.JOINT_OFFSETS[f"{side}UpperArm"] for side in LEFT
}
"""Side → (3,) m, the shoulder's centre in the frame of T8, whose origin is T8's joint."""


@dataclass(frozen=True, eq=False)
class Take:
    """recording: what the trackers measured. Everything else is true, in the same world (X forward, Y left, Z up).

    motion: `TRUTH_SEGMENTS`, origins at the proximal joints: UpperArm = shoulder, ForeArm = elbow, Hand = wrist.
    hand_point: side → (T, 3) m, the palm's centre. mounts: segment → how its tracker sits.
    heading_rad, origin: where the person stood: turned left by the heading about the world's Z, over `origin` (3,) m on the floor.
    """

    task: Task
    recording: TrackerRecording
    motion: HumanMotion
    hand_point: Mapping[str, Array]
    mounts: Mapping[str, Mount]
    heading_rad: float
    origin: Array

    @property
    def tracker_of(self) -> dict[str, str]:
        """Segment → name of its tracker in `recording`, also where that does not tell."""
        named = {segment: name for name, segment in self.recording.segments.items()}
        return {segment: named.get(segment, mount.serial) for segment, mount in self.mounts.items()}

    def position(self, segment: str) -> Array:
        """(T, 3) m, world, of the segment's proximal joint."""
        return np.asarray(self.motion.position[:, self.motion.index(segment)])


def operator_recording(
    task: Task | None = None,
    *,
    rate_hz: float = 90.0,
    heading_rad: float = 0.0,
    origin: ArrayLike = (0.0, 0.0, 0.0),
    mount_seed: int = 0,
    faults: Faults = NO_FAULTS,
    serials: bool = False,
) -> Take:
    """`task` (the calibration poses when None) at `rate_hz`, frames at 0, 1/rate, …, measured in the house's world.

    heading_rad turns the person left about Z, `origin` (3,) m is the floor under the pelvis at rest. Takes with the same `mount_seed` have
    their trackers strapped on alike: one calibrates the other. serials: trackers go by serial number only.
    """
    done = task if task is not None else Calibration()
    time = np.arange(round(done.duration * rate_hz) + 1) / rate_hz
    orientation, position = person.forward(*_posture(done, time))
    turn, place = rotations.exp(np.array([0.0, 0.0, heading_rad])), np.asarray(origin, float)
    orientation, position = rotations.multiply(turn, orientation), place + rotations.rotate(turn, position)
    keep = [SEGMENTS.index(segment) for segment in TRUTH_SEGMENTS]
    motion = HumanMotion(
        time=time,
        segments=TRUTH_SEGMENTS,
        orientation=orientation[:, keep],
        position=position[:, keep],
        source=Source("synthetic", rate_hz=rate_hz),
    )
    hands = {side: SEGMENTS.index(f"{side}Hand") for side in LEFT}
    points = {
        side: position[:, at] + rotations.rotate(orientation[:, at], np.array([0.0, LEFT[side] * PALM, 0.0]))
        for side, at in hands.items()
    }
    mounted = mounts(mount_seed)
    recording = measure(motion, mounted, faults, serials=serials)
    return Take(done, recording, motion, points, mounted, heading_rad, place)


def _posture(task: Task, time: Array) -> tuple[Array, dict[str, Array]]:
    """Pelvis position (T, 3) m and joint rotations (T, 4), as `person.forward` takes them, facing +X over the world's origin."""
    root, joints = _stance(task.body, time)
    for side in LEFT:
        joints |= task.arm(side, time).rotations_of(side)
    return root, joints


def _stance(body: Body, time: Array) -> tuple[Array, dict[str, Array]]:
    def angle(keys: Keys) -> Array:
        return np.radians(curves.keyed(time, keys))

    level = np.zeros(len(time))
    height = np.full(len(time), person.HIP_HEIGHT)
    root = np.stack([curves.keyed(time, body.forward), curves.keyed(time, body.sideways), height], axis=-1)
    joints = upper_body.trunk(angle(body.trunk_flexion), level, angle(body.trunk_turn))
    return root, joints | upper_body.head(angle(body.head_flexion), level, angle(body.head_turn))
