"""Small robots written on the spot, every packaged robot as a simulation model, and the samples on them."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from retarget import formats, robots, samples
from retarget.core import robot_model
from retarget.core.pipeline import ConvertOptions, convert
from retarget.core.profile import ModelSource, RobotProfile
from retarget.core.replay import model as replay_model
from retarget.core.replay.model import ReplayModel
from retarget.core.robot_model import RobotModel
from retarget.core.types import JointTrajectory

RobotFactory = Callable[..., RobotModel]


@pytest.fixture
def robot_from(tmp_path: Path) -> RobotFactory:
    """`robot_from(links and joints as URDF text, **fields of the profile)`; the URDF lies in tmp_path/urdf, its root link is the first."""

    def make(body: str, **fields: Any) -> RobotModel:
        folder = tmp_path / "urdf"
        folder.mkdir(exist_ok=True)
        path = folder / "small.urdf"
        path.write_text(f'<robot name="small">{body}</robot>')
        facts: dict[str, Any] = {"base": "fixed", "links": {}, **fields}
        return robot_model.build(RobotProfile("small", "", ModelSource("file", str(path)), **facts))

    return make


def link(name: str, *, mass: float = 1.0, com: str = "0 0 0", inertia: float = 0.01, shapes: str = "") -> str:
    """A link whose tensor is `inertia` times the identity; `shapes` are its <collision> elements."""
    tensor = " ".join(f'{key}="{inertia}"' for key in ("ixx", "iyy", "izz")) + ' ixy="0" ixz="0" iyz="0"'
    return (
        f'<link name="{name}"><inertial><origin xyz="{com}"/><mass value="{mass}"/><inertia {tensor}/></inertial>'
        f"{shapes}</link>"
    )


def hinge(name: str, parent: str, child: str, *, axis: str = "0 1 0", at: str = "0 0 0", more: str = "") -> str:
    """A hinge of ±3 rad and 40 Nm."""
    return (
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/><origin xyz="{at}"/>'
        f'<axis xyz="{axis}"/><limit lower="-3" upper="3" effort="40" velocity="5"/>{more}</joint>'
    )


def collision(geometry: str, at: str = "0 0 0") -> str:
    """<collision> with the given content of its <geometry>."""
    return f'<collision><origin xyz="{at}"/><geometry>{geometry}</geometry></collision>'


@pytest.fixture(scope="session")
def any_robot(build_robot: Callable[[str], RobotModel], make_motion: Callable[..., Any]) -> Callable[[str], RobotModel]:
    """As `build_robot`, and the person of `make_motion` too."""

    def build(name: str) -> RobotModel:
        if name == "human":
            return robot_model.build(robots.load(name), make_motion(np.arange(3) / 60))
        return build_robot(name)

    return cache(build)


@pytest.fixture(scope="session")
def replayed(
    any_robot: Callable[[str], RobotModel], tmp_path_factory: pytest.TempPathFactory
) -> Callable[..., ReplayModel]:
    """`replayed(name, base)`: with self-collision, built once per session."""
    folder = tmp_path_factory.mktemp("models")

    @cache
    def build(name: str, base: Any = None) -> ReplayModel:
        robot = any_robot(name)
        return replay_model.build(robot, base=base or robot.profile.base, self_collision=True, cache=folder)

    return build


@pytest.fixture(scope="session")
def clip() -> Callable[..., tuple[JointTrajectory, RobotModel]]:
    """`clip(robot, sample, start_s=None, end_s=None)` → (retargeted trajectory, its robot), each computed once per session."""

    @cache
    def make(
        robot: str, sample: str, start_s: float | None = None, end_s: float | None = None
    ) -> tuple[JointTrajectory, RobotModel]:
        motion = formats.read_motion(samples.sample_path(sample))
        model = robot_model.build(robots.load(robot), motion)
        return convert(motion, model, ConvertOptions(start_s=start_s, end_s=end_s)).trajectory, model

    return make


@pytest.fixture
def walking(clip: Callable[..., tuple[JointTrajectory, RobotModel]]) -> tuple[JointTrajectory, RobotModel]:
    """The walk on G1: 60 Hz, ends in a turn of 90° to the left."""
    return clip("g1", "walk")
