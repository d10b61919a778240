"""CSV (RFC 4180, UTF-8, comma) whose header names every column and its unit.

| columns | hold |
|---|---|
| `time_s` | s |
| `base_x_m base_y_m base_z_m`, `base_qw base_qx base_qy base_qz` | pose world ← base link (**wxyz**, each named); absent with a fixed base |
| `base_vx_m_s base_vy_m_s base_vz_m_s`, `base_wx_rad_s base_wy_rad_s base_wz_rad_s` | its twist, world; absent when unknown |
| `q_<joint>_rad`, `dq_<joint>_rad_s` | one of each a joint; for a sliding joint read m for rad |
| `status` | 0 = solved, 1 = marked; last, so that a line cut short is noticed |

Joints stand in the robot's own order (that of its URDF); a reader takes columns in any. Times are on the recording's clock.
Numbers are the shortest decimals that give the same double back: values are kept bit for bit. CSV has no place for the robot's and the
base frame's name, the provenance and the URDF: these are lost. A file cut off exactly between two lines can't be told from a whole one.

Style `unitree`: no header, a line a frame of root position x y z in m, root quaternion **xyzw**, joint positions in rad, as in Unitree's
retargeted LAFAN1 motions and what GMR exports for BeyondMimic. It also loses times, names, velocities, twist and status: it is only read
when the style is named, with the rate and the joint names. A headerless file is never guessed at: its quaternion order can't be known.
"""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import chain
from typing import BinaryIO

import numpy as np
from retarget.core.errors import FormatError, nearest
from retarget.core.types import Array, JointTrajectory
from retarget.formats import _headerless, _trajectory
from retarget.formats.base import Format, TrajectoryOptions

UNITREE = "unitree"
_POSITION = ("base_x_m", "base_y_m", "base_z_m")
_ORIENTATION = ("base_qw", "base_qx", "base_qy", "base_qz")
_LINEAR = ("base_vx_m_s", "base_vy_m_s", "base_vz_m_s")
_ANGULAR = ("base_wx_rad_s", "base_wy_rad_s", "base_wz_rad_s")
_BLOCK = 1024


def write_trajectory(stream: BinaryIO, trajectory: JointTrajectory, style: str = "header") -> None:
    """Write `trajectory` as CSV, style "header" or "unitree", to a stream that need not seek."""
    if style == UNITREE:
        _write_lines(stream, _unitree(trajectory))
        return
    header = ["time_s"]
    columns: list[Array] = [trajectory.time[:, None]]
    for names, values in (
        (_POSITION, trajectory.base_position),
        (_ORIENTATION, trajectory.base_orientation),
        (_LINEAR, trajectory.base_linear_velocity),
        (_ANGULAR, trajectory.base_angular_velocity),
    ):
        if values is not None:
            header += names
            columns.append(values)
    header += [f"q_{joint}_rad" for joint in trajectory.joint_names]
    header += [f"dq_{joint}_rad_s" for joint in trajectory.joint_names]
    columns += [trajectory.position, trajectory.velocity]
    line = io.StringIO()
    # The module quotes a line feed or carriage return inside a name only where its line terminator has it too.
    csv.writer(line, lineterminator="\r\n").writerow([*header, "status"])
    stream.write(line.getvalue().removesuffix("\r\n").encode() + b"\n")
    _write_lines(stream, columns, trajectory.status.tolist())


def _unitree(trajectory: JointTrajectory) -> list[Array]:
    frames = trajectory.frames
    position, quaternion = trajectory.base_position, trajectory.base_orientation
    if position is None or quaternion is None:
        position, quaternion = np.zeros((frames, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (frames, 1))
    return [position, quaternion[:, [1, 2, 3, 0]], trajectory.position]


def _write_lines(stream: BinaryIO, columns: Sequence[Array], last: Sequence[int] | None = None) -> None:
    """The columns side by side, a line a row, in blocks so that the text of a long clip never stands in memory as a whole."""
    for start in range(0, len(columns[0]), _BLOCK):
        rows = np.hstack([column[start : start + _BLOCK] for column in columns]).tolist()
        lines = [",".join(map(repr, row)) for row in rows]
        if last is not None:
            lines = [f"{line},{value}" for line, value in zip(lines, last[start : start + _BLOCK], strict=True)]
        stream.write(("\n".join(lines) + "\n").encode())


def read_trajectory(stream: BinaryIO, name: str, options: TrajectoryOptions | None = None) -> JointTrajectory:
    """The trajectory in a CSV file with this header; columns may stand in any order. Style "unitree" of `options`: without one.

    Columns of unknown names are left out with a warning; a missing velocity is differentiated.
    Raises `FormatError` for a file without header, missing or repeated columns, and lines that don't hold a number a column.
    """
    if options is not None and options.style == UNITREE:
        return _headerless.read(stream, name, options)
    text = io.TextIOWrapper(stream, encoding="utf-8-sig", newline="")
    try:
        header, values = _parse(text, name)
    except UnicodeDecodeError as error:
        raise FormatError(name, f"not UTF-8 text: {error.reason}", place=f"byte {error.start}") from error
    finally:
        text.detach()
    table = _Table(name, header, values)
    time = table.required(["time_s"])[:, 0]
    joints = [
        column[len("q_") : -len("_rad")] for column in header if column.startswith("q_") and column.endswith("_rad")
    ]
    position = table.required([f"q_{joint}_rad" for joint in joints])
    velocity = table.optional([f"dq_{joint}_rad_s" for joint in joints])
    warnings = [] if velocity is not None else ["velocity missing: differentiated from the positions"]
    base_position, orientation = table.optional(_POSITION), table.optional(_ORIENTATION)
    linear, angular = table.optional(_LINEAR), table.optional(_ANGULAR)
    status = table.optional(["status"])
    if unused := table.unused():
        warnings.append(f"columns not used: {', '.join(unused)}")
    return _trajectory.build(
        name,
        warnings,
        time=time,
        joint_names=tuple(joints),
        position=position,
        velocity=_trajectory.differentiate(time, position) if velocity is None else velocity,
        base_position=base_position,
        base_orientation=None if orientation is None else _trajectory.unit_quaternions(name, "base_qw …", orientation),
        base_linear_velocity=linear,
        base_angular_velocity=angular,
        status=np.zeros(0, np.int8) if status is None else status[:, 0],
    )


def _parse(text: Iterable[str], name: str) -> tuple[list[str], Array]:
    """The column names, and the numbers (T, columns) below them."""
    lines = iter(text)
    try:
        header = next(csv.reader(lines), [])
    except csv.Error as error:
        raise FormatError(name, f"header is no CSV: {error}", place="line 1") from error
    if header and all(_is_number(cell) for cell in header):
        raise FormatError(
            name,
            "starts with numbers, without a header",
            place="line 1",
            expected="column names (time_s, q_<joint>_rad, base_qw …), or the style 'unitree' named: "
            "the quaternion order of a headerless file can't be known",
        )
    if "time_s" not in header:
        near = nearest("time_s", header)
        hint = f" (is it '{near[0]}'?)" if near else ""
        raise FormatError(
            name, "no column 'time_s'" + hint, place="line 1", expected="time_s, q_<joint>_rad, dq_<joint>_rad_s …"
        )
    if repeated := [column for column, count in Counter(header).items() if count > 1]:
        raise FormatError(name, f"column '{repeated[0]}' stands twice", place="line 1")
    # NumPy only warns when there is nothing to read.
    first = next((line for line in lines if line.strip()), None)
    if first is None:
        raise FormatError(name, "no frames below the header")
    try:
        values = np.loadtxt(chain([first], lines), delimiter=",", comments=None, ndmin=2)
    except UnicodeDecodeError:
        raise
    except ValueError as error:
        # NumPy counts rows below the header from 0 or 1, depending on the error: its own words stay, without its advice to programmers.
        problem = " ".join(str(error).partition(";")[0].split())
        raise FormatError(name, problem, place="below the header", expected=f"{len(header)} numbers a line") from error
    if values.shape[1] != len(header):
        raise FormatError(
            name,
            f"{values.shape[1]} numbers a line",
            place="below the header",
            expected=f"{len(header)} as in the header",
        )
    return header, values


def recognises(head: bytes) -> bool:
    """Whether a file that starts with `head` has this format's header: a `time_s` and joint angles or velocities."""
    first = head.decode("utf-8-sig", "replace").split("\n", 1)[0]
    cells = [cell.strip('"\r ') for cell in first.split(",")]
    joints = any(cell.startswith("q_") and cell.endswith("_rad") for cell in cells)
    return "time_s" in cells and (joints or any(cell.startswith("dq_") and cell.endswith("_rad_s") for cell in cells))


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


class _Table:
    """Columns by name, and which of them were asked for."""

    def __init__(self, name: str, header: Sequence[str], values: Array) -> None:
        self.name, self.values = name, values
        self.index = {column: i for i, column in enumerate(header)}
        self.used: set[str] = set()

    def required(self, columns: Sequence[str]) -> Array:
        """Those columns (T, k); `FormatError` for a missing one."""
        if missing := [column for column in columns if column not in self.index]:
            near = nearest(missing[0], [column for column in self.unused() if column not in columns])
            hint = f" (is it '{near[0]}'?)" if near else ""
            raise FormatError(self.name, f"no column '{missing[0]}'{hint}", place="line 1")
        self.used |= set(columns)
        return self.values[:, [self.index[column] for column in columns]]

    def optional(self, columns: Sequence[str]) -> Array | None:
        """As `required`, but None when all of them are missing."""
        return self.required(columns) if any(column in self.index for column in columns) else None

    def unused(self) -> list[str]:
        """Columns that nobody asked for, in their order."""
        return [column for column in self.index if column not in self.used]


FORMAT = Format(
    name="csv",
    description="CSV with a header naming each column and unit; style unitree: no header, quaternion xyzw",
    suffixes=(".csv",),
    recognises=recognises,
    read_trajectory=read_trajectory,
    write_trajectory=write_trajectory,
    pipeable=True,
    styles=("header", UNITREE),
    read_styles=("header", UNITREE),
)
