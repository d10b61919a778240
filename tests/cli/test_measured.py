"""The page of measurements holds what the program gives, for a part of it measured again, and what is said of it is so."""

from __future__ import annotations

from pathlib import Path

import pytest
from retarget.cli import measured

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "measured.md"


def rows() -> list[dict[str, str]]:
    """Column → cell, of every row of the large table."""
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    start = lines.index("| " + " | ".join(measured.COLUMNS) + " |") + 2
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[start:]]
    return [dict(zip(measured.COLUMNS, line, strict=True)) for line in cells]


def numbers(cell: str) -> list[float]:
    """The numbers at the cell's start, before what is in brackets."""
    return [float(part) for part in cell.partition("(")[0].split("/") if part.strip()]


def test_every_clip_is_there() -> None:
    assert len(rows()) == len(list(measured.every_clip()))
    assert measured.page([], Path()).splitlines() == PAGE.read_text(encoding="utf-8").splitlines()[: -len(rows())]


@pytest.mark.parametrize(
    "clip", [measured.Clip("squat", "g1"), measured.Clip("squat", "baxter")], ids=lambda clip: clip.robot
)
def test_a_row_holds_what_is_measured(clip: measured.Clip) -> None:
    committed = next(row for row in rows() if (row["clip"], row["robot"]) == (clip.sample, clip.robot))
    now = dict(zip(measured.COLUMNS, measured.row(clip, ROOT / "samples"), strict=True))
    for column in ("clip", "robot", "hands / mm", "limits broken", "verdict"):
        assert committed[column] == now[column]
    for column in ("limbs / °", "motion asks", "tracking / °", "saturated / %", "links meet / mm"):
        # two digits, of which the last may be rounded the other way elsewhere
        assert numbers(committed[column]) == pytest.approx(numbers(now[column]), rel=0.1), column


def test_no_limit_is_broken_and_motors_reach_theirs_where_the_page_says() -> None:
    for row in rows():
        assert row["limits broken"] == "0"
        (saturated,), (asked,) = numbers(row["saturated / %"]), numbers(row["motion asks"])
        assert (saturated > 0) == (asked > 1 or (row["robot"] == "tocabi `--gains profile`" and row["clip"] == "walk"))


@pytest.mark.parametrize(
    ("value", "text"),
    [(None, "–"), (0.0, "0"), (0.0363, "0.036"), (26.0012, "26"), (348.3, "350"), (0.9999, "1"), (1e-7, "1e-07")],
)
def test_numbers_have_two_digits(value: float | None, text: str) -> None:
    assert measured.rounded(value) == text
