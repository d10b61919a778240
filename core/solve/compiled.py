"""`FrameSolver` that follows a clip in compiled code (`kernel`), the same answers, several times as fast.

Frames that the kernel does not handle are solved by the NumPy solver, and the kernel goes on after them. Single frames, and with them all
decisions between starts and basins, are the NumPy solver's.
"""

from __future__ import annotations

import numpy as np
from retarget.core import rotations
from retarget.core.kinematics import axis_frames
from retarget.core.solve import kernel
from retarget.core.solve.newton import FrameSolver, NewtonOptions, Path
from retarget.core.solve.problem import OrientationProblem
from retarget.core.types import FRAME_OK, Array

TOUCH_RAD = 1e-5
"""Frames that come nearer than this to a coupled row's bound are the NumPy solver's."""


class CompiledSolver(FrameSolver):
    """`FrameSolver` on the robot's tree. handed_over: frames that the NumPy solver had to solve."""

    def __init__(self, problem: OrientationProblem, options: NewtonOptions) -> None:
        super().__init__(problem, options)
        self.handed_over = 0
        self._tree, turns = _tree(problem)
        self._tasks = _tasks(problem, turns)
        self._limits = _limits(problem, options)
        nothing = np.zeros((0, len(problem.lower)))
        self._posture = kernel.Posture(
            np.array(problem.reference), options.posture_weight, *(problem.hold or (nothing, nothing))
        )
        self._work = kernel.work_space(problem.columns)
        self._time = np.array(problem.time)

    def follow(self, path: Path, first: int, last: int, below: Array | None = None) -> int:
        """As `FrameSolver.follow`."""
        direction = 1 if last >= first else -1
        limit = np.zeros(0) if below is None else below
        while first != last:
            begin = first
            first, ended = kernel.follow(
                self._tree, self._tasks, self._limits, self._posture, self._time, path.q, path.cost, path.iterations,
                limit, first, last, self.options.tolerance, self._work,
            )  # fmt: skip
            solved = slice(begin + 1, first + 1) if direction > 0 else slice(first, begin)
            path.status[solved], path.unconverged[solved] = FRAME_OK, False
            if ended:
                return first
            self.handed_over += 1
            if not self._follow_one(path, first + direction, direction, below):
                return first
            first += direction
        return last


def _tree(problem: OrientationProblem) -> tuple[kernel.Tree, dict[int, Array]]:
    """The kernel's tree, and per pinocchio joint the rotation from its own frame to the kernel's, whose z is the joint's axis."""
    base, columns = problem.base_columns, problem.columns
    frames = axis_frames(problem.model)
    parent, sliding, fixed = np.full(columns, -1), np.zeros(columns, bool), np.tile(np.eye(3), (columns, 1, 1))
    parent[:base] = np.arange(base) - 1
    for frame in frames.values():
        column = base + frame.column
        before = frames.get(frame.parent)
        parent[column] = base - 1 if before is None else base + before.column
        fixed[column], sliding[column] = frame.rotation, frame.sliding
    still = problem.model.base_is_floating and not base
    root = rotations.to_matrix(problem.model.base_rotation) if still else np.eye(3)
    return kernel.Tree(parent, base, fixed, root, sliding), {i: frame.axes for i, frame in frames.items()}


def _tasks(problem: OrientationProblem, turns: dict[int, Array]) -> kernel.Tasks:
    moved = [np.flatnonzero(row) for row in problem.moves]
    return kernel.Tasks(
        column=np.array([columns[-1] if len(columns) else -1 for columns in moved]),
        from_link=np.array([turns.get(int(joint), np.eye(3)).T for joint in problem.joint_ids]),
        bone=problem.bone,
        desired=problem.desired,
        desired_bone=problem.desired_bone,
        weight=problem.weight,
        twist_loss=problem.twist_loss,
    )


def _limits(problem: OrientationProblem, options: NewtonOptions) -> kernel.Limits:
    n = len(problem.lower)
    rows, rows_lower, rows_upper = problem.coupled or (np.zeros((0, n)), np.zeros(0), np.zeros(0))
    return kernel.Limits(
        np.array(problem.lower), np.array(problem.upper), np.array(problem.velocity),
        np.ascontiguousarray(rows), rows_lower + TOUCH_RAD, rows_upper - TOUCH_RAD, options.max_step_rad,
    )  # fmt: skip
