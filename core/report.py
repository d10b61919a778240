"""What a replay or a robot check found: measured values beside their limits, and the series behind them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
from retarget.core.field_checks import FieldSetter, read_only
from retarget.core.types import Array


@dataclass(frozen=True)
class Check:
    """One measured value against its limit.

    passed: None when nothing was judged: no value could be measured, or no limit is set; `note` says which.
    where, time_s: the joint, link or pair at fault, and when it was worst; "" and None where there is no such thing.
    """

    name: str
    value: float | None
    unit: str
    limit: float | None
    passed: bool | None
    note: str = ""
    where: str = ""
    time_s: float | None = None

    def __post_init__(self) -> None:
        # NumPy's False is not `False` and no JSON: what a comparison of arrays gave becomes Python's own here.
        set_ = FieldSetter(self)
        set_.value("passed", None if self.passed is None else bool(self.passed))
        set_.value("value", None if self.value is None else float(self.value))
        set_.value("limit", None if self.limit is None else float(self.limit))
        set_.value("time_s", None if self.time_s is None else float(self.time_s))


@dataclass(frozen=True, eq=False)
class ValidationReport:
    """What a replay or a robot check found: checks, and the series behind them.

    subject: the robot's or the clip's name. mode: how it was validated, "" for a robot check. facts: further JSON-able figures that are no
    checks (per-joint tables, settings).
    """

    subject: str
    checks: tuple[Check, ...]
    series: Mapping[str, Array] = field(default_factory=dict)
    mode: str = ""
    facts: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        set_ = FieldSetter(self)
        set_.value("checks", tuple(self.checks))
        series = {name: read_only(f"ValidationReport.series[{name}]", v, np.float64) for name, v in self.series.items()}
        set_.value("series", MappingProxyType(series))
        set_.value("facts", MappingProxyType(dict(self.facts)))

    @property
    def passed(self) -> bool:
        """Whether no check failed."""
        return not self.failures

    @property
    def failures(self) -> tuple[Check, ...]:
        """The checks that failed."""
        return tuple(check for check in self.checks if check.passed is False)

    def check(self, name: str) -> Check:
        """The check called `name`; raises `KeyError` when there is none."""
        for check in self.checks:
            if check.name == name:
                return check
        raise KeyError(name)
