"""Writes all samples: `python -m retarget.samples.generate [--out DIR]`. The same bytes every time.

Beside each recording `<name>.mvnx.gz` stands `<name>.json`, what it must decode to, taken from the motion itself before
anything was rounded or written.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
from retarget.core.segments import FOOT_CONTACTS, SEGMENTS
from retarget.samples import exercises, mvnx_writer, steps
from retarget.samples.gait import Walk
from retarget.samples.recording import Recording, record, turned

YAW_DURATION: Final = 5.0
HEADINGS_DEG: Final = (0, 45, 90, 135, 180, 225, 270, 315)


@dataclass(frozen=True)
class Sample:
    """One file: how its motion is made, and which optional fields it holds."""

    record: Callable[[], Recording]
    version: mvnx_writer.Version = 4
    angular_velocity: bool = True
    foot_contacts: bool = True


def _facing(heading_deg: int) -> Recording:
    return turned(record(exercises.Reach(), YAW_DURATION), float(np.radians(heading_deg)))


SAMPLES: Final[dict[str, Sample]] = {
    "walk": Sample(partial(record, Walk.planned(), steps.DURATION)),
    "walk_v3": Sample(partial(record, Walk.planned(), steps.DURATION), version=3, foot_contacts=False),
    "reach": Sample(partial(record, exercises.Reach(), exercises.REACH_DURATION)),
    "squat": Sample(partial(record, exercises.Squat(), exercises.SQUAT_DURATION)),
} | {f"yaw_{heading:03d}": Sample(partial(_facing, heading), angular_velocity=False) for heading in HEADINGS_DEG}


def golden(sample: Sample, recording: Recording) -> dict[str, Any]:
    """What a reader must find in the file: facts, and five frames in full."""
    chosen = sorted({0, 1, recording.frames // 3, recording.frames // 2, recording.frames - 1})
    contacts = recording.foot_contacts
    return {
        "format": "mvnx",
        "version": str(sample.version),
        "rate_hz": recording.rate_hz,
        "frames": recording.frames,
        "segments": list(SEGMENTS),
        "contact_frames": dict(zip(FOOT_CONTACTS, contacts.sum(axis=0).tolist(), strict=True))
        if sample.foot_contacts
        else None,
        "quaternion_order": "wxyz",
        "selected": [
            {
                "frame": i,
                "time_s": _rounded(i / recording.rate_hz),
                "orientation": _rounded(recording.orientation[i]),
                "position": _rounded(recording.position[i]),
                "angular_velocity": _rounded(recording.angular_velocity[i]) if sample.angular_velocity else None,
                "foot_contacts": contacts[i].tolist() if sample.foot_contacts else None,
            }
            for i in chosen
        ],
    }


def write_all(folder: Path) -> list[Path]:
    """Writes every sample and its golden JSON into `folder` (made if missing); the paths written."""
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for name, sample in SAMPLES.items():
        recording = sample.record()
        fields = {"angularVelocity": sample.angular_velocity, "footContacts": sample.foot_contacts}
        path, truth = folder / f"{name}.mvnx.gz", folder / f"{name}.json"
        path.write_bytes(mvnx_writer.write(recording, sample.version, name, fields))
        truth.write_text(_json(golden(sample, recording)))
        written += [path, truth]
    return written


def _rounded(values: Any) -> Any:
    return (np.round(values, 8) + 0.0).tolist()


def _json(content: dict[str, Any]) -> str:
    """JSON with one line per key, and per selected frame and key, so that a change shows as few lines."""
    frames = [
        "  {" + ",\n   ".join(f"{json.dumps(key)}: {json.dumps(value)}" for key, value in frame.items()) + "}"
        for frame in content["selected"]
    ]
    lines = [f" {json.dumps(key)}: {json.dumps(value)}" for key, value in content.items() if key != "selected"]
    return "{\n" + ",\n".join([*lines, ' "selected": [\n' + ",\n".join(frames) + "]"]) + "\n}\n"


def main() -> None:
    """Entry point."""
    parser = argparse.ArgumentParser(description="Write the synthetic sample recordings and what they must decode to.")
    parser.add_argument(
        "--out", type=Path, default=Path(__file__).parent, help="folder to write to (default: beside this script)"
    )
    for path in write_all(parser.parse_args().out):
        print(f"{path.stat().st_size:>9} {path.name}")


if __name__ == "__main__":
    main()
