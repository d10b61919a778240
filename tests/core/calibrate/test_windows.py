"""Still stretches, mean poses, and what is carried from one place of the chest to another."""

from __future__ import annotations

import numpy as np
import pytest
from retarget.core import rotations
from retarget.core.calibrate.windows import MeanPose, average, in_chest_of, still_stretches
from retarget.core.types import TrackerRecording
from scipy.spatial.transform import Rotation

from tests.core.calibrate.operators import wxyz


def moving(position: np.ndarray, rate_hz: float = 90.0, tracked: np.ndarray | None = None) -> TrackerRecording:
    frames = len(position)
    return TrackerRecording(
        time=10 + np.arange(frames) / rate_hz,
        trackers=("A",),
        orientation=np.broadcast_to([1.0, 0, 0, 0], (frames, 1, 4)),
        position=position[:, None],
        tracked=np.ones((frames, 1), bool) if tracked is None else tracked[:, None],
    )


def path(*pieces: tuple[float, float], rate_hz: float = 90.0) -> np.ndarray:
    """Positions along x: pieces of (duration s, speed m/s)."""
    speed = np.concatenate([np.full(round(duration * rate_hz), v) for duration, v in pieces])
    x = np.cumsum(speed) / rate_hz
    return np.stack([x, 0 * x, 0 * x], axis=-1)


@pytest.mark.parametrize("rate_hz", [30.0, 90.0, 240.0])
def test_still_stretches_are_those_without_movement(rate_hz: float) -> None:
    track = path((1.0, 0.0), (1.0, 1.0), (1.0, 0.0), (0.5, 0.8), (0.3, 0.0), (0.5, 0.8), (4.0, 0.03), rate_hz=rate_hz)
    found = still_stretches(moving(track + np.random.default_rng(0).normal(0, 0.002, track.shape), rate_hz), ["A"])
    assert len(found) == 3
    for (start, end), (first, last) in zip(found, [(10, 11), (12, 13), (14.3, 18.3)], strict=True):
        assert first <= start < end <= last
    assert found[2][1] - found[2][0] == pytest.approx(1.5)
    assert sum(found[2]) / 2 == pytest.approx(16.3, abs=0.1)


def test_a_lost_tracker_is_not_still() -> None:
    track = path((3.0, 0.0))
    tracked = np.ones(len(track), bool)
    tracked[100:170] = False
    found = still_stretches(moving(track, tracked=tracked), ["A"])
    assert len(found) == 2
    assert found[0][1] < 10 + 100 / 90
    assert found[1][0] > 10 + 169 / 90


def test_nobody_stands_still() -> None:
    assert still_stretches(moving(path((3.0, 0.5))), ["A"]) == []
    assert still_stretches(moving(np.zeros((1, 3))), ["A"]) == []


def test_the_mean_takes_tracked_frames_of_the_window_only() -> None:
    track = path((1.0, 0.0), (1.0, 1.0))
    tracked = np.ones(len(track), bool)
    tracked[20:60] = False
    track[20:60] += 5.0
    mean = average(moving(track, tracked=tracked), (10.0, 10 + 89 / 90), "still")
    assert mean.position["A"] == pytest.approx([0, 0, 0])
    assert mean.motion_m["A"] == 0
    nothing = average(moving(track, tracked=np.zeros(len(track), bool)), (10.0, 11.0), "still")
    assert not nothing.position


def test_a_pose_is_carried_with_the_chest() -> None:
    """The whole person moved rigidly: carried back, every tracker is where it was."""
    rng = np.random.default_rng(3)
    names = ("chest", "hand", "head")
    points = {name: rng.normal(size=3) for name in names}
    turns = {name: Rotation.random(random_state=rng) for name in names}
    shift, turn = rng.normal(size=3), Rotation.random(random_state=rng)
    still = MeanPose((0, 1), points, {name: wxyz(q) for name, q in turns.items()}, dict.fromkeys(names, 0.0))
    moved = MeanPose(
        (2, 3),
        {name: turn.apply(p) + shift for name, p in points.items()},
        {name: wxyz(turn * q) for name, q in turns.items()},
        dict.fromkeys(names, 0.0),
    )
    back = in_chest_of(still, moved, "chest")
    for name in names:
        assert back.position[name] == pytest.approx(points[name], abs=1e-12)
        assert rotations.angle(back.orientation[name], still.orientation[name]) < 1e-12
