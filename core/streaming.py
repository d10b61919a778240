"""Retargeting while the recording still arrives: a block at a time, in the memory of a block, and out as soon as it is solved.

Every block is converted together with `LEAD_S` of the recording on either side, which is what a part needs to move as it does in the whole
(`core.pipeline`), starts from the posture in which the block before has solved that time, and is joined to it by `core.solve.seams`.
What `convert` decides for a whole clip is kept from the first block on: the base motion, the person's size, the path's origin and height. Only contacts
that the recording does not state are judged by the heights within a block.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from retarget.core import pipeline, timebase
from retarget.core.errors import UsageError
from retarget.core.joint_ranges import JointRanges
from retarget.core.pipeline import LEAD_S, ConvertOptions
from retarget.core.stream_windows import Blocks, Window, Windows
from retarget.core.types import Array, HumanMotion, JointTrajectory, Source, Targets

if TYPE_CHECKING:
    from retarget.core.robot_model import RobotModel
    from retarget.core.solve.dynamical import Solution
    from retarget.core.solve.seams import Solved

BLOCKS = Blocks(first_s=2.0, block_s=20.0, lead_s=LEAD_S)
FADE_S = 2.0
"""Over which one block's solution becomes that of the next, where they differ."""
LEAST_RATE_HZ = 1.0
"""Frames that are further apart have nothing to do with blocks."""


def can_stream(options: ConvertOptions) -> bool:
    """Whether `options` are such that blocks give what the whole gives: frames of which each is solved for itself."""
    _, solver = pipeline.check_mapping(options)
    slow = options.rate_hz is not None and options.rate_hz < LEAST_RATE_HZ
    return solver == "dynamical" and not options.online and not slow and options.smooth_s <= LEAD_S / 2


class StreamedConversion:
    """The conversion of a motion that arrives in `parts` to `model`. Iterate over it once, for the trajectory's consecutive parts.

    The provenance of all but the last part is what is known at the beginning; that of the last is the whole's. frames, time_s (first and last
    frame), source, provenance, metrics (keys as `ConvertResult.metrics`, without tables) and timings_s (stage → seconds) are those of all parts so far.
    """

    def __init__(
        self, parts: Iterable[HumanMotion], model: RobotModel, options: ConvertOptions, blocks: Blocks = BLOCKS
    ) -> None:
        """Raises `UsageError` for options that no motion could make right, and for those that need the whole (`can_stream`)."""
        from retarget.core.running_metrics import RunningMetrics

        pipeline.check_options(options)
        if not can_stream(options):
            raise UsageError("these options need the whole recording; expected the dynamical solver, offline")
        self._mapping, _ = pipeline.check_mapping(options)
        self._windows = Windows(parts, blocks, options.start_s, options.end_s, options.rate_hz)
        self._model, self._options = model, options
        self._running, self._stages = RunningMetrics(), pipeline.Stages()
        self._facts: dict[str, Any] = {}
        self._base = ""
        self._scale: float | None = None
        self._ranges: JointRanges | None = None
        self._before: Solved | None = None
        self._base_position: Array | None = None  # of the frame written last
        self.frames = 0
        self.time_s = (0.0, 0.0)
        self.source = Source("memory")
        self.provenance: Mapping[str, Any] = {}

    @property
    def metrics(self) -> dict[str, Any]:
        """Of all parts so far."""
        return self._running.result()

    @property
    def timings_s(self) -> dict[str, float]:
        """Stage → seconds so far."""
        return self._stages.seconds

    def __iter__(self) -> Iterator[JointTrajectory]:
        """Raises as `pipeline.convert`, and what asking for parts raises."""
        windows = iter(self._windows)
        while True:
            with self._stages.timed("read"):
                window = next(windows, None)
            if window is None:
                return
            yield self._converted(window)

    def _converted(self, window: Window) -> JointTrajectory:
        """The window's block."""
        from retarget.core import metrics

        motion = self._prepared(window)
        with self._stages.timed("map"):
            targets = self._mapping.targets(motion, self._model, **self._options.settings)
        with self._stages.timed("solve"):
            solution, solved = self._solved(targets)
        with self._stages.timed("base"):
            whole = self._assembled(window, motion, solved, solution.status)
        wanted = window.wanted
        first = wanted.start if self.frames else 0
        part = sliced(whole, slice(first, first + wanted.stop - wanted.start))
        with self._stages.timed("measure"):
            figures, series = metrics.measure(part, self._model, *pipeline.trimmed(motion, targets, wanted))
            self._running.add(figures, series, part.frames)
            if self.frames:
                step = sliced(whole, slice(first - 1, first + 1))
                self._running.add_seam(metrics.limit_figures(step, self._model)[0])
        self.time_s = (self.time_s[0] if self.frames else float(part.time[0]), float(part.time[-1]))
        self.frames += part.frames
        self.source, self.provenance = window.source, part.provenance
        return part

    def _prepared(self, window: Window) -> HumanMotion:
        with self._stages.timed("prepare"):
            motion = window.motion
            if not self._base:
                _, solver = pipeline.check_mapping(self._options)
                self._base = pipeline.base_mode(motion, self._model, self._options, solver)
            if self._base != "fixed":
                return motion
            from retarget.core.mapping.heading import without_heading

            return without_heading(motion, self._model.profile.base_segment)

    def _solved(self, targets: Targets) -> tuple[Solution, Solved]:
        """The window's own solution, and that which continues the window before."""
        from retarget.core.solve import clip, seams
        from retarget.core.solve.problem import VELOCITY_MARGIN

        options, before = self._options, self._before
        found = clip.by_one_qp_a_frame(
            targets,
            self._model,
            free_base=self._base != "fixed",
            online=False,
            kernel=options.kernel,
            progress=None,
            start=None if before is None else before.at(float(targets.time[0])),
        )
        solution = found.solution
        if options.smooth_s > 0:
            solution = clip.smoothed(targets.time, solution, options.smooth_s, self._model)
        solved = seams.Solved(targets.time, solution.joints, solution.base_orientation)
        apart, shortened = 0.0, 0
        if before is not None:
            solved, apart = seams.faded(before, solved, self.time_s[1], FADE_S)
            solved, shortened = seams.within_speed(
                solved, self.time_s[1], self._model.velocity_limit * (1.0 - VELOCITY_MARGIN)
            )
        self._before = solved
        self._count(found.facts, apart, shortened)
        return solution, solved

    def _count(self, facts: Mapping[str, Any], apart: float, shortened: int) -> None:
        """Add a window's facts to those of the solver so far."""
        if not self._facts:
            self._facts = {**facts, "blocks": 1, "blocks_apart_rad": 0.0, "shortened_steps": 0}
            return
        for name in ("qps", "qp_fallbacks", "unconverged_frames"):
            self._facts[name] += facts[name]
        self._facts["calm_passes"] = max(self._facts["calm_passes"], facts["calm_passes"])
        self._facts["blocks"] += 1
        self._facts["blocks_apart_rad"] = max(self._facts["blocks_apart_rad"], apart)
        self._facts["shortened_steps"] += shortened

    def _assembled(
        self, window: Window, motion: HumanMotion, solved: Solved, status: NDArray[np.int8]
    ) -> JointTrajectory:
        """The block's trajectory, which goes on where the one before ended, with what is around it on both sides as far as that is known.

        At the recording's own ends nothing is around it, as in the whole.
        """
        model, wanted = self._model, window.wanted
        kept = slice(0 if self.frames else wanted.start, wanted.stop if window.is_last else motion.frames)
        joints, time_s = solved.joints[kept], motion.time[kept]
        orientation = position = None
        if model.base_is_floating:
            turned = None if solved.base_orientation is None else solved.base_orientation[kept]
            orientation = pipeline.base_orientation(model, turned, len(joints))
            position = self._base_path(
                timebase.cut(motion, time_s[0], time_s[-1]), joints, orientation, wanted.start - 1
            )
            self._base_position = position[wanted.stop - 1 - kept.start]
        known = window.source if window.is_last else replace(window.source, sha256="")
        solver = self._facts if window.is_last else {"name": self._facts["name"]}
        block = joints[wanted.start - kept.start : wanted.stop - kept.start]
        if self._ranges is None:
            self._ranges = JointRanges.of(model.joint_names, block)
        else:
            self._ranges = self._ranges.extended(block)
        ranges = self._ranges if window.is_last else None
        facts = pipeline.provenance(replace(motion, source=known), model, self._options, self._base, solver, ranges)
        return pipeline.assembled(time_s, model, joints, orientation, position, status[kept], facts)

    def _base_path(self, motion: HumanMotion, joints: Array, orientation: Array, last_written: int) -> Array:
        """Base positions (T, 3) m that go on from the frame `last_written`, where there is one."""
        from retarget.core.solve.base import base_position, leg_scale

        if self._scale is None:
            self._scale = leg_scale(self._model, motion)
        path = base_position(self._base, self._model, motion, joints, orientation, self._scale)  # type: ignore[arg-type]  # checked by `base_mode`
        if self._base_position is not None:
            shift = self._base_position - path[last_written]
            if self._base == "contact":
                shift[2] = 0.0  # its height is the floor's
            path += shift
        return path


def sliced(trajectory: JointTrajectory, window: slice) -> JointTrajectory:
    """The frames of `window`."""
    names = ("time", "position", "velocity", "base_position", "base_orientation", "base_linear_velocity")
    arrays = {name: getattr(trajectory, name) for name in (*names, "base_angular_velocity", "status")}
    parts: dict[str, Any] = {name: None if array is None else array[window] for name, array in arrays.items()}
    return replace(trajectory, **parts)
