"""The joints beside the ranges that they were written with, where the trajectory's provenance keeps them (`core.joint_ranges`).

Joints that changed places, columns sorted into another order or names into another list: what each joint does then is what another one did.
"""

from __future__ import annotations

import numpy as np
from retarget.core.chunks import frame_chunks
from retarget.core.errors import InvalidDataError
from retarget.core.joint_ranges import STEPS_A_UNIT, JointRanges
from retarget.core.replay.joint_checks import beyond, position_rounding
from retarget.core.replay.signals import Signal, larger, worst
from retarget.core.replay.thresholds import Thresholds
from retarget.core.report import Check
from retarget.core.types import Array, BoolArray, JointTrajectory

NAME = "joints_off_written_range"
BEYOND = 1.001
"""Shows in the strip of problems, and leaves the first place there to whatever is beyond a limit of the robot itself."""
_MOST_NAMED = 3
"""So many exchanges are named; whoever mixed up more knows by then."""


def check_written_range(trajectory: JointTrajectory, thresholds: Thresholds) -> tuple[list[Check], dict[str, Array]]:
    """(the check of how many joints leave their written range, series["problem/<joint>"] (T,) of those, a little above 1 while they are out).

    A clip of as many frames as were written has to cover the ranges, too; one of another length may be a part, and only has to stay inside.
    Files in single precision may be a rounding off. The joint that is furthest outside is named, with the first time it is; joints of a
    whole clip that do what another was written with are named as swapped.
    """
    try:
        written = JointRanges.from_provenance(trajectory.provenance)
    except InvalidDataError as error:
        return [thresholds.check(NAME, None, str(error))], {}
    if written is None:
        return [thresholds.check(NAME, None, "the file doesn't keep the ranges that its joints were written with")], {}
    names = [name for name in trajectory.joint_names if name in written.joint_names]
    if not names:
        return [thresholds.check(NAME, None, "the ranges that the file keeps are of other joints")], {}
    position = trajectory.position
    if len(names) < len(trajectory.joint_names):
        position = position[:, [trajectory.joint_names.index(name) for name in names]]
    rows = [written.joint_names.index(name) for name in names]
    found, whole = JointRanges.of(names, position), trajectory.frames == written.frames
    bounds = np.stack([written.lower[rows], written.upper[rows]], axis=1)
    covered = np.stack([found.lower, found.upper], axis=1)
    rounding = position_rounding(position)
    far, off = Signal(0.0), np.zeros(len(names), bool)
    for part in frame_chunks(trajectory.frames):
        outside = beyond(position[part], bounds[:, 0], bounds[:, 1], rounding)
        off |= np.any(outside > 0, axis=0)
        far = larger(far, worst(outside, trajectory.time, names, part.start))
    # A bound that single precision moves over a step is rounded outward to the next one.
    tolerance = rounding + (1 / STEPS_A_UNIT if rounding > 1e-8 else 0.0)
    differs = np.abs(covered - bounds).max(axis=1)
    same = _same(found.crc, [written.crc[row] for row in rows], covered, bounds, tolerance)
    if whole:
        off = off | (differs > tolerance) | ~np.diag(same)
    if not off.any():
        return [thresholds.check(NAME, 0.0)], {}
    out = {i: beyond(position[:, i], bounds[i, 0], bounds[i, 1], rounding) > 0 for i in np.flatnonzero(off)}
    joint = far.index[1] if far.index else int(np.argmax(np.where(off, differs, -1.0)))
    begins = out[joint]
    if whole and not begins.any() and (others := np.flatnonzero(same[joint] & off)).size:
        begins = position[:, joint] != position[:, others[0]]  # within the range, but at another time
    first = np.flatnonzero(begins)
    check = thresholds.check(
        NAME,
        float(off.sum()),
        "; ".join(
            [
                *(_exchanged(names, off, same) if whole else []),
                f"{_words(covered[joint])} there, written with {_words(bounds[joint])}",
            ]
        ),
        where=names[joint],
        time_s=float(trajectory.time[first[0]]) if len(first) else None,
    )
    return [check], {f"problem/{names[i]}": np.where(when, BEYOND, 0.0) for i, when in out.items()}


def _same(
    found_crc: tuple[int, ...], written_crc: list[int], covered: Array, bounds: Array, tolerance: float
) -> BoolArray:
    """(n, n): whether joint i does what joint j was written with: the very values where there are such a j, else within the same range."""
    exactly = np.array(found_crc)[:, None] == np.array(written_crc)[None, :]
    alike = (np.abs(covered[:, None] - bounds[None, :]) <= tolerance).all(axis=2)
    return np.where(exactly.any(axis=1, keepdims=True), exactly, alike)


def _exchanged(names: list[str], off: BoolArray, same: BoolArray) -> list[str]:
    """Which joints that are `off` (n,) do what another of them was written with: pairs first, then one-sided ones."""
    same = same & off[:, None] & off[None, :]
    taken: set[int] = set()
    lines = []
    for one, other in np.argwhere(np.triu(same & same.T, 1)).tolist():
        if not {one, other} & taken:
            taken |= {one, other}
            lines.append(f"{names[one]} and {names[other]} look swapped")
    for one, row in enumerate(same):
        if row.any() and one not in taken:
            lines.append(f"{names[one]} does what {names[int(np.argmax(row))]} was written to do")
    more = len(lines) - _MOST_NAMED
    return lines if more <= 0 else [*lines[:_MOST_NAMED], f"and {more} more"]


def _words(bounds: Array) -> str:
    return f"{bounds[0]:.4f} to {bounds[1]:.4f}"
