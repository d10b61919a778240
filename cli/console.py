"""What people see on stderr: one-line messages, colours only on a terminal that wants them, a progress bar that pipes never get.

stdout belongs to data and is written by the commands themselves.
"""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Callable, Iterator
from typing import NoReturn

import click

Progress = Callable[[int, int], None]


class Console:
    """One run's way of speaking. quiet: errors only. verbose: more facts. debug: tracebacks."""

    def __init__(self) -> None:
        self.quiet = self.verbose = self.debug = False

    def note(self, text: str) -> None:
        """A line that `-q` silences."""
        if not self.quiet:
            self._line(text)

    def detail(self, text: str) -> None:
        """A line that only `-v` shows."""
        if self.verbose and not self.quiet:
            self._line(text)

    def warning(self, text: str) -> None:
        """A warning; `-q` silences it, `--json` still carries it."""
        if not self.quiet:
            self._line(self.paint("  warning: ", "yellow") + printable(text))

    def error(self, text: str) -> None:
        """An error: one line, always shown."""
        self._line(self.paint("retarget: ", "red") + printable(text))

    def paint(self, text: str, colour: str) -> str:
        """`text` in `colour` when stderr is a terminal and neither NO_COLOR nor TERM=dumb forbids it."""
        return click.style(text, fg=colour) if _colourful() else text

    @contextlib.contextmanager
    def progress(self, label: str) -> Iterator[Progress | None]:
        """A callback (done, total) that moves a bar on stderr; None where no bar can be shown."""
        if self.quiet or not _is_terminal():
            yield None
            return
        shown = -1

        def move(done: int, total: int) -> None:
            nonlocal shown
            percent = 100 * done // max(total, 1)
            if percent != shown:
                shown = percent
                filled = "#" * (percent * 30 // 100)
                click.echo(f"\r{printable(label)}  [{filled:<30}] {percent:3d}%", nl=False, err=True)

        try:
            yield move
        finally:
            if shown >= 0:
                click.echo("\r\033[K", nl=False, err=True)

    def _line(self, text: str) -> None:
        click.echo(text, err=True, color=_colourful())


def printable(text: str) -> str:
    """`text` on one line, with whatever a file's name may hold to trouble a terminal spelled out."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape", "backslashreplace").decode() for c in text)


def drop_closed_streams() -> None:
    """Point stdout and stderr at nothing after their reader has gone, so that the interpreter's last flush can't complain."""
    null = os.open(os.devnull, os.O_WRONLY)
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError, AttributeError):
            stream.flush()
        with contextlib.suppress(OSError, ValueError, AttributeError):
            os.dup2(null, stream.fileno())


def leave(code: int) -> NoReturn:
    """End the command with exit `code`."""
    raise click.exceptions.Exit(code)


def _is_terminal() -> bool:
    with contextlib.suppress(AttributeError, ValueError):
        return sys.stderr.isatty()
    return False


def _colourful() -> bool:
    return _is_terminal() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"
