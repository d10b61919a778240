"""No instance of any type of the house can be changed after it is made."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from retarget.core import report, types
from retarget.core.report import Check, ValidationReport
from retarget.core.types import (
    Array,
    HumanMotion,
    JointTrajectory,
    Source,
    Targets,
    Task,
    TrackerRecording,
)

from tests.core.type_fields import motion_fields, recording_fields, task_fields, trajectory_fields


def all_types() -> list[Any]:
    task = Task(**task_fields())
    check = Check("a", 1.0, "m", 2.0, True)
    return [
        Source("mvnx"),
        HumanMotion(**motion_fields()),
        TrackerRecording(**recording_fields()),
        task,
        Targets(np.arange(4.0), (task,)),
        JointTrajectory(**trajectory_fields()),
        check,
        ValidationReport("walk", (check,), {"error": np.ones(3)}),
    ]


def arrays_of(thing: Any) -> Iterator[tuple[str, Array]]:
    for field in dataclasses.fields(thing):
        value = getattr(thing, field.name)
        if isinstance(value, np.ndarray):
            yield field.name, value
        elif hasattr(value, "items"):
            yield from ((f"{field.name}[{key}]", v) for key, v in value.items() if isinstance(v, np.ndarray))


class TestFrozen:
    def test_every_dataclass_of_the_modules_is_frozen_and_in_this_test(self) -> None:
        classes = {
            c
            for module in (types, report)
            for c in vars(module).values()
            if dataclasses.is_dataclass(c) and c.__module__ == module.__name__
        }
        assert classes == {type(thing) for thing in all_types()}
        for thing in all_types():
            name = dataclasses.fields(thing)[0].name
            with pytest.raises(dataclasses.FrozenInstanceError):
                setattr(thing, name, getattr(thing, name))

    def test_no_array_and_no_mapping_can_be_written_to(self) -> None:
        seen = 0
        for thing in all_types():
            for name, array in arrays_of(thing):
                seen += 1
                assert array.flags.c_contiguous, name
                with pytest.raises(ValueError, match="read-only"):
                    array[...] = 0
            for name in ("options", "joint_offsets", "provenance", "series"):
                if hasattr(thing, name):
                    with pytest.raises(TypeError, match="does not support item assignment"):
                        getattr(thing, name)["new"] = 1
        assert seen >= 20

    def test_motions_compare_by_identity(self) -> None:
        """Comparing arrays for equality has no single truth; it must not raise where a set or a cache compares."""
        one, other = HumanMotion(**motion_fields()), HumanMotion(**motion_fields())
        assert one == one
        assert one != other
        assert len({one, other}) == 2
