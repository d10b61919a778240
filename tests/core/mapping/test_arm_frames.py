"""Shoulders, hands and arm lengths of robots: by hand for a small arm, by pinocchio for the real ones."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from retarget.core.errors import ProfileError
from retarget.core.mapping.arm_frames import arm_frames
from retarget.core.profile import Arm

RobotBuilder = Callable[[str], Any]
ROBOTS = ["g1", "icub", "talos", "baxter"]


def world(model: Any, joints: Any, link: str, point: Any) -> Any:
    data = model.pin_model.createData()
    pin.framesForwardKinematics(model.pin_model, data, model.configuration(joints))
    return data.oMf[model.pin_model.getFrameId(link)].act(np.asarray(point, float))


@pytest.mark.parametrize("name", ROBOTS)
def test_real_robots(build_robot: RobotBuilder, name: str) -> None:
    """Mirrored arms; no elbow angle makes them longer, one makes them as long, and the shoulder does not depend on the arm's posture."""
    model = build_robot(name)
    arms = arm_frames(model)
    assert arms["Left"].length_m == pytest.approx(arms["Right"].length_m, abs=1e-6)
    shoulders = [world(model, model.reference_posture, arm.shoulder_link, arm.shoulder) for arm in arms.values()]
    assert shoulders[0] == pytest.approx(shoulders[1] * [1, -1, 1], abs=2e-3)
    for side, arm in arms.items():
        fore = model.links[f"{side}ForeArm"]
        elbow = model.joint_index(model.pin_model.names[model.link_in_joint(fore)[0]])
        lengths = []
        for value in np.linspace(model.lower[elbow], model.upper[elbow], 400):
            joints = np.array(model.reference_posture)
            joints[elbow] = value
            hand = world(model, joints, arm.hand_link, arm.hand)
            lengths.append(np.linalg.norm(hand - world(model, joints, arm.shoulder_link, arm.shoulder)))
        assert max(lengths) == pytest.approx(arm.length_m, abs=1e-5)
        elbow_point = world(model, model.reference_posture, arm.elbow_link, arm.elbow)
        upper = model.limbs[f"{side}UpperArm"]
        assert elbow_point == pytest.approx(world(model, model.reference_posture, upper.link, upper.distal))


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
    wrong = Arm("trunk", (0.0, 0.2, 0.4), "hnad", (0.0, 0.0, 0.0))
    with pytest.raises(ProfileError, match=r"\[arms.Left\] hand_link: the model has no link 'hnad'"):
        arm_frames(arm_robot(arms={"Left": wrong, "Right": wrong}))
