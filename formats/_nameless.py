"""Trajectories of others that don't name their joints: the reader is told the names, and what else the file doesn't say.

| file | holds | has to be told |
|---|---|---|
| CSV without a header, as Unitree and GMR write it | a line a frame: root position x y z in m, root quaternion **xyzw**, joint positions in rad | joints in order, frame rate |
| NPZ of BeyondMimic | `fps joint_pos joint_vel body_pos_w body_quat_w …`, the first body the root | joints in order |
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from retarget.core.errors import FormatError, InvalidDataError, UsageError
from retarget.core.types import JointTrajectory
from retarget.formats import _trajectory, npz
from retarget.formats._input import Input, opened

ROOT_COLUMNS = 7
DEFAULT_RATE_HZ = 30.0
"""Of Unitree's retargeted LAFAN1 and of GMR."""


def read_nameless_trajectory(
    source: Input,
    kind: Literal["csv", "npz"],
    joint_names: Sequence[str],
    *,
    rate_hz: float | None = None,
    name: str | None = None,
) -> JointTrajectory:
    """The trajectory in `source`, a headerless CSV or an NPZ without `joint_names`, whose joints are `joint_names` in this order.

    rate_hz: frames a second of the CSV, None = 30; an NPZ states its own. Velocities missing are differentiated.
    Raises `UsageError` for an NPZ with a rate, `FormatError` for content that doesn't fit.
    """
    with opened(source, name, kind, "read_trajectory") as (stream, shown, _):
        try:
            if kind == "npz":
                if rate_hz is not None:
                    raise UsageError(f"{shown}: states its own frame rate; leave out the given {rate_hz:g} Hz")
                return npz.read_trajectory(stream, shown, joint_names)
            return _read_csv(stream, shown, joint_names, DEFAULT_RATE_HZ if rate_hz is None else rate_hz)
        except InvalidDataError as error:
            raise FormatError(shown, str(error)) from error


def _read_csv(stream: object, name: str, joint_names: Sequence[str], rate_hz: float) -> JointTrajectory:
    wanted = ROOT_COLUMNS + len(joint_names)
    try:
        values = np.loadtxt(stream, delimiter=",", comments=None, ndmin=2, encoding="utf-8-sig")  # type: ignore[call-overload]  # any stream
    except ValueError as error:
        reason = " ".join(str(error).split())
        raise FormatError(name, reason, expected=f"{wanted} numbers a line, without a header") from error
    if values.shape[1] != wanted:
        raise FormatError(
            name,
            f"{values.shape[1]} numbers a line",
            expected=f"{wanted}: root position, root quaternion xyzw, {len(joint_names)} joints",
        )
    time = np.arange(len(values)) / rate_hz
    position = values[:, ROOT_COLUMNS:]
    quaternion = _trajectory.unit_quaternions(name, "columns 4 to 7", values[:, [6, 3, 4, 5]])
    return _trajectory.build(
        name,
        ["velocity missing: differentiated from the positions"],
        time=time,
        joint_names=tuple(joint_names),
        position=position,
        velocity=_trajectory.differentiate(time, position),
        base_position=values[:, :3],
        base_orientation=quaternion,
    )
