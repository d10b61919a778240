"""Text to numbers: the same bits as `float()`, and nothing that is no number gets through."""

from __future__ import annotations

import math
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from retarget.formats import _number_text
from retarget.formats._number_text import RowError, parse_rows


def plain(texts: list[str], width: int) -> list[list[float]] | None:
    """The same by Python alone; None for a row of another count or a word that is no number."""
    rows = [text.split() for text in texts]
    if any(len(row) != width for row in rows) or any("_" in text or not text.isascii() for text in texts):
        return None
    try:
        return [[float(word) for word in row] for row in rows]
    except ValueError:
        return None


def bits(rows: list[list[float]]) -> bytes:
    return b"".join(struct.pack("d", value) for row in rows for value in row)


@st.composite
def fixed_point(draw: st.DrawFn) -> tuple[list[str], int]:
    """Rows of numbers that all have the same count of decimals."""
    decimals, width = draw(st.integers(0, 9)), draw(st.integers(1, 7))
    number = st.tuples(st.booleans(), st.integers(0, 10 ** draw(st.integers(1, 17)))).map(
        lambda drawn: ("-" if drawn[0] else "") + (f"{drawn[1]:0{decimals + 1}d}")
    )
    point = number.map(lambda digits: f"{digits[:-decimals]}.{digits[-decimals:]}" if decimals else digits)
    rows = draw(st.lists(st.lists(point, min_size=width, max_size=width).map(" ".join), min_size=1, max_size=5))
    return rows, width


@settings(max_examples=200)
@given(fixed_point())
def test_fixed_point_has_the_bits_of_float(drawn: tuple[list[str], int]) -> None:
    texts, width = drawn
    expected = plain(texts, width)
    assert expected is not None
    assert parse_rows(texts, width).tobytes() == bits(expected)


def test_the_fast_way_is_taken_for_what_recordings_hold(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise AssertionError("one by one")

    monkeypatch.setattr(_number_text, "_parse_row", refuse)
    assert parse_rows(["-0.123456 12.000001 0.000000", "1.000000 -0.000000 -123.456789"], 3).shape == (2, 3)
    assert parse_rows(["1 0 1 1"], 4).tolist() == [[1, 0, 1, 1]]
    with pytest.raises(AssertionError, match="one by one"):
        parse_rows(["1e3 2.0"], 2)


def test_signed_zero() -> None:
    assert math.copysign(1, parse_rows(["-0.000000 0.000000"], 2)[0, 0]) == -1


@settings(max_examples=800)
@given(
    st.lists(st.text("0123456789.- +e\n\txn_", max_size=24), min_size=1, max_size=3),
    st.integers(1, 4),
)
def test_anything_else_is_read_as_by_float_or_refused(texts: list[str], width: int) -> None:
    check(texts, width)


def check(texts: list[str], width: int) -> None:
    """The texts are read to the bits of `float`, or refused where it refuses them."""
    expected = plain(texts, width)
    if expected is None:
        with pytest.raises(RowError):
            parse_rows(texts, width)
    else:
        assert parse_rows(texts, width).tobytes() == bits(expected)


NEARLY = ["0.12 345", "0.1.123456", "0.1.1234 6", "1.-23456", "-.123456", "0.12345x", "x.123456", "--.123456", "1 .123456", "0.123456-0.123456",
          "0,123456 0.1", "0.123456  0.123456", " 0.123456 0.123456", "0.123456 0.123456 ", "1234567890.123456 1.000000", "+1.123456 1.000000",
          "0:123456 1.000000", "0./23456 1.000000"]  # fmt: skip


@pytest.mark.parametrize("text", NEARLY)
def test_near_misses(text: str) -> None:
    """Texts that look like fixed-point numbers to a careless check."""
    for width in (1, 2):
        for texts in ([text], ["0.654321 0.123456"[: 9 * width - 1], text]):
            check(texts, width)


def test_rows_do_not_lend_each_other_numbers() -> None:
    with pytest.raises(RowError, match="3 values") as caught:
        parse_rows(["1.0 2.0", "3.0 4.0 5.0", "6.0"], 2)
    assert caught.value.row == 1


@pytest.mark.parametrize("word", ["nan", "NaN", "-nan", "nan(ind)", "-nan(ind)", "1.#QNAN", "-1.#IND00", "1.#INF00"])
def test_not_a_number(word: str) -> None:
    assert np.isnan(parse_rows([f"{word} 1.0"], 2)[0]).tolist() == [True, False]


@pytest.mark.parametrize("word", ["inf", "-Infinity", "1e999"])
def test_infinite(word: str) -> None:
    assert np.isinf(parse_rows([f"0.5 {word}"], 2)[0]).tolist() == [False, True]


def test_long_words_are_cut_in_messages() -> None:
    with pytest.raises(RowError, match=r"^'x{20}…' is not a number$"):
        parse_rows(["x" * 500], 1)


def test_no_width() -> None:
    assert parse_rows(["", ""], 0).shape == (2, 0)
