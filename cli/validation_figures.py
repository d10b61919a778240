"""The plots of a validation: tracking and torque of the joints that have it hardest, and where in time and in which joint the problems are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray
from retarget.cli.figures import FAINT, INK, LIMIT, WIDTH_IN, styled
from retarget.core.types import Array

CLIP_COLOURS = ("#1f6fb4", "#d9762b", "#3f8f4f", "#7a4fa3", "#a3803a", "#2b8f95")
KIND_COLOURS = {
    "motion beyond a limit": "#b3261e",
    "torque at its limit": "#7a4fa3",
    "tracking error beyond its limit": "#6b7a12",
    "links in each other": "#8d4b1f",
    "base or feet beyond a limit": "#2b5fa8",
    "limb unlike the person's": "#c2577f",
    "frames missing": "#1b1e24",
}
"""Kind of problem → the colour of a cell that has it."""
OTHER_KIND = "#444444"
NEAR_LIMIT = LinearSegmentedColormap.from_list("near", ["#ffffff", "#fdf3dc", "#f6c667"])
"""From far inside a limit to at it; what is beyond takes the colour of its kind instead."""
SHOWN_JOINTS = 6
STRIP_COLUMNS = 600


@dataclass(frozen=True)
class Curves:
    """What is drawn of one trajectory. K samples, n joints; NaN = unknown there.

    time: (K,) s. wanted: (K, n) rad; lower, upper: (n,) rad, the joints' ranges. actual: (K, n) rad and torque: (K, n) Nm, None without dynamics.
    rms_error, peak_error: (n,) rad, over all samples, not only the K that are drawn; None without dynamics. torque_limit: (n,) Nm, inf = none.
    torque_ratio: (n,) greatest |torque| / limit over all samples. sliding: (n,) bool; such joints have m and N for rad and Nm.
    strip_time: (C + 1,) s, edges of the strip's columns. problems: kind → (C, n) greatest value of each column over its limit;
    whole_body: row's name → (kind, (C,)) of the same, of what is no joint's own.
    """

    joints: tuple[str, ...]
    time: Array
    wanted: Array
    lower: Array
    upper: Array
    strip_time: Array
    actual: Array | None = None
    torque: Array | None = None
    rms_error: Array | None = None
    peak_error: Array | None = None
    torque_limit: Array = field(default_factory=lambda: np.zeros(0))
    torque_ratio: Array = field(default_factory=lambda: np.zeros(0))
    sliding: tuple[bool, ...] = ()
    problems: Mapping[str, Array] = field(default_factory=dict)
    whole_body: Mapping[str, tuple[str, Array]] = field(default_factory=dict)

    def shown(self, joint: int) -> tuple[float, str]:
        """(how many of its unit a rad or m is, the unit) of one joint in plots: degrees, or mm."""
        return (1000.0, " mm") if self.sliding and self.sliding[joint] else (float(np.degrees(1.0)), "°")


@styled
def tracking(curves: Sequence[Curves], labels: Sequence[str]) -> Figure | None:
    """Angle and error of the joints tracked worst, the worst first; None without dynamics. All curves have the same joints."""
    driven = [(c, label) for c, label in zip(curves, labels, strict=True) if c.actual is not None]
    if not driven:
        return None
    errors = np.max([c.rms_error for c, _ in driven if c.rms_error is not None], axis=0)
    worst = np.argsort(-errors, kind="stable")[:SHOWN_JOINTS]
    figure, grid = _pairs(len(worst))
    for (above, below), joint in zip(grid, worst, strict=False):
        scale, unit = driven[0][0].shown(joint)
        for number, (c, label) in enumerate(driven):
            assert c.actual is not None
            colour = CLIP_COLOURS[number % len(CLIP_COLOURS)]
            above.plot(c.time, scale * c.actual[:, joint], color=colour, label=label)
            above.plot(
                c.time, scale * c.wanted[:, joint], color=INK if len(driven) == 1 else colour, linestyle=(0, (3, 2))
            )
            below.plot(c.time, scale * (c.actual[:, joint] - c.wanted[:, joint]), color=colour, linewidth=0.8)
        first = driven[0][0]
        numbers = f"rms {scale * errors[joint]:.2g}{unit}"
        if len(driven) == 1 and first.peak_error is not None:
            numbers += f", peak {scale * first.peak_error[joint]:.2g}{unit}"
        above.set_title(f"{first.joints[joint]}    {numbers}", pad=3)
        below.axhline(0, color=FAINT, linewidth=0.6, zorder=0)
        _finish(above, below, first.time)
    grid[0][0].set_ylabel("angle / ° (sliding: mm)" if any(driven[0][0].sliding) else "angle / °")
    grid[0][1].set_ylabel("actual − wanted / °")
    wanted = Line2D([], [], color=INK, linestyle=(0, (3, 2)), label="wanted")
    _legend(figure, [wanted, *_clip_handles([label for _, label in driven], "actual")])
    return figure


@styled
def angles(curves: Curves) -> Figure:
    """Angle of the joints nearest to a problem, worst first, between their limits."""
    worst_ratio = np.max(
        [values.max(axis=0) for values in curves.problems.values()] or [np.zeros(len(curves.joints))], axis=0
    )
    worst = np.argsort(-worst_ratio, kind="stable")[:SHOWN_JOINTS]
    columns = min(3, len(worst))
    figure, axes = _figure(-(-len(worst) // columns), columns, row_in=1.5)
    for panel, joint in zip(axes, worst, strict=False):
        scale, unit = curves.shown(joint)
        low, high = scale * curves.lower[joint], scale * curves.upper[joint]
        angle = scale * curves.wanted[:, joint]
        panel.plot(curves.time, angle, color=INK)
        for limit in (low, high):
            panel.axhline(limit, color=LIMIT, linewidth=0.9)
        reach = max(float(np.ptp(angle)), 5.0)
        panel.set_ylim(
            min(angle.min(), max(low, angle.min() - reach)) - 0.06 * reach,
            max(angle.max(), min(high, angle.max() + reach)) + 0.06 * reach,
        )
        panel.set_title(f"{curves.joints[joint]}    {low:.0f}{unit} to {high:.0f}{unit}", pad=3)
        panel.set_xlim(*_span(curves.time))
        panel.grid(axis="y", color=FAINT, linewidth=0.5)
        panel.set_xlabel("time / s")
    for panel in axes[len(worst) :]:
        panel.set_visible(False)
    axes[0].set_ylabel("angle / °")
    _legend(figure, [Line2D([], [], color=INK, label="wanted"), Line2D([], [], color=LIMIT, label="range")])
    return figure


@styled
def torques(curves: Sequence[Curves], labels: Sequence[str]) -> Figure | None:
    """Torque of the joints nearest their limit (of the largest, where none has one), with the limits; None without dynamics."""
    driven = [(c, label) for c, label in zip(curves, labels, strict=True) if c.torque is not None]
    if not driven:
        return None
    ratio = np.max([c.torque_ratio for c, _ in driven], axis=0)
    size = np.max([np.abs(c.torque).max(axis=0) for c, _ in driven if c.torque is not None], axis=0)
    worst = np.lexsort((-size, -np.where(np.isfinite(ratio), ratio, 0.0)))[:SHOWN_JOINTS]
    columns = min(3, len(worst))
    rows = -(-len(worst) // columns)
    figure, axes = _figure(rows, columns, row_in=1.5)
    for panel, joint in zip(axes, worst, strict=False):
        first = driven[0][0]
        for number, (c, label) in enumerate(driven):
            assert c.torque is not None
            colour = CLIP_COLOURS[number % len(CLIP_COLOURS)]
            panel.plot(c.time, c.torque[:, joint], color=colour, label=label, linewidth=0.8)
        limit = first.torque_limit[joint] if len(first.torque_limit) else np.inf
        title = first.joints[joint]
        if np.isfinite(limit):
            title += f"    peak {100 * ratio[joint]:.0f} % of {limit:g} Nm"
            if ratio[joint] > 0.25:
                for sign in (-1, 1):
                    panel.axhline(sign * limit, color=LIMIT, linewidth=0.9)
                panel.set_ylim(-1.12 * limit, 1.12 * limit)
        panel.set_title(title, pad=3)
        panel.set_xlim(*_span(first.time))
        panel.grid(axis="y", color=FAINT, linewidth=0.5)
        panel.set_xlabel("time / s")
    for panel in axes[len(worst) :]:
        panel.set_visible(False)
    axes[0].set_ylabel("torque / Nm")
    limit = Line2D([], [], color=LIMIT, label="limit")
    _legend(figure, [limit, *_clip_handles([label for _, label in driven], "torque")])
    return figure


@styled
def error_map(curves: Curves) -> Figure | None:
    """Size of every joint's tracking error over time, as colour; None without dynamics."""
    if curves.actual is None:
        return None
    error = np.abs(curves.wanted - curves.actual) * [curves.shown(joint)[0] for joint in range(len(curves.joints))]
    step = max(1, len(error) // STRIP_COLUMNS)
    pooled = np.maximum.reduceat(error, np.arange(0, len(error), step), axis=0)
    figure = Figure(figsize=(WIDTH_IN, 0.9 + 0.14 * len(curves.joints)), layout="constrained")
    axes = figure.subplots()
    low, high = _span(curves.time)
    image = axes.imshow(
        pooled.T,
        aspect="auto",
        cmap="magma_r",
        vmin=0,
        interpolation="nearest",
        extent=(low, high, len(curves.joints) - 0.5, -0.5),
    )
    axes.set_yticks(range(len(curves.joints)), curves.joints, fontsize=6)
    axes.set_xlabel("time / s")
    bar = figure.colorbar(image, ax=axes, pad=0.01, fraction=0.03)
    bar.set_label("|actual − wanted| / ° (sliding: mm)" if any(curves.sliding) else "|actual − wanted| / °")
    bar.outline.set_visible(False)
    return figure


@styled
def problem_strip(curves: Curves) -> Figure:
    """Joints down, time across: how near everything is to its limit, and in the colour of its kind where it is beyond."""
    names, kinds, ratio, owner = _strip_rows(curves)
    colours = NEAR_LIMIT(np.clip(ratio, 0, 1))[..., :3]
    palette = np.array([to_rgb(KIND_COLOURS.get(kind, OTHER_KIND)) for kind in kinds] or [to_rgb(OTHER_KIND)])
    beyond = ratio > 1
    colours[beyond] = palette[owner[beyond]]
    figure = Figure(figsize=(WIDTH_IN, 1.15 + 0.14 * len(names)), layout="constrained")
    axes = figure.subplots()
    low, high = float(curves.strip_time[0]), float(curves.strip_time[-1])
    axes.imshow(
        colours, aspect="auto", interpolation="nearest", extent=(low, max(high, low + 1e-3), len(names) - 0.5, -0.5)
    )
    axes.set_yticks(range(len(names)), names, fontsize=6)
    axes.hlines(np.arange(len(names) - 1) + 0.5, low, high, color=FAINT, linewidth=0.3)
    if curves.whole_body:
        axes.axhline(len(curves.joints) - 0.5, color=INK, linewidth=0.6)
    bad_rows = np.atleast_1d(beyond.any(axis=1))
    for label, bad in zip(axes.get_yticklabels(), bad_rows, strict=True):
        if bad:
            label.set_color(LIMIT)
            label.set_fontweight("bold")
    axes.set_xlabel("time / s")
    handles: list[Patch | Line2D] = [
        Patch(facecolor=KIND_COLOURS.get(kind, OTHER_KIND), label=kind)
        for index, kind in enumerate(kinds)
        if (owner[beyond] == index).any()
    ]
    handles.append(Patch(facecolor=NEAR_LIMIT(1.0), edgecolor=FAINT, label="at a limit, within"))
    figure.legend(handles=handles, loc="outside upper right", ncols=min(len(handles), 6), borderpad=0)
    return figure


def worst_problem(curves: Curves) -> tuple[str, str, float, float] | None:
    """(row, kind, time s, value over limit) of the greatest excess; None when nothing is beyond a limit."""
    names, kinds, ratio, owner = _strip_rows(curves)
    row, column = np.unravel_index(int(np.argmax(ratio)), ratio.shape)
    if not ratio[row, column] > 1:
        return None
    middle = float(curves.strip_time[column : column + 2].mean())
    return names[row], kinds[owner[row, column]], middle, float(ratio[row, column])


def strip_edges(time: Array) -> tuple[Array, NDArray[np.intp]]:
    """Edges (C + 1,) s of the strip's columns for samples at `time` (T,), and the first sample (C,) of each."""
    starts = np.unique(np.linspace(0, len(time), min(len(time), STRIP_COLUMNS), endpoint=False).round().astype(np.intp))
    return np.append(time[starts], time[-1]), starts


def _strip_rows(curves: Curves) -> tuple[list[str], list[str], Array, NDArray[np.intp]]:
    """Rows' names, kinds, greatest value over limit (R, C), and which kind it is (R, C)."""
    columns, n = len(curves.strip_time) - 1, len(curves.joints)
    kinds = list(dict.fromkeys([*curves.problems, *(kind for kind, _ in curves.whole_body.values())]))
    names = [*curves.joints, *curves.whole_body]
    stack = np.zeros((len(kinds) or 1, len(names), columns))
    for kind, values in curves.problems.items():
        stack[kinds.index(kind), :n] = np.nan_to_num(values.T)
    for row, (kind, values) in enumerate(curves.whole_body.values(), n):
        stack[kinds.index(kind), row] = np.nan_to_num(values)
    return names, kinds, stack.max(axis=0), stack.argmax(axis=0)


def _pairs(count: int) -> tuple[Figure, list[tuple[Axes, Axes]]]:
    """Panels of two axes, angle above error, in up to three columns."""
    columns = min(3, count)
    rows = -(-count // columns)
    height = 0.85 + 2.25 * rows
    figure = Figure(figsize=(WIDTH_IN, height))
    figure.subplots_adjust(left=0.62 / WIDTH_IN, right=1 - 0.08 / WIDTH_IN, bottom=0.45 / height, top=1 - 0.55 / height)
    outer = figure.add_gridspec(rows, columns, wspace=0.16, hspace=0.3)
    pairs = []
    for index in range(rows * columns):
        if index < count:
            inner = outer[index // columns, index % columns].subgridspec(2, 1, height_ratios=(3, 2), hspace=0.12)
            pairs.append((figure.add_subplot(inner[0]), figure.add_subplot(inner[1])))
    return figure, pairs


def _figure(rows: int, columns: int, *, row_in: float) -> tuple[Figure, list[Axes]]:
    height = 0.9 + row_in * rows
    figure = Figure(figsize=(WIDTH_IN, height))
    figure.subplots_adjust(left=0.62 / WIDTH_IN, right=1 - 0.08 / WIDTH_IN, bottom=0.45 / height, top=1 - 0.55 / height)
    axes = figure.subplots(rows, columns, squeeze=False)
    figure.subplots_adjust(wspace=0.16, hspace=0.5)
    return figure, list(axes.flat)


def _finish(above: Axes, below: Axes, time: Array) -> None:
    for axes in (above, below):
        axes.set_xlim(*_span(time))
        axes.grid(axis="y", color=FAINT, linewidth=0.5)
    above.tick_params(labelbottom=False)
    below.set_xlabel("time / s", labelpad=1)


def _clip_handles(labels: Sequence[str], alone: str) -> list[Line2D]:
    """A line for each clip's legend, called `alone` where there is one clip only."""
    return [
        Line2D([], [], color=CLIP_COLOURS[i % len(CLIP_COLOURS)], label=label if len(labels) > 1 else alone)
        for i, label in enumerate(labels)
    ]


def _legend(figure: Figure, handles: Sequence[Line2D]) -> None:
    figure.legend(handles=handles, loc="upper right", ncols=len(handles), borderpad=0, bbox_to_anchor=(0.993, 0.998))


def _span(time: Array) -> tuple[float, float]:
    return float(time[0]), float(time[-1]) if len(time) > 1 else float(time[0]) + 1
