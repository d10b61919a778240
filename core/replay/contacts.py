"""Which pairs of bodies can't be judged by their shapes, because these are coarser than the robot: neighbours, and what touches anyway."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

NEIGHBOUR_DISTANCE = 2
"""Joints between two bodies up to which their shapes may overlap: convex hulls reach over the joint between them."""


def near_pairs(mj: Any) -> set[tuple[int, int]]:
    """Pairs of bodies (lower id first) that are at most two joints apart; the world counts as one where the base stands still.

    A link without a shape that only leads to the next one, as in shoulders and hips whose axes meet, adds nothing to the distance.
    """
    neighbours = _chain_of_shapes(mj)
    pairs = set()
    for start in neighbours:
        reached = {start}
        for _ in range(NEIGHBOUR_DISTANCE):
            reached |= {other for body in reached for other in neighbours[body]}
        pairs |= {(min(start, other), max(start, other)) for other in reached - {start}}
    return pairs


def _chain_of_shapes(mj: Any) -> dict[int, set[int]]:
    """Body → the bodies next to it, with those left out that have no shape and one child."""
    children = {body: [c for c in range(1, mj.nbody) if mj.body_parentid[c] == body] for body in range(mj.nbody)}
    solid = {int(body) for body, kind in zip(mj.geom_bodyid, mj.geom_conaffinity, strict=True) if kind}
    skipped = {body for body in range(1, mj.nbody) if body not in solid and len(children[body]) == 1}
    neighbours: dict[int, set[int]] = {body: set() for body in range(mj.nbody) if body not in skipped}
    for body in neighbours:
        parent = int(mj.body_parentid[body])
        if body == 0 or (parent == 0 and mj.body_dofnum[body] == 6):  # a base that floats is no neighbour of the world
            continue
        while parent in skipped:
            parent = int(mj.body_parentid[parent])
        if parent in neighbours and _joined_to(mj, parent):
            neighbours[body].add(parent)
            neighbours[parent].add(body)
    return neighbours


def _joined_to(mj: Any, body: int) -> bool:
    return body != 0 or bool(mj.body_weldid[1] == 0)


def touching_pairs(mj: Any, qpos: Any) -> set[tuple[int, int]]:
    """Pairs of bodies of the robot (lower id first) whose shapes overlap in posture qpos (nq,)."""
    data = mujoco.MjData(mj)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(mj, data)
    mujoco.mj_comPos(mj, data)
    mujoco.mj_collision(mj, data)
    bodies = np.sort(mj.geom_bodyid[data.contact.geom[: data.ncon]], axis=1)
    return {(int(a), int(b)) for a, b in bodies if a != 0}
