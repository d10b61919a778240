"""The compiled kernel against the NumPy solver: the same clips to 1e-9 rad, frames handed over where it stops, and when it is used."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from retarget import robots
from retarget.core import mapping, rotations
from retarget.core.errors import SolverError
from retarget.core.robot_model import RobotModel
from retarget.core.solve import dynamical
from retarget.core.solve.dynamical import DynamicalOptions, solve
from retarget.core.solve.newton import Converged, FrameSolver, NewtonOptions, Path
from retarget.core.solve.problem import orientation_problem
from retarget.core.solve.starts import best_start
from retarget.core.types import FRAME_MARKED, Array, HumanMotion, Targets, Task

pytest.importorskip("numba", reason="numba is not there for this Python")
from retarget.core.solve import jit, kernel
from retarget.core.solve.compiled import CompiledSolver

Models = Callable[[str], RobotModel]
Motions = Callable[[str], HumanMotion]
Swinging = Callable[..., Targets]
NUMPY, COMPILED = DynamicalOptions(kernel="numpy"), DynamicalOptions(kernel="compiled")


def assert_same(one: dynamical.Solution, other: dynamical.Solution) -> None:
    np.testing.assert_allclose(other.joints, one.joints, atol=1e-9)
    assert (one.base_orientation is None) == (other.base_orientation is None)
    if one.base_orientation is not None:
        np.testing.assert_allclose(other.base_orientation, one.base_orientation, atol=1e-9)
    np.testing.assert_array_equal(other.status, one.status)
    assert (other.start, other.exchanged, other.unconverged) == (one.start, one.exchanged, one.unconverged)


def followed(solver: FrameSolver) -> Path:
    """The whole clip, from what the reference posture leads to at the first frame."""
    problem = solver.problem
    path = Path.empty(len(problem.time), problem.model.pin_model.nq)
    path.put(0, best_start(solver, 0, [problem.reference])[1])
    solver.follow(path, 0, len(path.q) - 1)
    return path


@pytest.mark.parametrize("mapped_by", ["limb_plane", "link_orientation"])
@pytest.mark.parametrize("robot", robots.names())
@pytest.mark.parametrize("sample", ["walk", "reach", "squat", "yaw_180"])
def test_samples_on_robots(sample: str, robot: str, mapped_by: str, model: Models, motion: Motions) -> None:
    chosen = model(robot)
    targets = mapping.load(mapped_by).targets(motion(sample), chosen)
    problem = orientation_problem(targets, chosen, free_base=chosen.base_is_floating)
    options = NewtonOptions(posture_weight=chosen.profile.posture_weight)
    by_numpy, compiled = (followed(kind(problem, options)) for kind in (FrameSolver, CompiledSolver))
    np.testing.assert_allclose(compiled.q, by_numpy.q, atol=1e-9)
    np.testing.assert_allclose(compiled.cost, by_numpy.cost, atol=1e-10)
    np.testing.assert_array_equal(compiled.status, by_numpy.status)


def test_a_clip_that_leaves_a_basin(model: Models, motion: Motions) -> None:
    """Everything that `solve` does, the exchange of a worse stretch included."""
    icub = model("icub")
    targets = mapping.load("limb_plane").targets(motion("reach"), icub)
    problem = orientation_problem(targets, icub, free_base=True)
    by_numpy = solve(problem, NUMPY)
    assert by_numpy.exchanged
    assert_same(by_numpy, solve(problem, COMPILED))


@pytest.mark.parametrize("free_base", [True, False])
@pytest.mark.parametrize("robot", robots.names())
def test_limits_of_all_kinds_at_once(robot: str, free_base: bool, model: Models, swinging: Swinging) -> None:
    """Targets beyond the robot, at its position and speed limits nearly always; also with a moving robot's base held still."""
    chosen = model(robot)
    targets = swinging(chosen, 80, amplitude=2.0, misalignment=0.5, twist_weight=0.1)
    problem = orientation_problem(targets, chosen, free_base=free_base and chosen.base_is_floating)
    assert_same(solve(problem, NUMPY), solve(problem, COMPILED))


def test_joints_that_are_held(model: Models, swinging: Swinging) -> None:
    """The frames' own stiffnesses (`calm`)."""
    g1, rng = model("g1"), np.random.default_rng(0)
    problem = orientation_problem(swinging(g1, 60), g1, free_base=True)
    hold = (rng.uniform(0, 0.5, (60, 29)) * (rng.random((60, 29)) < 0.3), rng.uniform(-0.5, 0.5, (60, 29)))
    held = type(problem)(**{**vars(problem), "hold": hold})
    by_numpy = solve(held, NUMPY)
    assert np.abs(by_numpy.joints - solve(problem, NUMPY).joints).max() > 0.05
    assert_same(by_numpy, solve(held, COMPILED))


def test_a_sliding_joint(sliding_arm: RobotModel) -> None:
    rng, time = np.random.default_rng(0), np.arange(20) / 60
    turn = 0.5 * np.sin(time)[:, None] * rng.normal(size=3)
    task = Task("tip", "orientation", rotations.make_continuous(rotations.exp(turn)))
    problem = orientation_problem(Targets(time, (task,)), sliding_arm, free_base=False)
    assert_same(solve(problem, NUMPY), solve(problem, COMPILED))


def test_frames_are_handed_over_and_the_kernel_goes_on(model: Models, motion: Motions) -> None:
    """iCub's cables bind in part of the reach: those frames, and not many others, are the NumPy solver's."""
    icub = model("icub")
    targets = mapping.load("limb_plane").targets(motion("reach"), icub)
    solver = CompiledSolver(orientation_problem(targets, icub, free_base=True), NewtonOptions())
    path = followed(solver)
    assert solver.problem.coupled is not None
    matrix, lower, upper = solver.problem.coupled
    value = path.q[:, -32:] @ matrix.T
    touched = ((value < lower + 1e-5) | (value > upper - 1e-5)).any(axis=1)
    assert 10 < touched.sum() <= solver.handed_over < touched.sum() + 100
    assert (path.iterations[1:] > 0).all()


def test_a_frame_that_fails_holds_and_is_marked(
    model: Models, swinging: Swinging, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A frame that neither solves: here the kernel is told to stop at it, and the NumPy solver to fail."""
    g1 = model("g1")
    problem = orientation_problem(swinging(g1, 12), g1, free_base=True)
    run, converge = kernel.follow, FrameSolver.converge

    def stopping(*arguments: Any) -> tuple[int, bool]:
        *head, first, last, tolerance, work = arguments
        if first < 6 <= last:
            return (run(*head, first, 5, tolerance, work)[0], False) if first < 5 else (5, False)
        done: tuple[int, bool] = run(*arguments)
        return done

    def failing(self: FrameSolver, k: int, q: Array, lower: Array, upper: Array) -> Converged:
        if k == 6:
            raise SolverError("injected")
        return converge(self, k, q, lower, upper)

    monkeypatch.setattr(kernel, "follow", stopping)
    monkeypatch.setattr(FrameSolver, "converge", failing)
    path = followed(CompiledSolver(problem, NewtonOptions()))
    assert np.flatnonzero(path.status == FRAME_MARKED).tolist() == [6]
    np.testing.assert_array_equal(path.q[6], path.q[5])
    assert (path.q[7] != path.q[6]).any()


def test_backward_and_below(model: Models, swinging: Swinging) -> None:
    """As the basins use it."""
    g1 = model("g1")
    problem = orientation_problem(swinging(g1, 30), g1, free_base=True)
    paths = []
    for solver in (FrameSolver(problem, NewtonOptions()), CompiledSolver(problem, NewtonOptions())):
        path = Path.empty(30, 36)
        path.put(20, solver.converge(20, g1.configuration(problem.reference), problem.lower, problem.upper))
        below = np.full(30, np.inf)
        below[4] = below[27] = 0.0
        assert solver.follow(path, 20, 0, below) == 5
        assert solver.follow(path, 20, 29, below) == 26
        paths.append(path)
    solved = slice(5, 27)
    np.testing.assert_allclose(paths[1].q[solved], paths[0].q[solved], atol=1e-9)
    np.testing.assert_allclose(paths[1].cost[solved], paths[0].cost[solved], atol=1e-12)
    assert np.isinf(paths[1].cost[[0, 4, 27, 29]]).all()


class TestChoice:
    """Which solver a clip gets."""

    @pytest.fixture
    def chosen(self, model: Models, swinging: Swinging) -> Callable[[DynamicalOptions], type]:
        problem = orientation_problem(swinging(model("g1"), 20), model("g1"), free_base=True)
        return lambda options: type(dynamical._frame_solver(problem, options))

    def test_auto_goes_by_length(
        self, chosen: Callable[[DynamicalOptions], type], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        assert chosen(DynamicalOptions()) is FrameSolver
        monkeypatch.setattr(dynamical, "COMPILED_FRAMES", 20)
        assert chosen(DynamicalOptions()) is CompiledSolver
        assert chosen(DynamicalOptions(kernel="numpy")) is FrameSolver
        assert chosen(DynamicalOptions(online=True)) is FrameSolver

    def test_asked_for_it_is_used_at_any_length(self, chosen: Callable[[DynamicalOptions], type]) -> None:
        assert chosen(COMPILED) is CompiledSolver

    def test_code_that_is_not_kept_pays_later(
        self, chosen: Callable[[DynamicalOptions], type], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(dynamical, "COMPILED_FRAMES", 20)
        monkeypatch.setattr(jit, "kept", False)
        assert chosen(DynamicalOptions()) is FrameSolver
        assert chosen(COMPILED) is CompiledSolver
        monkeypatch.setattr(dynamical, "UNKEPT_FRAMES", 20)
        assert chosen(DynamicalOptions()) is CompiledSolver
