"""One clip, from its recording to its finished file and its JSON record: what a worker of `retarget convert` does."""

from __future__ import annotations

import itertools
import math
import sys
import time
from collections.abc import Iterable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, cast

from retarget.cli.console import Progress
from retarget.cli.plan import PIPE, Clip
from retarget.cli.tracker_logs import read_calibrated, stream_calibrated
from retarget.core.errors import UsageError

if TYPE_CHECKING:
    from retarget.core.pipeline import ConvertResult
    from retarget.core.replay.model import ReplayModel
    from retarget.core.robot_model import RobotModel
    from retarget.core.types import HumanMotion

Record = dict[str, Any]

WHOLE_S = 30.0
"""Recordings up to here are converted as a whole, also to a pipe, with the same bytes as in a file; longer ones in blocks."""


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
    if may_be_converted_in_blocks(clip):
        parts = stream_calibrated(clip.input, clip.calibration, clip.log, WHOLE_S)
        head = list(itertools.islice(parts, 2))
        if len(head) > 1 or head[0].time[-1] - head[0].time[0] > WHOLE_S:
            return _convert_in_blocks(clip, itertools.chain(head, parts), started)
        motion = head[0]
    else:
        motion = read_calibrated(clip.input, clip.calibration, clip.log)
    read_s = time.perf_counter() - started
    model = model_for(clip.robot, motion)
    model_s = time.perf_counter() - started - read_s
    result = pipeline.convert(motion, model, pipeline.ConvertOptions(**(clip.options or {})), progress)
    collide_s = _collide(clip, result) if clip.self_collision else {}
    person = result.motion if clip.human else None
    before_write = time.perf_counter()
    if clip.output == PIPE:
        stream = _stdout()
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


def may_be_converted_in_blocks(clip: Clip) -> bool:
    """Whether `clip` goes to a pipe, in a form and with options that allow to begin before the recording's end."""
    from retarget import formats, robots
    from retarget.core import pipeline, streaming

    target = formats.get(clip.format)
    return (
        clip.output == PIPE
        and target.write_parts is not None
        and clip.style in (None, target.styles[0])
        and not (clip.human or clip.report or clip.rerun or clip.self_collision)
        and robots.load(clip.robot).model.kind != "human"
        and streaming.can_stream(pipeline.ConvertOptions(**(clip.options or {})))
    )


def _convert_in_blocks(clip: Clip, parts: Iterable[HumanMotion], started: float) -> Record:
    """Convert and write the motion that arrives in `parts`, a block at a time; the clip's record."""
    from retarget import formats
    from retarget.core import pipeline, streaming

    options = pipeline.ConvertOptions(**(clip.options or {}))
    stream = _stdout()
    conversion = streaming.StreamedConversion(parts, robot_model(clip.robot), options)
    formats.write_trajectory_parts(stream, conversion, format=clip.format)
    stream.flush()
    wall_s = time.perf_counter() - started
    duration_s = conversion.time_s[1] - conversion.time_s[0]
    record: Record = without_nan(
        {
            **_head(clip, "ok", None),
            "frames": conversion.frames,
            "rate_hz": (conversion.frames - 1) / duration_s if duration_s > 0 else 0.0,
            "duration_s": duration_s,
            "wall_s": wall_s,
            "frames_per_second": conversion.frames / wall_s,
            "metrics": conversion.metrics,
            "warnings": list(conversion.source.warnings),
            "provenance": conversion.provenance,
            "stages_s": {**conversion.timings_s, "write": max(0.0, wall_s - sum(conversion.timings_s.values()))},
        }
    )
    return record


def _stdout() -> BinaryIO:
    stream = getattr(sys.stdout, "buffer", None)
    if stream is None:
        raise UsageError("stdout is closed")
    return cast(BinaryIO, stream)


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
