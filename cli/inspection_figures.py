"""Pictures of a recording before it is converted: what was tracked when, contacts, heights, speeds, where trackers went."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from retarget.cli.figures import FAINT, INK, LEFT, LIMIT, RIGHT, WIDTH_IN, heat, styled, thinned
from retarget.cli.stick_figures import PERSON_COLOURS, bodies_strip
from retarget.core import inspection, stick_figure
from retarget.core.inspection import MotionFindings
from retarget.core.segments import FOOT_CONTACTS
from retarget.core.types import Array, BoolArray, HumanMotion, TrackerRecording

ROW_IN = 0.15
MISSING = "#d9762b"
PALETTE = ("#1f6fb4", "#d9762b", "#3f8f4f", "#8a4fa3", "#b3261e", "#5b636e", "#0f8b8d", "#a9841b")


def person(motion: HumanMotion) -> Figure | None:
    """Stick figures of what was measured, at eight instants; None where that is too little."""
    columns = np.flatnonzero(motion.measured)
    if not len(columns):
        return None
    seen = HumanMotion(
        time=motion.time,
        segments=tuple(motion.segments[column] for column in columns),
        orientation=motion.orientation[:, columns],
        position=motion.position[:, columns],
    )
    points, bones = stick_figure.human_figure(seen)
    if points.shape[1] < 3 or not len(bones):
        return None
    return bodies_strip([(points, bones, PERSON_COLOURS)], motion.time, 8)


@styled
def rows_of_spans(
    time: Array, rows: Sequence[tuple[str, BoolArray | None, str]], *, marked: str = "", label_in: float = 1.5
) -> Figure:
    """A line for each row (name, mask (T,) or None, colour): coloured where the mask holds, with a faint line where it doesn't.

    marked: the colour in which stretches without are drawn, "" for none.
    """
    height = 0.5 + ROW_IN * len(rows)
    figure = Figure(figsize=(WIDTH_IN, height))
    figure.subplots_adjust(
        left=label_in / WIDTH_IN, right=1 - 0.1 / WIDTH_IN, top=1 - 0.06 / height, bottom=0.4 / height
    )
    axes = figure.subplots()
    step = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
    end = float(time[-1]) + step
    for number, (_, mask, colour) in enumerate(rows):
        axes.hlines(number, time[0], end, color=FAINT, linewidth=0.7, zorder=0)
        if mask is None:
            continue
        for shown, paint in ((mask, colour), (~mask, marked)):
            if paint:
                bars = [(first, last - first + step) for first, last in inspection.spans(time, np.asarray(shown, bool))]
                # A single lost frame of a long recording has to be seen, too.
                least = (end - float(time[0])) / 800
                bars = [(first, max(width, least)) for first, width in bars]
                axes.broken_barh(bars, (number - 0.36, 0.72), facecolors=paint, linewidth=0)
    axes.set_yticks(range(len(rows)), [name for name, _, _ in rows], fontsize=7)
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.set_xlim(float(time[0]), end)
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    axes.set_xlabel("time / s")
    return figure


def tracked(recording: TrackerRecording) -> Figure:
    """When each tracker was measured."""
    rows = [
        (f"{name} ({recording.segments[name]})" if name in recording.segments and recording.segments[name] != name else name,
         recording.tracked[:, column], LEFT)
        for column, name in enumerate(recording.trackers)
    ]  # fmt: skip
    return rows_of_spans(recording.time, rows, marked=MISSING, label_in=2.1)


def measured(motion: HumanMotion, gaps: Sequence[Mapping[str, Any]]) -> Figure:
    """When each segment was measured: nowhere, or all the time but for the gaps that the reader found."""
    rows: list[tuple[str, BoolArray | None, str]] = []
    for column, segment in enumerate(motion.segments):
        mask = np.full(motion.frames, bool(motion.measured[column]))
        for gap in gaps:
            if segment in gap.get("segments", motion.segments):
                start = float(gap.get("start_s", 0.0))
                mask &= ~((motion.time >= start) & (motion.time <= start + float(gap.get("duration_s", 0.0))))
        rows.append((segment, mask if motion.measured[column] else None, LEFT))
    return rows_of_spans(motion.time, rows, marked=MISSING)


def contacts(time: Array, found: BoolArray) -> Figure:
    """When heels and toes are on the ground."""
    rows = [
        (
            name.replace("_", " ").replace("Foot", " foot").lower(),
            found[:, column],
            LEFT if name.startswith("Left") else RIGHT,
        )
        for column, name in enumerate(FOOT_CONTACTS)
    ]
    return rows_of_spans(time, rows)


def poses(time: Array, found: Mapping[str, Sequence[tuple[float, float]]]) -> Figure:
    """When the arms show which pose."""
    rows = []
    for name, stretches in found.items():
        mask = np.zeros(len(time), bool)
        for start, end in stretches:
            mask |= (time >= start) & (time <= end)
        rows.append((name, mask, LEFT))
    return rows_of_spans(time, rows)


@styled
def curves(time: Array, findings: MotionFindings) -> Figure | None:
    """Height of the pelvis and time between frames."""
    keep = thinned(len(time))
    steps = np.diff(time) * 1000
    plots = []
    if findings.pelvis_height_m is not None:
        plots.append(("height of the pelvis / m", time[keep], findings.pelvis_height_m[keep]))
    if len(steps):
        inner = thinned(len(steps))
        plots.append(("time between frames / ms", time[1:][inner], steps[inner]))
    if not plots:
        return None
    figure = Figure(figsize=(WIDTH_IN, 1.9), layout="constrained")
    for axes, (title, across, values) in zip(figure.subplots(1, len(plots), squeeze=False).flat, plots, strict=True):
        axes.plot(across, values, color=INK)
        low, high = float(values.min()), float(values.max())
        room = max(0.1 * (high - low), 0.02 * abs(high), 1e-3)
        axes.set_ylim(low - room, high + room)
        axes.ticklabel_format(axis="y", useOffset=False)
        axes.set_title(title)
        axes.set_xlabel("time / s")
        axes.grid(axis="y", color=FAINT, linewidth=0.5)
    return figure


def turning(time: Array, names: Sequence[str], turn: Array) -> Figure:
    """Angular speed of everything, names down, time across; capped where single peaks would hide the rest."""
    largest = max(float(np.percentile(turn, 99.8)), 1.0)
    return heat(time, turn, names, "angular speed / rad/s", largest)


@styled
def paths(recording: TrackerRecording) -> Figure:
    """Where the trackers went: from above, and their height over time."""
    figure = Figure(figsize=(WIDTH_IN, 3.6), layout="constrained")
    above, heights = figure.subplots(1, 2, width_ratios=(1, 1.7))
    keep = thinned(recording.frames)
    for column, name in enumerate(recording.trackers):
        colour = PALETTE[column % len(PALETTE)]
        point = np.where(recording.tracked[:, column, None], recording.position[:, column], np.nan)[keep]
        above.plot(-point[:, 1], point[:, 0], color=colour, linewidth=0.8)
        heights.plot(recording.time[keep], point[:, 2], color=colour, label=name)
    above.set_aspect("equal", adjustable="datalim")
    above.set_title("from above")
    above.set_xlabel("right / m")
    above.set_ylabel("ahead / m")
    heights.axhline(0, color=LIMIT, linewidth=0.6)
    heights.set_title("height / m")
    heights.set_xlabel("time / s")
    heights.grid(axis="y", color=FAINT, linewidth=0.5)
    heights.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=7, borderpad=0)
    return figure
