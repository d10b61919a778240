"""The program: a group that imports a command's module only when that command runs, and one place for exit codes.

0 done · 1 a clip failed · 2 usage · 3 a check failed · 130 interrupted. A closed pipe ends quietly with 0.
"""
# ruff: noqa: ARG002 - the signatures of overridden methods are click's

from __future__ import annotations

import errno
import importlib
import os
import sys
import traceback
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NoReturn

import click
from retarget.cli.console import Console, drop_closed_streams, printable
from retarget.core.errors import RetargetError, UnknownNameError

if TYPE_CHECKING:
    from retarget.core.batch import Outcome

COMMANDS = {
    "convert": "Turn recordings into robot joint trajectories.",
    "validate": "Replay trajectories in physics and give a verdict.",
    "calibrate": "Make an operator's calibration of recordings of three poses.",
    "compare": "Compare hand mappings by the experiments of Lim et al. 2022.",
    "inspect": "Show a recording before it is converted: figures, gaps, contacts, what to watch for.",
    "info": "Say what is in a recording or a trajectory.",
    "robots": "List, show and check robots, start a new one.",
    "demo": "Convert a sample walk to two robots and write a report.",
    "completion": "Print the script that teaches a shell to complete.",
}
"""Command → its one-line help; its module is `retarget.cli.<command>`, its click command `<command>` in there."""

NAMES_NO_FILE = (errno.ENAMETOOLONG, errno.ELOOP, errno.EISDIR, errno.ENOTDIR)
"""What the system says of a path that can't be meant."""

HELP = """Recorded human motion to robot joint trajectories that stay inside the robot's limits.

\b
  retarget demo
  retarget convert walk.mvnx --robot icub -o walk.mcap
  retarget convert *.mvnx --robot g1 -o 'out/{robot}/{stem}.mcap' --jobs 4
  retarget validate walk.mcap --report walk.html

Data goes to stdout, everything else to stderr. Exit codes: 0 done, 1 a clip failed, 2 usage, 3 a check failed,
130 interrupted.
"""


class LazyGroup(click.Group):
    """Knows its commands by name; `--help` shows them without importing any."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in COMMANDS:
            return None
        module = importlib.import_module(f"retarget.cli.{cmd_name}")
        command: click.Command = getattr(module, cmd_name)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        if args and not args[0].startswith("-") and args[0] not in COMMANDS and not ctx.resilient_parsing:
            raise UnknownNameError("command", args[0], COMMANDS)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))

    def main(
        self,
        args: Sequence[str] | None = None,
        prog_name: str | None = None,
        complete_var: str | None = None,
        standalone_mode: bool = True,
        windows_expand_args: bool = True,
        **extra: Any,
    ) -> Any:
        """Run and exit. Replaces click's own handling of errors, whose messages and exit codes are not ours."""
        if "_RETARGET_COMPLETE" in os.environ:
            return super().main(args, "retarget", "_RETARGET_COMPLETE", **extra)
        console = Console()
        try:
            code = self._run(list(sys.argv[1:] if args is None else args), console, extra)
            if sys.stdout is not None:
                sys.stdout.flush()
        except BrokenPipeError:
            drop_closed_streams()
            code = 0
        sys.exit(code)

    def _run(self, args: list[str], console: Console, extra: dict[str, Any]) -> int:
        try:
            with self.make_context("retarget", args or ["--help"], obj=console, **extra) as ctx:
                self.invoke(ctx)
            return 0
        except click.exceptions.Exit as stop:
            return stop.exit_code
        except (KeyboardInterrupt, click.Abort):
            console.error("interrupted")
            return 130
        except click.ClickException as error:
            place = error.ctx.command_path if isinstance(error, click.UsageError) and error.ctx else "retarget"
            console.error(f"{error.format_message()} See '{place} --help'.")
            return 2
        except BrokenPipeError:
            raise
        except RetargetError as error:
            _show_traceback(console)
            console.error(str(error))
            return error.exit_code
        except OSError as error:
            _show_traceback(console)
            console.error(f"{error.filename}: {error.strerror}" if error.filename else str(error))
            return 2 if error.errno in NAMES_NO_FILE else 1
        except Exception as error:
            _show_traceback(console)
            console.error(unexpected(f"{type(error).__name__}: {error}"))
            return 1


def unexpected(text: str) -> str:
    """The line for a failure that is our fault, not the user's."""
    return f"internal error ({printable(text)}); run with --debug for the traceback"


def tell_failure(console: Console, shown: str, outcome: Outcome[Any], count: str = "") -> None:
    """Why the work on the input that messages call `shown` came to nothing, in one line on stderr that begins with `count`."""
    if console.debug and outcome.traceback:
        click.echo(outcome.traceback, err=True, nl=False)
    text = unexpected(outcome.error) if outcome.unexpected else outcome.error
    console.error(count + (text if shown in text else f"{shown}: {text}"))


def _show_traceback(console: Console) -> None:
    if console.debug:
        click.echo(traceback.format_exc(), err=True, nl=False)


def _show_version(ctx: click.Context, _param: click.Parameter, wanted: bool) -> None:
    if wanted and not ctx.resilient_parsing:
        from importlib.metadata import version

        click.echo(f"retarget {version('retarget')}")
        ctx.exit()


@click.command(cls=LazyGroup, name="retarget", help=HELP, context_settings={"help_option_names": ["-h", "--help"]})
@click.option(
    "--version", is_flag=True, is_eager=True, expose_value=False, callback=_show_version, help="Print the version."
)
def cli() -> None:
    """Replaced by HELP."""


def main() -> NoReturn:
    """Entry point of the `retarget` program."""
    # The matrices are tiny: BLAS threads only cost. Must be set before numpy is imported.
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    cli.main()
    raise AssertionError("main() always exits")
