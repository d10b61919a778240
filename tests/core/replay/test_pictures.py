"""Pictures without a screen: the model is in them, where it should be and as large as it should be. Skipped where nothing can draw."""

from __future__ import annotations

import contextlib
from typing import Any

import mujoco
import numpy as np
import pytest
from retarget.core.errors import UsageError
from retarget.core.replay.pictures import Painter, show

SIZE = (120, 90)


BOX = """<mujoco><worldbody>
<body name="base"><freejoint/><geom type="box" size=".1 .1 .5" rgba="1 0 0 1" group="3"/></body>
</worldbody></mujoco>"""


def painter(model: Any, postures: Any, **options: Any) -> Any:
    try:
        return Painter(model, postures, width=SIZE[0], height=SIZE[1], **options)
    except UsageError as error:
        pytest.skip(str(error))


def red(image: Any) -> Any:
    return (image[..., 0].astype(int) - image[..., 1] > 60) & (image[..., 2] < 120)


def test_the_robot_is_in_the_middle_whole_and_the_camera_follows_it() -> None:
    model = mujoco.MjModel.from_xml_string(BOX)
    postures = np.array([[0.0, 0, 0, 1, 0, 0, 0], [3.0, -2, 0, 1, 0, 0, 0]])
    with painter(model, postures) as draw:
        pictures = [draw.draw(posture) for posture in postures]
    for picture in pictures:
        assert picture.shape == (SIZE[1], SIZE[0], 3)
        rows, columns = np.nonzero(red(picture))
        assert 0 < rows.min() < rows.max() < SIZE[1] - 1
        assert rows.max() - rows.min() > 0.5 * SIZE[1]
        assert abs(columns.mean() - SIZE[0] / 2) < 4
        assert picture[2, 2].min() > 200  # what is behind is light


def test_the_person_stands_left_of_the_robot_on_the_same_height() -> None:
    model = mujoco.MjModel.from_xml_string(BOX)
    posture = np.array([[0.0, 0, 0, 1, 0, 0, 0]])
    person = np.array([[[5.0, 5.0, 0.0], [5.0, 5.0, 1.0]]])
    with painter(model, posture, person=(person, np.array([[0, 1]]))) as draw:
        picture = draw.draw(posture[0], person[0])
    robot, dark = red(picture), picture.max(axis=-1) < 110
    assert dark.any()
    assert np.nonzero(dark)[1].max() < np.nonzero(robot)[1].min()
    assert abs(np.nonzero(dark)[0].max() - np.nonzero(robot)[0].max()) < 0.1 * SIZE[1]


@pytest.mark.parametrize("points", [0, 2])
def test_a_person_of_whom_no_point_is_known_is_not_drawn(points: int) -> None:
    """Orientations alone: the recording's figure has no points, or none that are known."""
    model = mujoco.MjModel.from_xml_string(BOX)
    posture = np.array([[0.0, 0, 0, 1, 0, 0, 0]])
    person = np.full((1, points, 3), np.nan)
    with painter(model, posture) as draw:
        alone = draw.draw(posture[0])
    with painter(model, posture, person=(person, np.array([[0, 1]][: points // 2]))) as draw:
        np.testing.assert_array_equal(draw.draw(posture[0], person[0]), alone)


class Viewer:
    """Stands in for MuJoCo's window: open for `frames` pictures, and remembers what was shown."""

    def __init__(self, data: Any, frames: int) -> None:
        self.data, self.left, self.shown = data, frames, []

    def __enter__(self) -> Any:
        return self

    def __exit__(self, *_: object) -> None: ...

    def lock(self) -> Any:
        return contextlib.nullcontext()

    def is_running(self) -> bool:
        self.left -= 1
        return self.left >= 0

    def sync(self) -> None:
        self.shown.append((self.data.time, self.data.qpos[0]))


def test_the_window_replays_in_real_time_and_starts_again(monkeypatch: pytest.MonkeyPatch) -> None:
    import time as clock

    import mujoco.viewer

    windows = []

    def launch(_model: Any, data: Any) -> Viewer:
        windows.append(Viewer(data, 60))
        return windows[0]

    now = [100.0]
    monkeypatch.setattr(mujoco.viewer, "launch_passive", launch)
    monkeypatch.setattr(clock, "monotonic", lambda: now[0])
    monkeypatch.setattr(clock, "sleep", lambda seconds: now.__setitem__(0, now[0] + seconds))
    model = mujoco.MjModel.from_xml_string(BOX)
    time = 5.0 + np.arange(48) / 100
    postures = np.tile([0.0, 0, 0, 1, 0, 0, 0], (48, 1))
    postures[:, 0] = np.arange(48)
    show(model, time, postures)
    shown = np.array(windows[0].shown)
    expected = 5.0 + (np.arange(60) / 60) % 0.47
    np.testing.assert_allclose(shown[:, 0], expected, atol=1e-6)
    assert np.abs(shown[:, 1] - 100 * (expected - 5.0)).max() <= 1.0 + 1e-6
