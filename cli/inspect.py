"""`retarget inspect`: what a person wants to see of a recording before converting it."""

from __future__ import annotations

import json
from typing import Any

import click
from retarget.cli import options as o
from retarget.cli.console import Console, leave, printable
from retarget.cli.input_files import collect_inputs
from retarget.cli.main import tell_failure
from retarget.cli.plan import PIPE
from retarget.cli.tracker_logs import LOG_RATE, log_facts, log_options
from retarget.core.errors import UsageError


@click.command(
    cls=o.Command, short_help="Show a recording before it is converted: figures, gaps, contacts, what to watch for."
)
@click.argument("files", nargs=-1, required=True, type=click.Path(allow_dash=True, readable=False))
@click.option("--report", metavar="FILE.html", help="The page; {stem} is filled in. [default: {stem}_inspect.html]")
@click.option("--no-report", is_flag=True, help="Only the summary, no page.")
@click.option("--calibration", metavar="FILE.json", help="The operator of a tracker log: shows it as a person.")
@click.option(
    "--robot", type=o.ROBOT, help="Robot of a trajectory. [default: the file's own, or the one with its joints]"
)
@log_options(LOG_RATE)
@click.option("--force", is_flag=True, help="Replace pages that exist.")
@o.as_json("Print one JSON object per file and line on stdout.")
@o.speech
@click.pass_obj
def inspect(
    console: Console,
    /,
    files: tuple[str, ...],
    report: str | None,
    no_report: bool,
    calibration: str | None,
    robot: str | None,
    force: bool,
    as_json: bool,
    **choices: Any,
) -> None:
    """Show what is in each of FILES, recordings or trajectories, or '-' for stdin: a summary on stdout and a page with pictures.

    \b
      retarget inspect walk.mvnx
      retarget inspect vive.csv --up z --no-report

    Stick figures, gaps, foot contacts, rates, speeds, segments that were not measured, whether it can be a person at all, and which
    options and robots fit. Nothing is converted and nothing is refused but what can't be read.
    """
    from retarget.cli import plan
    from retarget.cli.clip import without_nan
    from retarget.core import batch

    if report and no_report:
        raise UsageError("--report and --no-report contradict each other")
    paths = collect_inputs(files, None, kind="any")
    pages = {} if no_report else _pages(paths, report, force)
    facts, codes = log_facts(choices), set()

    def work(path: str) -> dict[str, Any]:
        from retarget.cli.inspection import inspect_file

        found = inspect_file(path, facts, calibration, robot)
        if path in pages:
            from retarget.cli import inspection_page

            plan.write_whole(pages[path], inspection_page.page(found).encode())
        return found.record

    for path, outcome in zip(paths, batch.run(work, paths), strict=True):
        codes.add(outcome.exit_code)
        if outcome.value is None:
            tell_failure(console, path, outcome)
            continue
        record = without_nan({**outcome.value, "page": pages.get(path)})
        if as_json:
            click.echo(json.dumps(record, allow_nan=False))
        else:
            click.echo(_readable(path, record))
        if path in pages:
            console.note(printable(f"→ {pages[path]}"))
    if codes - {0}:
        leave(max(codes))


def _pages(paths: list[str], report: str | None, force: bool) -> dict[str, str]:
    """Input → its page. Raises `UsageError` before any work for pages that can't be written, or exist without --force."""
    from retarget import formats
    from retarget.cli import plan

    template = report or "{stem}_inspect.html"
    if not template.lower().endswith((".html", ".htm")):
        raise UsageError(f"--report {template}: expected a file name ending in .html")
    suffixes = [suffix for format_ in formats.available().values() for suffix in format_.suffixes]
    pages = {path: plan.with_stem(template, plan.stem(path, suffixes), "--report") for path in paths}
    plan.check_single_files(list(pages.values()), [path for path in paths if path != PIPE], overwrite=force)
    return pages


def _readable(path: str, record: dict[str, Any]) -> str:
    from retarget.cli import inspection_text

    return "\n".join([printable(path), *map(printable, inspection_text.lines(record))])
