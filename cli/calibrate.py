"""`retarget calibrate`: recordings of three poses in, the operator out."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from retarget.cli import options as o
from retarget.cli.console import Console, printable
from retarget.cli.input_files import collect_inputs
from retarget.cli.plan import PIPE
from retarget.cli.tracker_logs import log_facts, log_options, read_recording
from retarget.core.errors import MotionError, UsageError

if TYPE_CHECKING:
    from retarget.core.calibration import Calibration

DEFAULT_OUTPUT = "operator.json"
PICTURES = (".png", ".svg")


@click.command(cls=o.Command, short_help="Make an operator's calibration of recordings of three poses.")
@click.argument("inputs", nargs=-1, required=True, type=click.Path(allow_dash=True, readable=False))
@click.option(
    "-o",
    "--output",
    metavar="FILE.json|-",
    default=DEFAULT_OUTPUT,
    show_default=True,
    help="The calibration; '-' is stdout.",
)
@click.option("--still", type=o.Window(), help="When the Still pose is held (arms down), in s of its recording.")
@click.option("--tpose", type=o.Window(), help="When the T-pose is held (arms out to the sides).")
@click.option("--forward", type=o.Window(), help="When the Forward pose is held (arms straight ahead).")
@click.option(
    "--assign",
    "assign_by",
    type=click.Choice(["roles", "auto"]),
    help="Which tracker is where: by the recording's roles, or by geometry. [default: roles where they name chest and hands]",
)
@log_options("--rate")
@click.option(
    "--hand-offset",
    type=o.Vector(),
    help="From the hand's tracker to the hand point, in m. [default: -0.08,0,0; from a suit: 0,0,0]",
)
@o.choice(
    "--hand-offset-frame",
    of=["tracker", "hand"],
    text="Axes of --hand-offset: the tracker's own, or the hand's in T-pose (ahead, outward along the arm, up), for any mount.",
)
@click.option("--picture", metavar="FILE.png|FILE.svg", help="Also draw the calibrated person.")
@click.option("--force", is_flag=True, help="Replace outputs that exist.")
@o.as_json("Print the calibration on stdout as well, as one line of JSON.")
@o.speech
@click.pass_obj
def calibrate(
    console: Console,
    /,
    inputs: tuple[str, ...],
    output: str,
    still: tuple[float, float] | None,
    tpose: tuple[float, float] | None,
    forward: tuple[float, float] | None,
    picture: str | None,
    force: bool,
    as_json: bool,
    **choices: Any,
) -> None:
    """Make an operator's calibration: shoulders, arm lengths, facing direction, and how each tracker is strapped on.

    INPUTS is one recording that holds the three poses, or three: Still pose (arms down), T-pose and Forward pose (arms straight
    ahead), in this order. Tracker logs or suit recordings (MVNX), or '-' for stdin. When a pose is held is told by --still, --tpose and
    --forward (START:END), or found: the still stretches whose arms fit the poses best.
    """
    from retarget.cli import plan
    from retarget.core.calibration import POSES

    if len(inputs) not in (1, 3):
        raise UsageError(
            f"found {len(inputs)} inputs; expected one recording of all three poses, or three: Still, T and Forward"
        )
    collect_inputs(inputs, None)
    if output == PIPE and as_json:
        raise UsageError("-o - and --json both want stdout; choose one")
    if picture is not None and not picture.lower().endswith(PICTURES):
        raise UsageError(f"--picture {picture}: expected a file name ending in {' or '.join(PICTURES)}")
    files = ([] if output == PIPE else [output]) + ([picture] if picture else [])
    plan.check_single_files(files, inputs, overwrite=force)
    given = {"still": still, "tpose": tpose, "forward": forward}
    windows = {pose: given[pose] for pose in POSES if given[pose] is not None}
    calibration = _calibration(console, inputs, windows, **choices)
    if picture is not None:
        from retarget.cli import calibration_picture

        plan.write_whole(picture, calibration_picture.drawn(calibration, Path(picture).suffix.lower()))
    text = calibration.to_json()
    if output == PIPE:
        click.echo(text, nl=False)
    else:
        plan.write_whole(output, text.encode())
    if as_json:
        click.echo(json.dumps(json.loads(text), allow_nan=False))
    _tell(console, calibration, output)


def _calibration(
    console: Console,
    inputs: Sequence[str],
    windows: Mapping[str, Any],
    *,
    assign_by: Any,
    hand_offset: Sequence[float] | None,
    hand_offset_frame: Any,
    **choices: Any,
) -> Calibration:
    from retarget.core.calibrate import operator
    from retarget.core.calibration import POSES

    facts = log_facts(choices)
    recordings = {path: read_recording(path, facts) for path in dict.fromkeys(inputs)}
    # Before anything can fail: a wrong axis or a lost tracker explains what follows.
    for path, recording in recordings.items():
        for warning in recording.source.warnings:
            console.warning(warning if len(recordings) == 1 else f"{path}: {warning}")
    paths = inputs if len(inputs) == 3 else [inputs[0]] * 3
    by_pose = {pose: recordings[path] for pose, path in zip(POSES, paths, strict=True)}
    shown = ", ".join("stdin" if path == PIPE else path for path in dict.fromkeys(inputs))
    try:
        return operator.calibrate(
            by_pose,
            windows=windows,
            assign_by=assign_by,
            hand_offset_m=hand_offset,
            hand_offset_frame=hand_offset_frame,
        )
    except MotionError as error:
        raise MotionError(f"{shown}: {error}") from error


def _tell(console: Console, calibration: Calibration, output: str) -> None:
    """What was found, in a few lines; what the reader found has been told."""
    from retarget.core.calibration import POSE_NAMES, POSES, SIDES

    windows = ", ".join(
        f"{POSE_NAMES[pose]} {start:.2f}:{end:.2f}"
        for pose, (start, end) in ((pose, calibration.windows_s[pose]) for pose in POSES)
    )
    arms = ", ".join(
        f"{side.lower()} arm {calibration.arms[side].length_m:.3f} m "
        f"({'/'.join(f'{angle:.0f}' for angle in calibration.arms[side].angles_deg)}°)"
        for side in SIDES
    )
    console.note(printable(f"{windows} s; {arms}" + (f" → {output}" if output != PIPE else "")))
    margins = {
        name.partition("/")[2]: value
        for name, value in calibration.residuals.items()
        if name.startswith("assignment_margin_m/")
    }
    for segment, tracker in calibration.trackers.items():
        if segment in margins:
            console.note(printable(f"  {segment}: {tracker}, by {100 * margins[segment]:.0f} cm"))
    for name, value in calibration.residuals.items():
        console.detail(f"  {name}: {value:.4g}")
    for warning in calibration.warnings:
        console.warning(warning)
