"""Where the robot's shoulders are while its chest follows the person's: the waist's joint values for a chest orientation.

The chest has a higher priority than the hands [Lim2022 table II], so what the waist does is settled before any hand: the joints
between base and chest link, turned so that the link is oriented as wanted, or as nearly as their number and limits allow. A
target for a hand that is counted from the shoulder [Lim2022 sec. II-C] then starts where the robot's shoulder will really be.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from retarget.core import rotations
from retarget.core.kinematics import axis_frames, link_poses
from retarget.core.mapping.arm_frames import ArmFrame
from retarget.core.robot_model import RobotModel
from retarget.core.types import Array

ITERATIONS = 60
STEP_RAD = 0.5
DAMPING = 1e-7
CONVERGED_RAD = 1e-11


def trunk_joints(model: RobotModel, link: str, orientation: Array) -> Array:
    """Joint values (T, n) rad: the reference posture, with the joints between base and `link` set for the link's `orientation`
    (T, 4) wxyz.

    The base stands upright at the origin. Gauss-Newton from the reference posture on the logarithm of the orientation error; a
    joint at a limit that wants to go on stays there. Where orientations can't be reached the error's angle is the least that is
    possible nearby.
    """
    joints = np.tile(model.reference_posture, (len(orientation), 1))
    tree = axis_frames(model)
    chain, turn = [], np.eye(3)
    joint, link_turn, _ = model.link_in_joint(link)
    if joint in tree:
        turn = tree[joint].axes.T @ link_turn
    while joint in tree:
        chain.append(tree[joint])
        joint = tree[joint].parent
    chain.reverse()
    columns = [frame.column for frame in chain if not frame.sliding]
    if not columns:
        return joints
    low, high = model.lower[columns], model.upper[columns]
    base = rotations.to_matrix(model.base_rotation) if model.base_is_floating else np.eye(3)
    values = joints[:, columns]
    for _ in range(ITERATIONS):
        world, axes = np.broadcast_to(base, (len(joints), 3, 3)), []
        for frame in chain:
            world = world @ frame.rotation
            if not frame.sliding:
                axes.append(world[:, :, 2])
                world = world @ _about_z(values[:, len(axes) - 1])
        achieved = rotations.from_matrix(world @ turn)
        error = rotations.log(rotations.multiply(orientation, rotations.conjugate(achieved)))
        step = _step(np.stack(axes, axis=-1), error, values, low, high)
        values = (values + step).clip(low, high)
        if np.abs(step).max() < CONVERGED_RAD:
            break
    joints[:, columns] = values
    return joints


def shoulder_points(model: RobotModel, arms: Mapping[str, ArmFrame], turned: Array) -> dict[str, Array]:
    """Side → (T, 3) m, world: the robot's shoulder centres while its chest is turned by `turned` (T, 4) wxyz against the
    reference posture."""
    joints = np.tile(model.reference_posture, (len(turned), 1))
    if "T8" in model.links:
        link = model.links["T8"]
        upright = link_poses(model, [link], model.reference_posture[None])[0][0, 0]
        joints = trunk_joints(model, link, rotations.multiply(turned, rotations.from_matrix(upright)))
    rotation, origin = link_poses(model, [arm.shoulder_link for arm in arms.values()], joints)
    return {side: origin[:, i] + rotation[:, i] @ arm.shoulder for i, (side, arm) in enumerate(arms.items())}


def _step(jacobian: Array, error: Array, values: Array, low: Array, high: Array) -> Array:
    """Damped least-squares step (T, k), without joints that stand at a limit and want to go on."""
    count = values.shape[1]
    held = np.zeros(values.shape, bool)
    for _ in range(count + 1):
        moving = np.where(held[:, None, :], 0.0, jacobian)
        normal = np.swapaxes(moving, 1, 2) @ moving + DAMPING * np.eye(count)
        step = np.linalg.solve(normal, np.swapaxes(moving, 1, 2) @ error[:, :, None])[:, :, 0]
        stuck = ((values >= high) & (step > 0)) | ((values <= low) & (step < 0))
        if not (stuck & ~held).any():
            break
        held |= stuck
    step = np.where(held, 0.0, step)
    largest = np.abs(step).max(axis=1, keepdims=True)
    return np.asarray(step * np.minimum(1.0, STEP_RAD / np.maximum(largest, STEP_RAD)))


def _about_z(angle: Array) -> Array:
    """Rotation matrices (T, 3, 3) by `angle` (T,) rad about z."""
    turned = np.zeros((len(angle), 3, 3))
    turned[:, 0, 0] = turned[:, 1, 1] = np.cos(angle)
    turned[:, 1, 0] = np.sin(angle)
    turned[:, 0, 1] = -turned[:, 1, 0]
    turned[:, 2, 2] = 1.0
    return turned
