"""Shoulders, hands and arm lengths of robots: by hand for a small arm, by pinocchio for the real ones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from retarget.core.errors import ProfileError
from retarget.core.mapping.arm_frames import arm_frames
from retarget.core.profile import Arm

RobotBuilder = Callable[[str], Any]
ROBOTS = ["g1", "icub", "talos", "baxter", "tocabi"]


def world(model: Any, joints: Any, link: str, point: Any) -> Any:
    data = model.pin_model.createData()
    pin.framesForwardKinematics(model.pin_model, data, model.configuration(joints))
    return data.oMf[model.pin_model.getFrameId(link)].act(np.asarray(point, float))


def bare(model: Any) -> Any:
    """The robot without a table of its arms."""
    return replace(model, profile=replace(model.profile, arms={}))


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("table", [True, False], ids=["table", "derived"])
def test_real_robots(build_robot: RobotBuilder, name: str, table: bool) -> None:
    """Mirrored arms; no elbow angle makes them longer, one makes them as long, and elbow and shoulder are where the limbs have
    them."""
    model = build_robot(name) if table else bare(build_robot(name))
    arms = arm_frames(model)
    assert arms["Left"].length_m == pytest.approx(arms["Right"].length_m, abs=1e-4)
    shoulders = [world(model, model.reference_posture, arm.shoulder_link, arm.shoulder) for arm in arms.values()]
    assert shoulders[0] == pytest.approx(shoulders[1] * [1, -1, 1], abs=2e-3)
    for side, arm in arms.items():
        joints = np.array(model.reference_posture)
        elbow = model.joint_index(model.pin_model.names[model.link_in_joint(model.links[f"{side}ForeArm"])[0]])
        lengths = []
        for angle in np.linspace(model.lower[elbow], model.upper[elbow], 80):
            joints[elbow] = angle
            hand = world(model, joints, arm.hand_link, arm.hand)
            lengths.append(np.linalg.norm(hand - world(model, joints, arm.shoulder_link, arm.shoulder)))
        # The paper's own figure for TOCABI is rounded to centimetres.
        stated = side in model.profile.arms and model.profile.arms[side].length_m is not None
        assert max(lengths) == pytest.approx(arm.length_m, abs=5e-3 if stated else 1e-4)
        elbow_point = world(model, model.reference_posture, arm.elbow_link, arm.elbow)
        upper = model.limbs[f"{side}UpperArm"]
        distal, proximal = (
            world(model, model.reference_posture, upper.link, p) for p in (upper.distal, upper.proximal)
        )
        assert elbow_point == pytest.approx(distal, abs=0.04)
        assert np.linalg.norm(shoulders[0 if side == "Left" else 1] - proximal) < 0.09


def test_the_profile_has_the_last_word(arm_robot: Callable[..., Any]) -> None:
    """A left arm of 0.3 and 0.25 m whose shoulder is at (0, 0.2, 0.4), and a right one that does not exist."""
    left = Arm("trunk", (0.0, 0.2, 0.4), "hand", (0.0, -0.1, 0.0))
    right = Arm("trunk", (0.0, -0.2, 0.4), "trunk", (0.0, -0.2, -0.1), length_m=0.6, elbow_link="fore")
    arms = arm_frames(arm_robot(arms={"Left": left, "Right": right}))
    assert arms["Left"].length_m == pytest.approx(0.3 + 0.25 + 0.1, abs=1e-6)
    assert arms["Right"].length_m == 0.6
    assert (arms["Right"].elbow_link, arms["Right"].elbow.tolist()) == ("fore", [0.0, 0.0, 0.0])
    assert arms["Left"].basis == pytest.approx(0.65 * np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0]]))
    assert arms["Right"].basis == pytest.approx(0.6 * np.array([[0, 0, 1], [0, -1, 0], [-1, 0, 0]]))


def test_what_is_missing_is_named(arm_robot: Callable[..., Any]) -> None:
    with pytest.raises(ProfileError, match=r"needs the right arm, but \[links\] lacks RightUpperArm and RightForeArm"):
        arm_frames(arm_robot())
