"""The figures of `core.metrics` for a clip that comes in blocks, in memory that does not grow with it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from retarget.core.types import Array

BINS_PER_DEGREE = 200
"""Errors are counted in bins so fine that percentiles are right to the digits that are printed."""


class Distribution:
    """Errors in degrees, 0 to 180: their mean and largest exactly, percentiles to half of 1 / `BINS_PER_DEGREE`."""

    def __init__(self) -> None:
        self._counts = np.zeros(180 * BINS_PER_DEGREE + 1, np.int64)
        self._sum, self._max = 0.0, 0.0

    def add(self, degrees: Array) -> None:
        """Count `degrees` (K,) in."""
        places = np.clip((degrees * BINS_PER_DEGREE).astype(int), 0, len(self._counts) - 1)
        self._counts += np.bincount(places, minlength=len(self._counts))
        self._sum += float(degrees.sum())
        self._max = max(self._max, float(degrees.max(initial=0.0)))

    def figures(self) -> dict[str, float | None]:
        """mean, p95 and max; None of nothing."""
        count = int(self._counts.sum())
        if not count:
            return {"mean": None, "p95": None, "max": None}
        at = int(np.searchsorted(np.cumsum(self._counts), 0.95 * count))
        return {"mean": self._sum / count, "p95": min((at + 0.5) / BINS_PER_DEGREE, self._max), "max": self._max}


class RunningMetrics:
    """Adds up what `metrics.measure` says of each block. `result` has its keys, without the tables per limb and link."""

    def __init__(self) -> None:
        self._limb, self._link = Distribution(), Distribution()
        self._frames = 0
        self._counts = {"position_limit_violations": 0, "velocity_limit_violations": 0, "marked_frames": 0}
        self._means: dict[str, float] = {}
        self._most: dict[str, float] = {}
        self._skate = np.zeros(2)  # sum of speeds, steps
        self._unmeasured: list[str] = []

    def add(self, metrics: Mapping[str, Any], series: Mapping[str, Array], frames: int) -> None:
        """Count a block of `frames` frames in."""
        self._frames += frames
        for name, values in series.items():
            if name.startswith("limb_direction_error_deg/"):
                self._limb.add(values)
            elif name.startswith("orientation_error_deg/"):
                self._link.add(values)
        for name in self._counts:
            self._counts[name] += metrics[name]
        self._unmeasured = metrics["unmeasured_segments"]
        self._keep_most("max_velocity_ratio", metrics["max_velocity_ratio"])
        self._keep_mean("limit_active_fraction", metrics["limit_active_fraction"], frames)
        self._keep_mean("jerk", metrics["jerk_rms_rad_s3"] ** 2, frames)
        if (depth := metrics["ground_penetration_mm"]) is not None:
            self._keep_mean("ground_penetration_mm", depth["mean"], frames)
            self._keep_most("ground_penetration_mm", depth["max"])
        if (skate := metrics["foot_skate_m_s"]) is not None:
            total = sum(float(values.sum()) for name, values in series.items() if name.startswith("foot_skate_m_s/"))
            # The mean is over steps in which a foot stands, so that tells how many these were.
            self._skate += np.array([total, total / skate["mean"] if skate["mean"] > 0 else 0.0])
            self._keep_most("foot_skate_m_s", skate["max"])

    def add_seam(self, figures: Mapping[str, Any]) -> None:
        """Count in what `metrics.limit_figures` says of the step from one block to the next."""
        self._counts["velocity_limit_violations"] += figures["velocity_limit_violations"]
        self._keep_most("max_velocity_ratio", figures["max_velocity_ratio"])

    def result(self) -> dict[str, Any]:
        """All blocks so far."""
        return {
            "limb_direction_error_deg": self._limb.figures(),
            "orientation_error_deg": self._link.figures(),
            "hand_position_error_mm": None,
            **self._counts,
            "max_velocity_ratio": self._most.get("max_velocity_ratio", 0.0),
            "limit_active_fraction": self._mean("limit_active_fraction"),
            "jerk_rms_rad_s3": self._mean("jerk") ** 0.5,
            "foot_skate_m_s": self._with_most("foot_skate_m_s", float(self._skate[0] / max(self._skate[1], 1.0))),
            "ground_penetration_mm": self._with_most("ground_penetration_mm", self._mean("ground_penetration_mm")),
            "self_collision_fraction": None,
            "unmeasured_segments": self._unmeasured,
        }

    def _keep_mean(self, name: str, value: float, frames: int) -> None:
        self._means[name] = self._means.get(name, 0.0) + frames * value

    def _keep_most(self, name: str, value: float) -> None:
        self._most[name] = max(self._most.get(name, 0.0), value)

    def _mean(self, name: str) -> float:
        return self._means.get(name, 0.0) / max(self._frames, 1)

    def _with_most(self, name: str, mean: float) -> dict[str, float] | None:
        return {"mean": mean, "max": self._most[name]} if name in self._most else None
