"""Leaving worse basins: a path that is stuck gets out, within every limit; a path that is not stays as it is."""

from __future__ import annotations

from collections.abc import Callable
from itertools import islice

import numpy as np
import pytest
from retarget.core import mapping
from retarget.core.robot_model import RobotModel
from retarget.core.solve.basins import frames_to_look_at, leave_worse_basins
from retarget.core.solve.newton import FrameSolver, NewtonOptions, Path
from retarget.core.solve.problem import OrientationProblem, orientation_problem
from retarget.core.solve.starts import best_start, postures
from retarget.core.types import Array, HumanMotion, Targets

Models = Callable[[str], RobotModel]
Motions = Callable[[str], HumanMotion]
Swinging = Callable[..., Targets]


def followed(solver: FrameSolver, starts: list[Array]) -> Path:
    path = Path.empty(len(solver.problem.time), solver.problem.model.pin_model.nq)
    path.put(0, best_start(solver, 0, starts)[1])
    solver.follow(path, 0, len(path.q) - 1)
    return path


def assert_limits_hold(problem: OrientationProblem, path: Path) -> None:
    joints = path.q[:, -len(problem.lower) :]
    assert ((joints >= problem.lower) & (joints <= problem.upper)).all()
    allowed = problem.velocity * np.diff(problem.time)[:, None]
    assert (np.abs(np.diff(joints, axis=0)) <= allowed * (1 + 1e-9)).all()
    if problem.coupled is not None:
        matrix, lower, upper = problem.coupled
        value = joints @ matrix.T
        assert ((value >= lower) & (value <= upper)).all()


def stuck(g1: RobotModel, targets: Targets) -> tuple[FrameSolver, Path, Path]:
    """Solver, a path that starts in a basin clearly worse than the best, and the path that starts in the best."""
    problem = orientation_problem(targets, g1, free_base=True)
    solver = FrameSolver(problem, NewtonOptions())
    good = followed(solver, list(islice(postures(problem, 0), 16)))
    for posture in islice(postures(problem, 5), 3, 60):
        bad = followed(solver, [posture])
        if (bad.cost > 1.5 * good.cost).all():
            return solver, bad, good
    pytest.fail("no start leads to a worse basin that lasts")


def test_a_stuck_path_gets_out_and_keeps_every_limit(model: Models, swinging: Swinging) -> None:
    solver, path, good = stuck(model("g1"), swinging(model("g1"), 240, amplitude=0.2, misalignment=0.02))
    worse = path.cost.sum()
    assert leave_worse_basins(solver, path) >= 1
    assert path.cost.sum() < worse
    assert np.mean(path.cost <= 1.02 * good.cost) > 0.9
    assert_limits_hold(solver.problem, path)
    for k in (0, 60, 120, 239):
        assert path.cost[k] == pytest.approx(solver.cost(k, path.q[k]), abs=1e-9)


@pytest.mark.parametrize("robot", ["g1", "icub"])
def test_the_best_path_stays(robot: str, model: Models, swinging: Swinging) -> None:
    chosen = model(robot)
    problem = orientation_problem(swinging(chosen, 120, amplitude=0.2), chosen, free_base=True)
    solver = FrameSolver(problem, NewtonOptions())
    path = followed(solver, list(islice(postures(problem, 0), 16)))
    before = path.q.copy()
    assert leave_worse_basins(solver, path) == 0
    np.testing.assert_array_equal(path.q, before)


def test_lagging_behind_is_no_basin(model: Models, swinging: Swinging) -> None:
    """Targets too fast for the joints: fresh starts are far cheaper, but so would the path be if it had the time."""
    g1 = model("g1")
    problem = orientation_problem(swinging(g1, 120, amplitude=0.3, misalignment=0.0), g1, free_base=True)
    slow = OrientationProblem(**{**vars(problem), "velocity": np.full(29, 0.3)})
    solver = FrameSolver(slow, NewtonOptions())
    path = followed(solver, [slow.reference])
    fresh = [best_start(solver, k, [slow.reference])[1].cost for k in (30, 60, 90)]
    assert any(path.cost[k] > 1.5 * cost for k, cost in zip((30, 60, 90), fresh, strict=True))
    before = path.q.copy()
    leave_worse_basins(solver, path)
    np.testing.assert_array_equal(path.q, before)


def test_icubs_reach_gets_out_of_the_basin_that_its_shoulders_trap_it_in(model: Models, motion: Motions) -> None:
    """The sample that showed the need: overhead, following leaves the arm three times as costly as a fresh start."""
    icub = model("icub")
    targets = mapping.load("limb_plane").targets(motion("reach"), icub)
    solver = FrameSolver(orientation_problem(targets, icub, free_base=True), NewtonOptions())
    path = followed(solver, list(islice(postures(solver.problem, 0), 16)))
    overhead, before, q = slice(117, 147), path.cost.copy(), path.q.copy()
    assert leave_worse_basins(solver, path) >= 1
    assert path.cost[overhead].mean() < 0.5 * before[overhead].mean()
    assert path.cost.sum() < before.sum()
    assert_limits_hold(solver.problem, path)
    joints, earlier = path.q[:, -32:], q[:, -32:]
    changed = np.flatnonzero((joints != earlier).any(axis=1))
    assert changed[0] < 117
    assert 147 <= changed[-1] < 300, "what lies far from the worse basin stays as it was"
    assert np.mean(np.diff(joints, 3, axis=0) ** 2) < 1.5 * np.mean(np.diff(earlier, 3, axis=0) ** 2)


class TestFramesToLookAt:
    def test_go_by_the_recordings_clock(self) -> None:
        """A clip and its part from 1.3 s on look at the same moments, the part's first frame apart."""
        time = np.arange(300) / 60
        whole = time[frames_to_look_at(time)]
        np.testing.assert_allclose(whole, np.arange(10) * 0.5)
        part = time[78:]
        np.testing.assert_allclose(part[frames_to_look_at(part)], [1.3, *np.arange(3, 10) * 0.5])

    def test_one_frame(self) -> None:
        assert frames_to_look_at(np.array([3.2])).tolist() == [0]
