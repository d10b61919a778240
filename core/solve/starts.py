"""Where to start a frame that has no frame before it: the cost has several basins, and the posture one starts from decides among them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from retarget.core import rotations
from retarget.core.errors import SolverError
from retarget.core.solve.limits import nearest_feasible
from retarget.core.solve.newton import Converged, FrameSolver
from retarget.core.solve.problem import OrientationProblem
from retarget.core.types import Array

CLEARLY_BETTER = 1e-6
"""By how much of its cost (plus this, absolutely) a later start must win: equal basins must not be decided by rounding."""


def best_start(solver: FrameSolver, k: int, postures: Iterable[Array]) -> tuple[int, Converged]:
    """Frame k converged from every one of `postures` (n,) with only the position limits: which was the best, and what it led to.

    The base starts at the pelvis target. Raises `SolverError` when every start fails.
    """
    p = solver.problem
    best: tuple[int, Converged] | None = None
    for number, posture in enumerate(postures):
        joints = nearest_feasible(posture, p.lower, p.upper, p.coupled)
        try:
            found = solver.converge(k, configuration(p, k, joints), p.lower, p.upper)
        except SolverError:
            continue
        if best is None or found.cost < best[1].cost * (1.0 - CLEARLY_BETTER) - CLEARLY_BETTER:
            best = number, found
    if best is None:
        raise SolverError(f"frame {k} can't be solved from any start")
    return best


def postures(problem: OrientationProblem, seed: int) -> Iterator[Array]:
    """Reference posture, zero, middle of the ranges, then random ones without end: the same for the same `seed`."""
    lower, upper = np.maximum(problem.lower, -np.pi), np.minimum(problem.upper, np.pi)
    yield problem.reference
    yield np.zeros(len(lower))
    yield 0.5 * (lower + upper)
    generator = np.random.default_rng(seed)
    while True:
        yield lower + (upper - lower) * generator.random(len(lower))


def configuration(problem: OrientationProblem, k: int, joints: Array) -> Array:
    """pinocchio configuration of `joints`, a moving base turned to frame k's target of the link it carries, or to that of all links together."""
    q: Array = np.asarray(problem.model.configuration(joints))
    if problem.base_columns:
        root = np.flatnonzero(problem.joint_ids == 1)
        rotation = problem.desired[k, root[0]] if len(root) else _common_turn(problem, k, joints)
        q[3:7] = np.roll(rotations.from_matrix(rotation), -1)
    return q


def _common_turn(problem: OrientationProblem, k: int, joints: Array) -> Array:
    """The base rotation (3, 3) that brings all links together nearest to their targets in the least squares sense [Wahba's problem]."""
    import pinocchio as pin

    model = problem.model.pin_model
    data = model.createData()
    pin.forwardKinematics(model, data, problem.model.configuration(joints, np.array([1.0, 0.0, 0.0, 0.0])))
    turns = sum(
        weight * desired @ np.array(data.oMi[int(joint)].rotation).T
        for joint, desired, weight in zip(problem.joint_ids, problem.desired[k], problem.weight[k], strict=True)
    )
    left, _, right = np.linalg.svd(turns)
    return np.asarray(left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right)
