"""Rounding off: kinks that the robot's limits put into a motion are averaged out over less than a tenth of a second, without lag.

Where a limit engages or lets go, the exact answer changes its speed within a frame; a person does not. Frames are compared with the person's own
quickness, so that what the person did abruptly (a heel strike) stays as it was. All joints of a frame are averaged by the same share, so that
position limits and coupled rows, being convex, hold as before; speed limits are checked.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from retarget.core.solve.problem import OrientationProblem
from retarget.core.timebase import smooth
from retarget.core.types import Array

CHUNK = 4096
"""Frames computed together."""


@dataclass(frozen=True)
class RoundingOptions:
    """kink_rad_s: change of speed from frame to frame, beyond the person's own, that counts half. own_factor: how much quicker than the
    person's own change of speed is still no kink. window_s: half-width of the average. reach_s: of the time around a kink that is averaged.
    gain: how many times the average presence of kinks in that time is the share that the average gets; small, so that what differs by
    rounding in two files differs by rounding after."""

    kink_rad_s: float = 0.2
    own_factor: float = 1.5
    window_s: float = 0.07
    reach_s: float = 0.15
    gain: float = 4.0


def rounded_off(problem: OrientationProblem, joints: Array, options: RoundingOptions | None = None) -> Array:
    """`joints` (T, n) rad with their kinks averaged out; every limit and coupled row that held before holds after."""
    options = options or RoundingOptions()
    if len(joints) < 5:
        return joints
    share = kinks(problem, joints, options)
    average = smooth(problem.time, joints, options.window_s, ends="hold")
    allowed = problem.velocity * np.diff(problem.time)[:, None]
    for _ in range(6):
        rounded = np.clip(joints + share[:, None] * (average - joints), problem.lower, problem.upper)
        if (np.abs(np.diff(rounded, axis=0)) <= allowed).all():
            return np.asarray(rounded)
        share = 0.5 * share
    return joints


def kinks(problem: OrientationProblem, joints: Array, options: RoundingOptions) -> Array:
    """(T,) in [0, 1]: the share of the average that each frame takes; 0 where nothing kinks for `reach_s` around."""
    step_s = float(problem.time[-1] - problem.time[0]) / (len(joints) - 1)
    change = np.abs(np.diff(joints, n=3, axis=0)).max(axis=1) / step_s
    excess = np.maximum(change - options.own_factor * own_changes(problem) / step_s, 0.0)
    amount = excess**2 / (excess**2 + options.kink_rad_s**2)
    at_frame = np.zeros(len(joints))  # a third difference belongs to the two frames in its middle
    at_frame[1:-2] = amount
    at_frame[2:-1] = np.maximum(at_frame[2:-1], amount)
    return np.clip(options.gain * smooth(problem.time, at_frame, options.reach_s, ends="hold"), 0.0, 1.0)


def own_changes(problem: OrientationProblem) -> Array:
    """(T - 3,) rad: largest third difference of the targets' own turning, the person's quickness."""
    frames = len(problem.time)
    turning = np.empty((frames - 1, len(problem.joint_ids), 3))
    for start in range(0, frames - 1, CHUNK):
        part = slice(start, min(start + CHUNK, frames - 1))
        desired = problem.desired[part.start : part.stop + 1]
        turn = np.matmul(desired[1:], desired[:-1].swapaxes(-1, -2))
        for axis, (i, j) in enumerate(((2, 1), (0, 2), (1, 0))):
            turning[part, :, axis] = 0.5 * (turn[..., i, j] - turn[..., j, i])
    return np.asarray(np.linalg.norm(np.diff(turning, n=2, axis=0), axis=-1).max(axis=1))
