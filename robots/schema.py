"""TOML tables → `RobotProfile`. Unknown keys are errors that name the nearest valid key; units stand in key names."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NoReturn, TypeGuard

import numpy as np
from retarget.core.errors import ProfileError, nearest
from retarget.core.profile import (
    DEFAULT_POSTURE_WEIGHT,
    Array,
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

Table = dict[str, Any]
SIDES = ("Left", "Right")
LARGEST_NUMBER = 1e12
"""No length, angle or weight is larger; TOML would also take inf, nan and integers of any size."""


def parse_profile(table: Table, path: Path) -> RobotProfile:
    """The checked profile in `table`, read from `path` (named in errors). Raises `ProfileError`."""
    top = _Reader(path, "", table)
    top.only(
        [
            "name",
            "description",
            "model",
            "links",
            "limb_ends",
            "reference_posture_rad",
            "solver",
            "limits",
            "coupled",
            "hands",
            "feet",
            "tpose_exceptions",
            "mapping",
        ]
    )
    model = top.table("model", required=True)
    model.only(["package", "path", "file", "human", "base", "base_segment", "base_rpy_rad", "locked_joints"])
    links = top.table("links")
    links.only(SEGMENTS)
    base = model.text("base", "floating")
    if base not in ("floating", "fixed"):
        model.fail("base", base, "'floating' or 'fixed'")
    base_segment = model.text("base_segment", "Pelvis")
    if base_segment not in SEGMENTS:
        model.fail("base_segment", base_segment, "a canonical segment name")
    limits = top.table("limits")
    limits.only(["default_velocity_rad_s", "joints"])
    solver = top.table("solver")
    solver.only(["posture_weight"])
    return RobotProfile(
        name=top.text("name", path.stem),
        description=top.text("description", ""),
        origin=str(path),
        model=_model_source(model),
        base="fixed" if base == "fixed" else "floating",
        base_segment=base_segment,
        base_rpy=_triple(model.numbers("base_rpy_rad", 3, default=(0.0, 0.0, 0.0))),
        links={key: links.text(key) for key in links.table_},
        limb_ends=_texts(top.table("limb_ends"), SEGMENTS),
        reference_posture={
            k: top.table("reference_posture_rad").number(k) for k in top.table("reference_posture_rad").table_
        },
        locked_joints=tuple(model.texts("locked_joints")),
        posture_weight=solver.positive("posture_weight") or DEFAULT_POSTURE_WEIGHT,
        default_velocity_limit=limits.positive("default_velocity_rad_s"),
        joint_limits=_joint_limits(limits.table("joints")),
        coupled=tuple(_coupled(entry) for entry in top.tables("coupled")),
        hands={side: _hand(entry) for side, entry in _sides(top.table("hands"))},
        feet={side: _foot(entry) for side, entry in _sides(top.table("feet"))},
        tpose_exceptions=_tpose_exceptions(top.table("tpose_exceptions")),
        mappings=_mappings(top.table("mapping")),
    )


class _Reader:
    """One table of the file with its place, so that every message can say where."""

    def __init__(self, path: Path, place: str, table: Table) -> None:
        self.path, self.place, self.table_ = path, place, table

    def fail(self, key: str, found: object, expected: str) -> NoReturn:
        place = f"{self.place}.{key}" if self.place else key
        raise ProfileError(self.path, f"found {found!r}", place=f"key {place}", expected=expected)

    def only(self, keys: Iterable[str]) -> None:
        """Refuse every key that is not in `keys`, naming the nearest one that is."""
        valid = list(keys)
        for key in self.table_:
            if key not in valid:
                near = nearest(key, valid)
                place = f"[{self.place}]" if self.place else "top level"
                hint = f"did you mean '{near[0]}'?" if near else f"one of {', '.join(valid)}"
                raise ProfileError(self.path, f"unknown key '{key}'", place=place, expected=hint)

    def table(self, key: str, *, required: bool = False) -> _Reader:
        value = self.table_.get(key, {})
        if not isinstance(value, dict) or (required and key not in self.table_):
            self.fail(key, self.table_.get(key), "a table")
        return _Reader(self.path, f"{self.place}.{key}" if self.place else key, value)

    def tables(self, key: str) -> list[_Reader]:
        value = self.table_.get(key, [])
        if not isinstance(value, list) or not all(isinstance(item, dict) for item in value):
            self.fail(key, value, "an array of tables")
        return [_Reader(self.path, f"{self.place}{key}[{i}]", item) for i, item in enumerate(value)]

    def text(self, key: str, default: str | None = None) -> str:
        value = self.table_.get(key, default)
        if not isinstance(value, str):
            self.fail(key, value, "text")
        return value

    def texts(self, key: str) -> list[str]:
        value = self.table_.get(key, [])
        if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
            self.fail(key, value, "a list of texts")
        return list(value)

    def number(self, key: str) -> float:
        value = self.table_.get(key)
        if not _is_number(value):
            self.fail(key, value, "a finite number")
        return float(value)

    def optional(self, key: str) -> float | None:
        return self.number(key) if key in self.table_ else None

    def positive(self, key: str) -> float | None:
        value = self.optional(key)
        if value is not None and value <= 0:
            self.fail(key, value, "a number above 0")
        return value

    def numbers(self, key: str, count: int, default: Sequence[float] | None = None) -> list[float]:
        value = self.table_.get(key, None if default is None else list(default))
        if not isinstance(value, list) or len(value) != count or not all(_is_number(v) for v in value):
            self.fail(key, value, f"a list of {count} finite numbers")
        return [float(v) for v in value]

    def matrix(self, key: str, columns: int) -> Array:
        value = self.table_.get(key)
        if not isinstance(value, list) or not value or not all(_is_row(row, columns) for row in value):
            self.fail(key, value, f"rows of {columns} finite numbers")
        return np.array(value, float)


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < LARGEST_NUMBER


def _is_row(value: object, columns: int) -> bool:
    return isinstance(value, list) and len(value) == columns and all(_is_number(v) for v in value)


def _model_source(model: _Reader) -> ModelSource:
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


def _texts(table: _Reader, valid: Iterable[str]) -> dict[str, str]:
    table.only(valid)
    return {key: table.text(key) for key in table.table_}


def _sides(table: _Reader) -> list[tuple[str, _Reader]]:
    table.only(SIDES)
    return [(side, table.table(side)) for side in table.table_]


def _triple(values: list[float]) -> tuple[float, float, float]:
    return (values[0], values[1], values[2])


def _unit(table: _Reader, key: str) -> tuple[float, float, float]:
    values = table.numbers(key, 3)
    norm = float(np.linalg.norm(values))
    if abs(norm - 1) > 1e-3:
        table.fail(key, values, "a unit vector")
    return _triple([v / norm for v in values])


def _hand(table: _Reader) -> Hand:
    table.only(["link", "fingers", "palm"])
    hand = Hand(table.text("link"), _unit(table, "fingers"), _unit(table, "palm"))
    if abs(float(np.dot(hand.fingers, hand.palm))) > 1e-3:
        table.fail("palm", hand.palm, "a direction perpendicular to fingers")
    return hand


def _foot(table: _Reader) -> Foot:
    table.only(["link", "sole_m"])
    sole = table.matrix("sole_m", 3)
    if len(sole) < 3:
        table.fail("sole_m", sole.tolist(), "at least three corners")
    return Foot(table.text("link"), sole)


def _joint_limits(table: _Reader) -> dict[str, JointLimit]:
    limits = {}
    for joint in table.table_:
        entry = table.table(joint)
        entry.only(["lower_rad", "upper_rad", "velocity_rad_s"])
        limits[joint] = JointLimit(
            entry.optional("lower_rad"), entry.optional("upper_rad"), entry.positive("velocity_rad_s")
        )
    return limits


def _coupled(table: _Reader) -> CoupledJoints:
    table.only(["joints", "rows", "lower_rad", "upper_rad"])
    joints = tuple(table.texts("joints"))
    rows = table.matrix("rows", len(joints))
    lower = np.array(table.numbers("lower_rad", len(rows)))
    upper = np.array(table.numbers("upper_rad", len(rows)))
    if (lower > upper).any():
        table.fail("lower_rad", lower.tolist(), "nothing above upper_rad")
    return CoupledJoints(joints, rows, lower, upper)


def _tpose_exceptions(table: _Reader) -> dict[str, TposeException]:
    table.only(SEGMENTS)
    found = {}
    for segment in table.table_:
        entry = table.table(segment)
        entry.only(["joint", "error_deg"])
        found[segment] = TposeException(entry.text("joint"), entry.number("error_deg"))
    return found


def _mappings(table: _Reader) -> dict[str, MappingParameters]:
    found = {}
    for name in table.table_:
        entry = table.table(name)
        entry.only(["weights", "twist_weights", "rotations_rpy_rad", "links"])
        weights, twist, rpy = (entry.table(k) for k in ("weights", "twist_weights", "rotations_rpy_rad"))
        for part in (weights, twist, rpy):
            part.only(SEGMENTS)
        found[name] = MappingParameters(
            weights={k: _not_negative(weights, k) for k in weights.table_},
            twist_weights={k: _not_negative(twist, k) for k in twist.table_},
            rotations_rpy={k: _triple(rpy.numbers(k, 3)) for k in rpy.table_},
            links=_texts(entry.table("links"), SEGMENTS),
        )
    return found


def _not_negative(table: _Reader, key: str) -> float:
    value = table.number(key)
    if value < 0:
        table.fail(key, value, "a number ≥ 0")
    return value
