"""`retarget info`: what is in a recording or a trajectory."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from typing import Any

import click
from retarget.cli import options as o
from retarget.cli.console import Console, leave, printable
from retarget.cli.input_files import collect_inputs
from retarget.cli.main import tell_failure
from retarget.cli.plan import PIPE
from retarget.cli.tracker_logs import LOG_RATE, log_facts, log_options, tracker_options

LONGEST_TEXT = 240
"""Characters of a table within a table, such as the range of each joint; --json has all of it."""


@click.command(cls=o.Command, short_help="Say what is in a recording or a trajectory.")
@click.argument("files", nargs=-1, required=True, type=click.Path(allow_dash=True, readable=False))
@log_options(LOG_RATE)
@o.as_json("Print one JSON object per file and line on stdout.")
@o.speech
@click.pass_obj
def info(console: Console, /, files: tuple[str, ...], as_json: bool, **choices: Any) -> None:
    """Say what is in each of FILES: format, rate, frames, segments or joints, gaps, warnings."""
    from retarget.cli.clip import without_nan
    from retarget.core import batch

    paths = collect_inputs(files, None, kind="any")
    facts, codes = log_facts(choices), set()
    for path, outcome in zip(paths, batch.run(lambda path: _describe(path, facts), paths), strict=True):
        codes.add(outcome.exit_code)
        if outcome.value is None:
            tell_failure(console, path, outcome)
        elif as_json:
            click.echo(json.dumps(without_nan({"input": path, **outcome.value}), allow_nan=False))
        else:
            click.echo(_readable(path, without_nan(outcome.value)))
    if codes - {0}:
        leave(max(codes))


def _describe(path: str, facts: Mapping[str, Any]) -> Mapping[str, Any]:
    from retarget import formats

    options = tracker_options(facts)
    if path == PIPE:
        return formats.describe(sys.stdin.buffer, "stdin", options=options)
    return formats.describe(path, options=options)


def _readable(path: str, facts: Mapping[str, Any]) -> str:
    """The facts as aligned lines under the file's name; long lists are counted and cut."""
    lines = [printable(path)]
    width = max((len(key) for key in facts), default=0)
    for key, value in facts.items():
        for line in _lines(value):
            lines.append(f"  {key.replace('_', ' '):<{width}}  {printable(line)}")
            key = ""
    return "\n".join(lines)


def _cut(text: str) -> str:
    return text if len(text) <= LONGEST_TEXT else f"{text[:LONGEST_TEXT]} …"


def _lines(value: Any) -> list[str]:
    if isinstance(value, list) and value and all(isinstance(item, str) and " " not in item for item in value):
        return [f"{len(value)}: {' '.join(value)}"]
    if isinstance(value, list):
        return [str(item) for item in value[:10]] + ([f"… and {len(value) - 10} more"] if len(value) > 10 else []) or [
            "none"
        ]
    if isinstance(value, Mapping):
        return [f"{key}: {_cut(str(item))}" for key, item in value.items()] or ["none"]
    if isinstance(value, float):
        return [f"{value:g}"]
    return ["–" if value in (None, "") else str(value)]
