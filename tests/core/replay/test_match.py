"""A trajectory's joints put into a robot's order, and what can't be."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from retarget.core.errors import InvalidDataError, UnknownNameError, UsageError
from retarget.core.replay.match import joint_order, matched, robot_name
from retarget.core.types import JointTrajectory

ISAAC_TO_URDF = [
    0, 3, 6, 9, 13, 17,  # left leg
    1, 4, 7, 10, 14, 18,  # right leg
    2, 5, 8,  # waist
    11, 15, 19, 21, 23, 25, 27,  # left arm
    12, 16, 20, 22, 24, 26, 28,  # right arm
]  # fmt: skip
"""Where each of G1's 29 joints, in URDF order, stands among Isaac Sim's: written down by users of both, not computed."""


@pytest.fixture(scope="module")
def g1(build_robot: Callable[[str], Any]) -> Any:
    return build_robot("g1")


def trajectory(names: tuple[str, ...], **fields: Any) -> JointTrajectory:
    values = np.arange(3.0 * len(names)).reshape(3, len(names))
    return JointTrajectory(time=np.arange(3) / 30, joint_names=names, position=values, velocity=-values, **fields)


def test_joints_are_reordered_by_name(g1: Any) -> None:
    shuffled = tuple(np.random.default_rng(1).permutation(g1.joint_names))
    given = trajectory(shuffled)
    back = matched(given, g1)
    assert back.joint_names == g1.joint_names
    for i, name in enumerate(g1.joint_names):
        np.testing.assert_array_equal(back.position[:, i], given.position[:, shuffled.index(name)])
        np.testing.assert_array_equal(back.velocity[:, i], given.velocity[:, shuffled.index(name)])
    assert back.base_frame == "pelvis"


def test_what_fits_already_is_passed_through(g1: Any) -> None:
    given = trajectory(g1.joint_names, base_frame="pelvis")
    assert matched(given, g1) is given


def test_joints_that_the_model_holds_fixed_are_left_out_and_said(build_robot: Callable[[str], Any]) -> None:
    model = build_robot("g1")
    fixed = next(str(f.name) for f in model.pin_model.frames if str(f.type) == "FIXED_JOINT")
    back = matched(trajectory((fixed, *model.joint_names)), model)
    assert back.joint_names == model.joint_names
    np.testing.assert_array_equal(back.position[:, 0], trajectory((fixed, *model.joint_names)).position[:, 1])
    assert back.provenance["warnings"] == [f"joints that robot 'g1' holds fixed were left out: {fixed}"]


def test_unknown_missing_and_too_many(g1: Any) -> None:
    names = g1.joint_names
    with pytest.raises(InvalidDataError, match="no joint 'left_kne_joint'; did you mean left_knee_joint"):
        matched(trajectory(tuple(n.replace("left_knee", "left_kne") for n in names)), g1)
    with pytest.raises(InvalidDataError, match=r"lacks 29 of the 29 joints of robot 'g1'.*and 24 more"):
        matched(trajectory(()), g1)
    with pytest.raises(InvalidDataError, match=r"no joint 'zzz' .and 1 more.; .*31 joints found, 29 expected"):
        matched(trajectory((*names, "zzz", "qqq")), g1)


def test_base_of_another_link_is_refused(g1: Any) -> None:
    pose: dict[str, Any] = {"base_position": np.zeros((3, 3)), "base_orientation": np.tile([1.0, 0, 0, 0], (3, 1))}
    with pytest.raises(
        InvalidDataError, match="pose is that of 'torso_link', which is another link of the robot; expected 'pelvis'"
    ):
        matched(trajectory(g1.joint_names, base_frame="torso_link", **pose), g1)
    with pytest.raises(InvalidDataError, match="'root', which the robot lacks"):
        matched(trajectory(g1.joint_names, base_frame="root", **pose), g1)
    assert matched(trajectory(g1.joint_names, **pose), g1).base_frame == "pelvis"  # no name was given


def test_robot_is_the_given_one_or_the_recorded_one() -> None:
    bare = trajectory(("a", "b"))
    assert robot_name(replace(bare, robot="g1")) == "g1"
    assert robot_name(replace(bare, robot="g1"), "icub") == "icub"
    assert robot_name(replace(bare, provenance={"robot": "talos"})) == "talos"
    with pytest.raises(UsageError, match=r"doesn't say which robot it is of .2 joints, the first is 'a'."):
        robot_name(bare)


def test_order_of_isaac(g1: Any) -> None:
    isaac = joint_order(g1, "isaac")
    assert [isaac.index(name) for name in g1.joint_names] == ISAAC_TO_URDF
    assert joint_order(g1) == g1.joint_names
    with pytest.raises(UnknownNameError, match="joint order 'isac'; did you mean isaac"):
        joint_order(g1, "isac")


def test_order_of_unitrees_files_is_that_of_the_urdf(g1: Any) -> None:
    """As the data set's page lists them."""
    leg = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
    arm = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist_roll", "wrist_pitch", "wrist_yaw")
    listed = [*(f"left_{j}" for j in leg), *(f"right_{j}" for j in leg), "waist_yaw", "waist_roll", "waist_pitch",
              *(f"left_{j}" for j in arm), *(f"right_{j}" for j in arm)]  # fmt: skip
    assert joint_order(g1) == tuple(f"{name}_joint" for name in listed)
