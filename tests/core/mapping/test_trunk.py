"""The waist under a chest: pinocchio agrees where it can be reached, SciPy where it can't."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from retarget.core import rotations
from retarget.core.mapping.link_rotations import from_reference_posture
from retarget.core.mapping.trunk import trunk_joints
from retarget.core.types import Array
from scipy.optimize import minimize

RobotBuilder = Callable[[str], Any]


def wanted(model: Any, count: int, angle: float, seed: int = 0) -> Array:
    upright = rotations.from_matrix(from_reference_posture(model)["T8"])
    turn = rotations.exp(np.random.default_rng(seed).uniform(-angle, angle, size=(count, 3)))
    return rotations.multiply(turn, upright)


def error(model: Any, joints: Array, orientation: Array) -> float:
    data = model.pin_model.createData()
    pin.framesForwardKinematics(model.pin_model, data, model.configuration(joints))
    achieved = np.array(data.oMf[model.pin_model.getFrameId(model.links["T8"])].rotation)
    return float(np.linalg.norm(pin.log3(rotations.to_matrix(orientation) @ achieved.T)))


@pytest.mark.parametrize("name", ["g1", "icub"])
def test_three_joints_reach_any_small_turn(build_robot: RobotBuilder, name: str) -> None:
    model = build_robot(name)
    orientation = wanted(model, 30, 0.2)
    found = trunk_joints(model, model.links["T8"], orientation)
    assert max(error(model, q, o) for q, o in zip(found, orientation, strict=True)) < 1e-9
    assert ((found >= model.lower) & (found <= model.upper)).all()
    moved = np.ptp(found, axis=0) > 0
    assert moved.sum() == 3


def test_two_joints_or_limits_do_their_best(build_robot: RobotBuilder) -> None:
    """TALOS can't roll and its waist ends early: no SciPy start finds less error within the limits."""
    model = build_robot("talos")
    orientation = wanted(model, 12, 0.6, seed=1)
    found = trunk_joints(model, model.links["T8"], orientation)
    columns = np.flatnonzero(np.ptp(found, axis=0) > 0)
    assert len(columns) == 2
    bounds = list(zip(model.lower[columns], model.upper[columns], strict=True))
    for joints, target in zip(found, orientation, strict=True):

        def cost(x: Array, joints: Array = joints, target: Array = target) -> float:
            trial = np.array(joints)
            trial[columns] = x
            return error(model, trial, target) ** 2

        best = min(minimize(cost, start, bounds=bounds).fun for start in (joints[columns], np.zeros(2)))
        assert error(model, joints, target) ** 2 <= best + 1e-7
        assert ((joints >= model.lower) & (joints <= model.upper)).all()


def test_nothing_to_turn(build_robot: RobotBuilder) -> None:
    model = build_robot("baxter")
    found = trunk_joints(model, "base", np.tile([1.0, 0.0, 0.0, 0.0], (3, 1)))
    assert found == pytest.approx(np.tile(model.reference_posture, (3, 1)))
