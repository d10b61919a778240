"""The person beside the robot on /tf, and whole trajectories in one message, as independent readers see them."""

from __future__ import annotations

import io
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from retarget import formats
from retarget.core import rotations
from retarget.core.errors import FormatError, RetargetError
from retarget.core.types import HumanMotion, JointTrajectory
from retarget.formats._mcap_writer import McapFile, Topic, message_record
from retarget.formats._ros_messages import JOINT_TRAJECTORY, typestore
from rosbags.highlevel import AnyReader

from tests.trajectory_fields import ARRAYS

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)
    from mcap_ros2.reader import read_ros2_messages

Maker = Callable[..., JointTrajectory]
SEGMENTS = ("Pelvis", "Head", "LeftHand")


def person(trajectory: JointTrajectory) -> HumanMotion:
    """Three segments, of which the head was not tracked."""
    rng = np.random.default_rng(5)
    turns = np.cumsum(rng.normal(scale=0.1, size=(trajectory.frames, 3, 3)), axis=0)
    position = rng.normal(size=(trajectory.frames, 3, 3))
    position[:, 1] = np.nan
    orientation = rotations.make_continuous(rotations.exp(turns))
    return HumanMotion(trajectory.time, SEGMENTS, orientation, position)


def messages(path: Path) -> dict[str, list[Any]]:
    """All messages of a file or folder by topic, as rosbags reads them."""
    found: dict[str, list[Any]] = {}
    with AnyReader([path], default_typestore=typestore()) as reader:
        for connection, _, raw in reader.messages():
            found.setdefault(connection.topic, []).append(reader.deserialize(raw, connection.msgtype))
    return found


@pytest.mark.parametrize("fixed", [False, True])
def test_person_and_robot_stand_in_one_world(make_trajectory: Maker, tmp_path: Path, fixed: bool) -> None:
    base = {"base_position": None, "base_orientation": None} if fixed else {}
    trajectory = make_trajectory(frames=900, joints=29, **base)
    motion = person(trajectory)
    formats.write_trajectory(tmp_path / "walk.mcap", trajectory, motion=motion)
    tf = messages(tmp_path / "walk.mcap")["/tf"]
    assert len(tf) == trajectory.frames
    children = ["human/Pelvis", "human/LeftHand"] if fixed else ["pelvis", "human/Pelvis", "human/LeftHand"]
    for i, message in enumerate(tf):
        assert [item.child_frame_id for item in message.transforms] == children
        assert {item.header.frame_id for item in message.transforms} == {"world"}
        for item in message.transforms:
            stamp = item.header.stamp.sec * 10**9 + item.header.stamp.nanosec
            assert stamp == round(trajectory.time[i] * 1e9)
            if item.child_frame_id == "pelvis":
                expected = trajectory.base_position[i], trajectory.base_orientation[i]
            else:
                segment = SEGMENTS.index(item.child_frame_id.removeprefix("human/"))
                expected = motion.position[i, segment], motion.orientation[i, segment]
            t, q = item.transform.translation, item.transform.rotation
            np.testing.assert_array_equal([t.x, t.y, t.z], expected[0])
            np.testing.assert_array_equal([q.w, q.x, q.y, q.z], expected[1])


def test_mcap_ros2_reads_the_same(make_trajectory: Maker) -> None:
    trajectory, out = make_trajectory(frames=40), io.BytesIO()
    motion = person(trajectory)
    formats.write_trajectory_stream(out, trajectory, motion=motion)
    out.seek(0)
    found = [item.ros_msg for item in read_ros2_messages(out, topics=["/tf"])]
    hands = np.array([[(p := m.transforms[2].transform.translation).x, p.y, p.z] for m in found])
    np.testing.assert_array_equal(hands, motion.position[:, 2])


def test_the_robot_reads_back_as_without_the_person(make_trajectory: Maker, tmp_path: Path) -> None:
    trajectory = make_trajectory(frames=900, joints=29)
    formats.write_trajectory(tmp_path / "alone.mcap", trajectory)
    formats.write_trajectory(tmp_path / "both.mcap", trajectory, motion=person(trajectory))
    alone, both = (formats.read_trajectory(tmp_path / f"{name}.mcap") for name in ("alone", "both"))
    for field in (*ARRAYS, "status"):
        np.testing.assert_array_equal(getattr(alone, field), getattr(both, field))
    assert alone.provenance == both.provenance


def test_formats_that_can_not_show_a_person_leave_it_out(make_trajectory: Maker, tmp_path: Path) -> None:
    trajectory = make_trajectory()
    for name in ("a.csv", "b.npz", "c.h5"):
        formats.write_trajectory(tmp_path / name, trajectory, motion=person(trajectory))
        formats.write_trajectory(tmp_path / f"plain_{name}", trajectory)
        back, plain = formats.read_trajectory(tmp_path / name), formats.read_trajectory(tmp_path / f"plain_{name}")
        np.testing.assert_array_equal(back.position, plain.position)


def test_a_person_of_other_times_is_refused(make_trajectory: Maker, tmp_path: Path) -> None:
    trajectory = make_trajectory()
    motion = person(replace(trajectory, time=trajectory.time + 1.0))
    with pytest.raises(RetargetError, match="the person's motion has other times than the trajectory"):
        formats.write_trajectory(tmp_path / "walk.mcap", trajectory, motion=motion)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("joints", [0, 1, 2, 3])
@pytest.mark.parametrize("frames", [1, 2, 50])
def test_a_whole_trajectory_in_one_message(make_trajectory: Maker, tmp_path: Path, joints: int, frames: int) -> None:
    """Names of every length shift where the numbers begin: their alignment must hold for each."""
    for length in range(1, 9):
        names = tuple("j" * length + str(i) for i in range(joints))
        trajectory = make_trajectory(frames=frames, joints=joints, joint_names=names)
        trajectory = replace(trajectory, time=trajectory.time + 2.5)
        path = tmp_path / f"{length}.mcap"
        formats.write_trajectory(path, trajectory, style="joint_trajectory")
        (message,) = messages(path)["/joint_trajectory"]
        assert message.joint_names == list(names)
        assert (message.header.stamp.sec, message.header.stamp.nanosec, message.header.frame_id) == (0, 0, "")
        assert len(message.points) == frames
        for i, point in enumerate(message.points):
            np.testing.assert_array_equal(point.positions, trajectory.position[i])
            np.testing.assert_array_equal(point.velocities, trajectory.velocity[i])
            assert (len(point.accelerations), len(point.effort)) == (0, 0)
            after = point.time_from_start.sec * 10**9 + point.time_from_start.nanosec
            assert after == round(trajectory.time[i] * 1e9) - round(trajectory.time[0] * 1e9)


def plan_only(*plans: Any) -> io.BytesIO:
    """An MCAP of JointTrajectory messages alone, as a planner's recording is."""
    definition, _ = typestore().generate_msgdef(JOINT_TRAJECTORY, ros_version=2)
    out = io.BytesIO()
    file = McapFile(out, [Topic("/arm/plan", JOINT_TRAJECTORY, definition)], {})
    from retarget.formats._cdr import Layout

    for stamp, plan in enumerate(plans):
        layout = Layout()
        with message_record(layout, 1, ""):
            layout.raw(bytes(typestore().serialize_cdr(plan, JOINT_TRAJECTORY)))
        row = layout.rows(1)
        row["log_time"] = row["publish_time"] = stamp
        file.chunk(memoryview(row.tobytes()), {1: np.array([[stamp, 0]], np.uint64)})
    file.finish()
    out.seek(0)
    return out


def plan(positions: list[list[float]], velocities: list[list[float]]) -> Any:
    kinds = typestore().types
    stamp = kinds["builtin_interfaces/msg/Time"](10, 5)
    none = np.zeros(0)
    points = [
        kinds["trajectory_msgs/msg/JointTrajectoryPoint"](
            np.array(p, float), np.array(v, float), none, none, kinds["builtin_interfaces/msg/Duration"](i, 500_000_000)
        )
        for i, (p, v) in enumerate(zip(positions, velocities, strict=True))
    ]
    return kinds[JOINT_TRAJECTORY](kinds["std_msgs/msg/Header"](stamp, "base"), ["a", "b"], points)


def test_a_recording_of_nothing_but_a_plan_is_read() -> None:
    back = formats.read_trajectory(plan_only(plan([[0, 1], [2, 3]], [[4, 5], [6, 7]])), "plan.mcap")
    assert back.joint_names == ("a", "b")
    np.testing.assert_array_equal(back.time, [0, 1])
    np.testing.assert_array_equal(back.position, [[0, 1], [2, 3]])
    np.testing.assert_array_equal(back.velocity, [[4, 5], [6, 7]])
    assert back.provenance["start_stamp_ns"] == 10_500_000_005
    without = formats.read_trajectory(plan_only(plan([[0.0, 1.0], [2.0, 3.0]], [[], []])), "plan.mcap")
    np.testing.assert_array_equal(without.velocity, [[2, 2], [2, 2]])


def test_plans_that_make_no_trajectory() -> None:
    one = plan([[0.0, 1.0]], [[0.0, 0.0]])
    with pytest.raises(FormatError, match="topic /arm/plan: 2 joint trajectories; expected one"):
        formats.read_trajectory(plan_only(one, one), "plan.mcap")
    with pytest.raises(FormatError, match="a joint trajectory without points"):
        formats.read_trajectory(plan_only(plan([], [])), "plan.mcap")
    with pytest.raises(FormatError, match=r"point 0: 1 positions and 2 velocities; expected one for each of 2"):
        formats.read_trajectory(plan_only(plan([[1.0]], [[0.0, 0.0]])), "plan.mcap")
