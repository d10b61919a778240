"""What a retargeted clip is worth, measured on the written joint values by forward kinematics. Keys as in the command line's contract."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from retarget.core import rotations
from retarget.core.chunks import frame_chunks, gathered
from retarget.core.contacts import foot_contacts
from retarget.core.kinematics import Poses, position_errors
from retarget.core.mapping.limb_plane import bone_direction
from retarget.core.robot_model import RobotModel
from retarget.core.segments import LIMB_END
from retarget.core.solve.base import foot_links, sole_corners
from retarget.core.types import Array, BoolArray, HumanMotion, JointTrajectory, Targets

ROUNDING = 1e-9
"""Limits are counted with no tolerance beyond floating-point rounding."""
SOLE_ON_GROUND_M = 0.01
"""A sole whose centre is lower than this counts as standing: its horizontal speed is skating."""


def measure(
    trajectory: JointTrajectory, model: RobotModel, motion: HumanMotion, targets: Targets
) -> tuple[dict[str, Any], dict[str, Array]]:
    """(metrics, per-frame series behind them). `motion` and `targets` are what was retargeted, frame for frame.

    All errors are degrees, over measured and mapped segments. Feet figures are None for robots without feet or with a fixed base.
    """
    series: dict[str, Array] = {}
    links = [*(limb.link for limb in model.limbs.values()), *(task.frame for task in targets.tasks)]
    poses = Poses.along(trajectory, model, [*links, *foot_links(model)])
    limb = limb_direction_errors(trajectory, model, motion, poses)
    link = orientation_errors(trajectory, model, targets, poses)
    series |= {f"limb_direction_error_deg/{segment}": error for segment, error in limb.items()}
    series |= {f"orientation_error_deg/{segment}": error for segment, error in link.items()}
    skate, penetration, feet = foot_figures(trajectory, model, foot_contacts(motion), poses)
    series |= feet
    hands = {name: 1e3 * error for name, error in position_errors(model, targets, trajectory.position).items()}
    series |= {f"hand_position_error_mm/{segment}": error for segment, error in hands.items()}
    limits, limit_series = limit_figures(trajectory, model)
    series |= limit_series
    metrics: dict[str, Any] = {
        "limb_direction_error_deg": _summary(limb, "per_limb"),
        "orientation_error_deg": _summary(link, "per_link"),
        "hand_position_error_mm": _summary(hands, "per_hand") if hands else None,
        **limits,
        "jerk_rms_rad_s3": jerk_rms(trajectory),
        "foot_skate_m_s": skate,
        "ground_penetration_mm": penetration,
        # Looking for it takes as long again as converting: only done where it is asked for (`core.replay.kinematic.collision_fraction`).
        "self_collision_fraction": None,
        "marked_frames": int(np.count_nonzero(trajectory.status)),
        "unmeasured_segments": list(motion.unmeasured_segments),
    }
    return metrics, series


def limb_direction_errors(
    trajectory: JointTrajectory, model: RobotModel, motion: HumanMotion, poses: Poses | None = None
) -> dict[str, Array]:
    """Limb segment → angle (T,) in degrees between the person's and the robot's joint-centre lines, in the world."""
    limbs = [limb for segment, limb in model.limbs.items() if motion.has(segment)]
    links = [limb.link for limb in limbs]
    rotation = (poses or Poses.along(trajectory, model, links)).rotations_of(links)
    errors = {}
    for i, limb in enumerate(limbs):
        achieved = rotation[:, i] @ limb.bone
        errors[limb.segment] = np.degrees(rotations.vector_angle(achieved, person_limb(motion, limb.segment)))
    return errors


def person_limb(motion: HumanMotion, segment: str) -> Array:
    """Direction (T, 3), world, of the person's limb: between its joint centres where these are tracked, else along its bone axis."""
    end = LIMB_END[segment]
    if motion.has(end):
        line = motion.position[:, motion.index(end)] - motion.position[:, motion.index(segment)]
        if np.isfinite(line).all() and (np.linalg.norm(line, axis=1) > 1e-6).all():
            return line
    return bone_direction(motion, segment)


def orientation_errors(
    trajectory: JointTrajectory, model: RobotModel, targets: Targets, poses: Poses | None = None
) -> dict[str, Array]:
    """Segment (or frame, for tasks of none) → angle (T,) in degrees between the target and the achieved orientation of its link."""
    tasks = [task for task in targets.tasks if task.kind == "orientation"]
    links = [task.frame for task in tasks]
    rotation = (poses or Poses.along(trajectory, model, links)).rotations_of(links)
    errors = {}
    for i, task in enumerate(tasks):
        # ‖A - B‖ = 2√2 sin(θ/2) in the Frobenius norm: exact near 0, and no detour over quaternions.
        apart = np.linalg.norm(rotation[:, i] - rotations.to_matrix(task.value), axis=(1, 2))
        errors[task.segment or task.frame] = np.degrees(2.0 * np.arcsin(np.minimum(apart / np.sqrt(8.0), 1.0)))
    return errors


def limit_figures(
    trajectory: JointTrajectory, model: RobotModel, rounding: float = ROUNDING
) -> tuple[dict[str, Any], dict[str, Array]]:
    """Counts of joint values outside their limits, and how much of the motion is spent at limits.

    rounding: rad, what counts as the same position; more than the default for values kept in single precision, whose speeds are then
    known no better than two such roundings a step.
    """
    time, q = trajectory.time, trajectory.position
    outside = at_position = too_fast = 0
    for part in frame_chunks(trajectory.frames):
        now = q[part]
        outside += int(((now < model.lower - rounding) | (now > model.upper + rounding)).sum())
        at_position += int(((now <= model.lower + 1e-6) | (now >= model.upper - 1e-6)).any(axis=1).sum())
    at_velocity, fastest = np.zeros(q.shape[1], int), np.zeros(max(trajectory.frames - 1, 1))
    for part in frame_chunks(trajectory.frames - 1):
        step = np.diff(time[part.start : part.stop + 1])[:, None]
        ratio = np.abs(np.diff(q[part.start : part.stop + 1], axis=0)) / step / model.velocity_limit
        slack = 2 * rounding / step / model.velocity_limit if rounding > ROUNDING else ROUNDING
        too_fast += int((ratio > 1.0 + slack).sum())
        at_velocity += (ratio >= 1.0 - 1e-4).sum(axis=0)
        fastest[part] = ratio.max(axis=1, initial=0.0)
    figures = {
        "position_limit_violations": outside,
        "velocity_limit_violations": too_fast,
        "max_velocity_ratio": float(fastest.max()),
        "limit_active_fraction": at_position / trajectory.frames,
        "velocity_limit_active_fraction": {
            name: float(share)
            for name, share in zip(trajectory.joint_names, at_velocity / len(fastest), strict=True)
            if share > 0
        },
    }
    return figures, {"max_velocity_ratio": fastest}


def jerk_rms(trajectory: JointTrajectory) -> float:
    """Root mean square over joints and frames of the third difference of the joint values, rad/s³; 0 for fewer than four frames."""
    if trajectory.frames < 4:
        return 0.0
    q, factor = trajectory.position, trajectory.rate_hz**3

    def squares(part: slice) -> Array:
        return np.asarray(np.square(np.diff(q[part.start : part.stop + 3], n=3, axis=0) * factor))

    return float(np.sqrt(np.mean(gathered(trajectory.frames - 3, squares, q.shape[1:]))))


def foot_figures(
    trajectory: JointTrajectory,
    model: RobotModel,
    contacts: BoolArray | None = None,
    poses: Poses | None = None,
) -> tuple[dict[str, float] | None, dict[str, float] | None, dict[str, Array]]:
    """(skate in m/s, penetration in mm, series), floor at z = 0.

    Skate: horizontal speed of a stance foot's sole centre. A foot is in stance while its centre is lower than 10 mm and, where the person's
    `contacts` (T, 4) are known, the person's heel or toe is down: a small robot's foot swings through lower than that.
    Penetration: depth of the lowest corner below the floor.
    """
    if not model.profile.feet or trajectory.base_orientation is None or trajectory.base_position is None:
        return None, None, {}
    series: dict[str, Array] = {}
    speeds = []
    depth = np.zeros(trajectory.frames)
    for side, (centre, lowest) in _soles(trajectory, model, poses).items():
        depth = np.maximum(depth, -1e3 * lowest)
        series[f"foot_height_m/{side}"] = lowest
        if trajectory.frames < 2:
            continue
        speed = np.linalg.norm(np.diff(centre[:, :2], axis=0), axis=1) / np.diff(trajectory.time)
        low = centre[:, 2] < SOLE_ON_GROUND_M
        if contacts is not None:
            heel = 2 * ("Left", "Right").index(side)
            low &= contacts[:, heel : heel + 2].any(axis=1)
        standing = low[1:] & low[:-1]
        speeds.append(speed[standing])
        series[f"foot_skate_m_s/{side}"] = np.concatenate([[0.0], np.where(standing, speed, 0.0)])
    all_speeds = np.concatenate(speeds) if speeds else np.zeros(0)
    skate = (
        {"mean": float(all_speeds.mean()), "max": float(all_speeds.max())}
        if len(all_speeds)
        else {"mean": 0.0, "max": 0.0}
    )
    return skate, {"mean": float(depth.mean()), "max": float(depth.max())}, series


def _soles(trajectory: JointTrajectory, model: RobotModel, poses: Poses | None) -> dict[str, tuple[Array, Array]]:
    """Side → (centre (T, 3) of its sole, height (T,) of the lowest corner), m, world; `trajectory` has a base pose."""
    frames, links = trajectory.frames, foot_links(model)
    soles = {side: (np.empty((frames, 3)), np.empty(frames)) for side in model.profile.feet}
    for part in frame_chunks(frames):
        now = poses.part(part) if poses else Poses.along(trajectory, model, links, part)
        for side, points in sole_corners(model, now).items():
            centre, lowest = soles[side]
            centre[part], lowest[part] = points.mean(axis=1), points[:, :, 2].min(axis=1)
    return soles


def _summary(errors: Mapping[str, Array], key: str) -> dict[str, Any]:
    """mean, p95 and max over everything and per name; NaN-free because the series are."""
    if not errors:
        return {"mean": None, "p95": None, "max": None, key: {}}
    return {
        **_figures(np.concatenate(list(errors.values()))),
        key: {name: _figures(error) for name, error in errors.items()},
    }


def _figures(values: Array) -> dict[str, float]:
    return {"mean": float(values.mean()), "p95": float(np.percentile(values, 95)), "max": float(values.max())}
