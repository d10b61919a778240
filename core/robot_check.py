"""Does a robot profile fit its model? Every constant tested by forward kinematics in the T-pose that the solver itself finds.

A person in T-pose (every segment upright, facing +X) is retargeted with `limb_plane` and the dynamical solver. There every limb must
point as the person's, or the profile must say by how much it can't and which joint forbids it (`tpose_exceptions`): by its limit, or because
the two bones of a limb stand at different angles to their hinge and can never be in line.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from retarget.core import rotations
from retarget.core.errors import ProfileError
from retarget.core.kinematics import link_poses
from retarget.core.profile import TposeException
from retarget.core.report import Check, ValidationReport
from retarget.core.robot_model import RobotModel
from retarget.core.segments import LIMB_END, SEGMENTS
from retarget.core.types import Array, HumanMotion, Targets

LIMB_LIMIT_DEG = 1.0
ORIENTATION_LIMIT_DEG = 5.0
"""For segments that are no limbs: head, chest, pelvis, hands, feet."""
EXCEPTION_MARGIN_DEG = 0.1
"""How near the error must be to what a `tpose_exceptions` entry states."""
SOLE_LIMIT_MM = 2.0
SYMMETRY_LIMIT_MM = 1.0
ARM_MIRROR_LIMIT_MM = 2.0
ARM_LENGTH_LIMIT_PERCENT = 5.0
"""How far a typed arm length may be from the distance between the arm's two points in the reference posture."""
FASTEST_JOINT_RAD_S = 60.0
"""No humanoid's joint is faster: a higher figure is a placeholder that nobody replaced."""
AT_LIMIT_RAD = 1e-4
LIMB_BONES = (("UpperArm", "ForeArm"), ("UpperLeg", "LowerLeg"))
BODY = (
    "Pelvis", "T8", "Head",
    *(f"{side}{part}" for side in ("Left", "Right") for part in ("UpperArm", "ForeArm", "Hand", "UpperLeg", "LowerLeg", "Foot")),
)  # fmt: skip
"""The segments that a whole humanoid has links for; the others are spread over the spine, or are collarbones and toes."""
FRAMES = 3


def check(model: RobotModel) -> ValidationReport:
    """The report on `model` and its profile. Links and joints that do not exist never get here: building the model raises for these.

    series["tpose_rad"]: (n,) the solved T-pose. Raises `ProfileError` when the profile maps no link, `SolverError` when no T-pose can be solved at all.
    """
    if not model.links:
        raise ProfileError(
            model.profile.origin or model.profile.name, "no segment has a link", place="[links]",
            expected="the links that follow the person, at least of the arms or the legs",
        )  # fmt: skip
    motion = tpose(model)
    targets, joints, base = _solved(model, motion)
    checks = [*_model_checks(model), *_reference_checks(model)]
    checks += _tpose_checks(model, motion, targets, joints, base)
    checks += _foot_checks(model, joints, base)
    checks += _symmetry_checks(model, joints, base)
    checks += _hand_checks(model)
    checks += _arm_checks(model)
    checks += _replay_checks(model)
    return ValidationReport(model.profile.name, tuple(checks), {"tpose_rad": joints})


def tpose(model: RobotModel) -> HumanMotion:
    """A person standing in T-pose, facing +X; with the model's own bones where the robot is the person."""
    own = model.limbs if model.profile.model.kind == "human" else {}
    orientation = np.zeros((FRAMES, len(SEGMENTS), 4))
    orientation[..., 0] = 1.0
    return HumanMotion(
        time=np.arange(FRAMES) / 60.0,
        segments=SEGMENTS,
        orientation=orientation,
        position=np.full((FRAMES, len(SEGMENTS), 3), np.nan),
        joint_offsets={LIMB_END[segment]: limb.distal - limb.proximal for segment, limb in own.items()},
    )


def solved_tpose(model: RobotModel) -> tuple[Array, dict[str, float]]:
    """Joints (n,) rad of the T-pose that the solver finds, and segment → error that is left there, in degrees. Raises `SolverError`."""
    motion = tpose(model)
    targets, joints, base = _solved(model, motion)
    return joints, tpose_errors(model, motion, targets, joints, base)


def _solved(model: RobotModel, motion: HumanMotion) -> tuple[Targets, Array, Array | None]:
    """Targets, joints (n,) rad and base orientation (4,) wxyz or None of the last frame."""
    from retarget.core.mapping import limb_plane
    from retarget.core.solve.dynamical import DynamicalOptions, solve
    from retarget.core.solve.newton import NewtonOptions
    from retarget.core.solve.problem import orientation_problem

    targets = limb_plane.targets(motion, model)
    options = DynamicalOptions(newton=NewtonOptions(posture_weight=model.profile.posture_weight))
    solution = solve(orientation_problem(targets, model, free_base=model.base_is_floating), options)
    base = None if solution.base_orientation is None else solution.base_orientation[-1]
    return targets, solution.joints[-1], base


def _model_checks(model: RobotModel) -> list[Check]:
    span, speed = model.upper - model.lower, model.velocity_limit
    absent = [segment for segment in BODY if segment not in model.links]
    narrowest, fastest = int(np.argmin(span)), int(np.argmax(speed))
    return [
        _above("degrees of freedom", float(len(model.joint_names)), "", 0.0),
        _above("mass", model.mass_kg, "kg", 0.0),
        _above("smallest joint range", float(span[narrowest]), "rad", 0.0, model.joint_names[narrowest]),
        _below("largest joint speed", float(speed[fastest]), "rad/s", FASTEST_JOINT_RAD_S, model.joint_names[fastest]),
        Check("segments without a link", float(len(absent)), "", None, True, ", ".join(absent)),
    ]


def _reference_checks(model: RobotModel) -> list[Check]:
    """The posture as the profile states it: the model's own copy is already clipped into the limits."""
    stated = [(model.joint_index(name), value) for name, value in model.profile.reference_posture.items()]
    outside = [max(model.lower[i] - value, value - model.upper[i], 0.0) for i, value in stated]
    worst = int(np.argmax(outside)) if stated else 0
    name = model.joint_names[stated[worst][0]] if stated else ""
    checks = [_below("reference posture outside the joint limits", max(outside, default=0.0), "rad", 0.0, name)]
    if model.coupled:
        violations = [row for *_, row in _row_slacks(model, model.reference_posture)]
        worst_row = max(0.0, -min(violations))
        checks.append(_below("reference posture outside the coupled rows", worst_row, "rad", 0.0))
    return checks


def _row_slacks(model: RobotModel, joints: Array) -> list[tuple[tuple[str, ...], float]]:
    """(joints with a coefficient in the row, distance to the nearer bound, negative outside) for every coupled row."""
    slacks = []
    for coupled in model.coupled:
        value = coupled.matrix @ joints[[model.joint_index(name) for name in coupled.joints]]
        for row, slack in zip(coupled.matrix, np.minimum(value - coupled.lower, coupled.upper - value), strict=True):
            slacks.append((tuple(np.array(coupled.joints)[row != 0]), float(slack)))
    return slacks


def _tpose_checks(
    model: RobotModel, motion: HumanMotion, targets: Targets, joints: Array, base: Array | None
) -> list[Check]:
    errors = tpose_errors(model, motion, targets, joints, base)
    exceptions, held = _exceptions(model, errors), _skewed(model) | _held(model, joints)
    failing = [segment for segment in errors if errors[segment] > _limit(model, segment)]
    checks = []
    for segment, error in errors.items():
        name = f"T-pose {segment} {'direction' if segment in model.limbs else 'orientation'}"
        if segment not in exceptions:
            limit = _limit(model, segment)
            note = _reason(segment, error, _in_the_way(model, segment, failing, held)) if error > limit else ""
            checks.append(_below(name, error, "deg", limit, note))
            continue
        stated = exceptions[segment]
        forbids = held.get(stated.joint, "") if stated.joint else "; ".join(dict.fromkeys(held.values()))
        passed = abs(error - stated.error_deg) <= EXCEPTION_MARGIN_DEG and bool(forbids)
        note = f"the profile states {stated.error_deg:g}°; {forbids or f'but {stated.joint} is at no limit'}"
        checks.append(Check(name, error, "deg", stated.error_deg + EXCEPTION_MARGIN_DEG, passed, note))
    if not model.limbs:
        checks.append(Check("T-pose directions", None, "deg", LIMB_LIMIT_DEG, None, "the profile maps no whole limb"))
    return checks


def _limit(model: RobotModel, segment: str) -> float:
    return LIMB_LIMIT_DEG if segment in model.limbs else ORIENTATION_LIMIT_DEG


def _held_before(model: RobotModel, segment: str, held: Mapping[str, str]) -> list[str]:
    """The joints of `held` that move the segment's link against the base, nearest first."""
    joint, _, _ = model.link_in_joint(model.links[segment])
    names = []
    while joint > model.base_is_floating:
        names.append(str(model.pin_model.names[joint]))
        joint = int(model.pin_model.parents[joint])
    return [name for name in names if name in held]


def _in_the_way(model: RobotModel, segment: str, failing: list[str], held: dict[str, str]) -> dict[str, str]:
    """Of the joints of `held` those likely to keep `segment` from the T-pose, likeliest first.

    Those that move its link; where they are all free it gave way to others that fail: to its own side's, then to any.
    """
    side = next((side for side in ("Left", "Right") if segment.startswith(side)), "")
    groups = ([segment], [other for other in failing if side and other.startswith(side)], failing)
    for group in groups:
        if found := [name for other in group for name in _held_before(model, other, held)]:
            return {name: held[name] for name in found}
    return held


def _reason(segment: str, error: float, held: Mapping[str, str]) -> str:
    """What may keep `segment` from the T-pose, and the line that states it. held: joint → what holds it, likeliest first."""
    if not held:
        return "no joint is at its limit: are the link, reference_posture_rad and base_rpy_rad right?"
    line = f'{segment} = {{ joint = "{next(iter(held))}", error_deg = {error:.2f} }}'
    return f"{'; '.join(dict.fromkeys(held.values()))}; if it has to be so, under [tpose_exceptions]: {line}"


def tpose_errors(
    model: RobotModel, motion: HumanMotion, targets: Targets, joints: Array, base: Array | None
) -> dict[str, float]:
    """Segment → error in degrees at joints (n,): of the bone's direction for limbs, of the whole orientation for all others."""
    from retarget.core.mapping.limb_plane import bone_direction

    tasks = [task for task in targets.tasks if task.segment]
    turn = None if base is None else base[None]
    rotation, _ = link_poses(model, [task.frame for task in tasks], joints[None], turn)
    achieved = rotations.from_matrix(rotation[0])
    errors = {}
    for i, task in enumerate(tasks):
        limb = model.limbs.get(task.segment)
        if limb is None:
            error = rotations.angle(achieved[i], task.value[-1])
        else:
            error = rotations.vector_angle(rotation[0, i] @ limb.bone, bone_direction(motion, task.segment)[-1])
        errors[task.segment] = float(np.degrees(error))
    return errors


def _exceptions(model: RobotModel, errors: dict[str, float]) -> dict[str, TposeException]:
    """Segment → what the profile states for it.

    A robot whose sides mirror each other may have two T-poses that are equally good, one the mirror image of the other. If the errors
    fit better with left and right exchanged, so are the entries; what the opposite joint is called is not known then, so none is named.
    """
    stated = dict(model.profile.tpose_exceptions)
    mirrored = {_other_side(segment): TposeException("", entry.error_deg) for segment, entry in stated.items()}

    def misfit(candidate: dict[str, TposeException]) -> float:
        return sum(abs(errors[segment] - entry.error_deg) for segment, entry in candidate.items() if segment in errors)

    return stated if misfit(stated) <= misfit(mirrored) else mirrored


def _other_side(segment: str) -> str:
    if segment.startswith("Left"):
        return "Right" + segment.removeprefix("Left")
    return "Left" + segment.removeprefix("Right") if segment.startswith("Right") else segment


def _held(model: RobotModel, joints: Array) -> dict[str, str]:
    """Joint → what holds it: its own position limit, or a coupled row at its bound."""
    room = np.minimum(joints - model.lower, model.upper - joints)
    held: dict[str, str] = {}
    for names, slack in _row_slacks(model, joints):
        if slack < AT_LIMIT_RAD:
            held |= dict.fromkeys(names, f"{', '.join(names)} at the bound of a coupled row")
    return held | {
        name: f"{name} at its limit" for name, left in zip(model.joint_names, room, strict=True) if left < AT_LIMIT_RAD
    }


def _skewed(model: RobotModel) -> dict[str, str]:
    """Hinge → by how much it keeps its two bones out of line at best, where that is more than a limb may be off.

    Whatever the hinge does, its axis stays at the same angle to either bone: their directions differ at least by the difference.
    """
    import pinocchio as pin

    data = model.pin_model.createData()
    q = model.configuration(model.reference_posture)
    axes = pin.computeJointJacobians(model.pin_model, data, q)[3:]
    skewed = {}
    for upper, lower in ((f"{side}{u}", f"{side}{w}") for side in ("Left", "Right") for u, w in LIMB_BONES):
        if upper not in model.limbs or lower not in model.limbs or model.limbs[upper].hinge is None:
            continue
        hinge, _, _ = model.link_in_joint(model.limbs[lower].link)
        axis = axes[:, model.pin_model.joints[hinge].idx_v]
        limbs = [model.limbs[upper], model.limbs[lower]]
        rotation, _ = link_poses(model, [limb.link for limb in limbs], model.reference_posture[None])
        angles = [float(rotations.vector_angle(rotation[0, i] @ limb.bone, axis)) for i, limb in enumerate(limbs)]
        if (skew := float(np.degrees(abs(angles[0] - angles[1])))) > LIMB_LIMIT_DEG:
            name = str(model.pin_model.names[hinge])
            skewed[name] = f"{name} keeps its bones {skew:.2f}° out of line"
    return skewed


def _foot_checks(model: RobotModel, joints: Array, base: Array | None) -> list[Check]:
    checks, heights = [], []
    turn = None if base is None else base[None]
    for side, foot in model.profile.feet.items():
        shank = model.limbs.get(f"{side}LowerLeg")
        links = [foot.link] + ([shank.link] if shank else [])
        rotation, origin = link_poses(model, links, joints[None], turn)
        corners = foot.sole @ rotation[0, 0].T + origin[0, 0]
        heights.append(float(corners[:, 2].mean()))
        tilt = 1000 * float(np.ptp(corners[:, 2]))
        checks.append(_below(f"{side} sole out of level in T-pose", tilt, "mm", SOLE_LIMIT_MM))
        if shank:
            ankle = rotation[0, 1] @ shank.distal + origin[0, 1]
            checks.append(_above(f"{side} ankle above its sole", 1000 * float(ankle[2] - heights[-1]), "mm", 0.0))
    if len(heights) == 2:
        checks.append(_below("soles at different heights", 1000 * abs(heights[0] - heights[1]), "mm", SOLE_LIMIT_MM))
    return checks


def _symmetry_checks(model: RobotModel, joints: Array, base: Array | None) -> list[Check]:
    checks = []
    turn = None if base is None else base[None]
    for part in ("UpperArm", "ForeArm", "UpperLeg", "LowerLeg"):
        left, right = (model.limbs.get(f"{side}{part}") for side in ("Left", "Right"))
        if left is None or right is None:
            continue
        lengths = [float(np.linalg.norm(limb.distal - limb.proximal)) for limb in (left, right)]
        difference = 1000 * abs(lengths[0] - lengths[1])
        note = f"{lengths[0]:.4f} m and {lengths[1]:.4f} m"
        checks.append(_below(f"{part} left against right", difference, "mm", SYMMETRY_LIMIT_MM, note))
        # A robot with wide ranges can reach the T-pose with its arms crossed: only where they start tells left from right.
        rotation, origin = link_poses(model, [left.link, right.link], joints[None], turn)
        starts = [rotation[0, i] @ limb.proximal + origin[0, i] for i, limb in enumerate((left, right))]
        apart = 1000 * float(starts[0][1] - starts[1][1])
        hint = (
            ""
            if apart > 0
            else "links of left and right exchanged, or base_rpy_rad is not how it stands upright facing +X"
        )
        checks.append(_above(f"{part} left of the right one", apart, "mm", 0.0, hint))
    return checks


def _hand_checks(model: RobotModel) -> list[Check]:
    checks = []
    for side, hand in model.profile.hands.items():
        fingers, palm = np.array(hand.fingers), np.array(hand.palm)
        off = max(abs(np.linalg.norm(fingers) - 1), abs(np.linalg.norm(palm) - 1), abs(fingers @ palm))
        checks.append(_below(f"{side} hand: fingers and palm not unit and perpendicular", float(off), "", 1e-6))
    return checks


def arm_points(model: RobotModel, side: str, joints: Array) -> Array:
    """(2, 3) m: shoulder centre and hand point of [arms.`side`] at joints (n,), the base upright at the origin."""
    arm = model.profile.arms[side]
    rotation, origin = link_poses(model, [arm.shoulder_link, arm.hand_link], joints[None])
    local = np.array([arm.shoulder_m, arm.hand_m])
    return np.asarray(np.einsum("kij,kj->ki", rotation[0], local) + origin[0])


def _arm_checks(model: RobotModel) -> list[Check]:
    """In the reference posture, where the arm is stretched out to the side."""
    points = {side: arm_points(model, side, model.reference_posture) for side in model.profile.arms}
    checks = []
    for side, (shoulder, hand) in points.items():
        length = float(np.linalg.norm(hand - shoulder))
        checks.append(_above(f"{side} arm length", length, "m", 0.0, "shoulder to hand point, reference posture"))
        if (typed := model.profile.arms[side].length_m) is not None:
            off = 100 * abs(typed / length - 1) if length > 0 else np.inf
            checks.append(
                _below(f"{side} arm length off", off, "%", ARM_LENGTH_LIMIT_PERCENT, f"the profile states {typed:g} m")
            )
    if len(points) == 2:
        gaps = 1000 * np.linalg.norm(points["Left"] - points["Right"] * [1.0, -1.0, 1.0], axis=1)
        for name, gap in zip(("shoulder", "hand point"), gaps, strict=True):
            checks.append(_below(f"{name} left against right", float(gap), "mm", ARM_MIRROR_LIMIT_MM))
    return checks


def _replay_checks(model: RobotModel) -> list[Check]:
    """Whether the robot can be simulated, and as what."""
    from retarget.core.replay.model import build

    try:
        replay = build(model, base=model.profile.base, self_collision=True)
    except ProfileError as error:
        return [Check("simulation model", None, "", None, False, str(error))]
    mj, floating = replay.mj, 6 * model.base_is_floating
    degrees = len(model.joint_names) + floating
    touching = "; ".join(f"{a} and {b}" for a, b in replay.touching)
    repaired = ", ".join(replay.repaired)
    checks = [
        _below(
            "simulated mass off", abs(float(mj.body_mass.sum()) - model.mass_kg), "kg", 1e-6 * max(1.0, model.mass_kg)
        ),
        _below("simulated degrees of freedom off", float(abs(mj.nv - degrees)), "", 0.0),
        _below("pairs of links touching in the reference posture", float(len(replay.touching)), "", 0.0, touching),
        Check("links with an inertia that no body can have", float(len(replay.repaired)), "", None, True, repaired),
    ]
    of_model, of_shapes = model.warnings, replay.warnings[len(model.warnings) :]
    for name, told in (("parts of the MJCF left out", of_model), ("shapes left out", of_shapes)):
        if told:
            checks.append(Check(name, float(len(told)), "", None, None, "; ".join(told)))
    return checks


def _below(name: str, value: float, unit: str, limit: float, note: str = "") -> Check:
    return Check(name, value, unit, limit, bool(value <= limit), note)


def _above(name: str, value: float, unit: str, limit: float, note: str = "") -> Check:
    return Check(name, value, unit, limit, bool(value > limit), note)
