"""Who the operator is: shoulders, arm lengths and the three calibration poses of [Lim2022 sec. II-B], as one JSON file.

All points are metres in the **operator frame**: turned about world Z only, so that the person faced +X in the Still pose, Y left, Z up;
its origin is fixed in the world where the person's pelvis was in the Still pose (`origin`).
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray
from retarget.core.errors import FormatError, InvalidDataError, UsageError, nearest
from retarget.core.field_checks import FieldSetter, check_segment_names, check_unit, frozen_array

Array = NDArray[np.float64]

SIDES = ("Left", "Right")
POSES = ("still", "tpose", "forward")
"""S, T and F of [Lim2022 fig. 3]: arms down, arms out to the sides, arms forward."""

POSE_NAMES = {"still": "Still pose", "tpose": "T-pose", "forward": "Forward pose"}
"""Pose → what messages call it."""

LARGEST_NUMBER = 1e300
"""JSON knows whole numbers of any size."""
SCHEMA = "retarget.calibration/1"
UNITS = "m, rad, s; quaternions wxyz; operator frame: X forward, Y left, Z up"

_ANGLES = ("still_tpose", "tpose_forward", "forward_still")
_TABLES = (
    "still_orientation",
    "trackers",
    "tracker_rotation",
    "hand_offset_m",
    "windows_s",
    "input_sha256",
    "residuals",
)
_SINGLE = ("origin", "heading_rad", "chest_position", "chest_orientation")
_ARM = ("hand_points_m", "shoulder_m", "length_m", "angles_deg", "offsets_m")


@dataclass(frozen=True, eq=False)
class ArmCalibration:
    """One arm. hand_points: (3, 3) m, operator frame, rows = hand point in the Still, T and Forward pose. shoulder: (3,) m, operator frame.

    length_m: mean distance from shoulder to the three hand points. angles_deg: between the arm vectors S-T, T-F, F-S.
    offsets_m: k of the three pairs, the distances from the circle's centre to the three candidates; their spread is the residual.
    """

    hand_points: Array
    shoulder: Array
    length_m: float
    angles_deg: tuple[float, float, float]
    offsets_m: tuple[float, float, float]

    def __post_init__(self) -> None:
        for name, shape in (("hand_points", (3, 3)), ("shoulder", (3,)), ("angles_deg", (3,)), ("offsets_m", (3,))):
            value = frozen_array(f"ArmCalibration.{name}", getattr(self, name), shape)
            object.__setattr__(self, name, value if name in ("hand_points", "shoulder") else tuple(value.tolist()))
        if not 0.05 < self.length_m < 3:
            raise InvalidDataError(
                f"ArmCalibration.length_m: found {self.length_m:g}, expected an arm's length in metres"
            )

    @property
    def basis(self) -> Array:
        """B of [Lim2022 eq. 3]: (3, 3) m, columns S - sh, T - sh, F - sh in the operator frame."""
        return np.asarray((self.hand_points - self.shoulder).T)


@dataclass(frozen=True, eq=False)
class Calibration:
    """The operator, as measured in the three poses.

    arms: "Left" and "Right". origin: (3,) m, world, of the operator frame; heading_rad: the person's yaw in the world, Still pose.
    chest_position (3,) m and chest_orientation (4,) wxyz: T8 in the operator frame in the Still pose.
    still_orientation: segment → (4,) wxyz, operator frame ← segment, in the Still pose (the reference of relative orientations).
    trackers: segment → tracker's name; empty when the calibration is from segments (MVNX).
    tracker_rotation: segment → (4,) wxyz, tracker ← segment: R_segment = R_tracker · tracker_rotation is the identity facing +X in T-pose.
    hand_offset_m: side → (3,) m, the hand point in the hand tracker's (or hand segment's) own frame.
    windows_s: pose → (start, end) s of the recording, of which file is told by `input_sha256`: pose → hash.
    residuals: figures that tell how good it is: name → value, units in the names. warnings: what to be aware of.
    """

    arms: Mapping[str, ArmCalibration]
    origin: Array
    heading_rad: float
    chest_position: Array
    chest_orientation: Array
    still_orientation: Mapping[str, Array]
    trackers: Mapping[str, str] = field(default_factory=dict)
    tracker_rotation: Mapping[str, Array] = field(default_factory=dict)
    hand_offset_m: Mapping[str, Array] = field(default_factory=dict)
    windows_s: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    input_sha256: Mapping[str, str] = field(default_factory=dict)
    residuals: Mapping[str, float] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        put = FieldSetter(self).value
        if set(self.arms) != set(SIDES):
            raise InvalidDataError(f"Calibration.arms: found {sorted(self.arms)}, expected Left and Right")
        for name, shape in (("origin", (3,)), ("chest_position", (3,)), ("chest_orientation", (4,))):
            put(name, frozen_array(f"Calibration.{name}", getattr(self, name), shape))
        check_unit("Calibration.chest_orientation", self.chest_orientation, "a unit quaternion")
        if not abs(self.heading_rad) <= LARGEST_NUMBER:
            raise InvalidDataError(f"Calibration.heading_rad: found {self.heading_rad}, expected a finite angle")
        put("heading_rad", float(self.heading_rad))
        for name, shape in (("still_orientation", (4,)), ("tracker_rotation", (4,)), ("hand_offset_m", (3,))):
            values = {
                key: frozen_array(f"Calibration.{name}[{key}]", value, shape)
                for key, value in getattr(self, name).items()
            }
            if shape == (4,):
                check_segment_names(f"Calibration.{name}", values)
                for key, value in values.items():
                    check_unit(f"Calibration.{name}[{key}]", value, "a unit quaternion")
            put(name, MappingProxyType(values))
        check_segment_names("Calibration.trackers", self.trackers)
        _check_keys("Calibration.hand_offset_m", self.hand_offset_m, SIDES)
        _check_keys("Calibration.windows_s", self.windows_s, POSES)
        windows = {pose: frozen_array(f"Calibration.windows_s[{pose}]", w, (2,)) for pose, w in self.windows_s.items()}
        put("windows_s", MappingProxyType({pose: (float(w[0]), float(w[1])) for pose, w in windows.items()}))
        for residual, figure in self.residuals.items():
            if not abs(figure) <= LARGEST_NUMBER:
                raise InvalidDataError(f"Calibration.residuals[{residual}]: found {figure}, expected a finite number")
        put("residuals", MappingProxyType({residual: float(figure) for residual, figure in self.residuals.items()}))
        for name in ("arms", "trackers", "input_sha256"):
            put(name, MappingProxyType(dict(getattr(self, name))))
        put("warnings", tuple(self.warnings))

    def to_json(self) -> str:
        """The calibration as JSON text, one key per field, numbers in full precision."""
        arms = {
            side: {
                "hand_points_m": dict(zip(POSES, arm.hand_points.tolist(), strict=True)),
                "shoulder_m": arm.shoulder.tolist(),
                "length_m": arm.length_m,
                "angles_deg": dict(zip(_ANGLES, arm.angles_deg, strict=True)),
                "offsets_m": list(arm.offsets_m),
            }
            for side, arm in self.arms.items()
        }
        tables = {
            name: {
                key: value.tolist() if isinstance(value, np.ndarray) else value
                for key, value in getattr(self, name).items()
            }
            for name in _TABLES
        }
        record: dict[str, Any] = {
            "schema": SCHEMA,
            "units": UNITS,
            "arms": arms,
            "origin": self.origin.tolist(),
            "heading_rad": self.heading_rad,
            "chest_position": self.chest_position.tolist(),
            "chest_orientation": self.chest_orientation.tolist(),
            **tables,
            "warnings": list(self.warnings),
        }
        return json.dumps(record, indent=2, allow_nan=False) + "\n"


def from_json(text: str, name: str = "calibration") -> Calibration:
    """The calibration that `Calibration.to_json` wrote as `text`; `name` is what messages call the file.

    Raises `FormatError` for text that is no JSON, has another schema, lacks a key, has one too many, or holds a value that a
    calibration can't have; the place in the file stands in the message.
    """

    def refuse_constant(constant: str) -> NoReturn:
        raise FormatError(name, f"found {constant}", expected="finite numbers")

    try:
        record = json.loads(text, parse_constant=refuse_constant)
    except json.JSONDecodeError as error:
        place = f"line {error.lineno} column {error.colno}"
        raise FormatError(name, f"not JSON ({error.msg})", place=place, expected="a calibration") from None
    except FormatError:
        raise
    except ValueError:
        raise FormatError(name, "a number of thousands of digits", expected="a calibration") from None
    except RecursionError:
        raise FormatError(name, "nested too deeply", expected="a calibration") from None
    if not isinstance(record, dict) or record.get("schema") != SCHEMA:
        found = (
            f"schema {json.dumps(record['schema'])}" if isinstance(record, dict) and "schema" in record else "no schema"
        )
        raise FormatError(name, found, expected=f'"schema": "{SCHEMA}", as `retarget calibrate` writes it')
    _table(name, "", record, ("schema", "units", "arms", *_SINGLE, *_TABLES, "warnings"))
    _table(name, "arms", record["arms"], SIDES)
    try:
        arms = {side: _arm(name, f"arms.{side}", record["arms"][side]) for side in SIDES}
        for key in _TABLES:
            if not isinstance(record[key], dict):
                raise FormatError(name, f"found {_shown(record[key])}", place=key, expected="an object")
        for key in ("trackers", "input_sha256"):
            _texts(name, key, record[key].values())
        _numbers(name, "heading_rad", [record["heading_rad"]])
        _numbers(name, "residuals", record["residuals"].values())
        if not isinstance(record["warnings"], list):
            raise FormatError(name, f"found {_shown(record['warnings'])}", place="warnings", expected="a list")
        _texts(name, "warnings", record["warnings"])
        return Calibration(
            arms=arms, warnings=tuple(record["warnings"]), **{key: record[key] for key in (*_SINGLE, *_TABLES)}
        )
    except InvalidDataError as error:
        raise FormatError(name, str(error)) from None


def load(path: str | Path) -> Calibration:
    """The calibration in the JSON file `path`. Raises `UsageError` for a path that can't be opened, `FormatError` as `from_json`."""
    try:
        return from_json(Path(path).read_text(encoding="utf-8-sig"), str(path))
    except FileNotFoundError:
        near = nearest(Path(path).name, [f.name for f in Path(path).parent.glob("*.json")])
        hint = f"; did you mean {' or '.join(near)}?" if near else ""
        raise UsageError(f"{path}: no such file{hint}") from None
    except UnicodeDecodeError:
        raise FormatError(path, "not text", expected="a calibration in JSON") from None
    except IsADirectoryError:
        raise UsageError(f"{path}: is a directory; expected a calibration in JSON") from None
    except (OSError, ValueError) as error:
        reason = error.strerror.lower() if isinstance(error, OSError) and error.strerror else str(error)
        raise UsageError(f"{path}: {reason}") from None


def _arm(name: str, place: str, record: Any) -> ArmCalibration:
    _table(name, place, record, _ARM)
    _table(name, f"{place}.hand_points_m", record["hand_points_m"], POSES)
    _table(name, f"{place}.angles_deg", record["angles_deg"], _ANGLES)
    _numbers(name, f"{place}.length_m", [record["length_m"]])
    try:
        return ArmCalibration(
            hand_points=[record["hand_points_m"][pose] for pose in POSES],  # type: ignore[arg-type]  # checked and frozen there
            shoulder=record["shoulder_m"],
            length_m=float(record["length_m"]),
            angles_deg=[record["angles_deg"][pair] for pair in _ANGLES],  # type: ignore[arg-type]  # likewise
            offsets_m=record["offsets_m"],
        )
    except InvalidDataError as error:
        raise FormatError(name, str(error), place=place) from None


def _table(name: str, place: str, record: Any, keys: Iterable[str]) -> None:
    """`record` is an object with exactly these keys."""
    keys = tuple(keys)
    if not isinstance(record, dict):
        raise FormatError(name, f"found {_shown(record)}", place=place, expected=f"an object with {', '.join(keys)}")
    if unknown := [key for key in record if key not in keys]:
        near = nearest(unknown[0], keys)
        hint = f"did you mean {' or '.join(near)}?" if near else f"one of {', '.join(keys)}"
        raise FormatError(name, f"unknown key '{unknown[0]}'", place=place, expected=hint)
    if missing := [key for key in keys if key not in record]:
        raise FormatError(name, f"no key '{missing[0]}'", place=place, expected=f"all of {', '.join(keys)}")


def _numbers(name: str, place: str, values: Iterable[Any]) -> None:
    for value in values:
        # JSON knows whole numbers of any size.
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= LARGEST_NUMBER:
            raise FormatError(name, f"found {_shown(value)}", place=place, expected="a number")


def _texts(name: str, place: str, values: Iterable[Any]) -> None:
    for value in values:
        if not isinstance(value, str):
            raise FormatError(name, f"found {_shown(value)}", place=place, expected="text")


def _shown(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 40 else text[:37] + "..."


def _check_keys(field: str, table: Mapping[str, Any], keys: tuple[str, ...]) -> None:
    if unknown := [key for key in table if key not in keys]:
        raise InvalidDataError(f"{field}: found '{unknown[0]}', expected {', '.join(keys)}")
