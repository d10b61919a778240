"""`Targets` + `RobotModel` → the plain arrays that the inner loops work on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from retarget.core import rotations
from retarget.core.errors import SolverError
from retarget.core.robot_model import RobotModel
from retarget.core.types import Array, Targets

VELOCITY_MARGIN = 1e-6
"""Steps stay this fraction below the velocity limit: time stamps are rounded to nanoseconds when they are written."""


@dataclass(frozen=True, eq=False)
class OrientationProblem:
    """Orientation tasks over T frames for L links of a robot with n joints; columns are the moving base's 3 rotations, then the joints.

    desired: (T, L, 3, 3) rotation world ← frame of the joint that carries the link (link placements are folded in).
    bone: (L, 3) unit, in the joint's frame; desired_bone: (T, L, 3) where it should point, world. feed_forward: (T, L, 3) rad/s, world.
    weight: (T, L) ≥ 0. twist_loss: (L,) = 1 - twist weight: how much less a rotation about the bone counts, 0 where all axes count alike.
    joint_ids: (L,) pinocchio joints. moves: (L, columns) 1 where a column's motion turns the link.
    leads: (columns, columns) 1 where the row's motion turns the axis of the column, that is where it stands nearer to the base.
    lower, upper, velocity: (n,) limits, rad and rad/s. coupled: (matrix (m, n), lower (m,), upper (m,)) or None. reference: (n,) posture.
    hold: (stiffness (T, n) ≥ 0, posture (T, n) rad) that joints are pulled to beside everything else, or None (`calm`).
    """

    model: RobotModel
    time: Array
    desired: Array
    desired_bone: Array
    feed_forward: Array
    weight: Array
    bone: Array
    twist_loss: Array
    joint_ids: NDArray[np.intp]
    moves: Array
    leads: Array
    base_columns: int
    lower: Array
    upper: Array
    velocity: Array
    reference: Array
    coupled: tuple[Array, Array, Array] | None
    hold: tuple[Array, Array] | None = None

    @property
    def columns(self) -> int:
        """Number of unknowns of one step."""
        return self.base_columns + len(self.lower)

    def check_finite(self) -> None:
        """Raise `SolverError` for the first value that is not finite: QP solvers return NaN as success."""
        for name in ("time", "desired", "feed_forward", "weight", "lower", "upper", "velocity", "reference"):
            values = getattr(self, name)
            if not (finite := np.isfinite(values)).all():
                where = tuple(int(i) for i in np.argwhere(~finite)[0])
                raise SolverError(
                    f"the solver's input '{name}' holds {values[where]} at {where}, expected finite values"
                )


def orientation_problem(targets: Targets, model: RobotModel, *, free_base: bool) -> OrientationProblem:
    """The problem that `targets` pose to `model`; with `free_base` the base's rotation is solved for as well.

    Raises `SolverError` for kinds of task that the dynamical solver does not follow, and when there is no task.
    """
    if other := [task for task in targets.tasks if task.kind != "orientation"]:
        raise SolverError(
            f"the dynamical solver follows orientations; {other[0].frame} has a task of kind '{other[0].kind}'"
        )
    if not targets.tasks:
        raise SolverError(
            f"mapping '{targets.mapping}' gives no task for robot '{model.profile.name}' from what was measured"
        )
    frames, links = len(targets.time), len(targets.tasks)
    ids, bone = [], np.empty((links, 3))
    desired, desired_bone = np.empty((frames, links, 3, 3)), np.empty((frames, links, 3))
    feed_forward, weight = np.zeros((frames, links, 3)), np.empty((frames, links))
    for i, task in enumerate(targets.tasks):
        joint, placement, _ = model.link_in_joint(task.frame)
        ids.append(joint)
        orientation = rotations.to_matrix(task.value)
        desired[:, i] = orientation @ placement.T
        bone[i] = placement @ task.axis
        desired_bone[:, i] = orientation @ task.axis
        if task.feed_forward is not None:
            feed_forward[:, i] = task.feed_forward
        weight[:, i] = task.weight
    base_columns = 3 if free_base else 0
    paths = joint_paths(model, base_columns)
    first = base_columns + len(model.joint_names) - model.pin_model.nv
    moves = np.zeros((links, base_columns + len(model.joint_names)))
    leads = np.zeros((moves.shape[1], moves.shape[1]))
    for row, joint in enumerate(ids):
        moves[row, paths[joint]] = 1.0
    for joint, path in paths.items():
        if model.pin_model.joints[joint].nv == 1:
            column = first + model.pin_model.joints[joint].idx_v
            leads[[c for c in path if c != column], column] = 1.0
    return OrientationProblem(
        model=model,
        time=targets.time,
        desired=desired,
        desired_bone=desired_bone,
        feed_forward=feed_forward,
        weight=weight,
        bone=bone,
        twist_loss=np.array([1.0 - task.twist_weight for task in targets.tasks]),
        joint_ids=np.array(ids),
        moves=moves,
        leads=leads,
        base_columns=base_columns,
        lower=model.lower,
        upper=model.upper,
        velocity=model.velocity_limit * (1.0 - VELOCITY_MARGIN),
        reference=model.reference_posture,
        coupled=coupled_rows(model),
    )


def coupled_rows(model: RobotModel) -> tuple[Array, Array, Array] | None:
    """All coupled-joint inequalities over the full joint vector: lower ≤ matrix · q ≤ upper; None where there are none."""
    if not model.coupled:
        return None
    rows = [np.zeros((len(c.matrix), len(model.joint_names))) for c in model.coupled]
    for row, coupled in zip(rows, model.coupled, strict=True):
        row[:, [model.joint_index(name) for name in coupled.joints]] = coupled.matrix
    return (
        np.concatenate(rows),
        np.concatenate([c.lower for c in model.coupled]),
        np.concatenate([c.upper for c in model.coupled]),
    )


def joint_paths(model: RobotModel, base_columns: int) -> dict[int, list[int]]:
    """pinocchio joint → the columns that turn its frame: the base's and those of the joints from the base to it, itself included."""
    pin_model = model.pin_model
    first = base_columns + len(model.joint_names) - pin_model.nv
    paths = {0: list(range(base_columns))}
    for joint in range(1, pin_model.njoints):
        own = [first + pin_model.joints[joint].idx_v] if pin_model.joints[joint].nv == 1 else []
        paths[joint] = paths[int(pin_model.parents[joint])] + own
    return paths
