"""The one place that strings mapping, solver, base motion and measurement together. Commands and batches call `convert`."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from retarget.core import rotations, timebase
from retarget.core.errors import MotionError, UnknownNameError, UsageError
from retarget.core.joint_ranges import JointRanges
from retarget.core.types import Array, HumanMotion, JointTrajectory, Targets

if TYPE_CHECKING:
    from collections.abc import Iterator

    from retarget.core.mapping import Mapping as MotionMapping
    from retarget.core.robot_model import RobotModel
    from retarget.core.solve.clip import ClipSolution

BASE_CHOICES = ("auto", "fixed", "human", "contact")
SOLVER_CHOICES = ("auto", "dynamical", "hierarchical")
METHODS = {"geometric": "limb_plane", "telemanipulation": "hand_position"}
"""Method → the mapping that it takes unless another is named [Darvish2019], [Lim2022]."""
KERNEL_CHOICES = ("auto", "numpy", "compiled")
LEAD_S = 5.0
"""How much of the recording before and after a wanted part is solved along with it and thrown away."""


@dataclass(frozen=True)
class ConvertOptions:
    """How to convert. mapping: a name of `mapping_names()`. base: one of BASE_CHOICES, auto = by the robot.

    solver: one of SOLVER_CHOICES, auto = hierarchical for mappings of hands, dynamical for the others. settings: of the mapping, by name.
    online: the paper's one QP per frame instead of converged frames. rate_hz: output rate, None = the recording's.
    start_s, end_s: the part of the recording, on its own clock. smooth_s: half-width of a zero-lag minimum-jerk average over the result
    (the authors of [Darvish2019] smooth by minimum jerk over 0.25 s, with lag), 0 = none; limits hold all the same. kernel: the compiled solver where it pays, or one of the two.
    """

    mapping: str = "limb_plane"
    base: str = "auto"
    online: bool = False
    rate_hz: float | None = None
    start_s: float | None = None
    end_s: float | None = None
    smooth_s: float = 0.0
    kernel: str = "auto"
    solver: str = "auto"
    settings: Mapping[str, Any] = field(default_factory=dict, hash=False)  # options serve as keys of caches


@dataclass(frozen=True)
class ConvertResult:
    """A converted clip. motion: what was retargeted (cut, resampled), frame for frame with the trajectory.

    metrics: the "metrics" object of the command line's JSON. timings_s: stage → seconds.
    """

    trajectory: JointTrajectory
    motion: HumanMotion
    targets: Targets
    metrics: dict[str, Any]
    timings_s: dict[str, float]
    model: RobotModel
    measured_series: dict[str, Array] = field(default_factory=dict)

    @cached_property
    def series(self) -> dict[str, Any]:
        """Per-frame series behind the metrics, and stick figures: {human,robot}_points (T, P, 3) m and {human,robot}_bones (B, 2)."""
        from retarget.core.stick_figure import human_figure, robot_figure

        robot_points, robot_bones = robot_figure(self.trajectory, self.model)
        human_points, human_bones = human_figure(self.motion)
        return {
            **self.measured_series,
            "robot_points": robot_points,
            "robot_bones": robot_bones,
            "human_points": human_points,
            "human_bones": human_bones,
        }


def mapping_names() -> list[str]:
    """Names that `ConvertOptions.mapping` accepts."""
    from retarget.core import mapping

    return mapping.names()


def check_options(options: ConvertOptions) -> None:
    """Raise `UsageError` or `UnknownNameError` for options that no motion could make right."""
    for kind, value, choices in (
        ("mapping", options.mapping, mapping_names()),
        ("base motion", options.base, BASE_CHOICES),
        ("kernel", options.kernel, KERNEL_CHOICES),
        ("solver", options.solver, SOLVER_CHOICES),
    ):
        if value not in choices:
            raise UnknownNameError(kind, value, choices)
    if options.rate_hz is not None and not 0 < options.rate_hz <= 10_000:
        raise UsageError(f"rate {options.rate_hz:g} Hz; expected above 0 and at most 10000")
    if not 0 <= options.smooth_s <= 10:
        raise UsageError(f"smoothing over {options.smooth_s:g} s; expected 0 to 10")
    if options.start_s is not None and options.end_s is not None and options.end_s < options.start_s:
        raise UsageError(f"end {options.end_s:g} s is before start {options.start_s:g} s")


def convert(
    motion: HumanMotion, model: RobotModel, options: ConvertOptions, progress: Callable[[int, int], None] | None = None
) -> ConvertResult:
    """Retarget `motion` to `model`. `progress` gets (frames done, frames in all) now and then.

    Raises `UsageError` for options that contradict each other or the robot, `MotionError` for motions with nothing to retarget,
    `SolverError` when the first frame can't be solved. Frames that fail later are marked in the trajectory's status and counted.
    """
    from retarget.core.mapping.heading import without_heading
    from retarget.core.metrics import measure

    check_options(options)
    chosen, solver = check_mapping(options)
    base = base_mode(motion, model, options, solver)
    stages = Stages()
    with stages.timed("prepare"):
        motion, window = _with_lead(motion, options)
        if base == "fixed":
            motion = without_heading(motion, model.profile.base_segment)
    with stages.timed("map"):
        targets = chosen.targets(motion, model, **options.settings)
    with stages.timed("solve"):
        found = _solve(targets, model, options, solver, base != "fixed", progress)
    with stages.timed("finish"):
        from retarget.core.solve import clip

        solution = found.solution
        if options.smooth_s > 0:
            solution = clip.smoothed(motion.time, solution, options.smooth_s, model)
        if window != slice(0, motion.frames):
            motion, targets = trimmed(motion, targets, window)
            solution = clip.trimmed(solution, window)
    with stages.timed("base"):
        trajectory = _trajectory(motion, model, options, base, replace(found, solution=solution))
    with stages.timed("measure"):
        metrics, series = measure(trajectory, model, motion, targets)
    return ConvertResult(trajectory, motion, targets, metrics, stages.seconds, model, series)


def needs_calibration(mapping_name: str) -> bool:
    """Whether the mapping called so wants `motion.calibration`."""
    from retarget.core import mapping

    return mapping.load(mapping_name).needs_calibration


def check_mapping(options: ConvertOptions) -> tuple[MotionMapping, str]:
    """The mapping and the solver that `options` mean. Raises `UsageError` for combinations that can't work and unknown settings."""
    from retarget.core import mapping

    chosen = mapping.load(options.mapping)
    solver = _solver(chosen, options)
    _check_settings(chosen, options)
    return chosen, solver


def _solver(chosen: MotionMapping, options: ConvertOptions) -> str:
    """The solver to take. Raises `UsageError` for one that can't do what is asked of it."""
    solver = options.solver
    if solver == "auto":
        solver = "hierarchical" if chosen.needs_calibration else "dynamical"
    if solver == "dynamical" and chosen.needs_calibration:
        raise UsageError(
            f"mapping '{chosen.name}' places hands, the dynamical solver only follows orientations; expected the hierarchical solver"
        )
    if solver == "hierarchical":
        if options.online:
            raise UsageError("online is the dynamical solver's; the hierarchical one always steps as in a live loop")
        if options.base in ("human", "contact"):
            raise UsageError(
                f"the hierarchical solver keeps the base still; expected base motion fixed or auto, found {options.base}"
            )
    return solver


def _check_settings(chosen: MotionMapping, options: ConvertOptions) -> None:
    for name in options.settings:
        if name not in chosen.settings:
            if not chosen.settings:
                raise UsageError(f"mapping '{chosen.name}' has no settings; found '{name}'")
            raise UnknownNameError(f"setting of mapping '{chosen.name}'", name, chosen.settings)


def base_mode(motion: HumanMotion, model: RobotModel, options: ConvertOptions, solver: str) -> str:
    """The base motion to take. Raises `UsageError` for one that the robot, and `MotionError` for one that the recording does not have."""
    from retarget.core.solve import base as base_motion

    if options.base in ("human", "contact") and not model.base_is_floating:
        raise UsageError(f"robot '{model.profile.name}' stands on a fixed base; expected --base fixed or auto")
    if options.base == "contact" and not model.profile.feet:
        raise UsageError(f"robot '{model.profile.name}' has no feet in its profile; expected --base fixed or human")
    segment = model.profile.base_segment
    if options.base in ("human", "contact") and not motion.has(segment):
        raise MotionError(
            f"base motion {options.base} follows the person's {segment}, which was not measured; expected base motion fixed or auto"
        )
    if options.base != "auto":
        return options.base
    if solver == "hierarchical" or not motion.has(segment):
        return "fixed"
    return base_motion.default_mode(model)


def _with_lead(motion: HumanMotion, options: ConvertOptions) -> tuple[HumanMotion, slice]:
    """The wanted part at the wanted rate with up to LEAD_S more at either end, and which of its frames are wanted.

    A part then moves as it does in the whole: where a joint is at its speed limit, and where twists are averaged, what came before matters.
    """
    wanted = timebase.cut(motion, options.start_s, options.end_s)
    first, last = float(wanted.time[0]), float(wanted.time[-1])
    led = timebase.cut(motion, first - LEAD_S, last + LEAD_S) if wanted.frames < motion.frames else wanted
    if options.rate_hz is not None:
        led = timebase.resample(led, options.rate_hz, anchor_s=first)
    slack = timebase.CLOCK_SLACK_S
    inside = np.flatnonzero((led.time >= first - slack) & (led.time <= last + slack))
    return led, slice(int(inside[0]), int(inside[-1]) + 1)


def trimmed(motion: HumanMotion, targets: Targets, window: slice) -> tuple[HumanMotion, Targets]:
    """The frames of `window` of both."""
    first, last = float(motion.time[window.start]), float(motion.time[window.stop - 1])
    tasks = tuple(
        replace(
            task,
            value=task.value[window],
            feed_forward=None if task.feed_forward is None else task.feed_forward[window],
            weight=task.weight[window],
        )
        for task in targets.tasks
    )
    return timebase.cut(motion, first, last), replace(targets, time=targets.time[window], tasks=tasks)


def _solve(
    targets: Targets,
    model: RobotModel,
    options: ConvertOptions,
    solver: str,
    free_base: bool,
    progress: Callable[[int, int], None] | None,
) -> ClipSolution:
    from retarget.core.solve import clip

    if solver == "hierarchical":
        return clip.by_strict_priorities(targets, model, kernel=options.kernel, progress=progress)
    return clip.by_one_qp_a_frame(
        targets, model, free_base=free_base, online=options.online, kernel=options.kernel, progress=progress
    )


def _trajectory(
    motion: HumanMotion,
    model: RobotModel,
    options: ConvertOptions,
    base: str,
    found: ClipSolution,
) -> JointTrajectory:
    from retarget.core.solve.base import base_position

    solution = found.solution
    orientation = position = None
    if model.base_is_floating:
        orientation = base_orientation(model, solution.base_orientation, motion.frames)
        position = base_position(base, model, motion, solution.joints, orientation)  # type: ignore[arg-type]  # checked above
    ranges = JointRanges.of(model.joint_names, solution.joints)
    facts = provenance(motion, model, options, base, found.facts, ranges)
    return assembled(motion.time, model, solution.joints, orientation, position, solution.status, facts)


def base_orientation(model: RobotModel, solved: Array | None, frames: int) -> Array:
    """(T, 4) wxyz of a floating robot's base: as `solved`, or upright where it was not."""
    return np.tile(model.base_rotation, (frames, 1)) if solved is None else solved


def assembled(
    time_s: Array,
    model: RobotModel,
    joints: Array,
    orientation: Array | None,
    position: Array | None,
    status: NDArray[np.int8],
    facts: Mapping[str, Any],
) -> JointTrajectory:
    """The trajectory of joints (T, n) and of the base, where it floats, velocities from differences. facts: its provenance."""
    return JointTrajectory(
        time=time_s,
        joint_names=model.joint_names,
        position=joints,
        velocity=timebase.rate_of_change(time_s, joints),
        base_position=position,
        base_orientation=orientation,
        base_linear_velocity=None if position is None else timebase.rate_of_change(time_s, position),
        base_angular_velocity=None if orientation is None else rotations.angular_velocity(time_s, orientation),
        status=status,
        base_frame=model.base_link,
        robot=model.profile.name,
        provenance=facts,
        robot_description=model.urdf,
    )


def provenance(
    motion: HumanMotion,
    model: RobotModel,
    options: ConvertOptions,
    base: str,
    solver: Mapping[str, Any],
    ranges: JointRanges | None,
) -> dict[str, Any]:
    """Facts of how a trajectory was made, JSON-able.

    base: the base motion taken. solver: how the solution was found. ranges: of the joints, None where they are not known yet.
    """
    return {
        "input_sha256": motion.source.sha256,
        "input_format": motion.source.format,
        **({"reader_options": dict(motion.source.options)} if motion.source.options else {}),
        "retarget_version": retarget_version(),
        "robot_model_sha256": model.sha256,
        "options": {**asdict(options), "base": base, "settings": dict(options.settings)},
        "solver": solver,
        **({} if ranges is None else ranges.provenance()),
        **({} if motion.calibration is None else {"calibration_sha256": calibration_sha256(motion)}),
    }


def calibration_sha256(motion: HumanMotion) -> str:
    """Hash of the motion's calibration as its file would be written, "" where it has none."""
    return "" if motion.calibration is None else hashlib.sha256(motion.calibration.to_json().encode()).hexdigest()


def retarget_version() -> str:
    """Version of the installed package, "unknown" when it runs uninstalled."""
    try:
        return version("retarget")
    except PackageNotFoundError:
        return "unknown"


class Stages:
    """Where the time went: seconds by stage, added up."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def timed(self, name: str) -> Iterator[None]:
        """Count the time that the block takes as the stage's."""
        begin = time.perf_counter()
        yield
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - begin
