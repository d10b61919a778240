"""Root motion: orientations alone do not move the base. Three ways to place it, once the joints are known.

fixed: as on a stand. human: the pelvis' path scaled by hip height. contact: what is on the ground stays where it is, and the lowest corner
of the soles is at ground height.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from retarget.core import rotations
from retarget.core.contacts import foot_contacts
from retarget.core.kinematics import Poses, link_poses
from retarget.core.robot_model import RobotModel
from retarget.core.segments import LIMB_END
from retarget.core.timebase import smooth
from retarget.core.types import Array, BoolArray, HumanMotion

BaseMode = Literal["fixed", "human", "contact"]
MODES: tuple[BaseMode, ...] = ("fixed", "human", "contact")
HANDOVER_S = 0.06
"""Half-width over which the ground contact is handed from one foot to the other."""


DEEPEST_M, HIGHEST_M = 0.002, 0.004
"""How far rounding off the base's height may press the lowest corner into the floor, or lift it."""


def default_mode(model: RobotModel) -> BaseMode:
    """contact for robots that stand on feet, human for other floating ones, fixed for fixed ones."""
    if not model.base_is_floating:
        return "fixed"
    return "contact" if model.profile.feet else "human"


def foot_links(model: RobotModel) -> list[str]:
    """Links of the profile's feet."""
    return [foot.link for foot in model.profile.feet.values()]


def sole_corners(model: RobotModel, poses: Poses) -> dict[str, Array]:
    """Side → (T, K, 3) m, world, corners of that foot's sole; `poses` must hold `foot_links`."""
    corners = {}
    for side, foot in model.profile.feet.items():
        rotation, origin = poses.at(foot.link)
        corners[side] = origin[:, None] + foot.sole @ rotation.transpose(0, 2, 1)
    return corners


def base_position(
    mode: BaseMode,
    model: RobotModel,
    motion: HumanMotion,
    joints: Array,
    base_orientation: Array,
    scale: float | None = None,
) -> Array:
    """Position (T, 3) m of the base link's origin, world, floor at z = 0, first frame above the world's origin.

    joints: (T, n) rad; base_orientation: (T, 4) wxyz; motion: the T frames that were retargeted. scale: of the person's path, None =
    `leg_scale` of the motion.
    """
    corners = sole_corners(model, Poses.of(model, foot_links(model), joints, base_orientation))
    if mode == "fixed" or not corners:
        standing = np.zeros((motion.frames, 3))
        if mode == "human":
            standing = scaled_pelvis_path(model, motion, scale)
        lowest = min((float(c[0, :, 2].min()) for c in corners.values()), default=0.0)
        standing[:, 2] -= lowest if mode == "fixed" else 0.0
        return standing
    if mode == "human":
        path = scaled_pelvis_path(model, motion, scale)
        lowest = np.min([c[:, :, 2].min(axis=1) for c in corners.values()], axis=0) + path[:, 2]
        # One constant for the whole clip: the path keeps its shape; feet may leave the ground or enter it a little.
        path[:, 2] -= np.percentile(lowest, 25)
        return path
    return _contact_path(model, motion, corners, scale)


def scaled_pelvis_path(model: RobotModel, motion: HumanMotion, scale: float | None = None) -> Array:
    """The person's pelvis path (T, 3) m times robot hip height ÷ human hip height, from above the world's origin on; zero if untracked.

    scale: that ratio, None = `leg_scale` of the motion.
    """
    if not motion.has("Pelvis"):
        return np.zeros((motion.frames, 3))
    path = motion.position[:, motion.index("Pelvis")]
    if np.isnan(path).any():
        return np.zeros((motion.frames, 3))
    scaled: Array = (leg_scale(model, motion) if scale is None else scale) * (path - path[0])
    return scaled


def leg_scale(model: RobotModel, motion: HumanMotion) -> float:
    """Robot hip height ÷ human hip height above the soles, legs straight; 1 where either is unknown.

    Thigh and shank alone are not enough: TOCABI's ankles are 158 mm above its soles, a person's 80. They are compared where the robot has no
    sole or the person's toes were not tracked.
    """
    ratios = []
    for side in ("Left", "Right"):
        human, human_ankle = _human_leg(motion, side)
        robot, robot_ankle = _robot_leg(model, side)
        if human_ankle is not None and robot_ankle is not None:
            human, robot = human + human_ankle, robot + robot_ankle
        if human > 0 and robot > 0:
            ratios.append(robot / human)
    scale = float(np.mean(ratios)) if ratios else 1.0
    return scale if np.isfinite(scale) and scale > 0 else 1.0


def _human_leg(motion: HumanMotion, side: str) -> tuple[float, float | None]:
    """Thigh and shank, m, from the first frame's joints, and how high the ankle is above the ball of the foot's joint, which lies on the sole."""
    leg = 0.0
    for segment in (f"{side}UpperLeg", f"{side}LowerLeg"):
        end = LIMB_END[segment]
        if not (motion.has(segment) and motion.has(end)):
            return 0.0, None
        leg += float(np.linalg.norm(motion.position[0, motion.index(end)] - motion.position[0, motion.index(segment)]))
    toe = f"{side}Toe"
    if not np.isfinite(leg) or not motion.has(toe):
        return (leg if np.isfinite(leg) else 0.0), None
    foot = motion.index(f"{side}Foot")
    to_ball = motion.position[0, motion.index(toe)] - motion.position[0, foot]
    # In the foot's own frame, upright in T-pose: the first frame may be in the middle of a step.
    ankle = -float(rotations.rotate(rotations.conjugate(motion.orientation[0, foot]), to_ball)[2])
    return leg, ankle if np.isfinite(ankle) else None


def _robot_leg(model: RobotModel, side: str) -> tuple[float, float | None]:
    """Thigh and shank, m, and how high the ankle is above the sole when the foot is as in the reference posture, flat."""
    thigh, shank = model.limbs.get(f"{side}UpperLeg"), model.limbs.get(f"{side}LowerLeg")
    if thigh is None or shank is None:
        return 0.0, None
    leg = float(np.linalg.norm(thigh.distal - thigh.proximal) + np.linalg.norm(shank.distal - shank.proximal))
    foot = model.profile.feet.get(side)
    if foot is None:
        return leg, None
    rotation, origin = link_poses(model, [shank.link, foot.link], model.reference_posture[None])
    ankle = origin[0, 0] + rotation[0, 0] @ shank.distal
    sole = origin[0, 1] + foot.sole @ rotation[0, 1].T
    return leg, float(ankle[2] - sole[:, 2].mean())


def _contact_path(model: RobotModel, motion: HumanMotion, corners: dict[str, Array], scale: float | None) -> Array:
    """Integrates the base so that the corners in contact stand still on average; height from the lowest corner, or the human's in flight."""
    sides = list(corners)
    points = np.concatenate([corners[side] for side in sides], axis=1)  # (T, K, 3), relative to the base
    weight = _corner_weights(model, motion, sides)
    flight = weight.sum(axis=1) < 1e-6
    human = scaled_pelvis_path(model, motion, scale)
    shared = weight[1:] * weight[:-1]  # a corner counts for a step only if it is in contact at both its ends
    total = shared.sum(axis=1)
    held = total > 1e-9
    moved = np.einsum("tk,tki->ti", shared, np.diff(points, axis=0)) / np.where(held, total, 1.0)[:, None]
    step = np.where(held[:, None], -moved, np.diff(human, axis=0))
    path = np.zeros((motion.frames, 3))
    path[1:] = np.cumsum(step, axis=0)
    path[:, 2] = _height(motion.time, -points[:, :, 2].min(axis=1), human[:, 2], flight)
    return path


def _height(time: Array, grounded: Array, human: Array, flight: BoolArray) -> Array:
    """Base height (T,) m: on the lowest corner where something is on the ground, the person's rise above it in flight."""
    if not flight.any():
        # The lowest corner changes from foot to foot with a kink in speed: rounded off, within a few millimetres.
        return np.clip(smooth(time, grounded, 2 / 3 * HANDOVER_S), grounded - DEEPEST_M, grounded + HIGHEST_M)
    if flight.all():
        return grounded
    ground = np.flatnonzero(~flight)
    frames = np.arange(len(time))
    offset = np.interp(frames, ground, (grounded - human)[ground])
    # In flight the feet may hang lower than the path says: never below the ground.
    return np.where(flight, np.maximum(human + offset, grounded), grounded)


def _corner_weights(model: RobotModel, motion: HumanMotion, sides: list[str]) -> Array:
    """(T, K) weights 0…1 of all feet's corners: rear ones follow the heel's contact, front ones the toe's; soft at hand-over."""
    contacts = foot_contacts(motion)
    columns = []
    for side in sides:
        sole = model.profile.feet[side].sole
        front = sole @ _forward_in_foot(model, side)
        is_front = front > front.mean()
        for corner in range(len(sole)):
            if contacts is None:
                columns.append(np.ones(motion.frames))
                continue
            heel, toe = (contacts[:, 2 * ("Left", "Right").index(side) + i] for i in (0, 1))
            columns.append((toe if is_front[corner] else heel).astype(float))
    weight = np.stack(columns, axis=1)
    return weight if contacts is None else weight * smooth(motion.time, weight, HANDOVER_S).clip(0.0, 1.0)


def _forward_in_foot(model: RobotModel, side: str) -> Array:
    rotation, _ = link_poses(model, [model.profile.feet[side].link], model.reference_posture[None])
    return np.asarray(rotation[0, 0].T @ np.array([1.0, 0.0, 0.0]))
