"""The picture of a report: the person's joint centres and the robot's, side by side at several instants, to one scale."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray
from retarget.cli.figures import FAINT, WIDTH_IN, styled
from retarget.core.types import Array

if TYPE_CHECKING:
    from retarget.core.pipeline import ConvertResult

PERSON_COLOURS = ("#2b2f36", "#a9b0b8")
ROBOT_COLOURS = (("#0b5cad", "#8fbce6"), ("#b45309", "#e8b886"))
"""Colours of near and far bones."""
GAP_M = 0.3

AZIMUTH, ELEVATION = np.radians(-55.0), np.radians(8.0)
"""Where the viewer stands: in front of someone who faces +X, to their right, a little above."""


def strip(results: Sequence[ConvertResult], instants: int = 6) -> Figure:
    """The person (grey), unless no position is known, and beside them each result's robot, at evenly spaced instants; bones on the far side paler.

    All results come from the same motion: same frames, same times.
    """
    person = results[0].series
    bodies = [(person["human_points"], person["human_bones"], PERSON_COLOURS)] if person["human_points"].size else []
    for number, result in enumerate(results):
        colours = ROBOT_COLOURS[number % len(ROBOT_COLOURS)]
        bodies.append((result.series["robot_points"], result.series["robot_bones"], colours))
    return bodies_strip(bodies, results[0].trajectory.time, instants)


@styled
def bodies_strip(
    bodies: Sequence[tuple[Array, NDArray[Any], tuple[str, str]]], time: Array, instants: int = 6
) -> Figure:
    """Bodies side by side at evenly spaced instants of `time` (T,) s; each: points (T, P, 3) m, bones (B, 2), colours of near and far bones."""
    frames = np.linspace(0, len(time) - 1, min(instants, len(time))).round().astype(int)
    views = [[_view(points[frame]) for points, _, _ in bodies] for frame in frames]
    room = np.array([max(_half_width(row[i]) for row in views) for i in range(len(bodies))])
    centres = np.cumsum(2 * room) - room + GAP_M / 2
    step = 2 * float(room.sum()) + GAP_M
    top = max(float(np.nanmax(view[:, 1])) for row in views for view in row)
    figure = Figure(figsize=(WIDTH_IN, min(5.0, WIDTH_IN * (top + 0.4) / (step * len(views)))), layout="constrained")
    axes = figure.subplots()
    for column, (frame, row) in enumerate(zip(frames, views, strict=True)):
        for view, (_, bones, colours), centre in zip(row, bodies, centres, strict=True):
            _draw(axes, view, bones, column * step + centre, *colours)
        axes.text((column + 0.5) * step, -0.1, f"{time[frame]:.1f} s", ha="center", va="top", fontsize=9)
    axes.axhline(0, color=FAINT, linewidth=0.8, zorder=0)
    axes.set_xlim(0, step * len(views))
    axes.set_ylim(-0.35, top + 0.05)
    axes.set_aspect("equal")
    axes.set_axis_off()
    return figure


def _half_width(view: Array) -> float:
    return float(np.nanmax(np.abs(view[:, 0]))) + 0.04


def _view(points: Array) -> Array:
    """Points (P, 3) m as seen by the viewer: (P, 3) right, up, toward the viewer; above the lowest, centred sideways."""
    toward = np.array([np.cos(AZIMUTH), np.sin(AZIMUTH), 0.0])
    right = np.array([-np.sin(AZIMUTH), np.cos(AZIMUTH), 0.0])
    finite = points[np.isfinite(points).all(axis=1)]
    centred = points - np.array([*finite[:, :2].mean(axis=0), finite[:, 2].min()])
    depth = centred @ toward
    up = centred[:, 2] * np.cos(ELEVATION) - depth * np.sin(ELEVATION)
    return np.stack([centred @ right, up - np.nanmin(up), depth], axis=1)


def _draw(axes: Axes, view: Array, bones: Array, x: float, near: str, far: str) -> None:
    """Bones (B, 2) as lines around `x`, far ones first."""
    lines = view[np.asarray(bones, int)]
    lines = lines[np.isfinite(lines).all(axis=(1, 2))]
    lines = lines[np.argsort(lines[:, :, 2].mean(axis=1))]
    depth = lines[:, :, 2].mean(axis=1)
    colours = [near if d >= -0.02 else far for d in depth]
    segments = lines[:, :, :2] + np.array([x, 0.0])
    axes.add_collection(LineCollection(list(segments), colors=colours, linewidths=2.2, capstyle="round"))
