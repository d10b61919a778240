"""Inertia that a simulator accepts: rotors are told apart from links, and what no rigid body can have becomes the nearest that one can."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from retarget.core.kinematics import axis_frames
from retarget.core.robot_model import RobotModel
from retarget.core.types import Array

SMALLEST_MASS_KG = 1e-9
SMALLEST_INERTIA_KGM2 = 1e-9
"""Given to links without mass, and to any link at least. Far below what shows in a torque, and enough for a simulator."""
ROUNDING = 1e-6
"""Share of the inertia up to which a violation is rounding: a thin plate obeys with equality."""
REPAIRED_SHARE = 0.01
"""Of the tensor: from this change on a link counts as repaired."""


@dataclass(frozen=True, eq=False)
class LinkInertia:
    """mass kg; tensor (3, 3) kg m² about the centre of mass; rotor kg m², on the joint's axis. repaired: whether more was changed than 1 % of it."""

    mass: float
    tensor: Array
    rotor: float
    repaired: bool


def link_inertia(mass: float, tensor: Array, axis: Array | None) -> LinkInertia:
    """What a simulator is given for a link with `tensor` that turns about `axis`, (3,) unit, None where it slides or has no joint.

    A tensor I belongs to some distribution of mass if the second moments Σ = ½ tr(I) 1 - I have no negative eigenvalue, which is the same as
    positive principal moments that obey the triangle inequality [Traversaro2016, "Identification of fully physical consistent inertial parameters
    using optimization on manifolds"].

    Descriptions often add the rotor's inertia, as the gear reflects it, to the link's own on the joint's axis; then Σ is negative just there. The
    least that makes it zero is taken out and given back as `rotor`: to the joint itself it is the same, and the links before, which a rotor does
    not load like a link, get the right share. What is negative after that is set to zero, which gives the nearest Σ in the Frobenius norm.
    """
    if mass < SMALLEST_MASS_KG:
        return LinkInertia(SMALLEST_MASS_KG, SMALLEST_INERTIA_KGM2 * np.eye(3), 0.0, False)
    symmetric = (tensor + tensor.T) / 2
    rotor = 0.0
    if axis is not None:
        along = float(np.trace(symmetric) / 2 - axis @ symmetric @ axis)
        rotor = -2 * along if -along > max(ROUNDING * np.abs(symmetric).max(), SMALLEST_INERTIA_KGM2) else 0.0
        symmetric = symmetric - rotor * np.outer(axis, axis)
    moments, axes = np.linalg.eigh(np.trace(symmetric) / 2 * np.eye(3) - symmetric)
    least = SMALLEST_INERTIA_KGM2 / 2 + 1e-9 * float(np.abs(moments).max())
    if moments.min() >= least:
        return LinkInertia(mass, symmetric, rotor, False)
    second = axes @ np.diag(np.maximum(moments, least)) @ axes.T
    nearest = np.trace(second) * np.eye(3) - second
    repaired = np.linalg.norm(nearest - symmetric) > REPAIRED_SHARE * np.linalg.norm(symmetric)
    if axis is not None and rotor > 0:
        rotor = max(0.0, rotor + float(axis @ (symmetric - nearest) @ axis))
    return LinkInertia(mass, nearest, rotor, bool(repaired))


def link_inertias(robot: RobotModel) -> dict[int, LinkInertia]:
    """pinocchio joint → what the link that it moves is given; the base link under its own joint, 0 where it is fixed and 1 where it floats."""
    frames, base = axis_frames(robot), int(robot.base_is_floating)
    found = {}
    for i in range(base, robot.pin_model.njoints):
        axis = frames[i].axes[:, 2] if i in frames and not frames[i].sliding else None
        inertia = robot.pin_model.inertias[i]
        found[i] = link_inertia(float(inertia.mass), np.array(inertia.inertia), axis)
    return found
