"""One trajectory, from its file to its verdict, page, film and log: what a worker of `retarget validate` does."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from retarget.cli.clip import model_for, robot_model, without_nan
from retarget.cli.plan import PIPE
from retarget.cli.tracker_logs import read_calibrated
from retarget.core.errors import InvalidDataError, MotionError, RetargetError, UnknownNameError, UsageError

if TYPE_CHECKING:
    from retarget.cli.validation_page import Section
    from retarget.core.replay.model import ReplayModel
    from retarget.core.replay.thresholds import Thresholds
    from retarget.core.report import ValidationReport
    from retarget.core.robot_model import RobotModel
    from retarget.core.types import HumanMotion, JointTrajectory

Record = dict[str, Any]
KEYS = ("name", "value", "unit", "limit", "passed", "note", "where", "time_s")


@dataclass(frozen=True)
class Job:
    """One trajectory to judge.

    input: path, or "-" for stdin. robot: name or profile path, None = the trajectory's own. overrides: "NAME=VALUE" of thresholds.
    csv_style, joint_order, quaternion_order, rate_hz: what a file doesn't say of itself. recording, calibration: the person's motion, for pictures and the limbs' directions, and the operator a tracker log needs;
    reader: what the recording doesn't say of itself (`tracker_logs`).
    video, log, page: paths, "" for none. wants_section: the page's content is to come back.
    """

    input: str
    mode: str = "fixed"
    robot: str | None = None
    thresholds_file: str | None = None
    overrides: tuple[str, ...] = ()
    gains: Literal["auto", "profile", "inertia"] = "auto"
    feed_forward: bool = False
    self_collision: bool = False
    csv_style: str | None = None
    joint_order: str | None = None
    quaternion_order: Literal["wxyz", "xyzw"] | None = None
    rate_hz: float | None = None
    recording: str | None = None
    calibration: str | None = None
    reader: Mapping[str, Any] = field(default_factory=dict)
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
    """A judged trajectory: its record as `--json` prints it, and the page's section where one is wanted."""

    record: Record
    section: Section | None = None


def thresholds_of(mode: str, path: str | None, overrides: Sequence[str]) -> dict[str, Thresholds]:
    """Mode → thresholds, for all modes that `mode` runs. Raises `UsageError` for what none of them knows."""
    from retarget.core.replay.thresholds import TABLE, Thresholds, modes_of

    modes = ["kinematic"] if mode == "kinematic" else ["kinematic", mode]
    made = {}
    for each in modes:
        limits = Thresholds.load(path, each) if path else Thresholds(each)
        made[each] = limits.overridden(text for text in overrides if each in modes_of(text.partition("=")[0].strip()))
    for text in overrides:
        of = modes_of(text.partition("=")[0].strip())
        if not of:
            choices = [row.name for each in modes for row in TABLE[each]]
            raise UnknownNameError("threshold", text.partition("=")[0].strip(), choices, where="--max")
        if not set(of) & set(modes):
            raise UsageError(f"--max {text}: belongs to --mode {' or '.join(of)}, which is not run")
    return made


def validate_clip(job: Job) -> Done:
    """Read and judge `job`, write what it asks for. Raises `RetargetError` when it can't be judged."""
    started = time.perf_counter()
    motion = read_calibrated(job.recording, job.calibration, job.reader) if job.recording else None
    trajectory, model, warnings = _read(job, motion)
    limits = thresholds_of(job.mode, job.thresholds_file, job.overrides)
    try:
        trajectory, reports, replay_s = _judge(job, trajectory, model, motion, limits)
    except (InvalidDataError, MotionError, UnknownNameError) as error:
        raise RetargetError(f"{job.shown}: {error}") from error
    checks = [check for report in reports.values() for check in report.checks]
    duration_s = float(trajectory.time[-1] - trajectory.time[0])
    record: Record = {
        "input": job.input,
        "robot": model.profile.name,
        "mode": job.mode,
        "status": "ok",
        "error": None,
        "passed": all(check.passed is not False for check in checks),
        "checks": [{key: getattr(check, key) for key in KEYS} for check in checks],
        "frames": trajectory.frames,
        "rate_hz": trajectory.rate_hz,
        "duration_s": duration_s,
        "warnings": warnings,
        "facts": {mode: dict(report.facts) for mode, report in reports.items()},
    }
    section = None
    if job.wants_section or job.video or job.view:
        from retarget.cli import validation_views

        section = validation_views.show(job, trajectory, model, reports, limits, motion, without_nan(record))
    record["real_time_factor"] = duration_s / replay_s
    record["wall_s"] = time.perf_counter() - started
    return Done(without_nan(record), section)


def failed_record(job: Job, error: str) -> Record:
    """The record of a clip that could not be judged: the same keys, without values."""
    head: Record = {"input": job.input, "robot": job.robot, "mode": job.mode, "status": "failed", "error": error}
    keys = ("frames", "rate_hz", "duration_s", "warnings", "facts", "real_time_factor", "wall_s")
    return {**head, "passed": False, "checks": [], **dict.fromkeys(keys)}


def _judge(
    job: Job,
    trajectory: JointTrajectory,
    model: RobotModel,
    motion: HumanMotion | None,
    limits: Mapping[str, Thresholds],
) -> tuple[JointTrajectory, dict[str, ValidationReport], float]:
    """(the trajectory in the model's joint order, mode → report, seconds that judging took)."""
    import mujoco
    from retarget.core.replay import kinematic, match

    # By itself MuJoCo writes its warnings into a file in the current folder; a simulation that blows up is a check of its own.
    mujoco.set_mju_user_warning(lambda _text: None)
    trajectory = match.matched(trajectory, model)
    held = replay_model(job, model, "held")
    begin = time.perf_counter()
    reports = {"kinematic": kinematic.check(trajectory, held, limits["kinematic"], motion)}
    if job.mode == "fixed":
        from retarget.core.replay import fixed

        options = fixed.FixedOptions(
            gains=job.gains,
            feed_forward=job.feed_forward,
            self_collision=job.self_collision,
        )
        with _log(job, model) as log:
            reports["fixed"] = fixed.replay(trajectory, held, options, limits["fixed"], log)
    return trajectory, reports, time.perf_counter() - begin


@contextlib.contextmanager
def _log(job: Job, model: RobotModel) -> Iterator[Any]:
    """What takes the signals of every step: a file that appears whole or not at all; None where none is wanted."""
    if not job.log:
        yield None
        return
    from retarget.formats import ReplayLog, new_file

    units = {"time": "s", "reference": "rad", "reference_velocity": "rad/s", "position": "rad", "velocity": "rad/s"}
    units |= {"torque": "Nm", "constraint_torque": "Nm"}
    facts: dict[str, Any] = {"joint_names": list(model.joint_names), "robot": model.profile.name, "mode": job.mode}
    facts |= {"gains": job.gains, "feed_forward": job.feed_forward, "self_collision": job.self_collision}
    with new_file(job.log) as stream, ReplayLog(stream, units, facts) as log:
        yield lambda signals: log.append({name: getattr(signals, name) for name in units})


def _read(job: Job, motion: HumanMotion | None) -> tuple[JointTrajectory, RobotModel, list[str]]:
    """The trajectory, its robot, and warnings for people."""
    from retarget import formats

    source: Any = sys.stdin.buffer if job.input == PIPE else job.input
    names = None
    if job.joint_order is not None or job.csv_style is not None:
        if job.robot is None:
            raise UsageError(f"{job.shown}: a file that names no joints names no robot; give --robot NAME|FILE.toml")
        names = _joint_order(job.joint_order or "urdf", _robot(job.robot, motion, job))
    options = formats.TrajectoryOptions(job.csv_style, job.rate_hz, names, job.quaternion_order)
    trajectory = formats.read_trajectory(source, job.shown, options=options)
    warnings = list(trajectory.provenance.get("warnings", ()))
    robot = job.robot or trajectory.robot or str(trajectory.provenance.get("robot", ""))
    if not robot:
        raise UsageError(f"{job.shown}: names no robot; give --robot NAME|FILE.toml")
    model = _robot(robot, motion, job)
    if trajectory.robot and trajectory.robot != model.profile.name:
        warnings.append(f"made for robot '{trajectory.robot}', judged on '{model.profile.name}'")
    made_with = trajectory.provenance.get("robot_model_sha256")
    if made_with and made_with != model.sha256 and trajectory.robot == model.profile.name:
        warnings.append(f"made with another model of robot '{trajectory.robot}' than the one it is judged on")
    return trajectory, model, warnings


def _robot(robot: str, motion: HumanMotion | None, job: Job) -> RobotModel:
    from retarget import robots

    try:
        profile = robots.load(robot)
    except UnknownNameError as error:
        if job.robot is None:
            raise UsageError(
                f"{job.shown}: was made for robot '{robot}', which is not known by name here; give --robot NAME|FILE.toml"
            ) from error
        raise
    if profile.model.kind != "human":
        return robot_model(robot)
    if motion is None:
        raise UsageError(f"{job.shown}: robot '{robot}' is built from a recording; give it as --recording")
    return model_for(robot, motion)


def _joint_order(order: str, model: RobotModel) -> tuple[str, ...]:
    from retarget.core.replay import match

    if order in match.ORDERS:
        return match.joint_order(model, order)
    try:
        text = Path(order).read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        reason = "no such file"
    except (OSError, ValueError) as error:
        reason = error.strerror.lower() if isinstance(error, OSError) and error.strerror else "not UTF-8 text"
    else:
        return tuple(line.strip() for line in text.splitlines() if line.strip())
    raise UsageError(
        f"--joint-order {order}: {reason}; expected {', '.join(match.ORDERS)}, or a file with a joint's name a line"
    )


@lru_cache(maxsize=8)
def _cached_model(robot: str, kind: str) -> ReplayModel:
    return _built(robot_model(robot), kind)


def _built(model: RobotModel, kind: str) -> ReplayModel:
    from retarget.core.replay.model import build

    if kind == "held":
        return build(model, base="fixed", self_collision=True)
    if kind == "seen standing" and model.base_is_floating:
        return build(model, base="floating", floor=True, visuals=True)
    return build(model, base="fixed", visuals=True)


def replay_model(job: Job, model: RobotModel, kind: str) -> ReplayModel:
    """In MuJoCo, built once per process where the robot needs no recording.

    kind: "held" by its base, for computing; for pictures with all that is to be seen "seen held", and "seen standing" on a floor where it can.
    """
    if model.profile.model.kind == "human":
        return _built(model, kind)
    return _cached_model(job.robot or model.profile.name, kind)
