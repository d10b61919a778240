"""Whole clips: limits, coupled rows, invariances, bad input, and the optimum that many other starts don't beat."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path as FilePath

import numpy as np
import pytest
from retarget import formats, robots
from retarget.core import mapping, rotations
from retarget.core.errors import SolverError, UsageError
from retarget.core.robot_model import RobotModel
from retarget.core.solve import dynamical, kernel_choice
from retarget.core.solve.dynamical import DynamicalOptions, solve
from retarget.core.solve.limits import nearest_feasible
from retarget.core.solve.newton import FrameSolver, NewtonOptions
from retarget.core.solve.problem import OrientationProblem, orientation_problem
from retarget.core.solve.starts import best_start, configuration
from retarget.core.types import Array, HumanMotion, Targets, Task

Models = Callable[[str], RobotModel]
Motions = Callable[[str], HumanMotion]
Swinging = Callable[..., Targets]
REAL = FilePath(__file__).parents[4] / "shared" / "data" / "mvnx" / "upper_body_v4_60hz.mvnx"
NUMPY = DynamicalOptions(kernel="numpy")


def turned(problem: OrientationProblem, yaw: float) -> OrientationProblem:
    """The same targets seen in a world turned by `yaw` rad about Z."""
    turn = rotations.to_matrix(rotations.exp(np.array([0.0, 0.0, yaw])))
    return replace(
        problem,
        desired=np.ascontiguousarray(turn @ problem.desired),
        desired_bone=np.ascontiguousarray(problem.desired_bone @ turn.T),
        feed_forward=np.ascontiguousarray(problem.feed_forward @ turn.T),
    )


@pytest.mark.parametrize("rate_hz", [10.0, 240.0])
@pytest.mark.parametrize("robot", robots.names())
def test_no_limit_is_broken_by_targets_beyond_the_robot(
    robot: str, rate_hz: float, model: Models, swinging: Swinging
) -> None:
    chosen = model(robot)
    targets = swinging(chosen, 60, amplitude=3.0, misalignment=1.0, rate_hz=rate_hz, twist_weight=0.1)
    solution = solve(orientation_problem(targets, chosen, free_base=chosen.base_is_floating), NUMPY)
    assert not solution.status.any()
    assert ((solution.joints >= chosen.lower) & (solution.joints <= chosen.upper)).all()
    speed = np.abs(np.diff(solution.joints, axis=0)) * rate_hz
    assert (speed <= chosen.velocity_limit).all()
    assert (speed > 0.99 * chosen.velocity_limit).any(), "the targets were meant to ask for more than the robot has"


def test_coupled_rows_hold_on_every_frame_and_some_bind(model: Models, swinging: Swinging) -> None:
    icub = model("icub")
    problem = orientation_problem(swinging(icub, 120, amplitude=2.0, twist_weight=0.1), icub, free_base=True)
    assert problem.coupled is not None
    matrix, lower, upper = problem.coupled
    value = solve(problem, NUMPY).joints @ matrix.T
    assert (value >= lower).all()
    assert (value <= upper).all()
    assert ((value < lower + 1e-5) | (value > upper - 1e-5)).any()
    free = solve(replace(problem, coupled=None), NUMPY).joints @ matrix.T
    assert ((free < lower - 0.1) | (free > upper + 0.1)).any(), "without the rows they should have been broken"


@pytest.mark.parametrize("online", [False, True])
@pytest.mark.parametrize("robot", ["g1", "icub", "talos"])
def test_heading_does_not_matter(robot: str, online: bool, model: Models, swinging: Swinging) -> None:
    """The world turned by any angle: the same joints to 1e-9, the base turned along."""
    chosen = model(robot)
    problem = orientation_problem(swinging(chosen, 40, twist_weight=0.1), chosen, free_base=True)
    options = replace(NUMPY, online=online)
    ahead = solve(problem, options)
    for yaw in (0.3, np.pi / 2, np.pi, -2.0):
        around = solve(turned(problem, yaw), options)
        np.testing.assert_allclose(around.joints, ahead.joints, atol=1e-9)
        assert around.start == ahead.start
        assert ahead.base_orientation is not None
        expected = rotations.multiply(rotations.exp(np.array([0.0, 0.0, yaw])), ahead.base_orientation)
        assert around.base_orientation is not None
        assert rotations.angle(around.base_orientation, expected).max() < 1e-8


def test_without_a_pelvis_target_a_start_facing_away_converges(model: Models, swinging: Swinging) -> None:
    """No target turns the base by itself: the links' half turn has to."""
    g1 = model("g1")
    targets = swinging(g1, 10, misalignment=0.0, amplitude=0.3)
    headless = replace(targets, tasks=tuple(task for task in targets.tasks if task.segment != "Pelvis"))
    problem = orientation_problem(headless, g1, free_base=True)
    ahead = solve(problem, NUMPY)
    for yaw in (np.pi, 2.0, -1.0):
        np.testing.assert_allclose(solve(turned(problem, yaw), NUMPY).joints, ahead.joints, atol=1e-7)


@pytest.mark.parametrize("robot", ["g1", "icub"])
def test_a_cut_does_not_matter(robot: str, model: Models, swinging: Swinging) -> None:
    """What is solved from frame 30 on is what the whole clip has there: frames have no memory."""
    chosen = model(robot)
    targets = swinging(chosen, 60, amplitude=0.3, misalignment=0.05)
    part = Targets(
        targets.time[30:],
        tuple(
            replace(t, value=t.value[30:], feed_forward=None, weight=t.weight[30:]) for t in targets.tasks
        ),
    )  # fmt: skip
    whole = solve(orientation_problem(targets, chosen, free_base=True), NUMPY)
    rest = solve(orientation_problem(part, chosen, free_base=True), NUMPY)
    np.testing.assert_allclose(rest.joints, whole.joints[30:], atol=1e-8)


def test_it_is_deterministic(model: Models, swinging: Swinging) -> None:
    icub = model("icub")
    problem = orientation_problem(swinging(icub, 30, amplitude=1.5), icub, free_base=True)
    first, second = solve(problem, NUMPY), solve(problem, NUMPY)
    np.testing.assert_array_equal(first.joints, second.joints)
    np.testing.assert_array_equal(first.iterations, second.iterations)


def brute_force(problem: OrientationProblem, k: int, posture_weight: float, starts: int = 40) -> float:
    """The least cost of frame k that random starts, drawn here, lead to."""
    solver = FrameSolver(problem, NewtonOptions(posture_weight=posture_weight))
    rng, lowest = np.random.default_rng(1000 + k), np.inf
    lower, upper = np.maximum(problem.lower, -np.pi), np.minimum(problem.upper, np.pi)
    for _ in range(starts):
        joints = nearest_feasible(rng.uniform(lower, upper), problem.lower, problem.upper, problem.coupled)
        found = solver.converge(k, configuration(problem, k, joints), problem.lower, problem.upper)
        lowest = min(lowest, found.cost)
    return lowest


@pytest.mark.slow
@pytest.mark.parametrize("robot", ["g1", "icub"])
@pytest.mark.parametrize("clip", ["walk", "reach", "real"])
def test_cost_is_within_two_percent_of_the_best_of_many_starts(
    clip: str, robot: str, model: Models, motion: Motions, independent_cost: Callable[..., float]
) -> None:
    """On random frames of the samples and of the real recording; the cost by its definition (SciPy, pinocchio)."""
    if clip == "real" and not REAL.is_file():
        pytest.skip("the real recording is not here")
    person, chosen = formats.read_motion(REAL) if clip == "real" else motion(clip), model(robot)
    problem = orientation_problem(mapping.load("limb_plane").targets(person, chosen), chosen, free_base=True)
    weight = chosen.profile.posture_weight
    solution = solve(problem, replace(NUMPY, newton=NewtonOptions(posture_weight=weight)))
    assert solution.base_orientation is not None
    ratios = []
    for k in np.random.default_rng(7).choice(person.frames, 17, replace=False):
        q = chosen.configuration(solution.joints[k], solution.base_orientation[k])
        ratios.append(independent_cost(problem, k, q, weight) / brute_force(problem, int(k), weight))
    assert max(ratios) < 1.02, f"{np.round(ratios, 3)}"


class TestBadInput:
    @pytest.mark.parametrize("name", ["desired", "weight", "feed_forward", "reference", "time"])
    def test_what_is_not_finite_is_refused_before_solving(self, name: str, model: Models, swinging: Swinging) -> None:
        g1 = model("g1")
        problem = orientation_problem(swinging(g1, 5), g1, free_base=True)
        values = np.array(getattr(problem, name))
        values[(-1,) * values.ndim] = np.nan
        where = tuple(size - 1 for size in values.shape)
        with pytest.raises(SolverError, match=f"'{name}' holds nan at") as caught:
            solve(replace(problem, **{name: values}), NUMPY)
        assert str(where) in str(caught.value)

    def test_tasks_of_another_kind(self, model: Models) -> None:
        task = Task("pelvis", "position", np.zeros((1, 3)))
        with pytest.raises(SolverError, match="pelvis has a task of kind 'position'"):
            orientation_problem(Targets(np.zeros(1), (task,)), model("g1"), free_base=True)

    def test_no_task(self, model: Models) -> None:
        with pytest.raises(SolverError, match="mapping 'made up' gives no task for robot 'g1'"):
            orientation_problem(Targets(np.zeros(1), (), "made up"), model("g1"), free_base=True)

    def test_a_first_frame_that_nothing_starts(
        self, model: Models, swinging: Swinging, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def failing(*_: object) -> None:
            raise SolverError("injected")

        monkeypatch.setattr(FrameSolver, "converge", failing)
        g1 = model("g1")
        with pytest.raises(SolverError, match="frame 0 can't be solved from any start"):
            solve(orientation_problem(swinging(g1, 5), g1, free_base=True), NUMPY)


def test_one_frame_is_a_clip(model: Models, swinging: Swinging) -> None:
    g1 = model("g1")
    solution = solve(orientation_problem(swinging(g1, 1), g1, free_base=True), NUMPY)
    assert solution.joints.shape == (1, 29)


def test_progress_ends_at_the_last_frame(model: Models, swinging: Swinging, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dynamical, "CHUNK", 8)
    g1, seen = model("g1"), []
    solve(orientation_problem(swinging(g1, 30), g1, free_base=True), NUMPY, lambda done, of: seen.append((done, of)))
    assert [done for done, _ in seen] == [9, 17, 25, 30]
    assert {of for _, of in seen} == {30}


def test_chunks_leave_no_trace(model: Models, swinging: Swinging, monkeypatch: pytest.MonkeyPatch) -> None:
    g1 = model("g1")
    problem = orientation_problem(swinging(g1, 30), g1, free_base=True)
    whole = solve(problem, NUMPY)
    monkeypatch.setattr(dynamical, "CHUNK", 7)
    in_parts = solve(problem, NUMPY)
    np.testing.assert_array_equal(in_parts.joints, whole.joints)
    np.testing.assert_array_equal(in_parts.iterations, whole.iterations)


class TestStarts:
    def test_the_best_of_several_is_kept(self, model: Models, swinging: Swinging) -> None:
        """Given its own answer among worse postures, that one wins, and says which it was."""
        g1 = model("g1")
        problem = orientation_problem(swinging(g1, 1, misalignment=0.0, amplitude=0.3), g1, free_base=True)
        solver = FrameSolver(problem, NewtonOptions())
        answer = solve(problem, NUMPY).joints[0]
        flipped = answer.copy()
        shoulder = [g1.joint_index(f"left_shoulder_{axis}_joint") for axis in ("pitch", "roll", "yaw")]
        flipped[shoulder] = [-2.0, -1.0, 2.0]
        number, found = best_start(solver, 0, [flipped, answer, problem.reference])
        alone = [best_start(solver, 0, [posture])[1].cost for posture in (flipped, answer, problem.reference)]
        assert found.cost == pytest.approx(min(alone), abs=1e-9)
        assert alone[number] == pytest.approx(min(alone), rel=1e-5, abs=1e-5)

    def test_equal_basins_are_not_decided_by_rounding(self, model: Models, swinging: Swinging) -> None:
        """The same posture twice: the first is kept, however the two results round."""
        g1 = model("g1")
        problem = orientation_problem(swinging(g1, 1), g1, free_base=True)
        nearly: list[Array] = [problem.reference, problem.reference + 1e-5, problem.reference - 1e-5]
        assert best_start(FrameSolver(problem, NewtonOptions()), 0, nearly)[0] == 0


def test_a_compiled_kernel_that_is_not_installed_is_a_usage_error(
    model: Models, swinging: Swinging, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kernel_choice, "find_spec", lambda _: None)
    g1 = model("g1")
    with pytest.raises(UsageError, match="pip install numba"):
        solve(orientation_problem(swinging(g1, 5), g1, free_base=True), DynamicalOptions(kernel="compiled"))
