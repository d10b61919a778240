"""RobotModel → MjSpec: one body for each joint of the pinocchio model, with that model's own placements and inertias.

MuJoCo's URDF reader is not used. It welds the root link into the world and loses its mass, and repairs inertias link by link before fixed
links are merged; here bodies, masses and the order of joints are pinocchio's by construction.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import mujoco
import numpy as np
from retarget.core import rotations
from retarget.core.errors import ProfileError
from retarget.core.kinematics import axis_frames
from retarget.core.replay.inertia import LinkInertia
from retarget.core.replay.meshes import Mesh
from retarget.core.replay.shapes import Shape
from retarget.core.robot_model import RobotModel
from retarget.core.types import Array

TIMESTEP_S = 0.0005
FLOOR, WORLD = "floor", "world"
SOLID_GROUP, SEEN_GROUP = 3, 2
"""MuJoCo's custom: viewers show group 2 and hide group 3."""
GREY = (0.7, 0.7, 0.72, 1.0)

KINDS = {
    "box": mujoco.mjtGeom.mjGEOM_BOX,
    "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE,
}


def body_names(robot: RobotModel) -> dict[int, str]:
    """pinocchio joint → the link that it moves; the base's own joint (0 where it is fixed, 1 where it floats) → base link.

    A link that is called as MuJoCo calls the ground gets another name here.
    """
    children = {
        str(joint.get("name")): str(child.get("link"))
        for joint in ET.fromstring(robot.urdf).findall("joint")
        if (child := joint.find("child")) is not None
    }
    base = int(robot.base_is_floating)
    names = {base: robot.base_link}
    for i in range(base + 1, robot.pin_model.njoints):
        names[i] = children[str(robot.pin_model.names[i])]
    free = WORLD
    while free in names.values():
        free += "_"
    return {i: free if name == WORLD else name for i, name in names.items()}


def make_spec(
    robot: RobotModel,
    shapes: Sequence[Shape],
    meshes: Mapping[Path, Mesh],
    inertias: Mapping[int, LinkInertia],
    *,
    base: Literal["fixed", "floating"],
    base_height_m: float,
    floor: bool,
    armature: Array,
    torque_limit: Array,
) -> Any:
    """The model as an `mujoco.MjSpec`. Solid shapes meet each other and the floor; nothing is excluded yet."""
    spec = mujoco.MjSpec()
    spec.modelname = robot.profile.name
    spec.compiler.degree = False
    spec.compiler.autolimits = True
    spec.option.timestep = TIMESTEP_S
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    # 4.0.0's sparse path can give Newton a wrong Hessian (release notes of 4.0.1), and "auto" goes sparse above 60 velocities.
    spec.option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    spec.visual.global_.offwidth, spec.visual.global_.offheight = 1920, 1080
    spec.worldbody.add_light(pos=[0, 0, 4], dir=[0, 0, -1], type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL)
    if floor:
        spec.worldbody.add_geom(
            name=FLOOR, type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 0.05], rgba=[0.9, 0.9, 0.9, 1]
        )
    bodies = _add_bodies(spec, robot, inertias, base, base_height_m)
    _add_joints(spec, robot, bodies, armature, torque_limit)
    _add_shapes(spec, robot, bodies, shapes, meshes)
    return spec


def _add_bodies(
    spec: Any, robot: RobotModel, inertias: Mapping[int, LinkInertia], base: str, height: float
) -> dict[int, Any]:
    """pinocchio joint → body."""
    pin_model, names = robot.pin_model, body_names(robot)
    root = int(robot.base_is_floating)
    bodies = {
        root: spec.worldbody.add_body(
            name=names[root], pos=[0, 0, height], quat=robot.base_rotation, explicitinertial=True
        )
    }
    if base == "floating":
        bodies[root].add_freejoint(name=f"{names[root]}_free")
    for i in range(root + 1, pin_model.njoints):
        placement = pin_model.jointPlacements[i]
        bodies[i] = bodies[int(pin_model.parents[i])].add_body(
            name=names[i],
            pos=np.array(placement.translation),
            quat=rotations.from_matrix(np.array(placement.rotation)),
            explicitinertial=True,
        )
    for i, body in bodies.items():
        body.mass = inertias[i].mass
        body.ipos = np.array(pin_model.inertias[i].lever)
        body.fullinertia = inertias[i].tensor[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    return bodies


def _add_joints(spec: Any, robot: RobotModel, bodies: Mapping[int, Any], armature: Array, torque_limit: Array) -> None:
    dynamics = joint_dynamics(robot, torque_limit)
    frames = axis_frames(robot)
    root = int(robot.base_is_floating)
    for k, name in enumerate(robot.joint_names):
        frame = frames[root + 1 + k]
        damping, friction = dynamics[k]
        bodies[root + 1 + k].add_joint(
            name=name,
            type=mujoco.mjtJoint.mjJNT_SLIDE if frame.sliding else mujoco.mjtJoint.mjJNT_HINGE,
            axis=frame.axes[:, 2],
            range=[robot.lower[k], robot.upper[k]],
            limited=mujoco.mjtLimited.mjLIMITED_TRUE,
            armature=armature[k],
            damping=damping,
            frictionloss=friction,
        )
        actuator = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        actuator.set_to_motor()
        if np.isfinite(torque_limit[k]):
            actuator.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
            actuator.forcerange = [-torque_limit[k], torque_limit[k]]


def joint_dynamics(robot: RobotModel, torque_limit: Array) -> Array:
    """(n, 2) damping Nms/rad and friction Nm of the URDF's <dynamics>, 0 where it has none.

    Damping that alone would eat the motor's torque limit (n,) before the joint is at its speed limit is a placeholder and left out: iCub's
    wrists, of 0.45 Nm, would get no faster than 0.45 rad/s.
    """
    pin_model, n = robot.pin_model, len(robot.joint_names)
    values = np.nan_to_num(np.maximum(np.stack([pin_model.damping[-n:], pin_model.friction[-n:]], axis=1), 0.0))
    top_speed = np.where(np.isfinite(robot.velocity_limit), robot.velocity_limit, 0.0)
    values[values[:, 0] * top_speed > torque_limit, 0] = 0.0
    return np.asarray(values)


def stated_armature(robot: RobotModel) -> Array:
    """(n,) kg m² (kg for sliding joints) of the text's <dynamics armature>, which models from MJCF have; 0 where it says nothing."""
    texts = {
        str(joint.get("name")): dynamics.get("armature", "0")
        for joint in ET.fromstring(robot.urdf).findall("joint")
        if (dynamics := joint.find("dynamics")) is not None
    }
    values = []
    for name in robot.joint_names:
        text = texts.get(name, "0")
        try:
            value = float(text)
        except ValueError:
            value = np.nan
        if not 0 <= value < np.inf:
            raise ProfileError(
                robot.profile.origin or robot.profile.name,
                f"joint '{name}' has armature=\"{text}\"",
                place="[model]",
                expected="a finite number, not negative",
            )
        values.append(value)
    return np.array(values)


def _add_shapes(
    spec: Any, robot: RobotModel, bodies: Mapping[int, Any], shapes: Sequence[Shape], meshes: Mapping[Path, Mesh]
) -> None:
    used: dict[tuple[Path, tuple[float, ...], bool], str] = {}
    for number, shape in enumerate(shapes):
        joint, rotation, origin = robot.link_in_joint(shape.link)
        arguments: dict[str, Any] = {"type": KINDS.get(shape.kind, mujoco.mjtGeom.mjGEOM_MESH)}
        if shape.mesh is not None:
            key = (shape.mesh, shape.scale, shape.solid)
            if key not in used:
                used[key] = f"mesh{len(used)}"
                _add_mesh(spec, used[key], meshes[shape.mesh].scaled(shape.scale), hull=shape.solid)
            arguments["meshname"] = used[key]
        else:
            arguments["size"] = [*shape.size, *[0.0] * (3 - len(shape.size))]
        bodies[joint].add_geom(
            name=f"{shape.link}/{number}",
            pos=rotation @ shape.origin + origin,
            quat=rotations.from_matrix(rotation @ shape.rotation),
            contype=int(shape.solid),
            conaffinity=int(shape.solid),
            group=SOLID_GROUP if shape.solid else SEEN_GROUP,
            rgba=GREY,
            **arguments,
        )


def _add_mesh(spec: Any, name: str, mesh: Mesh, *, hull: bool) -> None:
    """Of a mesh that collides only the convex hull counts: MuJoCo makes it where no triangles are given."""
    # Inertia is asked of a mesh even where its body states its own; a sheet, which can only be seen, has one as a shell.
    kind = mujoco.mjtMeshInertia
    inertia = kind.mjMESH_INERTIA_CONVEX if hull else kind.mjMESH_INERTIA_SHELL
    added = spec.add_mesh(name=name, inertia=inertia, uservert=mesh.vertices.ravel())
    if not hull:
        added.userface = mesh.faces.ravel()
