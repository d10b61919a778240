"""Whatever the bytes, a tracker log gives a valid recording or one `RetargetError` of one line."""

from __future__ import annotations

import gzip
import random
import warnings
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from retarget.core.errors import RetargetError
from retarget.formats import _vive_columns

from tests.formats.test_fuzz import damaged
from tests.formats.tracker_logs import POSE, read, text, wandering, wide

TIME = np.arange(6) / 50
ROWS = [[repr(float(t)), name, *wandering(6)[i], "1"] for i, t in enumerate(TIME) for name in ("waist", "LHR-1")]
COLUMNS = {
    "header": False,
    "skip_lines": 1,
    "rate_hz": 90,
    "trackers": {"a": {part: i + 2 for i, part in enumerate(POSE)}},
}
LOGS: dict[str, tuple[bytes, dict[str, Any]]] = {
    "wide": (wide(TIME, waist=wandering(6), chest=wandering(6, 1)).encode(), {}),
    "long": (text(["time", "device", *POSE, "valid"], ROWS, ";").encode(), {}),
    "calendar": (text(["utc", *POSE], [[f"2026-01-01T00:00:0{i}Z", *wandering(6)[i]] for i in range(6)]).encode(), {}),
    "columns": (wide(TIME, waist=wandering(6)).encode(), {"columns": COLUMNS}),
    "libsurvive": (
        b"".join(b"0.%d T20 POSE 0.1 0.2 1.%d 1 0 0 0\n" % (i, i) for i in range(8)) * 1,
        {"format": "libsurvive"},
    ),
    "gzip": (gzip.compress(b"".join(b"0.%d T20 POSE 0 0 1 1 0 0 0\n" % i for i in range(8))), {"format": "libsurvive"}),
}


def refuses(data: bytes, options: dict[str, Any]) -> bool:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            found = read(data, **options)
        except RetargetError as error:
            message = str(error)
        else:
            message = ""
    assert "\n" not in message
    if message:
        return True
    assert np.isfinite(found.position).all()
    return False


@pytest.mark.parametrize("kind", LOGS)
def test_damaged_bytes(kind: str) -> None:
    rng = random.Random(kind)
    data, options = LOGS[kind]
    assert not refuses(data, options)
    refused = sum(refuses(damaged(data, rng), options) for _ in range(300))
    assert refused > 20


CELLS = st.sampled_from(
    [
        "",
        "0",
        "1",
        "-1",
        "nan",
        "inf",
        "1e308",
        "-1e308",
        "1e-320",
        "0.5",
        "true",
        "x",
        "2026-01-01",
        '"',
        "200",
        "9" * 400,
        "é",
        "1_0",
        "٣",
    ]
)
NAMES = st.sampled_from(
    [
        "time",
        "t_ms",
        "device",
        "role",
        "valid",
        "status",
        "a_x",
        "a_lost",
        *POSE,
        *(f"a_{part}" for part in POSE),
        "w",
        "i",
        "j",
        "k",
        "",
    ]
)


@settings(max_examples=150, suppress_health_check=list(HealthCheck))
@given(st.binary(max_size=200), st.sampled_from(["vive", "libsurvive"]))
def test_any_bytes(data: bytes, format: str) -> None:
    refuses(data, {"format": format})


@settings(max_examples=300, suppress_health_check=list(HealthCheck))
@given(
    st.lists(NAMES, max_size=4),
    st.lists(st.lists(CELLS, min_size=12, max_size=12), min_size=1, max_size=4),
    st.sampled_from([",", ";", "\t", " "]),
    st.sampled_from([None, 90.0]),
)
def test_any_cells_below_a_header(
    names: list[str], rows: list[list[str]], delimiter: str, rate_hz: float | None
) -> None:
    header = ["time", *POSE, *names]
    data = "\n".join(delimiter.join(cells[: len(header)]) for cells in [header, *rows]).encode()
    refuses(data, {"rate_hz": rate_hz})
    refuses(data, {"columns": {"rate_hz": 90, "trackers": {"a": {part: part for part in POSE} | {"valid": 1}}}})


@settings(max_examples=100, suppress_health_check=list(HealthCheck))
@given(
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
        lambda inner: (
            st.lists(inner, max_size=3)
            | st.dictionaries(st.sampled_from(["x", "y", "z", "qw", "valid", "unit", "a"]), inner, max_size=5)
        ),
    ),
    st.sampled_from(_vive_columns._TOP),
)
def test_any_value_in_a_columns_file(value: Any, key: str) -> None:
    refuses(LOGS["columns"][0], {"columns": COLUMNS | {key: value}})
