"""The options a recording was read with, as facts for the provenance of what is made of it: values as given, files by their hash, no paths."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from retarget.core.errors import UsageError
from retarget.core.types import HumanMotion, TrackerRecording
from retarget.formats._ros_definitions import definition_files
from retarget.formats.base import TrackerOptions


def noted(recording: HumanMotion | TrackerRecording, options: TrackerOptions) -> HumanMotion | TrackerRecording:
    """`recording` whose source tells the options that were given for it; the same object where none were."""
    facts = options_facts(options)
    return replace(recording, source=replace(recording.source, options=facts)) if facts else recording


def options_facts(options: TrackerOptions) -> dict[str, Any]:
    """The given options as JSON-able facts: `up`, `handedness`, `rate_hz`, `roles`, `clock`, and `columns_sha256`, `frames_sha256`, `msg_defs_sha256`.

    The hash of a file is that of its bytes, of content given in its place that of its JSON, of several definitions that of all their bytes,
    one after the other; None of a pipe, which can't be read again.
    """
    facts: dict[str, Any] = {
        "up": options.up,
        "handedness": options.handedness,
        "rate_hz": options.rate_hz,
        "roles": dict(options.roles) or None,
        "clock": options.clock,
    }
    facts = {name: value for name, value in facts.items() if value is not None}
    for name, source in (("columns", options.columns), ("frames", options.frames)):
        if source is not None:
            facts[f"{name}_sha256"] = _sha256(source)
    # Definitions that can't be used weren't: the reader complains where it needs them.
    with suppress(UsageError):
        if options.msg_defs:
            content = b"".join(path.read_bytes() for path in definition_files(options.msg_defs))
            facts["msg_defs_sha256"] = hashlib.sha256(content).hexdigest()
    return facts


def _sha256(source: Path | Mapping[str, Any]) -> str | None:
    if isinstance(source, Mapping):
        content = json.dumps(source, sort_keys=True, default=str).encode()
    elif source.is_file():
        content = source.read_bytes()
    else:
        return None
    return hashlib.sha256(content).hexdigest()
