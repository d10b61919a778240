"""The human reading of a clip's record: one line, then what deserves a warning."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

Record = Mapping[str, Any]
UNLIMITED = "reported only: no limit set"


def clip_line(record: Record) -> str:
    """One line: what was converted, how close the limbs are, whether the limits hold, the feet, the speed, the file."""
    metrics = record["metrics"]
    limbs = metrics["limb_direction_error_deg"]
    broken = metrics["position_limit_violations"] + metrics["velocity_limit_violations"]
    skate, hands = metrics["foot_skate_m_s"], metrics["hand_position_error_mm"]
    parts = [
        f"{record['input']} → {record['robot']}: {record['frames']:,} frames at {record['rate_hz']:g} Hz",
        f"limbs {degrees(limbs, 'mean')} (p95 {degrees(limbs, 'p95')})",
        *([f"hands {hands['mean']:.1f} mm (p95 {hands['p95']:.1f} mm)"] if hands else []),
        "limits kept" if not broken else f"LIMITS BROKEN {broken} times",
        *([f"skate {100 * skate['mean']:.1f} cm/s"] if skate else []),
        f"{record['frames_per_second']:,.0f} frames/s",
    ]
    return ", ".join(parts) + (f" → {record['output']}" if record["output"] != "-" else "")


def clip_notes(record: Record) -> list[str]:
    """What the reader found, what was not measured, and where the solver had to hold its last value."""
    metrics = record["metrics"]
    notes = list(record["warnings"])
    if missing := metrics["unmeasured_segments"]:
        notes.append(f"not measured, kept in the reference posture: {grouped(missing)}")
    if marked := metrics["marked_frames"]:
        notes.append(f"{marked} frames could not be solved and hold the last good posture (status 1 in the output)")
    if collided := metrics["self_collision_fraction"]:
        notes.append(
            f"links overlap by more than 20 mm in {100 * collided:.3g} % of the frames (retarget validate says which, and when)"
        )
    return notes


def stage_line(record: Record) -> str:
    """Where the time went."""
    return "  time: " + ", ".join(f"{name} {seconds:.2f} s" for name, seconds in record["stages_s"].items())


def grouped(segments: Sequence[str]) -> str:
    """Segment names with left and right of the same part said once: "LeftFoot RightFoot" → "left and right Foot"."""
    parts = []
    for name in segments:
        side = next((side for side in ("Left", "Right") if name.startswith(side)), "")
        part = name.removeprefix(side)
        both = f"Left{part}" in segments and f"Right{part}" in segments and side
        text = f"left and right {part}" if both else name
        if text not in parts:
            parts.append(text)
    return ", ".join(parts)


def degrees(statistics: Mapping[str, float | None] | None, key: str) -> str:
    """A statistic as text: "1.23°", or "–" where there is none."""
    value = statistics[key] if statistics else None
    return "–" if value is None else f"{value:.2f}°"


def number(value: float | None) -> str:
    """A number as text: three significant digits, "–" for none."""
    if value is None or not math.isfinite(value):
        return "–"
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def measured(check: Record) -> str:
    """A check's value with its unit; "–" where none could be measured."""
    return "–" if check["value"] is None else f"{number(check['value'])} {check['unit']}".rstrip()


def verdict(check: Record) -> str:
    """What a check says: "ok", "FAILED", "reported" for a value without a limit, "not made" without a value."""
    if check["passed"] is None:
        return "not made" if check["value"] is None else "reported"
    return "ok" if check["passed"] else "FAILED"


def remark(check: Record) -> str:
    """A check's note, without what its verdict says already."""
    return str(check["note"]).removesuffix(UNLIMITED).removesuffix("; ")


def table(rows: Sequence[Sequence[str]]) -> str:
    """Rows in columns, the first row and column as headings; numbers to the right."""
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    lines = []
    for row in rows:
        cells = [row[0].ljust(widths[0]), *(cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True))]
        lines.append("  ".join(cells).rstrip())
    return "\n".join(lines)
