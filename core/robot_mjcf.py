"""MJCF → URDF text, so that MuJoCo's own robots go the same way as all others.

MuJoCo compiles the file, with its includes, defaults and assets. What it compiled is written down link by link; the robot is the part of the scene
that has joints. A link is a body, in that body's frame. A joint's value is MuJoCo's `qpos`, `ref` included.
"""

from __future__ import annotations

import math
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from retarget.core import rotations
from retarget.core.errors import ProfileError
from retarget.core.mjcf_meshes import name_files, replace_missing
from retarget.core.mjcf_shapes import add_shapes
from retarget.core.profile import RobotProfile
from retarget.core.types import Array
from retarget.core.urdf_text import number, numbers

WORLD = "world"
NAMES_TOLD = 3


def is_mjcf(content: bytes) -> bool:
    """Whether the root element of the XML text `content` is <mujoco>."""
    try:
        _, root = next(iter(ET.iterparse(BytesIO(content), events=("start",))))
    except (ET.ParseError, LookupError, ValueError, StopIteration):
        return False
    return bool(root.tag == "mujoco")


def urdf_of_mjcf(profile: RobotProfile, path: Path) -> tuple[str, tuple[str, ...]]:
    """(URDF text of the robot in the MJCF file `path`, one warning for each kind of thing that URDF has no word for).

    One link for each body; where several joints move a body, or one that is not at its origin, further links without mass, `<body>_<joint>`, stand
    between. A single body in the world, free or without a joint, is the root link, wherever it is placed; else the root is the link `world`.
    Bodies of the world that no hinge or slide moves are no part of the robot. A joint's speed limit, which MJCF has no word for, is 0: unknown;
    so is an effort that neither joint nor motor bounds. Armature stands beside damping and friction, as attribute `armature` of <dynamics>.

    Raises `ProfileError` for what MuJoCo refuses, ball joints, several free robots, and meshes that are missing but needed for a mass.
    """
    import mujoco

    told: list[str] = []
    try:
        with _warnings_into(told):
            spec = mujoco.MjSpec.from_file(str(path.resolve()))
            # Every body is wanted as a link, and every shape, whatever the file spares a simulator.
            spec.compiler.fusestatic = spec.compiler.discardvisual = False
            files = name_files(spec)
            if needed := replace_missing(spec, files):
                raise _error(
                    profile,
                    f"body '{needed[0]}' has its mass from the mesh {needed[1]}, which is missing",
                    "the file, or an <inertial>",
                )
            model = spec.compile()
    except (ValueError, RuntimeError, mujoco.FatalError) as error:
        raise _error(profile, f"MuJoCo refuses {path.name}: {_one_line(str(error))}") from None
    urdf, lost = _Tree(profile, model).urdf(spec, files, path.stem)
    return urdf, (*told, *lost)


@contextmanager
def _warnings_into(told: list[str]) -> Iterator[None]:
    """Warnings of MuJoCo's compiler are collected; by itself it writes them into a file in the current folder."""
    import mujoco

    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda _text: None)
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            yield
        told += [f"MuJoCo: {_one_line(str(warning.message))}" for warning in caught]
    finally:
        mujoco.set_mju_user_warning(before)


class _Tree:
    """The compiled model as links and joints of a URDF."""

    def __init__(self, profile: RobotProfile, model: Any) -> None:
        self.profile, self.model = profile, model
        self.top, self.left_out = self._robots()
        self.bodies = [b for b in range(1, model.nbody) if int(model.body_rootid[b]) in self.top]
        self.joints = {b: self._joints_of(b) for b in self.bodies}
        self.root = self._root()
        given = [str(model.body(b).name) for b in range(1, model.nbody)]
        self.taken = {name for name in given if name}
        self.names = {b: given[b - 1] or self._new_name(f"body{b}") for b in self.bodies}
        if self.root == 0:
            self.names[0] = self._new_name(WORLD)

    def urdf(self, spec: Any, files: dict[str, Path | None], stem: str) -> tuple[str, tuple[str, ...]]:
        """The text, and what it leaves out."""
        robot = ET.Element("robot", {"name": str(spec.modelname) or stem})
        joints: list[ET.Element] = []
        lost: dict[str, list[str]] = {}
        if self.root == 0:
            ET.SubElement(robot, "link", {"name": self.names[0]})
        for body in self.bodies:
            link = ET.SubElement(robot, "link", {"name": self.names[body]})
            _add_inertial(link, self.model, body)
            add_shapes(link, self.model, body, spec, files, lost)
            if body != self.root:
                joints += self._chain(robot, body)
        robot.extend(joints)
        lost |= self._not_held()
        ET.indent(robot, "  ")
        return ET.tostring(robot, encoding="unicode"), tuple(_told(lost))

    def _robots(self) -> tuple[list[int], list[int]]:
        """Bodies of the world that carry a hinge or slide, and those that don't."""
        import mujoco

        model = self.model
        free = int(mujoco.mjtJoint.mjJNT_FREE)
        moved = {int(model.body_rootid[model.jnt_bodyid[j]]) for j in range(model.njnt) if model.jnt_type[j] != free}
        top = [b for b in range(1, model.nbody) if model.body_parentid[b] == 0]
        if not moved:
            raise _error(self.profile, "the model has no joint that moves")
        return [b for b in top if b in moved], [b for b in top if b not in moved]

    def _joints_of(self, body: int) -> list[int]:
        """Hinges and slides of `body`, nearest to the parent first."""
        import mujoco

        kinds, model = mujoco.mjtJoint, self.model
        first = int(model.body_jntadr[body])
        found = range(first, first + int(model.body_jntnum[body]))
        for j in found:
            if model.jnt_type[j] == kinds.mjJNT_BALL:
                name = str(model.joint(j).name) or f"of body '{model.body(body).name}'"
                raise _error(self.profile, f"'{name}' is a ball joint", "hinges, slides, or a free joint at the root")
        return [j for j in found if model.jnt_type[j] != kinds.mjJNT_FREE]

    def _root(self) -> int:
        model, top = self.model, self.top
        free = [b for b in top if model.body_jntnum[b] and not self.joints[b]]
        if len(top) > 1 and free:
            names = ", ".join(f"'{model.body(b).name}'" for b in top)
            raise _error(self.profile, f"the model has {len(top)} robots, {names}", "a single one, or all fixed")
        return top[0] if len(top) == 1 and not self.joints[top[0]] else 0

    def _chain(self, robot: ET.Element, body: int) -> list[ET.Element]:
        """The joints between `body` and its parent. MuJoCo turns the body by one joint after the other, each about its own point of the body."""
        model = self.model
        placement = _placement(model.body_pos[body], model.body_quat[body])
        parent, own = self.names[int(model.body_parentid[body])], self.names[body]
        joints = []
        for k, j in enumerate(self.joints[body]):
            name = str(model.joint(j).name) or self._new_name(f"{own}_joint{k + 1}")
            anchor = np.array(model.jnt_pos[j]) if self._turns(j) else np.zeros(3)
            last = j == self.joints[body][-1] and not anchor.any()
            child = own if last else self._new_name(f"{own}_{name}")
            if not last:
                ET.SubElement(robot, "link", {"name": child})
            placement = placement @ _placement(anchor, (1.0, 0.0, 0.0, 0.0)) @ self._back_to_zero(j)
            joints.append(self._joint(j, name, parent, child, placement))
            placement, parent = _placement(-anchor, (1.0, 0.0, 0.0, 0.0)), child
        if parent != own:
            joints.append(_joint_element(self._new_name(f"{own}_fixed"), "fixed", parent, own, placement))
        return joints

    def _back_to_zero(self, j: int) -> Array:
        """The joint's motion from `ref`, where the file shows it, to 0."""
        axis, ref = np.array(self.model.jnt_axis[j]), float(self.model.qpos0[self.model.jnt_qposadr[j]])
        if self._turns(j):
            return _placement(np.zeros(3), rotations.exp(-ref * axis))
        return _placement(-ref * axis, (1.0, 0.0, 0.0, 0.0))

    def _joint(self, j: int, name: str, parent: str, child: str, placement: Array) -> ET.Element:
        model = self.model
        limited, dof = bool(model.jnt_limited[j]), int(model.jnt_dofadr[j])
        kind = ("revolute" if limited else "continuous") if self._turns(j) else "prismatic"
        element = _joint_element(name, kind, parent, child, placement)
        ET.SubElement(element, "axis", {"xyz": numbers(model.jnt_axis[j])})
        limit = {"effort": number(self._effort(j)), "velocity": "0"}
        if kind != "continuous":
            # A slide without limits stays without: the profile has to state some.
            lower, upper = model.jnt_range[j] if limited else (-math.inf, math.inf)
            limit = {"lower": number(lower), "upper": number(upper), **limit}
        ET.SubElement(element, "limit", limit)
        dynamics = {
            "damping": float(model.dof_damping[dof]),
            "friction": float(model.dof_frictionloss[dof]),
            "armature": float(model.dof_armature[dof]),
        }
        if any(dynamics.values()):
            ET.SubElement(element, "dynamics", {key: number(value) for key, value in dynamics.items()})
        return element

    def _effort(self, j: int) -> float:
        """Nm (N): the smaller of what the joint lets through and what all its motors give together; 0 where neither is bounded."""
        import mujoco

        model, bounds, motors = self.model, [], []
        if model.jnt_actfrclimited[j]:
            bounds.append(float(np.abs(model.jnt_actfrcrange[j]).max()))
        at_joint = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
        for a in range(model.nu):
            if int(model.actuator_trntype[a]) not in at_joint or model.actuator_trnid[a, 0] != j:
                continue
            force = math.inf
            if model.actuator_forcelimited[a]:
                force = float(np.abs(model.actuator_forcerange[a]).max())
            # Of a motor the control is the force; of a servo it is an angle, and says nothing about force.
            if model.actuator_ctrllimited[a] and _is_motor(model, a):
                control = float(np.abs(model.actuator_ctrlrange[a]).max())
                force = min(force, control * abs(float(model.actuator_gainprm[a, 0])))
            motors.append(force * abs(float(model.actuator_gear[a, 0])))
        if motors:
            bounds.append(sum(motors))
        return min((bound for bound in bounds if math.isfinite(bound)), default=0.0)

    def _turns(self, j: int) -> bool:
        import mujoco

        return bool(self.model.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE)

    def _not_held(self) -> dict[str, list[str]]:
        """What is left out besides shapes → names."""
        model = self.model
        equalities = [str(model.eq(i).name) or f"equality {i + 1}" for i in range(model.neq) if model.eq_active0[i]]
        springs = [
            str(model.joint(j).name) or f"joint {j + 1}"
            for joints in self.joints.values()
            for j in joints
            if model.jnt_stiffness[j]
        ]
        others = [str(model.body(b).name) or f"body{b}" for b in self.left_out]
        found = {
            "equality constraint, not kept": equalities,
            "joint spring, left out": springs,
            "body of the scene without joints, left out": others,
        }
        return {what: names for what, names in found.items() if names}

    def _new_name(self, name: str) -> str:
        while name in self.taken:
            name += "_"
        self.taken.add(name)
        return name


def _is_motor(model: Any, actuator: int) -> bool:
    import mujoco

    return bool(
        model.actuator_gaintype[actuator] == mujoco.mjtGain.mjGAIN_FIXED
        and model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_NONE
        and model.actuator_dyntype[actuator] == mujoco.mjtDyn.mjDYN_NONE
    )


def _add_inertial(link: ET.Element, model: Any, body: int) -> None:
    mass = float(model.body_mass[body])
    if mass <= 0:
        return
    axes = rotations.to_matrix(model.body_iquat[body])
    tensor = axes @ np.diag(model.body_inertia[body]) @ axes.T
    element = ET.SubElement(link, "inertial")
    ET.SubElement(element, "origin", {"xyz": numbers(model.body_ipos[body]), "rpy": "0 0 0"})
    ET.SubElement(element, "mass", {"value": number(mass)})
    names = {"ixx": (0, 0), "iyy": (1, 1), "izz": (2, 2), "ixy": (0, 1), "ixz": (0, 2), "iyz": (1, 2)}
    ET.SubElement(element, "inertia", {name: number(tensor[at]) for name, at in names.items()})


def _joint_element(name: str, kind: str, parent: str, child: str, placement: Array) -> ET.Element:
    element = ET.Element("joint", {"name": name, "type": kind})
    ET.SubElement(element, "parent", {"link": parent})
    ET.SubElement(element, "child", {"link": child})
    rpy = rotations.to_rpy(rotations.from_matrix(placement[:3, :3]))
    ET.SubElement(element, "origin", {"xyz": numbers(placement[:3, 3]), "rpy": numbers(rpy)})
    return element


def _placement(position: Array, quaternion: Array | Sequence[float]) -> Array:
    """(4, 4) of a position (3,) and a wxyz quaternion (4,)."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotations.to_matrix(quaternion), position
    return matrix


def _one_line(text: str) -> str:
    return ", ".join(line.strip() for line in text.splitlines() if line.strip())


def _told(lost: dict[str, list[str]]) -> Iterable[str]:
    for what, names in lost.items():
        different = list(dict.fromkeys(names))
        more = ", …" if len(different) > NAMES_TOLD else ""
        yield f"{len(names)} × {what}: {', '.join(different[:NAMES_TOLD])}{more}"


def _error(profile: RobotProfile, problem: str, expected: str = "") -> ProfileError:
    return ProfileError(profile.origin or profile.name, problem, place="[model]", expected=expected)
