"""Six virtual trackers strapped to a person: where they sit, and what they would measure, with the faults of real ones on request."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from random import Random
from statistics import NormalDist
from types import MappingProxyType
from typing import Final

import numpy as np
from retarget.core import rotations
from retarget.core.errors import InvalidDataError
from retarget.core.types import Array, HumanMotion, Source, TrackerRecording
from retarget.samples.arm_reach import LEFT, PALM

ROLES: Final[Mapping[str, str]] = MappingProxyType(
    {
        "T8": "chest",
        "Head": "head",
        "LeftUpperArm": "left_upper_arm",
        "RightUpperArm": "right_upper_arm",
        "LeftHand": "left_hand",
        "RightHand": "right_hand",
    }
)
"""Segment → the name of its tracker."""

HAND_OFFSET: Final = (-0.08, 0.0, 0.0)
"""m, in a hand tracker's own frame: from the tracker to the hand point."""


@dataclass(frozen=True, eq=False)
class Mount:
    """How a tracker sits on its segment. rotation: (4,) wxyz, segment ← tracker. position: (3,) m, the tracker in the segment's frame.
    serial: what the device calls itself.
    """

    rotation: Array
    position: Array
    serial: str

    @property
    def tracker_rotation(self) -> Array:
        """(4,) wxyz, tracker ← segment, as `core.calibration.Calibration` has it: R_segment = R_tracker · tracker_rotation."""
        return rotations.conjugate(self.rotation)


@dataclass(frozen=True)
class Dropout:
    """The tracker on `segment` is lost from `start` to `end` s: its last pose is repeated and marked as not tracked."""

    segment: str
    start: float
    end: float


@dataclass(frozen=True)
class Faults:
    """What real trackers do. Noise is white, per axis, one standard deviation. repeats: share of the rows that repeat the row before them,
    which nothing in the log tells. The same seed gives the same faults.
    """

    position_noise_m: float = 0.0
    rotation_noise_rad: float = 0.0
    dropouts: tuple[Dropout, ...] = ()
    repeats: float = 0.0
    seed: int = 0


NO_FAULTS: Final = Faults()


def mounts(seed: int = 0) -> dict[str, Mount]:
    """Segment → how its tracker is strapped on: turned any way round, but a hand tracker points its X away from the palm's centre.

    Hand trackers sit on the back of the hand, 6 cm toward the wrist and 5 cm above the palm's middle, so that the hand point is
    tracker + R · `HAND_OFFSET`.
    """
    # Python promises the same numbers in every version, NumPy does not; the committed files are compared to the byte.
    random = Random(seed)
    around = {"T8": (0.13, 0.0, 0.06), "Head": (0.10, 0.0, 0.09)}
    around |= {f"{side}UpperArm": (0.0, 0.19 * left, 0.06) for side, left in LEFT.items()}
    around |= {f"{side}Hand": (0.0, (PALM - 0.064) * left, 0.048) for side, left in LEFT.items()}
    placed = {}
    for segment, spot in around.items():
        position = np.array(spot)
        if segment.endswith("Hand"):
            palm = np.array([0.0, PALM * LEFT[segment.removesuffix("Hand")], 0.0])
            away = (position - palm) / np.linalg.norm(position - palm)
            side_axis = np.array([1.0, 0.0, 0.0])
            frame = rotations.from_matrix(np.stack([away, side_axis, np.cross(away, side_axis)], axis=-1))
            rotation = rotations.multiply(frame, rotations.exp(np.array([random.uniform(-np.pi, np.pi), 0.0, 0.0])))
        else:
            position = position + np.array([random.uniform(-0.01, 0.01) for _ in range(3)])
            rotation = _random_rotation(random)
        placed[segment] = Mount(rotation, position, f"LHR-{random.getrandbits(32):08X}")
    return placed


def measure(
    motion: HumanMotion, mounted: Mapping[str, Mount], faults: Faults = NO_FAULTS, *, serials: bool = False
) -> TrackerRecording:
    """What the trackers `mounted` on the segments of `motion` report, in its world.

    serials: trackers are called by their serial numbers, in the order of these, and nothing tells their segments.
    Raises `InvalidDataError` for a dropout of a segment without a tracker, and for one that never ends.
    """
    names = {segment: mount.serial if serials else ROLES[segment] for segment, mount in mounted.items()}
    order = sorted(mounted, key=names.__getitem__) if serials else list(mounted)
    orientation, position = [], []
    for segment in order:
        at, mount = motion.index(segment), mounted[segment]
        orientation.append(rotations.multiply(motion.orientation[:, at], mount.rotation))
        position.append(motion.position[:, at] + rotations.rotate(motion.orientation[:, at], mount.position))
    q, p = np.stack(orientation, axis=1), np.stack(position, axis=1)
    random = Random(faults.seed)
    if faults.position_noise_m:
        p = p + faults.position_noise_m * _normal(random, p.shape)
    if faults.rotation_noise_rad:
        q = rotations.multiply(q, rotations.exp(faults.rotation_noise_rad * _normal(random, p.shape)))
    frames, tracked = np.arange(motion.frames), np.ones(q.shape[:2], bool)
    if faults.repeats:
        fresh = np.array([at == 0 or random.random() >= faults.repeats for at in frames])
        held = np.maximum.accumulate(np.where(fresh, frames, 0))
        q, p = q[held], p[held]
    for lost in faults.dropouts:
        if lost.segment not in mounted:
            raise InvalidDataError(f"dropout of {lost.segment}; expected one of {', '.join(mounted)}")
        at = order.index(lost.segment)
        tracked[(motion.time >= lost.start) & (motion.time < lost.end), at] = False
        if not tracked[:, at].any():
            raise InvalidDataError(f"dropout of {lost.segment} from {lost.start:g} to {lost.end:g} s leaves no frame")
        # The last good frame before, or, where there is none, the first one after.
        last = np.maximum.accumulate(np.where(tracked[:, at], frames, -1))
        last = np.where(last < 0, int(np.argmax(tracked[:, at])), last)
        q[:, at], p[:, at] = q[last, at], p[last, at]
    return TrackerRecording(
        time=motion.time,
        trackers=tuple(names[segment] for segment in order),
        orientation=rotations.make_continuous(q),
        position=p,
        tracked=tracked,
        segments={} if serials else {names[segment]: segment for segment in order},
        source=Source("synthetic", rate_hz=motion.source.rate_hz),
    )


def _random_rotation(random: Random) -> Array:
    """A unit quaternion, uniform over all rotations: a normal vector of four numbers has no direction of its own."""
    return rotations.normalize(_normal(random, (4,)))


def _normal(random: Random, shape: tuple[int, ...]) -> Array:
    standard = NormalDist()
    # random() may be 0 but never 1.
    values = [standard.inv_cdf(1.0 - random.random() or 0.5) for _ in range(int(np.prod(shape)))]
    return np.array(values).reshape(shape)
