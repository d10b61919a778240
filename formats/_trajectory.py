"""What every trajectory format needs to keep a `JointTrajectory` whole: checks before writing, checks after reading."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from retarget.core import rotations
from retarget.core.errors import FormatError, InvalidDataError, RetargetError
from retarget.core.types import Array, JointTrajectory

SCHEMA = "retarget.trajectory/1"
"""Name and version of what our files hold; a reader refuses another major version instead of guessing."""


def check_texts(trajectory: JointTrajectory) -> None:
    """Raise `RetargetError` for text that not every format can hold: a NUL character, or half of a surrogate pair."""
    texts = {
        "robot": trajectory.robot,
        "base_frame": trajectory.base_frame,
        "robot_description": trajectory.robot_description,
    }
    texts |= {f"joint_names[{i}]": name for i, name in enumerate(trajectory.joint_names)}
    for place, text in texts.items():
        try:
            text.encode()
        except UnicodeEncodeError as error:
            raise RetargetError(f"JointTrajectory.{place} can't be written as UTF-8: {error.reason}") from None
        if "\0" in text:
            raise RetargetError(f"JointTrajectory.{place} holds a NUL character; expected text without")


def provenance_json(trajectory: JointTrajectory) -> str:
    """The provenance as JSON text. Raises `RetargetError` when it holds what JSON doesn't know (objects, NaN)."""
    try:
        return json.dumps(dict(trajectory.provenance), allow_nan=False)
    except (TypeError, ValueError) as error:
        raise RetargetError(f"JointTrajectory.provenance can't be written as JSON: {error}") from None


def parse_provenance(name: str, text: str) -> dict[str, Any]:
    """The provenance that `provenance_json` wrote; "" gives an empty one. Tuples come back as lists."""
    value = parse_json(name, "provenance", text) if text else {}
    if not isinstance(value, dict):
        raise FormatError(name, f"found a JSON {type(value).__name__}", place="provenance", expected="an object")
    return value


def parse_json(name: str, place: str, text: str) -> Any:
    """JSON text as Python values; `FormatError` naming `place` otherwise."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise FormatError(name, f"not JSON: {error}", place=place) from None


def check_schema(name: str, found: str) -> None:
    """Raise `FormatError` unless `found` is the schema that this version reads."""
    if found != SCHEMA:
        raise FormatError(
            name, f"found schema '{found}'", expected=f"'{SCHEMA}'; a newer version of retarget may read it"
        )


def differentiate(time: Array, values: Array) -> Array:
    """d/dt of `values` (T, k) at `time` (T,) s: central differences, one-sided at both ends, zero for a single frame."""
    if len(time) < 2:
        return np.zeros_like(values)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        return np.asarray(np.gradient(values, time, axis=0))


def unit_quaternions(name: str, place: str, quaternion: ArrayLike) -> Array:
    """Quaternions (T, 4) wxyz from a file, made unit and continuous in sign; bits are kept where they already are.

    Raises `FormatError` where a norm is off by more than 1e-2: that is garbage, not rounding.
    """
    q = np.asarray(quaternion, float)
    with np.errstate(over="ignore", invalid="ignore"):
        off = np.abs(np.einsum("ti,ti->t", q, q) - 1.0)
    if not (off <= 2e-2).all():
        frame = int(np.argmax(~(off <= 2e-2)))
        raise FormatError(
            name, f"found quaternion {q[frame]}", place=f"{place}, frame {frame}", expected="a unit quaternion"
        )
    # The same measure and tolerance as the types': what they accept stays as it is.
    rough = off > 1e-6
    q = np.where(rough[:, None], rotations.normalize(q), q) if rough.any() else q
    return rotations.make_continuous(q)


def build(name: str, warnings: Sequence[str] = (), **fields: Any) -> JointTrajectory:
    """A `JointTrajectory` read from file `name`; broken promises of the type become `FormatError`.

    Warnings, when there are any, are added to the provenance under "warnings".
    """
    if warnings:
        provenance: Mapping[str, Any] = fields.get("provenance", {})
        fields["provenance"] = {**provenance, "warnings": [*provenance.get("warnings", []), *warnings]}
    try:
        return JointTrajectory(**fields)
    except InvalidDataError as error:
        raise FormatError(name, str(error)) from error
