"""One TOML table as the schema reads it: every value checked, every error with its place, the value found and the nearest valid one."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NoReturn, TypeGuard

import numpy as np
from retarget.core.errors import ProfileError, nearest
from retarget.core.profile import Array

Table = dict[str, Any]
Triple = tuple[float, float, float]
SIDES = ("Left", "Right")
LARGEST_NUMBER = 1e12
"""No length, angle or weight is larger; TOML would also take inf, nan and integers of any size."""


class TableReader:
    """One table of the file with its place, so that every message can say where."""

    def __init__(self, path: Path, place: str, table: Table) -> None:
        self.path, self.place, self.table_ = path, place, table

    def fail(self, key: str, found: object, expected: str) -> NoReturn:
        place = f"{self.place}.{key}" if self.place else key
        raise ProfileError(self.path, f"found {found!r}", place=f"key {place}", expected=expected)

    def only(self, keys: Iterable[str]) -> None:
        """Refuse every key that is not in `keys`, naming the nearest one that is."""
        valid = list(keys)
        for key in self.table_:
            if key not in valid:
                near = nearest(key, valid)
                place = f"[{self.place}]" if self.place else "top level"
                hint = f"did you mean '{near[0]}'?" if near else f"one of {', '.join(valid)}"
                raise ProfileError(self.path, f"unknown key '{key}'", place=place, expected=hint)

    def table(self, key: str, *, required: bool = False) -> TableReader:
        value = self.table_.get(key, {})
        if not isinstance(value, dict) or (required and key not in self.table_):
            self.fail(key, self.table_.get(key), "a table")
        return TableReader(self.path, f"{self.place}.{key}" if self.place else key, value)

    def tables(self, key: str) -> list[TableReader]:
        value = self.table_.get(key, [])
        if not isinstance(value, list) or not all(isinstance(item, dict) for item in value):
            self.fail(key, value, "an array of tables")
        return [
            TableReader(self.path, f"{self.place}.{key}[{i}]" if self.place else f"{key}[{i}]", item)
            for i, item in enumerate(value)
        ]

    def text(self, key: str, default: str | None = None) -> str:
        value = self.table_.get(key, default)
        if not isinstance(value, str):
            self.fail(key, value, "text")
        return value

    def texts(self, key: str) -> list[str]:
        value = self.table_.get(key, [])
        if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
            self.fail(key, value, "a list of texts")
        return list(value)

    def number(self, key: str) -> float:
        value = self.table_.get(key)
        if not _is_number(value):
            self.fail(key, value, "a finite number")
        return float(value)

    def optional(self, key: str) -> float | None:
        return self.number(key) if key in self.table_ else None

    def positive(self, key: str) -> float | None:
        return self.required_positive(key) if key in self.table_ else None

    def numbers(self, key: str, count: int, default: Sequence[float] | None = None) -> list[float]:
        value = self.table_.get(key, None if default is None else list(default))
        if not isinstance(value, list) or len(value) != count or not all(_is_number(v) for v in value):
            self.fail(key, value, f"a list of {count} finite numbers")
        return [float(v) for v in value]

    def matrix(self, key: str, columns: int) -> Array:
        value = self.table_.get(key)
        if not isinstance(value, list) or not value or not all(_is_row(row, columns) for row in value):
            self.fail(key, value, f"rows of {columns} finite numbers")
        return np.array(value, float)

    def required_positive(self, key: str) -> float:
        value = self.number(key)
        if value <= 0:
            self.fail(key, value, "a number above 0")
        return value

    def not_negative(self, key: str, default: float | None = None) -> float:
        value = default if default is not None and key not in self.table_ else self.number(key)
        if value < 0:
            self.fail(key, value, "a number ≥ 0")
        return value

    def triple(self, key: str, default: Sequence[float] | None = None) -> Triple:
        values = self.numbers(key, 3, default)
        return (values[0], values[1], values[2])

    def unit(self, key: str, default: Sequence[float] | None = None) -> Triple:
        values = self.triple(key, default)
        norm = float(np.linalg.norm(values))
        if abs(norm - 1) > 1e-3:
            self.fail(key, list(values), "a unit vector")
        return (values[0] / norm, values[1] / norm, values[2] / norm)

    def choice(self, key: str, valid: Iterable[str], default: str | None = None) -> str:
        """One of `valid`; the message names the nearest, or all."""
        value, known = self.text(key, default), list(valid)
        if value not in known:
            near = nearest(value, known)
            self.fail(key, value, f"did you mean '{near[0]}'?" if near else f"one of {', '.join(known)}")
        return value

    def texts_by(self, valid: Iterable[str]) -> dict[str, str]:
        """The whole table, key → text, keys out of `valid`."""
        self.only(valid)
        return {key: self.text(key) for key in self.table_}

    def sides(self) -> list[tuple[str, TableReader]]:
        """The tables under "Left" and "Right", whichever are there."""
        self.only(SIDES)
        return [(side, self.table(side)) for side in self.table_]


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < LARGEST_NUMBER


def _is_row(value: object, columns: int) -> bool:
    return isinstance(value, list) and len(value) == columns and all(_is_number(v) for v in value)
