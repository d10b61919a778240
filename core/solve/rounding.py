"""Rounding off: kinks that the robot's limits put into a motion are averaged out over less than a tenth of a second, without lag.

Where a limit engages or lets go, the exact answer changes its speed within a frame; a person does not. A joint's distance from its own short
average tells a kink, compared with the person's own, so that what the person did abruptly (a heel strike) stays as it was. All
joints of a frame are averaged by the same share, so that position limits and coupled rows, being convex, hold as before. Where a step would
become too fast, because the share changes there, nothing is averaged.
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
    """kink_rad: distance from the own average, beyond the person's own, that counts half. window_s: half-width of the average.

    own_factor: how much further from its average than the quickest of the segments a joint may be: it turns two of them against each other.
    reach_s: of the time around a kink that is averaged. gain: how many times the average presence of kinks in that time is the share
    that the average gets; small, so that what differs by rounding in two files differs by rounding after.
    """

    kink_rad: float = 0.0015
    own_factor: float = 1.5
    window_s: float = 0.07
    reach_s: float = 0.15
    gain: float = 5.0


def rounded_off(problem: OrientationProblem, joints: Array, options: RoundingOptions | None = None) -> Array:
    """`joints` (T, n) rad with their kinks averaged out; every limit and coupled row that held before holds after."""
    options = options or RoundingOptions()
    if len(joints) < 5:
        return joints
    average = smooth(problem.time, joints, options.window_s, ends="hold")
    share = kinks(problem, joints, average, options)
    allowed = problem.velocity * np.diff(problem.time)[:, None] * (1.0 + 1e-12)  # sums round
    for _ in range(4):
        rounded = np.clip(joints + share[:, None] * (average - joints), problem.lower, problem.upper)
        too_fast = (np.abs(np.diff(rounded, axis=0)) > allowed).any(axis=1)
        if not too_fast.any():
            return np.asarray(rounded)
        # None around these steps, and from there on a share that grows over the same time.
        at_frame = (np.append(too_fast, False) | np.append(False, too_fast)).astype(float)
        clear = smooth(problem.time, at_frame, 2.0 * options.reach_s, ends="hold") == 0.0
        share = np.minimum(share, smooth(problem.time, np.where(clear, share, 0.0), options.reach_s, ends="hold"))
    return joints


def kinks(problem: OrientationProblem, joints: Array, average: Array, options: RoundingOptions) -> Array:
    """(T,) in [0, 1]: the share of `average` (T, n) that each frame takes; 0 where nothing kinks for `reach_s` around."""
    own = options.own_factor * own_kinks(problem, options.window_s)
    excess = np.maximum(np.abs(joints - average).max(axis=1) - own, 0.0)
    amount = excess**2 / (excess**2 + options.kink_rad**2)
    return np.clip(options.gain * smooth(problem.time, amount, options.reach_s, ends="hold"), 0.0, 1.0)


def own_kinks(problem: OrientationProblem, window_s: float) -> Array:
    """(T,) rad: the largest distance of a target's own turning from its average over ± `window_s`, the person's quickness."""
    frames = len(problem.time)
    turned = np.zeros((frames, len(problem.joint_ids), 3))
    for start in range(0, frames - 1, CHUNK):
        stop = min(start + CHUNK, frames - 1)
        desired = problem.desired[start : stop + 1]
        turn = np.matmul(desired[1:], desired[:-1].swapaxes(-1, -2))
        for axis, (i, j) in enumerate(((2, 1), (0, 2), (1, 0))):
            turned[start + 1 : stop + 1, :, axis] = 0.5 * (turn[..., i, j] - turn[..., j, i])
    flat = np.cumsum(turned, axis=0, out=turned).reshape(frames, -1)
    away = flat - smooth(problem.time, flat, window_s, ends="hold")
    return np.asarray(np.linalg.norm(away.reshape(turned.shape), axis=-1).max(axis=1))
