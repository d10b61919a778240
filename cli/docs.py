"""Writes the generated part of the documentation: `python -m retarget.cli.docs docs` for a folder, `--picture` for README's picture.

Commands are described by their own options, formats and mappings by their own docstrings, robots by their own profiles, a profile's keys by
the parser's own list: nothing is said twice. A test compares the committed files with what this gives.
"""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Callable, Iterator
from pathlib import Path

import click
from retarget.cli.main import COMMANDS, cli
from retarget.cli.profile_page import profiles_page

NOTE = "<!-- Written by `python -m retarget.cli.docs docs`; changes here are lost. -->\n"


def command_line() -> str:
    """Every command with its arguments and options, as Markdown."""
    root = click.Context(cli, info_name="retarget")
    parts = [NOTE, "# Command line\n", _prose(cli.help), *_commands(cli, root, 2)]
    return "\n".join(parts)


def formats_page() -> str:
    """Every format of this package, as Markdown: what it can do, then its module's docstring."""
    from retarget import formats

    rows, parts = [], []
    for name, format_ in formats.available().items():
        try:
            module = importlib.import_module(f"retarget.formats.{name}")
        except ModuleNotFoundError:
            continue  # another package's format, documented there
        reads = [
            kind
            for kind, reader in (
                ("motion", format_.read_motion or format_.read_recording),
                ("trajectory", format_.read_trajectory or format_.read_folder),
                ("trackers", format_.read_trackers or format_.read_recording),
            )
            if reader
        ]
        styles = ", ".join(format_.styles) if len(format_.styles) > 1 else ""
        rows.append(
            f"| [{name}](#{name}) | {format_.description} | {' '.join(f'`{s}`' for s in format_.suffixes) or 'a folder'} | {', '.join(reads)} "
            f"| {'yes' if format_.writable else ''} | {'yes' if format_.pipeable else ''} | {styles} |"
        )
        parts.append(f"## {name}\n\n{inspect.cleandoc(module.__doc__ or '')}\n")
    head = "| format | | suffixes | reads | writes | pipes | styles |\n|---|---|---|---|---|---|---|"
    return "\n".join([NOTE, "# Formats\n", head, *rows, "", *parts])


def robots_page() -> str:
    """Every robot of this package, as Markdown."""
    from retarget import robots
    from retarget.cli.robots import facts

    head = "| robot | | DoF | mass / kg | base | model |\n|---|---|---|---|---|---|"
    rows, parts = [], []
    for name in robots.names():
        profile = robots.load(name)
        fact = facts(profile)
        rows.append(
            f"| [{name}](#{name}) | {fact['description']} | {fact['dof']} | {fact['mass_kg']:.1f} | {fact['base']} "
            f"| {fact['model']} |"
        )
        parts.append(f"## {name}\n\n| segment | link |\n|---|---|")
        parts.extend(f"| {segment} | `{link}` |" for segment, link in profile.links.items())
        for segment, exception in profile.tpose_exceptions.items():
            parts.append(
                f"\n{segment} stays {exception.error_deg:g}° from the T-pose: joint `{exception.joint}` can't turn further."
            )
        parts.append("")
    own = "A robot of your own: [profiles](profiles.md).\n"
    return "\n".join([NOTE, "# Robots\n", own, head, *rows, "", *parts])


def mappings_page() -> str:
    """Every mapping of this package, as Markdown: its line, then its module's docstring."""
    from retarget.core import mapping

    parts = [NOTE, "# Mappings\n"]
    for name in mapping.names():
        try:
            module = importlib.import_module(f"retarget.core.mapping.{name}")
        except ModuleNotFoundError:
            continue  # another package's mapping
        parts.append(f"## {name}\n\n{mapping.load(name).description}\n\n{inspect.cleandoc(module.__doc__ or '')}\n")
    return "\n".join(parts)


PAGES: dict[str, Callable[[], str]] = {
    "cli.md": command_line,
    "formats.md": formats_page,
    "mappings.md": mappings_page,
    "profiles.md": profiles_page,
    "robots.md": robots_page,
}


def picture(path: Path) -> None:
    """The demo's person and robots, as PNG."""
    from retarget import formats, samples
    from retarget.cli import figures, stick_figures
    from retarget.cli.clip import model_for
    from retarget.core import pipeline

    motion = formats.read_motion(str(samples.sample_path("walk")))
    part = pipeline.ConvertOptions(start_s=2.2, end_s=9.2)  # without the standing at both ends
    results = [pipeline.convert(motion, model_for(robot, motion), part) for robot in ("icub", "g1")]
    strip = stick_figures.strip(results, instants=5)
    figures.png(strip, path)


def _commands(group: click.Group, context: click.Context, level: int) -> Iterator[str]:
    for name in COMMANDS if group is cli else group.list_commands(context):
        command = group.get_command(context, name)
        assert command is not None
        inner = click.Context(command, info_name=name, parent=context)
        yield f"{'#' * level} {inner.command_path}\n"
        if isinstance(command, click.Group):
            yield _prose(command.help)
            yield from _commands(command, inner, level + 1)
            continue
        arguments = [parameter for parameter in command.params if isinstance(parameter, click.Argument)]
        yield "```\n" + " ".join([inner.command_path, "[OPTIONS]", *map(_argument, arguments)]) + "\n```\n"
        yield _prose(command.help)
        if options := [_option(parameter) for parameter in command.params if isinstance(parameter, click.Option)]:
            yield "\n".join(["| option | |\n|---|---|", *options]) + "\n"


def _prose(text: str | None) -> str:
    """Help text as Markdown: click's unwrapped paragraphs (marked by \\b) become code."""
    paragraphs = inspect.cleandoc(text or "").split("\n\n")
    made = [f"```\n{inspect.cleandoc(p[1:])}\n```" if p.startswith("\b") else p for p in paragraphs]
    return "\n\n".join(made) + "\n"


def _argument(argument: click.Argument) -> str:
    name = argument.metavar or (argument.name or "").upper()
    if argument.nargs == -1 and "..." not in name:
        name = f"{name}..."
    return name if argument.required or name.startswith("[") else f"[{name}]"


def _option(option: click.Option) -> str:
    value = "" if option.is_flag else f" {_value(option)}"
    default = (
        "" if option.is_flag or option.default is None or not option.show_default else f" [default: {option.default}]"
    )
    required = " [required]" if option.required else ""
    cells = ", ".join(f"`{name}`" for name in option.opts) + (f" {value.strip()}" if value else "")
    return f"| {_cell(cells)} | {_cell(f'{option.help}{default}{required}')} |"


def _value(option: click.Option) -> str:
    if option.metavar:
        return option.metavar
    if isinstance(option.type, click.Choice):
        return "|".join(option.type.choices)
    if isinstance(option.type, click.types.IntParamType):
        return "N"
    return option.type.get_metavar(option, click.Context(cli)) or option.type.name.upper()


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")


@click.command(help=__doc__)
@click.argument("folder", type=click.Path(file_okay=False, exists=True, path_type=Path))
@click.option("--picture", "with_picture", is_flag=True, help="Also make README's picture, demo.png.")
def write(folder: Path, with_picture: bool) -> None:
    """Write all pages into FOLDER."""
    for name, page in PAGES.items():
        (folder / name).write_text(page(), encoding="utf-8")
    if with_picture:
        picture(folder / "demo.png")


if __name__ == "__main__":
    write()
