"""`retarget convert`: recordings in, joint trajectories out."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import click
from retarget.cli import options as o
from retarget.cli.console import Console, leave, printable
from retarget.cli.input_files import collect_inputs
from retarget.cli.main import tell_failure
from retarget.cli.plan import PIPE, Clip
from retarget.cli.tracker_logs import LOG_RATE, load_calibration, log_facts, log_options
from retarget.core.errors import UnknownNameError, UsageError

if TYPE_CHECKING:
    from retarget.core.batch import Outcome


@click.command(cls=o.Command, short_help="Turn recordings into robot joint trajectories.")
@click.argument("inputs", nargs=-1, type=click.Path(allow_dash=True, readable=False))
@click.option(
    "--robot", "robots", multiple=True, required=True, type=o.ROBOT, help="Robot, or profile; repeat for several."
)
@click.option(
    "-o",
    "--output",
    metavar="TEMPLATE|-",
    help="Output file, with {stem}, {robot}, {mapping}, {format} filled in; '-' is stdout. Folders before the first "
    "placeholder must exist. [default: {stem}_{robot}.mcap]",
)
@click.option(
    "--format",
    "format_",
    type=o.FORMAT,
    help="mcap, rosbag2, hdf5, csv, npz or lerobot. [default: by the output's suffix]",
)
@click.option(
    "--style", metavar="NAME", help="Variant of the format: mcap and rosbag2 joint_trajectory, npz gmr, csv unitree."
)
@click.option("--csv-style", type=o.CSV_STYLE, help="Columns of CSV: header or unitree. [default: header]")
@o.choice(
    "--method",
    of=["geometric", "telemanipulation"],
    text="geometric follows every measured segment's orientation; telemanipulation places the hands, the rest by strict priorities.",
)
@click.option("--calibration", metavar="FILE.json", help="The operator, from retarget calibrate: tracker logs need it.")
@click.option(
    "--mapping",
    type=o.MAPPING,
    help="limb_plane or link_orientation; of hands: hand_position, proportional or absolute. [default: limb_plane, or "
    "hand_position for telemanipulation]",
)
@o.choice(
    "--solver",
    of=["auto", "dynamical", "hierarchical"],
    text="One QP a frame, or strict priorities; auto by the mapping.",
)
@click.option("--blend-hands", is_flag=True, help="Let the robot's hands meet when the operator's do (hand_position).")
@log_options(LOG_RATE)
@o.choice(
    "--base",
    of=["auto", "fixed", "human", "contact"],
    text="Base motion: fixed, along the person's pelvis, or with the stance feet kept in place.",
)
@click.option(
    "--online", is_flag=True, help="One solver step a frame, as in a live loop, instead of converging each frame."
)
@click.option(
    "--rate", "rate_hz", type=o.Number("HZ", above=0), help="Resample to this rate. [default: the recording's]"
)
@click.option("--start", "start_s", type=o.Number("S"), help="Leave out frames before this time of the recording.")
@click.option("--end", "end_s", type=o.Number("S"), help="Leave out frames after this time of the recording.")
@click.option(
    "--smooth",
    "smooth_s",
    type=o.Number("S", least=0),
    default=0.0,
    help="Average the result over ± this time, without lag; limits hold all the same. [default: none]",
)
@o.choice(
    "--kernel",
    of=["auto", "numpy", "compiled"],
    text="Solver code, the same results: compiled takes some seconds the first time (15, or 4 for hands); auto takes it for long clips.",
)
@click.option(
    "--human",
    is_flag=True,
    help="Write the person's frames along, for Foxglove and RViz: mcap, rosbag2; twice the size.",
)
@click.option(
    "--self-collision",
    is_flag=True,
    help="Also count the frames in which links overlap by more than 20 mm (self_collision_fraction): about as long again.",
)
@click.option(
    "--rerun", metavar="DIR|FILE.rrd", help="Also write a Rerun recording of person, targets, robot and errors."
)
@click.option("--report", metavar="DIR|FILE.html", help="Also write an HTML page with plots.")
@o.many_inputs("recordings")
@click.option("--skip-existing", is_flag=True, help="Leave outputs that exist alone.")
@click.option("--force", is_flag=True, help="Replace outputs that exist.")
@click.option("-n", "--dry-run", is_flag=True, help="Check everything, print what would be done, do nothing.")
@o.jobs
@click.option("--shard", type=o.Shard(), help="Do only the I-th of N parts of the work (I from 1).")
@o.as_json("Print one JSON object per clip and line on stdout.")
@o.speech
@click.pass_obj
def convert(
    console: Console,
    /,
    inputs: tuple[str, ...],
    robots: tuple[str, ...],
    output: str | None,
    jobs: int,
    dry_run: bool,
    as_json: bool,
    **choices: Any,
) -> None:
    """Turn recordings INPUTS into robot joint trajectories.

    INPUTS are recordings of suits (MVNX, ROS bags, MCAP), or, with --calibration, logs of trackers: files, folders with -r, or '-' for stdin. Everything is checked before any work: two inputs for one output, an
    output that exists or a folder that can't be written end the command with nothing done. Outputs are renamed into place
    when they are complete: a file that exists is finished.

    To a pipe (-o -, as mcap), recordings longer than 30 s are converted in blocks as they arrive: 2 s first, then 20 s at a time, each together
    with 5 s before and after it. Memory does not grow with the recording (MVNX, and MCAP of a suit whose frames are on one topic; bags and
    trackers are read first), and joint angles are those of a file, to 1e-6 rad in ordinary motion. --human, --report, --rerun, --online, other formats and styles, and the hierarchical solver take
    the recording as a whole. Where the input breaks off the output has no end, so that the next program sees it.
    """
    if output == PIPE and as_json:
        raise UsageError("-o - and --json both want stdout; choose one")
    clips, skipped = _plan(inputs, robots, output, **choices)
    for clip in skipped:
        console.note(f"{clip.output}: exists, skipped")
    if dry_run:
        for clip in clips:
            _print_plan(clip, as_json)
        return
    if output == PIPE and sys.stdout is not None and sys.stdout.isatty():
        raise UsageError("-o - would write the trajectory to the terminal; redirect it, or use -o FILE")
    codes = set()
    for clip, outcome in zip(clips, _outcomes(clips, jobs, console), strict=True):
        count = f"[{outcome.index + 1}/{len(clips)}] " if len(clips) > 1 else ""
        _tell(clip, outcome, count, as_json, console)
        codes.add(outcome.exit_code)
    if codes - {0}:
        # A mistake in the options stops every clip in the same way: then it is a usage error, not a failed clip.
        leave(2 if codes == {2} else 1)


def _plan(
    inputs: tuple[str, ...],
    robots: tuple[str, ...],
    output: str | None,
    *,
    format_: str | None,
    style: str | None,
    csv_style: str | None,
    human: bool,
    self_collision: bool,
    report: str | None,
    rerun: str | None,
    files_from: str | None,
    nul: bool,
    recursive: bool,
    skip_existing: bool,
    force: bool,
    shard: tuple[int, int] | None,
    method: str,
    calibration: str | None,
    blend_hands: bool,
    **options: Any,
) -> tuple[list[Clip], list[Clip]]:
    """(clips to convert, clips to skip), everything checked that can be checked before work."""
    from retarget import formats
    from retarget import robots as profiles
    from retarget.cli import plan
    from retarget.cli.clip import robot_model
    from retarget.core import batch, pipeline

    log = log_facts(options)
    options["mapping"] = options["mapping"] or pipeline.METHODS[method]
    options["settings"] = {"blend_hands": True} if blend_hands else {}
    pipeline.check_mapping(pipeline.ConvertOptions(**options))
    if calibration:
        load_calibration(calibration)
    elif pipeline.needs_calibration(options["mapping"]):
        raise UsageError(
            f"mapping '{options['mapping']}' needs the operator; give --calibration FILE.json (retarget calibrate makes it)"
        )
    if force and skip_existing:
        raise UsageError("--force and --skip-existing contradict each other")
    if options["start_s"] is not None and options["end_s"] is not None and options["end_s"] <= options["start_s"]:
        raise UsageError(f"--end {options['end_s']:g} is not after --start {options['start_s']:g}")
    known = formats.available()
    target = plan.output_format(output, format_, known)
    if csv_style and target.name != "csv":
        raise UsageError(f"--csv-style is for CSV; the output is {target.name}")
    if csv_style and style and csv_style != style:
        raise UsageError(f"--style {style} and --csv-style {csv_style} contradict each other")
    style = csv_style or style
    if style and style not in target.styles:
        raise UnknownNameError(f"{target.name} style", style, target.styles, where="--style")
    if rerun:
        from retarget.cli import rerun_log

        rerun_log.check_installed()
    chosen = {robot: profiles.load(robot) for robot in dict.fromkeys(robots)}
    names = collect_inputs(inputs, files_from, nul=nul, recursive=recursive, logs=calibration is not None)
    template = plan.folder_template(output, target)
    clips = plan.make(
        names,
        chosen,
        template,
        target,
        known=known,
        mapping=options["mapping"],
        report=report,
        rerun=rerun,
        style=style,
        human=human,
        self_collision=self_collision,
        overwrite=force,
        options=options,
        method=method,
        calibration=calibration,
        log=log,
    )
    clips = batch.shard(clips, *shard) if shard else clips
    done = [skip_existing and plan.is_finished(clip) for clip in clips]
    skipped = [clip for clip, is_done in zip(clips, done, strict=True) if is_done]
    clips = [clip for clip, is_done in zip(clips, done, strict=True) if not is_done]
    plan.check_outputs(clips, template)
    for robot, profile in chosen.items():
        if profile.model.kind != "human":
            robot_model(robot)  # a profile that doesn't fit its model should stop the command here, not every clip
    return clips, skipped


def _outcomes(clips: list[Clip], jobs: int, console: Console) -> Iterator[Outcome[dict[str, Any]]]:
    from retarget.cli.clip import convert_clip
    from retarget.core import batch

    if len(clips) == 1:
        with console.progress(clips[0].robot_name) as progress:

            def work(clip: Clip) -> dict[str, Any]:
                return convert_clip(clip, progress)

            outcomes = list(batch.run(work, clips))
        yield from outcomes
    elif jobs == 1 or not clips:
        yield from batch.run(convert_clip, clips)
    else:
        with batch.process_pool(min(jobs, len(clips))) as pool:
            yield from batch.run(convert_clip, clips, pool)


def _print_plan(clip: Clip, as_json: bool) -> None:
    if as_json:
        click.echo(
            json.dumps({"input": clip.input, "output": clip.output, "robot": clip.robot_name, "status": "planned"})
        )
    else:
        click.echo(f"{clip.input} → {clip.output}")


def _tell(clip: Clip, outcome: Outcome[dict[str, Any]], count: str, as_json: bool, console: Console) -> None:
    """The clip's JSON on stdout, its line or its error on stderr."""
    from retarget.cli.clip import failed_record
    from retarget.cli.summary import clip_line, clip_notes, stage_line

    record = outcome.value
    if record is None:
        tell_failure(console, clip.input, outcome, count)
        record = failed_record(clip, outcome.error)
    else:
        console.note(count + printable(clip_line(record)))
        for note in clip_notes(record):
            console.warning(note)
        console.detail(stage_line(record))
    if as_json:
        click.echo(json.dumps(record, allow_nan=False))
