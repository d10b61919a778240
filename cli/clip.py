"""One clip, from its recording to its finished file and its JSON record: what a worker of `retarget convert` does."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from retarget.cli.console import Progress
from retarget.cli.plan import PIPE, Clip
from retarget.cli.tracker_logs import read_calibrated
from retarget.core.errors import UsageError

if TYPE_CHECKING:
    from retarget.core.pipeline import ConvertResult
    from retarget.core.replay.model import ReplayModel
    from retarget.core.robot_model import RobotModel
    from retarget.core.types import HumanMotion

Record = dict[str, Any]


@lru_cache(maxsize=16)
def robot_model(robot: str) -> RobotModel:
    """The model of a robot that needs no recording, built once per process."""
    from retarget import robots
    from retarget.core.robot_model import build

    return build(robots.load(robot))


def model_for(robot: str, motion: HumanMotion) -> RobotModel:
    """The robot's model, built from `motion` where the profile says so."""
    from retarget import robots
    from retarget.core.robot_model import build

    profile = robots.load(robot)
    return build(profile, motion) if profile.model.kind == "human" else robot_model(robot)


@lru_cache(maxsize=16)
def _solid_robot(robot: str) -> ReplayModel:
    """The robot's shapes in MuJoCo, built once per process."""
    from retarget.core.replay.model import build

    return build(robot_model(robot), base="fixed", self_collision=True)


def convert_clip(clip: Clip, progress: Progress | None = None) -> Record:
    """Read, convert and write `clip`; its record as `--json` prints it. Raises `RetargetError`, leaving nothing half-written."""
    from retarget import formats
    from retarget.core import pipeline

    started = time.perf_counter()
    motion = read_calibrated(clip.input, clip.calibration, clip.log)
    read_s = time.perf_counter() - started
    model = model_for(clip.robot, motion)
    model_s = time.perf_counter() - started - read_s
    result = pipeline.convert(motion, model, pipeline.ConvertOptions(**(clip.options or {})), progress)
    collide_s = _collide(clip, result) if clip.self_collision else {}
    person = result.motion if clip.human else None
    before_write = time.perf_counter()
    if clip.output == PIPE:
        stream = getattr(sys.stdout, "buffer", None)
        if stream is None:
            raise UsageError("stdout is closed")
        formats.write_trajectory_stream(stream, result.trajectory, format=clip.format, style=clip.style, motion=person)
        stream.flush()
    else:
        Path(clip.output).parent.mkdir(parents=True, exist_ok=True)
        formats.write_trajectory(
            clip.output,
            result.trajectory,
            format=clip.format,
            style=clip.style,
            motion=person,
            overwrite=clip.overwrite,
        )
    write_s = time.perf_counter() - before_write
    wall_s = time.perf_counter() - started
    if clip.report:
        _write_report(clip, result, model)
    stages = {"read": read_s, "model": model_s, **result.timings_s, **collide_s, "write": write_s}
    if clip.rerun:
        from retarget.cli import rerun_log

        rerun_log.write(clip.rerun, result)
    return _record(clip, result, wall_s, stages)


def _collide(clip: Clip, result: ConvertResult) -> dict[str, float]:
    """Fill in `self_collision_fraction`; the time that took. A person's model, built from the recording, has no shapes: it stays null."""
    from retarget.core.replay.kinematic import collision_fraction

    begin = time.perf_counter()
    if result.model.profile.model.kind != "human":
        result.metrics["self_collision_fraction"] = collision_fraction(result.trajectory, _solid_robot(clip.robot))
    return {"self-collision": time.perf_counter() - begin}


def failed_record(clip: Clip, error: str) -> Record:
    """The record of a clip that came to nothing: the same keys, without values."""
    keys = ["frames", "rate_hz", "duration_s", "wall_s", "frames_per_second", "metrics", "provenance"]
    return {**_head(clip, "failed", error), **dict.fromkeys(keys), "warnings": []}


def _head(clip: Clip, status: str, error: str | None) -> Record:
    return {
        "input": clip.input,
        "output": clip.output,
        "robot": clip.robot_name,
        "method": clip.method,
        "mapping": (clip.options or {}).get("mapping"),
        "status": status,
        "error": error,
    }


def _record(clip: Clip, result: ConvertResult, wall_s: float, stages: Mapping[str, float]) -> Record:
    trajectory = result.trajectory
    record: Record = without_nan(
        {
            **_head(clip, "ok", None),
            "frames": trajectory.frames,
            "rate_hz": trajectory.rate_hz,
            "duration_s": float(trajectory.time[-1] - trajectory.time[0]),
            "wall_s": wall_s,
            "frames_per_second": trajectory.frames / wall_s,
            "metrics": result.metrics,
            "warnings": list(result.motion.source.warnings),
            "provenance": trajectory.provenance,
            "stages_s": dict(stages),
        }
    )
    return record


def _write_report(clip: Clip, result: ConvertResult, model: RobotModel) -> None:
    from retarget.cli.report_page import Section, write_page

    name = Path(clip.input).name if clip.input != PIPE else "stdin"
    section = Section(title=f"{name} on {clip.robot_name}", result=result, model=model, output=clip.output)
    write_page(Path(clip.report), [section], overwrite=clip.overwrite)


def without_nan(value: Any) -> Any:
    """`value` as plain JSON types, NumPy numbers unpacked; numbers that JSON can't hold become None."""
    if isinstance(value, Mapping):
        return {str(key): without_nan(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [without_nan(item) for item in value]
    if hasattr(value, "tolist"):
        return without_nan(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
