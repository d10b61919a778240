"""Joints beside the ranges that they were written with: every pair that can change places, parts of clips, precision, files that keep none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
import pytest
from retarget.core.joint_ranges import JointRanges
from retarget.core.replay import kinematic
from retarget.core.replay.thresholds import Thresholds
from retarget.core.replay.written_range_check import NAME, check_written_range
from retarget.core.report import Check
from retarget.core.types import JointTrajectory

Walking = tuple[JointTrajectory, Any]
LIMITS = Thresholds("kinematic")


def judged(trajectory: JointTrajectory) -> Check:
    checks, _ = check_written_range(trajectory, LIMITS)
    assert [check.name for check in checks] == [NAME]
    return checks[0]


def exchanged(good: JointTrajectory, first: str, second: str) -> JointTrajectory:
    """The values of each of two joints under the other one's name."""
    names = list(good.joint_names)
    i, j = names.index(first), names.index(second)
    names[i], names[j] = second, first
    return replace(good, joint_names=tuple(names))


def part_of(good: JointTrajectory, frames: slice) -> JointTrajectory:
    fields = ("time", "position", "velocity", "base_position", "base_orientation", "status")
    fields += ("base_linear_velocity", "base_angular_velocity")
    return replace(good, **{name: getattr(good, name)[frames] for name in fields})


def swing(values: np.ndarray, frames: int = 60) -> JointTrajectory:
    """Columns `values` (T, n) of joints a, b, c …, with their ranges in the provenance."""
    names = tuple("abcdefgh"[: values.shape[1]])
    ranges = JointRanges.of(names, values).provenance()
    assert len(values) == frames
    return JointTrajectory(np.arange(frames) / 60, names, values, np.zeros_like(values), provenance=ranges)


def test_every_pair_of_g1s_joints(walking: Walking) -> None:
    """All 406: caught, counted, both named, and the time is that of the first value outside."""
    good, _ = walking
    assert judged(good).passed
    for first, second in combinations(good.joint_names, 2):
        bad = exchanged(good, first, second)
        i, j = good.joint_names.index(first), good.joint_names.index(second)
        assert not np.array_equal(good.position[:, i], good.position[:, j])
        check = judged(bad)
        assert (check.value, check.passed) == (2, False), (first, second)
        assert check.where in (first, second)
        assert f"{second} and {first} look swapped" in check.note, check.note
        own, others = (i, j) if check.where == first else (j, i)
        low, high = good.position[:, own].min(), good.position[:, own].max()
        out = np.flatnonzero((good.position[:, others] < low - 2e-6) | (good.position[:, others] > high + 2e-6))
        if len(out):
            assert check.time_s is not None
            assert check.time_s <= good.time[out[0]]


def test_columns_sorted_into_another_order(walking: Walking) -> None:
    good, _ = walking
    order = sorted(good.joint_names)
    check = judged(replace(good, joint_names=tuple(order)))
    moved = sum(a != b for a, b in zip(order, good.joint_names, strict=True))
    assert check.value == moved
    assert "was written to do" in check.note
    assert check.note.count(" does what ") + check.note.count(" look swapped") == 3
    assert " more;" in check.note


def test_equal_ranges_at_other_times() -> None:
    """Left and right of a symmetric gait cover the same values half a cycle apart; the range alone could not tell them apart."""
    phase = 2 * np.pi * np.arange(60) / 30
    good = swing(np.stack([np.cos(phase), np.cos(phase + np.pi), 0.5 * np.cos(phase)], axis=1))
    assert judged(good).passed
    check = judged(exchanged(good, "a", "b"))
    assert (check.value, check.passed, check.where, check.time_s) == (2, False, "b", 0.0)
    assert "b and a look swapped" in check.note


def test_joints_that_do_the_same_can_t_be_told_apart() -> None:
    line = np.linspace(0, 1, 60)
    good = swing(np.stack([line, line, 0 * line, 0 * line], axis=1))
    assert judged(exchanged(exchanged(good, "a", "b"), "c", "d")).passed


def test_three_joints_in_a_circle() -> None:
    line = np.linspace(0, 1, 60)
    good = swing(np.stack([line, 2 * line, 3 * line], axis=1))
    check = judged(replace(good, joint_names=("b", "c", "a")))
    assert check.value == 3
    assert check.note.startswith(
        "a at 0.333 s; b does what a was written to do; c does what b was written to do; a does what c was written to do;"
    )


@pytest.mark.parametrize("frames", [slice(0, 1), slice(100, 400), slice(None, None, 2), slice(1, None)])
def test_a_part_passes(walking: Walking, frames: slice) -> None:
    good, _ = walking
    assert judged(part_of(good, frames)).passed


def test_a_part_with_swapped_joints_is_caught_where_a_value_is_outside(walking: Walking) -> None:
    good, _ = walking
    check = judged(part_of(exchanged(good, "left_wrist_pitch_joint", "left_wrist_yaw_joint"), slice(100, 200)))
    assert (check.value, check.passed, check.time_s) == (2, False, good.time[100])
    assert check.where in ("left_wrist_pitch_joint", "left_wrist_yaw_joint")


def test_first_time_outside_is_told(walking: Walking) -> None:
    good, model = walking
    joint = model.joint_index("waist_pitch_joint")
    position = good.position.copy()
    position[300:310, joint] += 0.5
    position[305, joint] += 0.1
    report = kinematic.check_numbers(replace(good, position=position), model)
    check = report.check(NAME)
    assert (check.value, check.where, check.time_s) == (1, "waist_pitch_joint", good.time[300])
    assert "swapped" not in check.note
    strip = report.series["problem/waist_pitch_joint"]
    assert (strip[300:310] > 1).all()


def test_a_column_that_stands_still_inside_its_range(walking: Walking) -> None:
    """Nothing is outside, but a whole clip has to cover what was written."""
    good, model = walking
    joint = model.joint_index("left_elbow_joint")
    position = good.position.copy()
    position[:, joint] = position[:, joint].mean()
    check = judged(replace(good, position=position))
    assert (check.value, check.passed, check.where, check.time_s) == (1, False, "left_elbow_joint", None)
    low, high = good.position[:, joint].min(), good.position[:, joint].max()
    assert f"written with {low:.4f} to {high:.4f}" in check.note


def test_single_precision_is_no_fault_and_hides_none(walking: Walking) -> None:
    good, _ = walking
    rounded = replace(good, position=good.position.astype(np.float32).astype(float))
    assert judged(rounded).passed
    for pair in (("left_elbow_joint", "right_elbow_joint"), ("waist_roll_joint", "waist_pitch_joint")):
        check = judged(exchanged(rounded, *pair))
        assert (check.value, check.passed) == (2, False)
        assert (
            f"{pair[1]} and {pair[0]} look swapped" in check.note
            or f"{pair[0]} and {pair[1]} look swapped" in check.note
        )


def test_a_part_that_is_converted_has_ranges_of_its_own(clip: Callable[..., Walking]) -> None:
    part, _ = clip("g1", "walk", 1.6, 2.6)
    assert part.provenance["joint_ranges"]["frames"] == part.frames
    assert judged(part).passed


def test_joints_in_another_order_are_matched_by_name(walking: Walking) -> None:
    good, model = walking
    order = np.random.default_rng(0).permutation(len(good.joint_names))
    mixed = replace(
        good,
        joint_names=tuple(good.joint_names[i] for i in order),
        position=good.position[:, order],
        velocity=good.velocity[:, order],
    )
    assert kinematic.check_numbers(mixed, model).check(NAME).passed


@pytest.mark.parametrize(
    ("provenance", "note"),
    [
        ({}, "the file doesn't keep the ranges that its joints were written with"),
        ({"joint_ranges": 7}, "provenance.joint_ranges: found something else"),
        ({"joint_ranges": {"frames": 9, "joints": {"nose": [0, 1, "00000000"]}}}, "are of other joints"),
    ],
)
def test_without_ranges_nothing_is_judged(walking: Walking, provenance: dict[str, Any], note: str) -> None:
    good, model = walking
    check = kinematic.check_numbers(replace(good, provenance=provenance), model).check(NAME)
    assert (check.value, check.passed) == (None, None)
    assert note in check.note


def test_the_limit_can_be_lifted(walking: Walking) -> None:
    good, model = walking
    bad = exchanged(good, "waist_roll_joint", "waist_pitch_joint")
    assert kinematic.check_numbers(bad, model, LIMITS.overridden([f"{NAME}=none"])).check(NAME).passed is None
    assert kinematic.check_numbers(bad, model, LIMITS.overridden([f"{NAME}=2"])).check(NAME).passed
