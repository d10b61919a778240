"""HDF5, layout `retarget.trajectory/1`.

| dataset | shape | holds |
|---|---|---|
| `/time` | (T,) | s |
| `/joint/position`, `/joint/velocity` | (T, n) | rad and rad/s (m and m/s for sliding joints) |
| `/base/position` | (T, 3) | m, world; absent with a fixed base |
| `/base/orientation` | (T, 4) | world ← base link, in the order that attribute `quat_order` says: **wxyz** as written; absent with a fixed base |
| `/base/linear_velocity`, `/base/angular_velocity` | (T, 3) | m/s and rad/s, world; absent when unknown |
| `/status` | (T,) int8 | 0 = solved, 1 = marked |

Attributes of the root: `schema`, `joint_names`, `quat_order`, `robot`, `base_frame`, `source` (provenance as JSON), `robot_description`.
Columns of joints stand in the order of `joint_names`, as written the robot's own (that of its URDF). Times are on the recording's clock.
Files of other programs are read, too: of the older format without checksums, with texts of variable length, as h5py writes them by default.
Damage in these can make the HDF5 library hang or crash, so they are first rewritten in a process of its own that may fail.
Every array carries its unit in attribute `unit`. Everything comes back bit for bit. HDF5 needs a file that can seek: no pipes.
"""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray
from retarget.core.errors import FormatError
from retarget.core.field_checks import LARGEST_ARRAY_BYTES
from retarget.core.types import JointTrajectory
from retarget.formats import _hdf5_rewrite, _trajectory
from retarget.formats.base import Format, TrajectoryOptions

if TYPE_CHECKING:
    import h5py

_SUPERBLOCK = 9
"""Bytes up to and with the version of the superblock."""
MAGIC = b"\x89HDF\r\n\x1a\n"
_BASE = {
    "base_position": ("base/position", "m"),
    "base_orientation": ("base/orientation", "1"),
    "base_linear_velocity": ("base/linear_velocity", "m/s"),
    "base_angular_velocity": ("base/angular_velocity", "rad/s"),
}


def write_trajectory(stream: BinaryIO, trajectory: JointTrajectory, _style: str = "default") -> None:
    """Write `trajectory` as HDF5. Raises `RetargetError` for provenance that JSON can't hold."""
    import h5py

    attributes = {
        "schema": _trajectory.SCHEMA,
        "quat_order": "wxyz",
        "robot": trajectory.robot,
        "base_frame": trajectory.base_frame,
        "source": _trajectory.provenance_json(trajectory),
        "robot_description": trajectory.robot_description,
    }
    # Built in memory: an error of the file system inside the HDF5 library would not surface as one.
    image = io.BytesIO()
    # The format of HDF5 1.8 (2008) on: its metadata carry checksums, and attributes may be longer than 64 kB.
    with h5py.File(image, "w", libver=("v108", "v110")) as file:
        for name, value in attributes.items():
            _put_texts(file, name, np.array(value.encode()))
        _put_texts(file, "joint_names", np.array([joint.encode() for joint in trajectory.joint_names], np.bytes_))
        _put(file, "time", trajectory.time, "s")
        _put(file, "joint/position", trajectory.position, "rad")
        _put(file, "joint/velocity", trajectory.velocity, "rad/s")
        for field, (path, unit) in _BASE.items():
            if (values := getattr(trajectory, field)) is not None:
                _put(file, path, values, unit)
        _put(file, "status", trajectory.status, "1")
    stream.write(image.getbuffer())


def _put_texts(file: h5py.File, name: str, values: NDArray[np.bytes_]) -> None:
    import h5py

    # Of fixed length: those of variable length lie in a heap without checksums, where damage makes the HDF5 library hang.
    file.attrs.create(name, values, dtype=h5py.string_dtype("utf-8", max(1, values.dtype.itemsize)))


def _put(file: h5py.File, path: str, values: NDArray[Any], unit: str) -> None:
    file.create_dataset(path, data=values).attrs["unit"] = unit


def read_trajectory(stream: BinaryIO, name: str, _options: TrajectoryOptions | None = None) -> JointTrajectory:
    """The trajectory in an HDF5 file of this layout.

    A missing velocity is differentiated, a missing status is 0. Raises `FormatError` for anything that is not such a file, and for
    base orientations without `quat_order`: the order is never guessed.
    """
    import h5py

    head = stream.read(_SUPERBLOCK)
    stream.seek(-len(head), io.SEEK_CUR)
    try:
        file = h5py.File(_hdf5_rewrite.rewritten(stream, name) if _is_old(head) else stream, "r")
        if not _is_old(head) and _has_loose_texts(file):
            file.close()
            stream.seek(0)
            file = h5py.File(_hdf5_rewrite.rewritten(stream, name), "r")
    except FormatError:
        raise
    # The library reports damage as OSError, RuntimeError, ValueError, KeyError … depending on where it stumbles.
    except Exception as error:
        raise FormatError(name, f"not a readable HDF5 file: {_one_line(error)}") from error
    with file:
        reader = _Reader(file, name)
        _trajectory.check_schema(name, reader.text("schema"))
        names = reader.names()
        time = reader.array("time", 1)
        position = reader.array("joint/position", 2)
        velocity = reader.optional("joint/velocity", 2)
        warnings = [] if velocity is not None else ["velocity missing: differentiated from the positions"]
        status = reader.optional("status", 1)
        base = {field: reader.optional(path, 2) for field, (path, _) in _BASE.items()}
        if (orientation := base["base_orientation"]) is not None:
            base["base_orientation"] = _wxyz(name, orientation, reader.text("quat_order"))
        return _trajectory.build(
            name,
            warnings,
            time=time,
            joint_names=names,
            position=position,
            velocity=_trajectory.differentiate(time, position) if velocity is None else velocity,
            **base,
            status=np.zeros(0, np.int8) if status is None else status,
            base_frame=reader.text("base_frame", "base_link"),
            robot=reader.text("robot", ""),
            provenance=_trajectory.parse_provenance(name, reader.text("source", "")),
            robot_description=reader.text("robot_description", ""),
        )


def _is_old(head: bytes) -> bool:
    """Whether a file that starts with `head` has metadata without checksums: a superblock before version 2."""
    return len(head) == _SUPERBLOCK and head[-1] < 2


def _has_loose_texts(file: h5py.File) -> bool:
    """Whether some text of the root has variable length: these lie in a heap without checksums."""
    from h5py import h5a, h5t

    kinds = [h5a.open(file.id, index=index).get_type() for index in range(h5a.get_num_attrs(file.id))]
    return any(kind.get_class() == h5t.STRING and kind.is_variable_str() for kind in kinds)


class _Reader:
    """Datasets and attributes of one file, each failure a `FormatError` naming them."""

    def __init__(self, file: h5py.File, name: str) -> None:
        self.file, self.name = file, name

    def text(self, attribute: str, default: str | None = None) -> str:
        """A text attribute of the root; `default` where it is missing, if there is one."""
        value = self._attribute(attribute)
        if value is None and default is not None:
            return default
        if not isinstance(value, str | bytes):
            found = "no such attribute" if value is None else f"found a {type(value).__name__}"
            raise FormatError(self.name, found, place=f"attribute {attribute}", expected="text")
        return self._decoded(attribute, value)

    def names(self) -> tuple[str, ...]:
        """The joint names."""
        value = self._attribute("joint_names")
        if not isinstance(value, np.ndarray) or not all(isinstance(item, str | bytes) for item in value.ravel()):
            raise FormatError(
                self.name, "missing or no list of text", place="attribute joint_names", expected="one name a joint"
            )
        return tuple(self._decoded("joint_names", item) for item in value.ravel())

    def array(self, path: str, dimensions: int) -> NDArray[Any]:
        """A numeric dataset with that many dimensions."""
        values = self.optional(path, dimensions)
        if values is None:
            raise FormatError(
                self.name, "no such dataset", place=f"/{path}", expected=f"an array of {dimensions} dimensions"
            )
        return values

    def optional(self, path: str, dimensions: int) -> NDArray[Any] | None:
        """As `array`; None where there is no such dataset."""
        import h5py

        try:
            if path not in self.file:
                return None
            dataset = self.file[path]
            numeric = isinstance(dataset, h5py.Dataset) and dataset.dtype.kind in "fiu"
            fits = numeric and dataset.ndim == dimensions
            # A dataset without a byte behind it may claim any shape.
            size = dataset.size * dataset.dtype.itemsize if fits else 0
            values = dataset[()] if fits and size <= LARGEST_ARRAY_BYTES else None
        except Exception as error:
            raise FormatError(self.name, f"can't be read: {_one_line(error)}", place=f"/{path}") from error
        if size > LARGEST_ARRAY_BYTES:
            expected = f"at most {LARGEST_ARRAY_BYTES >> 20} MB"
            raise FormatError(self.name, f"an array of {size >> 20} MB", place=f"/{path}", expected=expected)
        if values is None:
            expected = f"an array of numbers with {dimensions} dimensions"
            raise FormatError(self.name, f"found {_one_line(dataset)}", place=f"/{path}", expected=expected)
        return np.asarray(values)

    def _decoded(self, attribute: str, value: str | bytes) -> str:
        try:
            # h5py gives undecodable text of variable length as a str with lone surrogates.
            return value.decode() if isinstance(value, bytes) else value.encode().decode()
        except UnicodeError as error:
            raise FormatError(self.name, "not UTF-8", place=f"attribute {attribute}") from error

    def _attribute(self, attribute: str) -> Any:
        try:
            return self.file.attrs.get(attribute)
        except Exception as error:
            raise FormatError(
                self.name, f"can't be read: {_one_line(error)}", place=f"attribute {attribute}"
            ) from error


def _wxyz(name: str, quaternion: NDArray[Any], order: str) -> NDArray[Any]:
    columns = {"wxyz": [0, 1, 2, 3], "xyzw": [3, 0, 1, 2]}.get(order)
    if columns is None:
        raise FormatError(name, f"found '{order}'", place="attribute quat_order", expected="'wxyz' or 'xyzw'")
    if quaternion.shape[1] != 4:
        raise FormatError(name, f"found shape {quaternion.shape}", place="/base/orientation", expected="(T, 4)")
    return _trajectory.unit_quaternions(name, "/base/orientation", quaternion[:, columns])


def _one_line(value: object) -> str:
    return " ".join(str(value).split()) or type(value).__name__


FORMAT = Format(
    name="hdf5",
    description="HDF5: arrays under /joint and /base with units and names as attributes",
    suffixes=(".hdf5", ".h5"),
    magic=(MAGIC,),
    read_trajectory=read_trajectory,
    write_trajectory=write_trajectory,
)
