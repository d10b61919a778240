"""Rows of bare numbers: root position x y z in m, root quaternion, joint positions in rad. Style `unitree` of CSV files.

The layout of Unitree's retargeted LAFAN1 motions (huggingface.co/datasets/unitreerobotics/LAFAN1_Retargeting_Dataset: 30 frames/s, root
"XYZ QX QY QZ QW", joints limb after limb as in the robot's URDF), which GMR's `batch_gmr_pkl_to_csv.py` writes (at most 30 frames/s) and
BeyondMimic's `csv_to_npz.py` takes. Such a file says neither its rate nor its joints nor the order of its quaternion: rate and names must
be given, and the style itself stands for xyzw.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from itertools import chain
from typing import BinaryIO

import numpy as np
from retarget.core.errors import FormatError, UsageError
from retarget.core.types import Array, JointTrajectory
from retarget.formats import _trajectory
from retarget.formats.base import TrajectoryOptions

ROOT_COLUMNS = 7
TO_WXYZ = {"wxyz": [0, 1, 2, 3], "xyzw": [3, 0, 1, 2]}


def read(stream: BinaryIO, name: str, options: TrajectoryOptions) -> JointTrajectory:
    """The trajectory in rows of numbers; velocities are differentiated.

    Raises `UsageError` without a rate or joint names in `options`, `FormatError` for lines that are no such row.
    """
    if options.rate_hz is None:
        raise UsageError(
            f"{name}: rows without header don't say how many are a second; expected a rate in Hz with them"
        )
    if options.joint_names is None:
        raise UsageError(f"{name}: rows without header don't name the joints; expected the robot to be named with them")
    text = io.TextIOWrapper(stream, encoding="utf-8-sig", newline="")
    try:
        rows = _parse(text, name)
    except UnicodeDecodeError as error:
        raise FormatError(name, f"not UTF-8 text: {error.reason}", place=f"byte {error.start}") from error
    finally:
        text.detach()
    joints = rows.shape[1] - ROOT_COLUMNS
    check_count(name, joints, options.joint_names, "7 columns of the root and ")
    time = np.arange(len(rows)) / options.rate_hz
    quaternion = rows[:, 3:ROOT_COLUMNS][:, TO_WXYZ[options.quaternion_order or "xyzw"]]
    position = rows[:, ROOT_COLUMNS:]
    return _trajectory.build(
        name,
        [f"no times: {options.rate_hz:g} frames/s as given", "velocity missing: differentiated from the positions"],
        time=time,
        joint_names=options.joint_names,
        position=position,
        velocity=_trajectory.differentiate(time, position),
        base_position=rows[:, :3],
        base_orientation=_trajectory.unit_quaternions(name, "root quaternion", quaternion),
    )


def check_count(name: str, joints: int, names: tuple[str, ...], before: str = "") -> None:
    """Raise `FormatError` unless there are as many joint columns as names."""
    if joints != len(names):
        raise FormatError(
            name, f"found {before}{joints} of joints", expected=f"{len(names)} joints, of the robot named"
        )


def _parse(lines: Iterable[str], name: str) -> Array:
    """Numbers (T, 7 + n)."""
    lines = iter(lines)
    first = next((line for line in lines if line.strip()), None)
    if first is None:
        raise FormatError(name, "no frames")
    cells = next(csv.reader([first]), [])
    try:
        numbers = [float(cell) for cell in cells]
    except ValueError:
        raise FormatError(
            name, f"starts with '{cells[0]}'", place="line 1", expected="numbers; a file with a header needs no style"
        ) from None
    if len(numbers) < ROOT_COLUMNS:
        raise FormatError(
            name,
            f"{len(numbers)} numbers a line",
            place="line 1",
            expected="root x y z, its quaternion, then the joints",
        )
    try:
        return np.loadtxt(chain([first], lines), delimiter=",", comments=None, ndmin=2)
    except UnicodeDecodeError:
        raise
    except ValueError as error:
        reason = " ".join(str(error).split())
        raise FormatError(name, reason, expected=f"{len(numbers)} numbers a line as in the first") from error
