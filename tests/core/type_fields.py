"""Small whole fields of the types, for tests to break or to build on."""

from __future__ import annotations

from typing import Any

import numpy as np
from retarget.core.types import Array, Source

T = 4
"""Frames of all of them."""
NAMES = ("Pelvis", "T8", "LeftFoot")


def motion_fields() -> dict[str, Any]:
    return {
        "time": np.arange(T) / 60,
        "segments": NAMES,
        "orientation": np.tile([1.0, 0, 0, 0], (T, 3, 1)),
        "position": np.arange(T * 9, dtype=float).reshape(T, 3, 3),
        "angular_velocity": np.ones((T, 3, 3)),
        "foot_contacts": np.zeros((T, 4), bool),
        "measured": np.array([True, True, False]),
        "joint_offsets": {"T8": np.array([0, 0, 0.4])},
        "source": Source("memory", rate_hz=60),
    }


def recording_fields() -> dict[str, Any]:
    return {
        "time": np.arange(T) / 90,
        "trackers": ("LHR-1", "waist"),
        "orientation": np.tile([1.0, 0, 0, 0], (T, 2, 1)),
        "position": np.ones((T, 2, 3)),
        "tracked": np.ones((T, 2), bool),
        "segments": {"waist": "Pelvis"},
    }


def trajectory_fields() -> dict[str, Any]:
    return {
        "time": np.arange(T) / 50,
        "joint_names": ("hip", "knee"),
        "position": np.ones((T, 2)),
        "velocity": np.ones((T, 2)),
        "base_position": np.ones((T, 3)),
        "base_orientation": np.tile([1.0, 0, 0, 0], (T, 1)),
        "base_linear_velocity": np.ones((T, 3)),
        "base_angular_velocity": np.ones((T, 3)),
        "status": np.array([0, 1, 0, 0]),
        "provenance": {"input": "a"},
    }


def task_fields(kind: str = "orientation") -> dict[str, Any]:
    value = {"orientation": [0.0, 1, 0, 0], "position": [5.0, 6, 7], "axis": [0.0, 0.6, 0.8]}[kind]
    return {
        "frame": "head",
        "kind": kind,
        "value": np.tile(value, (T, 1)),
        "feed_forward": np.ones((T, 3)),
        "weight": np.arange(T, dtype=float),
        "offset": np.ones(3),
        "axis": np.array([0.0, 1.0, 0.0]),
    }


def changed(values: Any, at: Any, value: float) -> Array:
    array = np.array(values, float)
    array[at] = value
    return array
