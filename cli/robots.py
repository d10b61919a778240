"""`retarget robots`: which robots there are, what a profile says, and whether it fits its model."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from retarget.cli import options as o
from retarget.cli.console import Console, leave
from retarget.core.errors import UsageError

if TYPE_CHECKING:
    from retarget.core.profile import RobotProfile
    from retarget.core.report import ValidationReport
    from retarget.core.robot_model import RobotModel


@click.group(short_help="List, show and check robots, start a new one.")
def robots() -> None:
    """List, show and check robots.

    A robot is a name from the list, or a profile of your own: --robot ./mine.toml.
    """


@robots.command("list")
@o.as_json("Print one JSON object per robot and line on stdout.")
@o.speech
def list_robots(as_json: bool) -> None:
    """List the robots known by name."""
    from retarget import robots as profiles
    from retarget.cli.summary import table

    found = [facts(profiles.load(name)) for name in profiles.names()]
    if as_json:
        for fact in found:
            click.echo(json.dumps(fact))
    else:
        rows = [[f["name"], _text(f["dof"]), _text(f["mass_kg"]), f["base"], " " + f["description"]] for f in found]
        width = max(len(row[-1]) for row in rows)
        click.echo(
            table([["robot", "DoF", "kg", "base", " description".ljust(width)], *(_left(r, width) for r in rows)])
        )


@robots.command()
@click.argument("name", type=o.ROBOT)
@o.as_json()
@o.speech
def show(name: str, as_json: bool) -> None:
    """Show the robot NAME: where its model comes from, its links and its joints with their limits."""
    from retarget import robots as profiles

    profile = profiles.load(name)
    shown = {**facts(profile), "links": dict(profile.links), "joints": _joints(profile)}
    click.echo(json.dumps(shown) if as_json else _readable(shown))


@robots.command()
@click.argument("names", nargs=-1, type=o.ROBOT, metavar="[NAME|FILE.toml]...")
@click.option("--all", "every", is_flag=True, help="Check every robot known by name.")
@o.as_json("Print one JSON object per robot and line on stdout.")
@o.speech
@click.pass_obj
def check(console: Console, names: tuple[str, ...], every: bool, as_json: bool) -> None:
    """Check that the profiles NAMES fit their models: links, joints, limits, and the T-pose by forward kinematics.

    Exit code 3 when a check fails.
    """
    from retarget import robots as profiles

    if every == bool(names):
        raise UsageError("give robots to check, or --all")
    reports = [_check(profiles.load(name)) for name in (profiles.names() if every else names)]
    for report in reports:
        _print_report(report, as_json, console)
    if not all(report.passed for report in reports):
        leave(3)


@robots.command()
@click.argument("model", type=click.Path(path_type=Path), metavar="MODEL.urdf|MODEL.xml")
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    metavar="FILE.toml",
    help="The profile to write. Default: MODEL.toml here.",
)
@click.option("--force", is_flag=True, help="Replace a profile that exists.")
@o.speech
@click.pass_obj
def new(console: Console, model: Path, output: Path | None, force: bool) -> None:
    """Write a first profile for the robot in MODEL, a URDF or MJCF, and check it.

    Links, T-pose, base and fingers are guessed from the tree of joints, their axes and their names; every guess is marked as one in the file.
    docs/profiles.md tells what to do next. What the check finds is printed; it does not change the exit code.
    """
    from retarget import robots as profiles
    from retarget.core.profile import ModelSource, RobotProfile
    from retarget.core.profile_guess import guess
    from retarget.robots.profile_text import profile_text

    path = output or Path(f"{model.stem}.toml")
    if path.suffix != ".toml":
        raise UsageError(f"{path}: a profile's name ends in .toml")
    if path.exists() and not force:
        raise UsageError(f"{path} exists; --force replaces it")
    if not path.parent.is_dir():
        raise UsageError(f"{path.parent}: no such folder")
    source = RobotProfile(
        path.stem,
        f"{path.stem}, guessed from {model.name}",
        ModelSource("file", str(model.resolve())),
        "floating",
        {},
        origin=str(model),
    )
    found = guess(source)
    text = profile_text(found.profile, found.joints, os.path.relpath(model.resolve(), path.resolve().parent))
    path.write_text(text, encoding="utf-8")
    console.note(
        f"{path}: {len(found.profile.links)} links guessed; go through it, then: retarget robots check {_as_argument(path)}"
    )
    _print_report(_check(profiles.load(_as_argument(path))), as_json=False, console=console)


def _as_argument(path: Path) -> str:
    """`path` as it has to be written to be taken for a profile of one's own."""
    return str(path) if path.parent.name or path.is_absolute() else f"./{path}"


def _check(profile: RobotProfile) -> ValidationReport:
    from retarget.core import robot_check

    return robot_check.check(_model(profile))


def _print_report(report: ValidationReport, as_json: bool, console: Console) -> None:
    from retarget.cli.clip import without_nan

    if as_json:
        checks = [
            {k: getattr(c, k) for k in ("name", "value", "unit", "limit", "passed", "note")} for c in report.checks
        ]
        record = {"robot": report.subject, "passed": report.passed, "checks": checks}
        click.echo(json.dumps(without_nan(record), allow_nan=False))
        return
    failed = [check for check in report.checks if check.passed is False]
    click.echo(f"{report.subject}: {len(report.checks)} checks, {len(failed)} failed")
    for entry in report.checks if console.verbose else [check for check in report.checks if not check.passed]:
        verdict = {True: "ok", False: "FAILED", None: "not made"}[entry.passed]
        value = "–" if entry.value is None else f"{entry.value:.4g}"
        limit = "" if entry.limit is None else f" (limit {entry.limit:g})"
        click.echo(f"  {verdict:<8} {entry.name}: {value} {entry.unit}{limit} {entry.note}".rstrip())


def _model(profile: RobotProfile) -> RobotModel:
    """The robot's model; a robot that is built from a person takes the person of the sample walk."""
    from retarget.core.robot_model import build

    if profile.model.kind != "human":
        return build(profile)
    from retarget import formats, samples

    return build(profile, formats.read_motion(str(samples.sample_path("walk"))))


def facts(profile: RobotProfile) -> dict[str, Any]:
    """What `list` says of a robot, JSON-able."""
    from retarget import robots as profiles

    model = _model(profile)
    source = profile.model
    # Of the package's own files only the name: documents are made of this, on whatever machine.
    own = source.path and Path(source.path).resolve().parent == Path(profiles.__file__).resolve().parent
    file = f"retarget: robots/{Path(source.path).name}" if own else source.path
    where = {"package": f"{source.package}: {source.path}", "file": file, "human": "built from the recording"}
    return {
        "name": profile.name,
        "description": profile.description,
        "dof": len(model.joint_names),
        "mass_kg": round(model.mass_kg, 3),
        "model": where[source.kind],
        "base": profile.base,
        "links_mapped": len(profile.links),
    }


def _joints(profile: RobotProfile) -> list[dict[str, Any]]:
    model = _model(profile)
    columns = zip(model.joint_names, model.lower, model.upper, model.velocity_limit, strict=True)
    return [
        {"name": name, "lower_rad": float(low), "upper_rad": float(high), "velocity_rad_s": float(speed)}
        for name, low, high, speed in columns
    ]


def _readable(shown: dict[str, Any]) -> str:
    from retarget.cli.summary import table

    heads = [f"{shown['name']}: {shown['description']}"]
    heads += [f"  {key}: {shown[key]}" for key in ("dof", "mass_kg", "model", "base")]
    links = table([["  segment", "link"], *([f"  {segment}", link] for segment, link in shown["links"].items())])
    header = ["  joint", "lower rad", "upper rad", "rad/s"]
    rows = [
        [f"  {j['name']}", f"{j['lower_rad']:.3f}", f"{j['upper_rad']:.3f}", f"{j['velocity_rad_s']:.2f}"]
        for j in shown["joints"]
    ]
    return "\n".join([*heads, links, table([header, *rows])])


def _text(value: float) -> str:
    return f"{value:g}" if isinstance(value, int) else f"{value:.1f}"


def _left(row: Sequence[str], width: int) -> list[str]:
    return [*row[:-1], row[-1].ljust(width)]
