"""Every failure that a user can cause or meet, as one family.

One base class, few children. Each takes facts and builds one line of text from them: what was found, where,
what was expected, and the nearest valid choice. The command line maps class to exit code through `exit_code`.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable

LONGEST_MESSAGE = 1500
"""Characters: names and cells of a broken file can be as long as the file; a message stays one that can be read."""
NEAR = "did you mean "
"""How a hint begins that names the nearest valid choice."""
_INVISIBLE = (*range(0x20), *range(0x7F, 0xA0), 0x2028, 0x2029, *range(0x202A, 0x202F), *range(0x2066, 0x206A))
_ESCAPED = {code: repr(chr(code))[1:-1] for code in _INVISIBLE}
"""Line breaks, and what moves a terminal's cursor or turns text around: a file may hold them in its names, a message doesn't."""


class RetargetError(Exception):
    """Base of all errors that are shown to a person as one line, without traceback.

    `exit_code`: 1 when a clip's content is at fault, 2 when the command line or a configuration file is.
    """

    exit_code = 1

    def __str__(self) -> str:
        text = super().__str__().translate(_ESCAPED)
        if len(text) <= LONGEST_MESSAGE:
            return text
        kept = LONGEST_MESSAGE // 2
        return f"{text[:kept]} … {text[-kept:]}"


class FormatError(RetargetError):
    """A file whose content can't be read as what it claims to be."""

    def __init__(self, path: object, problem: str, *, place: str = "", expected: str = "") -> None:
        self.path, self.problem, self.place, self.expected = str(path), problem, place, expected
        where = f"{self.path}, {place}" if place else self.path
        super().__init__(f"{where}: {problem}" + _instead(expected))


def _instead(expected: str) -> str:
    """The end of a message that says what was expected, or asks whether something was meant."""
    if not expected:
        return ""
    return f"; {expected}" if expected.startswith(NEAR) else f"; expected {expected}"


class InvalidDataError(RetargetError):
    """Data that breaks a promise of its type: says which field, what was found, and what was promised."""


class MotionError(RetargetError):
    """Data that was read but can't be retargeted (gaps too long, nothing measured, empty cut)."""


class SolverError(RetargetError):
    """A solver that can't start (for example no posture satisfies the coupled-joint rows)."""


class UsageError(RetargetError):
    """A request that contradicts itself or the file system; nothing has been done yet."""

    exit_code = 2


class ProfileError(UsageError):
    """A robot profile (TOML) or its model (URDF) that can't be used."""

    def __init__(self, profile: object, problem: str, *, place: str = "", expected: str = "") -> None:
        self.profile, self.problem, self.place = str(profile), problem, place
        where = f"{self.profile}, {place}" if place else self.profile
        super().__init__(f"{where}: {problem}" + _instead(expected))


class UnknownNameError(UsageError):
    """A name that is none of the valid ones: says which are near it."""

    def __init__(self, kind: str, name: str, choices: Iterable[str], *, where: str = "") -> None:
        self.kind, self.name, self.choices = kind, name, sorted(choices)
        near = nearest(name, self.choices)
        hint = f"did you mean {' or '.join(near)}?" if near else f"choose from {', '.join(self.choices)}"
        super().__init__((f"{where}: " if where else "") + f"unknown {kind} '{name}'; {hint}")


def nearest(name: str, choices: Iterable[str], count: int = 3) -> list[str]:
    """The valid names most like `name`, best first; empty when none is near."""
    by_folded = {choice.casefold(): choice for choice in choices}
    found = difflib.get_close_matches(name.casefold(), by_folded, n=count, cutoff=0.5)
    return [by_folded[key] for key in found]
