"""Bone directions exactly as the person's, limb twist from the plane of the limb, pronation handed to the wrist. The default mapping.

[Darvish2019 eq. 2] orients every link fully, with constants measured in hand-made T-poses. Nearly all robots have a hinge for an elbow and
people do not quite: the misfit is shared between upper arm and forearm, and both point elsewhere. The arm plane of
[Lim2022 eq. 13] is the cure, here for arms and legs: constants from the robot's geometry (`link_rotations.from_geometry`), bone directions
that weigh fully, a twist that weighs less and is smooth over the clip (`limb_twist`).
"""

from __future__ import annotations

import numpy as np
from retarget.core import rotations
from retarget.core.mapping import Mapping
from retarget.core.mapping.limb_twist import frame_from_bone, hinge_directions
from retarget.core.mapping.link_rotations import from_geometry
from retarget.core.profile import MappingParameters
from retarget.core.robot_model import RobotModel
from retarget.core.segments import LIMB_END
from retarget.core.types import Array, HumanMotion, Targets, Task

WEIGHTS = {
    "Pelvis": 1.0,
    "T8": 1.0,
    "Head": 0.3,
    "Hand": 0.03,
    "Foot": 0.1,
    "UpperArm": 1.0,
    "ForeArm": 1.0,
    "UpperLeg": 1.0,
    "LowerLeg": 1.0,
}
"""Weights of orientation tasks by segment, sides alike. Hands and feet have few joints of their own: they must not bend limbs."""
OTHER_WEIGHT = 0.3
TWIST_WEIGHTS = {"T8": 0.25, "UpperArm": 0.05, "ForeArm": 0.0, "UpperLeg": 0.1, "LowerLeg": 0.0}
"""How much a rotation about the segment's own long axis counts beside one across it. A robot whose arm can't reach across its chest may turn
the chest, but it should not lean."""
LONG_AXES = {"T8": (0.0, 0.0, 1.0)}
"""Long axes, in T-pose axes, of segments that are no limbs."""
LIMBS = {"UpperArm": "ForeArm", "UpperLeg": "LowerLeg"}


def targets(motion: HumanMotion, model: RobotModel) -> Targets:
    """One orientation task per measured and mapped segment.

    Limb segments whose robot side is known by geometry aim at the person's bone direction (weight 1) with the limb plane's twist
    (lower weight); every other segment, limbs of which only one bone is measured, and limbs without a hinge on the robot (the 66-joint
    person) at the segment's own orientation.
    """
    constants = from_geometry(model)
    parameters = model.profile.mappings.get("limb_plane", MappingParameters())
    orientation = {s: motion.orientation[:, motion.index(s)] for s in model.links if motion.has(s)}
    for upper, lower in ((f"{side}{u}", f"{side}{w}") for side in ("Left", "Right") for u, w in LIMBS.items()):
        if upper in orientation and lower in orientation and _has_hinge(model, upper):
            orientation[upper], orientation[lower] = limb_orientations(motion, upper, lower)
    tasks = []
    for segment, value in orientation.items():
        part = segment.removeprefix("Left").removeprefix("Right")
        axis = _long_axis(model, segment, constants[segment])
        tasks.append(
            Task(
                frame=model.links[segment],
                kind="orientation",
                value=rotations.multiply(value, rotations.from_matrix(constants[segment])),
                feed_forward=rotations.angular_velocity(motion.time, value),
                weight=np.array(parameters.weights.get(segment, WEIGHTS.get(part, OTHER_WEIGHT))),
                twist_weight=1.0 if axis is None else parameters.twist_weights.get(segment, TWIST_WEIGHTS[part]),
                axis=np.array([1.0, 0.0, 0.0]) if axis is None else axis,
                segment=segment,
            )
        )
    return Targets(motion.time, tuple(tasks), "limb_plane")


def _has_hinge(model: RobotModel, segment: str) -> bool:
    return segment in model.limbs and model.limbs[segment].rotation is not None


def _long_axis(model: RobotModel, segment: str, segment_link: Array) -> Array | None:
    """The direction (3,) in the link's frame about which a rotation counts less, or None where all axes count alike."""
    if _has_hinge(model, segment):
        return model.limbs[segment].bone
    # A robot with a joint for every human one has nothing to give up.
    spread = any(limb.rotation is not None for limb in model.limbs.values())
    if segment in LONG_AXES and spread:
        return np.asarray(segment_link.T @ np.array(LONG_AXES[segment]))
    return None


def limb_orientations(motion: HumanMotion, upper: str, lower: str) -> tuple[Array, Array]:
    """Orientations (T, 4) wxyz, world ← segment, of both bones of a limb whose relative rotation is a pure hinge rotation."""
    left, arm = upper.startswith("Left"), upper.endswith("Arm")
    q_upper = motion.orientation[:, motion.index(upper)]
    d_upper, d_lower = bone_direction(motion, upper), bone_direction(motion, lower)
    own_hinge = rotations.rotate(q_upper, [0.0, 0.0, 1.0] if arm else [0.0, 1.0, 0.0])
    flexion = -1.0 if arm and left else 1.0
    hinge = hinge_directions(motion.time, d_upper, d_lower, own_hinge, flexion)
    return (
        frame_from_bone(d_upper, hinge, left=left, arm=arm),
        frame_from_bone(d_lower, hinge, left=left, arm=arm),
    )


def bone_direction(motion: HumanMotion, segment: str) -> Array:
    """Unit directions (T, 3), world, of the segment's bone: its joint-centre line where the recording tells it, else its T-pose axis."""
    end = LIMB_END[segment]
    axis = np.array([0.0, 1.0 if segment.startswith("Left") else -1.0, 0.0])
    if segment.endswith("Leg"):
        axis = np.array([0.0, 0.0, -1.0])
    offset = motion.joint_offsets.get(end)
    if offset is not None and np.linalg.norm(offset) > 1e-3:
        axis = offset / np.linalg.norm(offset)
    return rotations.rotate(motion.orientation[:, motion.index(segment)], axis)


MAPPING = Mapping(
    "limb_plane", "bone directions exact, twist from the limb's plane (ours, after [Lim2022 eq. 13])", targets
)
