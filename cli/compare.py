"""`retarget compare`: the hand mappings side by side, by the experiments of [Lim2022 sec. IV]."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from retarget.cli import options as o
from retarget.cli.console import Console
from retarget.cli.plan import PIPE
from retarget.cli.tracker_logs import log_facts, log_options, read_calibrated
from retarget.core.errors import InvalidDataError, MotionError, UsageError

if TYPE_CHECKING:
    from retarget.core.calibration import Calibration
    from retarget.core.comparison import Circles, Similarity, Square, Variant
    from retarget.core.robot_model import RobotModel
    from retarget.core.types import HumanMotion

CALIBRATION_SAMPLE, CIRCLES_SAMPLE = "calibration_trackers", "circles_trackers"
MOTION_SAMPLES = ("box_trackers", "clap_trackers")
"""Whose arms are compared."""
SYNTHETIC = "The samples are synthetic: computed, not recorded from a person."


@dataclass(frozen=True, eq=False)
class Clip:
    """A motion that was compared. motion: as compared, frame for frame with what the variants made of it."""

    name: str
    motion: HumanMotion
    results: Sequence[Similarity]


@dataclass(frozen=True, eq=False)
class Comparison:
    """All that the table, the JSON and the page show. circles: side → its circles, of the recording `circles_name`; notes: what could not be compared. about: a remark on
    the recordings."""

    model: RobotModel
    calibration: Calibration
    circles_name: str
    circles: dict[str, Circles]
    squares: dict[str, Square]
    clips: Sequence[Clip]
    notes: Sequence[str]
    about: str = ""


@click.command(cls=o.Command, short_help="Compare hand mappings by the experiments of Lim et al. 2022.")
@click.argument("recording", required=False, type=click.Path(allow_dash=True, readable=False), metavar="[INPUT]")
@click.option("--calibration", metavar="FILE.json", help="The operator, from retarget calibrate: INPUT needs it.")
@click.option("--robot", type=o.ROBOT, default="tocabi", show_default=True, help="Robot, or profile.")
@click.option(
    "--mapping",
    "mappings",
    multiple=True,
    type=o.MAPPING,
    help="Mapping of hands; repeat for several. [default: hand_position, proportional and absolute]",
)
@click.option(
    "--window",
    "window_s",
    type=o.Window(),
    help="When the hands draw circles, in s of the recording. [default: found, for each hand]",
)
@click.option("--start", "start_s", type=o.Number("S"), help="Leave out frames before this time of INPUT.")
@click.option("--end", "end_s", type=o.Number("S"), help="Leave out frames after this time of INPUT.")
@log_options("--rate")
@click.option("--report", metavar="DIR|FILE.html", help="Also write an HTML page with plots.")
@click.option("--force", is_flag=True, help="Replace a report that exists.")
@o.as_json("Print one JSON object on stdout instead of the table.")
@o.speech
@click.pass_obj
def compare(
    console: Console,
    /,
    recording: str | None,
    report: str | None,
    force: bool,
    as_json: bool,
    **choices: Any,
) -> None:
    """Compare hand mappings: how round the operator's circles come out, what becomes of a square, whose arms look most alike.

    INPUT is a tracker log, a suit recording (MVNX), or '-' for stdin; its circles are looked for, and its arms are compared throughout.
    Without it, the samples are compared: circles, a box that is carried, claps. proportional and absolute raise the hands by a constant
    that fits TOCABI and the paper's operator; they are shown a second time with the shoulders of both made level.
    """
    from retarget.cli.clip import without_nan
    from retarget.cli.comparison_table import record, text

    page = _page_path(report, recording, choices["robot"], overwrite=force) if report else None
    comparison = _compared(console, recording, **choices)
    if comparison.about:
        console.note(comparison.about)
    for note in comparison.notes:
        console.warning(note)
    if as_json:
        click.echo(json.dumps(without_nan(record(comparison)), allow_nan=False))
    else:
        click.echo(text(comparison))
    if page is not None:
        from retarget.cli import plan
        from retarget.cli.comparison_page import page as written

        plan.write_whole(page, written(comparison).encode())
        console.note(f"{page}: written; open it in a browser")


def _compared(
    console: Console,
    recording: str | None,
    *,
    calibration: str | None,
    robot: str,
    mappings: Sequence[str],
    window_s: tuple[float, float] | None,
    start_s: float | None,
    end_s: float | None,
    **log: Any,
) -> Comparison:
    from retarget.cli.clip import model_for
    from retarget.core import comparison, experiments, timebase
    from retarget.core.mapping.arm_frames import arm_frames

    facts = log_facts(log)
    names = list(dict.fromkeys(mappings or experiments.HAND_MAPPINGS))
    comparison.check_mappings(names)
    if recording is None:
        if calibration or start_s is not None or end_s is not None or any(facts.values()):
            raise UsageError("no INPUT: the samples are compared, with a calibration of their own; give a recording")
        recordings = _samples()
        circles_name = CIRCLES_SAMPLE
        shown: tuple[str, ...] = MOTION_SAMPLES
    else:
        motion = timebase.cut(_motion(console, recording, calibration, facts), start_s, end_s)
        circles_name = "stdin" if recording == PIPE else Path(recording).name
        recordings, shown = {circles_name: motion}, (circles_name,)
    drawn = recordings[circles_name]
    model = model_for(robot, drawn)
    arm_frames(model)  # a robot without arms stops here
    if drawn.calibration is None:
        raise UsageError(
            f"{circles_name}: nothing is known of the person; give --calibration FILE.json (retarget calibrate makes it)"
        )
    circles, notes = _circles(drawn, circles_name, model, names, window_s)
    return Comparison(
        model=model,
        calibration=drawn.calibration,
        circles_name=circles_name,
        circles=circles,
        squares=comparison.squares(drawn.calibration, model),
        clips=[_clip(console, name, recordings[name], model, comparison.variants(names)) for name in shown],
        notes=notes,
        about=SYNTHETIC if recording is None else "",
    )


def _samples() -> dict[str, HumanMotion]:
    """The operator's samples as motions, calibrated by the poses among them. What their reader remarks is known and not said."""
    from retarget import formats, samples
    from retarget.core.calibrate import operator
    from retarget.core.calibrate.apply import apply
    from retarget.core.calibration import POSES

    options = formats.TrackerOptions(up="y")
    read = {
        name: formats.read_trackers(str(samples.sample_path(name)), options=options)
        for name in (CALIBRATION_SAMPLE, CIRCLES_SAMPLE, *MOTION_SAMPLES)
    }
    poses = read.pop(CALIBRATION_SAMPLE)
    calibration = operator.calibrate(dict.fromkeys(POSES, poses))
    return {name: apply(calibration, recording) for name, recording in read.items()}


def _motion(console: Console, path: str, calibration: str | None, facts: dict[str, Any]) -> HumanMotion:
    motion = read_calibrated(path, calibration, facts)
    for warning in motion.source.warnings:
        console.warning(warning)
    return motion


def _circles(
    motion: HumanMotion, name: str, model: RobotModel, mappings: Sequence[str], window_s: tuple[float, float] | None
) -> tuple[dict[str, Circles], list[str]]:
    """Side → circles, and what to say of the hands that drew none."""
    from retarget.core import comparison
    from retarget.core.calibration import SIDES

    try:
        found = comparison.circles(motion, model, mappings, window_s)
    except (InvalidDataError, MotionError) as error:
        if window_s is not None:
            raise UsageError(f"--window {window_s[0]:g}:{window_s[1]:g}: {name}: {error}") from error
        raise
    without = [side.lower() for side in SIDES if side not in found]
    if not without:
        return found, []
    hands = "neither hand draws" if len(without) == 2 else f"the {without[0]} hand does not draw"
    return found, [
        f"{name}: {hands} circles, so that no circle index is given; --window START:END tells where they are"
    ]


def _clip(console: Console, name: str, motion: HumanMotion, model: RobotModel, chosen: Sequence[Variant]) -> Clip:
    from retarget.core import comparison

    compared = comparison.at_rate(motion)
    with console.progress(name) as progress:
        return Clip(name, compared, comparison.similarity(compared, model, chosen, progress))


def _page_path(report: str, recording: str | None, robot: str, *, overwrite: bool) -> Path:
    """Where the page goes, checked before any work; a folder is made."""
    from retarget import formats
    from retarget.cli import plan

    path = Path(report)
    if path.suffix.lower() not in (".html", ".htm"):
        suffixes = [suffix for format_ in formats.available().values() for suffix in format_.suffixes]
        stem = plan.stem(recording, suffixes) if recording else "samples"
        name = Path(robot).stem if robot.endswith(".toml") else robot
        try:
            path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise UsageError(f"--report {report}: can't be made a folder ({error.strerror})") from None
        path = path / f"compare_{stem}_{name}.html"
    plan.check_single_files([str(path)], [recording] if recording else [], overwrite=overwrite)
    return path
