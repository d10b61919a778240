"""A whole clip by the solver that suits its targets: what `core.pipeline` does between mapping and base motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from retarget.core import rotations, timebase
from retarget.core.robot_model import RobotModel
from retarget.core.solve.calm import calmed
from retarget.core.solve.dynamical import DynamicalOptions, Solution
from retarget.core.solve.dynamical import solve as solve_dynamical
from retarget.core.solve.hierarchical import HierarchicalOptions, HierarchicalSolution
from retarget.core.solve.hierarchical import solve as solve_hierarchical
from retarget.core.solve.newton import NewtonOptions
from retarget.core.solve.problem import VELOCITY_MARGIN, coupled_rows, orientation_problem
from retarget.core.solve.rounding import rounded_off
from retarget.core.types import Array, Targets

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class ClipSolution:
    """solution: frame by frame. facts: how it was found, JSON-able, for the trajectory's provenance."""

    solution: Solution
    facts: dict[str, Any]


def by_one_qp_a_frame(
    targets: Targets,
    model: RobotModel,
    *,
    free_base: bool,
    online: bool,
    kernel: str,
    progress: Progress | None,
    start: tuple[Array, Array | None] | None = None,
) -> ClipSolution:
    """Dynamical inverse kinematics, offline calmed and rounded off. Online there is neither: what comes later is not known yet.

    start: where the first frame is solved from, as `dynamical.solve` says.
    """
    problem = orientation_problem(targets, model, free_base=free_base)
    newton = NewtonOptions(posture_weight=model.profile.posture_weight)
    how = DynamicalOptions(online=online, kernel=kernel, newton=newton)
    solution, passes = solve_dynamical(problem, how, progress, start), 0
    if not online:
        solution, passes = calmed(problem, solution, lambda again: solve_dynamical(again, how, progress, start))
        solution = replace(solution, joints=rounded_off(problem, solution.joints))
    return ClipSolution(
        solution,
        {
            "name": "dynamical",
            "start": solution.start,
            "qps": int(solution.iterations.sum()),
            "qp_fallbacks": solution.fallbacks,
            "unconverged_frames": solution.unconverged,
            "calm_passes": passes,
        },
    )


def by_strict_priorities(
    targets: Targets, model: RobotModel, *, kernel: str, progress: Progress | None
) -> ClipSolution:
    """Hierarchical inverse kinematics; the base stands still."""
    solution = solve_hierarchical(targets, model, HierarchicalOptions(kernel=kernel), progress)
    return ClipSolution(
        solution,
        {
            "name": "hierarchical",
            "qps": int(solution.iterations.sum()),
            "control_steps": solution.control_steps,
            "first_frame_steps": solution.first_steps,
            "unconverged_frames": solution.unconverged,
            "failed_levels": solution.failed_levels,
            "slowed_frames": solution.slowed_frames,
            "frames_without_freedom": dict(
                zip((str(n) for n in solution.levels), solution.levels_without_freedom, strict=True)
            ),
        },
    )


def smoothed(time_s: Array, solution: Solution, window_s: float, model: RobotModel) -> Solution:
    """Averages of neighbouring frames: joint limits, coupled rows and speed limits are convex, so what held for each holds for these.

    Beyond the clip's ends the motion is thought to go on as it came, unless that would leave a limit: then to stand still.
    """
    joints = _averaged(time_s, solution.joints, window_s, "reflect")
    rows = coupled_rows(model)
    inside = (joints >= model.lower - 1e-12).all() and (joints <= model.upper + 1e-12).all()
    if rows is not None:
        value = joints @ rows[0].T
        inside = inside and (value >= rows[1]).all() and (value <= rows[2]).all()
    if not inside:
        joints = _averaged(time_s, solution.joints, window_s, "hold")
    joints = joints.clip(model.lower, model.upper)
    base = solution.base_orientation
    turned = None if base is None else rotations.normalize(timebase.smooth(time_s, base, window_s))
    return replace(solution, joints=joints, base_orientation=turned)


def _averaged(time_s: Array, joints: Array, window_s: float, ends: Literal["reflect", "hold"]) -> Array:
    """`timebase.smooth` for joints (T, n), on equal steps where those of `time_s` (T,) are not.

    A short step's speed limit does not hold for the average of the longer ones around it. The straight lines between frames keep all limits,
    and so do samples of these, their averages, and samples of the lines between those.
    """
    steps = np.diff(time_s)
    if not len(steps) or np.abs(steps / steps.mean() - 1.0).max() <= VELOCITY_MARGIN / 2:
        return timebase.smooth(time_s, joints, window_s, ends=ends)
    since = (
        time_s - time_s[0]
    )  # on a clock that counts from 1970 equal steps are none: its digits end at a quarter of a microsecond
    even = np.linspace(0.0, since[-1], len(since))
    smooth = timebase.smooth(even, _on_lines(even, since, joints), window_s, ends=ends)
    return _on_lines(since, even, smooth)


def _on_lines(at: Array, time_s: Array, joints: Array) -> Array:
    """Joints (T, n) at `time_s`, linearly interpolated to the times `at` (K,)."""
    return np.stack([np.interp(at, time_s, column) for column in joints.T], axis=1)


def trimmed(solution: Solution, window: slice) -> Solution:
    """The frames of `window`."""
    base = solution.base_orientation
    part: Solution = replace(
        solution,
        joints=solution.joints[window],
        base_orientation=None if base is None else base[window],
        status=solution.status[window],
        iterations=solution.iterations[window],
    )
    if isinstance(part, HierarchicalSolution):
        part = replace(part, level_residual=part.level_residual[window])
    return part
