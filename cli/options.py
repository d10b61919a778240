"""Options that several commands share, and the kinds of values they take. Names are completed by the shell and checked late.

Names of robots, mappings and formats come from their registries, which import NumPy: they are asked only when a value is there
to be checked or completed, never for `--help`.
"""
# ruff: noqa: ARG002 - the signatures of overridden methods are click's

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

import click
from click.shell_completion import CompletionItem
from retarget.cli.console import Console
from retarget.core.errors import UnknownNameError, UsageError

Decorated = TypeVar("Decorated", bound=Callable[..., Any])
LONGEST_COUNT = 9
"""Digits of a part of work; Python refuses to read numbers of thousands."""


if TYPE_CHECKING:
    _ParamType = click.ParamType
else:

    class _ParamType(click.ParamType):
        """click before 8.4 has no type parameter here."""

        def __class_getitem__(cls, _value_type: object) -> type:
            return cls


class Command(click.Command):
    """A command whose options are never empty: what a script's unset variable leaves is no choice of the default."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        rest = super().parse_args(ctx, args)
        for param in self.params:
            value = ctx.params.get(param.name or "")
            if isinstance(param, click.Option) and (value == "" or (isinstance(value, tuple) and "" in value)):
                raise UsageError(f"{param.opts[-1]}: found nothing; expected {param.make_metavar(ctx)}")
        return rest


class Name(_ParamType[str]):
    """One of the names that `choices()` gives; with `or_path`, also a path ending in `or_path` or holding a slash."""

    def __init__(self, kind: str, choices: Callable[[], Iterable[str]], *, or_path: str = "") -> None:
        self.name, self.choices, self.or_path = kind, choices, or_path

    def get_metavar(self, param: click.Parameter, ctx: click.Context | None = None) -> str:
        return f"NAME|FILE{self.or_path}" if self.or_path else "NAME"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        text = str(value)
        if self.or_path and (text.endswith(self.or_path) or "/" in text):
            return text
        choices = list(self.choices())
        if text not in choices:
            option = param.opts[-1] if param is not None and isinstance(param, click.Option) else ""
            raise UnknownNameError(self.name, text, choices, where=option)
        return text

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        items = [CompletionItem(name) for name in self.choices() if name.startswith(incomplete)]
        return items or ([CompletionItem(incomplete, type="file")] if self.or_path else [])


class Number(_ParamType[float]):
    """A finite number, above `above` or from `least` on; Python's float() alone would take "nan" and "inf"."""

    name = "number"

    def __init__(self, metavar: str, *, above: float = -math.inf, least: float = -math.inf) -> None:
        self.metavar, self.above, self.least = metavar, above, least

    def get_metavar(self, param: click.Parameter, ctx: click.Context | None = None) -> str:
        return self.metavar

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        if not math.isfinite(number) or number <= self.above or number < self.least:
            wanted = "a number"
            if self.above > -math.inf:
                wanted = f"a number above {self.above:g}"
            elif self.least > -math.inf:
                wanted = f"a number of at least {self.least:g}"
            self.fail(f"found '{value}', expected {wanted}.", param, ctx)
        return number


class Shard(_ParamType[tuple[int, int]]):
    """`i/n`: the i-th of n parts."""

    name = "shard"

    def get_metavar(self, param: click.Parameter, ctx: click.Context | None = None) -> str:
        return "I/N"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[int, int]:
        if isinstance(value, tuple):
            return value
        first, slash, second = str(value).partition("/")
        plain = slash and all(part.isdecimal() and len(part) <= LONGEST_COUNT for part in (first, second))
        if not (plain and 1 <= int(first) <= int(second)):
            self.fail(f"found '{value}', expected I/N with 1 ≤ I ≤ N, for example 1/4.", param, ctx)
        return int(first), int(second)


class Window(_ParamType[tuple[float, float]]):
    """`START:END` in seconds."""

    name = "window"

    def get_metavar(self, param: click.Parameter, ctx: click.Context | None = None) -> str:
        return "START:END"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, float]:
        if isinstance(value, tuple):
            return value
        numbers = _finite(str(value).split(":"))
        if len(numbers) != 2 or numbers[0] >= numbers[1]:
            self.fail(f"found '{value}', expected START:END in seconds, for example 2:3.5.", param, ctx)
        return numbers[0], numbers[1]


class Vector(_ParamType[tuple[float, float, float]]):
    """`X,Y,Z`: three numbers."""

    name = "vector"

    def get_metavar(self, param: click.Parameter, ctx: click.Context | None = None) -> str:
        return "X,Y,Z"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, float, float]:
        if isinstance(value, tuple):
            return value
        numbers = _finite(str(value).split(","))
        if len(numbers) != 3:
            self.fail(f"found '{value}', expected three numbers X,Y,Z, for example -0.08,0,0.", param, ctx)
        return numbers[0], numbers[1], numbers[2]


class Pair(_ParamType[tuple[str, str]]):
    """`NAME=VALUE`, neither of them empty; shown as `metavar`."""

    name = "pair"

    def __init__(self, metavar: str) -> None:
        self.metavar = metavar

    def get_metavar(self, param: click.Parameter, ctx: click.Context | None = None) -> str:
        return self.metavar

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[str, str]:
        if isinstance(value, tuple):
            return value
        name, equals, rest = (part.strip() for part in str(value).partition("="))
        if not (name and equals and rest):
            self.fail(f"found '{value}', expected {self.metavar}.", param, ctx)
        return name, rest


def _finite(texts: Iterable[str]) -> list[float]:
    """The numbers in `texts`; empty when one of them is none, or not finite."""
    try:
        numbers = [float(text) for text in texts]
    except ValueError:
        return []
    return numbers if all(math.isfinite(number) for number in numbers) else []


def robot_names() -> list[str]:
    """Robots known by name."""
    from retarget import robots

    return robots.names()


def mapping_names() -> list[str]:
    """Mappings known by name."""
    from retarget.core import pipeline

    return pipeline.mapping_names()


def writable_formats() -> list[str]:
    """Formats that hold trajectories and can be written."""
    from retarget import formats

    return [name for name, format_ in formats.available().items() if format_.writable]


def csv_styles() -> list[str]:
    """Styles of the CSV writer, the default first."""
    from retarget import formats

    return list(formats.available()["csv"].styles)


ROBOT = Name("robot", robot_names, or_path=".toml")
MAPPING = Name("mapping", mapping_names)
FORMAT = Name("format", writable_formats)
CSV_STYLE = Name("CSV style", csv_styles)


def speech(command: Decorated) -> Decorated:
    """Adds -q, -v and --debug, which set the run's `Console`."""

    def option(*names: str, attribute: str, text: str) -> Callable[[Decorated], Decorated]:
        def remember(ctx: click.Context, _param: click.Parameter, wanted: bool) -> None:
            if wanted and isinstance(ctx.obj, Console):
                setattr(ctx.obj, attribute, True)

        return click.option(*names, is_flag=True, is_eager=True, expose_value=False, callback=remember, help=text)

    quiet = option("-q", "--quiet", attribute="quiet", text="Only errors on stderr.")
    verbose = option("-v", "--verbose", attribute="verbose", text="More facts on stderr.")
    debug = option("--debug", attribute="debug", text="Show tracebacks of errors.")
    return quiet(verbose(debug(command)))


def choice(*names: str, of: Sequence[str], text: str, default: str | None = None) -> Callable[[Decorated], Decorated]:
    """Adds an option that takes one of `of`, the first unless `default` says another."""
    return click.option(*names, type=click.Choice(of), default=default or of[0], show_default=True, help=text)


def many_inputs(what: str) -> Callable[[Decorated], Decorated]:
    """Adds --files-from, --null and --recursive, by which a command gets more inputs than its arguments name."""

    def add(command: Decorated) -> Decorated:
        for option in (
            click.option("-r", "--recursive", is_flag=True, help=f"Take all {what} below folders."),
            click.option("-0", "--null", "nul", is_flag=True, help="--files-from is separated by NUL, not by lines."),
            click.option("--files-from", metavar="FILE|-", help="Read more inputs from this file, one a line."),
        ):
            command = option(command)
        return command

    return add


def jobs(command: Decorated) -> Decorated:
    """Adds --jobs."""
    count = click.IntRange(min=1)
    return click.option("-j", "--jobs", type=count, default=1, show_default=True, help="Clips at the same time.")(
        command
    )


def as_json(text: str = "Print JSON on stdout.") -> Callable[[Decorated], Decorated]:
    """Adds --json as the argument `as_json`."""
    return click.option("--json", "as_json", is_flag=True, help=text)
