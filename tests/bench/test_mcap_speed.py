"""MCAP writing: whole clips encoded in bulk against one message at a time through mcap.Writer and rosbags' serialisation.

Both write the same messages of the same trajectory, a robot of 29 joints with a moving base, into memory, with zstd (mcap.Writer at its
level 3, ours at level 1). What both wrote is read back and compared. Times and the ratio are recorded, not asserted.
"""

from __future__ import annotations

import io
import time
from typing import Any

import numpy as np
import pytest
from mcap.writer import Writer
from pytest_benchmark.fixture import BenchmarkFixture
from retarget.core import rotations
from retarget.core.types import JointTrajectory
from retarget.formats import mcap
from retarget.formats._ros_messages import typestore

FRAMES, JOINTS, RATE_HZ = 24_000, 29, 240.0
"""100 s at the rate of an Xsens suit, as many joints as a G1."""


@pytest.fixture(scope="module")
def trajectory() -> JointTrajectory:
    at = np.arange(FRAMES) / RATE_HZ
    rng = np.random.default_rng(0)
    frequency, phase = rng.uniform(0.5, 4, JOINTS), rng.uniform(0, 6, JOINTS)
    turn = np.stack([0.1 * np.sin(at), 0.1 * np.cos(at), 0.3 * at], axis=1)
    return JointTrajectory(
        time=at,
        joint_names=tuple(f"left_shoulder_pitch_joint_{i}" for i in range(JOINTS)),
        position=np.sin(at[:, None] * frequency + phase),
        velocity=frequency * np.cos(at[:, None] * frequency + phase),
        base_position=np.stack([1.2 * at, 0.02 * np.sin(at), 0.8 + 0.01 * np.sin(2 * at)], axis=1),
        base_orientation=rotations.make_continuous(rotations.exp(turn)),
        base_frame="pelvis",
        robot="g1",
    )


def write_in_bulk(trajectory: JointTrajectory) -> bytes:
    out = io.BytesIO()
    mcap.write_trajectory(out, trajectory)
    return out.getvalue()


def write_one_by_one(trajectory: JointTrajectory) -> bytes:
    """The plain way: build each message, serialise it, hand it to the writer."""
    store = typestore()
    kinds: dict[str, Any] = store.types
    stamp_of, header_of = kinds["builtin_interfaces/msg/Time"], kinds["std_msgs/msg/Header"]
    vector, quaternion = kinds["geometry_msgs/msg/Vector3"], kinds["geometry_msgs/msg/Quaternion"]
    out = io.BytesIO()
    writer = Writer(out)
    writer.start("ros2")
    channels = {}
    for topic, kind in (("/joint_states", "sensor_msgs/msg/JointState"), ("/tf", "tf2_msgs/msg/TFMessage")):
        definition, _ = store.generate_msgdef(kind, ros_version=2)
        channels[topic] = writer.register_channel(
            topic, "cdr", writer.register_schema(kind, "ros2msg", definition.encode())
        )
    names, effort = list(trajectory.joint_names), np.zeros(0)
    assert trajectory.base_position is not None
    assert trajectory.base_orientation is not None
    for i, at in enumerate(trajectory.time.tolist()):
        log_time = round(at * 1e9)
        stamp = stamp_of(*divmod(log_time, 10**9))
        state = kinds["sensor_msgs/msg/JointState"](
            header_of(stamp, ""), names, trajectory.position[i], trajectory.velocity[i], effort
        )
        raw = store.serialize_cdr(state, "sensor_msgs/msg/JointState")
        writer.add_message(channels["/joint_states"], log_time, bytes(raw), log_time, i)
        w, x, y, z = trajectory.base_orientation[i]
        pose = kinds["geometry_msgs/msg/Transform"](vector(*trajectory.base_position[i]), quaternion(x, y, z, w))
        stamped = kinds["geometry_msgs/msg/TransformStamped"](header_of(stamp, "world"), trajectory.base_frame, pose)
        raw = store.serialize_cdr(kinds["tf2_msgs/msg/TFMessage"]([stamped]), "tf2_msgs/msg/TFMessage")
        writer.add_message(channels["/tf"], log_time, bytes(raw), log_time, i)
    writer.finish()
    return out.getvalue()


def test_bulk_writer_against_a_message_at_a_time(benchmark: BenchmarkFixture, trajectory: JointTrajectory) -> None:
    plain_s = np.inf
    for _ in range(3):
        started = time.perf_counter()
        plain = write_one_by_one(trajectory)
        plain_s = min(plain_s, time.perf_counter() - started)
    ours = benchmark(write_in_bulk, trajectory)
    here, there = (mcap.read_trajectory(io.BytesIO(data), "clip.mcap") for data in (ours, plain))
    np.testing.assert_array_equal(here.position, there.position)
    np.testing.assert_array_equal(here.velocity, there.velocity)
    np.testing.assert_array_equal(here.time, there.time)
    if benchmark.stats is None:  # --benchmark-disable
        return
    ours_s = benchmark.stats.stats.min
    benchmark.extra_info |= {
        "frames_per_second_bulk": FRAMES / ours_s,
        "frames_per_second_one_by_one": FRAMES / plain_s,
        "ratio_one_by_one_to_bulk": plain_s / ours_s,
        "bytes_per_frame_bulk": len(ours) / FRAMES,
    }


def test_reader(benchmark: BenchmarkFixture, trajectory: JointTrajectory) -> None:
    data = write_in_bulk(trajectory)
    back = benchmark(lambda: mcap.read_trajectory(io.BytesIO(data), "clip.mcap"))
    np.testing.assert_array_equal(back.position, trajectory.position)
    if benchmark.stats is not None:
        benchmark.extra_info["frames_per_second"] = FRAMES / benchmark.stats.stats.min
