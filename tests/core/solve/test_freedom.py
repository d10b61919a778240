"""Null spaces against their definition, and the compiled `Freedom` against NumPy's, QP by QP."""

from __future__ import annotations

import numpy as np
import pytest
from retarget.core.solve.freedom import QP_SCALE, ControlStep, Freedom
from retarget.core.types import Array

JOINTS, LIMITS = 9, 5
KINDS = ["numpy", "compiled"]


def kind(name: str) -> type[Freedom]:
    if name == "numpy":
        return Freedom
    pytest.importorskip("numba", reason="numba is not there for this Python")
    from retarget.core.solve.freedom_kernel import CompiledFreedom

    return CompiledFreedom


def control_step(jacobian: Array, seed: int = 0) -> ControlStep:
    rng, rows = np.random.default_rng(seed), len(jacobian)
    root = rng.normal(size=(JOINTS, JOINTS))
    upper = rng.uniform(0, 2, JOINTS + LIMITS)
    return ControlStep(
        jacobian=jacobian,
        scale=rng.uniform(1, 3, rows),
        command=rng.normal(size=rows),
        inertia=root @ root.T + 0.1 * np.eye(JOINTS),
        lower=upper - rng.uniform(2, 3, JOINTS + LIMITS),
        upper=upper,
        constraints=rng.normal(size=(LIMITS, JOINTS)),
        before=rng.normal(size=JOINTS),
    )


def directions(freedom: Freedom, tasks: slice) -> Array:
    """N (c, f), told by what unit steps along y do."""
    rows = freedom.qp(tasks, 0.0).directions
    return rows[:JOINTS]


@pytest.mark.parametrize("name", KINDS)
@pytest.mark.parametrize(("rows", "rank"), [(1, 1), (4, 4), (4, 2), (4, 0), (9, 9), (12, 9), (12, 5)])
def test_what_is_left_moves_no_task(name: str, rows: int, rank: int) -> None:
    """N is orthonormal, J N = 0, and as many directions are gone as J has rank."""
    rng = np.random.default_rng(rows + rank)
    jacobian = np.concatenate(
        [rng.normal(size=(rows, rank)) @ rng.normal(size=(rank, JOINTS)), rng.normal(size=(1, JOINTS))]
    )
    freedom = kind(name)(control_step(jacobian))
    assert freedom.take(slice(0, rows), 1e-8) == rank
    assert freedom.left == JOINTS - rank
    if freedom.left:
        basis = directions(freedom, slice(rows, rows + 1))
        np.testing.assert_allclose(basis.T @ basis, np.eye(JOINTS - rank), atol=1e-12)
        np.testing.assert_allclose(jacobian[:rows] @ basis, 0.0, atol=1e-12)


@pytest.mark.parametrize("name", KINDS)
def test_what_hardly_moves_a_task_is_left(name: str) -> None:
    """A direction that a row sends to 1e-9 counts as null by a tolerance of 1e-8, and not by one of 1e-10."""
    jacobian = np.zeros((3, JOINTS))
    jacobian[0, 0], jacobian[1, 1], jacobian[2, 5] = 1.0, 1e-9, 1.0
    step = control_step(jacobian)._replace(scale=np.ones(3))
    assert kind(name)(step).take(slice(0, 2), 1e-8) == 1
    assert kind(name)(step).take(slice(0, 2), 1e-10) == 2


@pytest.mark.parametrize("name", KINDS)
def test_the_qp_is_the_costs_second_order_model(name: str) -> None:
    """½ yᵀHy + gᵀy is half of ‖√ρ(J q̇ - v)‖² + ‖q̇‖²_A + a ‖q̇ - q̇_before‖², less what it is at y = 0; bounds are those that are left."""
    rng = np.random.default_rng(5)
    step, factor = control_step(rng.normal(size=(6, JOINTS))), 0.7
    freedom, tasks = kind(name)(step), slice(2, 6)
    freedom.add(0.01 * QP_SCALE * rng.normal(size=JOINTS))
    freedom.take(slice(0, 2), 1e-8)
    start, basis, qp = freedom.velocity, directions(freedom, tasks), freedom.qp(tasks, factor)

    def half_cost(velocity: Array) -> float:
        lacking = step.scale[tasks] * (step.jacobian[tasks] @ velocity - step.command[tasks])
        changed = velocity - step.before
        return 0.5 * float(lacking @ lacking + velocity @ step.inertia @ velocity + factor * changed @ changed)

    for _ in range(5):
        y = rng.normal(size=freedom.left)
        model = 0.5 * y @ qp.hessian @ y + qp.gradient @ y / QP_SCALE
        assert model == pytest.approx(half_cost(start + basis @ y) - half_cost(start), rel=1e-9)
    value = np.concatenate([start, step.constraints @ start])
    np.testing.assert_allclose(qp.lower, np.minimum(QP_SCALE * (step.lower - value), 0.0), atol=1e-9)
    np.testing.assert_allclose(qp.upper, np.maximum(QP_SCALE * (step.upper - value), 0.0), atol=1e-9)
    np.testing.assert_allclose(qp.directions[JOINTS:], step.constraints @ basis, atol=1e-12)


@pytest.mark.parametrize("name", KINDS)
def test_steps_move_the_velocity_along_what_is_left(name: str) -> None:
    rng = np.random.default_rng(6)
    freedom = kind(name)(control_step(rng.normal(size=(4, JOINTS))))
    freedom.take(slice(0, 2), 1e-8)
    basis, y = directions(freedom, slice(2, 4)), rng.normal(size=JOINTS - 2)
    freedom.add(y)
    np.testing.assert_allclose(freedom.velocity, basis @ y / QP_SCALE, atol=1e-15)


@pytest.mark.parametrize("name", KINDS)
def test_the_first_level_has_bounds_without_rows(name: str) -> None:
    step = control_step(np.random.default_rng(7).normal(size=(3, JOINTS)))
    qp = kind(name)(step).qp(slice(0, 3), 0.0)
    np.testing.assert_array_equal(qp.directions, step.constraints)
    np.testing.assert_allclose(qp.upper, QP_SCALE * step.upper)
