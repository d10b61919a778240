"""Hierarchical solver: strict priorities against one weighted QP of the same control step, and control steps per second on one core.

The work is [Lim2022 table II] on an upper body: chest, hands and head, upper arms, and their second axes in place of the shoulders, with limits on joints and
hands. "solve" is what follows the linearisation: the cascade of QPs, in NumPy or compiled (as clips of 10 s and more are solved), or one daqp QP with
all levels' tasks summed by weight. "step" has the kinematics, Jacobians and inertia, too, which are the same code for all. The loop is the whole of what
a clip does: interpolation, steps, hand check.

All take turns in this one process, and the best of several turns counts, in processor time. Ratios are recorded and printed, not asserted; that
strict and weighted solution keep the same limits, and that only one of them is strict, is.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import daqp
import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture
from retarget import robots
from retarget.core.robot_model import build
from retarget.core.solve.cascade import Cascade
from retarget.core.solve.freedom import ControlStep
from retarget.core.solve.hierarchical import HierarchicalOptions, HierarchicalSolver, solve
from retarget.core.solve.task_samples import TaskSample, TaskSamples
from retarget.core.types import Array, Targets

from tests.core.solve.hierarchies import (
    ROBOTS,
    Step,
    by_cascade,
    last_step,
    paper_targets,
    random_step,
    upper_body_motion,
)

STATES, STEP_S, FRAMES = 200, 1e-3, 60


@dataclass(frozen=True)
class Work:
    """The same control steps for everyone."""

    name: str
    targets: Targets
    solver: HierarchicalSolver
    wanted: TaskSample
    states: list[Step]


@pytest.fixture(scope="module", params=ROBOTS)
def work(request: pytest.FixtureRequest) -> Work:
    robot = build(robots.load(request.param))
    targets = paper_targets(robot, upper_body_motion(robot, FRAMES), turned=0.1)
    solver, rng = HierarchicalSolver(targets, robot, HierarchicalOptions()), np.random.default_rng(0)
    states = [random_step(solver, robot, rng) for _ in range(STATES)]
    return Work(request.param, targets, solver, TaskSamples(solver.tasks, robot).at(0), states)


def linearised(work: Work) -> list[ControlStep]:
    found = []
    for state in work.states:
        work.solver.step(state.joints, work.wanted, 0, state.before, STEP_S)
        found.append(last_step(work.solver, state.before))
    return found


def strict(step: ControlStep, cascade: Cascade) -> Array:
    return by_cascade(cascade, step, STEP_S).velocity


@pytest.fixture(params=["numpy", "compiled"])
def kernel(request: pytest.FixtureRequest) -> str:
    if request.param == "compiled":
        pytest.importorskip("numba", reason="numba is not there for this Python")
    return str(request.param)


def weighted(work: Work, step: ControlStep) -> Array:
    """min Σ_p ρ_p ‖J_p q̇ - v_p‖² + ‖q̇‖²_A + a ‖(q̇ - q̇_before)/dt‖²: the levels' own weights, all at once."""
    importance, acceleration = work.solver.weight[0].copy(), 0.0
    for level, rows in zip(work.solver.levels, work.solver.level_rows, strict=True):
        importance[rows] *= level.weight
        acceleration = max(acceleration, level.acceleration_s2 / STEP_S**2)
    scaled = step.jacobian.T * importance
    hessian, gradient = scaled @ step.jacobian + step.inertia, -scaled @ step.command - acceleration * step.before
    hessian.reshape(-1)[:: len(hessian) + 1] += acceleration
    sense = np.zeros(len(step.lower), np.intc)
    x, _, flag, _ = daqp.solve(hessian, 1e3 * gradient, step.constraints, 1e3 * step.upper, 1e3 * step.lower, sense)
    assert flag in (1, 2)
    return np.asarray(x, float) / 1e3


def microseconds(runs: dict[str, Callable[[], object]], count: int, turns: int = 7) -> dict[str, float]:
    """Processor time a step, best of `turns`, everyone once per turn."""
    best = dict.fromkeys(runs, np.inf)
    for _ in range(turns):
        for name, run in runs.items():
            begin = time.process_time()
            run()
            best[name] = min(best[name], time.process_time() - begin)
    return {name: 1e6 * seconds / count for name, seconds in best.items()}


def test_strict_against_weighted(benchmark: BenchmarkFixture, work: Work, kernel: str) -> None:
    solver, steps = work.solver, linearised(work)
    freedom = HierarchicalSolver(
        work.targets, build(robots.load(work.name)), HierarchicalOptions(kernel=kernel)
    ).freedom
    cascade = Cascade(solver.levels, solver.level_rows, solver.weight, solver.limits.speed, freedom)

    def linearise() -> None:
        for state in work.states:
            solver.linearise(state.joints, work.wanted, STEP_S)

    runs: dict[str, Callable[[], object]] = {
        "strict": lambda: [strict(step, cascade) for step in steps],
        "weighted": lambda: [weighted(work, step) for step in steps],
        "linearisation": linearise,
    }
    benchmark(runs["strict"])
    found = microseconds(runs, STATES)
    solve_ratio = found["strict"] / found["weighted"]
    step_ratio = (found["strict"] + found["linearisation"]) / (found["weighted"] + found["linearisation"])
    benchmark.extra_info.update({f"microseconds_a_step_{name}": value for name, value in found.items()})
    benchmark.extra_info.update({"solve_ratio": solve_ratio, "step_ratio": step_ratio})
    print(f"\n{work.name}, {kernel}: strict {found['strict']:.0f} µs, one weighted QP {found['weighted']:.0f} µs (ratio {solve_ratio:.2f}); "
          f"with the linearisation's {found['linearisation']:.0f} µs ratio {step_ratio:.2f}")  # fmt: skip
    first = Cascade(solver.levels[:1], solver.level_rows[:1], solver.weight, solver.limits.speed, freedom)
    chest, lost = solver.level_rows[0], {"strict": 0.0, "weighted": 0.0}
    for step in steps:
        best = step.jacobian[chest] @ strict(step, first)
        for name, own in (("strict", strict(step, cascade)), ("weighted", weighted(work, step))):
            value = np.concatenate([own, step.constraints @ own])
            assert ((value >= step.lower - 1e-8) & (value <= step.upper + 1e-8)).all(), name
            lost[name] = max(lost[name], float(np.abs(step.jacobian[chest] @ own - best).max()))
    assert lost["strict"] <= 1e-6 < lost["weighted"]


def test_control_steps_per_second(benchmark: BenchmarkFixture, work: Work, kernel: str) -> None:
    robot, options = build(robots.load(work.name)), HierarchicalOptions(kernel=kernel)
    solution = benchmark(lambda: solve(work.targets, robot, options))
    begin = time.process_time()
    solution = solve(work.targets, robot, options)
    rate = (solution.control_steps + solution.first_steps) / (time.process_time() - begin)
    benchmark.extra_info["control_steps_a_second"] = rate
    print(f"\n{work.name}, {kernel}: {rate:.0f} control steps a second")
    assert not solution.status.any()
