"""TOML tables → `RobotProfile`. Unknown keys are errors that name the nearest valid key; units stand in key names.

`[model]` names a URDF or an MJCF (root element <mujoco>), in an installed package or as a `file` beside the profile.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from retarget.core.profile import (
    DEFAULT_POSTURE_WEIGHT,
    CoupledJoints,
    Foot,
    Hand,
    JointLimit,
    MappingParameters,
    ModelSource,
    RobotProfile,
    TposeException,
)
from retarget.core.segments import SEGMENTS
from retarget.robots import profile_keys as keys
from retarget.robots.schema_control import parse_arms, parse_hierarchy, parse_torque
from retarget.robots.toml_table import Table, TableReader


def parse_profile(table: Table, path: Path) -> RobotProfile:
    """The checked profile in `table`, read from `path` (named in errors). Raises `ProfileError`."""
    top = TableReader(path, "", table)
    top.only(keys.TOP)
    model = top.table("model", required=True)
    model.only(keys.MODEL)
    links = top.table("links")
    links.only(keys.LINKS)
    base = model.text("base", "floating")
    if base not in ("floating", "fixed"):
        model.fail("base", base, "'floating' or 'fixed'")
    base_segment = model.text("base_segment", "Pelvis")
    if base_segment not in SEGMENTS:
        model.fail("base_segment", base_segment, "a canonical segment name")
    arms = parse_arms(top.table("arms"))
    limits = top.table("limits")
    limits.only(keys.LIMITS)
    solver = top.table("solver")
    solver.only(keys.SOLVER)
    return RobotProfile(
        name=top.text("name", path.stem),
        description=top.text("description", ""),
        origin=str(path),
        model=_model_source(model),
        base="fixed" if base == "fixed" else "floating",
        base_segment=base_segment,
        base_rpy=model.triple("base_rpy_rad", (0.0, 0.0, 0.0)),
        links={key: links.text(key) for key in links.table_},
        limb_ends=top.table("limb_ends").texts_by(keys.LIMB_ENDS),
        reference_posture={
            k: top.table("reference_posture_rad").number(k) for k in top.table("reference_posture_rad").table_
        },
        locked_joints=tuple(model.texts("locked_joints")),
        posture_weight=solver.positive("posture_weight") or DEFAULT_POSTURE_WEIGHT,
        default_velocity_limit=limits.positive("default_velocity_rad_s"),
        joint_limits=_joint_limits(limits.table("joints")),
        coupled=tuple(_coupled(entry) for entry in top.tables("coupled")),
        hands={side: _hand(entry) for side, entry in top.table("hands").sides()},
        feet={side: _foot(entry) for side, entry in top.table("feet").sides()},
        tpose_exceptions=_tpose_exceptions(top.table("tpose_exceptions")),
        mappings=_mappings(top.table("mapping")),
        arms=arms,
        hierarchy=parse_hierarchy(top.table("hierarchy"), links.table_, arms),
        torque=parse_torque(top.table("torque")),
    )


def _model_source(model: TableReader) -> ModelSource:
    given = [key for key in ("package", "file", "human") if key in model.table_]
    if len(given) != 1:
        model.fail("package", given, "exactly one of package (with path), file, human")
    if given == ["human"]:
        if model.table_["human"] is not True:
            model.fail("human", model.table_["human"], "true")
        return ModelSource("human")
    if given == ["file"]:
        return ModelSource("file", path=model.text("file"))
    return ModelSource("package", path=model.text("path"), package=model.text("package"))


def _hand(table: TableReader) -> Hand:
    table.only(keys.HAND)
    hand = Hand(table.text("link"), table.unit("fingers"), table.unit("palm"))
    if abs(float(np.dot(hand.fingers, hand.palm))) > 1e-3:
        table.fail("palm", hand.palm, "a direction perpendicular to fingers")
    return hand


def _foot(table: TableReader) -> Foot:
    table.only(keys.FOOT)
    sole = table.matrix("sole_m", 3)
    if len(sole) < 3:
        table.fail("sole_m", sole.tolist(), "at least three corners")
    return Foot(table.text("link"), sole)


def _joint_limits(table: TableReader) -> dict[str, JointLimit]:
    limits = {}
    for joint in table.table_:
        entry = table.table(joint)
        entry.only(keys.JOINT_LIMITS)
        limits[joint] = JointLimit(
            entry.optional("lower_rad"), entry.optional("upper_rad"), entry.positive("velocity_rad_s")
        )
    return limits


def _coupled(table: TableReader) -> CoupledJoints:
    table.only(keys.COUPLED)
    joints = tuple(table.texts("joints"))
    rows = table.matrix("rows", len(joints))
    lower = np.array(table.numbers("lower_rad", len(rows)))
    upper = np.array(table.numbers("upper_rad", len(rows)))
    if (lower > upper).any():
        table.fail("lower_rad", lower.tolist(), "nothing above upper_rad")
    return CoupledJoints(joints, rows, lower, upper)


def _tpose_exceptions(table: TableReader) -> dict[str, TposeException]:
    table.only(keys.TPOSE_EXCEPTIONS)
    found = {}
    for segment in table.table_:
        entry = table.table(segment)
        entry.only(keys.TPOSE_EXCEPTION)
        found[segment] = TposeException(entry.text("joint"), entry.number("error_deg"))
    return found


def _mappings(table: TableReader) -> dict[str, MappingParameters]:
    found = {}
    for name in table.table_:
        entry = table.table(name)
        entry.only(keys.MAPPING)
        weights, twist, rpy = (entry.table(k) for k in ("weights", "twist_weights", "rotations_rpy_rad"))
        for part in (weights, twist, rpy):
            part.only(keys.LINKS)
        found[name] = MappingParameters(
            weights={k: weights.not_negative(k) for k in weights.table_},
            twist_weights={k: twist.not_negative(k) for k in twist.table_},
            rotations_rpy={k: rpy.triple(k) for k in rpy.table_},
            links=entry.table("links").texts_by(SEGMENTS),
        )
    return found
