"""Where windows of a clip that were solved one by one meet: no step in the motion, no limit broken.

Both windows have solved the frames behind a seam, mostly to the same: where what comes before or after decided otherwise, the earlier solution
fades into the later one. Position limits and coupled rows are convex, so they hold in between; a step that is quicker than the joints
may be is shortened as a whole, which is between two such postures, too, and what is missing is made up for by the steps after it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from retarget.core import rotations
from retarget.core.timebase import CLOCK_SLACK_S, minimum_jerk
from retarget.core.types import Array


@dataclass(frozen=True, eq=False)
class Solved:
    """time (T,) s, joints (T, n) rad and base_orientation (T, 4) wxyz, None where the base doesn't move, of the frames of a window."""

    time: Array
    joints: Array
    base_orientation: Array | None

    def at(self, time_s: float) -> tuple[Array, Array | None]:
        """Joints (n,) and base orientation (4,) of the frame at `time_s`, or of the last one before."""
        k = max(int(np.searchsorted(self.time, time_s + CLOCK_SLACK_S, side="right")) - 1, 0)
        return self.joints[k], None if self.base_orientation is None else self.base_orientation[k]


def faded(before: Solved, after: Solved, seam_s: float, fade_s: float) -> tuple[Solved, float]:
    """`after` with the frames up to `seam_s` as in `before`, and those of the `fade_s` behind it in between; and how far (rad) the two
    were apart there at most.

    The first frame behind the seam still is that of `before`, so that what was said of the step to it holds.
    """
    k = np.searchsorted(before.time, after.time - CLOCK_SLACK_S)
    k = np.minimum(k, len(before.time) - 1)
    shared = np.abs(before.time[k] - after.time) <= CLOCK_SLACK_S
    behind = after.time > seam_s + CLOCK_SLACK_S
    if not (shared & behind).any():
        share = behind.astype(float)
    else:
        first, last = after.time[behind][0], after.time[shared][-1]
        share = minimum_jerk((after.time - first) / max(min(fade_s, float(last - first)), CLOCK_SLACK_S))
    share[~shared] = 1.0
    mixed = np.flatnonzero(share < 1.0)
    of_before, weight = k[mixed], share[mixed]
    apart = after.joints[mixed] - before.joints[of_before]
    joints = after.joints.copy()
    joints[mixed] = before.joints[of_before] + weight[:, None] * apart
    base = after.base_orientation
    if base is not None and before.base_orientation is not None:
        base = base.copy()
        base[mixed] = rotations.slerp(before.base_orientation[of_before], base[mixed], weight)
        base = rotations.make_continuous(base)
    seam = np.abs(apart[behind[mixed]]).max(initial=0.0)
    return Solved(after.time, joints, base), float(seam)


def within_speed(solved: Solved, seam_s: float, speed: Array) -> tuple[Solved, int]:
    """`solved` with its steps behind `seam_s` shortened to what `speed` (n,) rad/s allows; how many that were."""
    joints, step_s = solved.joints, np.diff(solved.time)
    allowed = speed * step_s[:, None]
    too_fast = (np.abs(np.diff(joints, axis=0)) > allowed * (1.0 + 1e-12)).any(axis=1)  # sums round
    too_fast &= solved.time[1:] > seam_s + CLOCK_SLACK_S
    if not too_fast.any():
        return solved, 0
    joints = joints.copy()
    shortened = 0
    for k in range(int(np.argmax(too_fast)), len(step_s)):
        step = joints[k + 1] - joints[k]
        excess = float(np.max(np.abs(step) / allowed[k], initial=0.0))
        if excess > 1.0 + 1e-12:
            joints[k + 1] = joints[k] + step / excess
            shortened += 1
    return Solved(solved.time, joints, solved.base_orientation), shortened
