"""Calming: joints that would run at their speed limit are held to their own average over time, and the clip is solved again.

Near a singular posture (an arm that hangs along a shoulder axis), and where a person is quicker than a joint can be, the exact answer of every
single frame asks for speeds the robot does not have. Limits then hold only because the joint lags behind, at full speed, which wears it
out and helps nobody: the frames it misses are random. Such a joint is pulled, around that time only, to its own zero-lag average; the other
joints make up for it as well as they can. What was within the robot's reach stays exact.

How fast a joint runs is judged over a fifth of a second and answered gradually: judged step by step, two files of one recording that differ
by rounding alone would be held differently, and come out ten times further apart than they went in.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from retarget.core.solve.dynamical import Solution
from retarget.core.solve.problem import OrientationProblem
from retarget.core.timebase import smooth
from retarget.core.types import Array


@dataclass(frozen=True)
class CalmOptions:
    """window_s: half-width of the averages, and of the time held around a spot. stiffness: of the first hold, beside task weights of about 1;
    every further pass over the same spot takes up to `factor` times more, at most `passes` times.

    full_speed: part of the speed limit from which running counts, fully at the limit. speed_window_s: half-width of the time over which it
    is judged. gain: how many times the average of running over `window_s` is the share of a hold.
    """

    window_s: float = 0.6
    stiffness: float = 0.03
    factor: float = 4.0
    passes: int = 10
    full_speed: float = 0.7
    speed_window_s: float = 0.15
    gain: float = 12.0


def calmed(
    problem: OrientationProblem,
    solution: Solution,
    solve: Callable[[OrientationProblem], Solution],
    options: CalmOptions | None = None,
) -> tuple[Solution, int]:
    """`solution` of `problem` brought off the speed limits, and the passes that took; the same object and 0 when nothing was wrong.

    `solve` is called with every new problem. Only what is at a limit is touched, so passes that one part of a clip needs leave
    the others as they are.
    """
    options = options or CalmOptions()
    stiffness, posture = np.zeros(solution.joints.shape), solution.joints.copy()
    for number in range(options.passes):
        rushed = rush(problem, solution.joints, options)
        which = np.flatnonzero(rushed.any(axis=0))
        if not len(which):
            return solution, number
        around = np.clip(options.gain * smooth(problem.time, rushed[:, which], options.window_s, ends="hold"), 0.0, 1.0)
        before = stiffness[:, which]
        stiffer = before * (1.0 + (options.factor - 1.0) * around)
        stiffness[:, which] = np.maximum(before, np.maximum(options.stiffness * around, stiffer))
        average = smooth(problem.time, solution.joints[:, which], options.window_s)
        posture[:, which] += around * (average - posture[:, which])
        solution = solve(replace(problem, hold=(stiffness.copy(), posture.copy())))
    return solution, options.passes


def rush(problem: OrientationProblem, joints: Array, options: CalmOptions) -> Array:
    """(T, n) in [0, 1]: 1 where a joint runs at its speed limit for `speed_window_s` around, 0 below `full_speed` of it.

    The fourth-power mean of the steps' speeds: short bursts count, yet no single step decides.
    """
    if len(joints) < 2:
        return np.zeros(joints.shape)
    rushed = np.zeros(joints.shape)
    ratio = np.diff(joints, axis=0)
    ratio /= np.diff(problem.time)[:, None] * problem.velocity
    which = np.flatnonzero(
        np.maximum(ratio.max(axis=0), -ratio.min(axis=0)) > options.full_speed
    )  # else no mean is above it
    if len(which):
        steps = ratio[:, which] ** 4
        at_frame = np.concatenate([steps[:1], 0.5 * (steps[1:] + steps[:-1]), steps[-1:]])
        speed = smooth(problem.time, at_frame, options.speed_window_s, ends="hold") ** 0.25
        part = np.clip((speed - options.full_speed) / (1.0 - options.full_speed), 0.0, 1.0)
        rushed[:, which] = part * part * (3.0 - 2.0 * part)
    return rushed
