"""The HTML page of a validation: verdict and numbers of one trajectory or of several side by side, pictures, plots. Nothing is fetched, no script."""

from __future__ import annotations

import base64
import html
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from retarget.cli import validation_figures as plots
from retarget.cli.plan import write_whole
from retarget.cli.report_page import document, picture
from retarget.cli.summary import measured, number, remark
from retarget.cli.validation_figures import Curves
from retarget.core.errors import UsageError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STYLE = """
.ok { color: #2e7d32; } .verdict { font-weight: 600; } td.text { text-align: left; color: #5b636e; white-space: normal; min-width: 16rem; }
.shots { display: grid; gap: .35rem; } .shots img { border-radius: 3px; } .shots div { text-align: center; font-size: .85rem; color: #5b636e; }
.shots .row { text-align: left; font-weight: 600; color: #2b2f36; grid-column: 1 / -1; } .shots .worst { color: #b3261e; }
"""
MODES = {
    "kinematic": "kinematic mode: limits, jumps, collisions and feet, without dynamics",
    "fixed": "fixed base: the kinematic checks, then torque control of every joint in MuJoCo at 2 kHz",
}


@dataclass(frozen=True)
class Shot:
    """One snapshot: when (s), the PNG, and the row of the problem for whose sake it was taken, "" for one of the even instants."""

    time_s: float
    png: bytes
    problem: str = ""


@dataclass(frozen=True)
class Section:
    """One trajectory. title: its heading. record: as `--json` prints it. Pickles, to come from worker processes."""

    title: str
    record: Mapping[str, Any]
    curves: Curves
    shots: tuple[Shot, ...] = ()
    without_shots: str = ""
    """Why there are no snapshots."""


def write_page(path: Path, sections: Sequence[Section], *, overwrite: bool = False) -> None:
    """Write the page of `sections` to `path`, whole or not at all. Raises `UsageError` when it exists and `overwrite` is not set."""
    if os.path.lexists(path) and not overwrite:
        raise UsageError(f"{path}: exists; --force replaces it")
    write_whole(path, page(sections).encode())


def page(sections: Sequence[Section]) -> str:
    """The HTML text."""
    parts = [_overview(sections)]
    if len(sections) > 1:
        parts.append(_side_by_side(sections))
    parts += [_section(section) for section in sections]
    return document("Validation report", "", parts, STYLE)


def _overview(sections: Sequence[Section]) -> str:
    """Checks down, trajectories across."""
    names = list(dict.fromkeys(check["name"] for section in sections for check in section.record["checks"]))
    by_name = [{check["name"]: check for check in section.record["checks"]} for section in sections]
    head = "".join(f"<th>{html.escape(section.title)}</th>" for section in sections)
    verdicts = "".join(
        f'<td class="verdict {"ok" if section.record["passed"] else "bad"}">{"passed" if section.record["passed"] else "FAILED"}</td>'
        for section in sections
    )
    rows = [f"<tr><th>verdict</th>{verdicts}<td></td>{'<td></td>' if len(sections) == 1 else ''}</tr>"]
    for name in names:
        cells, limit, unit, note = "", None, "", ""
        for checks in by_name:
            check = checks.get(name)
            if check is None:
                cells += "<td>–</td>"
                continue
            limit, unit, note = check["limit"], check["unit"], remark(check)
            mark = ' class="bad"' if check["passed"] is False else ""
            text = measured(check)
            if len(sections) > 1 and note:
                cells += f'<td{mark} title="{html.escape(note)}">{html.escape(text)}</td>'
            else:
                cells += f"<td{mark}>{html.escape(text)}</td>"
        limits = "" if limit is None else f"{number(limit)} {unit}".strip()
        last = f'<td class="text">{html.escape(note)}</td>' if len(sections) == 1 else ""
        rows.append(f'<tr><th>{html.escape(name)}</th>{cells}<td class="note">{html.escape(limits)}</td>{last}</tr>')
    extra = "<th></th>" if len(sections) == 1 else ""
    return (
        f'<div class="scroll"><table><thead><tr><th></th>{head}<th>limit</th>{extra}</tr></thead>'
        f"<tbody>{''.join(rows)}</tbody></table></div>"
    )


def _side_by_side(sections: Sequence[Section]) -> str:
    """Snapshots of all trajectories under each other, and their tracking in the same panels where the joints are the same."""
    parts = ["<section>\n<h2>Side by side</h2>"]
    even = [replace(s, shots=tuple(shot for shot in s.shots if not shot.problem)) for s in sections]
    if all(section.shots for section in even):
        columns = max(len(section.shots) for section in even)
        cells = "".join(f'<div class="row">{html.escape(s.title)}</div>{_cells(s, columns)}' for s in even)
        parts.append(f'<div class="shots" style="grid-template-columns:repeat({columns},1fr)">{cells}</div>')
    labels = [section.title for section in sections]
    curves = [section.curves for section in sections]
    if len({c.joints for c in curves}) == 1:
        parts += _figures(
            [
                (
                    "Tracking",
                    "The joints tracked worst in any of them; dashed: wanted.",
                    plots.tracking(curves, labels),
                ),
                ("Torque", "The joints nearest their torque limit in any of them.", plots.torques(curves, labels)),
            ],
            "side by side",
        )
    else:
        parts.append('<p class="note">Robots with different joints: their curves stand in their own sections.</p>')
    return "\n".join([*parts, "</section>"])


def _section(section: Section) -> str:
    record = section.record
    facts = [
        f"{record['robot']}, {MODES.get(record['mode'], record['mode'])}",
        f"{record['frames']} frames at {record['rate_hz']:g} Hz, {record['duration_s']:.2f} s",
    ]
    parts = [
        f"<section>\n<h2>{html.escape(section.title)}</h2>",
        f'<p class="note">{html.escape("; ".join(facts))}</p>',
    ]
    for check in record["checks"]:
        if check["passed"] is False:
            limit = f" (limit {number(check['limit'])})" if check["limit"] is not None else ""
            text = f"{check['name']}: {measured(check)}{limit} {remark(check)}"
            parts.append(f'<p class="bad">{html.escape(text)}</p>')
    if section.shots:
        parts.append("<h3>Snapshots</h3>")
        parts.append(f'<div class="shots" style="grid-template-columns:repeat({len(section.shots)},1fr)">')
        parts.append(_cells(section, len(section.shots)) + "</div>")
    elif section.without_shots:
        parts.append(f'<p class="note">No snapshots: {html.escape(section.without_shots)}</p>')
    worst = plots.worst_problem(section.curves)
    where = "Nothing is beyond its limit."
    if worst is not None:
        row, kind, time_s, ratio = worst
        where = f"Worst: {row} at {time_s:.2f} s ({kind}, {100 * ratio:,.0f} % of it)."
    alone = [section.curves]
    parts += _figures(
        [
            (
                "Problems over time",
                f"Each cell's greatest value against its limit. {where}",
                plots.problem_strip(section.curves),
            ),
            *(
                [("Angles", "The joints nearest to a problem, the worst first.", plots.angles(section.curves))]
                if section.curves.actual is None
                else []
            ),
            ("Tracking", "The joints tracked worst, the worst first.", plots.tracking(alone, [section.title])),
            ("Tracking error", "Every joint; dark where the robot lags most.", plots.error_map(section.curves)),
            ("Torque", "The joints nearest their torque limit.", plots.torques(alone, [section.title])),
        ],
        section.title,
    )
    return "\n".join([*parts, "</section>"])


def _cells(section: Section, columns: int) -> str:
    cells = []
    for shot in section.shots:
        data = base64.b64encode(shot.png).decode()
        caption = f"{shot.time_s:.2f} s"
        if shot.problem:
            caption = f'<span class="worst">{caption}: {html.escape(shot.problem)}</span>'
        alt = html.escape(f"{section.title} at {shot.time_s:.2f} s")
        cells.append(f'<div><img alt="{alt}" src="data:image/png;base64,{data}">{caption}</div>')
    return "".join(cells + ["<div></div>"] * (columns - len(cells)))


def _figures(made: Sequence[tuple[str, str, Figure | None]], title: str) -> list[str]:
    return [picture(name, caption, figure, f"{name}, {title}") for name, caption, figure in made if figure is not None]
