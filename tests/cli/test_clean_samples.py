"""The tracker samples without faults give nothing to warn of; the one with faults says which it has."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result
from retarget import samples

Run = Callable[..., Result]

CLEAN = ("box_trackers", "calibration_trackers", "circles_trackers", "clap_trackers")


@pytest.fixture
def operator(run: Run) -> Path:
    """The calibration of the samples' operator, made without a word too many."""
    log = samples.sample_path("calibration_trackers")
    result = run("calibrate", log, "--up", "y", "-o", "operator.json")
    assert result.exit_code == 0
    assert result.stderr.startswith("Still pose ")
    assert len(result.stderr.splitlines()) == 1
    return Path("operator.json")


def test_info_has_nothing_to_warn_of(run: Run) -> None:
    result = run("info", "--json", "--up", "y", *(samples.sample_path(name) for name in CLEAN))
    assert result.exit_code == 0
    assert result.stderr == ""
    for line in result.stdout.splitlines():
        found = json.loads(line)
        assert found["warnings"] == [], found["input"]
        assert (found["repeated_rows"], found["jumps"], found["gaps"]) == (0, 0, [])
    assert len(result.stdout.splitlines()) == len(CLEAN)


@pytest.mark.parametrize("name", CLEAN)
def test_nor_has_convert(run: Run, operator: Path, name: str) -> None:
    arguments = ["--up", "y", "--end", "1.0", "--calibration", operator, "--robot", "g1", "-o", "a.npz"]
    result = run("convert", samples.sample_path(name), *arguments)
    assert result.exit_code == 0, result.stderr
    assert "warning" not in result.stderr
    assert "limits kept" in result.stderr


def test_faults_are_told(run: Run) -> None:
    result = run("info", "--up", "y", samples.sample_path("calibration_serials"))
    assert result.exit_code == 0
    for words in ("rows marked as not tracked", "rows that repeat the pose before"):
        assert words in result.stdout
    assert "the same pose for longer" not in result.stdout
