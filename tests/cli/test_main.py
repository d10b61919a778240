"""The program as a whole: help, version, and that every failure is one line with its exit code."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from importlib.metadata import version
from types import ModuleType

import pytest
from click.testing import Result
from retarget.cli import main
from retarget.core.errors import MotionError

Run = Callable[..., Result]

USAGE = {
    "unknown command": (["convrt"], "unknown command 'convrt'; did you mean convert?"),
    "unknown option": (["convert", "--robott", "icub"], "No such option"),
    "missing argument": (["info"], "Missing argument"),
    "missing robot": (["convert", "walk.mvnx"], "Missing option '--robot'"),
    "unknown subcommand": (["robots", "lst"], "No such command 'lst'"),
    "not a number": (["convert", "w", "--robot", "icub", "--rate", "fast"], "found 'fast', expected a number above 0"),
    "NaN": (["convert", "w", "--robot", "icub", "--rate", "nan"], "found 'nan', expected a number above 0"),
    "negative rate": (["convert", "w", "--robot", "icub", "--rate", "-5"], "found '-5', expected a number above 0"),
    "negative smoothing": (["convert", "w", "--robot", "icub", "--smooth", "-1"], "expected a number of at least 0"),
    "infinite start": (["convert", "w", "--robot", "icub", "--start", "inf"], "found 'inf', expected a number"),
    "shard": (["convert", "w", "--robot", "icub", "--shard", "5/4"], "expected I/N with 1 ≤ I ≤ N"),
    "no jobs": (["convert", "w", "--robot", "icub", "--jobs", "0"], "--jobs"),
}


@pytest.mark.parametrize("case", USAGE)
def test_usage_errors_are_one_line_on_stderr(run: Run, case: str) -> None:
    arguments, expected = USAGE[case]
    result: Result = run(*arguments)
    assert result.exit_code == 2
    assert result.stdout == ""
    assert result.stderr.startswith("retarget: ")
    assert expected in result.stderr
    assert result.stderr.count("\n") == 1


def test_without_arguments_there_is_help(run: Run) -> None:
    assert run().stdout == run("--help").stdout
    for command, help_ in main.COMMANDS.items():
        assert f"{command} " in run().stdout
        assert help_ in " ".join(run().stdout.split())


def test_version(run: Run) -> None:
    assert run("--version").stdout == f"retarget {version('retarget')}\n"


@pytest.mark.parametrize("command", main.COMMANDS)
def test_the_short_help_is_the_command_s_own(command: str) -> None:
    module: ModuleType = importlib.import_module(f"retarget.cli.{command}")
    assert getattr(module, command).short_help == main.COMMANDS[command]


def failing(error: BaseException) -> None:
    raise error


@pytest.mark.parametrize(
    ("error", "line", "code"),
    [
        (MotionError("nothing measured"), "retarget: nothing measured\n", 1),
        (PermissionError(13, "Permission denied", "walk.mvnx"), "retarget: walk.mvnx: Permission denied\n", 1),
        (KeyboardInterrupt(), "retarget: interrupted\n", 130),
        (
            ValueError("odd\nshape"),
            "retarget: internal error (ValueError: odd\\nshape); run with --debug for the traceback\n",
            1,
        ),
    ],
)
def test_exceptions_become_one_line_and_their_exit_code(
    run: Run, monkeypatch: pytest.MonkeyPatch, error: BaseException, line: str, code: int
) -> None:
    from retarget import robots

    monkeypatch.setattr(robots, "names", lambda: failing(error))
    result = run("robots", "list")
    assert (result.stdout, result.stderr, result.exit_code) == ("", line, code)


def test_debug_adds_the_traceback(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    from retarget import robots

    monkeypatch.setattr(robots, "names", lambda: failing(ValueError("odd")))
    stderr = run("robots", "list", "--debug").stderr
    assert stderr.startswith("Traceback (most recent call last):\n")
    assert "in failing" in stderr
    assert stderr.endswith("internal error (ValueError: odd); run with --debug for the traceback\n")


def test_control_characters_of_a_file_name_stay_out_of_the_terminal(run: Run) -> None:
    result = run("info", "a\x1b[31m\nb.mvnx")
    assert result.stderr == "retarget: a\\x1b[31m\\nb.mvnx: no such file\n"
