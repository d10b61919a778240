"""A synthetic operator with six or seven trackers: straight arms on two ball joints, closed-form poses, any heading, place and mount.

Written from the definition of the poses alone; nothing of `retarget.core.calibrate` is used. SciPy does the rotations.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray
from retarget.core import rotations
from retarget.core.types import Source, TrackerRecording
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

SIDES = ("Left", "Right")
ROLES = ("T8", "Head", "LeftUpperArm", "RightUpperArm", "LeftHand", "RightHand")
SERIAL = {segment: f"LHR-{index:04X}" for index, segment in enumerate((*ROLES, "Pelvis"), 0xA0)}
ARM = {"still": (0.0, 0.0, -1.0), "tpose": (0.0, 1.0, 0.0), "forward": (1.0, 0.0, 0.0)}
"""Pose → direction of the left arm in the operator's frame; the right arm's is mirrored."""


def arm_rotation(side: str, pose: str) -> Rotation:
    """Orientation of an arm's segments in a pose, the identity in T-pose: a turn about one axis of the person."""
    left = 1.0 if side == "Left" else -1.0
    turn = {"still": [-90.0 * left, 0.0, 0.0], "tpose": [0.0, 0.0, 0.0], "forward": [0.0, 0.0, -90.0 * left]}[pose]
    return Rotation.from_rotvec(turn, degrees=True)


@dataclass
class Operator:
    """The person and their trackers. World: operator's own frame turned by `heading` and moved to `place`; the floor is z = 0.

    shoulder_half, shoulder_height, arm_length: m. mount: segment → rotation tracker → segment. hand_offset: side → hand tracker to hand
    point in the tracker's axes, m; `offset` is the left one. elbow_deg: (side, pose) → bend of that elbow, forearm up (down in the Still pose: ahead).
    aim_deg: (side, pose) → turn of that whole arm about the vertical, toward the front.
    """

    heading: float = 0.0
    place: ArrayLike = (0.0, 0.0, 0.0)
    shoulder_half: float = 0.18
    shoulder_height: float = 1.42
    arm_length: float = 0.58
    mount: Mapping[str, Rotation] = field(default_factory=dict)
    hand_offset: Mapping[str, ArrayLike] = field(default_factory=lambda: dict.fromkeys(SIDES, (-0.08, 0.0, 0.0)))
    elbow_deg: Mapping[tuple[str, str], float] = field(default_factory=dict)
    aim_deg: Mapping[tuple[str, str], float] = field(default_factory=dict)
    roles: tuple[str, ...] = ROLES

    @classmethod
    def random(cls, seed: int, **fields: object) -> Operator:
        """Any heading, place, build, mounts and hand offset (one for both hands, in the trackers' axes)."""
        rng = np.random.default_rng(seed)
        mount = {segment: Rotation.random(random_state=rng) for segment in (*ROLES, "Pelvis")}
        offset = dict.fromkeys(SIDES, rng.uniform(-0.08, 0.08, 3))
        chosen = {
            "heading": rng.uniform(-np.pi, np.pi),
            "place": rng.uniform(-4, 4, 3) * [1, 1, 0],
            "shoulder_half": rng.uniform(0.14, 0.22),
            "shoulder_height": rng.uniform(1.2, 1.6),
            "arm_length": rng.uniform(0.48, 0.7),
            "mount": mount,
            "hand_offset": offset,
            **fields,
        }
        return cls(**chosen)  # type: ignore[arg-type]  # fields by name

    @property
    def to_world(self) -> Rotation:
        return Rotation.from_euler("z", self.heading)

    @property
    def offset(self) -> list[float]:
        return np.asarray(self.hand_offset["Left"], float).tolist()

    def shoulder(self, side: str) -> Array:
        """(3,) m, in the person's own frame with its origin on the floor."""
        return np.array([0.0, self.shoulder_half if side == "Left" else -self.shoulder_half, self.shoulder_height])

    def world(self, point: ArrayLike) -> Array:
        """A point of the person's frame in the world."""
        return self.to_world.apply(point) + np.asarray(self.place, float)

    def segment(self, name: str, pose: str, lean: Rotation | None = None) -> tuple[Array, Rotation]:
        """Origin-point and orientation of what a tracker is on, person's frame; `lean` turns the whole person about the floor."""
        point, turned = self._upright(name, pose)
        return (point, turned) if lean is None else (lean.apply(point), lean * turned)

    def _upright(self, name: str, pose: str) -> tuple[Array, Rotation]:
        h = self.shoulder_height
        fixed = {"T8": (0.11, 0.01, h - 0.12), "Head": (0.08, 0.0, h + 0.24), "Pelvis": (0.1, 0.0, h - 0.46)}
        if name in fixed:
            return np.array(fixed[name]), Rotation.identity()
        side = "Left" if name.startswith("Left") else "Right"
        left = 1.0 if side == "Left" else -1.0
        aim = Rotation.from_euler("z", -left * self.aim_deg.get((side, pose), 0.0), degrees=True)
        turned = aim * arm_rotation(side, pose)
        bone = turned.apply([0.0, left, 0.0])
        if name.endswith("UpperArm"):
            return self.shoulder(side) + 0.17 * bone + [0.0, 0.03 * left, 0.02], turned
        bend = np.radians(self.elbow_deg.get((side, pose), 0.0))
        aside = np.array([1.0, 0.0, 0.0]) if pose == "still" else np.array([0.0, 0.0, 1.0])
        fore = Rotation.from_rotvec(bend * np.cross(bone, aside))
        half = self.arm_length / 2
        return self.shoulder(side) + half * bone + half * fore.apply(bone), fore * turned

    def tracker(self, name: str, pose: str, lean: Rotation | None = None) -> tuple[Array, Rotation]:
        """Position and orientation of the tracker on segment `name`, in the world."""
        point, turned = self.segment(name, pose, lean)
        device = self.to_world * turned * self.mount.get(name, Rotation.identity()).inv()
        position = self.world(point)
        if name.endswith("Hand"):
            position = position - device.apply(self.hand_offset[name.removesuffix("Hand")])
        return position, device

    def record(
        self,
        poses: tuple[str, ...] = ("still", "tpose", "forward"),
        *,
        hold_s: float = 1.5,
        move_s: float = 1.0,
        rate_hz: float = 90.0,
        noise_m: float = 0.0,
        noise_deg: float = 0.0,
        lean_deg: Mapping[str, tuple[float, float, float]] | None = None,
        named: bool = True,
        seed: int = 0,
    ) -> TrackerRecording:
        """The poses one after the other, each held, straight lines between them. lean_deg: pose → rotation vector of the whole person."""
        rng = np.random.default_rng(seed)
        hold, move = round(hold_s * rate_hz), round(move_s * rate_hz)
        positions, orientations = [], []
        for name in self.roles:
            keys = [
                self.tracker(name, pose, Rotation.from_rotvec((lean_deg or {}).get(pose, (0, 0, 0)), degrees=True))
                for pose in poses
            ]
            points, turns = [], []
            for index, (point, turned) in enumerate(keys):
                if index:
                    share = (np.arange(move) + 1) / (move + 1)
                    before, before_turned = keys[index - 1]
                    points.append(before + share[:, None] * (point - before))
                    step = (before_turned.inv() * turned).as_rotvec()
                    turns.append(wxyz(before_turned * Rotation.from_rotvec(share[:, None] * step)))
                points.append(np.repeat(point[None], hold, 0))
                turns.append(np.repeat(wxyz(turned)[None], hold, 0))
            positions.append(np.concatenate(points))
            orientations.append(np.concatenate(turns))
        position, orientation = np.stack(positions, 1), np.stack(orientations, 1)
        position = position + rng.normal(0, noise_m, position.shape)
        jitter = rng.normal(0, np.radians(noise_deg), position.shape)
        orientation = rotations.multiply(orientation, rotations.exp(jitter))
        frames = len(position)
        return TrackerRecording(
            time=np.arange(frames) / rate_hz,
            trackers=tuple(SERIAL[name] for name in self.roles),
            orientation=rotations.make_continuous(orientation),
            position=position,
            tracked=np.ones((frames, len(self.roles)), bool),
            segments={SERIAL[name]: name for name in self.roles} if named else {},
            source=Source("synthetic", rate_hz=rate_hz, sha256="0" * 64),
        )


def wxyz(rotation: Rotation) -> Array:
    """SciPy's rotation as quaternions in the house's order."""
    return np.roll(rotation.as_quat(), 1, axis=-1)


def windows(
    poses: tuple[str, ...] = ("still", "tpose", "forward"), hold_s: float = 1.5, move_s: float = 1.0
) -> dict[str, tuple[float, float]]:
    """Where `record` holds each pose, a tenth of a second inside."""
    return {pose: (i * (hold_s + move_s) + 0.1, i * (hold_s + move_s) + hold_s - 0.1) for i, pose in enumerate(poses)}
