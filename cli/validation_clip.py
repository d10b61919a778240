"""One trajectory, from its file to its verdict, page, film and log: what a worker of `retarget validate` does."""

from __future__ import annotations

import contextlib
import dataclasses
import secrets
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from retarget.cli.clip import model_for, read_motion, robot_model, without_nan
from retarget.cli.console import Progress
from retarget.cli.plan import PIPE
from retarget.core.errors import FormatError, InvalidDataError, RetargetError, UnknownNameError, UsageError

if TYPE_CHECKING:
    from retarget.cli.validation_page import Section
    from retarget.core.replay.model import ReplayModel
    from retarget.core.replay.thresholds import Thresholds
    from retarget.core.robot_model import RobotModel
    from retarget.core.types import Check, HumanMotion, JointTrajectory, ValidationReport

Record = dict[str, Any]
PICKLES = (".pkl", ".pickle", ".p")
KEYS = ("name", "value", "unit", "limit", "passed", "note")


@dataclass(frozen=True)
class Job:
    """One trajectory to judge.

    input: path, or "-" for stdin. robot: name or profile path, None = the trajectory's own. overrides: "NAME=VALUE" of thresholds.
    joint_order, rate_hz: what a file doesn't say of itself. recording: the person's motion, for pictures.
    video, log, page: paths, "" for none. wants_section: the page's content is to come back.
    """

    input: str
    mode: str = "fixed"
    robot: str | None = None
    thresholds_file: str | None = None
    overrides: tuple[str, ...] = ()
    gains: str = "auto"
    feed_forward: bool = False
    self_collision: bool = False
    joint_order: str | None = None
    rate_hz: float | None = None
    recording: str | None = None
    video: str = ""
    log: str = ""
    page: str = ""
    wants_section: bool = False
    overwrite: bool = False
    view: bool = False

    @property
    def shown(self) -> str:
        """What messages call the input."""
        return "stdin" if self.input == PIPE else self.input


@dataclass(frozen=True)
class Done:
    """A judged trajectory: its record as `--json` prints it, warnings for people, the page's section where one is wanted."""

    record: Record
    warnings: tuple[str, ...] = ()
    section: Section | None = None
    kinematic: tuple[str, ...] = field(default=(), repr=False)


def thresholds_of(mode: str, path: str | None, overrides: Sequence[str]) -> dict[str, Thresholds]:
    """Mode → thresholds, for all modes that `mode` runs. Raises `UsageError` for what none of them knows."""
    from retarget.core.replay.thresholds import TABLE, Thresholds, modes_of

    modes = ["kinematic"] if mode == "kinematic" else ["kinematic", mode]
    made = {}
    for each in modes:
        limits = Thresholds.load(path, each) if path else Thresholds(each)
        made[each] = limits.overridden(text for text in overrides if each in modes_of(_name(text)))
    for text in overrides:
        of = modes_of(_name(text))
        if not of:
            choices = [row.name for each in modes for row in TABLE[each]]
            raise UnknownNameError("threshold", _name(text), choices, where="--max")
        if not set(of) & set(modes):
            raise UsageError(f"--max {text}: belongs to --mode {' or '.join(of)}, which is not run")
    return made


def validate_clip(job: Job, progress: Progress | None = None) -> Done:
    """Read and judge `job`, write what it asks for. Raises `RetargetError` when it can't be judged."""
    from retarget.core.replay import model as replay_models

    started = time.perf_counter()
    motion = read_motion(job.recording) if job.recording else None
    trajectory, model, warnings = _read(job, motion)
    limits = thresholds_of(job.mode, job.thresholds_file, job.overrides)
    standing = _replay_model(job.robot or trajectory.robot, model, "standing", job.self_collision)
    replaying = time.perf_counter()
    try:
        reports = _judge(job, trajectory, model, standing, limits)
    except (InvalidDataError, UnknownNameError) as error:
        raise _placed(error, job) from error
    replay_s = time.perf_counter() - replaying
    del replay_models, progress
    checks = [check for report in reports.values() for check in report.checks]
    duration_s = float(trajectory.time[-1] - trajectory.time[0])
    record: Record = {
        "input": job.input,
        "robot": model.profile.name,
        "mode": job.mode,
        "status": "ok",
        "error": None,
        "passed": all(check.passed is not False for check in checks),
        "checks": [_check_record(check) for check in checks],
        "frames": trajectory.frames,
        "rate_hz": trajectory.rate_hz,
        "duration_s": duration_s,
        "real_time_factor": duration_s / replay_s,
        "wall_s": None,
    }
    section = None
    if job.wants_section or job.video or job.view:
        section = _pictures(job, trajectory, model, reports, motion, without_nan(record))
    record["wall_s"] = time.perf_counter() - started
    return Done(without_nan(record), tuple(warnings), section)
