"""The robot as a MuJoCo model, built from its URDF and asserted to be pinocchio's: same mass, same joints, same order."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import mujoco
import numpy as np
from numpy.typing import NDArray
from retarget.core.errors import FormatError, ProfileError
from retarget.core.kinematics import link_poses
from retarget.core.replay import model_cache
from retarget.core.replay.contacts import near_pairs, touching_pairs
from retarget.core.replay.inertia import LinkInertia, link_inertias
from retarget.core.replay.meshes import Mesh, read_mesh
from retarget.core.replay.shapes import Shape, shapes_of
from retarget.core.replay.spec import body_names, make_spec, stated_armature
from retarget.core.robot_model import RobotModel
from retarget.core.types import Array

LARGEST_EFFORT = 2000.0
"""Nm, or N of sliding joints. No humanoid's joint is stronger, so a higher figure in a URDF is a placeholder, as 0 is."""
SMALLEST_ARMATURE, ARMATURE_SHARE = 0.005, 0.05
"""kg m², and share of the inertia that the joint moves: stands in for the rotor, which URDF has no word for and MJCF may leave out."""
MASS_TOLERANCE = 1e-6
LEFT_OUT = "left_out"
"""Text in the compiled model: a warning that only those get to see who read the meshes, and not from the cache."""

Base = Literal["fixed", "floating"]


@dataclass(frozen=True, eq=False)
class ReplayModel:
    """A robot in MuJoCo. n joints in the order of `robot.joint_names`; rad and Nm (m and N for sliding joints).

    mj: `mujoco.MjModel`. qpos, qvel, actuators: (n,) addresses of each joint's position, velocity and motor. base_qpos, base_qvel: first of the
    base's 7 and 6 (position and quaternion wxyz; linear velocity in the world, angular in the body), None where it stands still.
    torque_limit_nm: (n,), inf where unknown. armature: (n,) kg m², part of MuJoCo's own mass
    matrix. friction_nm, damping_nms_rad: (n,), the URDF's, placeholders left out.
    self_collision: whether the robot's shapes meet each other. excluded: pairs of bodies whose shapes are not judged against each other;
    touching: those of them that are no neighbours, but overlap in the reference posture. body_of_link: link → id of the body that carries it.
    repaired: links whose inertia no rigid body can have. warnings: what had to be left out, for the user.
    """

    mj: Any
    robot: RobotModel
    qpos: NDArray[np.int64]
    qvel: NDArray[np.int64]
    base_qpos: int | None
    base_qvel: int | None
    actuators: NDArray[np.int64]
    torque_limit_nm: Array
    armature: Array
    friction_nm: Array
    damping_nms_rad: Array
    self_collision: bool
    excluded: tuple[tuple[str, str], ...]
    touching: tuple[tuple[str, str], ...]
    body_of_link: Mapping[str, int]
    repaired: tuple[str, ...]
    warnings: tuple[str, ...]

    def configuration(
        self, joints: Array, base_orientation: Array | None = None, base_position: Array | None = None
    ) -> Array:
        """MuJoCo's qpos (nq,) of joints (n,); base pose as wxyz (4,) and m (3,), where the model has it when None. A fixed base ignores both."""
        qpos = np.array(self.mj.qpos0)
        qpos[self.qpos] = joints
        if self.base_qpos is not None:
            if base_position is not None:
                qpos[self.base_qpos : self.base_qpos + 3] = base_position
            if base_orientation is not None:
                qpos[self.base_qpos + 3 : self.base_qpos + 7] = base_orientation
        return qpos


def build(
    model: RobotModel,
    *,
    base: Base,
    floor: bool = False,
    self_collision: bool = False,
    visuals: bool = False,
    cache: Path | None = None,
) -> ReplayModel:
    """The MuJoCo model of `model`.

    base: "fixed" welds the base link to the world, upright. floor: a plane at z = 0; the base then starts so high that the soles stand on it in the
    reference posture, else at the origin. self_collision: whether the robot's own shapes meet each other (`excluded` ones never do); without it they
    only meet the floor. visuals: adds what is only seen, in geom group 2. cache: folder of compiled models, `model_cache.default_folder()` when None.

    Raises `ProfileError` for meshes that can't be read and for models that MuJoCo refuses. Meshes that are missing are left out and counted in
    `warnings`.
    """
    shapes, lost = shapes_of(model, visuals=visuals)
    warnings = [*model.warnings, *lost]
    contents = _contents(model, shapes)
    inertias, limit = link_inertias(model), torque_limits(model)
    armature = _armature(model, inertias)
    height = _standing_height(model) if floor else 0.0
    folder = model_cache.default_folder() if cache is None else cache
    numbers = [model.reference_posture, model.base_rotation, armature, limit, np.array([height])]
    settings = f"{base} {floor} {self_collision} {visuals}"
    places = [f"{shape.link} {shape.mesh.suffix}" for shape in shapes if shape.mesh is not None]
    key = model_cache.key_of([model.urdf, settings, *places, *(n.tobytes() for n in numbers), *contents.values()])
    mj = model_cache.load(folder, key)
    if mj is None:
        kept, meshes = _read_meshes(model, shapes, contents)
        spec = make_spec(
            model, kept, meshes, inertias, base=base, base_height_m=height, floor=floor, armature=armature, torque_limit=limit
        )  # fmt: skip
        if flat := [shape.link for shape in shapes if shape not in kept]:
            more = ", …" if len(flat) > 1 else ""
            spec.add_text(
                name=LEFT_OUT, data=f"{len(flat)} × flat mesh, which has no solid (collision): {flat[0]}{more}"
            )
        mj = _compiled(model, spec, self_collision=self_collision)
        model_cache.store(folder, key, mj)
    if mj.ntext:
        warnings.append(bytes(mj.text_data).rstrip(b"\0").decode())
    return _checked(model, mj, base, inertias, warnings)


def torque_limits(model: RobotModel) -> Array:
    """(n,) Nm: the profile's, else the URDF's effort where it is plausible (above 0, at most 2000), else inf."""
    effort = np.array(model.pin_model.effortLimit[-len(model.joint_names) :], float)
    plausible = np.where((effort > 0) & (effort <= LARGEST_EFFORT), effort, math.inf)
    given = model.profile.torque.torque_limit
    return np.array([given.get(name, float(plausible[k])) for k, name in enumerate(model.joint_names)])


def moved_inertia(model: RobotModel) -> Array:
    """(n,) kg m² (kg for sliding joints): diagonal of pinocchio's mass matrix in the reference posture, without `armature`."""
    import pinocchio as pin

    data = model.pin_model.createData()
    matrix = pin.crba(model.pin_model, data, model.configuration(model.reference_posture))
    n = model.pin_model.nv  # of a single joint pinocchio gives (1,)
    return np.array(np.diag(np.reshape(matrix, (n, n)))[-len(model.joint_names) :])


def _armature(model: RobotModel, inertias: Mapping[int, LinkInertia]) -> Array:
    """(n,) kg m²: the rotor that the description states or holds, else 5 % of the inertia that the joint moves, at least 0.005."""
    first = 1 + int(model.base_is_floating)
    held = np.array([inertias[first + k].rotor for k in range(len(model.joint_names))])
    stated = stated_armature(model)
    rotor = np.where(stated > 0, stated, held)
    return np.where(rotor > 0, rotor, np.maximum(SMALLEST_ARMATURE, ARMATURE_SHARE * moved_inertia(model)))


def _standing_height(model: RobotModel) -> float:
    """Height of the base, m, at which the lowest corner of the soles is on the ground in the reference posture; 0 without feet."""
    feet = list(model.profile.feet.values())
    if not feet:
        return 0.0
    rotation, origin = link_poses(model, [foot.link for foot in feet], model.reference_posture[None])
    return -min(float((foot.sole @ rotation[0, i].T + origin[0, i])[:, 2].min()) for i, foot in enumerate(feet))


def _contents(model: RobotModel, shapes: Sequence[Shape]) -> dict[Path, bytes]:
    contents = {}
    for path in {shape.mesh: None for shape in shapes if shape.mesh is not None}:
        try:
            contents[path] = path.read_bytes()
        except OSError as error:
            raise ProfileError(
                model.profile.origin or model.profile.name,
                f"mesh {path} can't be read: {error.strerror}",
                place="[model]",
            ) from None
    return contents


def _read_meshes(
    model: RobotModel, shapes: Sequence[Shape], contents: Mapping[Path, bytes]
) -> tuple[list[Shape], dict[Path, Mesh]]:
    """Shapes that can be simulated, and all meshes. A sheet has no convex hull: it can be seen, but not collide."""
    try:
        meshes = {path: read_mesh(path, content) for path, content in contents.items()}
    except FormatError as error:
        raise ProfileError(model.profile.origin or model.profile.name, str(error), place="[model]") from None
    flat = {path for path, mesh in meshes.items() if mesh.is_flat}
    return [shape for shape in shapes if not (shape.solid and shape.mesh in flat)], meshes


def _compiled(model: RobotModel, spec: Any, *, self_collision: bool) -> Any:
    """Compiled twice: which shapes touch in the reference posture is seen in the first."""
    try:
        mj = spec.compile()
        qpos = np.array(mj.qpos0)
        qpos[[mj.joint(name).qposadr[0] for name in model.joint_names]] = model.reference_posture
        for pair in sorted(near_pairs(mj) | touching_pairs(mj, qpos)):
            first, second = (mj.body(body).name for body in pair)
            spec.add_exclude(bodyname1=first, bodyname2=second)
        if not self_collision:
            # 0 & 1 = 0 between two shapes of the robot, 1 & 1 between a shape and the floor
            for geom in spec.geoms:
                geom.contype = int(geom.name == "floor")
        return spec.compile()
    except (ValueError, RuntimeError, mujoco.FatalError) as error:
        raise ProfileError(
            model.profile.origin or model.profile.name, f"MuJoCo can't build the model: {error}", place="[model]"
        ) from None


def _checked(
    model: RobotModel, mj: Any, base: Base, inertias: Mapping[int, LinkInertia], warnings: Sequence[str]
) -> ReplayModel:
    """Raises `ProfileError` when MuJoCo's model has another mass, or other joints, than pinocchio's."""
    names = model.joint_names
    moving = [mj.joint(i).name for i in range(mj.njnt) if mj.jnt_type[i] != mujoco.mjtJoint.mjJNT_FREE]
    mass, degrees = float(mj.body_mass.sum()), len(names) + (6 if base == "floating" else 0)
    problem = ""
    if sorted(moving) != sorted(names):
        problem = f"the joints {', '.join(sorted(set(names) ^ set(moving)))} differ"
    elif mj.nv != degrees or mj.nu != len(names):
        problem = f"{mj.nv} degrees of freedom and {mj.nu} motors, not {degrees} and {len(names)}"
    elif abs(mass - model.mass_kg) > MASS_TOLERANCE * max(1.0, model.mass_kg):
        problem = f"a mass of {mass:.6f} kg, not {model.mass_kg:.6f} kg"
    if problem:
        raise ProfileError(
            model.profile.origin or model.profile.name, f"MuJoCo's model has {problem}", place="[model]",
            expected="what pinocchio's has",
        )  # fmt: skip
    qvel = np.array([mj.joint(name).dofadr[0] for name in names])
    bodies = body_names(model)
    body_of_link = {
        str(frame.name): int(mj.body(bodies[int(frame.parentJoint)]).id)
        for frame in model.pin_model.frames
        if str(frame.type) == "BODY"
    }
    near = near_pairs(mj)
    pairs = [(int(s) >> 16, int(s) & 0xFFFF) for s in mj.exclude_signature]
    repaired = tuple(bodies[i] for i, inertia in inertias.items() if inertia.repaired)
    floating = base == "floating"
    return ReplayModel(
        mj=mj,
        robot=model,
        qpos=np.array([mj.joint(name).qposadr[0] for name in names]),
        qvel=qvel,
        base_qpos=0 if floating else None,
        base_qvel=0 if floating else None,
        actuators=np.array([mj.actuator(name).id for name in names]),
        torque_limit_nm=torque_limits(model),
        armature=np.array(mj.dof_armature[qvel]),
        friction_nm=np.array(mj.dof_frictionloss[qvel]),
        damping_nms_rad=np.array(mj.dof_damping[qvel]),
        self_collision=any(mj.geom_contype[i] and mj.geom_bodyid[i] for i in range(mj.ngeom)),
        excluded=tuple((mj.body(a).name, mj.body(b).name) for a, b in pairs),
        touching=tuple((mj.body(a).name, mj.body(b).name) for a, b in pairs if (min(a, b), max(a, b)) not in near),
        body_of_link=body_of_link,
        repaired=repaired,
        warnings=tuple(warnings),
    )
