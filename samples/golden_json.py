"""How the truth beside a sample is written: rounded to 8 decimals, one line per key, and per selected frame and key."""

from __future__ import annotations

import json
from typing import Any

import numpy as np


def rounded(values: Any) -> Any:
    """Numbers or arrays of them to 8 decimals, as lists; no negative zero."""
    return (np.round(values, 8) + 0.0).tolist()


def to_json(content: dict[str, Any]) -> str:
    """JSON with one line per key, and per selected frame and key, so that a change shows as few lines."""
    frames = [
        "  {" + ",\n   ".join(f"{json.dumps(key)}: {json.dumps(value)}" for key, value in frame.items()) + "}"
        for frame in content["selected"]
    ]
    lines = [f" {json.dumps(key)}: {json.dumps(value)}" for key, value in content.items() if key != "selected"]
    return "{\n" + ",\n".join([*lines, ' "selected": [\n' + ",\n".join(frames) + "]"]) + "\n}\n"
