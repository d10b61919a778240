"""Who may move, and how much which priority level counts: what a robot's profile says of its hierarchy, made concrete for given targets."""

from __future__ import annotations

from dataclasses import dataclass, replace
from fnmatch import fnmatchcase

import numpy as np
from numpy.typing import NDArray
from retarget.core.errors import ProfileError, SolverError, nearest
from retarget.core.profile import Level
from retarget.core.robot_model import RobotModel
from retarget.core.solve.problem import joint_paths
from retarget.core.types import Targets, Task

PAPER_LEVELS = (Level((), 50.0), Level((), 50.0), Level((), 5.0, 4e-5), Level((), 5.0, 4e-5))
"""Weights ρ and acceleration costs of chest, hands, upper arms and shoulders [Lim2022 eq. 14, their code]; lower levels are like the last."""


@dataclass(frozen=True)
class Priority:
    """One level as the solver sees it: tasks first to last of the sorted ones, ρ, and the factor (s²) on ‖q̈‖²."""

    number: int
    tasks: slice
    weight: float
    acceleration_s2: float


def moving_columns(targets: Targets, model: RobotModel) -> NDArray[np.intp]:
    """Columns (c,) of the joints that are solved for: those of the profile's hierarchy, or else all between the base and a task's frame.

    Raises `SolverError` for a task on a frame that the model lacks, a pattern that fits no joint, and where nothing moves any task.
    """
    paths = joint_paths(model, 0)
    on_path = {column for task in targets.tasks for column in paths[frame_joint(model, task.frame)]}
    patterns = model.profile.hierarchy.joints
    for pattern in patterns:
        if not any(fnmatchcase(name, pattern) for name in model.joint_names):
            near = nearest(pattern, model.joint_names)
            hint = f"; did you mean {' or '.join(near)}?" if near else ""
            raise SolverError(f"robot '{model.profile.name}', [hierarchy] joints: no joint fits '{pattern}'{hint}")
    columns = [
        column
        for column, name in enumerate(model.joint_names)
        if (any(fnmatchcase(name, pattern) for pattern in patterns) if patterns else column in on_path)
    ]
    if not on_path.intersection(columns):
        raise SolverError(
            f"mapping '{targets.mapping}' gives robot '{model.profile.name}' no task that a joint of its hierarchy moves"
        )
    return np.array(columns, np.intp)


def sorted_tasks(targets: Targets, model: RobotModel, columns: NDArray[np.intp]) -> tuple[Task, ...]:
    """The tasks that the joints `columns` (c,) move, by level; the others are out of reach, and no level loses freedom to them."""
    paths, moving = joint_paths(model, 0), set(columns.tolist())
    tasks = [task for task in targets.tasks if moving.intersection(paths[frame_joint(model, task.frame)])]
    return tuple(sorted(tasks, key=lambda task: task.level))


def priorities(tasks: tuple[Task, ...], model: RobotModel) -> tuple[Priority, ...]:
    """The levels of `tasks`, which are sorted, with the profile's weights, or the paper's where it declares none. First level first."""
    declared = model.profile.hierarchy.levels
    found = []
    for number in sorted({task.level for task in tasks}):
        own = [i for i, task in enumerate(tasks) if task.level == number]
        level = declared[number] if number < len(declared) else PAPER_LEVELS[min(number, len(PAPER_LEVELS) - 1)]
        found.append(Priority(number, slice(own[0], own[-1] + 1), level.weight, level.acceleration_s2))
    return tuple(found)


def hand_points(tasks: tuple[Task, ...], model: RobotModel) -> tuple[tuple[str, tuple[float, float, float]], ...]:
    """(link, point (3,) m in its frame) of every hand whose velocity is boxed in: the profile's arms, and what position tasks lead."""
    points = [(arm.hand_link, tuple(arm.hand_m)) for arm in model.profile.arms.values()]
    points += [(task.frame, tuple(task.offset.tolist())) for task in tasks if task.kind == "position"]
    return tuple(dict.fromkeys(points))  # type: ignore[arg-type]  # a tuple of (3,) has three entries


def frame_joint(model: RobotModel, frame: str) -> int:
    """The pinocchio joint that carries `frame`. Raises `SolverError` when the model has no such frame."""
    import pinocchio as pin

    if not model.pin_model.existFrame(frame, pin.FrameType.BODY):
        near = nearest(frame, [str(f.name) for f in model.pin_model.frames])
        hint = f"; did you mean {' or '.join(near)}?" if near else ""
        raise SolverError(f"robot '{model.profile.name}' has no frame '{frame}'{hint}")
    return model.link_in_joint(frame)[0]


def narrowed(model: RobotModel) -> RobotModel:
    """`model` with the joint limits that its hierarchy narrows, and the reference posture inside them.

    Raises `ProfileError` where no value is left.
    """
    hierarchy = model.profile.hierarchy
    if not hierarchy.lower and not hierarchy.upper:
        return model
    lower, upper = model.lower.copy(), model.upper.copy()
    for joint, value in hierarchy.lower.items():
        lower[model.joint_index(joint)] = max(value, lower[model.joint_index(joint)])
    for joint, value in hierarchy.upper.items():
        upper[model.joint_index(joint)] = min(value, upper[model.joint_index(joint)])
    if (lower > upper).any():
        at = int(np.argmax(lower > upper))
        raise ProfileError(
            model.profile.origin or model.profile.name,
            f"joint {model.joint_names[at]} would have to stay above {lower[at]:g} and below {upper[at]:g} rad",
            place="[hierarchy.lower_rad] and [hierarchy.upper_rad]",
            expected="limits that overlap with the joint's own",
        )
    return replace(model, lower=lower, upper=upper, reference_posture=np.clip(model.reference_posture, lower, upper))
