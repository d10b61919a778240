"""`retarget validate`: trajectories in, a verdict out."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from retarget.cli import options as o
from retarget.cli.console import Console, leave, printable
from retarget.cli.input_files import collect_inputs
from retarget.cli.main import tell_failure
from retarget.cli.plan import PIPE
from retarget.cli.tracker_logs import LOG_CHOICES, LOG_RATE, log_facts, log_options
from retarget.core.errors import UsageError

if TYPE_CHECKING:
    from retarget.cli.validation_clip import Done, Job
    from retarget.core.batch import Outcome

MODES = ("kinematic", "fixed")
GAINS = ("auto", "profile", "inertia")


@click.command(cls=o.Command, short_help="Replay trajectories in physics and give a verdict.")
@click.argument("inputs", nargs=-1, type=click.Path(allow_dash=True, readable=False))
@o.choice(
    "--mode",
    of=MODES,
    text="kinematic: limits, jumps, collisions, feet, without dynamics. fixed: these, then torque control on a fixed base.",
    default="fixed",
)
@click.option("--robot", type=o.ROBOT, help="Robot, or profile. [default: the trajectory's own]")
@click.option("--thresholds", "thresholds_file", metavar="FILE.toml", help="Limits of the checks.")
@click.option(
    "--max",
    "overrides",
    multiple=True,
    type=o.Pair("NAME=VALUE"),
    help="Limit of one check, before those of the file; 'none' = report only. Repeat for several.",
)
@click.option(
    "--report", metavar="DIR|FILE.html", help="HTML page: a file compares all inputs, a folder gets a page each."
)
@click.option("--video", metavar="FILE.mp4", help="Film of the replay; {stem} is filled in. Needs the extra [video].")
@click.option(
    "--log", metavar="FILE.h5", help="All signals of the torque control at 2 kHz, as HDF5; {stem} is filled in."
)
@click.option("--view", is_flag=True, help="Show the replay in MuJoCo's viewer; one input.")
@click.option(
    "--recording",
    metavar="FILE",
    help="What the person did: limbs are compared with it, and pictures show it beside the robot.",
)
@click.option(
    "--calibration",
    metavar="FILE.json",
    help="The operator of the recording, from retarget calibrate: tracker logs need it.",
)
@log_options(LOG_RATE)
@o.choice(
    "--gains",
    of=GAINS,
    text="Gains of the torque control: the profile's, or from inertia; auto takes the profile's, but not what it states for standing legs.",
)
@click.option("--feed-forward", is_flag=True, help="Add the reference's inverse dynamics to the torque control.")
@click.option("--self-collision", is_flag=True, help="Let links that meet push each other in the torque control.")
@click.option(
    "--csv-style",
    type=click.Choice(["unitree"]),
    help="Read CSV without a header: root position, root quaternion xyzw, joints; as Unitree and GMR write it.",
)
@click.option(
    "--joint-order",
    metavar="urdf|isaac|FILE",
    help="Joints of files that name none: in the URDF's order (Unitree, GMR), in Isaac Sim's (BeyondMimic's npz), or listed in a file, "
    "a name a line. [default with --csv-style: urdf]",
)
@click.option(
    "--quaternion-order",
    type=click.Choice(["wxyz", "xyzw"]),
    help="Of the base, in files that don't say. [default: xyzw in headerless CSV and GMR's npz, wxyz in BeyondMimic's]",
)
@click.option("--rate", "rate_hz", type=o.Number("HZ", above=0), help="Frame rate of files without times.")
@o.many_inputs("trajectories")
@click.option("--force", is_flag=True, help="Replace outputs that exist.")
@o.jobs
@o.as_json("Print one JSON object per clip and line on stdout.")
@o.speech
@click.pass_obj
def validate(
    console: Console, /, inputs: tuple[str, ...], jobs: int, as_json: bool, view: bool, **choices: Any
) -> None:
    """Say whether robots can do the trajectories INPUTS: files, folders with -r, or '-' for an MCAP stream on stdin.

    \b
      retarget convert walk.mvnx --robot icub -o - | retarget validate -
      retarget validate walk_g1.mcap --max joint_tracking_rmse_deg=1 --report walk.html

    Exit codes: 0 every check passed, 1 a clip could not be judged, 2 usage, 3 a check failed: stderr says which, where and when.
    """
    from retarget.cli import video

    if view:
        _check_screen()
    elif choices["report"] or choices["video"]:
        video.choose_opengl()  # before anything imports mujoco
    jobs_, report = _plan(inputs, view=view, **choices)
    codes, sections = set(), []
    for job, outcome in zip(jobs_, _outcomes(jobs_, jobs), strict=True):
        count = f"[{outcome.index + 1}/{len(jobs_)}] " if len(jobs_) > 1 else ""
        _tell(job, outcome, count, as_json, console)
        done = outcome.value
        if done is not None and done.section is not None:
            sections.append(done.section)
        codes.add(outcome.exit_code if done is None else (0 if done.record["passed"] else 3))
    if report and sections:
        from retarget.cli import validation_page

        validation_page.write_page(Path(report), sections, overwrite=choices["force"])
    if codes - {0, 3}:
        # A mistake in the options stops every clip in the same way: then it is a usage error, not a failed clip.
        leave(2 if codes == {2} else 1)
    if 3 in codes:
        leave(3)


def _plan(
    inputs: tuple[str, ...],
    *,
    view: bool,
    files_from: str | None,
    nul: bool,
    recursive: bool,
    force: bool,
    report: str | None,
    video: str | None,
    log: str | None,
    overrides: Sequence[tuple[str, str]],
    **settings: Any,
) -> tuple[list[Job], str]:
    """The work, everything checked that can be checked before it, and the page that compares all of it, "" for none."""
    from retarget import formats
    from retarget import robots as profiles
    from retarget.cli import plan
    from retarget.cli import video as films
    from retarget.cli.validation_clip import Job, thresholds_of

    names = collect_inputs(inputs, files_from, nul=nul, recursive=recursive, kind="trajectory")
    if view and len(names) > 1:
        raise UsageError(f"--view shows one trajectory; found {len(names)}")
    if log and settings["mode"] == "kinematic":
        raise UsageError("--log holds the signals of the torque control; kinematic mode has none")
    if log and not log.lower().endswith((".h5", ".hdf5")):
        raise UsageError(f"--log {log}: expected a file name ending in .h5")
    if video:
        films.check_installed()
        if not video.lower().endswith(".mp4"):
            raise UsageError(f"--video {video}: expected a file name ending in .mp4")
    if settings["recording"] == PIPE:
        raise UsageError("--recording takes a file; stdin is for a trajectory")
    if not settings["recording"]:
        for name, option in {"calibration": "--calibration", **LOG_CHOICES}.items():
            if settings[name]:
                raise UsageError(f"{option} is of the --recording; give it too")
    reader = log_facts(settings)
    if settings["robot"]:
        profiles.load(settings["robot"])
    texts = tuple(f"{name}={value}" for name, value in overrides)
    thresholds_of(settings["mode"], settings["thresholds_file"], texts)
    whole = report if report and report.lower().endswith((".html", ".htm")) else ""
    suffixes = [suffix for format_ in formats.available().values() for suffix in format_.suffixes]
    work = []
    for name in names:
        stem = plan.stem(name, suffixes)
        page = str(Path(report) / f"{stem}_validation.html") if report and not whole else ""
        work.append(
            Job(
                input=name,
                video=plan.with_stem(video or "", stem, "--video"),
                log=plan.with_stem(log or "", stem, "--log"),
                page=page,
                wants_section=bool(report),
                overwrite=force,
                view=view,
                overrides=texts,
                reader=reader,
                **settings,
            )
        )
    outputs = [path for job in work for path in (job.video, job.log, job.page) if path] + ([whole] if whole else [])
    if report and not whole:
        _make_folder(report)
    plan.check_single_files(
        outputs, [*names, *([settings["recording"]] if settings["recording"] else [])], overwrite=force
    )
    return work, whole


def _outcomes(work: list[Job], jobs: int) -> Iterator[Outcome[Done]]:
    from retarget.cli.validation_clip import validate_clip
    from retarget.core import batch

    if jobs == 1 or len(work) == 1:
        yield from batch.run(validate_clip, work)
    else:
        with batch.process_pool(min(jobs, len(work))) as pool:
            yield from batch.run(validate_clip, work, pool)


def _tell(job: Job, outcome: Outcome[Done], count: str, as_json: bool, console: Console) -> None:
    """The clip's JSON or table on stdout; its failure, or what failed in it, on stderr."""
    from retarget.cli.validation_clip import failed_record

    done = outcome.value
    if done is None:
        tell_failure(console, job.shown, outcome, count)
        record = failed_record(job, outcome.error)
    else:
        record = done.record
    if as_json:
        click.echo(json.dumps(record, allow_nan=False))
    elif done is not None:
        click.echo(_table(job.shown, record))
    if done is not None:
        for warning in record["warnings"]:
            console.warning(warning)
        for check in record["checks"]:
            if check["passed"] is False:
                console.error(f"{count}{job.shown}: {_failure(check)}")


def _failure(check: dict[str, Any]) -> str:
    """One line: which check failed, by how much, where and when."""
    from retarget.cli.summary import measured, number, remark

    return f"{check['name']} is {measured(check)}, limit {number(check['limit'])}: {remark(check)}".rstrip(": ")


def _table(shown: str, record: dict[str, Any]) -> str:
    """The verdict and every check, in columns."""
    from retarget.cli.summary import measured, number, remark, table, verdict

    speed = f"{record['real_time_factor']:.0f} × real time"
    state = "passed" if record["passed"] else "FAILED"
    head = f"{printable(shown)} on {record['robot']}, {record['mode']}: {state} ({record['duration_s']:.1f} s, {speed})"
    rows = [["  check", "value", "limit", "verdict", " where"]]
    for check in record["checks"]:
        limit = "" if check["limit"] is None else number(check["limit"])
        rows.append([f"  {check['name']}", measured(check), limit, verdict(check), f" {remark(check)}"])
    width = max(len(row[-1]) for row in rows)
    return head + "\n" + table([[*row[:-1], row[-1].ljust(width)] for row in rows])


def _make_folder(folder: str) -> None:
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"--report {folder}: can't be made a folder ({error.strerror})") from None


def _check_screen() -> None:
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise UsageError("--view needs a screen (DISPLAY is not set); --video FILE.mp4 films without one")
