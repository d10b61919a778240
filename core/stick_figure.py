"""Points and bones of person and robot, for pictures."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from retarget.core.kinematics import Poses, link_poses
from retarget.core.robot_model import RobotModel
from retarget.core.segments import PARENT
from retarget.core.solve.base import foot_links, sole_corners
from retarget.core.types import Array, HumanMotion, JointTrajectory

Bones = NDArray[np.intp]


def human_figure(motion: HumanMotion) -> tuple[Array, Bones]:
    """Segment origins (T, S, 3) m, world, and bones (B, 2) as pairs of their columns; untracked segments are left out."""
    names = [n for n in motion.segments if np.isfinite(motion.position[0, motion.index(n)]).all()]
    points = motion.position[:, [motion.index(n) for n in names]]
    bones = []
    for name in names:
        parent = PARENT[name]
        while parent is not None and parent not in names:
            parent = PARENT[parent]
        if parent is not None:
            bones.append((names.index(parent), names.index(name)))
    return points, np.array(bones, np.intp).reshape(-1, 2)


def robot_figure(trajectory: JointTrajectory, model: RobotModel) -> tuple[Array, Bones]:
    """Origins (T, P, 3) m, world, of the base and of every link that a joint carries, soles' corners last, and bones (B, 2)."""
    pin_model = model.pin_model
    links, owner = [model.base_link], {0: 0, 1: 0} if model.base_is_floating else {0: 0}
    bones = []
    for i in range(2 if model.base_is_floating else 1, pin_model.njoints):
        link = next(str(f.name) for f in pin_model.frames if str(f.type) == "BODY" and int(f.parentJoint) == i)
        owner[i] = len(links)
        bones.append((owner[int(pin_model.parents[i])], len(links)))
        links.append(link)
    _, points = link_poses(model, links, trajectory.position, trajectory.base_orientation, trajectory.base_position)
    poses = Poses.of(
        model, foot_links(model), trajectory.position, trajectory.base_orientation, trajectory.base_position
    )
    for side, corners in sole_corners(model, poses).items():
        ankle = owner[model.link_in_joint(model.profile.feet[side].link)[0]]
        first = points.shape[1]
        bones += [(ankle, first + k) for k in range(corners.shape[1])]
        points = np.concatenate([points, corners], axis=1)
    return points, np.array(bones, np.intp).reshape(-1, 2)
