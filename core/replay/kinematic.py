"""The fast gate: what a trajectory's numbers alone tell, without dynamics.

| asks | of |
|---|---|
| can every joint be there, and get there in time? | `joint_checks`: ranges, coupled ranges, speeds, accelerations, jumps, stored velocities |
| does the robot stand in the world as it should? | `base_checks`: floor, feet, tilt, speed, quaternion order |
| do links run into each other? | the collision function that is given |
| does it do what the person did? | `recording_check`: the limbs' directions, where the recording is at hand |
| does each joint do what was written for it? | `written_range_check`: its range, where the file keeps it |
| are frames missing? | here: gaps in time, frames that the solver marked |

Which limit each check has, and why, stands in `thresholds.KINEMATIC`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from retarget.core.replay.base_checks import check_base
from retarget.core.replay.joint_checks import check_joints
from retarget.core.replay.match import matched
from retarget.core.replay.recording_check import check_recording
from retarget.core.replay.thresholds import KINEMATIC, Thresholds
from retarget.core.replay.written_range_check import check_written_range
from retarget.core.report import Check, ValidationReport
from retarget.core.robot_model import RobotModel
from retarget.core.types import Array, HumanMotion, JointTrajectory

if TYPE_CHECKING:
    from retarget.core.replay.collisions import SelfCollisions
    from retarget.core.replay.model import ReplayModel

MODE = "kinematic"
HULL_ERROR_M = 0.02
"""Overlaps of convex hulls that are deeper than this are only believed if the meshes meet, too; with a lower limit those beyond the limit."""

Collide = Callable[[JointTrajectory], "SelfCollisions"]
"""Finds self-collisions of a trajectory whose joints stand in the model's order."""


def check(
    trajectory: JointTrajectory,
    replay: ReplayModel,
    thresholds: Thresholds | None = None,
    motion: HumanMotion | None = None,
) -> ValidationReport:
    """The report on `trajectory`, whose joints may stand in any order; `replay` is built with `self_collision`.

    motion: the recording it was retargeted from, where it is at hand.
    series: (T,) each: "time", "problem/<joint or place>" (1 = at a limit) for a strip of problems over time, "foot_height_m/<side>" …
    facts: "self_collision_pairs", deepest first; "self_collision_hulls_only", overlaps that were left out as the meshes don't meet; and others.
    Raises `InvalidDataError` for joints that are not the model's (`match.matched`).
    """
    from retarget.core.replay.collisions import self_collisions

    limits = thresholds or Thresholds(MODE)
    limit_mm = limits.limits["self_collision_depth_mm"]
    doubted_m = HULL_ERROR_M if limit_mm is None else min(limit_mm / 1e3, HULL_ERROR_M)
    return check_numbers(
        trajectory,
        replay.robot,
        limits,
        motion,
        lambda given: self_collisions(replay, given.position, doubted_m=doubted_m),
    )


def collision_fraction(trajectory: JointTrajectory, replay: ReplayModel) -> float | None:
    """Part of the frames in which links overlap by more than `HULL_ERROR_M`, which `check` doesn't let pass by default; None for robots without shapes.

    `replay` is built with `self_collision`, and the trajectory's joints stand in its order.
    """
    from retarget.core.replay.collisions import self_collisions

    found = self_collisions(replay, trajectory.position, doubted_m=HULL_ERROR_M)
    return float((found.depth_m > HULL_ERROR_M).mean()) if found.links else None


def check_numbers(
    trajectory: JointTrajectory,
    model: RobotModel,
    thresholds: Thresholds | None = None,
    motion: HumanMotion | None = None,
    collide: Collide | None = None,
) -> ValidationReport:
    """As `check`, needing no physics engine; without `collide` self-collision is not judged."""
    limits = thresholds or Thresholds(MODE)
    trajectory = matched(trajectory, model)
    person, person_series = check_recording(trajectory, model, motion, limits)
    joints, series = check_joints(trajectory, model, limits)
    written, written_series = check_written_range(trajectory, limits)
    series |= {name: np.maximum(series[name], strip) for name, strip in written_series.items()}
    base, base_series = check_base(trajectory, model, limits)
    found = collide(trajectory) if collide else None
    touch, touch_series, pairs = _collisions(trajectory, limits, found)
    hulls_only = [
        {"links": list(links), "depth_mm": 1e3 * depth} for links, depth in (found.hulls_only if found else {}).items()
    ]
    timing, timing_series = _timing(trajectory, limits)
    series = {**series, **base_series, **touch_series, **timing_series, **person_series}
    for values in series.values():
        values.flags.writeable = False  # the report keeps such arrays as they are, and copies others
    by_name = {entry.name: entry for entry in (*joints, *written, *touch, *base, *timing, *person)}
    return ValidationReport(
        subject=model.profile.name,
        checks=tuple(by_name[row.name] for row in KINEMATIC),
        series={"time": trajectory.time, **series},
        mode=MODE,
        facts={
            "frames": trajectory.frames,
            "rate_hz": trajectory.rate_hz,
            "self_collision_pairs": pairs,
            "self_collision_hulls_only": hulls_only,
        },
    )


def _collisions(
    trajectory: JointTrajectory, thresholds: Thresholds, found: SelfCollisions | None
) -> tuple[list[Check], dict[str, Array], list[dict[str, Any]]]:
    names = ("self_collision_depth_mm", "self_collision_percent")
    if found is None:
        return [thresholds.check(name, None, "collisions were not looked for") for name in names], {}, []
    depth = 1e3 * found.depth_m
    pairs: list[dict[str, Any]] = [
        {"links": list(links), "depth_mm": 1e3 * deepest, "time_s": float(trajectory.time[frame]), "frames": frames}
        for links, (deepest, frame, frames) in found.by_pair().items()
    ]
    where, when = (" and ".join(pairs[0]["links"]), pairs[0]["time_s"]) if pairs else ("", None)
    others = f"{len(pairs)} pairs touch" if len(pairs) > 1 else ""
    checks = [
        thresholds.check(names[0], float(depth.max()), others, where=where, time_s=when),
        thresholds.check(names[1], 100 * float((depth > 0).mean())),
    ]
    limit = thresholds.limits[names[0]]
    strip = {"problem/self-collision": depth / limit} if limit else {}
    return checks, {"self_collision_depth_mm": depth} | strip, pairs


def _timing(trajectory: JointTrajectory, thresholds: Thresholds) -> tuple[list[Check], dict[str, Array]]:
    marked = np.flatnonzero(trajectory.status)
    when = float(trajectory.time[marked[0]]) if len(marked) else None
    checks = [
        thresholds.check("marked_frames", len(marked), "the first of them" if len(marked) > 1 else "", time_s=when)
    ]
    if trajectory.frames < 2:
        return [*checks, thresholds.check("time_gap_ratio", None, "a single frame has no gaps")], {}
    steps = np.diff(trajectory.time)
    at, usual = int(np.argmax(steps)), float(np.median(steps))
    ratio = steps / usual
    note = f"{steps[at]:.4f} s after the frame there, {usual:.4f} s is usual" if ratio[at] > 1.5 else ""
    time_s = float(trajectory.time[at]) if note else None
    checks.append(thresholds.check("time_gap_ratio", float(ratio[at]), note, time_s=time_s))
    limit = thresholds.limits["time_gap_ratio"]
    if not limit:
        return checks, {}
    problem = np.where(ratio > 1.5, ratio / limit, 0.0)
    return checks, {"problem/timing": np.maximum(np.concatenate([[0.0], problem]), trajectory.status)}
