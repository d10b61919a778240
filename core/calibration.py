"""Who the operator is: shoulders, arm lengths and the three calibration poses of [Lim2022 sec. II-B], as one JSON file.

All points are metres in the **operator frame**: turned about world Z only, so that the person faced +X in the Still pose, Y left, Z up;
its origin is fixed in the world where the person's pelvis was in the Still pose (`origin`).
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from retarget.core.errors import InvalidDataError
from retarget.core.field_checks import FieldSetter, check_segment_names, check_unit, frozen_array

Array = NDArray[np.float64]

SIDES = ("Left", "Right")
POSES = ("still", "tpose", "forward")
"""S, T and F of [Lim2022 fig. 3]: arms down, arms out to the sides, arms forward."""

SCHEMA = "retarget.calibration/1"


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
        if not np.isfinite(self.heading_rad):
            raise InvalidDataError(f"Calibration.heading_rad: found {self.heading_rad}, expected a finite angle")
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
        for name in ("arms", "trackers", "windows_s", "input_sha256", "residuals"):
            put(name, MappingProxyType(dict(getattr(self, name))))
        put("warnings", tuple(self.warnings))

    def to_json(self) -> str:
        """The calibration as JSON text, one key per field, numbers in full precision."""
        arms = {
            side: {
                "hand_points_m": dict(zip(POSES, arm.hand_points.tolist(), strict=True)),
                "shoulder_m": arm.shoulder.tolist(),
                "length_m": arm.length_m,
                "angles_deg": dict(zip(("still_tpose", "tpose_forward", "forward_still"), arm.angles_deg, strict=True)),
                "offsets_m": list(arm.offsets_m),
            }
            for side, arm in self.arms.items()
        }
        tables = {
            name: {
                key: value.tolist() if isinstance(value, np.ndarray) else value
                for key, value in getattr(self, name).items()
            }
            for name in (
                "still_orientation",
                "trackers",
                "tracker_rotation",
                "hand_offset_m",
                "windows_s",
                "input_sha256",
                "residuals",
            )
        }
        record: dict[str, Any] = {
            "schema": SCHEMA,
            "units": "m, rad, s; quaternions wxyz; operator frame: X forward, Y left, Z up",
            "arms": arms,
            "origin": self.origin.tolist(),
            "heading_rad": self.heading_rad,
            "chest_position": self.chest_position.tolist(),
            "chest_orientation": self.chest_orientation.tolist(),
            **tables,
            "warnings": list(self.warnings),
        }
        return json.dumps(record, indent=2, allow_nan=False) + "\n"
