"""Strict priorities for the solver's tests: paper-like levels on any robot, and eq. 14 of [Lim2022] as the paper prints it."""

from __future__ import annotations

from dataclasses import dataclass

import daqp
import numpy as np
from numpy.typing import NDArray
from retarget import robots
from retarget.core import rotations
from retarget.core.kinematics import link_poses
from retarget.core.robot_model import RobotModel
from retarget.core.solve.cascade import Cascade, CascadeStep
from retarget.core.solve.freedom import ControlStep, Freedom
from retarget.core.solve.hierarchical import HierarchicalSolver
from retarget.core.solve.priorities import narrowed
from retarget.core.types import Array, Targets, Task

HAND_OFFSET = np.array([0.02, -0.03, 0.08])

ROBOTS = ["g1", "talos", "icub", *(["tocabi"] if "tocabi" in robots.names() else [])]
"""Floating and fixed arms of seven and eight joints; iCub with coupled rows."""


def paper_targets(
    robot: RobotModel, joints: Array, rate_hz: float = 60.0, turned: float = 0.0, seed: int = 0
) -> Targets:
    """[Lim2022 table II] on `robot`, as `joints` (T, n) would meet it, orientations and axes turned away by a constant `turned` rad (σ).

    Levels: chest orientation; hand points and orientations and the head's x axis; upper arms' x axes; their y axes, instead of the shoulders'.
    """
    rng, time = np.random.default_rng(seed), np.arange(len(joints)) / rate_hz
    segments = [s for s in ("T8", "LeftHand", "RightHand", "Head", "LeftUpperArm", "RightUpperArm") if s in robot.links]
    links = [robot.links[segment] for segment in segments]
    rotation, origin = link_poses(robot, links, joints)
    tasks = []
    for i, (segment, link) in enumerate(zip(segments, links, strict=True)):
        away = rotations.to_matrix(rotations.exp(rng.normal(0.0, turned, 3)))
        turn = rotation[:, i] @ away
        value = rotations.make_continuous(rotations.from_matrix(turn))
        rate = rotations.angular_velocity(time, value)

        def pointing(
            axis: int, level: int, gain: float, link: str = link, turn: Array = turn, rate: Array = rate
        ) -> Task:
            return Task(link, "axis", turn[:, :, axis], rate, level=level, gain=gain, axis=np.eye(3)[axis])

        if segment == "T8":
            tasks.append(Task(link, "orientation", value, rate, level=0, gain=100.0))
        elif segment == "Head":
            tasks.append(pointing(0, 1, 200.0))
        elif segment.endswith("Hand"):
            point = origin[:, i] + rotation[:, i] @ HAND_OFFSET
            speed = np.gradient(point, time, axis=0) if len(time) > 1 else np.zeros_like(point)
            tasks.append(Task(link, "position", point, speed, level=1, gain=200.0, offset=HAND_OFFSET, segment=segment))
            tasks.append(Task(link, "orientation", value, rate, level=1, gain=100.0))
        else:
            tasks += [pointing(0, 2, 100.0), pointing(1, 3, 100.0)]
    return Targets(time, tuple(tasks), "paper")


def upper_body_motion(
    robot: RobotModel, frames: int, seed: int = 0, rate_hz: float = 60.0, reach: float = 0.3
) -> Array:
    """Joints (T, n) that swing about the reference posture, inside the limits that the hierarchy has; legs in it."""
    robot = narrowed(robot)
    rng, time = np.random.default_rng(seed), np.arange(frames) / rate_hz
    count = len(robot.joint_names)
    phase, away = rng.uniform(0, 6, count), rng.uniform(-0.2, 0.2, count)
    swing = away + rng.uniform(-reach, reach, count) * np.sin(2 * np.pi * 0.4 * time[:, None] + phase)
    for i, name in enumerate(robot.joint_names):
        if any(part in name.lower() for part in ("leg", "hip", "knee", "ankle")):
            swing[:, i] = 0.0
    return np.clip(robot.reference_posture + swing, robot.lower, robot.upper)


@dataclass(frozen=True)
class Step:
    """One random control step: where the robot is, and how fast it was."""

    joints: Array
    before: Array


def random_step(solver: HierarchicalSolver, robot: RobotModel, rng: np.random.Generator) -> Step:
    """A posture anywhere inside the limits, a quarter of the joints near one of them, and velocities within theirs."""
    lower, upper = np.maximum(robot.lower, -2.5), np.minimum(robot.upper, 2.5)
    share = rng.random(len(lower))
    near = rng.random(len(lower)) < 0.25
    share[near] = np.where(share[near] < 0.5, 0.01 * share[near], 1.0 - 0.01 * share[near])
    joints = robot.reference_posture.copy()
    joints[solver.columns] = (lower + share * (upper - lower))[solver.columns]
    return Step(joints, 0.3 * solver.limits.speed * rng.uniform(-1, 1, len(solver.columns)))


def paper_cascade(
    solver: HierarchicalSolver, weight: Array, before: Array, step_s: float
) -> tuple[Array, NDArray[np.bool_]]:
    """Velocities (L, c) after each level of eq. 14 with equalities, on the rows of `solver`'s last step, and whether daqp solved each level.

    A level that is infeasible for daqp's tolerance (the paper's level 5, often) keeps the one before.
    """
    step, count = last_step(solver, before), len(solver.columns)
    velocity, found, solved = np.zeros(count), [], []
    for level, own in zip(solver.levels, solver.level_rows, strict=True):
        higher = step.jacobian[: own.start]
        factor = level.acceleration_s2 / step_s**2
        jacobian, importance = step.jacobian[own], level.weight * weight[own]
        hessian = (jacobian.T * importance) @ jacobian + step.inertia + factor * np.eye(count)
        gradient = -(jacobian.T * importance) @ step.command[own] - factor * before
        # Dependent equalities are inconsistent for any tolerance: an independent set says the same.
        _, size, right = np.linalg.svd(higher) if len(higher) else (None, np.zeros(0), np.eye(count))
        basis = right[: int((size > 1e-9).sum())]
        matrix = np.concatenate([step.constraints, basis])
        fixed = basis @ velocity
        lower, upper = np.concatenate([step.lower, fixed]), np.concatenate([step.upper, fixed])
        sense = np.repeat(np.array([0, 5], np.intc), [len(step.lower), len(basis)])
        # Where limits bind beside many equalities daqp may find no feasible point, unless it solves these first, or in a coarser unit.
        for scale, how in ((1e3, {}), (1e3, {"eq_reduction": 1}), (1.0, {"eq_reduction": 1})):
            problem = (hessian, scale * gradient, matrix, scale * upper, scale * lower, sense.copy())
            x, _, flag, _ = daqp.solve(*problem, **how)
            if flag in (1, 2):
                velocity = np.asarray(x, float) / scale
                break
        solved.append(flag in (1, 2))
        found.append(velocity)
    return np.array(found), np.array(solved)


def last_step(solver: HierarchicalSolver, before: Array) -> ControlStep:
    """What the last step of `solver` gave to its cascade, with the first frame's weights and the velocities (c,) of the step before."""
    rows, limits = solver.rows, solver.limits
    return ControlStep(
        jacobian=rows.jacobian.copy(),
        scale=np.sqrt(solver.weight[0]),
        command=rows.command.copy(),
        inertia=rows.inertia + solver.added_inertia,
        lower=limits.lower.copy(),
        upper=limits.upper.copy(),
        constraints=np.concatenate([rows.hand_rows, limits.coupled]),
        before=before,
    )


def by_cascade(cascade: Cascade, step: ControlStep, step_s: float) -> CascadeStep:
    """`step` solved with the first frame's weights."""
    return cascade.solve(
        0, step.jacobian, step.command, step.inertia, step.lower, step.upper, step.constraints, step.before, step_s
    )


def largest_change(
    solver: HierarchicalSolver, before: Array, full: Array, step_s: float, freedom: type[Freedom] = Freedom
) -> float:
    """By how much a level's task velocities differ between the cascade that ends with it and the whole one."""
    step, largest = last_step(solver, before), 0.0
    for count in range(1, len(solver.levels)):
        part = Cascade(solver.levels[:count], solver.level_rows[:count], solver.weight, solver.limits.speed, freedom)
        found = by_cascade(part, step, step_s)
        own = slice(0, solver.level_rows[count - 1].stop)
        largest = max(largest, float(np.abs(step.jacobian[own] @ (full - found.velocity)).max()))
    return largest
