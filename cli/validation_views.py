"""What a judged trajectory looks like: the section of its page, its film, its replay on the screen."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from retarget.cli import validation_page, video
from retarget.cli.console import printable
from retarget.cli.figures import thinned
from retarget.cli.validation_clip import Job, Record, replay_model
from retarget.cli.validation_figures import Curves, strip_edges, worst_problem
from retarget.cli.validation_page import Section, Shot
from retarget.core.errors import UsageError
from retarget.core.report import ValidationReport
from retarget.core.stick_figure import human_figure
from retarget.core.types import Array, HumanMotion, JointTrajectory

if TYPE_CHECKING:
    from retarget.core.replay.model import ReplayModel
    from retarget.core.replay.thresholds import Thresholds
    from retarget.core.robot_model import RobotModel

SHOTS, SHOT_SIZE = 6, (384, 480)
FILM_SIZE, FILM_RATE_HZ, VIEW_RATE_HZ = (800, 600), 30, 120
"""Width and height in pixels."""
PLACES = {"self-collision": "links in each other", "timing": "frames missing"}
LIMB = "limb unlike the person's"
MOTION, FEET = "motion beyond a limit", "base or feet beyond a limit"
TORQUE, TRACKING = "torque at its limit", "tracking error beyond its limit"
SATURATED = 1.0 - 1e-9
SCALE = {"deg": float(np.degrees(1.0)), "mm": 1000.0}
"""Unit of a joint's error → how many of them a rad or m is."""


def show(
    job: Job,
    trajectory: JointTrajectory,
    model: RobotModel,
    reports: Mapping[str, ValidationReport],
    limits: Mapping[str, Thresholds],
    motion: HumanMotion | None,
    record: Record,
) -> Section | None:
    """Write the film and the page that `job` asks for, open its window; the section where the caller makes the page."""
    curves = curves_of(trajectory, model, reports, limits)
    postures = _Postures(job, trajectory, model, reports, motion)
    if job.video:
        _film(job, postures, curves)
    section = None
    if job.wants_section:
        title = Path(job.input).name if job.input != "-" else "stdin"
        try:
            shots, reason = _shots(postures, curves), ""
        except UsageError as error:
            shots, reason = (), str(error)
        section = Section(printable(title), record, curves, shots, reason)
        if job.page:
            validation_page.write_page(Path(job.page), [section], overwrite=job.overwrite)
    if job.view:
        from retarget.core.replay import pictures

        times = np.arange(curves.time[0], curves.time[-1], 1 / VIEW_RATE_HZ)
        pictures.show(postures.replay.mj, times, postures.at(times))
    return section


def curves_of(
    trajectory: JointTrajectory,
    model: RobotModel,
    reports: Mapping[str, ValidationReport],
    limits: Mapping[str, Thresholds],
) -> Curves:
    """What is drawn, of the reports' series; `trajectory` has the model's joint order."""
    joints = model.joint_names
    edges, starts = strip_edges(trajectory.time)
    own, places = {MOTION: np.zeros((len(starts), len(joints)))}, {}
    for key, values in reports["kinematic"].series.items():
        kind, _, place = key.partition("/")
        if kind != "problem":
            continue
        pooled = np.maximum.reduceat(values, starts)
        if place in joints:
            own[MOTION][:, joints.index(place)] = pooled
        else:
            kind = LIMB if place in model.limbs else PLACES.get(place, FEET)
            places[place] = (kind, pooled)
    common: dict[str, Any] = {"joints": joints, "lower": model.lower, "upper": model.upper, "strip_time": edges}
    common["sliding"] = _sliding(model)
    if "fixed" not in reports:
        keep = thinned(trajectory.frames)
        return Curves(
            time=trajectory.time[keep], wanted=trajectory.position[keep], problems=own, whole_body=places, **common
        )
    series, facts = reports["fixed"].series, reports["fixed"].facts["joints"]
    time = series["time"]
    error = _of_joints(series, "joint_error", joints)
    units = [_unit(series, joint) for joint in joints]
    torque = np.stack([series[f"torque_nm/{joint}"] for joint in joints], axis=1)
    limit = _column(facts, joints, ["torque_limit_nm"] * len(joints), np.inf)
    ratio = np.where(np.isfinite(limit), np.abs(torque) / limit, 0.0)
    # Saturation is a problem at the limit already, not only beyond it, where it never gets.
    own[TORQUE] = _pooled(np.where(ratio >= SATURATED, 1.001, np.minimum(ratio, 1.0)), time, edges)
    most = [limits["fixed"].limits[f"joint_tracking_peak_{unit}"] for unit in units]
    per_limit = [SCALE[unit] / peak if peak else 0.0 for unit, peak in zip(units, most, strict=True)]
    own[TRACKING] = _pooled(np.abs(error) * per_limit, time, edges)
    scale = np.array([SCALE[unit] for unit in units])
    keep = thinned(len(time))
    wanted = _of_joints(series, "reference", joints)[keep]
    return Curves(
        time=time[keep],
        wanted=wanted,
        actual=wanted + error[keep],
        torque=torque[keep],
        rms_error=_column(facts, joints, [f"tracking_rmse_{unit}" for unit in units]) / scale,
        peak_error=_column(facts, joints, [f"tracking_peak_{unit}" for unit in units]) / scale,
        torque_limit=limit,
        torque_ratio=ratio.max(axis=0),
        problems=own,
        whole_body=places,
        **common,
    )


def _of_joints(series: Mapping[str, Array], what: str, joints: tuple[str, ...]) -> Array:
    """Series `what` of all joints (B, n) in rad, or m of sliding joints."""
    columns = []
    for joint in joints:
        unit = _unit(series, joint)
        columns.append(series[f"{what}_{unit}/{joint}"] / SCALE[unit])
    return np.stack(columns, axis=1)


def _sliding(model: RobotModel) -> tuple[bool, ...]:
    """(n,) which joints slide: pinocchio's prismatic ones, all others turn."""
    pin_model = model.pin_model
    first = pin_model.njoints - len(model.joint_names)
    kinds = [str(pin_model.joints[first + i].shortname()) for i in range(len(model.joint_names))]
    return tuple(kind.removeprefix("JointModel").startswith("P") for kind in kinds)


def _column(facts: Mapping[str, Any], joints: tuple[str, ...], keys: Sequence[str], unknown: float = np.nan) -> Array:
    """(n,) figure `keys[i]` of each joint."""
    values = [facts[joint][key] for joint, key in zip(joints, keys, strict=True)]
    return np.array([unknown if value is None else value for value in values], float)


def _unit(series: Mapping[str, Array], joint: str) -> str:
    return "deg" if f"joint_error_deg/{joint}" in series else "mm"


def _pooled(values: Array, time: Array, edges: Array) -> Array:
    """Greatest of `values` (B, n) at `time` (B,) in each column between `edges` (C + 1,); columns between two samples take the one before."""
    column = np.clip(np.searchsorted(edges, time, side="right") - 1, 0, len(edges) - 2)
    pooled = np.full((len(edges) - 1, values.shape[1]), -1.0)
    np.maximum.at(pooled, column, values)
    known = np.maximum.accumulate(np.where(pooled[:, 0] >= 0, np.arange(len(pooled)), 0))
    return np.asarray(np.maximum(pooled[known], 0.0))


class _Postures:
    """The robot, and the person where there is a recording, at any time of the clip."""

    def __init__(
        self,
        job: Job,
        trajectory: JointTrajectory,
        model: RobotModel,
        reports: Mapping[str, ValidationReport],
        motion: HumanMotion | None,
    ) -> None:
        self._trajectory = trajectory
        self._known = trajectory.time, trajectory.position
        if "fixed" in reports:
            series = reports["fixed"].series
            self._known = series["time"], _of_joints(series, "position", model.joint_names)
        # With dynamics the base is held where the replay held it; without them it moves as the trajectory says.
        self._held = "fixed" in reports or trajectory.base_position is None
        self.replay: ReplayModel = replay_model(job, model, "seen held" if self._held else "seen standing")
        self._motion = motion
        self._figure = None if motion is None else human_figure(motion)

    def at(self, times: Array) -> Array:
        """qpos (K, nq) at `times` (K,) s: what the replay did, or without dynamics what the trajectory says."""
        trajectory = self._trajectory
        joints = _interpolated(times, *self._known)
        position, orientation = trajectory.base_position, trajectory.base_orientation
        if self._held or position is None or orientation is None:
            return np.array([self.replay.configuration(row) for row in joints])
        frames = _nearest(trajectory.time, times)
        return np.array(
            [self.replay.configuration(row, orientation[k], position[k]) for row, k in zip(joints, frames, strict=True)]
        )

    def images(self, times: Array, size: tuple[int, int], smooth: int) -> Iterator[Any]:
        """Pictures at `times`, `size` wide and high."""
        from retarget.core.replay.pictures import Painter

        postures, person = self.at(times), None
        if self._motion is not None and self._figure is not None:
            clock = self._motion.time - self._motion.time[0]
            person = self._figure[0][_nearest(clock, times - self._trajectory.time[0])], self._figure[1]
        with Painter(self.replay.mj, postures, width=size[0], height=size[1], person=person, samples=smooth) as painter:
            for k, posture in enumerate(postures):
                yield painter.draw(posture, None if person is None else person[0][k])


def _shots(postures: _Postures, curves: Curves) -> tuple[Shot, ...]:
    """Evenly spaced snapshots, the same instants for trajectories of one length, and a last one of the worst problem."""
    start, end = curves.time[0], curves.time[-1]
    times = np.linspace(start, end, SHOTS if end > start else 1)
    problems = [""] * len(times)
    if (worst := worst_problem(curves)) is not None:
        times, problems = np.append(times, worst[2]), [*problems, worst[0]]
    images = postures.images(times, SHOT_SIZE, 4)
    return tuple(
        Shot(float(time_s), video.png(image), problem)
        for time_s, image, problem in zip(times, images, problems, strict=True)
    )


def _film(job: Job, postures: _Postures, curves: Curves) -> None:
    times = np.arange(curves.time[0], curves.time[-1] + 0.5 / FILM_RATE_HZ, 1 / FILM_RATE_HZ)
    times = np.minimum(times, curves.time[-1])
    problems = _problem_texts(curves, times)

    def images() -> Iterator[Any]:
        for time_s, text, image in zip(times, problems, postures.images(times, FILM_SIZE, 0), strict=True):
            yield video.captioned(image, f"{time_s:6.2f} s", text)

    video.write_mp4(Path(job.video), images(), FILM_RATE_HZ)


def _problem_texts(curves: Curves, times: Array) -> list[str]:
    """For each time what is worst then, "" where nothing is beyond its limit."""
    found = []
    for time_s in times:
        column = int(
            np.clip(np.searchsorted(curves.strip_time, time_s, side="right") - 1, 0, len(curves.strip_time) - 2)
        )
        best, text = 1.0, ""
        for kind, values in curves.problems.items():
            joint = int(np.argmax(values[column]))
            if values[column, joint] > best:
                best, text = float(values[column, joint]), f"{curves.joints[joint]}: {kind}"
        for place, (kind, values) in curves.whole_body.items():
            if values[column] > best:
                best, text = float(values[column]), f"{place}: {kind}"
        found.append(text)
    return found


def _nearest(times: Array, wanted: Array) -> NDArray[np.intp]:
    """Index of the entry of `times`, sorted, that is nearest to each of `wanted`."""
    right = np.clip(np.searchsorted(times, wanted), 1, max(1, len(times) - 1))
    right = np.minimum(right, len(times) - 1)
    left = np.maximum(right - 1, 0)
    return np.where(wanted - times[left] <= times[right] - wanted, left, right)


def _interpolated(times: Array, known: Array, values: Array) -> Array:
    """Columns of `values` (T, n) at `times` (K,), linearly between the `known` (T,) ones."""
    return np.stack([np.interp(times, known, column) for column in values.T], axis=1)
