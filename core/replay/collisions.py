"""Self-collision of a whole trajectory, without dynamics."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import mujoco
import numpy as np
from numpy.typing import NDArray
from retarget.core.chunks import frame_chunks
from retarget.core.errors import UsageError
from retarget.core.replay.mesh_contact import MeshContact
from retarget.core.replay.model import ReplayModel
from retarget.core.types import Array

MOST_LOOKS = 2000
"""Overlaps of one pair of links that are looked at mesh against mesh: half a minute at 60 Hz frame by frame."""


@dataclass(frozen=True, eq=False)
class SelfCollisions:
    """Overlaps of the robot with itself. T frames, C overlapping pairs of shapes in all of them, in order of time.

    depth_m: (T,), of the deepest overlap in each frame, 0 where there is none. links: names that `pair` indexes. pair: (T, 2), the links that
    overlap deepest, -1 where none do. overlap_frame: (C,), overlap_pair: (C, 2), lower first, overlap_depth_m: (C,).
    hulls_only: two links → depth m, of overlaps that were left out because only hulls had them, not the meshes.
    """

    depth_m: Array
    pair: NDArray[np.int64]
    links: tuple[str, ...]
    overlap_frame: NDArray[np.int64]
    overlap_pair: NDArray[np.int64]
    overlap_depth_m: Array
    hulls_only: Mapping[tuple[str, str], float] = field(default_factory=dict)

    def by_pair(self) -> dict[tuple[str, str], tuple[float, int, int]]:
        """Two links → (deepest overlap m, its frame, number of frames in which they overlap), deepest first."""
        found = {}
        for a, b in np.unique(self.overlap_pair, axis=0):
            rows = np.flatnonzero((self.overlap_pair == (a, b)).all(axis=1))
            worst = rows[np.argmax(self.overlap_depth_m[rows])]
            frames = len(np.unique(self.overlap_frame[rows]))
            found[self.links[a], self.links[b]] = (
                float(self.overlap_depth_m[worst]), int(self.overlap_frame[worst]), frames,
            )  # fmt: skip
        return dict(sorted(found.items(), key=lambda item: -item[1][0]))


def self_collisions(
    replay: ReplayModel,
    joints: Array,
    base_orientation: Array | None = None,
    base_position: Array | None = None,
    *,
    doubted_m: float | None = None,
) -> SelfCollisions:
    """Where the robot's solid shapes overlap at joints (T, n); base pose as wxyz (T, 4) and m (T, 3), which only matters to the floor.

    Meshes count as their convex hulls; `replay.excluded` pairs of bodies and shapes of one body are not judged.
    doubted_m: overlaps deeper than this are looked at again, mesh against mesh; those that are in the hulls alone are left out. None = none are.
    Raises `UsageError` for a model built without `self_collision`, which could see nothing.
    """
    mj = replay.mj
    solid = [i for i in range(mj.ngeom) if mj.geom_bodyid[i] != 0]
    if not replay.self_collision and any(mj.geom_conaffinity[solid]):
        raise UsageError(
            "the replay model was built without self_collision: it can't tell where the robot meets itself"
        )
    links = tuple(dict.fromkeys(mj.geom(i).name.rpartition("/")[0] for i in solid))
    link_of_geom = np.full(mj.ngeom, -1)
    link_of_geom[solid] = [links.index(mj.geom(i).name.rpartition("/")[0]) for i in solid]
    overlaps: list[Overlaps] = []
    for part in frame_chunks(len(joints)):
        # Joined for each chunk: the small arrays of each frame take several times as much as the numbers in them.
        overlaps.append(
            _joined(
                [
                    _overlaps(t, data, link_of_geom)
                    for t, data in _postures(replay, part, joints, base_orientation, base_position)
                    if data.ncon
                ]
            )
        )
    found = _collected(len(joints), links, _joined(overlaps))
    return found if doubted_m is None else _verified(found, replay, np.asarray(joints), doubted_m)


def _verified(found: SelfCollisions, replay: ReplayModel, joints: Array, doubted_m: float) -> SelfCollisions:
    """`found` without what deeper than `doubted_m` is in the hulls alone.

    Of each pair of links the deepest overlaps are tried first. Those deeper than the first real one are left out; where none is real, all of the
    pair's are, as shallower ones come of the same hulls. Of more than `MOST_LOOKS` overlaps some are tried, equally far apart in time.
    """
    deep = found.overlap_depth_m > doubted_m
    if not deep.any():
        return found
    meshes, kept, left_out = MeshContact(replay.robot), np.ones(len(deep), bool), {}
    for pair in np.unique(found.overlap_pair[deep], axis=0):
        first, second = (found.links[i] for i in pair)
        own = np.flatnonzero((found.overlap_pair == pair).all(axis=1))
        tried = own[deep[own]]
        if len(tried) > MOST_LOOKS:
            tried = tried[np.linspace(0, len(tried) - 1, MOST_LOOKS).astype(int)]
        tried = tried[np.argsort(-found.overlap_depth_m[tried], kind="stable")]
        frames = found.overlap_frame[tried]
        met = meshes.first_meeting(first, second, joints[frames], frames)
        out = own if met is None else own[found.overlap_depth_m[own] > found.overlap_depth_m[tried[met]]]
        if len(out):
            kept[out] = False
            left_out[first, second] = float(found.overlap_depth_m[out].max())
    real = found.overlap_frame[kept], found.overlap_pair[kept], found.overlap_depth_m[kept]
    checked = _collected(len(found.depth_m), found.links, real)
    return replace(checked, hulls_only=dict(sorted(left_out.items(), key=lambda item: -item[1])))


Overlaps = tuple[NDArray[np.int64], NDArray[np.int64], Array]
"""Frames (C,), pairs of links (C, 2), and depths (C,) m of some overlaps."""


def _overlaps(t: int, data: mujoco.MjData, link_of_geom: NDArray[np.int64]) -> Overlaps:
    """Those among the contacts of frame `t`."""
    pair, depth = link_of_geom[data.contact.geom], -data.contact.dist
    robot = (pair >= 0).all(axis=1) & (depth > 0)
    return np.full(int(robot.sum()), t), np.sort(pair[robot], axis=1), depth[robot]


def _joined(overlaps: list[Overlaps]) -> Overlaps:
    frames, pairs, depths = zip((np.empty(0, int), np.empty((0, 2), int), np.empty(0)), *overlaps, strict=True)
    return np.concatenate(frames), np.concatenate(pairs), np.concatenate(depths)


def _postures(
    replay: ReplayModel, part: slice, joints: Array, orientation: Array | None, position: Array | None
) -> Iterator[tuple[int, mujoco.MjData]]:
    """(frame, data with its contacts), of the frames in `part`."""
    mj, data = replay.mj, mujoco.MjData(replay.mj)
    qpos = np.tile(mj.qpos0, (part.stop - part.start, 1))
    qpos[:, replay.qpos] = joints[part]
    if replay.base_qpos is not None:
        if position is not None:
            qpos[:, replay.base_qpos : replay.base_qpos + 3] = position[part]
        if orientation is not None:
            qpos[:, replay.base_qpos + 3 : replay.base_qpos + 7] = orientation[part]
    now = data.qpos
    for t, posture in enumerate(qpos, part.start):
        now[:] = posture
        mujoco.mj_kinematics(mj, data)
        mujoco.mj_collision(mj, data)
        yield t, data


def _collected(frames: int, links: tuple[str, ...], overlaps: Overlaps) -> SelfCollisions:
    frame, pair, depth = overlaps
    deepest, who = np.zeros(frames), np.full((frames, 2), -1)
    order = np.argsort(depth, kind="stable")  # the deepest is written last
    deepest[frame[order]] = depth[order]
    who[frame[order]] = pair[order]
    return SelfCollisions(deepest, who, links, frame, pair, depth)
