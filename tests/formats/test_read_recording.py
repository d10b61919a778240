"""`formats.read_recording`: a person's recording, whatever kind of system made it."""

from __future__ import annotations

import io

import numpy as np
import pytest
from retarget import formats, samples
from retarget.core.errors import UsageError
from retarget.core.types import HumanMotion, JointTrajectory, TrackerRecording

LOG = "time_s,chest_x,chest_y,chest_z,chest_qw,chest_qx,chest_qy,chest_qz\n" + "".join(
    f"{frame / 90:.6f},{frame / 1000},0,1.3,1,0,0,0\n" for frame in range(20)
)


def test_a_suit_gives_a_motion_and_a_log_gives_trackers() -> None:
    motion = formats.read_recording(samples.sample_path("yaw_000"))
    assert isinstance(motion, HumanMotion)
    assert np.array_equal(motion.orientation, formats.read_motion(samples.sample_path("yaw_000")).orientation)
    options = formats.TrackerOptions(up="z")
    log = formats.read_recording(io.BytesIO(LOG.encode()), "log.csv", options=options)
    assert isinstance(log, TrackerRecording)
    same = formats.read_trackers(io.BytesIO(LOG.encode()), "log.csv", options=options)
    assert np.array_equal(log.position, same.position)
    assert log.trackers == same.trackers == ("chest",)


def test_a_robots_trajectory_is_refused() -> None:
    stream = io.BytesIO()
    trajectory = JointTrajectory(np.arange(3.0), ("a",), np.zeros((3, 1)), np.zeros((3, 1)))
    formats.write_trajectory_stream(stream, trajectory, format="mcap")
    stream.seek(0)
    with pytest.raises(UsageError, match=r"walk\.mcap: mcap holds robot trajectories, not a person's motion"):
        formats.read_recording(stream, "walk.mcap")
