"""Writes a converted clip as a Rerun recording (.rrd): person, targets, robot and errors on one timeline, `time`.

| entity | holds |
|---|---|
| `/` | right-handed, Z up |
| `/human/bones`, `/robot/bones` | stick figures in the one world of both |
| `/robot/links` | axes (x red, y green, z blue) of the links that have an orientation to follow |
| `/targets/orientations` | the axes that these links should have, at the same places |
| `/targets/positions` | points that position tasks ask for |
| `/joints/<name>` | joint values, rad |
| `/errors/…` | the series behind the metrics, by their names |

Needs the extra `rerun`. Whole columns are sent at once: a clip costs a few calls, not a few a frame. Numbers stand at every frame, figures
at most 60 times a second.
"""

from __future__ import annotations

import hashlib
import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from retarget.cli.plan import write_whole
from retarget.core import rotations
from retarget.core.errors import UsageError
from retarget.core.kinematics import Poses
from retarget.core.pipeline import ConvertResult
from retarget.core.types import Array

if TYPE_CHECKING:
    from retarget.core.stick_figure import Bones

AXIS_M = 0.08
FIGURES_HZ = 60.0
HUMAN, ROBOT, TARGET = (70, 130, 220), (230, 140, 40), (40, 170, 90)
AXES = ((220, 50, 50), (60, 170, 60), (60, 90, 220))
MISSING = "--rerun needs the package rerun-sdk, which is not installed; expected it from pip install 'retarget[rerun]'"


def check_installed() -> None:
    """Raise `UsageError` unless Rerun's SDK is there."""
    _rerun()


def write(path: str | Path, result: ConvertResult) -> None:
    """Write `result` to the file `path`, which appears whole or not at all and replaces one that is there.

    Raises `UsageError` without Rerun's SDK.
    """
    rr = _rerun()
    trajectory = result.trajectory
    # Recordings of one id are one recording to the viewer: the id says what was converted and how.
    facts = json.dumps([dict(trajectory.provenance), trajectory.robot], sort_keys=True, default=str)
    recording = rr.RecordingStream("retarget", recording_id=hashlib.sha256(facts.encode()).hexdigest()[:32])
    # Into memory, as the SDK writes files in a thread of its own, where a full disk is nobody's error.
    memory = recording.memory_recording()
    _log(rr, recording, result)
    write_whole(path, memory.drain_as_bytes())


def _rerun() -> Any:
    try:
        import rerun
    except ImportError:
        raise UsageError(MISSING) from None
    if not (hasattr(rerun, "send_columns") and hasattr(rerun, "TimeColumn")):
        raise UsageError(f"--rerun needs rerun-sdk 0.23 or newer; found {rerun.__version__}")
    return rerun


def _log(rr: Any, recording: Any, result: ConvertResult) -> None:
    series, trajectory = result.series, result.trajectory
    step = max(1, math.ceil(trajectory.rate_hz / FIGURES_HZ - 0.01))
    some = rr.TimeColumn("time", duration=trajectory.time[::step])

    def send_figure(entity: str, columns: Any) -> None:
        rr.send_columns(entity, indexes=[some], columns=columns, recording=recording, strict=True)

    def send_number(names: list[str], values: Array) -> None:
        columns = rr.Scalars.columns(scalars=values)
        # A series of steps between frames has a value less: each stands at its step's end.
        every = rr.TimeColumn("time", duration=trajectory.time[-len(values) :])
        # As parts, so that Rerun escapes what names hold.
        path = rr.new_entity_path(names)
        rr.send_columns(path, indexes=[every], columns=columns, recording=recording, strict=True)

    rr.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True, recording=recording)
    for name, colour in (("human", HUMAN), ("robot", ROBOT)):
        strips = _bones(series[f"{name}_points"][::step], series[f"{name}_bones"])
        if strips.shape[1]:
            rr.log(f"/{name}/bones", rr.LineStrips3D.from_fields(colors=[colour]), static=True, recording=recording)
            send_figure(f"/{name}/bones", _strips(rr, strips))
    achieved, wanted, points = _tasks(result, step)
    for entity, axes in (("/robot/links", achieved), ("/targets/orientations", wanted)):
        if axes.shape[1]:
            colours = np.tile(np.array(AXES, np.uint8), (axes.shape[1] // 3, 1))
            rr.log(entity, rr.LineStrips3D.from_fields(colors=colours), static=True, recording=recording)
            send_figure(entity, _strips(rr, axes))
    if points.shape[1]:
        style = rr.Points3D.from_fields(colors=[TARGET], radii=[0.015])
        rr.log("/targets/positions", style, static=True, recording=recording)
        columns = rr.Points3D.columns(positions=points.reshape(-1, 3))
        send_figure("/targets/positions", columns.partition([points.shape[1]] * len(points)))
    for i, joint in enumerate(trajectory.joint_names):
        send_number(["joints", joint], trajectory.position[:, i])
    for name, values in result.measured_series.items():
        send_number(["errors", *name.split("/")], values)


def _bones(points: Array, bones: Bones) -> Array:
    """Both ends (T, B, 2, 3) of each bone; none at all where a point is not finite throughout."""
    known = np.asarray(np.isfinite(points).all(axis=(0, 2)))
    bones = bones[known[bones].all(axis=1)] if len(bones) else bones
    return points[:, bones] if len(bones) else np.zeros((len(points), 0, 2, 3))


def _strips(rr: Any, strips: Array) -> Any:
    """A column of line strips (T, B, 2, 3), B in each row."""
    columns = rr.LineStrips3D.columns(strips=strips.reshape(-1, 2, 3).astype(np.float32))
    return columns.partition([strips.shape[1]] * len(strips))


def _tasks(result: ConvertResult, step: int) -> tuple[Array, Array, Array]:
    """Axes (T, 3 K, 2, 3) that the K links with orientation tasks have and should have, and points (T, L, 3) of position tasks.

    T: every `step`-th frame.
    """
    trajectory, tasks, model = result.trajectory, result.targets.tasks, result.model
    joints = trajectory.position[::step]
    base = None if trajectory.base_orientation is None else trajectory.base_orientation[::step]
    place = None if trajectory.base_position is None else trajectory.base_position[::step]
    achieved = wanted = np.zeros((len(joints), 0, 2, 3))
    points = np.zeros((len(joints), 0, 3))
    if turned := [task for task in tasks if task.kind == "orientation"]:
        poses = Poses.of(model, [task.frame for task in turned], joints, base, place)
        found = [poses.at(task.frame) for task in turned]
        values = [rotations.to_matrix(task.value[::step]) for task in turned]
        achieved = np.concatenate([_axes(rotation, origin) for rotation, origin in found], axis=1)
        wanted = np.concatenate([_axes(v, origin) for v, (_, origin) in zip(values, found, strict=True)], axis=1)
    if placed := [task.value[::step] for task in tasks if task.kind == "position"]:
        points = np.stack(placed, axis=1)
        if place is not None and base is not None:
            # Position tasks are in the world of a robot that stands upright at the origin.
            turn = rotations.to_matrix(base) @ rotations.to_matrix(model.base_rotation).T
            points = np.einsum("tij,tkj->tki", turn, points) + place[:, None]
    return achieved, wanted, points


def _axes(rotation: Array, origin: Array) -> Array:
    """Line segments (T, 3, 2, 3) from `origin` (T, 3) along the axes of `rotation` (T, 3, 3)."""
    tips = origin[:, None] + AXIS_M * rotation.swapaxes(1, 2)
    return np.stack([np.broadcast_to(origin[:, None], tips.shape), tips], axis=2)
