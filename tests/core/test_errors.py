"""One line per error: what was found, where, what was expected, and the nearest valid choice."""

from __future__ import annotations

import inspect
from pathlib import Path

import pytest
from retarget.core import errors
from retarget.core.errors import FormatError, ProfileError, RetargetError, UnknownNameError, UsageError, nearest


def test_all_errors_are_one_family() -> None:
    classes = [c for _, c in inspect.getmembers(errors, inspect.isclass) if c.__module__ == errors.__name__]
    assert len(classes) >= 8
    assert all(issubclass(c, RetargetError) for c in classes)


@pytest.mark.parametrize(
    ("error", "exit_code"),
    [
        (errors.RetargetError("x"), 1),
        (errors.InvalidDataError("x"), 1),
        (errors.MotionError("x"), 1),
        (errors.SolverError("x"), 1),
        (FormatError("a.mvnx", "x"), 1),
        (UsageError("x"), 2),
        (ProfileError("a.toml", "x"), 2),
        (UnknownNameError("robot", "x", ["y"]), 2),
    ],
    ids=lambda value: type(value).__name__,
)
def test_a_clip_at_fault_exits_1_and_a_request_at_fault_2(error: RetargetError, exit_code: int) -> None:
    assert error.exit_code == exit_code


@pytest.mark.parametrize("kind", [FormatError, ProfileError])
def test_file_place_found_and_expected(kind: type[FormatError] | type[ProfileError]) -> None:
    assert str(kind(Path("d/a.x"), "3 values", place="line 7", expected="4")) == "d/a.x, line 7: 3 values; expected 4"
    assert str(kind("a.x", "empty file")) == "a.x: empty file"
    error = kind("a.x", "3 values", place="line 7")
    assert (error.problem, error.place) == ("3 values", "line 7")


def test_an_unknown_name_offers_its_neighbours() -> None:
    robots = ["icub", "g1", "baxter", "talos"]
    assert str(UnknownNameError("robot", "icup", robots)) == "unknown robot 'icup'; did you mean icub?"
    assert str(UnknownNameError("robot", "ICUB", robots)) == "unknown robot 'ICUB'; did you mean icub?"
    assert str(UnknownNameError("mapping", "limb", ["limb_plane", "limb_line", "other"])) == (
        "unknown mapping 'limb'; did you mean limb_line or limb_plane?"
    )


def test_an_unknown_name_far_from_all_lists_all() -> None:
    error = UnknownNameError("robot", "zzz", ["talos", "g1"], where="a.toml, key extends")
    assert str(error) == "a.toml, key extends: unknown robot 'zzz'; choose from g1, talos"


def test_nearest_is_ordered_limited_and_keeps_the_choices_own_case() -> None:
    assert nearest("leftfoot", ["RightFoot", "LeftFoot", "LeftToe", "Head"])[0] == "LeftFoot"
    assert nearest("q", ["LeftFoot"]) == []
    assert len(nearest("aaaa", ["aaab", "aaba", "abaa", "baaa"], count=2)) == 2


@pytest.mark.parametrize(
    ("found", "shown"),
    [
        ("a\nb\r\n", r"a\nb\r\n"),
        ("\x1b[2J\x07\0\x7f\x9b", r"\x1b[2J\x07\x00\x7f\x9b"),
        ("a\u2028b\u202eevil\u2069", r"a\u2028b\u202eevil\u2069"),
        ("é ٣ \U0001f600 \\n", "é ٣ \U0001f600 \\n"),
    ],
)
def test_a_message_is_one_line_that_a_terminal_only_shows(found: str, shown: str) -> None:
    assert str(FormatError("a.x", f"joint '{found}'")) == f"a.x: joint '{shown}'"
