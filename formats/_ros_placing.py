"""Frames of a ROS recording on one time base: their samples as rows of a log, and the chains composed once every edge is placed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from retarget.core import rotations
from retarget.core.errors import FormatError
from retarget.core.types import Array, BoolArray
from retarget.formats._ros_frames import Edge, compose
from retarget.formats._tracker_faults import LONGEST_HOLD_S, Samples
from retarget.formats._tracker_recording import Placed

_HELD_SHARE = 0.2


def out_of_order(label: str, poses: int) -> str:
    """The line that says so."""
    return f"{label}: {poses} poses out of order, sorted by time"


def repeated(held: int, frames: int) -> str:
    """The line that says so of a whole person."""
    return f"{held} of {frames} frames repeat the whole pose before, as published faster than measured: left out"


def samples_of(edge: Edge, time: NDArray[np.int64], warnings: list[str]) -> Samples:
    """The edge's rows in order of time; what comes late on a network is not time going backward."""
    poses = edge.poses()
    order = np.argsort(time, kind="stable")
    if late := int((np.diff(time) < 0).sum()):
        warnings.append(out_of_order(edge.label, late))
    return Samples(
        tracker=edge.label,
        time=time[order] / 1e9,
        position=poses[order, :3],
        orientation=poses[order, 3:],
        valid=np.ones(len(order), bool),
        line=order + 1,
    )


def without_held(samples: list[Samples], warnings: list[str]) -> list[Samples]:
    """Without rows in which the whole person repeats the row before: a driver that publishes faster than the suit measures."""
    rows = {len(one.time) for one in samples}
    if len(rows) != 1 or (count := rows.pop()) < 3:
        return samples
    same = np.ones(count, bool)
    same[0] = False
    for one in samples:
        same[1:] &= (one.position[1:] == one.position[:-1]).all(axis=1) & (
            one.orientation[1:] == one.orientation[:-1]
        ).all(axis=1)
    # A person who stands perfectly still is a synthetic one, or a frozen suit: that stays.
    new = np.flatnonzero(~same)
    last = np.append(new[1:], count) - 1
    for first, end in zip(new, last, strict=True):
        if samples[0].time[end] - samples[0].time[first] > LONGEST_HOLD_S:
            same[first : end + 1] = False
    held = int(same.sum())
    if held < _HELD_SHARE * count:
        return samples
    warnings.append(repeated(held, count))
    keep = ~same
    return [
        replace(
            one,
            time=one.time[keep],
            position=one.position[keep],
            orientation=one.orientation[keep],
            valid=one.valid[keep],
            line=one.line[keep],
        )
        for one in samples
    ]


_FARTHEST_M = 1e7
"""Of a static frame from the one it hangs in: coordinates of maps reach this far, not farther."""


def composed(file: str, chains: Mapping[str, Sequence[Edge]], placed: Placed) -> Placed:
    """The frames in their root, from their edges on one time base. Tracked is where every moving edge above is.

    Raises `FormatError` for a static transform that is none, in recording `file`.
    """
    column = {label: index for index, label in enumerate(placed.trackers)}
    frames = len(placed.time)
    known: dict[tuple[int, ...], tuple[Array, Array, BoolArray]] = {}

    def pose(edges: Sequence[Edge]) -> tuple[Array, Array, BoolArray]:
        key = tuple(id(edge) for edge in edges)
        if key in known:
            return known[key]
        *above, edge = edges
        if edge.static:
            constant = edge.poses()[-1]
            # Each part first: the square of a large one overflows.
            unit = (np.abs(constant[3:]) < 2).all() and abs(np.linalg.norm(constant[3:]) - 1) <= 1e-2
            if not (unit and (np.abs(constant[:3]) < _FARTHEST_M).all()):
                place = f"topic {edge.topic}, {edge.label}"
                raise FormatError(
                    file, f"found {constant.tolist()}", place=place, expected="a pose with a unit quaternion"
                )
            constant[3:] = rotations.normalize(constant[3:])
            own = np.broadcast_to(constant[:3], (frames, 3)), np.broadcast_to(constant[3:], (frames, 4))
            seen = np.ones(frames, bool)
        else:
            at = column[edge.label]
            own, seen = (placed.position[:, at], placed.orientation[:, at]), placed.tracked[:, at]
        if above:
            *outer, outer_seen = pose(above)
            own, seen = compose((outer[0], outer[1]), own), seen & outer_seen
        known[key] = own[0], own[1], seen
        return known[key]

    found = []
    for edges in chains.values():
        if edges:
            found.append(pose(edges))
        else:
            identity = np.broadcast_to(np.array([1.0, 0.0, 0.0, 0.0]), (frames, 4))
            found.append((np.zeros((frames, 3)), identity, np.ones(frames, bool)))
    return replace(
        placed,
        trackers=tuple(chains),
        position=np.stack([one[0] for one in found], axis=1),
        orientation=np.stack([one[1] for one in found], axis=1),
        tracked=np.stack([one[2] for one in found], axis=1),
        roles={name: name.rpartition("/")[2] for name in chains},
    )
