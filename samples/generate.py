"""Writes all samples: `python -m retarget.samples.generate [--out DIR]`. The same bytes every time.

Beside each recording `<name>.mvnx.gz` or `<name>.csv` (trackers) stands `<name>.json`, what it must decode to, taken from the motion itself
before anything was rounded or written.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
from retarget.core.segments import FOOT_CONTACTS, SEGMENTS
from retarget.samples import exercises, mvnx_writer, steps, tasks, tracker_csv, tracker_truth
from retarget.samples.gait import Walk
from retarget.samples.golden_json import rounded, to_json
from retarget.samples.recording import Recording, record, turned
from retarget.samples.takes import Take, operator_recording
from retarget.samples.trackers import Dropout, Faults

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


# One session: the same operator with the trackers on alike, in a room whose axes are not the operator's.
_take = partial(operator_recording, heading_rad=float(np.radians(35.0)), origin=(0.8, -0.4, 0.0))

FAULTS: Final = Faults(
    position_noise_m=0.0005,
    rotation_noise_rad=0.002,
    dropouts=(Dropout("RightHand", 2.60, 2.75), Dropout("Head", 10.0, 10.2)),
    repeats=0.03,
)

TRACKER_SAMPLES: Final[dict[str, Callable[[], Take]]] = {
    "calibration_trackers": partial(_take, tasks.Calibration()),
    "calibration_serials": partial(_take, tasks.Calibration(), faults=FAULTS, serials=True),
    "circles_trackers": partial(_take, tasks.Circles()),
    "box_trackers": partial(_take, tasks.BoxCarrying()),
    "clap_trackers": partial(_take, tasks.Clapping()),
}
"""Tracker logs; all but `calibration_serials` without faults."""


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
                "time_s": rounded(i / recording.rate_hz),
                "orientation": rounded(recording.orientation[i]),
                "position": rounded(recording.position[i]),
                "angular_velocity": rounded(recording.angular_velocity[i]) if sample.angular_velocity else None,
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
        truth.write_text(to_json(golden(sample, recording)))
        written += [path, truth]
    return written + write_trackers(folder)


def write_trackers(folder: Path) -> list[Path]:
    """Writes the tracker logs and their golden JSON into `folder`, which exists; the paths written."""
    written = []
    for name, make in TRACKER_SAMPLES.items():
        take = make()
        path, truth = folder / f"{name}.csv", folder / f"{name}.json"
        path.write_bytes(tracker_csv.write(take.recording))
        truth.write_text(to_json(tracker_truth.golden(take)))
        written += [path, truth]
    return written


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
