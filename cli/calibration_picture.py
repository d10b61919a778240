"""The picture of a calibrated person: shoulders, chest and the arms of the three poses, from the front, the side and above."""

from __future__ import annotations

import io

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from retarget.cli.figures import FAINT, INK, LEFT, RIGHT, STYLE, styled, svg
from retarget.core.calibration import POSES, SIDES, Calibration
from retarget.core.types import Array

VIEWS = {
    "from the front (S Still pose, T T-pose, F Forward pose)": (
        np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
        "left / m",
        "up / m",
    ),
    "from the right": (np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), "ahead / m", "up / m"),
    "from above": (np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0]]), "right / m", "ahead / m"),
}
"""Title → what of a point goes across and up (2, 3), and the labels of these axes."""

COLOUR = {"Left": LEFT, "Right": RIGHT}
LETTER = dict(zip(POSES, "STF", strict=True))
WIDTH_IN, TABLE_IN, TITLE_IN, LABELS_IN = 11.0, 0.85, 0.3, 0.45
GAP_IN, LEFT_IN, RIGHT_IN = 0.6, 0.6, 0.1
DPI = 130


def drawn(calibration: Calibration, suffix: str) -> bytes:
    """The picture as the bytes of a file, `suffix` ".svg" or ".png"."""
    figure = person(calibration)
    if suffix == ".svg":
        return svg(figure)
    buffer = io.BytesIO()
    with mpl.rc_context(STYLE):
        figure.savefig(buffer, format="png", dpi=DPI, metadata={"Software": None})
    return buffer.getvalue()


@styled
def person(calibration: Calibration) -> Figure:
    """Three views of the person in the operator frame, in one scale, and the arms in numbers below."""
    corners = _extent(calibration)
    sizes = np.array([np.ptp(corners @ across_up.T, axis=0) for across_up, _, _ in VIEWS.values()])
    scale = (WIDTH_IN - LEFT_IN - RIGHT_IN - GAP_IN * (len(VIEWS) - 1)) / sizes[:, 0].sum()
    height = scale * sizes[:, 1].max() + TITLE_IN + LABELS_IN + TABLE_IN
    figure = Figure(figsize=(WIDTH_IN, height))
    figure.subplots_adjust(
        left=LEFT_IN / WIDTH_IN,
        right=1 - RIGHT_IN / WIDTH_IN,
        top=1 - TITLE_IN / height,
        bottom=(TABLE_IN + LABELS_IN) / height,
        wspace=GAP_IN / (scale * sizes[:, 0].mean()),
    )
    grid = figure.subplots(1, len(VIEWS), width_ratios=sizes[:, 0].tolist())
    for axes, (title, (across_up, across, up)) in zip(grid, VIEWS.items(), strict=True):
        _draw(axes, calibration, across_up, named=axes is grid[0])
        flat = corners @ across_up.T
        axes.set(title=title, anchor="N", xlabel=across, ylabel=up, aspect="equal")
        axes.set_xlim(flat[:, 0].min(), flat[:, 0].max())
        axes.set_ylim(flat[:, 1].min(), flat[:, 1].max())
        axes.grid(color=FAINT, linewidth=0.4)
        axes.set_axisbelow(True)
    # Side by side every column needs its own left edge: lines of one text would not line up in a proportional font.
    for column, lines in zip((0.06, 0.13, 0.23, 0.47, 0.73), _table(calibration), strict=True):
        for row, (text, colour) in enumerate(zip(lines, (INK, LEFT, RIGHT), strict=True)):
            figure.text(column, (TABLE_IN - 0.1 - 0.22 * row) / height, text, color=colour, fontsize=8, va="top")
    return figure


def _draw(axes: Axes, calibration: Calibration, across_up: Array, *, named: bool) -> None:
    def flat(point: Array) -> tuple[float, float]:
        across, up = (across_up @ point).tolist()
        return across, up

    shoulders = [calibration.arms[side].shoulder for side in SIDES]
    neck = np.mean(shoulders, axis=0)
    for start, end in ((np.zeros(3), neck), (shoulders[0], shoulders[1])):
        axes.plot(
            *np.transpose([flat(start), flat(end)]), color="#9aa1aa", linewidth=4, solid_capstyle="round", zorder=1
        )
    for side in SIDES:
        arm, colour = calibration.arms[side], COLOUR[side]
        shoulder = flat(arm.shoulder)
        for pose, hand in zip(POSES, arm.hand_points, strict=True):
            end = flat(hand)
            axes.annotate(
                "", end, shoulder, arrowprops={"arrowstyle": "-|>", "color": colour, "shrinkA": 0, "shrinkB": 0}
            )
            # Arms that point at the viewer or lie behind one another keep their letters apart by side.
            seen = np.subtract(end, shoulder)
            away = seen / max(float(np.linalg.norm(seen)), 0.25)
            x, y = 11 * away + (np.zeros(2) if np.linalg.norm(away) > 0.9 else [7 if side == "Left" else -7, -9])
            axes.annotate(
                f"{LETTER[pose]}",
                end,
                xytext=(x, y),
                textcoords="offset points",
                color=colour,
                ha="center",
                va="center",
            )
        axes.plot(*shoulder, "o", color=colour, markersize=7, zorder=3)
    for point, marker, name in ((calibration.chest_position, "s", "chest"), (np.zeros(3), "P", "origin")):
        axes.plot(*flat(point), marker, color=INK, markersize=5, zorder=4)
        if named:
            axes.annotate(name, flat(point), xytext=(6, -3), textcoords="offset points", fontsize=7, va="top", zorder=4)


def _extent(calibration: Calibration) -> Array:
    """(2, 3) m, the corners of the box around all points, with a margin for the letters."""
    points = np.concatenate([np.zeros((1, 3)), *(calibration.arms[side].hand_points for side in SIDES)])
    points = np.concatenate([points, [calibration.arms[side].shoulder for side in SIDES], [calibration.chest_position]])
    return np.array([points.min(axis=0) - 0.12, points.max(axis=0) + 0.12])


def _table(calibration: Calibration) -> list[tuple[str, str, str]]:
    """Columns of head, left and right."""
    columns: list[tuple[str, str, str]] = [("", "left arm", "right arm")]
    arms = [calibration.arms[side] for side in SIDES]

    def column(head: str, values: list[str]) -> None:
        columns.append((head, values[0], values[1]))

    column("arm length", [f"{arm.length_m:.4f} m" for arm in arms])
    column("angles S–T, T–F, F–S", [", ".join(f"{a:.2f}°" for a in arm.angles_deg) for arm in arms])
    column(
        "shoulder: ahead, left, up",
        [", ".join(f"{round(v, 4) + 0.0:.4f}" for v in arm.shoulder) + " m" for arm in arms],
    )
    column("spread of its estimates", [f"{1000 * np.ptp(arm.offsets_m):.1f} mm" for arm in arms])
    return columns
