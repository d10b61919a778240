"""Reports: what passes and what fails."""

from __future__ import annotations

import numpy as np
from retarget.core.report import Check, ValidationReport


def test_a_report_passes_unless_a_check_failed() -> None:
    good, bad = Check("a", 1, "m", 2, True), Check("b", 3, "m", 2, False)
    unknown = Check("c", None, "m", None, None, "no feet")
    assert ValidationReport("s", (good, unknown)).passed
    assert not ValidationReport("s", (good, bad, unknown)).passed


def test_numpys_own_false_fails_too() -> None:
    """`np.False_ is False` does not hold: a comparison of NumPy numbers must not slip through as passed."""
    value = np.float64(3)
    check = Check("b", value, "m", 2.0, value < 2.0)
    assert not ValidationReport("s", (check,)).passed
    assert check.passed is False
    assert type(check.value) is float


def test_checks_may_come_as_a_list() -> None:
    found = ValidationReport("s", [Check("a", 1, "m", 2, True)])  # type: ignore[arg-type]
    assert isinstance(found.checks, tuple)
