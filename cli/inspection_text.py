"""What `retarget inspect` found, in words: (name, text) pairs for the page and the terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from retarget.cli.summary import grouped

SPANS = 4


def facts(record: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The facts that there are, in the order in which one wants to know them."""
    made = [
        ("format", " ".join(str(record[key]) for key in ("format", "version") if record.get(key))),
        ("length", f"{record['duration_s']:.2f} s, {record['frames']:,} frames at {record['rate_hz']:.5g} Hz"),
        ("clock", _clock(record.get("timing"))),
        ("robot", _robot(record)),
        ("segments", _segments(record)),
        ("trackers", _trackers(record)),
        ("gaps", _gaps(record)),
        ("person", _person(record.get("person"))),
        ("arms", _poses(record.get("poses"))),
        ("calibration poses", _calibration(record)),
        ("feet", _contacts(record)),
        ("fastest", _fastest(record.get("fastest"))),
        ("base", _base(record)),
        ("nearest its limit", _nearest_limit(record)),
    ]
    return [(name, text) for name, text in made if text]


def fit(row: Mapping[str, Any], *, hands: bool = False) -> str:
    """How a robot fits: what it follows and what of that was not measured; with `hands`, whether its hands can be placed."""
    if hands:
        return (
            "its hands can be placed"
            if row["places_hands"]
            else "its profile says nothing of arms: hands can't be placed"
        )
    if not row["lacks"]:
        return f"fits: all {row['follows']} segments that it follows were measured"
    return f"follows {row['follows']} segments; not measured: {grouped(row['lacks'])}"


def lines(record: Mapping[str, Any], width: int = 0) -> list[str]:
    """Facts, doubts, suggestions and robots as aligned lines for a terminal."""
    rows = facts(record)
    fitting = [row["robot"] for row in record.get("robots", ()) if not row["lacks"]]
    others = [row["robot"] for row in record.get("robots", ()) if row["lacks"]]
    if record.get("calibrated"):
        placed = [row["robot"] for row in record["robots"] if row["places_hands"]]
        rows.append(("robots to place hands", ", ".join(placed)))
    elif record.get("robots"):
        partly = f"partly: {', '.join(others)}" if others else ""
        rows.append(
            ("robots that fit", "; ".join(part for part in (", ".join(fitting) or "none wholly", partly) if part))
        )
    width = max([width, *(len(name) for name, _ in rows)])
    out = [f"  {name:<{width}}  {text}" for name, text in rows]
    out += [f"  {'beware' if i == 0 else '':<{width}}  {text}" for i, text in enumerate(record["doubts"])]
    for i, suggestion in enumerate(record["suggestions"]):
        out.append(f"  {'suggested' if i == 0 else '':<{width}}  {suggestion['option']}")
        out.append(f"  {'':<{width}}    {suggestion['why']}")
    return out


def _clock(timing: Mapping[str, Any] | None) -> str:
    if not timing or not timing["usual_step_s"]:
        return ""
    if not timing["uneven_steps"]:
        return "even"
    return (
        f"{timing['uneven_steps']} uneven steps, {1000 * timing['shortest_step_s']:.3g} to "
        f"{1000 * timing['longest_step_s']:.3g} ms, usually {1000 * timing['usual_step_s']:.3g} ms"
    )


def _segments(record: Mapping[str, Any]) -> str:
    segments = record.get("segments")
    if not isinstance(segments, Sequence):
        return ""
    unmeasured = record.get("unmeasured_segments", ())
    if not unmeasured:
        return f"{len(segments)}, all measured"
    return f"{len(segments)}, of them not measured: {grouped(unmeasured)}"


def _trackers(record: Mapping[str, Any]) -> str:
    if "trackers" not in record:
        return ""
    roles, tracked = record.get("segments", {}), record.get("tracked_fraction", {})
    parts = []
    for name in record["trackers"]:
        role = f" on {roles[name]}" if name in roles else ""
        share = tracked.get(name, 1.0)
        parts.append(f"{name}{role}" + (f" ({100 * share:.1f} % tracked)" if share < 1 else ""))
    return f"{len(parts)}: {', '.join(parts)}"


def _gaps(record: Mapping[str, Any]) -> str:
    if "gaps" not in record:
        return ""
    gaps = record["gaps"]
    if not gaps:
        return "none"
    longest = max(gaps, key=lambda gap: gap.get("duration_s", 0.0))
    where = longest.get("tracker") or grouped(longest.get("segments", ())) or longest.get("kind", "")
    return (
        f"{len(gaps)}, the longest {longest.get('duration_s', 0.0):.3g} s from {longest.get('start_s', 0.0):.2f} s on"
        + (f" ({where})" if where else "")
    )


def _person(person: Mapping[str, Any] | None) -> str:
    if person is None:
        return ""
    parts = []
    if person["stature_m"] is not None:
        parts.append(f"about {person['stature_m']:.2f} m tall")
    if person["upright"] is not None:
        upright = person["upright"]
        parts.append(
            "upright" if upright > 0.8 else "bent" if upright > 0.3 else "lying" if upright > -0.3 else "upside down"
        )
    if person["heading_deg"] is not None:
        heading = person["heading_deg"]
        turned = heading["max"] - heading["min"]
        parts.append(
            f"faces {round(heading['first']) + 0}° from X at first"
            + (f", turns over {turned:.0f}°" if turned > 10 else "")
        )
    if person["travel_m"] is not None:
        parts.append(f"walks {person['travel_m']:.1f} m" if person["travel_m"] > 0.5 else "stays in place")
    return ", ".join(parts)


def _poses(poses: Mapping[str, Any] | None) -> str:
    found = [f"{name} {_spans(spans)}" for name, spans in (poses or {}).items() if spans]
    if poses is not None and not found:
        return "no T-pose, N-pose or arms forward" if poses else ""
    return "; ".join(found)


def _calibration(record: Mapping[str, Any]) -> str:
    if "calibration_poses" not in record:
        return ""
    poses = record["calibration_poses"]
    if not poses:
        return f"not found: {record.get('calibration_poses_problem', '')}"
    return ", ".join(f"{name} {_spans([span])}" for name, span in poses.items())


def _spans(spans: Sequence[Sequence[float]]) -> str:
    more = f" and {len(spans) - SPANS} more" if len(spans) > SPANS else ""
    return ", ".join(f"{start:.1f}-{end:.1f} s" for start, end in spans[:SPANS]) + more


def _contacts(record: Mapping[str, Any]) -> str:
    if "contacts" not in record:
        return ""
    contacts = record["contacts"]
    if contacts is None:
        return "not measured"
    steps = contacts["steps"]
    return (
        f"contacts {contacts['source']}: {steps['Left']} left and {steps['Right']} right steps, "
        f"a foot on the ground {100 * contacts['on_ground_fraction']:.0f} % of the time"
    )


def _fastest(rows: Sequence[Mapping[str, Any]] | None) -> str:
    parts = []
    for row in (rows or ())[:3]:
        speed = f", {row['m_s']:.1f} m/s" if row["m_s"] is not None else ""
        parts.append(f"{row['name']} {row['rad_s']:.1f} rad/s{speed}")
    return "; ".join(parts)


def _robot(record: Mapping[str, Any]) -> str:
    if record.get("kind") != "trajectory":
        return ""
    stated, checked = record.get("robot") or "not stated", record.get("checked_against")
    joints = f"{len(record['joints'])} joints"
    return f"{stated}, {joints}" + (f", taken for {checked}" if checked and checked != record.get("robot") else "")


def _base(record: Mapping[str, Any]) -> str:
    return f"{record['base']} ({record.get('base_frame', '')})" if "base" in record else ""


def _nearest_limit(record: Mapping[str, Any]) -> str:
    rows = [row for row in record.get("joint_ranges", ()) if "lower" in row]
    if not rows:
        return ""
    closest = min(rows, key=lambda row: min(row["min"] - row["lower"], row["upper"] - row["max"]))
    fastest = max(rows, key=lambda row: row["speed_ratio"])
    left = min(closest["min"] - closest["lower"], closest["upper"] - closest["max"])
    return f"{closest['joint']} ({left:.3f} rad left); fastest {fastest['joint']} at {100 * fastest['speed_ratio']:.0f} % of its speed limit"
