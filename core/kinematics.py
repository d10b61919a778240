"""Forward kinematics of a whole clip at once, in NumPy: (T, …) arrays instead of T calls into pinocchio."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from retarget.core import rotations
from retarget.core.robot_model import RobotModel
from retarget.core.types import Array

CHUNK = 4096
"""Frames computed together: the working set stays in the processor's cache."""


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
    frames = len(joints)
    rotation, origin = np.empty((frames, len(links), 3, 3)), np.empty((frames, len(links), 3))
    chain = _Chain(model)
    for start in range(0, frames, CHUNK):
        part = slice(start, min(start + CHUNK, frames))
        turn = model.base_rotation[None] if base_orientation is None else base_orientation[part]
        shift = np.zeros((1, 3)) if base_position is None else base_position[part]
        rotation[part], origin[part] = chain.poses(links, joints[part], rotations.to_matrix(turn), shift)
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

    def rotations_of(self, links: Sequence[str]) -> Array:
        """(T, L, 3, 3), in the order of `links`."""
        return self.rotation[:, [self.links.index(link) for link in links]]

    def at(self, link: str) -> tuple[Array, Array]:
        """Rotation (T, 3, 3) and origin (T, 3) m of one link."""
        i = self.links.index(link)
        return self.rotation[:, i], self.origin[:, i]


class _Chain:
    """The model's constants: for every joint, its placement times I, sin and cos parts of its rotation."""

    def __init__(self, model: RobotModel) -> None:
        import pinocchio as pin

        self.model, pin_model = model, model.pin_model
        data = pin_model.createData()
        pin.computeJointJacobians(pin_model, data, pin.neutral(pin_model))
        self.joints = []
        for i in range(1, pin_model.njoints):
            joint = pin_model.joints[i]
            if joint.nv != 1:
                continue
            axis_world = data.J[:, joint.idx_v]
            local = np.array(data.oMi[i].rotation).T
            turn, slide = local @ axis_world[3:], local @ axis_world[:3]
            slides = bool(np.linalg.norm(axis_world[3:]) < 0.5)
            self.joints.append(
                (i, int(pin_model.parents[i]), pin_model.jointPlacements[i], turn, slide if slides else None)
            )

    def poses(self, links: Sequence[str], joints: Array, base: Array, shift: Array) -> tuple[Array, Array]:
        frames = len(joints)
        first = 1 if self.model.base_is_floating else 0
        world = {0: (np.broadcast_to(np.eye(3), (frames, 3, 3)), np.zeros((frames, 3)))}
        if first:
            world[1] = (np.broadcast_to(base, (frames, 3, 3)), np.broadcast_to(shift, (frames, 3)))
        for column, (i, parent, placement, axis, slide) in enumerate(self.joints):
            rotation, origin = world[parent]
            at = origin + rotation @ placement.translation
            fixed = np.array(placement.rotation)
            if slide is not None:
                turned = rotation @ fixed
                world[i] = (turned, at + joints[:, column, None] * (turned @ slide))
                continue
            along = np.outer(axis, axis)
            cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
            angle = joints[:, column, None, None]
            own = fixed @ along + np.cos(angle) * (fixed @ (np.eye(3) - along)) + np.sin(angle) * (fixed @ cross)
            world[i] = (rotation @ own, at)
        out_rotation, out_origin = np.empty((frames, len(links), 3, 3)), np.empty((frames, len(links), 3))
        for k, link in enumerate(links):
            joint, turn, offset = self.model.link_in_joint(link)
            rotation, origin = world[joint]
            out_rotation[:, k] = rotation @ turn
            out_origin[:, k] = origin + rotation @ offset
        return out_rotation, out_origin
