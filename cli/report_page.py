"""The HTML report: numbers, pictures and plots of converted clips in one file, without scripts or anything fetched from elsewhere."""

from __future__ import annotations

import base64
import html
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from retarget.cli import figures, stick_figures
from retarget.cli.plan import write_whole
from retarget.core.errors import UsageError

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from retarget.core.pipeline import ConvertResult
    from retarget.core.robot_model import RobotModel

CSS = """
:root { color-scheme: light; }
body { font: 15px/1.5 system-ui, sans-serif; color: #2b2f36; background: #fff; margin: 0 auto; max-width: 72rem; padding: 1.5rem; }
h1 { font-size: 1.6rem; margin: 0 0 .3rem; } h2 { font-size: 1.25rem; margin: 2.6rem 0 .4rem; border-top: 1px solid #d7dbe0;
padding-top: 1.2rem; } h3 { font-size: 1rem; margin: 1.6rem 0 .2rem; }
p, figure { margin: .3rem 0; } .note { color: #5b636e; font-size: .9rem; overflow-wrap: anywhere; }
img { width: 100%; height: auto; display: block; }
.scroll { overflow-x: auto; } table { border-collapse: collapse; font-variant-numeric: tabular-nums; margin: .6rem 0; }
th, td { text-align: right; padding: .22rem .9rem .22rem 0; border-bottom: 1px solid #e7eaee; font-weight: normal; white-space: nowrap; }
th:first-child { text-align: left; } thead th { color: #5b636e; } .bad { color: #b3261e; font-weight: 600; }
"""


@dataclass(frozen=True)
class Section:
    """One clip on one robot. title: its heading. output: the trajectory file's name, as text."""

    title: str
    result: ConvertResult
    model: RobotModel
    output: str = ""


def write_page(
    path: Path,
    sections: Sequence[Section],
    *,
    heading: str = "Retargeting report",
    note: str = "",
    overwrite: bool = False,
) -> None:
    """Write the page of `sections` to `path`, whole or not at all. Raises `UsageError` when it exists and `overwrite` is not set."""
    if os.path.lexists(path) and not overwrite:
        raise UsageError(f"{path}: exists; --force replaces it")
    write_whole(path, page(sections, heading, note).encode())


def page(sections: Sequence[Section], heading: str, note: str = "") -> str:
    """The HTML text. note: a line under the heading."""
    return document(heading, note, [_overview(sections), *(_section(section) for section in sections)])


def document(heading: str, note: str, parts: Sequence[str], style: str = "") -> str:
    """A whole page: `heading`, under it the line `note` ("" for none), then the HTML `parts`. style: CSS beyond that of all pages."""
    introduction = f'<p class="note">{html.escape(note)}</p>' if note else ""
    body = "\n".join([f"<h1>{html.escape(heading)}</h1>", introduction, *parts])
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{html.escape(heading)}</title>\n<style>{CSS}{style}</style>\n</head>\n<body>\n{body}\n</body>\n</html>\n"
    )


def picture(title: str, caption: str, figure: Figure, alt: str) -> str:
    """A figure with its title and caption; `alt` is what stands for the picture where there is none."""
    data = base64.b64encode(figures.svg(figure)).decode()
    # An image of its own, not inline SVG: identifiers of several figures in one document would collide.
    image = f'<img alt="{html.escape(alt)}" src="data:image/svg+xml;base64,{data}">'
    return f'<figure><h3>{html.escape(title)}</h3><p class="note">{html.escape(caption)}</p>{image}</figure>'


def figures_of(result: ConvertResult, model: RobotModel) -> list[tuple[str, str, Figure]]:
    """(title, caption, figure) of everything a clip has to show."""
    makers: list[tuple[str, str, Callable[[], Figure | None]]] = [
        (
            "Person and robot",
            "Joint centres of the person (grey) and the robot (blue) at the same instants, to one scale, seen from front right.",
            lambda: stick_figures.strip([result]),
        ),
        (
            "Limb direction error",
            "Angle between the person's and the robot's joint-centre lines.",
            lambda: figures.limbs(result),
        ),
        ("Feet", "Lowest corner of each sole, and how fast a sole on the ground slides.", lambda: figures.feet(result)),
        ("Joints", "Every joint of the written trajectory between its limits.", lambda: figures.joints(result, model)),
        ("Joint speeds", "1 would be a joint at its velocity limit.", lambda: figures.speeds(result, model)),
    ]
    made = [(title, caption, make()) for title, caption, make in makers]
    return [(title, caption, figure) for title, caption, figure in made if figure is not None]


def _overview(sections: Sequence[Section]) -> str:
    rows = {
        section.title: overview_values(section.result.metrics, section.result.trajectory.frames) for section in sections
    }
    names = list(next(iter(rows.values())))
    head = "".join(f"<th>{html.escape(title)}</th>" for title in rows)
    lines = []
    for name in names:
        cells = "".join(f"<td{_mark(name, rows[title][name])}>{html.escape(rows[title][name])}</td>" for title in rows)
        lines.append(f"<tr><th>{html.escape(name)}</th>{cells}</tr>")
    return f'<div class="scroll"><table><thead><tr><th></th>{head}</tr></thead><tbody>{"".join(lines)}</tbody></table></div>'


def overview_values(metrics: Mapping[str, Any], frames: int) -> dict[str, str]:
    """Name → text of the numbers that sum a clip up."""
    limbs, links = metrics["limb_direction_error_deg"], metrics["orientation_error_deg"]
    skate, depth = metrics["foot_skate_m_s"], metrics["ground_penetration_mm"]
    return {
        "frames": f"{frames:,}",
        "limb direction error, mean (p95)": f"{_number(limbs['mean'], '.2f')}° ({_number(limbs['p95'], '.2f')}°)",
        "link orientation error, mean (p95)": f"{_number(links['mean'], '.2f')}° ({_number(links['p95'], '.2f')}°)",
        "position limits broken": str(metrics["position_limit_violations"]),
        "velocity limits broken": str(metrics["velocity_limit_violations"]),
        "fastest joint, part of its limit": _number(metrics["max_velocity_ratio"], ".2f"),
        "jerk, rms": f"{_number(metrics['jerk_rms_rad_s3'], ',.0f')} rad/s³",
        "foot skating, mean": f"{100 * skate['mean']:.2f} cm/s" if skate else "–",
        "ground penetration, greatest": f"{depth['max']:.1f} mm" if depth else "–",
        "frames not solved": str(metrics["marked_frames"]),
    }


def _section(section: Section) -> str:
    result = section.result
    trajectory, source = result.trajectory, result.motion.source
    facts = [f"{trajectory.frames} frames at {trajectory.rate_hz:g} Hz", f"{len(trajectory.joint_names)} joints"]
    if section.output:
        facts.append(f"written to {section.output}")
    if source.sha256:
        facts.append(f"recording sha256 {source.sha256[:16]}…")
    parts = [
        f"<section>\n<h2>{html.escape(section.title)}</h2>",
        f'<p class="note">{html.escape("; ".join(facts))}</p>',
    ]
    if missing := result.metrics["unmeasured_segments"]:
        parts.append(
            f'<p class="note">Not measured, kept in the reference posture: {html.escape(", ".join(missing))}</p>'
        )
    for title, caption, figure in figures_of(result, section.model):
        parts.append(picture(title, caption, figure, f"{title}, {section.title}"))
    return "\n".join([*parts, "</section>"])


def _mark(name: str, value: str) -> str:
    return ' class="bad"' if ("broken" in name or "not solved" in name) and value != "0" else ""


def _number(value: float | None, spec: str) -> str:
    return "–" if value is None else format(value, spec)
