"""Inertia that a simulator accepts: what no rigid body can have is replaced by the nearest that one can."""

from __future__ import annotations

import numpy as np
from retarget.core.types import Array

SMALLEST_MASS_KG = 1e-9
SMALLEST_INERTIA_KGM2 = 1e-9
"""Given to links without mass, and to any link at least. Far below what shows in a torque, and enough for a simulator."""


def physical(mass: float, tensor: Array) -> tuple[float, Array, bool]:
    """(mass kg, tensor (3, 3) kg m² about the centre of mass, whether a link with mass had to be changed).

    A tensor I belongs to some distribution of mass if the second moments Σ = ½ tr(I) 1 - I have no negative eigenvalue, which is the same as
    positive principal moments that obey the triangle inequality [Traversaro2016, "Identification of fully physical consistent inertial parameters"].
    Negative second moments are set to zero: the nearest such Σ in the Frobenius norm.
    """
    if mass < SMALLEST_MASS_KG:
        return SMALLEST_MASS_KG, SMALLEST_INERTIA_KGM2 * np.eye(3), False
    symmetric = (tensor + tensor.T) / 2
    moments, axes = np.linalg.eigh(np.trace(symmetric) / 2 * np.eye(3) - symmetric)
    # A thin plate obeys with equality, and rounding puts it on either side.
    floor = SMALLEST_INERTIA_KGM2 / 2 + 1e-9 * float(np.abs(moments).max())
    clipped = np.maximum(moments, floor)
    if np.array_equal(clipped, moments):
        return mass, symmetric, False
    second = axes @ np.diag(clipped) @ axes.T
    changed = bool(moments.min() < -1e-6 * np.abs(moments).max() or np.abs(moments).max() == 0)
    return mass, np.trace(second) * np.eye(3) - second, changed
