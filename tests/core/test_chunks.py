"""Clips in parts: no frame twice, none left out, and sums as of the whole."""

from __future__ import annotations

import numpy as np
import pytest
from retarget.core import chunks, kinematics


@pytest.mark.parametrize("frames", [0, 1, 6, 7, 8, 20, 21])
def test_chunks_cover_every_frame_once(monkeypatch: pytest.MonkeyPatch, frames: int) -> None:
    monkeypatch.setattr(chunks, "CHUNK_FRAMES", 7)
    parts = list(chunks.frame_chunks(frames))
    assert [t for part in parts for t in range(part.start, part.stop)] == list(range(frames))
    assert all(0 < part.stop - part.start <= 7 for part in parts)


@pytest.mark.parametrize("columns", [(), (3,), (2, 3)])
def test_gathered_is_the_whole(monkeypatch: pytest.MonkeyPatch, columns: tuple[int, ...]) -> None:
    monkeypatch.setattr(chunks, "CHUNK_FRAMES", 7)
    values = np.random.default_rng(4).normal(size=(50, *columns))
    doubled = chunks.gathered(50, lambda part: 2 * values[part], columns)
    np.testing.assert_array_equal(doubled, 2 * values)
    assert doubled.sum() == (2 * values).sum()
    assert chunks.gathered(0, lambda part: values[part], columns).shape == (0, *columns)


def test_kinematics_cut_a_clip_at_the_same_frames() -> None:
    assert chunks.CHUNK_FRAMES % kinematics.CHUNK == 0
