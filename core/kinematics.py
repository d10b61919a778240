"""Forward kinematics of a whole clip at once, in NumPy: (T, …) arrays instead of T calls into pinocchio."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from retarget.core import rotations
from retarget.core.robot_model import RobotModel
from retarget.core.types import Array, JointTrajectory, Targets

CHUNK = 512
"""Frames computed together: a joint's numbers stay in the processor's nearest cache."""


def link_poses(
    model: RobotModel,
    links: Sequence[str],
    joints: Array,
    base_orientation: Array | None = None,
    base_position: Array | None = None,
) -> tuple[Array, Array]:
    """World rotation (T, L, 3, 3) and origin (T, L, 3) m of `links`.

    joints: (T, n) rad. base_orientation: (T, 4) wxyz, upright when None. base_position: (T, 3) m, the origin when None.
    """
    frames, floating = len(joints), model.base_is_floating
    rotation, origin = np.empty((frames, len(links), 3, 3)), np.empty((frames, len(links), 3))
    tree = axis_frames(model)
    base = rotations.to_matrix(model.base_rotation[None] if base_orientation is None else base_orientation)
    position = np.zeros((1, 3)) if base_position is None else base_position
    placements = []
    for link in links:
        joint, turn, offset = model.link_in_joint(link)
        back = tree[joint].axes.T if joint in tree else np.eye(3)
        placements.append((joint, back @ turn, back @ offset))
    for start in range(0, frames, CHUNK):
        part = slice(start, min(start + CHUNK, frames))
        # Time runs along the last axis: a product with a constant is one matrix product for all frames.
        turn_of_base = base[part if len(base) > 1 else slice(None)] if floating else np.eye(3)[None]
        shift_of_base = position[part if len(position) > 1 else slice(None)] if floating else np.zeros((1, 3))
        world = _axis_frame_poses(tree, joints[part].T, turn_of_base.transpose(1, 2, 0), shift_of_base.T)
        for i, (joint, turn, offset) in enumerate(placements):
            rotation[part, i] = np.matmul(turn.T, world[joint][0]).transpose(2, 0, 1)
            origin[part, i] = (world[joint][1] + np.matmul(offset, world[joint][0])).T
    return rotation, origin


@dataclass(frozen=True, eq=False)
class Poses:
    """World rotation (T, 3, 3) and origin (T, 3) m of each of `links`, all from one pass over the tree."""

    links: tuple[str, ...]
    rotation: Array
    origin: Array

    @classmethod
    def of(
        cls,
        model: RobotModel,
        links: Iterable[str],
        joints: Array,
        base_orientation: Array | None = None,
        base_position: Array | None = None,
    ) -> Poses:
        """Poses of `links` (repeats are fine); the other arguments are those of `link_poses`."""
        names = tuple(dict.fromkeys(links))
        return cls(names, *link_poses(model, names, joints, base_orientation, base_position))

    @classmethod
    def along(
        cls, trajectory: JointTrajectory, model: RobotModel, links: Iterable[str], frames: slice = slice(None)
    ) -> Poses:
        """Poses of `links` in `frames` of a trajectory whose joints stand in the model's order."""
        orientation, position = trajectory.base_orientation, trajectory.base_position
        return cls.of(
            model,
            links,
            trajectory.position[frames],
            None if orientation is None else orientation[frames],
            None if position is None else position[frames],
        )

    def rotations_of(self, links: Sequence[str]) -> Array:
        """(T, L, 3, 3), in the order of `links`."""
        return self.rotation[:, [self.links.index(link) for link in links]]

    def part(self, frames: slice) -> Poses:
        """Those of `frames` alone."""
        return Poses(self.links, self.rotation[frames], self.origin[frames])

    def at(self, link: str) -> tuple[Array, Array]:
        """Rotation (T, 3, 3) and origin (T, 3) m of one link."""
        i = self.links.index(link)
        return self.rotation[:, i], self.origin[:, i]


def position_errors(model: RobotModel, targets: Targets, joints: Array) -> dict[str, Array]:
    """Segment (or frame, for tasks of none) → distance (T,) m between the point of its position task and where it should be at joints (T, n).

    Position tasks are in the world of a robot that stands upright at the origin, so that is where its base is put.
    """
    tasks = [task for task in targets.tasks if task.kind == "position"]
    if not tasks:
        return {}
    poses = Poses.of(model, [task.frame for task in tasks], joints)
    errors = {}
    for task in tasks:
        rotation, origin = poses.at(task.frame)
        away = rotation @ task.offset + origin - task.value
        errors[task.segment or task.frame] = np.asarray(np.linalg.norm(away, axis=1))
    return errors


@dataclass(frozen=True, eq=False)
class AxisFrame:
    """A joint's frame turned so that its z is the joint's axis: every joint then turns about, or slides along, z.

    axes (3, 3): joint's own frame ← axis frame. rotation (3, 3) and translation (3,) m: of the axis frame, the joint at zero, in that of
    the joint before (`parent`). column: the joint's value among all. sliding: along z instead of about it.
    """

    parent: int
    column: int
    axes: Array
    rotation: Array
    translation: Array
    sliding: bool


def axis_frames(model: RobotModel) -> dict[int, AxisFrame]:
    """pinocchio joint → axis frame of every joint with one degree of freedom, from the base outward."""
    import pinocchio as pin

    pin_model, first = model.pin_model, model.pin_model.nv - len(model.joint_names)
    data = pin_model.createData()
    pin.computeJointJacobians(pin_model, data, pin.neutral(pin_model))
    jacobian = np.reshape(data.J, (6, -1))  # of a single joint pinocchio gives (6,)
    frames: dict[int, AxisFrame] = {}
    for i in range(1, pin_model.njoints):
        if pin_model.joints[i].nv != 1:
            continue
        slide, turn = np.split(jacobian[:, pin_model.joints[i].idx_v], 2)
        sliding = bool(np.linalg.norm(turn) < 0.5)
        axes = _with_z(np.array(data.oMi[i].rotation).T @ (slide if sliding else turn))
        parent, placement = int(pin_model.parents[i]), pin_model.jointPlacements[i]
        back = frames[parent].axes.T if parent in frames else np.eye(3)
        frames[i] = AxisFrame(
            parent=parent,
            column=pin_model.joints[i].idx_v - first,
            axes=axes,
            rotation=back @ np.array(placement.rotation) @ axes,
            translation=back @ np.array(placement.translation),
            sliding=sliding,
        )
    return frames


def _with_z(axis: Array) -> Array:
    """A rotation (3, 3) whose third column is `axis` (3,) made unit."""
    z = axis / np.linalg.norm(axis)
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def _axis_frame_poses(
    tree: dict[int, AxisFrame], joints: Array, base: Array, shift: Array
) -> dict[int, tuple[Array, Array]]:
    """pinocchio joint → world rotation (3, 3, T) and origin (3, T) of its axis frame; 0 and 1 also the base's. joints: (n, T)."""
    count = joints.shape[1]
    still = (np.broadcast_to(base, (3, 3, count)), np.broadcast_to(shift, (3, count)))
    world = {0: still, 1: still}
    cosine, sine = np.cos(joints), np.sin(joints)
    for i, frame in tree.items():
        before, origin = world[frame.parent]
        turned = np.matmul(frame.rotation.T, before)  # (3, 3, T): the frame's axes at zero
        at = origin + np.matmul(frame.translation, before)
        if frame.sliding:
            at += joints[frame.column] * turned[:, 2]
        else:
            x, y, c, s = turned[:, 0].copy(), turned[:, 1], cosine[frame.column], sine[frame.column]
            turned[:, 0] = c * x + s * y
            turned[:, 1] = c * y - s * x
        world[i] = turned, at
    return world
