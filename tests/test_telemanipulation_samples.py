"""The tracker samples end to end: calibrated, mapped to TOCABI and solved by strict priorities, against the truth beside them."""

from __future__ import annotations

import json
from functools import cache
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from retarget import formats, robots, samples
from retarget.core import comparison, experiments, mapping, robot_model
from retarget.core.calibrate.apply import apply
from retarget.core.calibrate.operator import calibrate
from retarget.core.calibration import POSES, SIDES, Calibration
from retarget.core.kinematics import position_errors
from retarget.core.robot_model import RobotModel
from retarget.core.solve.hierarchical import HierarchicalOptions, HierarchicalSolution, HierarchicalSolver, solve
from retarget.core.solve.task_samples import TaskSamples
from retarget.core.types import HumanMotion, Targets, TrackerRecording
from scipy.spatial.transform import Rotation

from tests.core.solve.hierarchies import largest_change

CALIBRATIONS = {"calibration_trackers": "clean", "calibration_serials": "noise"}
STEP_S = 5e-3
"""One over the largest gain: the longest control step with which errors don't swing."""


@cache
def truth(name: str) -> dict[str, Any]:
    loaded: dict[str, Any] = json.loads(samples.sample_path(name).with_suffix(".json").read_text(encoding="utf-8"))
    return loaded


@cache
def recording(name: str) -> TrackerRecording:
    found = formats.read_recording(samples.sample_path(name))
    assert isinstance(found, TrackerRecording)
    return found


@cache
def calibration(name: str = "calibration_trackers", *, told: bool = False) -> Calibration:
    """told: with the windows that the JSON states; else it has to find them."""
    windows = {pose: tuple(truth(name)["windows_s"][pose]) for pose in POSES} if told else None
    return calibrate(recording(name), windows=windows)


@cache
def motion(name: str) -> HumanMotion:
    return apply(calibration(), recording(name))


@cache
def tocabi() -> RobotModel:
    return robot_model.build(robots.load("tocabi"))


@cache
def carrying() -> tuple[Targets, HierarchicalSolution]:
    """The box on TOCABI."""
    targets = mapping.load("hand_position").targets(motion("box_trackers"), tocabi())
    return targets, solve(targets, tocabi(), HierarchicalOptions(control_step_s=STEP_S))


def scipy(wxyz: Any) -> Rotation:
    return Rotation.from_quat(np.array(wxyz)[[1, 2, 3, 0]])


@pytest.mark.parametrize("told", [True, False], ids=["windows told", "windows found"])
@pytest.mark.parametrize("name", CALIBRATIONS)
class TestCalibration:
    """The serials' log names no roles, and has noise of 0.5 mm and 2 mrad and lost poses."""

    def test_shoulders_and_arms(self, name: str, told: bool) -> None:
        found, true = calibration(name, told=told), truth(name)
        tolerance = {"clean": 0.002, "noise": 0.015}[CALIBRATIONS[name]]
        # In the world: without a tracker on it nobody knows the height of the pelvis, the operator frame's origin.
        measured, actual = (Rotation.from_euler("z", yaw) for yaw in (found.heading_rad, true["heading_rad"]))
        for side in SIDES:
            shoulder = measured.apply(np.array(found.arms[side].shoulder)) + found.origin
            expected = actual.apply(true["shoulder_m"][side]) + true["origin_m"]
            assert np.linalg.norm(shoulder - expected) < tolerance
            assert found.arms[side].length_m == pytest.approx(true["arm_length_m"], abs=tolerance)
            assert found.arms[side].angles_deg == pytest.approx(true["angles_deg"][side], abs=0.1)

    def test_trackers(self, name: str, told: bool) -> None:
        found, true = calibration(name, told=told), truth(name)
        assert found.trackers == dict(zip(true["segments"], true["trackers"], strict=True))
        assert set(found.tracker_rotation) == set(true["segments"])
        for segment, rotation in found.tracker_rotation.items():
            away = scipy(rotation).inv() * scipy(true["tracker_rotation"][segment])
            assert np.degrees(away.magnitude()) < 0.1, segment

    def test_heading_origin_and_windows(self, name: str, told: bool) -> None:
        found, true = calibration(name, told=told), truth(name)
        assert np.degrees(found.heading_rad - true["heading_rad"]) == pytest.approx(0.0, abs=0.1)
        assert found.origin[:2] == pytest.approx(true["origin_m"][:2], abs=0.002)
        assert found.origin[2] == pytest.approx(true["origin_m"][2], abs=0.05)  # from usual proportions
        for pose in POSES:
            assert found.windows_s[pose] == pytest.approx(true["windows_s"][pose], abs=0.2)
        assert found.warnings == ()


@pytest.mark.parametrize("side", SIDES)
def test_circles_get_rounder(side: str) -> None:
    """[Lim2022 table IV]: meant as circles, drawn in the skewed axes of the operator's own poses. The baselines keep them as drawn; what the
    poses can undo, more than half, the mapping undoes; what is left is the chest's sway and the hand's unsteadiness."""
    window = tuple(truth("circles_trackers")["windows_s"]["circles"])
    found = comparison.circles(motion("circles_trackers"), tocabi(), experiments.HAND_MAPPINGS, window)
    index = found[side].index
    assert index["hand_position"] < 0.5 * index["original"]
    for baseline in ("proportional", "absolute"):
        assert index[baseline] == pytest.approx(index["original"], rel=1e-6)


class TestBoxOnTocabi:
    def test_hands_follow(self) -> None:
        """Within 5 mm on average, and within half a millimetre while they hold the box."""
        targets, solution = carrying()
        assert solution.unconverged == solution.failed_levels == 0
        assert not solution.status.any()
        start, end = truth("box_trackers")["windows_s"]["held"]
        time = motion("box_trackers").time
        held = (time >= start) & (time <= end)
        errors = position_errors(tocabi(), targets, solution.joints)
        assert len(errors) == 2
        for error in errors.values():
            assert error.mean() < 0.005
            assert error[held].max() < 0.0005

    def test_hand_points_by_pinocchio(self) -> None:
        """What is reported as errors is what another FK of the solution's joints finds."""
        targets, solution = carrying()
        model = tocabi()
        errors = position_errors(model, targets, solution.joints)
        data = model.pin_model.createData()
        for frame in (0, 300, 600):
            pin.framesForwardKinematics(model.pin_model, data, model.configuration(solution.joints[frame]))
            for task in targets.tasks:
                if task.kind == "position":
                    point = data.oMf[model.pin_model.getFrameId(task.frame)].act(task.offset)
                    error = np.linalg.norm(point - task.value[frame])
                    assert error == pytest.approx(errors[task.segment][frame], abs=1e-9)

    def test_limits_hold(self) -> None:
        model, joints = tocabi(), carrying()[1].joints
        assert ((joints >= model.lower) & (joints <= model.upper)).all()
        speed = np.abs(np.diff(joints, axis=0)) / np.diff(motion("box_trackers").time)[:, None]
        assert (speed <= model.velocity_limit * (1 + 1e-9)).all()

    def test_lower_levels_leave_higher_ones_alone(self) -> None:
        """Along the whole clip: what a level's tasks get doesn't change by 1e-6 m/s or rad/s when the levels below are solved, too."""
        targets, solution = carrying()
        model = tocabi()
        solver = HierarchicalSolver(targets, model, HierarchicalOptions(control_step_s=STEP_S))
        assert len(solver.levels) == 4
        wanted = TaskSamples(solver.tasks, model)
        time, largest = motion("box_trackers").time, 0.0
        for frame in range(1, len(time) - 1, 10):
            step = solution.joints[frame] - solution.joints[frame - 1]
            before = step[solver.columns] / (time[frame] - time[frame - 1])
            found = solver.step(solution.joints[frame], wanted.at(frame), frame, before, STEP_S)
            assert found.failed is None
            largest = max(largest, largest_change(solver, before, found.velocity, STEP_S))
            assert (found.freedom[:3] > 0).all(), "nothing was left for the upper arms to do"
        assert largest < 1e-6
