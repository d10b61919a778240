"""How much a validation lets pass: defaults, a TOML file over them, single `NAME=VALUE` over that.

Every threshold is a maximum: a check passes while its value is not above it. Defaults hold for any humanoid; where what is
sensible depends on the robot or the task, there is none, and the value is only reported until someone sets one.

```toml
# Above the tables: every mode that has the name. In a table: that mode only. "none" = report, don't judge.
position_limit_violations = 0
[kinematic]
ground_penetration_mm = 5.0
acceleration_max_rad_s2 = "none"
[fixed]
joint_tracking_rmse_deg = 0.5
```
The rows of `TABLE` are the documentation: name, unit, default, and why.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

from retarget.core.errors import ProfileError, UnknownNameError, UsageError
from retarget.core.report import Check

NONE = "none"
"""What stands for "no limit" in files and on the command line."""
LARGEST_LIMIT = 1e300
"""TOML knows whole numbers of any size, infinity and nan."""
ROUNDING = 1e-9
"""A value this much above its limit, relative to it, is the same number, differently rounded."""


@dataclass(frozen=True)
class Threshold:
    """One row of the table. limit: the default maximum in `unit`, None = reported only. why: the reason for the default."""

    name: str
    unit: str
    limit: float | None
    why: str


KINEMATIC = (
    Threshold("position_limit_violations", "", 0, "joint values outside their range can't be reached; no tolerance"),
    Threshold("position_limit_excess_deg", "deg", 0, "how far outside: tells a rounding from a wrong joint"),
    Threshold("coupled_limit_excess_deg", "deg", 0, "joints that share a mechanism limit each other as hard as a stop"),
    Threshold("velocity_limit_violations", "", 0, "steps that the motor can't make in time; no tolerance"),
    Threshold("velocity_ratio_max", "", 1, "fastest step beside the joint's speed limit"),
    Threshold("velocity_mismatch_percent", "%", 40, "stored velocities beside those of the positions, rms: differences of good files stay below "
              "10 %, double rate gives 50 %"),
    Threshold("acceleration_max_rad_s2", "rad/s²", 500, "people's fastest joint motions stay below 250; a limb of 1 kg m² at 500 "
              "would need 500 Nm"),
    Threshold("jerk_rms_rad_s3", "rad/s³", 1500, "retargeted walking has 300 to 400; a tracker's noise that was not filtered has thousands"),
    Threshold("jerk_max_rad_s3", "rad/s³", None, "grows with the cube of the frame rate: only comparable between clips of one rate"),
    Threshold("joint_jump_max_rad", "rad", 0.3, "a step that stands out from the steps around it; at 30 Hz the fastest motions reach 0.2"),
    Threshold("joints_off_written_range", "", 0, "a joint outside the range that its file says it was written with is another joint, or was changed "
              "since"),
    Threshold("self_collision_depth_mm", "mm", 20, "of convex hulls, which overlap up to 18 mm deeper than the links' meshes (measured on G1, iCub, TALOS); deeper ones "
              "are believed only if the meshes meet"),
    Threshold("self_collision_percent", "%", None, "part of the frames in which links touch: how much of it is a touch that was meant "
              "(hands folded) only the author knows"),
    Threshold("ground_penetration_mm", "mm", 10, "what soles and a controller's compliance forgive"),
    Threshold("feet_floating_mm", "mm", 30, "both soles this high for 0.6 s: the flight of the highest jump of people lasts that long"),
    Threshold("foot_skate_m_s", "m/s", 0.15, "speed a standing sole keeps for 0.1 s; a foot that is lifted passes the lowest "
              "centimetre in less"),
    Threshold("base_tilt_deg", "deg", 100, "lying and bowing are motions, standing on the head is a wrong quaternion"),
    Threshold("base_speed_max_m_s", "m/s", 5, "humanoids run at up to 4; a base that teleports has tens"),
    Threshold("base_turn_max_rad_s", "rad/s", 15, "people turn at up to 10; a flipped orientation has 100 and more"),
    Threshold("base_jump_max_m", "m", 0.1, "a step that stands out from the steps around it, as for joints"),
    Threshold("base_quaternion_swapped", "", 0, "1 where the base passes only with the quaternion's components in the other order"),
    Threshold("limb_direction_error_deg", "deg", 45, "the worst limb beside the person's, in 95 % of the frames: good clips stay below 40, "
              "joints that changed places reach 60 and more; mappings that follow hands alone leave elbows free and need more"),
    Threshold("time_gap_ratio", "", 2.5, "longest time between frames beside the median: one lost frame is 2, and bridged"),
    Threshold("marked_frames", "", 0, "frames that the solver gave up hold an older posture"),
)  # fmt: skip

FIXED = (
    Threshold("simulation_lost_s", "s", 0, "what the simulation never reached because it blew up has no verdict"),
    Threshold("joint_tracking_rmse_deg", "deg", 3, "over all joints; with gravity compensated, good gains stay below 1"),
    Threshold("joint_tracking_peak_deg", "deg", 15, "one joint, one moment: an arm that is off by more looks different"),
    Threshold("joint_tracking_rmse_mm", "mm", 10, "of sliding joints, for robots that have some"),
    Threshold("joint_tracking_peak_mm", "mm", 50, "of sliding joints, for robots that have some"),
    Threshold("torque_saturation_percent", "%", 1, "part of the time with any joint at its limit: touching it is use, staying there is failure"),
    Threshold("torque_peak_ratio", "", None, "largest torque beside the joint's limit; saturation says whether it mattered"),
    Threshold("reference_torque_ratio_max", "", None, "torque that the motion itself asks for, by inverse dynamics, beside the limit: above 1 no controller "
              "can follow just then, below it saturation is the controller's doing"),
    Threshold("torque_rms_nm", "Nm", None, "of the joint that works hardest; what heats a motor depends on the motor"),
    Threshold("power_peak_w", "W", None, "mechanical, all motors that give power together; what the supply bears depends on the robot"),
    Threshold("power_mean_w", "W", None, "mechanical, given by the motors"),
    Threshold("energy_j", "J", None, "grows with the clip's length"),
    Threshold("energy_balance_error_j", "J", None, "the integrator's own error, beside the work that the note tells"),
)  # fmt: skip

TABLE: Mapping[str, tuple[Threshold, ...]] = MappingProxyType({"kinematic": KINEMATIC, "fixed": FIXED})
"""Mode → its thresholds, in the order in which they are reported."""


@dataclass(frozen=True)
class Thresholds:
    """The limits of one mode. limits: name → maximum, None = reported only; absent names have their default.

    Raises `UnknownNameError` for an unknown mode or name, `UsageError` for a limit that is no number ≥ 0.
    """

    mode: str
    limits: Mapping[str, float | None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        rows = _rows(self.mode)
        for name, limit in self.limits.items():
            if name not in rows:
                raise _unknown(name, rows, "")
            _checked(limit, name)
        merged = {name: row.limit for name, row in rows.items()} | dict(self.limits)
        object.__setattr__(self, "limits", MappingProxyType(merged))

    @classmethod
    def load(cls, path: str | Path, mode: str) -> Thresholds:
        """The defaults of `mode` with what the TOML file at `path` says laid over them; tables of other modes are checked, too."""
        return cls(mode, _read(Path(path), mode))

    def overridden(self, texts: Iterable[str]) -> Thresholds:
        """With each "NAME=VALUE" of `texts` laid over, the last one winning. VALUE: a number ≥ 0, or "none"."""
        changed = dict(self.limits)
        for text in texts:
            name, equals, value = (part.strip() for part in text.partition("="))
            if not equals:
                raise UsageError(f"threshold '{text}': expected NAME=VALUE, for example {next(iter(self.limits))}=1")
            if name not in changed:
                raise _unknown(name, _rows(self.mode), "")
            changed[name] = _parsed(value, name)
        return Thresholds(self.mode, changed)

    def check(
        self, name: str, value: float | None, note: str = "", *, where: str = "", time_s: float | None = None
    ) -> Check:
        """`value` judged against the limit of `name`, a name of this mode.

        where, time_s: the joint, link or pair at fault, and when; None and "" are left out of the note. A value of None says that the
        check could not be made, and `note` why.
        """
        row, limit = _rows(self.mode)[name], self.limits[name]
        at = " ".join([*([where] if where else []), *([f"at {time_s:.3f} s"] if time_s is not None else [])])
        words = [part for part in (at, note) if part]
        passed = None
        if value is not None and limit is not None:
            passed = bool(value <= limit + ROUNDING * abs(limit))
        elif value is not None:
            words.append("reported only: no limit set")
        return Check(name, value, row.unit, limit, passed, "; ".join(words), where, time_s)


def modes_of(name: str) -> tuple[str, ...]:
    """The modes that have a threshold called `name`, none for an unknown one."""
    return tuple(mode for mode, rows in TABLE.items() if any(row.name == name for row in rows))


def _rows(mode: str) -> dict[str, Threshold]:
    if mode not in TABLE:
        raise UnknownNameError("validation mode", mode, TABLE)
    return {row.name: row for row in TABLE[mode]}


def _unknown(name: str, rows: Mapping[str, Threshold], where: str) -> UsageError:
    """The name is none of this mode's: another mode's, or nobody's."""
    if modes := modes_of(name):
        return UsageError((f"{where}: " if where else "") + f"threshold '{name}' belongs to mode {' and '.join(modes)}")
    return UnknownNameError("threshold", name, rows, where=where)


def _read(path: Path, mode: str) -> dict[str, float | None]:
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8"))
    except (
        OSError,
        ValueError,
        RecursionError,
    ) as error:  # ValueError: no TOML, no UTF-8, numbers of thousands of digits
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise ProfileError(path, f"no readable thresholds: {reason}") from None
    everywhere: dict[str, float | None] = {}
    tables: dict[str, dict[str, float | None]] = {}
    for key, value in document.items():
        if not isinstance(value, dict):
            if not modes_of(key):
                raise UnknownNameError(
                    "threshold", key, sorted({r.name for t in TABLE.values() for r in t}), where=str(path)
                )
            everywhere[key] = _parsed(value, key, f"{path}, ")
            continue
        if key not in TABLE:
            raise UnknownNameError("validation mode", key, TABLE, where=str(path))
        rows = _rows(key)
        for name in value:
            if name not in rows:
                raise _unknown(name, rows, f"{path}, [{key}]")
        tables[key] = {name: _parsed(limit, name, f"{path}, [{key}] ") for name, limit in value.items()}
    own = _rows(mode)
    return {name: limit for name, limit in everywhere.items() if name in own} | tables.get(mode, {})


def _parsed(value: Any, name: str, where: str = "") -> float | None:
    """A limit as text or TOML gives it."""
    if isinstance(value, str):
        if value.casefold() == NONE:
            return None
        try:
            value = float(value)
        except ValueError:
            raise UsageError(f"{where}{name}: found '{value}', expected a number ≥ 0 or \"{NONE}\"") from None
    _checked(value, name, where)
    return float(value)


def _checked(limit: Any, name: str, where: str = "") -> None:
    if limit is None:
        return
    if isinstance(limit, bool) or not isinstance(limit, int | float) or not 0 <= limit <= LARGEST_LIMIT:
        raise UsageError(f'{where}{name}: found {limit!r}, expected a number ≥ 0 or "{NONE}"')
