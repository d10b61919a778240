"""Inverse kinematics by strict priorities [Lim2022 sec. III]: limits, then level after level, at control steps between the frames.

At every control step each level's tasks command velocities, v = feed-forward + gain · error (`task_rows`); the cascade of QPs (`cascade`) finds
the joint velocities, and they are integrated. Gains of 200/s want steps of 5 ms or less: each frame's time is cut into steps short enough,
between which targets are interpolated. The base stands still, and so do the joints that the hierarchy does not move, in the reference posture.

The motion starts where the first frame's targets are met: the hierarchy is iterated from the reference posture until it stands. (The authors'
robot needs 5 s to get there from wherever it stood.)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from fnmatch import fnmatchcase

import numpy as np
from retarget.core import rotations
from retarget.core.errors import SolverError
from retarget.core.robot_model import RobotModel
from retarget.core.solve.cascade import Cascade, CascadeStep
from retarget.core.solve.dynamical import Solution
from retarget.core.solve.freedom import Freedom
from retarget.core.solve.kernel_choice import chosen
from retarget.core.solve.limits import nearest_feasible
from retarget.core.solve.priorities import hand_points, moving_columns, narrowed, priorities, sorted_tasks
from retarget.core.solve.problem import VELOCITY_MARGIN, coupled_rows
from retarget.core.solve.task_rows import ROWS_OF, TaskRows
from retarget.core.solve.task_samples import TaskSample, TaskSamples
from retarget.core.solve.velocity_limits import VelocityLimits
from retarget.core.types import FRAME_MARKED, FRAME_OK, Array, Targets

Progress = Callable[[int, int], None]

CHUNK = 64
"""Frames between two calls of the progress function."""

FIRST_STEP_RAD, FIRST_INERTIA, STANDING_RAD = 0.1, 0.1, 1e-5
"""On the way to the first frame: the longest step of a joint, the share of A that counts, and the step below which it has arrived.

Without the share, arms that hardly reach their targets creep there for thousands of steps; with less of it they jump to other postures.
"""

COMPILED_STEPS, UNKEPT_STEPS = 10_000, 50_000
"""Control steps from which the compiled kernel pays: it takes 0.7 s to load, and some 4 s to compile the first time, or, where no folder can
be written to that would keep it, every time; a step costs 0.1 ms less with it."""

FREE = 1e30
"""What daqp takes for no bound."""


@dataclass(frozen=True)
class HierarchicalOptions:
    """control_step_s: longest control step; it is shorter where a gain demands it. gain_1_s: of tasks that state none.

    first_steps: most steps on the way from the reference posture to the first frame. kernel: "compiled" (numba), "numpy", or "auto", compiled if
    that is there and the clip long enough; from one state both step to the same velocities to 1e-9 rad/s.
    """

    control_step_s: float = 1e-3
    gain_1_s: float = 100.0
    first_steps: int = 1000
    kernel: str = "auto"

    def __post_init__(self) -> None:
        if not 0 < self.control_step_s < np.inf:
            raise SolverError(f"control step of {self.control_step_s:g} s; expected above 0")
        if not 0 < self.gain_1_s < np.inf:
            raise SolverError(f"gain of {self.gain_1_s:g}/s; expected above 0")
        if self.first_steps < 1:
            raise SolverError(f"{self.first_steps} steps to the first frame; expected at least 1")


@dataclass(frozen=True)
class HierarchicalSolution(Solution):
    """As `Solution` (status, per frame: marked where a control step's QP failed; iterations: QPs), and:

    levels: the targets' level numbers, first to last. level_residual: (T, L) weighted norm of what each level's command velocities lacked
    in the last control step before a frame, m/s and rad/s together. levels_without_freedom: (L,) frames on which the higher levels left a level nothing.
    failed_levels: control steps in which a level's QP failed. slowed_frames: frames shortened because hands would have been too fast.
    control_steps: in all, and first_steps of those to the first frame.
    """

    levels: tuple[int, ...] = ()
    level_residual: Array = field(default_factory=lambda: np.zeros((0, 0)))
    levels_without_freedom: tuple[int, ...] = ()
    failed_levels: int = 0
    slowed_frames: int = 0
    control_steps: int = 0
    first_steps: int = 0


def solve(
    targets: Targets, model: RobotModel, options: HierarchicalOptions, progress: Progress | None = None
) -> HierarchicalSolution:
    """Joint motion that follows `targets` by strict priorities, inside the limits on joints and hands.

    Between written frames no joint is faster than its limit and no hand leaves its velocity box. Frames on which a level's QP
    failed keep what the levels before it want, and are marked. Raises `SolverError` for input that is not finite, targets that nothing moves,
    and where no posture satisfies the limits.
    """
    solver = HierarchicalSolver(targets, model, options)
    frames = len(targets.time)
    record = _Record(frames, len(model.joint_names), len(solver.levels))
    joints, first_steps, arrived = solver.start()
    record.joints[0], record.iterations[0], record.unconverged = (
        joints,
        first_steps * len(solver.levels),
        int(not arrived),
    )
    record.residual[0] = solver.residuals(np.zeros(len(solver.columns)), 0)
    velocity = np.zeros(len(solver.columns))
    for frame in range(frames - 1):
        joints, velocity = solver.advance(frame, joints, velocity, record)
        if progress is not None and ((frame + 1) % CHUNK == 0 or frame + 2 == frames):
            progress(frame + 2, frames)
    return HierarchicalSolution(
        joints=record.joints,
        base_orientation=np.tile(model.base_rotation, (frames, 1)) if model.base_is_floating else None,
        status=record.status,
        iterations=record.iterations,
        start=0,
        fallbacks=0,
        unconverged=record.unconverged,
        levels=tuple(level.number for level in solver.levels),
        level_residual=record.residual,
        levels_without_freedom=tuple(int(count) for count in record.without_freedom),
        failed_levels=record.failed,
        slowed_frames=record.slowed,
        control_steps=record.steps,
        first_steps=first_steps,
    )


class _Record:
    """What the frames leave behind."""

    def __init__(self, frames: int, joints: int, levels: int) -> None:
        self.joints, self.residual = np.zeros((frames, joints)), np.zeros((frames, levels))
        self.status, self.iterations = np.full(frames, FRAME_OK, np.int8), np.zeros(frames, np.int64)
        self.without_freedom = np.zeros(levels, np.int64)
        self.unconverged = self.failed = self.slowed = self.steps = 0


class HierarchicalSolver:
    """The control steps of one set of targets, with their work space. Not thread-safe.

    columns: (c,) joints solved for. levels: first to last. tasks: sorted by level. freedom: NumPy's or the compiled one.
    """

    def __init__(self, targets: Targets, model: RobotModel, options: HierarchicalOptions) -> None:
        _check_finite(targets, model)
        model = narrowed(model)
        self._model, self._options, self._time = model, options, targets.time
        self.columns = moving_columns(targets, model)
        self.tasks = sorted_tasks(targets, model, self.columns)
        self.levels = priorities(self.tasks, model)
        hierarchy, hands = model.profile.hierarchy, hand_points(self.tasks, model)
        self._standing = model.configuration(model.reference_posture)
        self._samples = TaskSamples(self.tasks, model)
        gains = np.array([task.gain or options.gain_1_s for task in self.tasks])
        # With one over the step as gain the error is gone after it; with more it swings over.
        self.longest_step_s = min(options.control_step_s, 1.0 / float(gains.max()))
        self._first_step_s = 1.0 / float(gains.max())
        self.rows = TaskRows(self.tasks, model, self.columns, hands, gains)
        self.level_rows = [
            slice(self.rows.slices[level.tasks.start].start, self.rows.slices[level.tasks.stop - 1].stop)
            for level in self.levels
        ]
        size = [ROWS_OF[task.kind] for task in self.tasks]
        self.weight = np.repeat(np.stack([task.weight for task in self.tasks], axis=1), size, axis=1)
        speed = model.velocity_limit[self.columns] * (1.0 - VELOCITY_MARGIN)
        box = np.repeat([hierarchy.hand_speed_m_s, hierarchy.hand_rate_rad_s], 3)
        self.limits = VelocityLimits(model, self.columns, len(hands), speed, hierarchy.limit_gain, box)
        unhurried = np.full(len(speed), FIRST_STEP_RAD / self._first_step_s)
        self._unhurried = VelocityLimits(model, self.columns, len(hands), unhurried, FREE, np.full(6, FREE))
        self.freedom = self._chosen_freedom()
        self._cascade = Cascade(self.levels, self.level_rows, self.weight, self.limits.speed, self.freedom)
        # The way to the first frame may end at either of two postures by rounding: it is NumPy's, so that the rest of the clip is the same, too.
        self._first_cascade = Cascade(self.levels, self.level_rows, self.weight, self.limits.speed)
        self.added_inertia = np.diag(
            [
                hierarchy.inertia_diagonal
                + sum(
                    extra
                    for pattern, extra in hierarchy.extra_inertia.items()
                    if fnmatchcase(model.joint_names[column], pattern)
                )
                for column in self.columns
            ]
        )

    def step(self, joints: Array, wanted: TaskSample, frame: int, before: Array, step_s: float) -> CascadeStep:
        """The velocities (c,) of one control step of `step_s` seconds from `joints` (n,), which satisfy the limits.

        frame: whose task weights count. before: (c,) the step before's velocities. The rows stay in `rows` until the next step.
        """
        self.linearise(joints, wanted, step_s)
        inertia = self.rows.inertia + self.added_inertia
        return self._solve(self._cascade, frame, self.limits, inertia, before, step_s)

    def _chosen_freedom(self) -> type[Freedom]:
        def compiled() -> type[Freedom]:
            from retarget.core.solve.freedom_kernel import CompiledFreedom

            return CompiledFreedom

        steps = int(sum(self._control_steps(frame) for frame in range(len(self._time) - 1)))
        return chosen(self._options.kernel, Freedom, compiled, steps, COMPILED_STEPS, UNKEPT_STEPS)

    def linearise(self, joints: Array, wanted: TaskSample, step_s: float) -> None:
        """Bring `rows` and `limits` to `joints` (n,)."""
        self.rows.linearise(self._configuration(joints), wanted)
        self.limits.update(joints, step_s)

    def _solve(
        self, cascade: Cascade, frame: int, limits: VelocityLimits, inertia: Array, before: Array, step_s: float
    ) -> CascadeStep:
        rows, constraints = self.rows, np.concatenate([self.rows.hand_rows, limits.coupled])
        return cascade.solve(
            frame, rows.jacobian, rows.command, inertia, limits.lower, limits.upper, constraints, before, step_s
        )

    def start(self) -> tuple[Array, int, bool]:
        """The joints (n,) that meet the first frame's targets, found from the reference posture, the steps it took, and whether they stand.

        Time does not count here: no speed limit holds, and little of the inertia that would slow the way down. Where targets can't be met, full
        steps may swing about the answer for ever: they are shortened while they turn back.
        """
        model, step_s = self._model, self._first_step_s
        joints = nearest_feasible(model.reference_posture, model.lower, model.upper, coupled_rows(model))
        wanted, still = self._samples.at(0).standing(), np.zeros(len(self.columns))
        last, share = still, 1.0
        for count in range(1, self._options.first_steps + 1):
            self.rows.linearise(self._configuration(joints), wanted)
            self._unhurried.update(joints, step_s)
            inertia = FIRST_INERTIA * (self.rows.inertia + self.added_inertia)
            found = self._solve(self._first_cascade, 0, self._unhurried, inertia, still, step_s)
            if found.failed == 0:
                raise SolverError(
                    f"the first frame can't be solved for robot '{model.profile.name}': its first QP fails"
                )
            share = 0.5 * share if found.velocity @ last < 0.0 else min(1.2 * share, 1.0)
            joints, last = self._moved(joints, found.velocity * (share * step_s)), found.velocity
            if np.abs(last).max() * share * step_s <= STANDING_RAD:
                return joints, count, True
        return joints, self._options.first_steps, False

    def advance(self, frame: int, start: Array, velocity: Array, record: _Record) -> tuple[Array, Array]:
        """The joints (n,) at the frame after `frame`, from `start` (n,) there and moving with `velocity` (c,), and the velocity then."""
        duration = float(self._time[frame + 1] - self._time[frame])
        count = self._control_steps(frame)
        step_s, after = duration / count, frame + 1
        wanted, joints = self._samples.between(frame, count), start
        stuck, qps, failed = np.zeros(len(self.levels), bool), 0, 0
        for i in range(count):
            found = self.step(joints, wanted[i], frame, velocity, step_s)
            velocity = found.velocity
            joints = self._moved(joints, velocity * step_s)
            stuck |= found.freedom == 0
            qps, failed = qps + found.qps, failed + (found.failed is not None)
        record.residual[after] = self.residuals(velocity, frame)
        share = self._share_within_hand_box(start, joints, duration)
        if share < 1.0:
            joints, velocity = start + share * (joints - start), share * velocity
            record.slowed += 1
        record.joints[after], record.iterations[after] = joints, qps
        record.without_freedom += stuck
        record.steps, record.failed = record.steps + count, record.failed + failed
        if failed:
            record.status[after] = FRAME_MARKED
        return joints, velocity

    def _control_steps(self, frame: int) -> int:
        """From `frame` to the next."""
        duration = float(self._time[frame + 1] - self._time[frame])
        return max(1, int(np.ceil(duration / self.longest_step_s - 1e-6)))

    def residuals(self, velocity: Array, frame: int) -> Array:
        """Per level (L,) the norm of weighted J q̇ - v at `velocity` (c,), with the rows of the last step."""
        lacking = (self.rows.jacobian @ velocity - self.rows.command) * np.sqrt(self.weight[frame])
        return np.array([np.linalg.norm(lacking[rows]) for rows in self.level_rows])

    def _configuration(self, joints: Array) -> Array:
        """pinocchio's q of `joints` (n,), the base standing still."""
        q = self._standing.copy()
        q[-len(joints) :] = joints
        return q

    def _moved(self, joints: Array, step: Array) -> Array:
        after = joints.copy()
        after[self.columns] += step
        return np.clip(after, self._model.lower, self._model.upper, out=after)

    def _share_within_hand_box(self, start: Array, end: Array, duration: float) -> float:
        """Which share of the way from `start` to `end` keeps the hands' mean velocities inside the box.

        Every control step did; what turns while it moves may leave a box on the whole by a little. Limits on joints are convex: on
        part of the way they hold as on all of it.
        """
        turn, point = self.rows.hand_poses(self._configuration(start))
        if not len(point):
            return 1.0
        share = 1.0
        for _ in range(20):
            turned, moved = self.rows.hand_poses(self._configuration(start + share * (end - start)))
            turns = rotations.log(rotations.from_matrix(turned @ turn.transpose(0, 2, 1)))
            rates = np.abs(np.concatenate([moved - point, turns], axis=1)) / duration
            excess = float((rates / self.limits.hand_box).max())
            if excess <= 1.0:
                return share
            share *= (1.0 - 1e-6) / excess
        return 0.0


def _check_finite(targets: Targets, model: RobotModel) -> None:
    """Raise `SolverError` for the first value that is not finite: daqp returns NaN as success."""
    inputs = {"time": targets.time, "reference posture": model.reference_posture}
    for task in targets.tasks:
        inputs[f"target of {task.frame}"], inputs[f"weight of {task.frame}"] = task.value, task.weight
        if task.feed_forward is not None:
            inputs[f"feed-forward of {task.frame}"] = task.feed_forward
    for name, limits in (("lower", model.lower), ("upper", model.upper), ("speed", model.velocity_limit)):
        inputs[f"{name} limits"] = np.nan_to_num(limits, nan=np.nan, posinf=0.0, neginf=0.0)  # no limit is fine
    for name, values in inputs.items():
        if not (finite := np.isfinite(values)).all():
            where = tuple(int(i) for i in np.argwhere(~finite)[0])
            raise SolverError(f"the solver's input '{name}' holds {values[where]} at {where}, expected finite values")
