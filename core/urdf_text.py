"""Numbers as URDF text with all their digits: what is read back is what was written."""

from __future__ import annotations

from collections.abc import Iterable


def number(value: float) -> str:
    """The shortest text that reads as the same double."""
    return repr(float(value))


def numbers(values: Iterable[float]) -> str:
    """As `number`, with a blank between."""
    return " ".join(number(value) for value in values)
