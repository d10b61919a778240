"""NPZ with the keys of BeyondMimic's motion files, so that its loader and those built on it take it as it is.

| key | shape | holds |
|---|---|---|
| `fps` | (1,) | mean frame rate in Hz, 0 for a single frame |
| `joint_pos`, `joint_vel` | (T, n) | rad, rad/s, in the order of `joint_names`: as written the robot's own, that of its URDF |
| `body_pos_w` | (T, B, 3) | m, world |
| `body_quat_w` | (T, B, 4) | world ← body, **wxyz** |
| `body_lin_vel_w`, `body_ang_vel_w` | (T, B, 3) | m/s, rad/s, world |

B is 1: the only body is the base link (`body_names[0]`). The keys below are ours and let everything come back bit for bit:
`schema`, `time` (T,) s, `joint_names`, `body_names`, `status`, `robot`, `provenance` (JSON), `robot_description`, `base_fixed` (a fixed
base is written as standing at the origin) and `twist_known` (2,) (an unknown linear or angular velocity is written as the difference of the
poses). Texts are arrays of NumPy's own string types (`robot_description`, the longest, UTF-8 bytes to be a quarter the size): arrays of
objects would need pickle, which is never written nor read.

A file of others without `joint_names` is only read with names that are given: BeyondMimic's `csv_to_npz.py` names none, and its columns
stand in Isaac Sim's order (breadth first), not in the URDF's. Of several bodies the first is the base, as in BeyondMimic.

Style `gmr`, which is read without being named, too: the arrays that GMR (General Motion Retargeting) pickles.

| key | shape | holds |
|---|---|---|
| `fps` | () | mean frame rate in Hz, 0 for a single frame |
| `root_pos` | (T, 3) | m, world; the origin with a fixed base |
| `root_rot` | (T, 4) | world ← base link, **xyzw**, as GMR's own scripts save it and its viewer expects it |
| `dof_pos` | (T, n) | rad, in the order of `joint_names` |
| `time`, `joint_names` | (T,), (n,) | ours: s, and the names, in the robot's own order (that of its URDF) |

It loses velocities, twist, status, names of robot and base frame, provenance and URDF; `np.load(path)` takes the place of `pickle.load`.
Some copies of GMR save wxyz, for which the order can be given in reading. Names, where `joint_names` or `dof_names` holds none, must be
given: URDF order. GMR's `local_body_pos` and `link_body_list`, which it leaves empty, are not written, not needed and not loaded.

An archive needs to seek: no pipes.
"""

from __future__ import annotations

import zipfile
from collections.abc import Iterable, Mapping
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray
from retarget.core import rotations
from retarget.core.errors import FormatError, nearest
from retarget.core.field_checks import LARGEST_ARRAY_BYTES
from retarget.core.types import Array, JointTrajectory
from retarget.formats import _headerless, _trajectory
from retarget.formats.base import Format, TrajectoryOptions

Arrays = Mapping[str, NDArray[Any]]
_XYZW = [1, 2, 3, 0]
MOST_OF_NOTHING = 1_000_000
"""Elements along an axis of an array that takes no bytes."""
NOT_NEEDED = ("local_body_pos", "link_body_list")
"""GMR's own extras, often None: an array of objects, which would need pickle."""


GMR = "gmr"
"""Style of `write_trajectory` with the keys of GMR's motion files."""


def write_trajectory(stream: BinaryIO, trajectory: JointTrajectory, style: str = "default") -> None:
    """Write `trajectory` as uncompressed NPZ, style "default" or "gmr". Raises `RetargetError` for provenance that JSON can't hold."""
    time = trajectory.time
    fixed = trajectory.base_position is None
    position, quaternion = _base(trajectory)
    if style == GMR:
        np.savez(
            stream,
            allow_pickle=False,
            fps=np.array(trajectory.rate_hz),
            root_pos=position,
            root_rot=quaternion[:, _XYZW],
            dof_pos=trajectory.position,
            time=time,
            joint_names=np.array(trajectory.joint_names, str),
        )
        return
    linear, angular = trajectory.base_linear_velocity, trajectory.base_angular_velocity
    known = [linear is not None, angular is not None]
    # Frames a hair apart may overflow here; what is not known is not read back either.
    with np.errstate(all="ignore"):
        linear = _trajectory.differentiate(time, position) if linear is None else linear
        angular = rotations.angular_velocity(time, quaternion) if angular is None else angular
    np.savez(
        stream,
        allow_pickle=False,
        fps=np.array([trajectory.rate_hz]),
        joint_pos=trajectory.position,
        joint_vel=trajectory.velocity,
        body_pos_w=position[:, None],
        body_quat_w=quaternion[:, None],
        body_lin_vel_w=linear[:, None],
        body_ang_vel_w=angular[:, None],
        schema=np.array(_trajectory.SCHEMA),
        time=time,
        joint_names=np.array(trajectory.joint_names, str),
        body_names=np.array([trajectory.base_frame]),
        status=trajectory.status,
        base_fixed=np.array(fixed),
        twist_known=np.array(known),
        robot=np.array(trajectory.robot),
        provenance=np.array(_trajectory.provenance_json(trajectory)),
        robot_description=np.array(trajectory.robot_description.encode()),
    )


def _base(trajectory: JointTrajectory) -> tuple[Array, Array]:
    """Pose of the base, (T, 3) m and (T, 4) wxyz; at the origin where it is fixed."""
    if trajectory.base_position is None or trajectory.base_orientation is None:
        return np.zeros((trajectory.frames, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (trajectory.frames, 1))
    return trajectory.base_position, trajectory.base_orientation


def read_trajectory(stream: BinaryIO, name: str, options: TrajectoryOptions | None = None) -> JointTrajectory:
    """The trajectory in an NPZ file with these keys. Without `time`, frame k is at k / fps.

    options: joint names, rate and quaternion order of files that don't have them.
    Raises `FormatError` for anything that is not such a file, among it arrays of pickled objects.
    """
    arrays, options = _load(stream, name), options or TrajectoryOptions()
    if "dof_pos" in arrays and "joint_pos" not in arrays:
        return _read_gmr(name, arrays, options)
    if "schema" in arrays:
        _trajectory.check_schema(name, _text(name, arrays, "schema", ""))
        options = TrajectoryOptions()  # ours says everything
    position = _array(name, arrays, "joint_pos", 2)
    names, warnings = _joint_names(name, arrays, ("joint_names",), position.shape[1], options)
    body_position, body_orientation = (_array(name, arrays, key, 3) for key in ("body_pos_w", "body_quat_w"))
    linear, angular = (_array(name, arrays, key, 3) for key in ("body_lin_vel_w", "body_ang_vel_w"))
    if body_orientation.shape[1:] < (1, 4) or body_orientation.shape[2] != 4 or 0 in body_position.shape:
        raise FormatError(
            name, f"found shape {body_orientation.shape}", place="body_quat_w", expected="(T, B, 4) with B ≥ 1"
        )
    fixed = bool(_array(name, arrays, "base_fixed", 0, kinds="b")) if "base_fixed" in arrays else False
    known = _array(name, arrays, "twist_known", 1, kinds="b") if "twist_known" in arrays else np.ones(2, bool)
    if known.shape != (2,) or 0 in linear.shape or 0 in angular.shape:
        raise FormatError(
            name, "found other shapes", place="twist_known, body_lin_vel_w", expected="(2,) and (T, B, 3)"
        )
    body_names = (
        _array(name, arrays, "body_names", 1, kinds="US") if "body_names" in arrays else np.array(["base_link"])
    )
    quaternion = body_orientation[:, 0][:, _headerless.TO_WXYZ[options.quaternion_order or "wxyz"]]
    return _trajectory.build(
        name,
        warnings,
        time=_time(name, arrays, len(position), options),
        joint_names=names,
        position=position,
        velocity=_array(name, arrays, "joint_vel", 2),
        base_position=None if fixed else body_position[:, 0],
        base_orientation=None if fixed else _trajectory.unit_quaternions(name, "body_quat_w", quaternion),
        base_linear_velocity=linear[:, 0] if known[0] else None,
        base_angular_velocity=angular[:, 0] if known[1] else None,
        status=_array(name, arrays, "status", 1) if "status" in arrays else np.zeros(0, np.int8),
        base_frame=_texts(name, "body_names", body_names[:1])[0] if len(body_names) else "base_link",
        robot=_text(name, arrays, "robot", ""),
        provenance=_trajectory.parse_provenance(name, _text(name, arrays, "provenance", "")),
        robot_description=_text(name, arrays, "robot_description", ""),
    )


def _read_gmr(name: str, arrays: Arrays, options: TrajectoryOptions) -> JointTrajectory:
    """The arrays of GMR's motion files."""
    position, root = _array(name, arrays, "dof_pos", 2), _array(name, arrays, "root_pos", 2)
    quaternion = _array(name, arrays, "root_rot", 2)
    if quaternion.shape[1] != 4:
        raise FormatError(name, f"found shape {quaternion.shape}", place="root_rot", expected="(T, 4)")
    names, warnings = _joint_names(name, arrays, ("joint_names", "dof_names"), position.shape[1], options)
    if options.quaternion_order is None:
        warnings.append("root_rot taken as x y z w, as GMR saves it")
    time = _time(name, arrays, len(position), options)
    if len(time) != len(position):
        raise FormatError(name, f"found shape {time.shape}", place="time", expected=f"({len(position)},), as dof_pos")
    return _trajectory.build(
        name,
        [*warnings, "velocity missing: differentiated from the positions"],
        time=time,
        joint_names=names,
        position=position,
        velocity=_trajectory.differentiate(time, position),
        base_position=root,
        base_orientation=_trajectory.unit_quaternions(
            name, "root_rot", quaternion[:, _headerless.TO_WXYZ[options.quaternion_order or "xyzw"]]
        ),
    )


def _joint_names(
    name: str, arrays: Arrays, keys: tuple[str, ...], joints: int, options: TrajectoryOptions
) -> tuple[tuple[str, ...], list[str]]:
    """(the file's joint names, else those that are given; warnings)."""
    key = next((key for key in keys if key in arrays), None)
    if key is not None:
        return _texts(name, key, _array(name, arrays, key, 1, kinds="US")), []
    if options.joint_names is None:
        found = ", ".join(nearest(keys[0], arrays)) or ", ".join(sorted(arrays))
        raise FormatError(
            name,
            f"no array '{keys[0]}'",
            expected=f"it beside those found: {found}; or the robot named, and the order of its joints in the file",
        )
    _headerless.check_count(name, joints, options.joint_names)
    return options.joint_names, ["the file names no joints: taken in the order given"]


def _load(stream: BinaryIO, name: str) -> dict[str, NDArray[Any]]:
    start = stream.tell()
    head = stream.read(4)
    stream.seek(start)
    if head[:2] != b"PK":
        raise FormatError(name, f"not a readable NPZ archive: starts with {head!r}", expected="a ZIP archive of arrays")
    try:
        with np.load(stream, allow_pickle=False) as archive:
            if not isinstance(archive, np.lib.npyio.NpzFile):
                raise ValueError("a single array")
            _check_size(archive.zip.infolist())
            arrays = {key: archive[key] for key in archive.files if key not in NOT_NEEDED}
            if other := [key for key, value in arrays.items() if not isinstance(value, np.ndarray)]:
                raise ValueError(f"member '{other[0]}' is no array")
            return arrays
    # Damage surfaces as whatever zipfile, zlib or NumPy's header parser trips over: a dozen unrelated classes.
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise FormatError(name, f"not a readable NPZ archive: {reason}") from error


def _check_size(members: Iterable[zipfile.ZipInfo]) -> None:
    """An archive of kilobytes can hold terabytes of zeros, and the header of an array can claim more than follows."""
    size = sum(member.file_size for member in members)
    if size > LARGEST_ARRAY_BYTES:
        raise ValueError(f"its arrays take {size >> 20} MB; expected at most {LARGEST_ARRAY_BYTES >> 20} MB")


def _array(name: str, arrays: Arrays, key: str, dimensions: int, *, kinds: str = "fiu") -> NDArray[Any]:
    """Array `key` with that many dimensions, its dtype one of `kinds`; `FormatError` otherwise."""
    if key not in arrays:
        near = ", ".join(nearest(key, arrays)) or ", ".join(sorted(arrays)) or "none"
        raise FormatError(name, f"no array '{key}'", expected=f"it beside those found: {near}")
    found = arrays[key]
    # Texts of no length and rows of no columns take no bytes: the archive's size says nothing of how many there are.
    endless = not found.nbytes and max(found.shape, default=0) > MOST_OF_NOTHING
    if found.ndim != dimensions or found.dtype.kind not in kinds or endless:
        problem = f"found {found.dtype} of shape {found.shape}"
        kind = {"fiu": "numbers", "US": "texts", "b": "truth values"}[kinds]
        expected = "no endless rows of nothing" if endless else f"{kind} with {dimensions} dimensions"
        raise FormatError(name, problem, place=key, expected=expected)
    return found


def _text(name: str, arrays: Arrays, key: str, default: str) -> str:
    return _texts(name, key, _array(name, arrays, key, 0, kinds="US").reshape(1))[0] if key in arrays else default


def _texts(name: str, key: str, values: NDArray[Any]) -> tuple[str, ...]:
    """NumPy texts as Python ones; bytes are taken as UTF-8."""
    try:
        # Code points above Unicode's last make tolist itself raise ValueError (of which UnicodeError is a child) or SystemError.
        return tuple(
            value.decode() if isinstance(value, bytes) else value.encode().decode() for value in values.tolist()
        )
    except (ValueError, SystemError) as error:
        raise FormatError(name, "not Unicode text", place=key) from error


def _time(name: str, arrays: Arrays, frames: int, options: TrajectoryOptions) -> Array:
    if "time" in arrays:
        return _array(name, arrays, "time", 1).astype(float)
    if "fps" not in arrays and options.rate_hz is not None:
        return np.asarray(np.arange(frames) / options.rate_hz)
    if "fps" not in arrays:
        raise FormatError(name, "neither 'time' nor 'fps'", expected="one of them")
    fps = np.asarray(arrays["fps"])
    if fps.size != 1 or fps.dtype.kind not in "fiu" or not (np.isfinite(fps).all() and fps.ravel()[0] > 0):
        raise FormatError(name, f"found {fps}", place="fps", expected="one positive number")
    with np.errstate(over="ignore"):  # times that are not finite are refused
        return np.asarray(np.arange(frames) / float(fps.ravel()[0]))


FORMAT = Format(
    name="npz",
    description="NumPy archive with the keys of BeyondMimic's motion files; style gmr: those of GMR's",
    suffixes=(".npz",),
    magic=(b"PK\x03\x04", b"PK\x05\x06"),
    read_trajectory=read_trajectory,
    write_trajectory=write_trajectory,
    styles=("default", GMR),
)
