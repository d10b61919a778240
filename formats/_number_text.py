"""Rows of numbers out of text, fast where the text has a fixed number of decimals and strict everywhere.

Motion files hold millions of numbers like `-0.123456`. General float parsers spend 70-100 ns on each; numbers that all have the same
count of decimals are integers with a point in them, which NumPy can read a column of digits at a time, for a third of that. The results
are the same to the last bit: below 10¹⁵ the integer is exact in a double, so is the power of ten, and IEEE division of the two
rounds once, as `float()` does.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import accumulate

import numpy as np
from retarget.core.types import Array

MAX_DIGITS = 15
_SPACE, _MINUS, _POINT, _ZERO = b" -.0"
# What C libraries of Windows write for values that are not finite.
_WINDOWS_NOT_A_NUMBER = re.compile(r"[+-]?(?:1\.#(?:IND|QNAN|SNAN|INF)\d*|nan\((?:ind|snan)\))", re.IGNORECASE)


class RowError(ValueError):
    """A text that does not hold the numbers it should: which one of the texts, and what is wrong with it."""

    def __init__(self, row: int, problem: str) -> None:
        super().__init__(problem)
        self.row, self.problem = row, problem


def parse_rows(texts: Sequence[str], width: int) -> Array:
    """Numbers (len(texts), width) of texts that hold `width` numbers each, separated by white space.

    `nan`, `inf` and their Windows spellings are read as such. Raises `RowError` naming the first text that has another count of
    numbers or something else than numbers.
    """
    rows = _parse_fixed_point(texts, width)
    if rows is not None:
        return rows
    return np.array([_parse_row(row, text, width) for row, text in enumerate(texts)], float).reshape(len(texts), width)


def _parse_row(row: int, text: str, width: int) -> list[float]:
    words = text.split()
    if len(words) != width:
        raise RowError(row, f"{len(words)} values")
    try:
        # float() also takes "1_000" and digits of other scripts, which no writer of motion files means.
        if not text.isascii() or "_" in text:
            raise ValueError
        return [float(word) for word in words]
    except ValueError:
        return [_parse_word(row, word) for word in words]


def _parse_word(row: int, word: str) -> float:
    try:
        if not word.isascii() or "_" in word:
            raise ValueError
        return float("nan" if _WINDOWS_NOT_A_NUMBER.fullmatch(word) else word)
    except ValueError:
        shown = word if len(word) <= 20 else word[:20] + "…"
        raise RowError(row, f"{shown!r} is not a number") from None


def _parse_fixed_point(texts: Sequence[str], width: int) -> Array | None:
    """The same for texts of numbers `-?digits.decimals`, all with one count of decimals and one space between; None for others.

    Whole numbers without a point are the case of no decimals.
    """
    joined = " ".join(texts) + " "
    if not joined.isascii() or not width:
        return None
    raw = joined.encode("ascii")
    first_number = raw[: raw.find(b" ")]
    after_whole = (
        len(first_number) - first_number.find(b".") if b"." in first_number else 0
    )  # the point and the decimals
    decimals = max(after_whole - 1, 0)

    text = np.frombuffer(raw, np.uint8)
    ends = np.flatnonzero(text == _SPACE)
    row_ends = np.array(list(accumulate(len(one) + 1 for one in texts))) - 1
    if len(ends) != len(texts) * width or not np.array_equal(ends[width - 1 :: width], row_ends):
        return None
    starts = np.concatenate([[0], ends[:-1] + 1])
    negative = text[starts] == _MINUS
    whole_digits = ends - starts - negative - after_whole
    most = int(whole_digits.max())
    if whole_digits.min() < 1 or most + decimals > MAX_DIGITS:
        return None

    # Every number ends in the same columns: its last whole digit, the point, the decimals. One row of `columns` for each.
    columns = text[ends + np.arange(-after_whole - 1, 0)[:, None]]
    weights = 10.0 ** np.arange(decimals, -1, -1)
    digits = columns - _ZERO  # wraps around below "0", so that one comparison finds every character that is no digit
    if after_whole:
        if (columns[1] != _POINT).any():
            return None
        digits[1] = 0
        weights = np.insert(weights, 1, 0.0)
    if digits.max() > 9:
        return None
    values: Array = weights @ digits
    for place in range(2, most + 1):
        longer = np.flatnonzero(whole_digits >= place)
        digit = text[ends[longer] - (after_whole + place)] - _ZERO
        if digit.max() > 9:
            return None
        values[longer] += digit * 10.0 ** (decimals + place - 1)
    values /= 10.0**decimals
    values *= 1.0 - 2.0 * negative
    return values.reshape(len(texts), width)
