"""The project's own samples on its robots, retargeted once: the good clips that faults are put into."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import pytest
from retarget import formats, robots, samples
from retarget.core import robot_model
from retarget.core.pipeline import ConvertOptions, convert
from retarget.core.types import JointTrajectory


@pytest.fixture(scope="session")
def clip() -> Callable[[str, str], tuple[JointTrajectory, Any]]:
    """`clip(robot, sample)` → (trajectory, `RobotModel`), each computed once per session."""

    @cache
    def make(robot: str, sample: str) -> tuple[JointTrajectory, Any]:
        motion = formats.read_motion(samples.sample_path(sample))
        model = robot_model.build(robots.load(robot), motion)
        return convert(motion, model, ConvertOptions()).trajectory, model

    return make


@pytest.fixture
def walking(clip: Callable[[str, str], tuple[JointTrajectory, Any]]) -> tuple[JointTrajectory, Any]:
    """The walk on G1: 60 Hz, ends in a turn of 90° to the left."""
    return clip("g1", "walk")
