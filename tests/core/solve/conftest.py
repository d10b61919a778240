"""Robots and made-up targets for the solver's tests."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from retarget import formats, robots, samples
from retarget.core import robot_model, rotations
from retarget.core.kinematics import link_poses
from retarget.core.profile import ModelSource, RobotProfile
from retarget.core.robot_model import RobotModel
from retarget.core.solve.problem import OrientationProblem
from retarget.core.types import Array, HumanMotion, Targets, Task
from scipy.spatial.transform import Rotation

RATE_HZ = 60.0


@cache
def _motion(sample: str) -> HumanMotion:
    return formats.read_motion(samples.sample_path(sample))


@cache
def _model(name: str) -> RobotModel:
    return robot_model.build(robots.load(name), _motion("walk"))


@pytest.fixture(scope="session")
def motion() -> Callable[[str], HumanMotion]:
    """Sample name → motion."""
    return _motion


@pytest.fixture(scope="session")
def model() -> Callable[[str], RobotModel]:
    """Robot name → model; the human's from the walk."""
    return _model


@pytest.fixture(scope="session")
def swinging() -> Callable[..., Targets]:
    """Targets that a robot's joints swinging within ±amplitude would reach, each link's turned away by a constant `misalignment` rad (σ)."""

    def make(
        robot: RobotModel,
        frames: int = 60,
        *,
        seed: int = 0,
        amplitude: float = 0.6,
        misalignment: float = 0.2,
        twist_weight: float = 1.0,
        rate_hz: float = RATE_HZ,
    ) -> Targets:
        rng = np.random.default_rng(seed)
        time, n = np.arange(frames) / rate_hz, len(robot.joint_names)
        lower, upper = np.maximum(robot.lower, -1.5), np.minimum(robot.upper, 1.5)
        middle = 0.5 * (lower + upper)
        centre = np.clip(
            robot.reference_posture,
            np.minimum(lower + 2 * amplitude, middle),
            np.maximum(upper - 2 * amplitude, middle),
        )
        joints = centre + sum(
            rng.uniform(-amplitude, amplitude, n)
            * np.sin(2 * np.pi * hz * time[:, None] + rng.uniform(0, 2 * np.pi, n))
            for hz in (0.3, 0.7)
        )
        turn = np.stack([0.2 * np.sin(time), 0.2 * np.sin(1.3 * time), 0.3 * time], axis=1)
        base = rotations.multiply(rotations.exp(turn), robot.base_rotation) if robot.base_is_floating else None
        rotation, _ = link_poses(robot, list(robot.links.values()), joints, base)
        tasks = []
        for i, (segment, link) in enumerate(robot.links.items()):
            away = rotations.exp(rng.normal(0.0, misalignment, 3))
            value = rotations.make_continuous(rotations.multiply(rotations.from_matrix(rotation[:, i]), away))
            limb = robot.limbs.get(segment)
            tasks.append(
                Task(
                    frame=link,
                    kind="orientation",
                    value=value,
                    feed_forward=rotations.angular_velocity(time, value),
                    weight=np.asarray(rng.uniform(0.1, 1.0)),
                    twist_weight=1.0 if limb is None else twist_weight,
                    axis=np.array([1.0, 0.0, 0.0]) if limb is None else limb.bone,
                    segment=segment,
                )
            )
        return Targets(time, tuple(tasks), "swinging")

    return make


SLIDING_ARM = """<robot name="arm"><link name="base"/><link name="a"/><link name="b"/><link name="tip"/>
<joint name="first" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2" velocity="3" effort="1"/></joint>
<joint name="slide" type="prismatic"><parent link="a"/><child link="b"/><axis xyz="1 0 0"/>
<limit lower="-0.1" upper="0.4" velocity="1" effort="1"/></joint>
<joint name="last" type="revolute"><parent link="b"/><child link="tip"/><origin xyz="0.2 0 0" rpy="0.3 0.2 0.1"/>
<axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="3" effort="1"/></joint></robot>"""


@pytest.fixture
def sliding_arm(tmp_path: Path) -> RobotModel:
    """A fixed base, a hinge about z, a slide along x, a hinge about y."""
    (tmp_path / "arm.urdf").write_text(SLIDING_ARM, encoding="utf-8")
    source = ModelSource("file", str(tmp_path / "arm.urdf"))
    return robot_model.build(RobotProfile("arm", "test", source, "fixed", links={}))


def _independent_cost(problem: OrientationProblem, k: int, q: Array, posture_weight: float = 0.0) -> float:
    """F of frame k at pinocchio configuration `q` from its definition: SciPy's logarithm, pinocchio's forward kinematics."""
    model = problem.model.pin_model
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    cost = 0.5 * posture_weight * float(np.sum((q[-len(problem.lower) :] - problem.reference) ** 2))
    for link, joint in enumerate(problem.joint_ids):
        rotation = np.array(data.oMi[int(joint)].rotation)
        desired, bone = problem.desired[k, link], problem.bone[link]
        angle = Rotation.from_matrix(desired @ rotation.T).magnitude()
        swing = float(rotations.vector_angle(desired @ bone, rotation @ bone))
        loss = problem.twist_loss[link]
        cost += 0.5 * problem.weight[k, link] * ((1 - loss) * angle**2 + loss * swing**2)
    return float(cost)


@pytest.fixture(scope="session")
def independent_cost() -> Callable[..., float]:
    """(problem, k, q, posture weight) → F by its definition."""
    return _independent_cost
