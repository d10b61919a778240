"""Every promise of the types, broken once: the message names the field, what was found and what was expected."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from retarget.core.errors import RetargetError
from retarget.core.types import (
    FRAME_MARKED,
    HumanMotion,
    InvalidDataError,
    JointTrajectory,
    Source,
    Targets,
    Task,
    TrackerRecording,
)

from tests.core.type_fields import (
    NAMES,
    T,
    changed,
    motion_fields,
    recording_fields,
    task_fields,
    trajectory_fields,
)
from tests.trajectory_fields import ARRAYS

MAKERS: dict[type, Callable[[], dict[str, Any]]] = {
    HumanMotion: motion_fields,
    JointTrajectory: trajectory_fields,
    Task: task_fields,
}


def with_nan(name: str) -> Callable[[dict[str, Any]], dict[str, Any]]:
    return lambda fields: {name: changed(fields[name], (-1,) + (0,) * (np.ndim(fields[name]) - 1), np.nan)}


def shortened(name: str) -> Callable[[dict[str, Any]], dict[str, Any]]:
    return lambda fields: {name: fields[name][:-1]}


def flipped(name: str) -> Callable[[dict[str, Any]], dict[str, Any]]:
    return lambda fields: {name: fields[name] * changed(np.ones(fields[name].shape), 2, -1)}


def lengthened(name: str) -> Callable[[dict[str, Any]], dict[str, Any]]:
    return lambda fields: {name: fields[name] * changed(np.ones(fields[name].shape), 1, 1.001)}


BROKEN: list[tuple[type, Any, str]] = [
    # HumanMotion
    (HumanMotion, {"time": []}, "HumanMotion.time: found shape (0,), expected (T,), T ≥ 1"),
    (HumanMotion, {"time": np.zeros((4, 1))}, "HumanMotion.time: found shape (4, 1), expected (T,), T ≥ 1"),
    (
        HumanMotion,
        {"time": [0, 0.1, 0.1, 0.2]},
        "HumanMotion.time: found frame 2 at 0.1 s after frame 1 at 0.1 s, expected increasing times",
    ),
    (
        HumanMotion,
        {"time": [1000, 1000.0001, 1000.00005, 1001]},
        "HumanMotion.time: found frame 2 at 1000.00005 s after frame 1 at 1000.0001 s, expected increasing times",
    ),
    (HumanMotion, with_nan("time"), "HumanMotion.time: found nan at (3,), expected finite values"),
    (
        HumanMotion,
        {"segments": ("Pelvis", "T8", "LeftFot")},
        "HumanMotion.segments: found unknown segment 'LeftFot', expected a canonical name; did you mean LeftFoot",
    ),
    (
        HumanMotion,
        {"segments": ("Pelvis", "T8", "T8")},
        "HumanMotion.segments: found ('Pelvis', 'T8', 'T8'), expected at least one name, each once",
    ),
    (HumanMotion, {"segments": ()}, "HumanMotion.segments: found (), expected at least one name, each once"),
    (
        HumanMotion,
        {"segments": NAMES[:2]},
        "HumanMotion.orientation: found shape (4, 3, 4), expected (4, 2, 4)",
    ),
    (HumanMotion, shortened("orientation"), "HumanMotion.orientation: found shape (3, 3, 4), expected (4, 3, 4)"),
    (HumanMotion, with_nan("orientation"), "HumanMotion.orientation: found nan at (3, 0, 0), expected finite values"),
    (
        HumanMotion,
        lengthened("orientation"),
        "HumanMotion.orientation: found length 1.001 at (1, 0), expected unit quaternions",
    ),
    (
        HumanMotion,
        {"orientation": np.zeros((4, 3, 4))},
        "HumanMotion.orientation: found length 0 at (0, 0), expected unit quaternions",
    ),
    (
        HumanMotion,
        flipped("orientation"),
        "HumanMotion.orientation: found a sign flip at (2, 0), expected signs continuous between frames",
    ),
    (HumanMotion, shortened("position"), "HumanMotion.position: found shape (3, 3, 3), expected (4, 3, 3)"),
    (
        HumanMotion,
        lambda fields: {"position": changed(fields["position"], (2, 1), np.nan)},
        "HumanMotion.position: found nan for T8 in frame 2, expected a segment finite in every frame or NaN in every",
    ),
    (
        HumanMotion,
        lambda fields: {"position": changed(fields["position"], (slice(None), 1, 2), np.nan)},
        "HumanMotion.position: found nan for T8 in frame 0, expected a segment finite in every frame or NaN in every",
    ),
    (
        HumanMotion,
        lambda fields: {"position": changed(fields["position"], (slice(1, None), 2), np.nan)},
        "HumanMotion.position: found nan for LeftFoot in frame 1, expected a segment finite in every",
    ),
    (
        HumanMotion,
        lambda fields: {"position": changed(fields["position"], (slice(0, 2), 2), np.nan)},
        "HumanMotion.position: found 24.0 for LeftFoot in frame 2, expected a segment finite in every",
    ),
    (
        HumanMotion,
        lambda fields: {"position": changed(fields["position"], (3, 0, 1), -np.inf)},
        "HumanMotion.position: found -inf for Pelvis in frame 3, expected a segment finite in every",
    ),
    (
        HumanMotion,
        {"angular_velocity": np.ones((T, 3, 4))},
        "HumanMotion.angular_velocity: found shape (4, 3, 4), expected (4, 3, 3)",
    ),
    (HumanMotion, with_nan("angular_velocity"), "HumanMotion.angular_velocity: found nan at (3, 0, 0), expected"),
    (
        HumanMotion,
        {"foot_contacts": np.zeros((T, 2), bool)},
        "HumanMotion.foot_contacts: found shape (4, 2), expected (4, 4)",
    ),
    (HumanMotion, with_nan("foot_contacts"), "HumanMotion.foot_contacts: found nan at (3, 0), expected bool values"),
    (
        HumanMotion,
        {"foot_contacts": np.full((T, 4), 2)},
        "HumanMotion.foot_contacts: found 2 at (0, 0), expected bool values",
    ),
    (HumanMotion, {"measured": [True]}, "HumanMotion.measured: found shape (1,), expected (3,)"),
    (
        HumanMotion,
        {"joint_offsets": {"T9": np.ones(3)}},
        "HumanMotion.joint_offsets: found unknown segment 'T9', expected a canonical name; did you mean T8",
    ),
    (
        HumanMotion,
        {"joint_offsets": {"T8": np.ones(2)}},
        "HumanMotion.joint_offsets[T8]: found shape (2,), expected (3,)",
    ),
    (
        HumanMotion,
        {"joint_offsets": {"T8": [0, np.nan, 0]}},
        "HumanMotion.joint_offsets[T8]: found nan at (1,), expected finite values",
    ),
    # Task
    (Task, {"kind": "pose"}, "Task.kind: found 'pose', expected orientation, position or axis"),
    (Task, {"value": np.ones((T, 3))}, "Task.value: found shape (4, 3), expected (T, 4), T ≥ 1"),
    (Task, {"value": np.ones((0, 4))}, "Task.value: found shape (0, 4), expected (T, 4), T ≥ 1"),
    (Task, lengthened("value"), "Task.value of head: found length 1.001 at (1,), expected unit quaternions"),
    (Task, flipped("value"), "Task.value of head: found a sign flip at (2,), expected signs continuous"),
    (Task, with_nan("value"), "Task.value: found nan at (3, 0), expected finite values"),
    (Task, shortened("feed_forward"), "Task.feed_forward: found shape (3, 3), expected (4, 3)"),
    (Task, with_nan("feed_forward"), "Task.feed_forward: found nan at (3, 0), expected finite values"),
    (Task, {"weight": [1, 1, 1]}, "Task.weight: found shape (3,), expected (4,)"),
    (Task, {"weight": np.ones((T, 1))}, "Task.weight: found shape (4, 1), expected (4,)"),
    (Task, {"weight": [1, 0, -0.5, 1]}, "Task.weight of head: found -0.5 at (2,), expected ≥ 0"),
    (Task, {"weight": -1}, "Task.weight of head: found -1 at (0,), expected ≥ 0"),
    (Task, {"weight": np.nan}, "Task.weight: found nan at (0,), expected finite values"),
    (Task, {"twist_weight": 1.5}, "Task.twist_weight of head: found 1.5, expected 0 to 1"),
    (Task, {"twist_weight": -0.1}, "Task.twist_weight of head: found -0.1, expected 0 to 1"),
    (Task, {"twist_weight": np.nan}, "Task.twist_weight of head: found nan, expected 0 to 1"),
    (Task, {"level": -1}, "Task.level of head: found -1, expected 0 (first) or more"),
    (Task, {"offset": [1, 2]}, "Task.offset: found shape (2,), expected (3,)"),
    (Task, {"axis": [1, 1, 0]}, "Task.axis of head: found length 1.414214, expected a unit vector"),
    (Task, {"axis": [np.inf, 1, 0]}, "Task.axis: found inf at (0,), expected finite values"),
    (
        Task,
        {"kind": "axis", "value": np.tile([0.0, 0.5, 0.5], (T, 1))},
        "Task.value of head: found length 0.7071068 at (0,), expected unit vectors",
    ),
    # JointTrajectory
    (JointTrajectory, {"time": [0, 1, 2, 2]}, "JointTrajectory.time: found frame 3 at 2 s after frame 2 at 2 s"),
    (
        JointTrajectory,
        {"joint_names": ("hip", "hip")},
        "JointTrajectory.joint_names: found 'hip' twice, expected each name once",
    ),
    (
        JointTrajectory,
        {"joint_names": ("hip",)},
        "JointTrajectory.position: found shape (4, 2), expected (4, 1)",
    ),
    (JointTrajectory, shortened("velocity"), "JointTrajectory.velocity: found shape (3, 2), expected (4, 2)"),
    (
        JointTrajectory,
        {"base_position": None},
        "JointTrajectory.base_position: found None beside a base_orientation, expected both or neither",
    ),
    (
        JointTrajectory,
        {"base_orientation": None},
        "JointTrajectory.base_orientation: found None beside a base_position, expected both or neither",
    ),
    (
        JointTrajectory,
        lengthened("base_orientation"),
        "JointTrajectory.base_orientation: found length 1.001 at (1,), expected unit quaternions",
    ),
    (
        JointTrajectory,
        flipped("base_orientation"),
        "JointTrajectory.base_orientation: found a sign flip at (2,), expected signs continuous",
    ),
    (JointTrajectory, {"status": [0, 0]}, "JointTrajectory.status: found shape (2,), expected (4,)"),
    (
        JointTrajectory,
        {"status": [0, 3, 1, 0]},
        "JointTrajectory.status: found 3, expected 0 (solved) or 1 (marked)",
    ),
    (
        JointTrajectory,
        {"status": [0, 256, 1, 0]},
        "JointTrajectory.status: found 256 at (1,), expected int8 values",
    ),
    (
        JointTrajectory,
        {"status": [0, 0.5, 1, 0]},
        "JointTrajectory.status: found 0.5 at (1,), expected int8 values",
    ),
    *(
        (JointTrajectory, with_nan(name), f"JointTrajectory.{name}: found nan at (3, 0), expected finite values")
        for name in ARRAYS[1:]
    ),
    # What is no array of numbers at all
    (HumanMotion, {"time": None}, "HumanMotion.time: found object values, expected an array of numbers"),
    (HumanMotion, {"time": ["0", "1", "2", "3"]}, "HumanMotion.time: found <U1 values, expected an array of numbers"),
    (JointTrajectory, {"position": [[0], [1, 2]]}, "JointTrajectory.position: found rows of unequal lengths, expected"),
    (
        JointTrajectory,
        {"velocity": np.ones((T, 2)) * 1j},
        "JointTrajectory.velocity: found complex128 values, expected",
    ),
]


@pytest.mark.parametrize(("kind", "change", "message"), BROKEN, ids=[m.split(", expected")[0] for *_, m in BROKEN])
def test_broken_promise(kind: type, change: Any, message: str) -> None:
    fields = MAKERS[kind]()
    change = change(fields) if callable(change) else change
    kind(**fields)  # whole before it is broken
    with pytest.raises(InvalidDataError, match="^" + re.escape(message)) as caught:
        kind(**{**fields, **change})
    assert "\n" not in str(caught.value)
    assert isinstance(caught.value, RetargetError)


def test_targets_need_as_many_frames_in_every_task() -> None:
    with pytest.raises(InvalidDataError, match=r"^Targets\.tasks: task of head has 4 frames, expected 3$"):
        Targets(np.arange(3.0), (Task(**task_fields()),))
    with pytest.raises(InvalidDataError, match=r"^Targets\.time: found frame 1 at 0 s after frame 0 at 0 s"):
        Targets([0.0, 0.0], ())  # type: ignore[arg-type]  # a list does as well
    assert Targets(np.arange(4.0), [Task(**task_fields())]).tasks[0].frame == "head"  # type: ignore[arg-type]


class TestWhatIsAllowed:
    def test_untracked_segments_are_nan_throughout(self) -> None:
        fields = motion_fields()
        fields["position"] = changed(fields["position"], (slice(None), 1), np.nan)
        assert np.isnan(HumanMotion(**fields).position[:, 1]).all()

    def test_large_finite_values_whose_sum_overflows(self) -> None:
        fields = trajectory_fields()
        fields["position"] = np.full((T, 2), 1.7e308)
        assert JointTrajectory(**fields).position[0, 0] == 1.7e308

    def test_rounding_of_written_quaternions(self) -> None:
        """Files hold six or seven digits; lengths off by that much are still unit."""
        fields = motion_fields()
        fields["orientation"] = fields["orientation"] * (1 + 4e-7)
        HumanMotion(**fields)

    def test_defaults(self) -> None:
        fields = {k: v for k, v in motion_fields().items() if k in ("time", "segments", "orientation", "position")}
        motion = HumanMotion(**fields)
        assert motion.measured.tolist() == [True, True, True]
        assert motion.angular_velocity is None
        assert motion.foot_contacts is None
        assert dict(motion.joint_offsets) == {}
        trajectory = JointTrajectory(np.zeros(1), ("a",), np.zeros((1, 1)), np.zeros((1, 1)))
        assert trajectory.status.tolist() == [0]
        assert trajectory.base_position is None

    @pytest.mark.parametrize("weight", [2, 2.0, np.float64(2), [2], np.full(T, 2.0), np.full(1, 2)])
    def test_one_weight_serves_all_frames(self, weight: Any) -> None:
        found = Task(**{**task_fields(), "weight": weight}).weight
        assert found.tolist() == [2.0] * T
        assert found.dtype == np.float64

    @pytest.mark.parametrize("kind", ["orientation", "position", "axis"])
    def test_each_kind_of_task(self, kind: str) -> None:
        task = Task(**task_fields(kind))
        assert task.value.shape == (T, 4 if kind == "orientation" else 3)

    def test_status_from_comparisons(self) -> None:
        fields = trajectory_fields()
        fields["status"] = np.array([False, True, False, False])
        trajectory = JointTrajectory(**fields)
        assert trajectory.status.dtype == np.int8
        assert trajectory.status[1] == FRAME_MARKED


class TestReading:
    def test_rate(self) -> None:
        motion = HumanMotion(**motion_fields())
        assert motion.frames == T
        assert motion.rate_hz == pytest.approx(60)
        one = {
            name: value[:1]
            if name in ("time", "orientation", "position", "angular_velocity", "foot_contacts")
            else value
            for name, value in motion_fields().items()
        }
        one["source"] = Source("mvnx", rate_hz=240)
        assert HumanMotion(**one).rate_hz == 240
        assert JointTrajectory(**trajectory_fields()).rate_hz == pytest.approx(50)
        assert JointTrajectory(np.zeros(1), (), np.zeros((1, 0)), np.zeros((1, 0))).rate_hz == 0

    def test_segments(self) -> None:
        motion = HumanMotion(**motion_fields())
        assert motion.unmeasured_segments == ("LeftFoot",)
        assert motion.index("T8") == 1
        assert motion.has("T8")
        assert not motion.has("LeftFoot")
        assert not motion.has("Head")

    def test_a_missing_segment_is_named_with_its_neighbours(self) -> None:
        motion = HumanMotion(**motion_fields())
        with pytest.raises(InvalidDataError, match=r"^the motion has no segment 'LeftToe'; did you mean LeftFoot\?$"):
            motion.index("LeftToe")
        with pytest.raises(InvalidDataError, match=r"^the motion has no segment 'Q'; it has Pelvis, T8, LeftFoot$"):
            motion.index("Q")


class TestTrackerRecording:
    @pytest.mark.parametrize(
        ("field", "value", "message"),
        [
            ("trackers", ("a", "a"), r"trackers: found \('a', 'a'\), expected at least one name, each once"),
            ("trackers", (), "expected at least one name"),
            ("time", np.zeros(T), "expected increasing times"),
            ("orientation", np.tile([2.0, 0, 0, 0], (T, 2, 1)), "expected unit quaternions"),
            ("orientation", np.tile([1.0, 0, 0, 0], (T, 3, 1)), r"found shape \(4, 3, 4\), expected \(4, 2, 4\)"),
            ("position", np.full((T, 2, 3), np.nan), "expected finite values"),
            ("tracked", np.ones((T, 1), bool), r"found shape \(4, 1\), expected \(4, 2\)"),
            ("segments", {"waist": "Pelvs"}, "did you mean Pelvis"),
            ("segments", {"hip": "Pelvis"}, "found tracker 'hip', expected one of LHR-1, waist"),
            ("segments", {"waist": "Pelvis", "LHR-1": "Pelvis"}, "expected each segment once"),
        ],
    )
    def test_broken_promises(self, field: str, value: Any, message: str) -> None:
        with pytest.raises(InvalidDataError, match=message):
            TrackerRecording(**{**recording_fields(), field: value})

    def test_columns_and_rates(self) -> None:
        recording = TrackerRecording(**recording_fields())
        assert (recording.frames, recording.index("waist")) == (T, 1)
        assert recording.rate_hz == pytest.approx(90)
        with pytest.raises(InvalidDataError, match="no tracker 'chest'; it has LHR-1, waist"):
            recording.index("chest")
