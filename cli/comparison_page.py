"""The page of `retarget compare`: its tables, and the figures 6 and 8 of [Lim2022] for the operator and robot at hand."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import TYPE_CHECKING

from retarget.cli import comparison_figures, comparison_table
from retarget.cli.report_page import document, picture
from retarget.core.comparison import SQUARE_AHEAD, SQUARE_M

if TYPE_CHECKING:
    from retarget.cli.compare import Clip, Comparison


def page(comparison: Comparison) -> str:
    """The HTML text."""
    robot = comparison.model.profile.name
    tables = dict(comparison_table.tables(comparison))
    titles = list(tables)
    parts = [f'<p class="note">{html.escape(note)}</p>' for note in comparison.notes]
    parts += [_section(title, [_table(tables[title])]) for title in titles[:1]]
    own = titles[1 : len(titles) - len(comparison.clips)]
    if comparison.circles:
        parts.append(
            _section(
                own[0],
                [
                    _table(tables[own[0]]),
                    picture(
                        "Circles",
                        "The operator's hand and the robot's target, seen from the front, each about its own centre and in units of its own "
                        "radius; dashed: a circle.",
                        comparison_figures.circles(comparison.circles),
                        "circles, drawn and mapped",
                    ),
                ],
            )
        )
    parts.append(
        _section(
            own[-1],
            [
                _table(tables[own[-1]]),
                picture(
                    "Square",
                    f"Seen from the front: a square of {SQUARE_M:g} m, its centre {SQUARE_AHEAD:g} arm lengths straight ahead of the operator's "
                    "shoulder (grey), and what hand_position makes of it for the robot's, both in metres from that shoulder.",
                    comparison_figures.squares(comparison.squares),
                    "square and its image",
                ),
            ],
        )
    )
    for clip, title in zip(comparison.clips, titles[-len(comparison.clips) :], strict=True):
        parts.append(_section(title, [_table(tables[title]), *_clip_pictures(clip, comparison)]))
    note = f"Hand mappings by the experiments of Lim et al., ICRA 2022, section IV. {comparison.about}".strip()
    return document(f"retarget compare: {robot}", note, parts)


def _clip_pictures(clip: Clip, comparison: Comparison) -> list[str]:
    from retarget.core.comparison import operator_points

    person = operator_points(clip.motion, comparison.model)
    robot = comparison.model.profile.name
    return [
        picture(
            "Operator and robot",
            f"The operator on top, below them {robot} by each variant at the same instants, to one scale, seen from the front and a little from "
            "the right. Thin lines from the robot's shoulders: where the operator's arms point, in the robot's lengths.",
            comparison_figures.postures(clip.motion.time, person, clip.results),
            f"operator and robot, {clip.name}",
        ),
        picture(
            "Arm direction error",
            "Angle between the operator's and the robot's lines: shoulder to hand, shoulder to elbow, elbow to hand.",
            comparison_figures.errors(clip.motion.time, clip.results),
            f"arm direction error, {clip.name}",
        ),
    ]


def _section(title: str, parts: Sequence[str]) -> str:
    return "\n".join([f"<section>\n<h2>{html.escape(title[:1].upper() + title[1:])}</h2>", *parts, "</section>"])


def _table(rows: comparison_table.Rows) -> str:
    head = "".join(f"<th>{html.escape(cell)}</th>" for cell in rows[0])
    lines = []
    for row in rows[1:]:
        cells = "".join(f"<td>{html.escape(cell)}</td>" for cell in row[1:])
        lines.append(f"<tr><th>{html.escape(row[0])}</th>{cells}</tr>")
    return f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{"".join(lines)}</tbody></table></div>'
