"""Tracker logs made of arrays, as text, without anything of the readers under test."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from retarget import formats
from retarget.core.types import TrackerRecording
from retarget.formats import TrackerOptions
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")


def wxyz(rotation: Rotation) -> Array:
    return rotation.as_quat()[..., [3, 0, 1, 2]]


def rotation(quaternion: ArrayLike) -> Rotation:
    return Rotation.from_quat(np.asarray(quaternion)[..., [1, 2, 3, 0]])


def poses(position: ArrayLike, turned: Rotation | None = None) -> Array:
    """(T, 7): positions (T, 3) and orientations as wxyz, the identity when not given."""
    position = np.atleast_2d(np.asarray(position, float))
    quaternion = np.tile([1.0, 0, 0, 0], (len(position), 1)) if turned is None else np.atleast_2d(wxyz(turned))
    return np.hstack([position, quaternion])


def wandering(frames: int, seed: int = 0, rate_hz: float = 100.0, about: Sequence[float] = (0.1, 1.2, -0.4)) -> Array:
    """(T, 7): a smooth motion in all six degrees of freedom, a hand's speed, `about` a place with Y up."""
    rng = np.random.default_rng(seed)
    time = np.arange(frames)[:, None] / rate_hz
    phase, angular = rng.uniform(0, 6, (2, 3))
    return poses(
        np.array(about) + 0.2 * np.sin(2 * time + phase), Rotation.from_rotvec(0.8 * np.cos(1.5 * time + angular))
    )


def text(header: Sequence[str], rows: Sequence[Sequence[Any]], delimiter: str = ",", end: str = "\n") -> str:
    """Numbers as the shortest text that gives them back."""

    def cell(value: Any) -> str:
        return value if isinstance(value, str) else repr(float(value))

    lines = [delimiter.join(header), *(delimiter.join(map(cell, row)) for row in rows)]
    return end.join(lines) + end


def wide(time: ArrayLike, **trackers: Array) -> str:
    """A wide log, columns `<tracker>_x` …"""
    names = ["time_s", *(f"{tracker}_{part}" for tracker in trackers for part in POSE)]
    return text(names, np.hstack([np.asarray(time)[:, None], *trackers.values()]).tolist())


def read(content: str | bytes, *, format: str = "vive", up: Any = "y", **options: Any) -> TrackerRecording:
    data = content.encode() if isinstance(content, str) else content
    return formats.read_trackers(io.BytesIO(data), "log", format, TrackerOptions(up=up, **options))


def in_house(position: ArrayLike) -> Array:
    """OpenVR's right, up, backward as forward, left, up."""
    right, up, backward = np.moveaxis(np.asarray(position, float), -1, 0)
    return np.stack([-backward, -right, up], axis=-1)


def path_length(position: ArrayLike) -> float:
    return float(np.linalg.norm(np.diff(np.asarray(position), axis=0), axis=-1).sum())
