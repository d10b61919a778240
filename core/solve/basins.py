"""Out of a worse basin: where the followed path is clearly costlier than a fresh start would be, it changes over to what the start found.

Frames follow one another, so a path that once went left around a shoulder's singularity stays left until a limit stops it. At a few
frames a second a handful of starts is converged as for a first frame; if the best is clearly cheaper than the path, and not
only because the path lags behind at its speed limits, it is followed forward and backward as far as it is the cheaper one. The path
then changes over to it where the two are nearest and, where they don't meet, over a time long enough for the speed limits. What
does not pay, the cost of the change-over included, is left alone.

Frames are chosen and starts drawn by the clock of the recording, so that a part of a clip is treated like the whole.
"""

from __future__ import annotations

from dataclasses import fields
from itertools import islice

import numpy as np
from numpy.typing import NDArray
from retarget.core import rotations
from retarget.core.errors import SolverError
from retarget.core.solve.newton import Converged, FrameSolver, Path
from retarget.core.solve.problem import OrientationProblem
from retarget.core.solve.starts import best_start, postures
from retarget.core.timebase import minimum_jerk
from retarget.core.types import Array

EVERY_S = 0.5
STARTS, STARTS_WHERE_GOOD = 6, 1
GOOD_COST = 3e-3
"""Tasks that cost less than this are off by a few degrees in all: one start is enough to look for better."""

CLEARLY_CHEAPER = 0.02
SHORTEST_S, LONGEST_S = 0.2, 2.0
"""Of a change-over."""

SAME_RAD = 1e-6
PART_OF_SPEED = 0.5
"""The part of the speed limit that a change-over may add to the motion."""


def leave_worse_basins(solver: FrameSolver, path: Path) -> int:
    """Improve `path`, all of whose frames are solved, in place; the number of stretches that were exchanged."""
    exchanged = 0
    for k in frames_to_look_at(solver.problem.time):
        found = _better(solver, path, k)
        if found is not None:
            exchanged += _exchange(solver, path, k, found)
    return exchanged


def frames_to_look_at(time: Array) -> NDArray[np.intp]:
    """The first frame at or after every multiple of `EVERY_S` on the recording's clock."""
    number = np.floor(time / EVERY_S + 1e-6)
    return np.flatnonzero(np.diff(number, prepend=number[0] - 1.0) > 0)


def _better(solver: FrameSolver, path: Path, k: int) -> Converged | None:
    """What a fresh start finds at frame k, if that is clearly cheaper than what the path would find, given the time to get there."""
    problem = solver.problem
    try:
        own = solver.converge(k, path.q[k], problem.lower, problem.upper)
        away = own.q[-len(problem.lower) :] - problem.reference
        of_tasks = own.cost - 0.5 * solver.options.posture_weight * float(away @ away)
        seed = int(abs(np.floor(problem.time[k] / EVERY_S + 1e-6)))
        starts = islice(postures(problem, seed), STARTS if of_tasks > GOOD_COST else STARTS_WHERE_GOOD)
        _, found = best_start(solver, k, starts)
    except SolverError:
        return None
    return found if found.cost < own.cost * (1.0 - CLEARLY_CHEAPER) else None


def _exchange(solver: FrameSolver, path: Path, k: int, found: Converged) -> bool:
    """Change `path` over to the branch through `found` around frame k and back; False, and nothing done, where that does not pay."""
    time, end = solver.problem.time, len(path.q) - 1
    branch = Path.empty(len(path.q), path.q.shape[1])
    branch.put(k, found)
    first, last = solver.follow(branch, k, 0, path.cost), solver.follow(branch, k, end, path.cost)
    share = np.ones(len(time))
    if first > 0:
        share *= _rise(solver.problem, path, branch, np.arange(first, k + 1))
    if last < end:
        share *= _rise(solver.problem, path, branch, np.arange(last, k - 1, -1))
    touched = np.flatnonzero(share)
    if not len(touched) or share[k] < 1.0:  # the change-overs take longer than the branch is worth
        return False
    # A change-over may reach beyond the frames where the branch is the cheaper one.
    for begin, outermost in ((first, touched[0]), (last, touched[-1])):
        if (outermost - begin) * (begin - k) > 0 or begin == k != outermost:
            solver.follow(branch, begin, int(outermost))
    mixed = _mixed(solver, path, branch, share, touched)
    if mixed.cost[touched].sum() >= path.cost[touched].sum() or not _speed_holds(solver, mixed, time):
        return False
    for name in ("q", "cost", "iterations", "status", "unconverged"):
        getattr(path, name)[touched] = getattr(mixed, name)[touched]
    return True


def _rise(problem: OrientationProblem, path: Path, branch: Path, frames: NDArray[np.intp]) -> Array:
    """(T,) from 0 to 1 in the direction of `frames`, around the one of them on which path and branch are nearest: a minimum-jerk change-over.

    Its time keeps every joint's additional speed, at most 15/8 of the mean, to `PART_OF_SPEED` of its limit. All zero when that takes too long.
    """
    time, n = problem.time, len(problem.lower)
    apart = np.abs(branch.q[frames, -n:] - path.q[frames, -n:])
    distance = apart.max(axis=1)
    nearest = int(np.argmax(distance <= 1.1 * distance.min()))  # the outermost that is about as near as any
    centre, towards = time[frames[nearest]], np.sign(frames[-1] - frames[0]) or 1
    if apart[nearest].max() < SAME_RAD:
        return np.where(towards * (time - centre) >= 0.0, 1.0, 0.0)
    lasts = max(SHORTEST_S, float(np.max(15 / 8 * apart[nearest] / (PART_OF_SPEED * problem.velocity))))
    if lasts > LONGEST_S:
        return np.zeros(len(time))
    return minimum_jerk(0.5 + towards * (time - centre) / lasts)


def _mixed(solver: FrameSolver, path: Path, branch: Path, share: Array, touched: NDArray[np.intp]) -> Path:
    """A copy of `path` with `share` (T,) of the branch. Position limits and coupled rows hold in between: they are convex."""
    mixed = Path(*(np.array(getattr(path, field.name)) for field in fields(path)))
    n = len(solver.problem.lower)
    for k in touched:
        if share[k] == 1.0:
            for field in fields(path):
                getattr(mixed, field.name)[k] = getattr(branch, field.name)[k]
            continue
        mixed.q[k, -n:] = path.q[k, -n:] + share[k] * (branch.q[k, -n:] - path.q[k, -n:])
        if path.q.shape[1] > n:
            here, there = (np.roll(p.q[k, 3:7], 1) for p in (path, branch))
            mixed.q[k, 3:7] = np.roll(rotations.slerp(here, there, share[k]), -1)
        mixed.cost[k] = solver.cost(k, mixed.q[k])
    return mixed


def _speed_holds(solver: FrameSolver, mixed: Path, time: Array) -> bool:
    joints = mixed.q[:, -len(solver.problem.lower) :]
    return bool(
        (np.abs(np.diff(joints, axis=0)) <= solver.problem.velocity * np.diff(time)[:, None] * (1 + 1e-9)).all()
    )
