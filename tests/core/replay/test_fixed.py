"""Torque replay against closed forms: gravity, periods, a controller's lag, inverse dynamics, energy; and faults with their joint and time."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from retarget.core.errors import InvalidDataError, MotionError, UsageError
from retarget.core.profile import TorqueControl
from retarget.core.replay.fixed import FixedOptions, replay
from retarget.core.replay.gains import gains
from retarget.core.replay.model import ReplayModel
from retarget.core.replay.thresholds import Thresholds
from retarget.core.replay.torque_law import InverseDynamics
from retarget.core.replay.torque_loop import Signals
from retarget.core.report import ValidationReport
from retarget.core.types import Array, JointTrajectory
from scipy.special import ellipk

from tests.core.replay.plane_arms import FORE, GRAVITY, UPPER, arm, gravity_torque, moving, moving_torque

PENDULUM_WEIGHT = UPPER.mass * GRAVITY * UPPER.centre


def logged(
    trajectory: JointTrajectory, model: ReplayModel, options: FixedOptions | None = None
) -> tuple[ValidationReport, Signals]:
    parts: list[Signals] = []
    report = replay(trajectory, model, options, log=parts.append)
    return report, Signals.joined(parts)


def waving(time: Array) -> Array:
    """Both joints of the arm in sums of sines; no standstill at the start."""
    first = 0.6 * np.sin(2.1 * time) + 0.3 * np.sin(5.3 * time + 0.4)
    return np.stack([first, 0.9 + 0.7 * np.sin(3.7 * time + 1.0)], axis=1)


class TestAgainstClosedForms:
    def test_holding_still_takes_the_weights_torque(self, tmp_path: Path) -> None:
        model, posture = arm(tmp_path, 2), np.array([0.7, -1.9])
        report, signals = logged(moving(model, lambda t: np.tile(posture, (len(t), 1)), 0.5, 50), model)
        np.testing.assert_allclose(signals.torque, np.tile(gravity_torque(posture), (1000, 1)), rtol=1e-12)
        assert report.check("joint_tracking_peak_deg").value == pytest.approx(0, abs=1e-10)
        assert report.check("energy_j").value == pytest.approx(0, abs=1e-10)

    def test_without_torque_a_pendulum_swings_in_its_period(self, tmp_path: Path) -> None:
        amplitude, model = 1.0, arm(tmp_path, 1)
        weak = replace(model, torque_limit_nm=np.zeros(1))
        _, signals = logged(moving(model, lambda t: np.full(len(t), amplitude), 6.0, 50), weak)
        angle, time = signals.position[:, 0], signals.time
        down = np.flatnonzero((angle[:-1] > 0) & (angle[1:] <= 0))
        crossing = time[down] + (time[down + 1] - time[down]) * angle[down] / (angle[down] - angle[down + 1])
        inertia = UPPER.inertia + UPPER.mass * UPPER.centre**2 + model.armature[0]
        period = 4 * np.sqrt(inertia / PENDULUM_WEIGHT) * ellipk(np.sin(amplitude / 2) ** 2)
        assert len(crossing) >= 4
        np.testing.assert_allclose(np.diff(crossing), period, rtol=2e-6)

    def test_the_law_lags_a_sine_as_its_transfer_function_says(self, tmp_path: Path) -> None:
        """With gravity compensated a pendulum is I q̈ = kp e + kv ė: e/q_d = I s² / (I s² + kv s + kp)."""
        model, omega, amplitude = arm(tmp_path, 1), 7.0, 0.5
        chosen = gains(model, "inertia", 30.0)
        inertia = chosen.stiffness[0] / 30.0**2
        _, signals = logged(
            moving(model, lambda t: amplitude * np.sin(omega * t), 6.0, 200),
            model,
            FixedOptions(natural_frequency_rad_s=30.0),
        )
        settled = signals.time > 3.0
        error = (signals.position - signals.reference)[settled, 0]
        s = 1j * omega
        expected = amplitude * abs(inertia * s**2 / (inertia * s**2 + chosen.damping[0] * s + chosen.stiffness[0]))
        assert np.abs(error).max() == pytest.approx(expected, rel=0.01)

    def test_feed_forward_is_the_textbooks_dynamics(self, tmp_path: Path) -> None:
        model, rng = arm(tmp_path, 2), np.random.default_rng(0)
        q, v, a = rng.uniform(-2, 2, (3, 50, 2))
        expected = moving_torque(q, v, a, model.armature)
        np.testing.assert_allclose(InverseDynamics(model).torque(q, v, a), expected, rtol=0, atol=1e-12)

    def test_an_exact_reference_is_followed_exactly(self, tmp_path: Path) -> None:
        """Desired velocities are the integrator's own differences, so what is left is rounding."""
        model = arm(tmp_path, 2, damping=0.4)
        report, signals = logged(moving(model, waving, 3.0, 100), model, FixedOptions(feed_forward=True))
        assert report.check("joint_tracking_peak_deg").value == pytest.approx(0, abs=1e-9)
        velocity = np.gradient(signals.reference, signals.time, axis=0)
        acceleration = np.gradient(velocity, signals.time, axis=0)
        expected = gravity_torque(signals.reference) + 0.4 * velocity
        expected += moving_torque(signals.reference, velocity, acceleration, model.armature)
        np.testing.assert_allclose(signals.torque[5:-5], expected[5:-5], rtol=0, atol=0.02)

    @pytest.mark.parametrize("effort", [500.0, 8.0], ids=["strong", "saturated"])
    def test_the_energy_adds_up(self, tmp_path: Path, effort: float) -> None:
        model = arm(tmp_path, 2, damping=0.3, friction=0.5, effort=effort)
        report, _ = logged(moving(model, waving, 4.0, 100), model)
        gross = float(report.check("energy_balance_error_j").note.split()[1])
        assert gross > 5
        assert report.check("energy_balance_error_j").value == pytest.approx(0, abs=2e-4 * gross)

    def test_lifting_slowly_costs_the_potential_energy(self, tmp_path: Path) -> None:
        model = arm(tmp_path, 1)
        lift = 2.0
        report, _ = logged(moving(model, lambda t: lift * (1 - np.cos(np.pi * t / 4)) / 2, 4.0, 100), model)
        assert report.check("energy_j").value == pytest.approx(PENDULUM_WEIGHT * (1 - np.cos(lift)), rel=5e-3)


class TestFriction:
    def test_compensated_dry_friction_hardly_shows(self, tmp_path: Path) -> None:
        model = arm(tmp_path, 2, friction=2.0)
        motion = moving(model, waving, 3.0, 100)
        values = [
            replay(motion, model, FixedOptions(friction_compensation=on)).check("joint_tracking_rmse_deg").value
            for on in (True, False)
        ]
        smooth = replay(motion, arm(tmp_path, 2)).check("joint_tracking_rmse_deg").value
        assert values[0] is not None
        assert smooth is not None
        assert values[0] == pytest.approx(smooth, rel=0.1)
        assert values[1] is not None
        assert values[1] > 1.5 * values[0]


class TestFaults:
    def test_a_weak_motor_saturates_where_the_weight_passes_its_limit(self, tmp_path: Path) -> None:
        """Raised slowly, so the torque is the weight's: m g l sin(rate t) = limit."""
        rate, limit = 0.2, PENDULUM_WEIGHT / 2
        model = arm(tmp_path, 1, effort=limit)
        report = replay(moving(model, lambda t: rate * t, 4.0, 50), model)
        check = report.check("torque_saturation_percent")
        assert check.passed is False
        assert check.where == "joint0"
        assert check.time_s == pytest.approx(np.arcsin(0.5) / rate, abs=0.02)
        assert report.check("torque_peak_ratio").value == pytest.approx(1, abs=1e-12)
        sag = report.check("joint_tracking_peak_deg")
        assert sag.value is not None
        assert sag.value > 10
        assert sag.time_s == pytest.approx(4.0, abs=0.01)

    def test_halved_torque_limits_show(self, tmp_path: Path) -> None:
        model = arm(tmp_path, 2)
        motion = moving(model, waving, 3.0, 100)
        _, signals = logged(motion, model)
        enough = replace(model, torque_limit_nm=1.01 * np.abs(signals.torque).max(axis=0))
        assert replay(motion, enough).check("torque_saturation_percent").value == 0
        halved = replay(motion, replace(enough, torque_limit_nm=enough.torque_limit_nm / 2))
        assert halved.check("torque_saturation_percent").passed is False

    def test_at_double_rate_torques_grow_as_accelerations_do(self, tmp_path: Path) -> None:
        model = arm(tmp_path, 2)
        motion = moving(model, waving, 3.0, 100)
        fast = replace(motion, time=motion.time / 2)
        slow_torque, fast_torque = (
            signals.torque - gravity_torque(signals.position)
            for _, signals in (logged(each, model, FixedOptions(feed_forward=True)) for each in (motion, fast))
        )
        ratio = np.abs(fast_torque).max(axis=0) / np.abs(slow_torque).max(axis=0)
        np.testing.assert_allclose(ratio, 4.0, rtol=0.02)

    def test_two_swapped_joints_run_into_a_stop(self, tmp_path: Path) -> None:
        model = arm(tmp_path, 2, limits=((-1.5, 0.3), (0.0, 2.5)))
        joints = lambda t: np.stack([-0.6 + 0.5 * np.sin(2 * t), 1.2 + 0.8 * np.sin(2 * t)], axis=1)  # noqa: E731
        motion = moving(model, joints, 3.0, 100)
        assert replay(motion, model).passed
        check = replay(replace(motion, position=motion.position[:, ::-1]), model).check("joint_tracking_peak_deg")
        assert check.passed is False
        assert check.where == "joint0"  # 2.0 rad asked for, stopped at 0.3
        assert check.value == pytest.approx(np.degrees(1.7), abs=10)
        assert check.time_s == pytest.approx(np.pi / 4, abs=0.3)

    def test_a_jump_of_half_a_radian_is_found(self, tmp_path: Path) -> None:
        model = arm(tmp_path, 2)
        motion = moving(model, waving, 3.0, 100)
        position = np.array(motion.position)
        position[150:, 1] += 0.5
        whole, broken = (
            replay(each, model).check("joint_tracking_peak_deg")
            for each in (motion, replace(motion, position=position))
        )
        assert whole.value is not None
        assert broken.value is not None
        assert broken.value > 10 * whole.value
        assert broken.where == "joint1"
        assert broken.time_s == pytest.approx(1.5, abs=0.03)

    def test_a_simulation_that_blows_up_says_so_and_leaves_nothing_behind(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.chdir(tmp_path)
        torque = TorqueControl(stiffness={"joint0": 1e4, "joint1": 1e4}, damping={"joint0": 10.0, "joint1": 5000.0})
        model = arm(tmp_path, 2, torque=torque, effort=0.0)  # 0 = the description states no limit
        before = {path.name for path in tmp_path.iterdir()}
        report, signals = logged(moving(model, waving, 1.0, 100), model)
        check = report.check("simulation_lost_s")
        assert check.passed is False
        assert check.value == pytest.approx(1.0 - len(signals.time) / 2000)
        assert "blew up: gains too high" in check.note
        assert {path.name for path in tmp_path.iterdir()} == before


class TestReport:
    def test_it_is_the_same_each_time_and_whatever_the_joints_order_in_the_file(self, tmp_path: Path) -> None:
        model = arm(tmp_path, 2, friction=0.5)
        motion = moving(model, waving, 1.5, 60)
        swapped = replace(motion, joint_names=motion.joint_names[::-1], position=motion.position[:, ::-1])
        first, *others = (replay(each, model) for each in (motion, motion, swapped))
        for other in others:
            assert other.checks == first.checks
            assert other.facts == first.facts
            for name, values in first.series.items():
                np.testing.assert_array_equal(other.series[name], values)

    def test_series_keep_the_peaks(self, tmp_path: Path) -> None:
        model = arm(tmp_path, 2)
        report = replay(moving(model, waving, 3.0, 100), model)
        assert len(report.series["time"]) == 300
        peak = max(np.abs(report.series[f"joint_error_deg/joint{i}"]).max() for i in (0, 1))
        assert report.check("joint_tracking_peak_deg").value == pytest.approx(peak, rel=1e-12)
        assert report.check("power_peak_w").value == pytest.approx(report.series["power_w"].max(), rel=1e-12)
        shown = report.series["position_deg/joint1"] - report.series["reference_deg/joint1"]
        assert (np.abs(shown) <= np.abs(report.series["joint_error_deg/joint1"]) + 1e-12).all()
        np.testing.assert_allclose(
            report.series["reference_deg/joint0"], np.degrees(waving(report.series["time"])[:, 0]), rtol=0, atol=1e-3
        )
        for i in (0, 1):
            torque = report.facts["joints"][f"joint{i}"]["torque_peak_nm"]
            assert np.abs(report.series[f"torque_nm/joint{i}"]).max() == pytest.approx(torque, rel=1e-12)

    def test_the_log_has_every_step_once(self, tmp_path: Path) -> None:
        model = arm(tmp_path, 1)
        motion = replace(
            moving(model, np.sin, 2.6, 50), time=1e9 + np.arange(131) / 50
        )  # more than one chunk, another clock
        report, signals = logged(motion, model)
        np.testing.assert_allclose(signals.time, 1e9 + np.arange(5200) / 2000, rtol=0, atol=2e-7)
        np.testing.assert_allclose(signals.reference[:, 0], np.sin(np.arange(5200) / 2000), rtol=0, atol=1e-6)
        rms = np.degrees(np.sqrt(np.mean((signals.position - signals.reference) ** 2)))
        assert report.check("joint_tracking_rmse_deg").value == pytest.approx(rms, rel=1e-9)

    def test_sliding_joints_are_judged_in_millimetres(self, tmp_path: Path) -> None:
        """Across gravity, so the force is m ẍ alone; feed-forward leaves nothing over."""
        model = arm(tmp_path, 1, kind="prismatic")
        omega, mass = 4.0, UPPER.mass + model.armature[0]
        report, signals = logged(
            moving(model, lambda t: 0.2 * np.sin(omega * t), 3.0, 100), model, FixedOptions(feed_forward=True)
        )
        assert {check.name for check in report.checks} >= {"joint_tracking_rmse_mm", "joint_tracking_peak_mm"}
        assert "joint_tracking_rmse_deg" not in {check.name for check in report.checks}
        assert report.check("joint_tracking_peak_mm").value == pytest.approx(0, abs=1e-6)
        expected = -mass * 0.2 * omega**2 * np.sin(omega * signals.time)
        np.testing.assert_allclose(signals.torque[100:-100, 0], expected[100:-100], rtol=0, atol=0.02)
        assert len(report.series["joint_error_mm/joint0"]) == len(report.series["time"])

    def test_thresholds_decide(self, tmp_path: Path) -> None:
        model = arm(tmp_path, 2)
        motion = moving(model, waving, 1.0, 100)
        assert replay(motion, model).passed
        strict = replay(motion, model, thresholds=Thresholds("fixed").overridden(["joint_tracking_rmse_deg=0.001"]))
        assert [check.name for check in strict.failures] == ["joint_tracking_rmse_deg"]
        assert strict.failures[0].where in model.robot.joint_names

    def test_unknown_torque_limits_are_not_judged(self, tmp_path: Path) -> None:
        model = arm(tmp_path, 1, effort=0.0)
        report = replay(moving(model, np.sin, 0.5, 50), model)
        check = report.check("torque_saturation_percent")
        assert (check.value, check.passed, check.note) == (None, None, "no joint's torque limit is known")
        assert report.facts["joints"]["joint0"]["torque_limit_nm"] is None


class TestBadInput:
    def test_joints_that_do_not_fit_are_named(self, tmp_path: Path) -> None:
        model = arm(tmp_path, 2)
        motion = moving(model, waving, 0.1, 50)
        with pytest.raises(InvalidDataError, match="robot 'arm' has no joint 'jiont1'; did you mean joint1"):
            replay(replace(motion, joint_names=("joint0", "jiont1")), model)
        with pytest.raises(InvalidDataError, match="lacks 1 of the 2 joints of robot 'arm': joint1"):
            replay(
                replace(
                    motion, joint_names=("joint0",), position=motion.position[:, :1], velocity=motion.velocity[:, :1]
                ),
                model,
            )

    def test_a_single_frame_is_no_motion(self, tmp_path: Path) -> None:
        model = arm(tmp_path, 2)
        with pytest.raises(MotionError, match="has 1 frame and lasts 0 s; replaying under torque needs at least"):
            replay(moving(model, waving, 0.0, 50), model)

    def test_options_that_contradict_the_model(self, tmp_path: Path) -> None:
        model = arm(tmp_path, 2)
        motion = moving(model, waving, 0.1, 50)
        with pytest.raises(UsageError, match="built without; build it with self_collision"):
            replay(motion, model, FixedOptions(self_collision=True))
        with pytest.raises(UsageError, match="build it with a fixed base"):
            replay(motion, replace(model, base_qpos=0, base_qvel=0), FixedOptions())
        with pytest.raises(UsageError, match="thresholds are for mode 'kinematic'"):
            replay(motion, model, thresholds=Thresholds("kinematic"))


def test_the_arm_is_what_the_closed_forms_describe() -> None:
    """Two links that differ in everything: a swapped figure would show."""
    assert len({UPPER.mass, FORE.mass, UPPER.length, FORE.length, UPPER.centre, FORE.centre}) == 6
