"""Joint values against the robot's limits, and against what moves smoothly: ranges, speeds, accelerations, jumps, stored velocities."""

from __future__ import annotations

import numpy as np
from retarget.core import metrics
from retarget.core.replay.signals import Signal, held, local_jumps, worst
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
    names, time, frames = trajectory.joint_names, trajectory.time, trajectory.frames
    rounding = position_rounding(trajectory.position)
    figures, series = metrics.limit_figures(trajectory, model, rounding)
    excess = np.maximum(model.lower - trajectory.position, trajectory.position - model.upper)
    excess = np.where(excess > rounding, excess, 0.0)
    far = worst(np.degrees(excess), time, names)
    checks = [
        thresholds.check("position_limit_violations", figures["position_limit_violations"], _which(excess > 0, far), where=far.where, time_s=far.time_s),
        thresholds.check("position_limit_excess_deg", far.value, _range(model, trajectory, far), where=far.where, time_s=far.time_s),
        _coupled(trajectory, model, thresholds, rounding),
    ]  # fmt: skip
    problem = np.where(excess > 0, 1.0 + excess / ONE_DEGREE, 0.0)
    if frames < 2:
        checks += [thresholds.check(name, None, "a single frame has no speed") for name in _SPEEDS]
        return checks, series | _strips(names, problem)
    step = np.diff(time)[:, None]
    speed = np.diff(trajectory.position, axis=0) / step
    ratio = np.abs(speed) / model.velocity_limit
    fast = worst(held(ratio, frames), time, names)
    over = ratio > 1.0 + metrics.ROUNDING
    too_fast = figures["velocity_limit_violations"]
    # A step at the limit, rounded, is at the limit.
    fastest = figures["max_velocity_ratio"] if too_fast else min(figures["max_velocity_ratio"], 1.0)
    acceleration = _derivative(speed, (step[1:] + step[:-1]) / 2)
    jerk = _derivative(acceleration, (step[2:] + step[1:-1] + step[:-2]) / 3)
    sharp, rough = (
        worst(held(np.abs(acceleration), frames), time, names),
        worst(held(np.abs(jerk), frames), time, names),
    )
    jumps = held(np.abs(local_jumps(trajectory.position, time)), frames)
    jump = worst(jumps, time, names)
    checks += [
        thresholds.check("velocity_limit_violations", too_fast, _which(over, fast) if too_fast else "", where=fast.where, time_s=fast.time_s),
        thresholds.check("velocity_ratio_max", fastest, where=fast.where, time_s=fast.time_s),
        _mismatch(trajectory, speed, thresholds),
        thresholds.check("acceleration_max_rad_s2", sharp.value, where=sharp.where, time_s=sharp.time_s),
        thresholds.check("jerk_rms_rad_s3", metrics.jerk_rms(trajectory), f"most in {names[int(np.argmax((jerk**2).sum(axis=0)))]}" if len(jerk) else ""),
        thresholds.check("jerk_max_rad_s3", rough.value, where=rough.where, time_s=rough.time_s),
        thresholds.check("joint_jump_max_rad", jump.value, where=jump.where, time_s=jump.time_s),
    ]  # fmt: skip
    problem = np.maximum(problem, held(ratio, frames))
    for values, name in (
        (held(np.abs(acceleration), frames), "acceleration_max_rad_s2"),
        (jumps, "joint_jump_max_rad"),
    ):
        if limit := thresholds.limits[name]:
            problem = np.maximum(problem, values / limit)
    return checks, series | _strips(names, problem)


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
    if np.array_equal(position, position.astype(np.float32)):
        return max(metrics.ROUNDING, SINGLE_PRECISION * float(np.abs(position).max(initial=1.0)))
    return metrics.ROUNDING


def _coupled(trajectory: JointTrajectory, model: RobotModel, thresholds: Thresholds, rounding: float) -> Check:
    """The linear rows over several joints; a row's excess is divided by its largest coefficient to be an angle."""
    if not model.coupled:
        return thresholds.check("coupled_limit_excess_deg", None, "the robot has no coupled joints")
    rows, labels = [], []
    for coupled in model.coupled:
        value = trajectory.position[:, [model.joint_index(name) for name in coupled.joints]] @ coupled.matrix.T
        outside = np.maximum(coupled.lower - value, value - coupled.upper) / np.abs(coupled.matrix).max(axis=1)
        rows.append(np.where(outside > 2 * rounding, outside, 0.0))
        labels += [" + ".join(np.array(coupled.joints)[row != 0]) for row in coupled.matrix]
    far = worst(np.degrees(np.hstack(rows)), trajectory.time, labels)
    return thresholds.check("coupled_limit_excess_deg", far.value, where=far.where, time_s=far.time_s)


def _mismatch(trajectory: JointTrajectory, speed: Array, thresholds: Thresholds) -> Check:
    """Stored velocities beside those of the positions, both in the middle of each step.

    Positions that were resampled, scaled in time or sorted into another joint order without their velocities show here, also on robots
    whose limits are far away.
    """
    stored = (trajectory.velocity[1:] + trajectory.velocity[:-1]) / 2
    size = max(float(np.sqrt(np.mean(v**2))) for v in (stored, speed))
    if size < STILL_RAD_S:
        return thresholds.check("velocity_mismatch_percent", 0.0, "the joints stand still")
    off = stored - speed
    percent = 100 * float(np.sqrt(np.mean(off**2))) / size
    joint = int(np.argmax((off**2).sum(axis=0)))
    frame = int(np.argmax(np.abs(off[:, joint]))) + 1
    note = ""
    if (energy := float((stored**2).sum())) > 0:
        factor = float((stored * speed).sum()) / energy
        rest = float(np.sqrt(np.mean((speed - factor * stored) ** 2))) / size
        if abs(factor - 1) > 0.1 and 100 * rest < percent / 2:
            note = f"the positions move {factor:.2f} times as fast as the stored velocities: played at another rate?"
    else:
        note = "the stored velocities are all zero"
    return thresholds.check(
        "velocity_mismatch_percent",
        percent,
        note,
        where=trajectory.joint_names[joint],
        time_s=float(trajectory.time[frame]),
    )


def _which(over: BoolArray, most: Signal) -> str:
    """How many joints and frames are over their limit, when any are."""
    return (
        f"{int(over.any(axis=0).sum())} joints in {int(over.any(axis=1).sum())} frames"
        if most.value > 0 and over.any()
        else ""
    )


def _range(model: RobotModel, trajectory: JointTrajectory, far: Signal) -> str:
    if far.index is None:
        return ""
    frame, joint = far.index
    return f"{trajectory.position[frame, joint]:.4f}, range {model.lower[joint]:.4f} to {model.upper[joint]:.4f} rad"


def _derivative(values: Array, step: Array) -> Array:
    """Differences of `values` (K, n) along time, `step` (K-1, 1) s apart; none of fewer than two."""
    return np.diff(values, axis=0) / step if len(values) > 1 else np.zeros((0, values.shape[1]))


def _strips(names: tuple[str, ...], problem: Array) -> dict[str, Array]:
    return {f"problem/{name}": problem[:, i] for i, name in enumerate(names)}
