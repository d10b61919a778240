"""The base and the feet of a floating robot against the world: floor at z = 0, Z up.

A base quaternion whose components stand in the other order (wxyz taken for xyzw, or the reverse) is valid by itself. It shows in what
it does to the robot: upside down, leaning with its heading, feet in the air. So where the base fails as given, both other readings are tried,
and named when they clear it. A robot that keeps facing +X and stands still looks the same turned by half a turn: that case stays open.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from retarget.core import metrics, rotations
from retarget.core.chunks import gathered
from retarget.core.replay.signals import Signal, held, lasting, local_jumps, worst
from retarget.core.replay.thresholds import Thresholds
from retarget.core.report import Check
from retarget.core.robot_model import RobotModel
from retarget.core.types import Array, JointTrajectory

FLIGHT_S = 0.6
"""A jump of 44 cm: people's flights are not longer."""
SKATE_S = 0.1
"""A foot that is lifted leaves the lowest centimetre, in which it counts as standing, in less."""
REPAIRED = 0.1
"""Another order of the quaternion is named when it leaves no more than this part of what is wrong as given."""
WORST_FACTOR = 10.0
"""How much one check can weigh in that comparison, in multiples of its limit."""
ORDERS = (
    ((3, 0, 1, 2), "x y z w was read as w x y z"),
    ((1, 2, 3, 0), "w x y z was read as x y z w"),
)
"""What was given → what it should have been, and how that comes about."""
FOOT_CHECKS = ("ground_penetration_mm", "feet_floating_mm", "foot_skate_m_s")
BASE_CHECKS = ("base_tilt_deg", "base_speed_max_m_s", "base_turn_max_rad_s", "base_jump_max_m")
SHOWS_ORDER = (*FOOT_CHECKS, "base_tilt_deg", "base_turn_max_rad_s")
"""Checks that the orientation decides."""


def check_base(
    trajectory: JointTrajectory, model: RobotModel, thresholds: Thresholds
) -> tuple[list[Check], dict[str, Array]]:
    """(checks, per-frame series), as `check_joints`. series["problem/base"] and "problem/<side> foot": (T,), 1 = at the limit."""
    if trajectory.base_orientation is None or trajectory.base_position is None:
        why = "the base is fixed" if not model.base_is_floating else "the trajectory has no base pose"
        names = (*FOOT_CHECKS, *BASE_CHECKS, "base_quaternion_swapped")
        return [thresholds.check(name, None, why) for name in names], {}
    signals, series = _signals(trajectory, model)
    checks = []
    for name in (*FOOT_CHECKS, *BASE_CHECKS):
        if name not in signals:
            why = "the profile names no feet" if name in FOOT_CHECKS else "a single frame has no speed"
            checks.append(thresholds.check(name, None, why))
            continue
        found = _worst_of(signals[name], trajectory.time)
        checks.append(thresholds.check(name, found.value, where=found.where, time_s=found.time_s))
    checks.append(_order(trajectory, model, thresholds, signals))
    return checks, series | _strips(signals, thresholds, trajectory.frames)


def _signals(trajectory: JointTrajectory, model: RobotModel) -> tuple[dict[str, dict[str, Array]], dict[str, Array]]:
    """(check → place → (T,) its values over time, the series of `metrics.foot_figures`)."""
    time, orientation, position = trajectory.time, trajectory.base_orientation, trajectory.base_position
    assert orientation is not None
    assert position is not None
    base, frames = model.base_link, trajectory.frames

    def tilt(part: slice) -> Array:
        upright = rotations.multiply(orientation[part], rotations.conjugate(model.base_rotation))
        up = rotations.rotate(upright, np.array([0.0, 0.0, 1.0]))
        return np.asarray(np.degrees(np.arccos(np.clip(up[:, 2], -1.0, 1.0))))

    def turned(part: slice) -> Array:
        now = orientation[part.start : part.stop + 1]
        return rotations.angle(now[1:], now[:-1])

    signals: dict[str, dict[str, Array]] = {"base_tilt_deg": {base: gathered(frames, tilt)}}
    if frames > 1:
        step = np.diff(time)
        speed = np.linalg.norm(np.diff(position, axis=0), axis=1) / step
        turn = gathered(frames - 1, turned) / step
        jump = np.linalg.norm(local_jumps(position, time), axis=1)
        for name, values in (
            ("base_speed_max_m_s", speed),
            ("base_turn_max_rad_s", turn),
            ("base_jump_max_m", jump),
        ):
            signals[name] = {base: held(values[:, None], frames)[:, 0]}
    _, _, series = metrics.foot_figures(trajectory, model)
    heights = {key.partition("/")[2]: values for key, values in series.items() if key.startswith("foot_height_m/")}
    if heights:
        signals["ground_penetration_mm"] = {f"{side} foot": -1e3 * h for side, h in heights.items()}
        lowest = 1e3 * np.min(list(heights.values()), axis=0)
        signals["feet_floating_mm"] = {"lowest foot": lasting(lowest, time, FLIGHT_S)}
        skates = {key.partition("/")[2]: v for key, v in series.items() if key.startswith("foot_skate_m_s/")}
        if skates:
            signals["foot_skate_m_s"] = {f"{side} foot": lasting(v, time, SKATE_S) for side, v in skates.items()}
    return signals, series


def _worst_of(places: Mapping[str, Array], time: Array) -> Signal:
    return worst(np.stack(list(places.values()), axis=1), time, tuple(places))


def _order(
    trajectory: JointTrajectory, model: RobotModel, thresholds: Thresholds, signals: Mapping[str, dict[str, Array]]
) -> Check:
    given, name = _badness(signals, thresholds), "base_quaternion_swapped"
    if given == 0.0:
        return thresholds.check(name, 0.0)
    assert trajectory.base_orientation is not None
    best, best_words, best_left = "", "", np.inf
    for order, words in ORDERS:
        reordered = rotations.make_continuous(trajectory.base_orientation[:, order])
        other, _ = _signals(replace(trajectory, base_orientation=reordered, base_angular_velocity=None), model)
        if (left := _badness(other, thresholds)) < best_left:
            best_words, best_left = words, left
            tilts = [_worst_of(s["base_tilt_deg"], trajectory.time).value for s in (signals, other)]
            best = f"the other way its tilt is {tilts[1]:.0f}° instead of {tilts[0]:.0f}°"
    if best_left > REPAIRED * given:
        return thresholds.check(name, 0.0)
    return thresholds.check(name, 1.0, f"quaternion order: {best_words}; {best}", where=model.base_link)


def _badness(signals: Mapping[str, dict[str, Array]], thresholds: Thresholds) -> float:
    """By how many multiples of their limits the checks that show a wrong orientation fail, summed; 0 = none fails."""
    total = 0.0
    for name in SHOWS_ORDER:
        limit = thresholds.limits[name]
        if limit is None or name not in signals:
            continue
        value = max(0.0, *(float(values.max()) for values in signals[name].values()))
        if value > limit:
            total += min(WORST_FACTOR, value / limit - 1.0) if limit > 0 else WORST_FACTOR
    return total


def _strips(signals: Mapping[str, dict[str, Array]], thresholds: Thresholds, frames: int) -> dict[str, Array]:
    strips: dict[str, Array] = {}
    for name, places in signals.items():
        if not (limit := thresholds.limits[name]):
            continue
        for place, values in places.items():
            key = "problem/base" if name in BASE_CHECKS else f"problem/{place}"
            strips[key] = np.maximum(strips.get(key, np.zeros(frames)), values / limit)
    return strips
