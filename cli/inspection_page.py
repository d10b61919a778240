"""The HTML page of `retarget inspect`: one file's facts, doubts, suggested options and pictures, self-contained and without scripts."""

from __future__ import annotations

import html
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from retarget.cli import figures, inspection_figures, inspection_text
from retarget.cli.report_page import document, picture
from retarget.core.inspection import MotionFindings, TrackerFindings
from retarget.core.types import HumanMotion, JointTrajectory, TrackerRecording

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from retarget.cli.inspection import Inspection

STYLE = """<style>td, th { vertical-align: top; } .facts td { text-align: left; white-space: normal; max-width: 52rem; }
li { margin: .15rem 0; } code { background: #f1f3f5; padding: .05rem .3rem; border-radius: .2rem; overflow-wrap: anywhere; }
.joints td:nth-child(2) { padding-right: 1.6rem; }</style>"""

TRACKED = "Blue: measured. Orange: lost, interpolated or held."


def page(found: Inspection) -> str:
    """The HTML text."""
    record = found.record
    parts = [STYLE, _facts(record)]
    if record["doubts"]:
        items = "".join(f"<li>{html.escape(text)}</li>" for text in record["doubts"])
        parts.append(f"<h2>To be aware of</h2>\n<ul>{items}</ul>")
    if record["suggestions"]:
        items = "".join(
            f"<li><code>{html.escape(s['option'])}</code> {html.escape(s['why'])}</li>" for s in record["suggestions"]
        )
        parts.append(f"<h2>Suggested</h2>\n<ul>{items}</ul>")
    title = "stdin" if found.path == "-" else found.path
    pictures = [picture(name, caption, figure, name) for name, caption, figure in _figures(found)]
    if pictures:
        parts += ["<h2>Over time</h2>", *pictures]
    if record.get("checked_against") and "lower" in record["joint_ranges"][0]:
        parts += ["<h2>Joint ranges</h2>", _joints(record)]
    if record.get("robots"):
        parts += ["<h2>Robots</h2>", _robots(record)]
    return document(title.rsplit("/", 1)[-1], f"Inspected before conversion: {title}", parts)


def _facts(record: Mapping[str, Any]) -> str:
    rows = "".join(
        f"<tr><th>{html.escape(name)}</th><td>{html.escape(text)}</td></tr>"
        for name, text in inspection_text.facts(record)
    )
    return f'<div class="scroll"><table class="facts"><tbody>{rows}</tbody></table></div>'


def _figures(found: Inspection) -> list[tuple[str, str, Figure]]:
    data, findings, made = found.data, found.findings, list[tuple[str, str, "Figure | None"]]()
    plots = inspection_figures
    if isinstance(data, HumanMotion) and isinstance(findings, MotionFindings):
        gaps = found.record.get("gaps", ())
        made += [
            ("Person", "At evenly spaced instants, seen from front right; the far side paler.", plots.person(data)),
        ]
        if found.trackers is not None:
            made.append(("Tracked", TRACKED, plots.tracked(found.trackers)))
        else:
            figure = plots.measured(data, [gap for gap in gaps if "segments" in gap])
            made.append(
                ("Measured", "Blue: measured. Orange: missing, interpolated. A thin line: never measured.", figure)
            )
        if findings.contacts is not None:
            how = "as recorded" if findings.contacts_recorded else "estimated from height and speed"
            made.append(("Feet on the ground", f"{how.capitalize()}.", plots.contacts(data.time, findings.contacts)))
        if findings.poses:
            made.append(
                (
                    "Poses of the arms",
                    "Upper arms and forearms of both sides, within 30°.",
                    plots.poses(data.time, findings.poses),
                )
            )
        made += [
            (
                "Height and clock",
                "A step or a slope in the height: another floor, or drift.",
                plots.curves(data.time, findings),
            ),
            (
                "Angular speed",
                "Of every segment; single dark frames are jumps.",
                plots.turning(data.time, data.segments, findings.turn_rad_s),
            ),
        ]
    elif isinstance(data, TrackerRecording) and isinstance(findings, TrackerFindings):
        made += [
            ("Tracked", TRACKED, plots.tracked(data)),
            (
                "Where the trackers went",
                "X ahead, Z up, after the file's axes were turned into the house's.",
                plots.paths(data),
            ),
            (
                "Angular speed",
                "Of every tracker; single dark frames are jumps.",
                plots.turning(data.time, data.trackers, findings.turn_rad_s),
            ),
        ]
    elif isinstance(data, JointTrajectory) and found.model is not None:
        from retarget.cli.stick_figures import ROBOT_COLOURS, bodies_strip
        from retarget.core import stick_figure

        points, bones = stick_figure.robot_figure(data, found.model)
        made += [
            (
                "Robot",
                "At evenly spaced instants, seen from front right.",
                bodies_strip([(points, bones, ROBOT_COLOURS[0])], data.time, 8),
            ),
            ("Joints", "Every joint between its limits.", figures.joint_angles(data, found.model)),
            ("Joint speeds", "1 would be a joint at its velocity limit.", figures.joint_speeds(data, found.model)),
        ]
    return [(name, caption, figure) for name, caption, figure in made if figure is not None]


def _joints(record: Mapping[str, Any]) -> str:
    rows = []
    for row in record["joint_ranges"]:
        outside = f'<td class="bad">{row["frames_outside"]}</td>' if row["frames_outside"] else "<td>0</td>"
        fast = ' class="bad"' if row["speed_ratio"] > 1 + 1e-9 else ""
        rows.append(
            f"<tr><th>{html.escape(row['joint'])}</th><td>{row['min']:.3f} … {row['max']:.3f}</td>"
            f"<td>{row['lower']:.3f} … {row['upper']:.3f}</td>{outside}<td{fast}>{row['speed_ratio']:.2f}</td></tr>"
        )
    head = (
        "<th></th><th>range / rad</th><th>limits / rad</th><th>frames outside</th><th>fastest, part of its limit</th>"
    )
    return f'<div class="scroll"><table class="joints"><thead><tr>{head}</tr></thead><tbody>{"".join(rows)}</tbody></table></div>'


def _robots(record: Mapping[str, Any]) -> str:
    rows = "".join(
        f"<tr><th>{html.escape(row['robot'])}</th><td>{html.escape(inspection_text.fit(row, hands=record['calibrated']))}</td></tr>"
        for row in record["robots"]
    )
    return f'<div class="scroll"><table class="facts"><tbody>{rows}</tbody></table></div>'
