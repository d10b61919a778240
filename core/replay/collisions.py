"""Self-collision of a whole trajectory, without dynamics."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple, TypeVar

import mujoco
import numpy as np
from numpy.typing import NDArray
from retarget.core.chunks import frame_chunks
from retarget.core.errors import UsageError
from retarget.core.replay.mesh_contact import MeshContact
from retarget.core.replay.model import ReplayModel
from retarget.core.types import Array

Number = TypeVar("Number", bound=np.generic)
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
    overlap_frame: NDArray[np.int32]
    overlap_pair: NDArray[np.int16]
    overlap_depth_m: Array
    hulls_only: Mapping[tuple[str, str], float] = field(default_factory=dict)

    def by_pair(self) -> dict[tuple[str, str], tuple[float, int, int]]:
        """Two links → (deepest overlap m, its frame, number of frames in which they overlap), deepest first."""
        found = {}
        for a, b in _distinct(self.overlap_pair):
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
    found = _collected(len(joints), links, _contacts(replay, link_of_geom, joints, base_orientation, base_position))
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
    for pair in _distinct(found.overlap_pair[deep]):
        first, second = (found.links[i] for i in pair)
        own = np.flatnonzero((found.overlap_pair == pair).all(axis=1))
        tried = own[deep[own]]
        if len(tried) > MOST_LOOKS:
            tried = tried[np.linspace(0, len(tried) - 1, MOST_LOOKS).astype(int)]
        tried = tried[np.argsort(-found.overlap_depth_m[tried], kind="stable")]
        frames = found.overlap_frame[tried]
        met = meshes.first_meeting(first, second, joints[frames], frames.astype(int))
        out = own if met is None else own[found.overlap_depth_m[own] > found.overlap_depth_m[tried[met]]]
        if len(out):
            kept[out] = False
            left_out[first, second] = float(found.overlap_depth_m[out].max())
    if kept.all():
        return found
    real = [Overlaps(found.overlap_frame[kept], found.overlap_pair[kept], found.overlap_depth_m[kept])]
    checked = _collected(len(found.depth_m), found.links, real)
    return replace(checked, hulls_only=dict(sorted(left_out.items(), key=lambda item: -item[1])))


class Overlaps(NamedTuple):
    """frame (C,), pair (C, 2) of links, lower first, and depth_m (C,) of some overlaps, in numbers as short as hold them: there can be millions."""

    frame: NDArray[np.int32]
    pair: NDArray[np.int16]
    depth_m: Array


def _contacts(
    replay: ReplayModel,
    link_of_geom: NDArray[np.int64],
    joints: Array,
    orientation: Array | None,
    position: Array | None,
) -> Iterator[Overlaps]:
    """The robot's overlaps with itself, those of a chunk of frames together: the small arrays of single frames take several times their room."""
    for part in frame_chunks(len(joints)):
        frames, pairs, depths = [], [], []
        for t, data in _postures(replay, part, joints, orientation, position):
            if not data.ncon:
                continue
            pair = link_of_geom[data.contact.geom]
            depth = -data.contact.dist
            robot = (pair >= 0).all(axis=1) & (depth > 0)
            frames.append(np.full(int(robot.sum()), t))
            pairs.append(np.sort(pair[robot], axis=1))
            depths.append(depth[robot])
        if frames:
            yield Overlaps(
                np.concatenate(frames).astype(np.int32),
                np.concatenate(pairs).astype(np.int16),
                np.concatenate(depths),
            )


def _distinct(pairs: NDArray[np.int16]) -> list[tuple[int, int]]:
    """Each of `pairs` (C, 2) once, in order."""
    # One number for both links: sorting rows takes a second for a million of them.
    numbers = np.unique(pairs.astype(np.int32) @ np.array([1 << 15, 1], np.int32)).tolist()
    return [divmod(number, 1 << 15) for number in numbers]


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


def _collected(frames: int, links: tuple[str, ...], overlaps: Iterable[Overlaps]) -> SelfCollisions:
    """`overlaps` in order of time, no frame in two of them."""
    deepest, who = np.zeros(frames), np.full((frames, 2), -1)
    frame: list[NDArray[np.int32]] = []
    pair: list[NDArray[np.int16]] = []
    depth: list[Array] = []
    for some in overlaps:
        order = np.argsort(some.depth_m, kind="stable")  # the deepest is written last
        deepest[some.frame[order]] = some.depth_m[order]
        who[some.frame[order]] = some.pair[order]
        frame.append(some.frame)
        pair.append(some.pair)
        depth.append(some.depth_m)
    return SelfCollisions(
        deepest,
        who,
        links,
        _joined(frame, np.empty(0, np.int32)),
        _joined(pair, np.empty((0, 2), np.int16)),
        _joined(depth, np.empty(0)),
    )


def _joined(parts: list[NDArray[Number]], nothing: NDArray[Number]) -> NDArray[Number]:
    """`parts` as one array, `nothing` of none; they are let go, so that no two fields are there twice at a time."""
    joined = np.concatenate(parts) if len(parts) > 1 else (*parts, nothing)[0]
    parts.clear()
    return joined
