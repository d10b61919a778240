"""Calming: joints that would run at their speed limit are held to their own average over time, and the clip is solved again.

Near a singular posture (an arm that hangs along a shoulder axis), and where a person is quicker than a joint can be, the exact answer of every
single frame asks for speeds the robot does not have. Limits then hold only because the joint lags behind, at full speed, which wears it
out and helps nobody: the frames it misses are random. Such a joint is pulled, around that time only, to its own zero-lag average; the other
joints make up for it as well as they can. What was within the robot's reach stays exact.
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
    every further pass over the same spot takes `factor` times more, at most `passes` times. full_speed: part of the speed limit from which a
    step counts (fully at 1)."""

    window_s: float = 0.5
    stiffness: float = 0.03
    factor: float = 4.0
    passes: int = 10
    full_speed: float = 0.85


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
        rushed = rush(problem, solution.joints, options.full_speed)
        which = np.flatnonzero(rushed.any(axis=0))
        if not len(which):
            return solution, number
        # One frame in twenty at the limit is enough to hold fully: the average of a 0/1 signal counts them.
        around = np.clip(20.0 * smooth(problem.time, rushed[:, which], options.window_s, ends="hold"), 0.0, 1.0)
        before = stiffness[:, which]
        stiffer = before * (1.0 + (options.factor - 1.0) * around)
        stiffness[:, which] = np.maximum(before, np.maximum(options.stiffness * around, stiffer))
        average = smooth(problem.time, solution.joints[:, which], options.window_s)
        posture[:, which] += around * (average - posture[:, which])
        solution = solve(replace(problem, hold=(stiffness.copy(), posture.copy())))
    return solution, options.passes


def rush(problem: OrientationProblem, joints: Array, full_speed: float) -> Array:
    """(T, n) in [0, 1]: 1 where a step to or from the frame is at the joint's speed limit, 0 below `full_speed` of it."""
    rushed = np.zeros(joints.shape)
    if len(joints) < 2:
        return rushed
    steps = np.abs(np.diff(joints, axis=0)) / np.diff(problem.time)[:, None] / problem.velocity
    fast = np.clip((steps - full_speed) / (1.0 - full_speed), 0.0, 1.0)
    rushed[1:] = fast
    rushed[:-1] = np.maximum(rushed[:-1], fast)
    return rushed
