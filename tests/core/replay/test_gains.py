"""Gains from closed-form inertias and from profiles."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from retarget.core.errors import UnknownNameError, UsageError
from retarget.core.profile import TorqueControl
from retarget.core.replay.gains import gains

from tests.core.replay.plane_arms import FORE, UPPER, arm

STATED = TorqueControl(stiffness={"joint1": 125.0}, damping={"joint1": 2.5})


def test_gains_from_inertia_are_those_of_a_critically_damped_joint(tmp_path: Path) -> None:
    model = arm(tmp_path, 2)
    found = gains(model, "inertia", 30.0)
    fore = FORE.inertia + FORE.mass * FORE.centre**2
    both = UPPER.inertia + UPPER.mass * UPPER.centre**2 + FORE.inertia + FORE.mass * (UPPER.length + FORE.centre) ** 2
    inertia = np.array([both, fore]) + model.armature
    np.testing.assert_allclose(found.stiffness, inertia * 900, rtol=1e-9)
    np.testing.assert_allclose(found.damping, 2 * np.sqrt(found.stiffness * inertia), rtol=1e-9)
    assert found.from_profile == ()


def test_auto_takes_what_the_profile_states_and_computes_the_rest(tmp_path: Path) -> None:
    model = arm(tmp_path, 2, torque=STATED)
    found, computed = gains(model), gains(model, "inertia")
    assert found.from_profile == ("joint1",)
    assert (found.stiffness[1], found.damping[1]) == (125.0, 2.5)
    assert (found.stiffness[0], found.damping[0]) == (computed.stiffness[0], computed.damping[0])


def test_gains_for_a_standing_leg_are_taken_on_request_only(tmp_path: Path) -> None:
    stated = TorqueControl(
        {"joint0": 4500.0, "joint1": 125.0}, {"joint0": 70.0, "joint1": 2.5}, standing_joints=("joint0",)
    )
    model = arm(tmp_path, 2, torque=stated)
    found, computed, whole = gains(model), gains(model, "inertia"), gains(model, "profile")
    assert found.from_profile == ("joint1",)
    assert (found.stiffness[0], found.damping[0]) == (computed.stiffness[0], computed.damping[0])
    assert whole.from_profile == ("joint0", "joint1")
    np.testing.assert_array_equal(whole.stiffness, [4500.0, 125.0])


def test_the_damping_ratio_is_that_of_the_joint_by_itself(tmp_path: Path) -> None:
    """ζ = c / (2 √(k I)) of a link turning about its end, I = I_c + m l² + armature."""
    stated = TorqueControl(stiffness={"joint0": 125.0}, damping={"joint0": 2.5})
    model = arm(tmp_path, 1, torque=stated)
    inertia = UPPER.inertia + UPPER.mass * UPPER.centre**2 + model.armature[0]
    assert gains(model).damping_ratio == pytest.approx([2.5 / (2 * np.sqrt(125.0 * inertia))])
    assert gains(model, "inertia").damping_ratio == pytest.approx([1.0])


def test_a_profile_that_lacks_a_joint_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"robot 'arm' states no stiffness and damping of joint 'joint0' \(1 of 2"):
        gains(arm(tmp_path, 2, torque=STATED), "profile")


def test_requests_without_sense_are_refused(tmp_path: Path) -> None:
    model = arm(tmp_path, 1)
    with pytest.raises(UnknownNameError, match="did you mean inertia"):
        gains(model, "inerta")  # type: ignore[arg-type]  # what a command line might hand over
    with pytest.raises(UsageError, match="expected a positive number"):
        gains(model, "inertia", 0.0)
