"""Puts a trajectory's joints into a robot's order, by name; and says which robot a trajectory is of.

A file that names no joints can't be matched, only read with names that someone gives: `joint_order` has the two orders that are in use.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from retarget.core.errors import InvalidDataError, UnknownNameError, UsageError, nearest
from retarget.core.robot_model import RobotModel
from retarget.core.types import JointTrajectory

Order = Literal["urdf", "isaac"]
ORDERS: tuple[Order, ...] = ("urdf", "isaac")
UNNAMED_BASE = "base_link"
"""The base frame's name where a file gives none."""


def robot_name(trajectory: JointTrajectory, given: str = "") -> str:
    """The robot to judge `trajectory` on: the one that is given, else the one that it was made for.

    Raises `UsageError` when neither is known.
    """
    recorded = trajectory.robot or str(trajectory.provenance.get("robot", ""))
    if name := given or recorded:
        return name
    raise UsageError(
        f"the trajectory doesn't say which robot it is of ({len(trajectory.joint_names)} joints, the first is "
        f"'{trajectory.joint_names[0] if trajectory.joint_names else ''}'); expected a robot to be named"
    )


def matched(trajectory: JointTrajectory, model: RobotModel) -> JointTrajectory:
    """`trajectory` with the joints of `model`, in its order; the same object where that holds already.

    Joints that the model holds fixed are left out, with a warning in the provenance.
    Raises `InvalidDataError` for joints that the robot lacks (naming the nearest), for joints that are missing, and for a base pose, of a robot whose
    base floats, that is another link's than the model's base.
    """
    names, wanted = trajectory.joint_names, model.joint_names
    if names == wanted and trajectory.base_frame == model.base_link:
        return trajectory
    _check_base(trajectory, model)
    fixed = _fixed_joints(model)
    unknown = [name for name in names if name not in wanted and name not in fixed]
    missing = [name for name in wanted if name not in names]
    robot = model.profile.name
    if unknown:
        near = nearest(unknown[0], missing or wanted)
        hint = f"did you mean {' or '.join(near)}?" if near else f"it has {', '.join(wanted)}"
        count = f" (and {len(unknown) - 1} more)" if len(unknown) > 1 else ""
        sizes = f"; {len(names)} joints found, {len(wanted)} expected" if len(names) != len(wanted) else ""
        raise InvalidDataError(f"robot '{robot}' has no joint '{unknown[0]}'{count}; {hint}{sizes}")
    if missing:
        shown = ", ".join(missing[:5]) + (f" and {len(missing) - 5} more" if len(missing) > 5 else "")
        raise InvalidDataError(
            f"the trajectory lacks {len(missing)} of the {len(wanted)} joints of robot '{robot}': {shown}"
        )
    columns = [names.index(name) for name in wanted]
    provenance = dict(trajectory.provenance)
    if dropped := [name for name in names if name in fixed and name not in wanted]:
        warning = f"joints that robot '{robot}' holds fixed were left out: {', '.join(dropped)}"
        provenance["warnings"] = [*provenance.get("warnings", []), warning]
    return replace(
        trajectory,
        joint_names=wanted,
        position=trajectory.position[:, columns],
        velocity=trajectory.velocity[:, columns],
        base_frame=model.base_link,
        provenance=provenance,
    )


def joint_order(model: RobotModel, order: str = "urdf") -> tuple[str, ...]:
    """The model's joints in the order of files that name none. Raises `UnknownNameError` for an order that is none.

    "urdf": depth first, limb after limb, as URDF parsers and MuJoCo number them; Unitree's and GMR's files.
    "isaac": breadth first from the base, all hips before all knees, as Isaac Sim numbers them; BeyondMimic's motion files.
    Children of one link stand in the order of the model in either.
    """
    if order not in ORDERS:
        raise UnknownNameError("joint order", order, ORDERS)
    if order == "urdf":
        return model.joint_names
    depth = {0: 0}
    parents = model.pin_model.parents
    for joint in range(1, model.pin_model.njoints):
        depth[joint] = depth[int(parents[joint])] + 1
    first = model.pin_model.njoints - len(model.joint_names)
    level = [depth[first + i] for i in range(len(model.joint_names))]
    # Breadth first: by depth; within it by the parent's place in the level above, which the stable sort over depth-first numbers keeps.
    return tuple(model.joint_names[i] for i in np.argsort(level, kind="stable"))


def _fixed_joints(model: RobotModel) -> set[str]:
    return {str(frame.name) for frame in model.pin_model.frames if str(frame.type) == "FIXED_JOINT"}


def _check_base(trajectory: JointTrajectory, model: RobotModel) -> None:
    frame, links = trajectory.base_frame, _links(model)
    if trajectory.base_position is None or frame in (model.base_link, UNNAMED_BASE) or not model.base_is_floating:
        return
    problem = "which is another link of the robot" if frame in links else "which the robot lacks"
    raise InvalidDataError(
        f"the trajectory's base pose is that of '{frame}', {problem}; expected '{model.base_link}', the base of robot '{model.profile.name}'"
    )


def _links(model: RobotModel) -> Sequence[str]:
    return [str(frame.name) for frame in model.pin_model.frames if str(frame.type) == "BODY"]
