"""Writes tracker recordings as SteamVR loggers do: one row per frame, every column named, in OpenVR's world (Y up, X right, Z backward).

Columns: `time_s`, then per tracker `<name>_x_m`, `_y_m`, `_z_m`, `_qw`, `_qx`, `_qy`, `_qz` (world ← tracker) and `_valid` (1, or 0 where the
pose is the last one known). The header can't tell which axis is up; whoever reads it has to be told.
"""

from __future__ import annotations

from typing import Final, Literal

import numpy as np
from retarget.core import rotations
from retarget.core.types import Array, TrackerRecording

FIELDS: Final = ("x_m", "y_m", "z_m", "qw", "qx", "qy", "qz", "valid")
DECIMALS: Final = 7
"""0.1 µm: rounding alone moves a point 8 cm from a tracker by less than a micrometre."""

_TO_OPENVR: Final = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])


def to_openvr(position: Array, orientation: Array) -> tuple[Array, Array]:
    """Positions (..., 3) m and orientations (..., 4), world ← tracker, of the house's world in OpenVR's; trackers' own axes stay theirs."""
    return position @ _TO_OPENVR.T, rotations.multiply(rotations.from_matrix(_TO_OPENVR), orientation)


def write(recording: TrackerRecording, *, lost: Literal["held", "empty"] = "held") -> bytes:
    """The recording as CSV. lost: what stands where a tracker was not tracked, its last pose or nothing; `_valid` is 0 either way. Quaternions have w ≥ 0, as those made from matrices do: their signs jump where w passes zero."""
    position, orientation = to_openvr(recording.position, recording.orientation)
    orientation = np.where(orientation[..., :1] < 0, -orientation, orientation)
    # Adding zero takes the sign from a negative zero.
    poses = np.round(np.concatenate([position, orientation], axis=-1), DECIMALS) + 0.0
    lines = [",".join(["time_s", *(f"{name}_{field}" for name in recording.trackers for field in FIELDS)])]
    for time, row, tracked in zip(recording.time, poses, recording.tracked, strict=True):
        cells = [f"{time:.6f}"]
        for pose, valid in zip(row, tracked, strict=True):
            cells += [f"{value:.{DECIMALS}f}" if valid or lost == "held" else "" for value in pose]
            cells.append(str(int(valid)))
        lines.append(",".join(cells))
    return ("\n".join(lines) + "\n").encode()
