"""What a reader was told beside the file stands in the motion's source: values as given, files by their hash, nothing where nothing was."""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path
from typing import Any

import pytest
from retarget import formats, samples
from retarget.formats import TrackerOptions
from retarget.formats._reader_options import options_facts


def sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def test_written_by_hand(tmp_path: Path) -> None:
    (tmp_path / "columns.toml").write_text("# mine\n")
    (tmp_path / "msg").mkdir()
    (tmp_path / "msg" / "B.msg").write_text("int8 b\n")
    (tmp_path / "msg" / "A.msg").write_text("int8 a\n")
    frames: dict[str, Any] = {"root": "world", "prefix": "a_"}
    options = TrackerOptions(
        columns=tmp_path / "columns.toml",
        up="z",
        rate_hz=90.0,
        roles={"LHR-1": "left_hand"},
        handedness="left",
        frames=frames,
        clock="log",
        msg_defs=(tmp_path / "msg",),
    )
    facts = options_facts(options)
    assert facts == {
        "up": "z",
        "handedness": "left",
        "rate_hz": 90.0,
        "roles": {"LHR-1": "left_hand"},
        "clock": "log",
        "columns_sha256": sha256(b"# mine\n"),
        "frames_sha256": sha256(b'{"prefix": "a_", "root": "world"}'),
        "msg_defs_sha256": sha256(b"int8 a\nint8 b\n"),
    }
    assert str(tmp_path) not in json.dumps(facts)
    assert options_facts(TrackerOptions()) == {}


def test_what_can_t_be_read_again_has_no_hash(tmp_path: Path) -> None:
    """A pipe (`--columns <(…)`) is read once, by the reader; unusable definitions were not used."""
    os.mkfifo(tmp_path / "pipe")
    assert options_facts(TrackerOptions(columns=tmp_path / "pipe")) == {"columns_sha256": None}
    assert options_facts(TrackerOptions(msg_defs=(tmp_path / "nowhere",))) == {}


def test_a_tracker_log_remembers_its_options() -> None:
    path = samples.sample_path("box_trackers")
    log = formats.read_trackers(path, options=TrackerOptions(up="y"))
    assert log.source.options == {"up": "y"}
    assert formats.read_recording(path, options=TrackerOptions(up="y")).source.options == {"up": "y"}
    assert formats.read_trackers(path).source.options == {}


@pytest.mark.parametrize("options", [None, TrackerOptions(), TrackerOptions(up="z")])
def test_a_suit_s_recording_needs_none_and_remembers_none(options: TrackerOptions | None) -> None:
    assert formats.read_motion(samples.sample_path("squat"), options=options).source.options == {}
