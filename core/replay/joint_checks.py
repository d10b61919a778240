"""Joint values against the robot's limits, and against what moves smoothly: ranges, speeds, accelerations, jumps, stored velocities."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from retarget.core import metrics
from retarget.core.chunks import frame_chunks, gathered
from retarget.core.replay.signals import Signal, held, jumps_of, larger, worst
from retarget.core.replay.thresholds import Thresholds
from retarget.core.report import Check
from retarget.core.robot_model import RobotModel
from retarget.core.types import Array, BoolArray, JointTrajectory

SINGLE_PRECISION = float(np.finfo(np.float32).eps)
STILL_RAD_S = 1e-3
"""Joints slower than this (root mean square) stand still: comparing velocities would compare rounding."""
ONE_DEGREE = np.radians(1.0)


def check_joints(
    trajectory: JointTrajectory, model: RobotModel, thresholds: Thresholds
) -> tuple[list[Check], dict[str, Array]]:
    """(checks, per-frame series); the joints of `trajectory` stand in the model's order.

    series["problem/<joint>"]: (T,) the worst of that joint's speed, acceleration and jump beside their limits, 1 = at the limit; a
    position outside its range counts 1 and 1 more each degree.
    """
    names, frames = trajectory.joint_names, trajectory.frames
    rounding = position_rounding(trajectory.position)
    figures, series = metrics.limit_figures(trajectory, model, rounding)
    # First what needs a number for each joint and frame for itself: afterwards the strips take that room.
    jerk_rms = metrics.jerk_rms(trajectory)
    mismatch = _mismatch(trajectory, thresholds)
    strips = np.zeros((len(names), frames))
    checks = [
        *_ranges(trajectory, model, thresholds, rounding, figures, strips),
        _coupled(trajectory, model, thresholds, rounding),
    ]
    if frames < 2:
        checks += [thresholds.check(name, None, "a single frame has no speed") for name in _SPEEDS]
    else:
        checks += [mismatch, *_motion(trajectory, model, thresholds, figures, jerk_rms, strips)]
    strips.flags.writeable = False  # the report keeps read-only arrays as they are, and copies others
    return checks, series | {f"problem/{name}": strip for name, strip in zip(names, strips, strict=True)}


def _ranges(
    trajectory: JointTrajectory,
    model: RobotModel,
    thresholds: Thresholds,
    rounding: float,
    figures: Mapping[str, Any],
    strips: Array,
) -> list[Check]:
    """Positions beside the joints' ranges; raises `strips` (n, T) where they are outside."""
    far, out = Signal(0.0), _Over(len(model.lower))
    for part in frame_chunks(trajectory.frames):
        excess = beyond(trajectory.position[part], model.lower, model.upper, rounding)
        far = larger(far, worst(np.degrees(excess), trajectory.time, trajectory.joint_names, part.start))
        out.add(excess > 0)
        _raise(strips, part, np.where(excess > 0, 1.0 + excess / ONE_DEGREE, 0.0))
    return [
        thresholds.check("position_limit_violations", figures["position_limit_violations"], out.words(far), where=far.where, time_s=far.time_s),
        thresholds.check("position_limit_excess_deg", far.value, _range(model, trajectory, far), where=far.where, time_s=far.time_s),
    ]  # fmt: skip


def _motion(
    trajectory: JointTrajectory,
    model: RobotModel,
    thresholds: Thresholds,
    figures: Mapping[str, Any],
    jerk_rms: float,
    strips: Array,
) -> list[Check]:
    """Speeds, accelerations, jerks and jumps of two frames or more; raises `strips` (n, T) by what has a limit."""
    names, time = trajectory.joint_names, trajectory.time
    fast = sharp = rough = jump = Signal(0.0)
    over, jerks = _Over(len(names)), np.zeros(len(names))
    jumps_at = jumps_of(trajectory.position, time)
    for part in frame_chunks(trajectory.frames):
        speed, acceleration, jerk = _derivatives(trajectory, part)
        ratio = np.abs(speed) / model.velocity_limit
        jumps = held(np.abs(jumps_at(slice(max(part.start - 1, 0), part.stop - 1))), part.stop - part.start)
        fast = larger(fast, worst(ratio, time, names, part.start))
        sharp = larger(sharp, worst(np.abs(acceleration), time, names, part.start))
        rough = larger(rough, worst(np.abs(jerk), time, names, part.start))
        jump = larger(jump, worst(jumps, time, names, part.start))
        over.add(ratio > 1.0 + metrics.ROUNDING)
        jerks += (jerk**2).sum(axis=0)
        _raise(strips, part, ratio)
        for values, name in ((np.abs(acceleration), "acceleration_max_rad_s2"), (jumps, "joint_jump_max_rad")):
            if limit := thresholds.limits[name]:
                _raise(strips, part, values / limit)
    too_fast = figures["velocity_limit_violations"]
    # A step at the limit, rounded, is at the limit.
    fastest = figures["max_velocity_ratio"] if too_fast else min(figures["max_velocity_ratio"], 1.0)
    most = f"most in {names[int(np.argmax(jerks))]}" if trajectory.frames > 3 else ""
    return [
        thresholds.check("velocity_limit_violations", too_fast, over.words(fast) if too_fast else "", where=fast.where, time_s=fast.time_s),
        thresholds.check("velocity_ratio_max", fastest, where=fast.where, time_s=fast.time_s),
        thresholds.check("acceleration_max_rad_s2", sharp.value, where=sharp.where, time_s=sharp.time_s),
        thresholds.check("jerk_rms_rad_s3", jerk_rms, most),
        thresholds.check("jerk_max_rad_s3", rough.value, where=rough.where, time_s=rough.time_s),
        thresholds.check("joint_jump_max_rad", jump.value, where=jump.where, time_s=jump.time_s),
    ]  # fmt: skip


def _derivatives(trajectory: JointTrajectory, part: slice) -> tuple[Array, Array, Array]:
    """Speed, acceleration and jerk (K, n) of the frames in `part`, by differences: each at the frame in which it shows, 0 before."""
    window = slice(max(part.start - 3, 0), part.stop)
    step = np.diff(trajectory.time[window])[:, None]
    speed = np.diff(trajectory.position[window], axis=0) / step
    acceleration = _differences(speed, (step[1:] + step[:-1]) / 2)
    jerk = _differences(acceleration, (step[2:] + step[1:-1] + step[:-2]) / 3)
    frames, before = window.stop - window.start, part.start - window.start
    return held(speed, frames)[before:], held(acceleration, frames)[before:], held(jerk, frames)[before:]


class _Over:
    """How many joints and frames are over their limit."""

    def __init__(self, joints: int) -> None:
        self._joints, self._frames = np.zeros(joints, bool), 0

    def add(self, over: BoolArray) -> None:
        """Count the next frames (K, n) in."""
        self._joints |= over.any(axis=0)
        self._frames += int(over.any(axis=1).sum())

    def words(self, most: Signal) -> str:
        """For the note beside the largest value; "" when none is over."""
        joints = int(self._joints.sum())
        return f"{joints} joints in {self._frames} frames" if most.value > 0 and self._frames else ""


def _raise(strips: Array, part: slice, values: Array) -> None:
    """Make `strips` (n, T) at least `values` (K, n) in the frames `part`."""
    np.maximum(strips[:, part], values.T, out=strips[:, part])


_SPEEDS = (
    "velocity_limit_violations",
    "velocity_ratio_max",
    "velocity_mismatch_percent",
    "acceleration_max_rad_s2",
    "jerk_rms_rad_s3",
    "jerk_max_rad_s3",
    "joint_jump_max_rad",
)


def position_rounding(position: Array) -> float:
    """How far (rad) a value at its limit may lie outside for its number format alone.

    Files of learning pipelines hold single precision: a joint clipped to its limit there comes back up to half a unit in the last place
    outside. That all values are single-precision numbers tells such a file.
    """
    chunks = [position[part] for part in frame_chunks(len(position))]
    if all(np.array_equal(values, values.astype(np.float32)) for values in chunks):
        largest = max(float(np.abs(values).max(initial=1.0)) for values in chunks)
        return max(metrics.ROUNDING, SINGLE_PRECISION * largest)
    return metrics.ROUNDING


def beyond(position: Array, lower: Array, upper: Array, rounding: float) -> Array:
    """How far `position` (K, n) lies outside `lower` to `upper`, each (n,); 0 inside, and where `rounding` may have moved it out."""
    outside = np.maximum(lower - position, position - upper)
    return np.where(outside > rounding, outside, 0.0)


def _coupled(trajectory: JointTrajectory, model: RobotModel, thresholds: Thresholds, rounding: float) -> Check:
    """The linear rows over several joints; a row's excess is divided by its largest coefficient to be an angle."""
    if not model.coupled:
        return thresholds.check("coupled_limit_excess_deg", None, "the robot has no coupled joints")
    labels = [" + ".join(np.array(c.joints)[row != 0]) for c in model.coupled for row in c.matrix]
    far = Signal(0.0)
    for part in frame_chunks(trajectory.frames):
        rows = []
        for coupled in model.coupled:
            value = (
                trajectory.position[part][:, [model.joint_index(name) for name in coupled.joints]] @ coupled.matrix.T
            )
            outside = np.maximum(coupled.lower - value, value - coupled.upper) / np.abs(coupled.matrix).max(axis=1)
            rows.append(np.where(outside > 2 * rounding, outside, 0.0))
        far = larger(far, worst(np.degrees(np.hstack(rows)), trajectory.time, labels, part.start))
    return thresholds.check("coupled_limit_excess_deg", far.value, where=far.where, time_s=far.time_s)


def _mismatch(trajectory: JointTrajectory, thresholds: Thresholds) -> Check:
    """Stored velocities beside those of the positions, both in the middle of each step.

    Positions that were resampled, scaled in time or sorted into another joint order without their velocities show here, also on robots
    whose limits are far away.
    """
    name, count = "velocity_mismatch_percent", (trajectory.frames - 1) * len(trajectory.joint_names)
    if not count:
        return thresholds.check(name, None, "a single frame has no speed")
    stored_squares, _ = _sums(trajectory, lambda stored, _: stored**2)
    speed_squares, _ = _sums(trajectory, lambda _, speed: speed**2)
    size = float(np.sqrt(max(stored_squares, speed_squares) / count))
    if size < STILL_RAD_S:
        return thresholds.check(name, 0.0, "the joints stand still")
    squares, of_joints = _sums(trajectory, lambda stored, speed: (stored - speed) ** 2)
    percent = 100 * float(np.sqrt(squares / count)) / size
    joint = int(np.argmax(of_joints))
    stored, speed = _step_velocities(trajectory, slice(0, trajectory.frames - 1), slice(joint, joint + 1))
    frame = int(np.argmax(np.abs(stored - speed))) + 1
    note = ""
    if stored_squares > 0:
        factor = _sums(trajectory, lambda stored, speed: stored * speed)[0] / stored_squares
        rest, _ = _sums(trajectory, lambda stored, speed: (speed - factor * stored) ** 2)
        if abs(factor - 1) > 0.1 and 100 * float(np.sqrt(rest / count)) / size < percent / 2:
            note = f"the positions move {factor:.2f} times as fast as the stored velocities: played at another rate?"
    else:
        note = "the stored velocities are all zero"
    return thresholds.check(
        name,
        percent,
        note,
        where=trajectory.joint_names[joint],
        time_s=float(trajectory.time[frame]),
    )


def _sums(trajectory: JointTrajectory, compute: Callable[[Array, Array], Array]) -> tuple[float, Array]:
    """The sum, and that of each joint (n,), over all steps of what `compute` makes of stored velocities and those of the positions."""
    names, steps = trajectory.joint_names, trajectory.frames - 1
    values = gathered(steps, lambda part: compute(*_step_velocities(trajectory, part)), (len(names),))
    return float(values.sum()), values.sum(axis=0)


def _step_velocities(trajectory: JointTrajectory, part: slice, joints: slice = slice(None)) -> tuple[Array, Array]:
    """Stored velocities and those of the positions (K, n), in the middle of each of the steps `part`."""
    frames = slice(part.start, part.stop + 1)
    stored = trajectory.velocity[frames, joints]
    speed = np.diff(trajectory.position[frames, joints], axis=0) / np.diff(trajectory.time[frames])[:, None]
    return (stored[1:] + stored[:-1]) / 2, speed


def _range(model: RobotModel, trajectory: JointTrajectory, far: Signal) -> str:
    if far.index is None:
        return ""
    frame, joint = far.index
    return f"{trajectory.position[frame, joint]:.4f}, range {model.lower[joint]:.4f} to {model.upper[joint]:.4f} rad"


def _differences(values: Array, step: Array) -> Array:
    """Differences of `values` (K, n) along time, `step` (K-1, 1) s apart; none of fewer than two."""
    return np.diff(values, axis=0) / step if len(values) > 1 else np.zeros((0, values.shape[1]))
