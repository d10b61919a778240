"""What `retarget compare` found, as JSON-able facts and as tables of text."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from retarget.cli import summary
from retarget.core.calibration import SIDES
from retarget.core.experiments import ORIGINAL
from retarget.core.mapping.arm_frames import arm_frames

if TYPE_CHECKING:
    from retarget.cli.compare import Clip, Comparison
    from retarget.core.comparison import Similarity
    from retarget.core.types import Array

Rows = list[list[str]]

ANGLES = ("still_tpose", "tpose_forward", "forward_still")
ANGLE_TITLES = ("Still to T-pose", "T-pose to Forward", "Forward to Still")
LINE_TITLES = {"Arm": "arm", "UpperArm": "upper arm", "ForeArm": "forearm"}


def record(comparison: Comparison) -> dict[str, Any]:
    """The JSON object. "circles" is null where neither hand drew any."""
    from retarget.core.comparison import SQUARE_M

    calibration, arms = comparison.calibration, arm_frames(comparison.model)
    circles = {
        side.lower(): {"window_s": list(found.window_s), "index": dict(found.index), "change": change(found.index)}
        for side, found in comparison.circles.items()
    }
    squares = {
        side.lower(): {"edges_m": list(s.edges_m), "corner_deg": s.corner_deg, "tilt_deg": s.tilt_deg}
        for side, s in comparison.squares.items()
    }
    return {
        "robot": comparison.model.profile.name,
        "operator": {
            side.lower(): {
                "arm_length_m": calibration.arms[side].length_m,
                "angles_deg": dict(zip(ANGLES, calibration.arms[side].angles_deg, strict=True)),
            }
            for side in SIDES
        },
        "robot_arm_length_m": {side.lower(): arm.length_m for side, arm in arms.items()},
        "circles": {"input": comparison.circles_name, **circles} if circles else None,
        "square": {"side_m": SQUARE_M, **squares},
        "similarity": [_clip_record(clip) for clip in comparison.clips],
        "notes": list(comparison.notes),
    }


def change(index: Mapping[str, float]) -> dict[str, float | None]:
    """Mapping → how much its index differs from the operator's own, as a part of that; None where that is zero."""
    own = index[ORIGINAL]
    return {name: value / own - 1 if own > 1e-12 else None for name, value in index.items() if name != ORIGINAL}


def _clip_record(clip: Clip) -> dict[str, Any]:
    return {
        "input": clip.name,
        "frames": clip.motion.frames,
        "rate_hz": clip.motion.rate_hz,
        "variants": [
            {
                "name": result.variant.name,
                "mapping": result.variant.mapping,
                "settings": dict(result.variant.settings),
                "arm_direction_error_deg": {
                    **{LINE_TITLES[line].replace(" ", "_"): statistics(both(result, line)) for line in LINE_TITLES},
                    "per_line": {name: statistics([error]) for name, error in result.errors_deg.items()},
                },
                "hand_position_error_mm": statistics(1000 * error for error in result.hand_error_m.values()),
                "unsolved_frames": result.unsolved_frames,
            }
            for result in clip.results
        ],
    }


def both(result: Similarity, line: str) -> list[Array]:
    """Errors of one of `LINES`, of the sides that have it."""
    return [result.errors_deg[side + line] for side in SIDES if side + line in result.errors_deg]


def statistics(series: Iterable[Array]) -> dict[str, float] | None:
    """Mean, 95th percentile and maximum of several series together; None of none."""
    values = [np.asarray(values) for values in series]
    if not values:
        return None
    every = np.concatenate(values)
    return {"mean": float(every.mean()), "p95": float(np.percentile(every, 95)), "max": float(every.max())}


def tables(comparison: Comparison) -> list[tuple[str, Rows]]:
    """(title, rows), the first row of each and the first of its columns being headings."""
    facts = record(comparison)
    found = [
        ("operator and robot", _arms(facts)),
        (_square_title(facts), _squares(facts)),
    ]
    if facts["circles"]:
        found.insert(1, (f"circle index, {comparison.circles_name}", _circles(facts["circles"])))
    for clip in facts["similarity"]:
        title = f"arm direction error in degrees, {clip['input']}: {clip['frames']} frames at {clip['rate_hz']:.4g} Hz"
        found.append((title, _similarity(clip)))
    return found


def text(comparison: Comparison) -> str:
    """The tables for a terminal."""
    return "\n\n".join(f"{title}\n{summary.table(_indented(rows))}" for title, rows in tables(comparison))


def _indented(rows: Rows) -> Rows:
    return [[f"  {row[0]}", *row[1:]] for row in rows]


def _arms(facts: Mapping[str, Any]) -> Rows:
    operator, robot = facts["operator"], facts["robot_arm_length_m"]
    sides = [side.lower() for side in SIDES]
    rows = [["", *sides], ["operator's arm", *(f"{operator[side]['arm_length_m']:.4f} m" for side in sides)]]
    for title, key in zip(ANGLE_TITLES, ANGLES, strict=True):
        rows.append([title, *(f"{operator[side]['angles_deg'][key]:.2f}°" for side in sides)])
    return [*rows, [f"{facts['robot']}'s arm", *(f"{robot[side]:.4f} m" for side in sides)]]


def _circles(circles: Mapping[str, Any]) -> Rows:
    sides = [side.lower() for side in SIDES if side.lower() in circles]
    rows = [["", *sides]]
    rows.append(["drawn", *("{:.2f}:{:.2f} s".format(*circles[side]["window_s"]) for side in sides)])
    for name in circles[sides[0]]["index"]:
        cells = []
        for side in sides:
            part = circles[side]["change"].get(name)
            # A rotation's rounding is no change: -0.0 % would read like one.
            percent = "" if part is None else f" ({100 * part + 0.0:+.1f} %)" if abs(part) >= 5e-4 else " (same)"
            cells.append(f"{circles[side]['index'][name]:.4f}{percent or ' ' * 9}")
        rows.append([name, *cells])
    return rows


def _square_title(facts: Mapping[str, Any]) -> str:
    return f"ideal square of {facts['square']['side_m']:g} m by hand_position"


def _squares(facts: Mapping[str, Any]) -> Rows:
    sides = [side.lower() for side in SIDES]
    squares = [facts["square"][side] for side in sides]
    return [
        ["", *sides],
        ["edge across", *(f"{s['edges_m'][0]:.4f} m" for s in squares)],
        ["edge down", *(f"{s['edges_m'][1]:.4f} m" for s in squares)],
        ["corner", *(f"{s['corner_deg']:.2f}°" for s in squares)],
        ["out of the frontal plane", *(f"{s['tilt_deg']:.2f}°" for s in squares)],
    ]


def _similarity(clip: Mapping[str, Any]) -> Rows:
    """Means with 95th percentiles."""
    rows = [["mean (p95)", *LINE_TITLES.values(), "hand off target", "frames not solved"]]
    for variant in clip["variants"]:
        errors = variant["arm_direction_error_deg"]
        cells = [_mean(errors[title.replace(" ", "_")]) for title in LINE_TITLES.values()]
        hand = _mean(variant["hand_position_error_mm"])
        rows.append([variant["name"], *cells, f"{hand} mm" if hand != "–" else hand, str(variant["unsolved_frames"])])
    return rows


def _mean(values: Mapping[str, float] | None) -> str:
    return "–" if values is None else f"{values['mean']:.1f} ({values['p95']:.1f})"
