"""Figures of `retarget compare`: circles, the square, arms over time, operator and robot side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from retarget.cli.figures import FAINT, INK, LEFT, RIGHT, WIDTH_IN, styled, thinned
from retarget.core.calibration import SIDES
from retarget.core.comparison import Circles, Similarity, Square, Variant
from retarget.core.experiments import LINES
from retarget.core.types import Array

PALETTE = ("#1f6fb4", "#d9762b", "#4d8f3a", "#8a4fa3", "#a8893b")
PERSON = "#5b636e"
SIDE_COLOUR = {"Left": LEFT, "Right": RIGHT}
FROM_FRONT = ("Right", "Left")
"""Sides as one who faces them sees them, from left to right."""

INSTANTS = 8
"""Columns of [Lim2022 fig. 8]."""
AZIMUTH, ELEVATION = np.radians(-28.0), np.radians(12.0)
"""Where the viewer stands: in front, a little to the right of someone who faces +X and above, so that arms that point ahead show."""

BONES = (
    ("Pelvis", "Neck"),
    ("Neck", "Head"),
    ("LeftShoulder", "RightShoulder"),
    *((f"{side}Shoulder", f"{side}Elbow") for side in SIDES),
    *((f"{side}Elbow", f"{side}Hand") for side in SIDES),
)


def colours(chosen: Sequence[Variant]) -> dict[str, tuple[str, str]]:
    """Variant's name → (colour, line style): a colour for each mapping, full for its first variant and dashed for others."""
    first = {variant.mapping: variant.name for variant in reversed(chosen)}
    colour = {name: PALETTE[i % len(PALETTE)] for i, name in enumerate(dict.fromkeys(v.mapping for v in chosen))}
    return {v.name: (colour[v.mapping], "-" if first[v.mapping] == v.name else "--") for v in chosen}


@styled
def circles(found: Mapping[str, Circles]) -> Figure:
    """One panel for each hand and path, about its own centre and in units of its own radius."""
    sides = [side for side in FROM_FRONT if side in found]
    names = list(found[sides[0]].paths)
    width = min(WIDTH_IN, 2.6 * len(names))
    figure = Figure(figsize=(width, 0.3 + width / len(names) * len(sides)), layout="constrained")
    grid = figure.subplots(len(sides), len(names), squeeze=False, sharex=True, sharey=True)
    angle = np.linspace(0, 2 * np.pi, 181)
    for row, side in zip(grid, sides, strict=True):
        for axes, name in zip(row, names, strict=True):
            path = found[side].paths[name]
            flat = path[:, 1:] - path[:, 1:].mean(axis=0)
            flat = flat[thinned(len(flat))] / np.linalg.norm(flat, axis=1).mean()
            axes.plot(np.cos(angle), np.sin(angle), color="#9aa1aa", linewidth=0.8, dashes=(4, 3))
            axes.plot(*flat.T, color=PERSON if name == names[0] else SIDE_COLOUR[side])
            axes.set_title(f"{side.lower()} hand, {name}: {found[side].index[name]:.4f}")
            axes.set_aspect("equal")
            axes.grid(color=FAINT, linewidth=0.4)
    for axes in grid[-1]:
        axes.set_xlabel("left / radii")
    for row in grid:
        row[0].set_ylabel("up / radii")
    return figure


@styled
def squares(found: Mapping[str, Square]) -> Figure:
    """Both hands from the front: the square and what becomes of it, from the shoulder."""
    figure = Figure(figsize=(WIDTH_IN, 5.5), layout="constrained")
    grid = figure.subplots(1, 2, sharex=True, sharey=True)
    for axes, side in zip(grid, FROM_FRONT, strict=True):
        square = found[side]
        for points, colour, label in (
            (square.operator, PERSON, "operator's square"),
            (square.robot, SIDE_COLOUR[side], "robot's"),
        ):
            axes.plot(points[:, 1], points[:, 2], color=colour, linewidth=1.6, label=label)
            # Corners joined to their images would clutter; where drawing begins is enough to tell one from the other.
            axes.plot(*points[0, 1:], "o", color=colour, markersize=4)
        axes.plot(0, 0, "+", color=INK, markersize=8)
        axes.annotate(
            "straight ahead of the shoulder", (0, 0), (0, -11), textcoords="offset points", ha="center", fontsize=7
        )
        axes.set(title=f"{side.lower()} hand", xlabel="left / m", aspect="equal")
        axes.grid(color=FAINT, linewidth=0.4)
        axes.set_axisbelow(True)
        axes.margins(0.12)
        axes.legend(loc="lower center", bbox_to_anchor=(0.6, 1.0), ncols=2, borderpad=0)
    grid[0].set_ylabel("up / m")
    return figure


@styled
def errors(time: Array, results: Sequence[Similarity]) -> Figure:
    """Angle of every line of both arms over time, a curve for each variant."""
    titles = {"Arm": "shoulder to hand", "UpperArm": "upper arm", "ForeArm": "forearm"}
    known = [line for line in titles if any(side + line in results[0].errors_deg for side in SIDES)]
    assert set(titles) == set(LINES)
    figure = Figure(figsize=(WIDTH_IN, 0.5 + 1.75 * len(known)), layout="constrained")
    grid = figure.subplots(len(known), 2, squeeze=False, sharex=True, sharey="row")
    keep = thinned(len(time))
    styles = colours([result.variant for result in results])
    for row, line in zip(grid, known, strict=True):
        for axes, side in zip(row, SIDES, strict=True):
            for result in results:
                colour, style = styles[result.variant.name]
                if side + line in result.errors_deg:
                    series = result.errors_deg[side + line][keep]
                    axes.plot(time[keep], series, style, color=colour, label=result.variant.name)
            axes.set_title(f"{side.lower()} {titles[line]}")
            axes.set_xlim(time[0], time[-1] if len(time) > 1 else time[0] + 1)
            axes.grid(axis="y", color=FAINT, linewidth=0.5)
        row[0].set_ylabel("error / °")
        row[0].set_ylim(bottom=0)
    for axes in grid[-1]:
        axes.set_xlabel("time / s")
    handles, labels = grid[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=len(labels), borderpad=0.2)
    return figure


@styled
def postures(time: Array, person: Mapping[str, Array], results: Sequence[Similarity]) -> Figure:
    """Rows: the operator, then the robot by each variant. Columns: instants evenly over the clip [Lim2022 fig. 8]."""
    frames = np.unique(np.linspace(0, len(time) - 1, INSTANTS).round().astype(int))
    styles = colours([result.variant for result in results])
    rows: list[tuple[str, str, Mapping[str, Array]]] = [("operator", INK, person)]
    rows += [(r.variant.name, styles[r.variant.name][0], r.points) for r in results]
    views = [[_view(points, frame) for frame in frames] for _, _, points in rows]
    wanted = [[_view(_pointed(r.points, person, f), 0, origin=r.points["Neck"][f]) for f in frames] for r in results]
    every = np.array([point for row in [*views, *wanted] for view in row for point in view.values()])
    step, low, high = 2 * np.abs(every[:, 0]).max() + 0.06, every[:, 1].min() - 0.06, every[:, 1].max() + 0.06
    heading_m = 0.16
    tall = high - low + heading_m
    scale = WIDTH_IN / (step * len(frames))
    figure = Figure(figsize=(WIDTH_IN, scale * (tall * len(rows) + 0.15)))
    axes = figure.add_axes((0, 0, 1, 1))
    for number, ((name, colour, _), row) in enumerate(zip(rows, views, strict=True)):
        floor = -number * tall
        axes.text(0.04, floor + high + 0.02, name, color=colour, fontsize=9, va="bottom", weight="bold")
        for column, view in enumerate(row):
            at = np.array([(column + 0.5) * step, floor])
            if number:
                _draw(axes, wanted[number - 1][column], at, "#8b929b", width=1.0)
            _draw(axes, view, at, colour, width=2.4)
        axes.axhline(floor + low, color=FAINT, linewidth=0.6, zorder=0)
    bottom = -(len(rows) - 1) * tall + low
    for column, frame in enumerate(frames):
        axes.text((column + 0.5) * step, bottom - 0.02, f"{time[frame]:.1f} s", ha="center", va="top", fontsize=8)
    axes.set_xlim(0, step * len(frames))
    axes.set_ylim(bottom - 0.15, high + heading_m)
    axes.set_aspect("equal")
    axes.set_axis_off()
    return figure


def _pointed(robot: Mapping[str, Array], person: Mapping[str, Array], frame: int) -> dict[str, Array]:
    """The robot's arms at `frame` if they pointed where the person's do: points (1, 3), from the robot's own shoulders."""
    points = {}
    for side in SIDES:
        at = np.array(robot[f"{side}Shoulder"][frame])
        points[f"{side}Shoulder"] = at[None]
        joints = [f"{side}{name}" for name in ("Shoulder", "Elbow", "Hand")]
        joints = [name for name in joints if name in robot and name in person]
        for start, end in pairwise(joints):
            line = person[end][frame] - person[start][frame]
            length = np.linalg.norm(robot[end][frame] - robot[start][frame])
            at = at + length * line / np.linalg.norm(line)
            points[end] = at[None]
    return points


def _view(points: Mapping[str, Array], frame: int, origin: Array | None = None) -> dict[str, Array]:
    """Points at `frame` as the viewer sees them: (2,) m right and up, from `origin` or their own Neck."""
    toward = np.array([np.cos(AZIMUTH), np.sin(AZIMUTH), 0.0])
    right = np.array([-np.sin(AZIMUTH), np.cos(AZIMUTH), 0.0])
    centre = points["Neck"][frame] if origin is None else origin
    seen: dict[str, Array] = {}
    for name, series in points.items():
        offset = series[frame] - centre
        up = offset[2] * np.cos(ELEVATION) - (offset @ toward) * np.sin(ELEVATION)
        seen[name] = np.array([offset @ right, up])
    return seen


def _draw(axes: Axes, view: Mapping[str, Array], at: Array, colour: str, width: float) -> None:
    lines: list[Any] = [
        np.stack([view[start] + at, view[end] + at]) for start, end in _bones(view) if start in view and end in view
    ]
    axes.add_collection(LineCollection(lines, colors=colour, linewidths=width, capstyle="round"))
    if "Head" in view:
        axes.plot(*(view["Head"] + at), "o", color=colour, markersize=5)


def _bones(view: Mapping[str, Array]) -> list[tuple[str, str]]:
    """BONES, with one from shoulder to hand for arms without an elbow."""
    straight = [(f"{side}Shoulder", f"{side}Hand") for side in SIDES if f"{side}Elbow" not in view]
    return [*BONES, *straight]
