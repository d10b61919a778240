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


@dataclass(frozen=True)
class OrientationProblem:
    """Orientation tasks over T frames for L links of a robot with n joints; columns are the moving base's 3 rotations, then the joints.

    desired: (T, L, 3, 3) world ← carrying joint's frame (link placements are folded in). feed_forward: (T, L, 3) rad/s, world.
    weight: (T, L). bone: (L, 3) unit, in the joint's frame; twist_loss: (L,) = 1 - twist weight, 0 where all axes count alike.
    joint_ids: (L,) pinocchio joints. moves: (L, columns) 1 where a column's motion turns the link.
    lower, upper, velocity: (n,) limits. coupled: (matrix (m, n), lower (m,), upper (m,)) or None. reference: (n,) posture.
    """

    model: RobotModel
    time: Array
    desired: Array
    feed_forward: Array
    weight: Array
    bone: Array
    twist_loss: Array
    joint_ids: NDArray[np.intp]
    moves: Array
    base_columns: int
    lower: Array
    upper: Array
    velocity: Array
    reference: Array
    coupled: tuple[Array, Array, Array] | None

    @property
    def columns(self) -> int:
        """Number of unknowns of one step."""
        return self.base_columns + len(self.lower)


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
    ids, desired, bones = [], [], []
    for task in targets.tasks:
        joint, placement, _ = model.link_in_joint(task.frame)
        ids.append(joint)
        desired.append(rotations.to_matrix(task.value) @ placement.T)
        bones.append(placement @ task.axis)
    stacked = np.ascontiguousarray(np.stack(desired, axis=1))
    base_columns = 3 if free_base else 0
    zero = np.zeros((len(targets.time), 3))
    return OrientationProblem(
        model=model,
        time=targets.time,
        desired=stacked,
        feed_forward=np.stack([zero if t.feed_forward is None else t.feed_forward for t in targets.tasks], axis=1),
        weight=np.stack([task.weight for task in targets.tasks], axis=1),
        bone=np.array(bones),
        twist_loss=np.array([1.0 - task.twist_weight for task in targets.tasks]),
        joint_ids=np.array(ids),
        moves=_moves(model, ids, base_columns),
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


def _moves(model: RobotModel, joint_ids: list[int], base_columns: int) -> Array:
    pin_model = model.pin_model
    first = pin_model.nv - len(model.joint_names)
    moves = np.zeros((len(joint_ids), base_columns + len(model.joint_names)))
    moves[:, :base_columns] = 1.0
    for row, joint in enumerate(joint_ids):
        while joint > 0 and pin_model.joints[joint].nv == 1:
            moves[row, base_columns + pin_model.joints[joint].idx_v - first] = float(pin_model.joints[joint].nq == 1)
            joint = int(pin_model.parents[joint])
    return moves
