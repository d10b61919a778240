"""Figures added up block by block are those of everything at once."""

from __future__ import annotations

import numpy as np
import pytest
from retarget.core.running_metrics import BINS_PER_DEGREE, Distribution, RunningMetrics


def test_a_distribution() -> None:
    rng = np.random.default_rng(3)
    errors = np.abs(rng.normal(size=5000)) * 20
    found = Distribution()
    for block in np.array_split(errors, 7):
        found.add(block)
    figures = found.figures()
    assert figures["mean"] == pytest.approx(errors.mean(), rel=1e-12)
    assert figures["max"] == errors.max()
    expected = np.percentile(errors, 95, method="inverted_cdf")
    assert figures["p95"] == pytest.approx(expected, abs=0.5 / BINS_PER_DEGREE + 1e-12)
    assert Distribution().figures() == {"mean": None, "p95": None, "max": None}
    straight = Distribution()
    straight.add(np.array([180.0, 0.0]))
    assert straight.figures()["max"] == 180.0


@pytest.mark.parametrize("degrees", [0.0, 1e-4, 180.0])
def test_no_percentile_is_above_the_largest(degrees: float) -> None:
    """Errors that are all the same, and smaller than half a bin."""
    found = Distribution()
    found.add(np.full(10, degrees))
    assert found.figures() == {"mean": pytest.approx(degrees), "p95": degrees, "max": degrees}


def test_blocks_of_other_lengths() -> None:
    """Two blocks, of 30 and 10 frames; two feet, which stand in some of the steps."""
    running = RunningMetrics()
    unchanged = {
        "position_limit_violations": 1, "velocity_limit_violations": 2, "marked_frames": 3,
        "max_velocity_ratio": 0.5, "limit_active_fraction": 0.2, "jerk_rms_rad_s3": 3.0,
        "ground_penetration_mm": {"mean": 1.0, "max": 2.0}, "unmeasured_segments": ["Head"],
    }  # fmt: skip
    for frames, speeds in ((30, [0.1, 0.3, 0.0]), (10, [0.2, 0.0, 0.0])):
        standing = [speed for speed in speeds if speed]
        skate = {"mean": float(np.mean(standing)), "max": max(standing)}
        series = {"limb_direction_error_deg/A": np.full(frames, frames / 10), "foot_skate_m_s/Left": np.array(speeds)}
        running.add({**unchanged, "foot_skate_m_s": skate, "jerk_rms_rad_s3": float(frames)}, series, frames)
    running.add_seam({"velocity_limit_violations": 1, "max_velocity_ratio": 0.9})
    found = running.result()
    assert (found["position_limit_violations"], found["velocity_limit_violations"], found["marked_frames"]) == (2, 5, 6)
    assert found["max_velocity_ratio"] == 0.9
    assert found["limit_active_fraction"] == pytest.approx(0.2)
    assert found["limb_direction_error_deg"]["mean"] == pytest.approx((30 * 3 + 10 * 1) / 40)
    assert found["orientation_error_deg"]["mean"] is None
    assert found["foot_skate_m_s"] == {"mean": pytest.approx((0.1 + 0.3 + 0.2) / 3), "max": 0.3}
    assert found["ground_penetration_mm"] == {"mean": pytest.approx(1.0), "max": 2.0}
    assert found["jerk_rms_rad_s3"] == pytest.approx(np.sqrt((30 * 30**2 + 10 * 10**2) / 40))
    assert found["unmeasured_segments"] == ["Head"]
