"""What each joint did over a trajectory, in three numbers, as the trajectory's provenance keeps them.

Two columns that changed places can stay inside every limit of the robot; they do not stay inside the range that each was written with. Kept by
the joints' names, so that exchanged names show as exchanged values do.

```json
"joint_ranges": {"frames": 793, "joints": {"left_knee_joint": [0.09089, 1.180882, "8c2f1a07"]}}
```
Lowest and highest value are rounded outward to a millionth, to be short. The third is the CRC-32 of the values in single precision, little-endian:
the two sides of a symmetric motion cover the same range, but not at the same time. It is the same in files of single and double precision.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from retarget.core.chunks import frame_chunks
from retarget.core.errors import InvalidDataError
from retarget.core.types import Array

KEY = "joint_ranges"
"""Where in a trajectory's provenance they stand."""
STEPS_A_UNIT = 1_000_000
"""Bounds are whole multiples of 1 / STEPS_A_UNIT rad, or m."""


@dataclass(frozen=True, eq=False)
class JointRanges:
    """frames: of how many frames. joint_names: n, each once. lower, upper: (n,) rad (m for sliding joints), rounded outward. crc: n CRC-32."""

    frames: int
    joint_names: tuple[str, ...]
    lower: Array
    upper: Array
    crc: tuple[int, ...]

    @classmethod
    def of(cls, joint_names: Sequence[str], position: Array) -> JointRanges:
        """Those of `position` (T, n) with T ≥ 1."""
        # Adding zero makes the negative zero that rounding gives an ordinary one.
        lower = np.floor(position.min(axis=0) * STEPS_A_UNIT) / STEPS_A_UNIT + 0.0
        upper = np.ceil(position.max(axis=0) * STEPS_A_UNIT) / STEPS_A_UNIT + 0.0
        return cls(len(position), tuple(joint_names), lower, upper, _crc(position, (0,) * len(joint_names)))

    def extended(self, position: Array) -> JointRanges:
        """Those of the same trajectory with the next part of it, `position` (T, n) with T ≥ 1, for what is written in parts."""
        part = JointRanges.of(self.joint_names, position)
        return JointRanges(
            self.frames + part.frames,
            self.joint_names,
            np.minimum(self.lower, part.lower),
            np.maximum(self.upper, part.upper),
            _crc(position, self.crc),
        )

    def provenance(self) -> dict[str, Any]:
        """As an entry of a trajectory's provenance."""
        rows = zip(self.lower.tolist(), self.upper.tolist(), self.crc, strict=True)
        joints = {
            name: [lower, upper, f"{crc:08x}"] for name, (lower, upper, crc) in zip(self.joint_names, rows, strict=True)
        }
        return {KEY: {"frames": self.frames, "joints": joints}}

    @classmethod
    def from_provenance(cls, provenance: Mapping[str, Any]) -> JointRanges | None:
        """What `provenance` keeps, None where it keeps none. Raises `InvalidDataError` for an entry of another kind."""
        if KEY not in provenance:
            return None
        try:
            frames, joints = provenance[KEY]["frames"], dict(provenance[KEY]["joints"])
            bounds = np.array([[float(lower), float(upper)] for lower, upper, _ in joints.values()]).reshape(-1, 2)
            crc = tuple(_parsed(text) for _, _, text in joints.values())
        except (KeyError, TypeError, ValueError, OverflowError):
            expected = "frames, and [lowest, highest, CRC-32] of each joint"
            raise InvalidDataError(f"provenance.{KEY}: found something else, expected {expected}") from None
        if isinstance(frames, bool) or not isinstance(frames, int) or frames < 1:
            raise InvalidDataError(f"provenance.{KEY}.frames: found {frames!r}, expected how many were written")
        wrong = ~((bounds[:, 0] <= bounds[:, 1]) & np.isfinite(bounds).all(axis=1))
        if wrong.any():
            at = int(np.argmax(wrong))
            found = bounds[at].tolist()
            raise InvalidDataError(
                f"provenance.{KEY} of {list(joints)[at]}: found {found}, expected lowest and highest"
            )
        return cls(frames, tuple(joints), bounds[:, 0], bounds[:, 1], crc)


def _crc(position: Array, before: Sequence[int]) -> tuple[int, ...]:
    """The CRC-32 of each column, going on from `before`."""
    crc = tuple(before)
    for part in frame_chunks(len(position)):
        with np.errstate(over="ignore"):  # what no joint reaches is infinite in single precision
            columns = np.ascontiguousarray((position[part].T + 0.0).astype("<f4"))
        crc = tuple(zlib.crc32(column, so_far) for column, so_far in zip(columns, crc, strict=True))
    return crc


def _parsed(text: str) -> int:
    if not re.fullmatch("[0-9a-f]{8}", text):
        raise ValueError(text)
    return int(text, 16)
