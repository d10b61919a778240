"""The packaged robots follow the project's samples on a fixed base; what saturates is what is too weak, and nothing else."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from retarget import formats
from retarget.core.pipeline import ConvertOptions, convert
from retarget.core.replay.fixed import FixedOptions, replay
from retarget.core.replay.gains import gains
from retarget.core.replay.model import ReplayModel, build
from retarget.core.report import ValidationReport
from retarget.core.robot_model import RobotModel
from retarget.core.timebase import cut
from retarget.core.types import JointTrajectory

from tests.conftest import REPOSITORY

RobotFactory = Callable[[str], RobotModel]


@pytest.fixture(scope="module")
def model_of(build_robot: RobotFactory) -> Callable[[str], ReplayModel]:
    """Built once per robot."""
    return cache(lambda name: build(build_robot(name), base="fixed"))


@pytest.fixture(scope="module")
def trajectory_of(build_robot: RobotFactory) -> Callable[[str, str], JointTrajectory]:
    """`trajectory_of(robot, sample)`: the sample's first four seconds, cut before conversion, which then needs no more of it."""

    @cache
    def converted(robot: str, sample: str) -> JointTrajectory:
        motion = formats.read_motion(REPOSITORY / "samples" / f"{sample}.mvnx.gz")
        return convert(cut(motion, None, 4.0), build_robot(robot), ConvertOptions(rate_hz=50.0)).trajectory

    return converted


@pytest.fixture(scope="module")
def report_of(
    trajectory_of: Callable[[str, str], JointTrajectory], model_of: Callable[[str], ReplayModel]
) -> Callable[..., ValidationReport]:
    """`report_of(robot, sample, options)`, each once."""
    return cache(lambda robot, sample, *options: replay(trajectory_of(robot, sample), model_of(robot), *options))


@pytest.mark.parametrize(
    ("robot", "sample", "rmse_deg"),
    [
        ("g1", "walk", 0.3),
        ("g1", "squat", 0.3),
        ("icub", "walk", 0.8),
        ("icub", "reach", 0.8),
        ("talos", "walk", 1.5),
        ("talos", "reach", 1.5),
    ],
)
def test_robots_follow_within_their_motors_limits(
    report_of: Callable[..., ValidationReport], robot: str, sample: str, rmse_deg: float
) -> None:
    report = report_of(robot, sample)
    rmse = report.check("joint_tracking_rmse_deg").value
    assert rmse is not None
    assert rmse <= rmse_deg
    assert report.check("torque_saturation_percent").value == 0
    assert report.passed
    gross = float(report.check("energy_balance_error_j").note.split()[1])
    assert report.check("energy_balance_error_j").value == pytest.approx(0, abs=1e-3 * gross)


def test_baxters_shoulder_cannot_hold_the_stretched_arm(report_of: Callable[..., ValidationReport]) -> None:
    check = report_of("baxter", "reach").check("torque_saturation_percent")
    assert check.passed is False
    assert check.where in ("left_s1", "right_s1")
    assert check.value is not None
    assert check.value > 10


def test_baxters_shoulder_is_asked_for_more_than_it_has(report_of: Callable[..., ValidationReport]) -> None:
    check = report_of("baxter", "reach").check("reference_torque_ratio_max")
    assert check.value is not None
    assert check.value > 1.1
    assert check.where.endswith("_s1")


def test_what_tocabis_standing_gains_saturate_its_motors_can_do(report_of: Callable[..., ValidationReport]) -> None:
    """The authors' gains for standing legs damp one that swings in the air at a fifth of critical: it rings against its limit."""
    own = report_of("tocabi", "walk", FixedOptions(gains="profile"))
    fed = report_of("tocabi", "walk", FixedOptions(gains="profile", feed_forward=True))
    saturated, asked = own.check("torque_saturation_percent"), own.check("reference_torque_ratio_max")
    assert saturated.where.endswith("_HipPitch_Joint")
    assert saturated.note.endswith("the rest is the controller's, whose gains damp it at 0.22 of critical")
    assert asked.value is not None
    assert 0.6 < asked.value < 0.9
    assert fed.check("torque_saturation_percent").value == 0
    assert fed.check("reference_torque_ratio_max").value == asked.value


@pytest.mark.parametrize("sample", ["walk", "reach"])
def test_tocabi_follows_by_its_authors_gains_and_swings_its_legs_by_others(
    report_of: Callable[..., ValidationReport], sample: str
) -> None:
    report = report_of("tocabi", sample)
    joints = report.facts["joints"]
    legs = {name for name in joints if any(part in name for part in ("Hip", "Knee", "Ankle"))}
    assert len(legs) == 12
    assert {name for name, joint in joints.items() if joint["gains_from"] == "inertia"} == legs
    elbow = joints["L_Elbow_Joint"]
    assert (elbow["stiffness_nm_rad"], elbow["damping_nms_rad"], elbow["torque_limit_nm"]) == (125.0, 2.5, 23.0)
    assert joints["L_HipPitch_Joint"]["damping_ratio"] == pytest.approx(1)
    assert report.check("torque_saturation_percent").value == 0
    assert report.passed


def test_tocabi_has_its_authors_gains_throughout_on_request(report_of: Callable[..., ValidationReport]) -> None:
    report = report_of("tocabi", "reach", FixedOptions(gains="profile"))
    joints = report.facts["joints"]
    assert {joint["gains_from"] for joint in joints.values()} == {"profile"}
    knee = joints["R_Knee_Joint"]
    assert (knee["stiffness_nm_rad"], knee["damping_nms_rad"]) == (4500.0, 70.0)
    assert report.passed


def test_feed_forward_leaves_next_to_nothing(report_of: Callable[..., ValidationReport]) -> None:
    report = report_of("g1", "squat", FixedOptions(feed_forward=True))
    assert report.check("joint_tracking_peak_deg").value == pytest.approx(0, abs=1e-3)


@pytest.mark.parametrize("robot", ["g1", "icub", "talos", "tocabi", "baxter"])
def test_2000_hz_is_fast_enough_for_the_default_gains(model_of: Callable[[str], ReplayModel], robot: str) -> None:
    """Explicit damping over a step h is stable while h times the largest eigenvalue of M⁻¹ Kv stays below 2."""
    import mujoco

    model = model_of(robot)
    damping = np.diag(gains(model).damping)
    data, mass = mujoco.MjData(model.mj), np.zeros((model.mj.nv, model.mj.nv))
    rng = np.random.default_rng(0)
    lower, upper = model.robot.lower, model.robot.upper
    for posture in [model.robot.reference_posture, *rng.uniform(lower, upper, (20, len(lower)))]:
        data.qpos[model.qpos] = posture
        mujoco.mj_forward(model.mj, data)
        mujoco.mj_fullM(model.mj, data, mass)
        rates = np.linalg.eigvals(np.linalg.solve(mass[np.ix_(model.qvel, model.qvel)], damping)).real
        assert rates.max() / 2000 < 1.5


def test_a_hand_pressed_into_the_torso_shows_with_self_collision(build_robot: RobotFactory) -> None:
    model = build(build_robot("g1"), base="fixed", self_collision=True)
    names, time = model.robot.joint_names, np.arange(101) / 50
    position = np.zeros((101, len(names)))
    inward = (1 - np.cos(np.pi * time / 2)) / 2
    for name, values in {
        "left_shoulder_roll_joint": 0.3 - 0.5 * inward,
        "left_shoulder_yaw_joint": -1.2 * inward,
        "left_elbow_joint": 0.9,
        "right_shoulder_roll_joint": -0.3,
    }.items():
        position[:, names.index(name)] = values
    motion = JointTrajectory(time, names, position, np.gradient(position, time, axis=0))
    through = replay(motion, model).check("joint_tracking_peak_deg")
    stopped = replay(motion, model, FixedOptions(self_collision=True)).check("joint_tracking_peak_deg")
    assert through.value == pytest.approx(0, abs=0.1)
    assert stopped.value is not None
    assert stopped.value > 5
    assert stopped.where.startswith("left_")
    assert stopped.time_s is not None
    assert stopped.time_s > 1


def test_halving_talos_torque_limits_is_seen(
    trajectory_of: Callable[[str, str], JointTrajectory],
    model_of: Callable[[str], ReplayModel],
    report_of: Callable[..., ValidationReport],
) -> None:
    model, ratio = model_of("talos"), report_of("talos", "walk").check("torque_peak_ratio")
    assert ratio.value is not None
    assert ratio.value > 0.5
    halved = replay(trajectory_of("talos", "walk"), replace(model, torque_limit_nm=model.torque_limit_nm / 2))
    check = halved.check("torque_saturation_percent")
    assert check.passed is False
    assert check.where.replace("left", "right") == ratio.where.replace("left", "right")


def test_damping_that_would_eat_the_motors_torque_is_a_placeholder(model_of: Callable[[str], ReplayModel]) -> None:
    """iCub's description gives 1 Nms/rad to all joints: a hip of 84 Nm at 10 rad/s can have that, a wrist of 0.45 Nm can't."""
    icub, talos = model_of("icub"), model_of("talos")
    damping = dict(zip(icub.robot.joint_names, icub.damping_nms_rad, strict=True))
    assert damping["l_hip_pitch"] == damping["r_ankle_roll"] == 1.0
    assert {name for name, value in damping.items() if value == 0} == {
        f"{side}_wrist_{axis}" for side in "lr" for axis in ("prosup", "pitch", "yaw")
    }
    arms = [name.startswith("arm_") for name in talos.robot.joint_names]
    assert (talos.damping_nms_rad[arms] == 1.0).all()
