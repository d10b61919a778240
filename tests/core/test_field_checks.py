"""Checks of fields by themselves: seams between chunks, and who owns the memory of an array that was handed over."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from retarget.core import chunks, field_checks
from retarget.core.report import ValidationReport
from retarget.core.types import Array, HumanMotion, InvalidDataError, Targets, Task

from tests.core.type_fields import T, motion_fields, task_fields


class TestQuaternionChecksInChunks:
    """Long clips are checked piece by piece: nothing may slip through at the seams."""

    @pytest.mark.parametrize("frame", [1, 9, 10, 11, 19, 20, 21, 24])
    def test_every_frame_is_seen(self, monkeypatch: pytest.MonkeyPatch, frame: int) -> None:
        monkeypatch.setattr(chunks, "CHUNK_FRAMES", 10)
        quaternion = np.tile([1.0, 0, 0, 0], (25, 2, 1))
        field_checks.check_unit_quaternions("q", quaternion)
        flipped = quaternion.copy()
        flipped[frame:, 1] *= -1
        with pytest.raises(InvalidDataError, match=rf"^q: found a sign flip at \({frame}, 1\)"):
            field_checks.check_unit_quaternions("q", flipped)
        long = quaternion.copy()
        long[frame, 1] *= 1.01
        with pytest.raises(InvalidDataError, match=rf"^q: found length 1\.01 at \({frame}, 1\)"):
            field_checks.check_unit_quaternions("q", long)


class Wrapped:
    """Foreign data that hands out its own memory, as tensors and columns of tables do."""

    def __init__(self, data: Array) -> None:
        self.data = data

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        return self.data


def owner(position: Array) -> tuple[Any, Array]:
    return position, position


def view(position: Array) -> tuple[Any, Array]:
    return position[:], position


def read_only_view(position: Array) -> tuple[Any, Array]:
    given = position[:]
    given.flags.writeable = False
    return given, position


def view_of_read_only_view(position: Array) -> tuple[Any, Array]:
    return read_only_view(position)[0][:], position


def broadcast(position: Array) -> tuple[Any, Array]:
    return np.broadcast_to(position, position.shape), position


def memory_view(position: Array) -> tuple[Any, Array]:
    return memoryview(position), position


def read_only_buffer(position: Array) -> tuple[Any, Array]:
    buffer = bytearray(position.tobytes())
    given = np.frombuffer(memoryview(buffer).toreadonly()).reshape(position.shape)
    return given, np.frombuffer(buffer).reshape(position.shape)


def foreign(position: Array) -> tuple[Any, Array]:
    return Wrapped(position), position


def subclass(position: Array) -> tuple[Any, Array]:
    return position.view(np.recarray), position


class TestWhoOwnsTheMemory:
    @pytest.mark.parametrize(
        "handed_over",
        [
            owner,
            view,
            read_only_view,
            view_of_read_only_view,
            broadcast,
            memory_view,
            read_only_buffer,
            foreign,
            subclass,
        ],
    )
    def test_what_the_caller_changes_later_does_not_change_the_motion(
        self, handed_over: Callable[[Array], tuple[Any, Array]]
    ) -> None:
        fields = motion_fields()
        given, caller = handed_over(fields["position"].copy())
        motion = HumanMotion(**{**fields, "position": given})
        caller[0, 0, 0] = 99.0  # and the caller may still write
        assert motion.position[0, 0, 0] == 0.0

    def test_a_weight_too(self) -> None:
        weight = np.ones(1)
        task = Task(**{**task_fields(), "weight": weight})
        weight[0] = 5
        assert task.weight.tolist() == [1.0] * T

    def test_mappings_too(self) -> None:
        fields = {**motion_fields(), "joint_offsets": {"T8": np.zeros(3)}}
        motion = HumanMotion(**fields)
        fields["joint_offsets"]["Head"] = np.zeros(3)
        fields["joint_offsets"]["T8"][0] = 9
        assert list(motion.joint_offsets) == ["T8"]
        assert motion.joint_offsets["T8"][0] == 0
        series = {"error": np.zeros(3)}
        found = ValidationReport("walk", (), series)
        series["error"][0] = 9
        assert found.series["error"][0] == 0

    def test_what_nobody_can_write_to_is_shared_not_copied(self) -> None:
        fields = motion_fields()
        fields["orientation"] = fields["orientation"].copy()
        fields["orientation"].flags.writeable = False
        motion = HumanMotion(**fields)
        assert motion.orientation is fields["orientation"]
        assert np.shares_memory(dataclasses.replace(motion, time=motion.time + 1).position, motion.position)
        part = dataclasses.replace(
            motion,
            time=motion.time[1:],
            orientation=motion.orientation[1:],
            position=motion.position[1:],
            angular_velocity=None,
            foot_contacts=None,
        )
        assert np.shares_memory(part.orientation, motion.orientation)
        text = np.frombuffer(np.arange(4.0).tobytes())
        assert np.shares_memory(Targets(text, ()).time, text)

    def test_other_layouts_and_number_types_become_the_houses_own(self) -> None:
        fields = motion_fields()
        values = fields["position"].astype(np.float32)
        motion = HumanMotion(**{**fields, "position": np.asfortranarray(values), "time": [0, 1, 2, 3]})
        assert motion.position.dtype == np.float64
        assert motion.position.flags.c_contiguous
        assert np.array_equal(motion.position, values)
        assert motion.time.dtype == np.float64
