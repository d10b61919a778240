"""The published figures of robots whose URDF we write ourselves, read from tables that are not part of the repository."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

FACTS = Path(__file__).resolve().parents[3] / "shared" / "facts"

Row = dict[str, str]


def published(name: str) -> tuple[list[Row], list[Row]]:
    """Rows of the joint table and of the link table of `name`.md, column → text. Skips the test where the file is absent."""
    path = FACTS / f"{name}.md"
    if not path.is_file():
        pytest.skip(f"the table of facts (../shared/facts/{name}.md) is not on this machine")
    tables: list[list[Row]] = []
    head: list[str] = []
    for line in path.read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if cells[0] in ("joint", "link"):
            head = cells
            tables.append([])
        elif len(cells) == len(head) and not cells[0].startswith("-"):
            tables[-1].append(dict(zip(head, cells, strict=True)))
    joints, links = tables
    return joints, links


def numbers(text: str) -> np.ndarray:
    """ "0.1 0 -2" → array."""
    return np.array(text.split(), float)
