"""Dynamical inverse kinematics [Darvish2019 eqs 3–5]: follow every link's orientation, one box QP a step.

Offline (default) every frame is iterated to convergence (`newton`), starting from a converged first frame: no lag, and no memory of how
the frame was reached. Online keeps the paper's one QP per frame in velocities, ω* + K e desired, λ ‖ν‖² as regularisation, limits
fading out by tanh.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import islice

import numpy as np
from numpy.typing import NDArray
from retarget.core import rotations
from retarget.core.solve.basins import leave_worse_basins
from retarget.core.solve.kernel_choice import chosen
from retarget.core.solve.limits import nearest_feasible
from retarget.core.solve.newton import Converged, FrameSolver, NewtonOptions, Path
from retarget.core.solve.online import OnlineOptions, OnlineSolver
from retarget.core.solve.problem import OrientationProblem
from retarget.core.solve.starts import best_start, postures
from retarget.core.types import Array

Progress = Callable[[int, int], None]

CHUNK = 256
"""Frames between two calls of the progress function."""

COMPILED_FRAMES, UNKEPT_FRAMES = 10_000, 150_000
"""Clips from which the compiled kernel pays: it takes 1 s to load, and some 15 s to compile the first time, or, where no folder can be
written to that would keep it, every time; a frame costs 0.02 ms with it and 0.15 ms without."""


@dataclass(frozen=True)
class DynamicalOptions:
    """online: one QP per frame, with its own options; else frames are converged as `newton` says. starts: tried for the first frame.

    kernel: "compiled" (numba), "numpy", or "auto", compiled if that is there and the clip long enough. Both give the same
    answers to 1e-9 rad; online is always NumPy.
    """

    online: bool = False
    kernel: str = "auto"
    newton: NewtonOptions = field(default_factory=NewtonOptions)
    one_step: OnlineOptions = field(default_factory=OnlineOptions)
    starts: int = 16


@dataclass(frozen=True)
class Solution:
    """joints (T, n) rad; base_orientation (T, 4) wxyz world ← base link, or None; status (T,); iterations (T,) QPs per frame.

    start: which of the first frame's starts was the best (0 = the reference posture). fallbacks: QPs solved by the fallback solver.
    unconverged: frames on which the iterations ran out. exchanged: stretches that a better basin replaced (`basins`).
    """

    joints: Array
    base_orientation: Array | None
    status: NDArray[np.int8]
    iterations: NDArray[np.int64]
    start: int
    fallbacks: int
    unconverged: int = 0
    exchanged: int = 0


def solve(
    problem: OrientationProblem,
    options: DynamicalOptions,
    progress: Progress | None = None,
    start: tuple[Array, Array | None] | None = None,
) -> Solution:
    """Joint motion that follows the problem's targets inside all limits.

    start: joints (n,) rad and base orientation (4,) wxyz, or None where it doesn't move, from which the first frame is solved instead of from
    `options.starts` postures: that of a clip that goes on.
    Frames on which the QP fails hold the last good posture and are marked in `status`. Raises `SolverError` for input that is not
    finite and when the first frame can't be solved from any start, `UsageError` for a compiled kernel that is not installed.
    """
    problem.check_finite()
    solver = _frame_solver(problem, options)
    frames, n = len(problem.time), len(problem.lower)
    number, first = _first_frame(solver, options, start)
    path = Path.empty(frames, len(first.q))
    path.put(0, first)
    follow = OnlineSolver(problem, options.one_step).follow if options.online else solver.follow
    for begin in range(0, frames - 1, CHUNK):
        end = min(begin + CHUNK, frames - 1)
        follow(path, begin, end)
        if progress is not None:
            progress(end + 1, frames)
    exchanged = 0 if options.online else leave_worse_basins(solver, path)
    orientation = rotations.make_continuous(np.roll(path.q[:, 3:7], 1, axis=1)) if problem.base_columns else None
    return Solution(
        joints=path.q[:, -n:].copy(),
        base_orientation=orientation,
        status=path.status,
        iterations=path.iterations,
        start=number,
        fallbacks=solver.qp.fallbacks,
        unconverged=int(path.unconverged.sum()),
        exchanged=exchanged,
    )


def _first_frame(
    solver: FrameSolver, options: DynamicalOptions, start: tuple[Array, Array | None] | None
) -> tuple[int, Converged]:
    """Which start it was, and the frame."""
    problem = solver.problem
    if start is None:
        return best_start(solver, 0, islice(postures(problem, 0), options.starts))
    joints = nearest_feasible(start[0], problem.lower, problem.upper, problem.coupled)
    return 0, solver.converge(0, problem.model.configuration(joints, start[1]), problem.lower, problem.upper)


def _frame_solver(problem: OrientationProblem, options: DynamicalOptions) -> FrameSolver:
    def compiled() -> type[FrameSolver]:
        from retarget.core.solve.compiled import CompiledSolver

        return CompiledSolver

    kernel = "numpy" if options.online else options.kernel
    solver = chosen(kernel, FrameSolver, compiled, len(problem.time), COMPILED_FRAMES, UNKEPT_FRAMES)
    return solver(problem, options.newton)
