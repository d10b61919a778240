"""The samples' operator, who breathes and sways, calibrated from the logs: what the JSON beside them says, which no reader has made."""

from __future__ import annotations

import json
from functools import cache
from typing import Any

import numpy as np
import pytest
from retarget import formats, samples
from retarget.core.calibrate.operator import calibrate
from retarget.core.calibration import Calibration
from retarget.core.types import TrackerRecording
from retarget.formats import TrackerOptions
from scipy.spatial.transform import Rotation

SIDES = ("Left", "Right")


@cache
def truth(name: str) -> dict[str, Any]:
    loaded: dict[str, Any] = json.loads(samples.sample_path(name).with_suffix(".json").read_text())
    return loaded


@cache
def calibrated(name: str, *, given: bool) -> Calibration:
    """With the true windows, or those found."""
    log = formats.read_trackers(samples.sample_path(name), options=TrackerOptions(up="y"))
    assert isinstance(log, TrackerRecording)
    windows = {pose: (start, end) for pose, (start, end) in truth(name)["windows_s"].items()}
    return calibrate(log, windows=windows if given else None)


def _wxyz(values: Any) -> Rotation:
    return Rotation.from_quat(np.asarray(values)[[1, 2, 3, 0]])


def shoulder_errors_m(found: Calibration, expected: dict[str, Any]) -> list[float]:
    """How far the shoulders are from where they are on the chest, in the axes of the chest's tracker: whatever way it is strapped on."""
    errors = []
    for side in SIDES:
        from_tracker = np.subtract(expected["shoulder_in_chest_m"][side], expected["tracker_position_m"]["T8"])
        true = _wxyz(expected["tracker_rotation"]["T8"]).apply(from_tracker)
        # The chest's frame is upright and ahead in the Still pose, as is the operator frame.
        seen = _wxyz(found.tracker_rotation["T8"]).apply(found.arms[side].shoulder - found.chest_position)
        errors.append(float(np.linalg.norm(seen - true)))
    return errors


@pytest.mark.parametrize("given", [True, False], ids=["windows given", "windows found"])
def test_the_sway_does_no_harm_to_the_shoulders(given: bool) -> None:
    """Hands go with the chest, so that only the second order of its sway is left, and the digits of the file: some micrometres."""
    found, expected = calibrated("calibration_trackers", given=given), truth("calibration_trackers")
    assert max(shoulder_errors_m(found, expected)) < 1e-5
    for side in SIDES:
        assert found.arms[side].length_m == pytest.approx(expected["arm_length_m"], abs=1e-5)
        assert found.arms[side].angles_deg == pytest.approx(expected["angles_deg"][side], abs=1e-3)
    assert found.warnings == ()


@pytest.mark.parametrize(("given", "angle_deg", "point_m"), [(True, 1e-3, 1e-5), (False, 0.03, 3e-4)])
def test_axes_are_those_of_the_upright_body(given: bool, angle_deg: float, point_m: float) -> None:
    """It sways evenly about it in the true windows; those found lie some hundredths of a second off."""
    found, expected = calibrated("calibration_trackers", given=given), truth("calibration_trackers")
    assert np.degrees(found.heading_rad - expected["heading_rad"]) == pytest.approx(0, abs=angle_deg)
    for segment, rotation in expected["tracker_rotation"].items():
        off = _wxyz(found.tracker_rotation[segment]).inv() * _wxyz(rotation)
        assert np.degrees(off.magnitude()) < angle_deg, segment
    for side in SIDES:
        assert found.arms[side].basis == pytest.approx(np.array(expected["basis_m"][side]), abs=point_m)


def test_windows_are_found_where_the_poses_are_held() -> None:
    found, expected = calibrated("calibration_trackers", given=False), truth("calibration_trackers")
    for pose, (start, end) in expected["windows_s"].items():
        assert found.windows_s[pose] == pytest.approx((start, end), abs=0.15)


@pytest.mark.parametrize("given", [True, False], ids=["windows given", "windows found"])
def test_trackers_that_go_by_serial_number_with_faults(given: bool) -> None:
    """0.5 mm and 2 mrad of noise, the right hand lost for a moment, repeated rows: which tracker is where comes from geometry."""
    found, expected = calibrated("calibration_serials", given=given), truth("calibration_serials")
    assert dict(found.trackers) == dict(zip(expected["segments"], expected["trackers"], strict=True))
    assert max(shoulder_errors_m(found, expected)) < 5e-4
    for side in SIDES:
        assert found.arms[side].basis == pytest.approx(np.array(expected["basis_m"][side]), abs=1e-3)
