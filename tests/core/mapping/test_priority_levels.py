"""Levels: the profile's own, else those of the paper on what the robot has."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from retarget.core import robot_model
from retarget.core.mapping.priority_levels import priority_levels
from retarget.core.profile import Hierarchy, Level, LevelTask

RobotBuilder = Callable[[str], Any]


def outline(model: Any) -> list[list[tuple[str, str]]]:
    return [[(task.segment, task.kind) for task in level.tasks] for level in priority_levels(model)]


HANDS = [(f"{side}Hand", kind) for kind in ("position", "orientation") for side in ("Left", "Right")]
UPPER_ARMS = [("LeftUpperArm", "axis"), ("RightUpperArm", "axis")]


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("icub", [[("T8", "orientation")], [*HANDS, ("Head", "axis")], UPPER_ARMS]),
        ("talos", [[("T8", "orientation")], [*HANDS, ("Head", "axis")], UPPER_ARMS]),
        ("g1", [[("T8", "orientation")], HANDS, UPPER_ARMS]),
        ("baxter", [[], [*HANDS, ("Head", "axis")], UPPER_ARMS]),
    ],
)
def test_derived_from_the_links(build_robot: RobotBuilder, name: str, expected: list[list[tuple[str, str]]]) -> None:
    assert outline(build_robot(name)) == expected


def test_derived_gains_and_weights_are_the_papers(build_robot: RobotBuilder) -> None:
    levels = priority_levels(build_robot("icub"))
    assert [level.weight for level in levels] == [50.0, 50.0, 5.0]
    assert [level.acceleration_s2 for level in levels] == [0.0, 0.0, 4e-5]
    assert [[task.gain for task in level.tasks] for level in levels] == [[100], [200, 200, 100, 100, 200], [100, 100]]
    assert [[task.weight for task in level.tasks] for level in levels] == [[1], [1, 1, 0.01, 0.01, 1], [1, 1]]


def test_an_upper_arms_axis_is_its_elbows(build_robot: RobotBuilder) -> None:
    model = build_robot("g1")
    for task in priority_levels(model)[-1].tasks:
        assert task.axis == pytest.approx(model.limbs[task.segment].hinge)
        assert np.linalg.norm(task.axis) == pytest.approx(1.0)


def test_the_profile_has_the_last_word(arm_robot: Callable[..., robot_model.RobotModel]) -> None:
    own = (Level((LevelTask("T8", "orientation", 3.0),)),)
    model = arm_robot(hierarchy=replace(Hierarchy(), levels=own))
    assert priority_levels(model) == own


def test_what_would_be_derived_for_tocabi_is_the_papers_table(build_robot: RobotBuilder) -> None:
    """Its profile states the table of the paper, down to axes, gains and weights; only the shoulders, its last level, can't be
    derived."""
    model = build_robot("tocabi")
    stated = model.profile.hierarchy.levels
    bare = replace(model, profile=replace(model.profile, hierarchy=Hierarchy()))
    derived = priority_levels(bare)
    assert len(stated) == 4
    assert {task.segment for task in stated[3].tasks} == {"LeftShoulder", "RightShoulder"}
    for ours, theirs in zip(derived, stated, strict=False):
        assert (ours.weight, ours.acceleration_s2) == (theirs.weight, theirs.acceleration_s2)
        by_name = {(task.segment, task.kind): task for task in theirs.tasks}
        assert [(task.segment, task.kind) for task in ours.tasks] == list(by_name)
        for task in ours.tasks:
            other = by_name[task.segment, task.kind]
            assert task.gain == other.gain
            assert task.axis == pytest.approx(other.axis, abs=1e-6)
