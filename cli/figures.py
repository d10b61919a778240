"""The plots of a report: joints against their limits, limb errors, feet. Matplotlib figures, made without pyplot and its state."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from retarget.core.segments import FOOT_CONTACTS
from retarget.core.types import Array, BoolArray, JointTrajectory

if TYPE_CHECKING:
    from retarget.core.pipeline import ConvertResult
    from retarget.core.robot_model import RobotModel

LEFT, RIGHT, LIMIT, INK, FAINT = "#1f6fb4", "#d9762b", "#b3261e", "#2b2f36", "#d7dbe0"
WIDTH_IN = 12.0
MAX_POINTS = 1200
"""Most points drawn of one curve: more than the page has pixels for it."""

STYLE: dict[Any, Any] = {
    "font.size": 8.0,
    "axes.edgecolor": "#9aa1aa",
    "axes.linewidth": 0.6,
    "axes.labelcolor": INK,
    "axes.titlesize": 8.0,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.labelsize": 7.0,
    "ytick.labelsize": 7.0,
    "legend.frameon": False,
    "lines.linewidth": 1.0,
    "svg.hashsalt": "retarget",
}


styled = mpl.rc_context(STYLE)
"""Decorator: what the function draws is in the report's style, and nothing else is."""


def svg(figure: Figure) -> bytes:
    """The figure as an SVG document, the same bytes for the same figure."""
    buffer = io.BytesIO()
    with mpl.rc_context(STYLE):
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    return buffer.getvalue()


def png(figure: Figure, path: Path) -> None:
    """Write the figure as a PNG of 64 colours: line drawings need no more, and it is a third of the size."""
    from PIL import Image

    buffer = io.BytesIO()
    with mpl.rc_context(STYLE):
        figure.savefig(buffer, format="png", dpi=120)
    Image.open(buffer).convert("RGB").quantize(64).save(path, optimize=True)


def joints(result: ConvertResult, model: RobotModel) -> Figure:
    """Every joint's angle over time, between its limits."""
    return joint_angles(result.trajectory, model)


@styled
def joint_angles(trajectory: JointTrajectory, model: RobotModel) -> Figure:
    """Every joint's angle over time, between its limits; the trajectory's joints are the model's, in its order."""
    columns = 5
    rows = math.ceil(len(model.joint_names) / columns)
    keep = thinned(trajectory.frames)
    time = trajectory.time[keep]
    figure, grid = _grid(rows, columns, row_in=1.05)
    for index, axes in enumerate(grid):
        if index >= len(model.joint_names):
            axes.set_visible(False)
            continue
        angle = np.degrees(trajectory.position[keep, index])
        lower, upper = np.degrees(model.lower[index]), np.degrees(model.upper[index])
        margin = 0.06 * (upper - lower)
        axes.axhspan(lower - margin, lower, color=LIMIT, alpha=0.16, linewidth=0)
        axes.axhspan(upper, upper + margin, color=LIMIT, alpha=0.16, linewidth=0)
        axes.plot(time, angle, color=INK)
        axes.set_ylim(lower - margin, upper + margin)
        axes.set_yticks(_round_ticks(lower, upper))
        axes.set_title(model.joint_names[index], pad=2)
        axes.set_xlim(time[0], time[-1] if len(time) > 1 else time[0] + 1)
        axes.tick_params(labelbottom=index + columns >= len(model.joint_names))
    figure.supxlabel(
        "time / s     (angles in degrees; red: beyond the joint's limits)", fontsize=8, y=0.004, va="bottom"
    )
    return figure


def speeds(result: ConvertResult, model: RobotModel) -> Figure:
    """Each joint's speed as a fraction of its limit, joints down, time across."""
    return joint_speeds(result.trajectory, model)


def joint_speeds(trajectory: JointTrajectory, model: RobotModel) -> Figure:
    """Each joint's speed as a fraction of its limit; the trajectory's joints are the model's, in its order."""
    ratio = np.abs(trajectory.velocity) / model.velocity_limit
    return heat(trajectory.time, ratio, model.joint_names, "joint speed / its limit", 1.0)


@styled
def heat(time: Array, values: Array, names: Sequence[str], label: str, largest: float) -> Figure:
    """Values (T, n) ≥ 0 as colours from 0 to `largest`, names down, time across; no peak is lost."""
    figure = Figure(figsize=(WIDTH_IN, 0.9 + 0.14 * len(names)), layout="constrained")
    axes = figure.subplots()
    end = time[-1] if len(time) > 1 else time[0] + 1
    image = axes.imshow(
        _pooled_maximum(values, 600).T,
        aspect="auto",
        cmap="magma_r",
        vmin=0,
        vmax=largest,
        interpolation="nearest",
        extent=(float(time[0]), float(end), len(names) - 0.5, -0.5),
    )
    axes.set_yticks(range(len(names)), names, fontsize=6)
    axes.set_xlabel("time / s")
    bar = figure.colorbar(image, ax=axes, pad=0.01, fraction=0.03)
    bar.set_label(label)
    bar.outline.set_visible(False)
    return figure


@styled
def limbs(result: ConvertResult) -> Figure | None:
    """Angle between the person's and the robot's limb lines over time; None when no limb was compared."""
    prefix = "limb_direction_error_deg/"
    found = {name.removeprefix(prefix): s for name, s in result.series.items() if name.startswith(prefix)}
    bones = [b for b in ("UpperArm", "ForeArm", "UpperLeg", "LowerLeg") if f"Left{b}" in found or f"Right{b}" in found]
    if not bones:
        return None
    keep = thinned(result.trajectory.frames)
    figure, grid = _grid(1, len(bones), row_in=1.9, share_y=True)
    for axes, bone in zip(grid, bones, strict=True):
        for side, colour in (("Left", LEFT), ("Right", RIGHT)):
            if (series := found.get(side + bone)) is not None:
                axes.plot(result.trajectory.time[keep], series[keep], color=colour, label=side.lower())
        axes.set_title(bone)
        axes.set_xlabel("time / s")
        axes.grid(axis="y", color=FAINT, linewidth=0.5)
    top = max(float(np.nanmax(series)) for series in found.values())
    grid[0].set_ylim(0, max(1.0, 1.1 * top))
    grid[0].set_ylabel("limb direction error / °")
    grid[-1].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderpad=0)
    return figure


@styled
def feet(result: ConvertResult) -> Figure | None:
    """Height of each sole's lowest corner over the ground and its sliding speed, stance shaded; None without feet."""
    series, time = result.series, result.trajectory.time
    if "foot_height_m/Left" not in series or "foot_height_m/Right" not in series:
        return None
    keep = thinned(len(time))
    figure, grid = _grid(2, 2, row_in=1.6, share_y="row")
    for column, (side, colour) in enumerate((("Left", LEFT), ("Right", RIGHT))):
        height, skate = grid[column], grid[2 + column]
        stance, meaning = _stance(result, side)
        for axes in (height, skate):
            _shade(axes, time, stance)
            axes.set_xlim(time[0], time[-1] if len(time) > 1 else time[0] + 1)
            axes.grid(axis="y", color=FAINT, linewidth=0.5)
        height.plot(time[keep], 1000 * series[f"foot_height_m/{side}"][keep], color=colour)
        height.axhline(0, color=LIMIT, linewidth=0.7)
        height.set_title(f"{side.lower()} foot (shaded: {meaning})")
        if f"foot_skate_m_s/{side}" in series:
            skate.plot(time[keep], 100 * series[f"foot_skate_m_s/{side}"][keep], color=colour)
        skate.set_xlabel("time / s")
    grid[0].set_ylabel("sole height / mm")
    grid[2].set_ylabel("sliding on the\nground / cm/s")
    return figure


def _stance(result: ConvertResult, side: str) -> tuple[BoolArray, str]:
    """When the foot should stand (T,), and how that is known: the recording's contacts, else the robot's own foot near the ground."""
    contacts = result.motion.foot_contacts
    if contacts is not None:
        columns = [i for i, name in enumerate(FOOT_CONTACTS) if name.startswith(side)]
        touching: BoolArray = np.asarray(contacts[:, columns].any(axis=1), bool)
        return touching, "the person's foot is on the ground"
    near_ground: BoolArray = np.asarray(result.series[f"foot_height_m/{side}"] < 0.01, bool)
    return near_ground, "lower than 10 mm"


def thinned(frames: int) -> NDArray[np.intp]:
    """Indices of at most `MAX_POINTS` frames, first and last among them."""
    return np.unique(np.linspace(0, frames - 1, min(frames, MAX_POINTS)).round().astype(np.intp))


def _grid(
    rows: int, columns: int, *, row_in: float, share_y: bool | Literal["row"] = False
) -> tuple[Figure, Sequence[Axes]]:
    height = 0.45 + row_in * rows
    figure = Figure(figsize=(WIDTH_IN, height))
    # Margins in inches instead of a layout engine, which takes most of the time a page of joints costs.
    figure.subplots_adjust(left=0.62 / WIDTH_IN, right=1 - 0.08 / WIDTH_IN, bottom=0.42 / height, top=1 - 0.22 / height)
    axes = figure.subplots(rows, columns, sharey=share_y, squeeze=False)
    figure.subplots_adjust(wspace=0.22 if not share_y else 0.06, hspace=0.42)
    return figure, list(axes.flat)


def _round_ticks(lower: float, upper: float) -> list[float]:
    """Zero and the limits, rounded; a label never stands for a number it isn't."""
    ticks = [round(lower), round(upper)]
    if lower < 0 < upper and min(-lower, upper) > 0.2 * (upper - lower):
        ticks.insert(1, 0)
    return [float(tick) for tick in ticks]


def _pooled_maximum(values: Array, most: int) -> Array:
    """Values (T, n) in at most `most` rows: the maximum over neighbouring frames, so that no peak is lost."""
    if len(values) <= most:
        return values
    edges = np.linspace(0, len(values), most, endpoint=False).astype(int)
    return np.asarray(np.maximum.reduceat(values, edges, axis=0))


def _shade(axes: Axes, time: Array, stance: BoolArray) -> None:
    changes = np.flatnonzero(np.diff(np.concatenate([[False], stance, [False]]).astype(int)))
    for start, stop in zip(changes[::2], changes[1::2], strict=True):
        axes.axvspan(time[start], time[min(stop, len(time) - 1)], color=FAINT, alpha=0.55, linewidth=0)
