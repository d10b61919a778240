"""Films: frames and their rate, whole files or none. Needs the extra [video]."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from retarget.cli import video

av = pytest.importorskip("av", reason="the extra [video] is not installed")


def images() -> list[Any]:
    return [np.full((48, 64, 3), (shade, 0, 255 - shade), np.uint8) for shade in range(0, 250, 10)]


def test_what_was_drawn_is_in_the_film(tmp_path: Path) -> None:
    path = tmp_path / "film.mp4"
    video.write_mp4(path, images(), 30)
    with av.open(str(path)) as film:
        frames = [frame.to_ndarray(format="rgb24") for frame in film.decode(video=0)]
        assert film.streams.video[0].average_rate == 30
    assert len(frames) == len(images())
    for frame, image in zip(frames, images(), strict=True):
        assert np.abs(frame.mean(axis=(0, 1)) - image[0, 0]).max() < 12
    assert list(tmp_path.iterdir()) == [path]


def test_a_film_that_fails_leaves_nothing(tmp_path: Path) -> None:
    def failing() -> Any:
        yield from images()[:3]
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        video.write_mp4(tmp_path / "film.mp4", failing(), 30)
    assert list(tmp_path.iterdir()) == []


def test_captions_are_below_and_warnings_red() -> None:
    image = np.full((240, 320, 3), 255, np.uint8)
    captioned = video.captioned(image, "1.00 s", "left_elbow")
    changed = np.nonzero((captioned != image).any(axis=-1))[0]
    assert changed.min() > 0.8 * 240
    difference = captioned[..., 0].astype(int) - captioned[..., 1]
    assert difference.max() > 100
