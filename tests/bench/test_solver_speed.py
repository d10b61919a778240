"""Solver speed: one step a frame of the same orientation tasks, ours against placo, mink and a naive loop, on G1 and iCub, in one run.

Two works. "walk": the walk sample's link orientations (the paper's mapping), which the robots follow almost without touching a limit. "limits":
joints swinging through their ranges, every link's target turned away by 0.2 rad, so that none can be met and some limit binds in most
frames. Everyone has a floating base, position and speed limits, one solve per frame, and sets its targets from Python; ours is `--online`
[Darvish2019 eq. 5] on NumPy. Building robots, tasks and problems is nobody's time. iCub's coupled rows are left out: only we have them.

All take turns in this one process, and the best of several turns counts, in processor time: other work on the machine hits everyone.
Ratios are recorded and printed, not asserted; that every one of them follows the walk, and that ours keeps the limits, is asserted.
"""

from __future__ import annotations

import time
import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path as FilePath

import daqp
import numpy as np
import pinocchio as pin
import pytest
from pytest_benchmark.fixture import BenchmarkFixture
from retarget import formats, robots, samples
from retarget.core import mapping, rotations, timebase
from retarget.core.kinematics import link_poses
from retarget.core.robot_model import RobotModel, build
from retarget.core.solve.dynamical import DynamicalOptions, solve
from retarget.core.solve.newton import Converged, FrameSolver, NewtonOptions, Path
from retarget.core.solve.online import OnlineOptions, OnlineSolver
from retarget.core.solve.problem import OrientationProblem, orientation_problem
from retarget.core.types import Array, Targets, Task

FRAMES, STEP_S = 600, 1 / 60
Run = Callable[[], Array]
"""Runs all frames from the start posture; the joints (T - 1, n) after each."""


@dataclass(frozen=True)
class Work:
    """The same job for everyone: tasks (L links), targets (T, L, 3, 3) world ← link, start joints (n,) and base (4,), and our form of it."""

    name: str
    model: RobotModel
    links: list[str]
    targets: Array
    joints: Array
    base: Array
    problem: OrientationProblem
    bare_urdf: str


@pytest.fixture(scope="module", params=["g1-walk", "icub-walk", "g1-limits", "icub-limits"])
def work(request: pytest.FixtureRequest) -> Work:
    robot, kind = request.param.split("-")
    model = build(replace(robots.load(robot), coupled=()))
    targets = walking(model) if kind == "walk" else swinging(model)
    problem = orientation_problem(targets, model, free_base=True)
    first = solve(replace(problem, **_frames(problem, slice(0, 1))), DynamicalOptions())
    assert first.base_orientation is not None
    matrices = np.stack([rotations.to_matrix(task.value) for task in targets.tasks], axis=1)
    links = [task.frame for task in targets.tasks]
    bare = _without_meshes(model.urdf)
    return Work(request.param, model, links, matrices, first.joints[0], first.base_orientation[0], problem, bare)


def walking(model: RobotModel) -> Targets:
    motion = timebase.cut(formats.read_motion(samples.sample_path("walk")), 2.0, 2.0 + (FRAMES - 1) * STEP_S)
    return mapping.load("link_orientation").targets(motion, model)


def swinging(model: RobotModel) -> Targets:
    rng, at = np.random.default_rng(0), np.arange(FRAMES) * STEP_S
    middle, half = 0.5 * (model.lower + model.upper), 0.5 * (model.upper - model.lower)
    joints = middle + np.minimum(half, 1.5) * 1.1 * np.sin(
        rng.uniform(1, 4, len(middle)) * at[:, None] + rng.uniform(0, 6, len(middle))
    )
    turn = np.stack([0.2 * np.sin(at), 0.2 * np.cos(at), 0.3 * at], axis=1)
    base = rotations.multiply(rotations.exp(turn), model.base_rotation)
    rotation, _ = link_poses(model, list(model.links.values()), joints, base)
    tasks = []
    for i, link in enumerate(model.links.values()):
        away = rotations.exp(rng.normal(0, 0.2, 3))
        value = rotations.make_continuous(rotations.multiply(rotations.from_matrix(rotation[:, i]), away))
        tasks.append(Task(link, "orientation", value, rotations.angular_velocity(at, value)))
    return Targets(at, tuple(tasks))


def _frames(problem: OrientationProblem, part: slice) -> dict[str, Array]:
    return {
        name: getattr(problem, name)[part] for name in ("time", "desired", "desired_bone", "feed_forward", "weight")
    }


def _without_meshes(urdf: str) -> str:
    """placo and MuJoCo want every mesh they are told of, and no solver looks at one."""
    root = ET.fromstring(urdf)
    for link in root.findall("link"):
        for tag in ("visual", "collision"):
            for element in link.findall(tag):
                link.remove(element)
    return ET.tostring(root, encoding="unicode")


def started(work: Work) -> Path:
    path = Path.empty(FRAMES, work.model.pin_model.nq)
    path.put(0, Converged(work.model.configuration(work.joints, work.base), 0.0, 1, True))
    return path


def ours(work: Work) -> Run:
    solver, path, n = OnlineSolver(work.problem, OnlineOptions()), started(work), len(work.joints)

    def run() -> Array:
        solver.follow(path, 0, FRAMES - 1)
        return path.q[1:, -n:]

    return run


def placo(work: Work, folder: FilePath) -> Run:
    import placo as library

    (folder / "robot.urdf").write_text(work.bare_urdf)
    robot = library.RobotWrapper(str(folder), library.Flags.ignore_collisions)
    solver = library.KinematicsSolver(robot)
    solver.dt = STEP_S
    for name, limit in zip(work.model.joint_names, work.model.velocity_limit, strict=True):
        robot.set_velocity_limit(name, limit)
    solver.enable_joint_limits(True)
    solver.enable_velocity_limits(True)
    tasks = [solver.add_orientation_task(link, work.targets[0, i]) for i, link in enumerate(work.links)]
    for task, link in zip(tasks, work.links, strict=True):
        task.configure(link, "soft", 1.0)
    solver.add_regularization_task(1e-3)
    turn = np.eye(4)
    turn[:3, :3] = rotations.to_matrix(work.base)
    joints = np.empty((FRAMES - 1, len(work.joints)))

    def run() -> Array:
        for name, value in zip(work.model.joint_names, work.joints, strict=True):
            robot.set_joint(name, value)
        robot.set_T_world_frame(work.model.base_link, turn)
        robot.update_kinematics()
        for k in range(1, FRAMES):
            for task, target in zip(tasks, work.targets[k], strict=True):
                task.R_world_frame = target
            solver.solve(True)
            robot.update_kinematics()
            joints[k - 1] = robot.state.q[7:]
        return joints

    return run


def mink(work: Work) -> Run:
    import mink as library
    import mujoco

    spec = mujoco.MjSpec.from_string(work.bare_urdf)
    spec.compiler.fusestatic = False
    spec.compiler.balanceinertia = True
    spec.compiler.boundmass, spec.compiler.boundinertia = 1e-4, 1e-6
    spec.worldbody.first_body().add_freejoint()
    model = spec.compile()
    configuration = library.Configuration(model)
    q = configuration.q.copy()
    q[3:7] = work.base
    places = [model.joint(name).qposadr[0] for name in work.model.joint_names]
    q[places] = work.joints
    tasks = [library.FrameTask(link, "body", position_cost=0.0, orientation_cost=1.0) for link in work.links]
    speeds = dict(zip(work.model.joint_names, work.model.velocity_limit, strict=True))
    limits = [library.ConfigurationLimit(model), library.VelocityLimit(model, speeds)]
    joints = np.empty((FRAMES - 1, len(work.joints)))

    def run() -> Array:
        configuration.update(q)
        for k in range(1, FRAMES):
            for task, target in zip(tasks, work.targets[k], strict=True):
                task.set_target(library.SE3.from_rotation(library.SO3.from_matrix(target)))
            velocity = library.solve_ik(configuration, tasks, STEP_S, "daqp", damping=1e-3, limits=limits)
            configuration.integrate_inplace(velocity, STEP_S)
            joints[k - 1] = configuration.q[places]
        return joints

    return run


def naive(work: Work) -> Run:
    """As one writes it down, and as task libraries do: a Jacobian per link, JᵀJ summed up, daqp."""
    model, data = work.model.pin_model, work.model.pin_model.createData()
    ids = [model.getFrameId(link) for link in work.links]
    lower, upper, speed = work.model.lower, work.model.upper, work.model.velocity_limit
    n, columns = len(lower), len(lower) + 3
    no_rows, sense = np.zeros((0, columns)), np.zeros(columns, np.intc)
    joints = np.empty((FRAMES - 1, n))

    def run() -> Array:
        q = work.model.configuration(work.joints, work.base)
        for k in range(1, FRAMES):
            pin.computeJointJacobians(model, data, q)
            pin.updateFramePlacements(model, data)
            hessian, gradient = 1e-3 * np.eye(columns), np.zeros(columns)
            for i, frame in enumerate(ids):
                jacobian = pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)[3:, 3:]
                wanted = pin.log3(work.targets[k, i] @ data.oMf[frame].rotation.T) / STEP_S
                hessian += jacobian.T @ jacobian
                gradient -= jacobian.T @ wanted
            low, high = np.full(columns, -1e3), np.full(columns, 1e3)
            low[3:] = np.maximum(-speed, (lower - q[-n:]) / STEP_S)
            high[3:] = np.minimum(speed, (upper - q[-n:]) / STEP_S)
            velocity, _, flag, _ = daqp.solve(hessian, gradient, no_rows, high, low, sense)
            assert flag in (1, 2)
            q = pin.integrate(model, q, np.concatenate([np.zeros(3), velocity]) * STEP_S)
            joints[k - 1] = q[-n:]
        return joints

    return run


def microseconds(runs: dict[str, Run], turns: int = 5) -> dict[str, float]:
    """Processor time a frame, best of `turns`, everyone once per turn."""
    best = dict.fromkeys(runs, np.inf)
    for _ in range(turns):
        for name, run in runs.items():
            begin = time.process_time()
            run()
            best[name] = min(best[name], time.process_time() - begin)
    return {name: 1e6 * seconds / (FRAMES - 1) for name, seconds in best.items()}


def follows(joints: Array, best: Array) -> bool:
    """Within 0.1 rad rms of the converged answer, over the later half."""
    return bool(np.sqrt(np.mean((joints[FRAMES // 2 :] - best[FRAMES // 2 + 1 :]) ** 2)) < 0.1)


def record(benchmark: BenchmarkFixture, work: Work, found: dict[str, float], own: str) -> None:
    others = [name for name in found if name != own]
    benchmark.extra_info.update({f"microseconds_a_frame_{name}": value for name, value in found.items()})
    benchmark.extra_info.update({f"{own}_relative_to_{name}": found[own] / found[name] for name in others})
    print(f"\n{work.name}: {own} {found[own]:.1f} µs a frame, " + ", ".join(
        f"{name} {found[name]:.1f} (ratio {found[own] / found[name]:.3f})" for name in others
    ))  # fmt: skip


def test_one_step_a_frame(benchmark: BenchmarkFixture, work: Work, tmp_path: FilePath) -> None:
    runs = {"ours": ours(work), "naive": naive(work)}
    for name, make in (("placo", lambda: placo(work, tmp_path)), ("mink", lambda: mink(work))):
        try:
            runs[name] = make()
        except ImportError:
            print(f"\n{name} is not installed: pip install 'retarget[bench]'")
    joints = benchmark(runs["ours"])
    assert ((joints >= work.model.lower) & (joints <= work.model.upper)).all()
    assert (np.abs(np.diff(joints, axis=0)) / STEP_S <= work.model.velocity_limit).all()
    if work.name.endswith("walk"):
        best = solve(work.problem, DynamicalOptions(starts=1, kernel="numpy")).joints
        for name, run in runs.items():
            assert follows(run(), best), name
    record(benchmark, work, microseconds(runs), "ours")


def test_converged_frames(benchmark: BenchmarkFixture, work: Work) -> None:
    """The offline default: the NumPy solver and the compiled kernel, following the clip frame by frame."""
    pytest.importorskip("numba", reason="numba is not there for this Python")
    from retarget.core.solve.compiled import CompiledSolver

    def follow(solver: FrameSolver) -> Run:
        path, n = started(work), len(work.joints)

        def run() -> Array:
            solver.follow(path, 0, FRAMES - 1)
            return path.q[1:, -n:]

        return run

    runs = {
        "compiled": follow(CompiledSolver(work.problem, NewtonOptions())),
        "numpy": follow(FrameSolver(work.problem, NewtonOptions())),
    }
    np.testing.assert_allclose(runs["compiled"](), runs["numpy"](), atol=1e-9)
    benchmark(runs["compiled"])
    record(benchmark, work, microseconds(runs), "compiled")
