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
from retarget.samples.curves import Keys
from retarget.samples.sway import MIDDLE, Sway, sway
from retarget.samples.tasks import Body, Calibration, Task
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
    still: one frame, the Still pose in which the task starts, without sway: the chest upright, the pelvis over `origin`.
    heading_rad, origin: where the person stood: turned left by the heading about the world's Z, over `origin` (3,) m on the floor.
    """

    task: Task
    recording: TrackerRecording
    motion: HumanMotion
    still: HumanMotion
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
    The operator breathes and sways throughout (`sway`); that is part of what is true.
    """
    done = task if task is not None else Calibration()
    time = np.arange(round(done.duration * rate_hz) + 1) / rate_hz
    place = np.asarray(origin, float)

    def moved(at: Array, swaying: Array) -> HumanMotion:
        return _motion(done, at, swaying, heading_rad, place, Source("synthetic", rate_hz=rate_hz))

    motion, still = moved(time, time), moved(np.zeros(1), np.array([MIDDLE]))
    points = {}
    for side, left in LEFT.items():
        wrist = motion.index(f"{side}Hand")
        palm = rotations.rotate(motion.orientation[:, wrist], np.array([0.0, left * PALM, 0.0]))
        points[side] = motion.position[:, wrist] + palm
    mounted = mounts(mount_seed)
    recording = measure(motion, mounted, faults, serials=serials)
    return Take(done, recording, motion, still, points, mounted, heading_rad, place)


def _motion(task: Task, time: Array, swaying: Array, heading_rad: float, place: Array, source: Source) -> HumanMotion:
    """`task` at `time` (T,) s while the body sways as at `swaying` (T,) s, turned left by the heading and moved to `place` (3,) m."""
    root, joints = _stance(task.body, time, sway(swaying))
    for side in LEFT:
        joints |= task.arm(side, time).rotations_of(side)
    orientation, position = person.forward(root, joints)
    turn = rotations.exp(np.array([0.0, 0.0, heading_rad]))
    keep = [SEGMENTS.index(segment) for segment in TRUTH_SEGMENTS]
    return HumanMotion(
        time=time,
        segments=TRUTH_SEGMENTS,
        orientation=rotations.multiply(turn, orientation[:, keep]),
        position=place + rotations.rotate(turn, position[:, keep]),
        source=source,
    )


def _stance(body: Body, time: Array, more: Sway) -> tuple[Array, dict[str, Array]]:
    """Pelvis position (T, 3) m and the rotations (T, 4) of trunk and head, as `person.forward` takes them: `body` and `more` together."""

    def angle(keys: Keys, swayed: Array) -> Array:
        return np.asarray(np.radians(curves.keyed(time, keys)) + swayed)

    forward = curves.keyed(time, body.forward) + more.forward
    sideways = curves.keyed(time, body.sideways) + more.sideways
    root = np.stack([forward, sideways, np.full(len(time), person.HIP_HEIGHT)], axis=-1)
    trunk = upper_body.trunk(
        angle(body.trunk_flexion, more.trunk_flexion), more.trunk_sidebend, angle(body.trunk_turn, more.trunk_turn)
    )
    head = upper_body.head(
        angle(body.head_flexion, more.head_flexion), more.head_sidebend, angle(body.head_turn, more.head_turn)
    )
    return root, trunk | head
