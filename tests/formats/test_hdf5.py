"""The HDF5 layout as any HDF5 user sees it, and files that are nearly of this layout."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from retarget import formats
from retarget.core.errors import FormatError
from retarget.core.types import JointTrajectory

Maker = Callable[..., JointTrajectory]


@pytest.fixture
def path(tmp_path: Path, make_trajectory: Maker) -> Path:
    formats.write_trajectory(tmp_path / "walk.hdf5", make_trajectory())
    return tmp_path / "walk.hdf5"


def test_layout(path: Path, make_trajectory: Maker) -> None:
    expected = make_trajectory()
    with h5py.File(path) as file:
        found = {
            "time": (expected.time, "s"),
            "joint/position": (expected.position, "rad"),
            "joint/velocity": (expected.velocity, "rad/s"),
            "base/position": (expected.base_position, "m"),
            "base/orientation": (expected.base_orientation, "1"),
            "base/linear_velocity": (expected.base_linear_velocity, "m/s"),
            "base/angular_velocity": (expected.base_angular_velocity, "rad/s"),
            "status": (expected.status, "1"),
        }
        datasets: list[str] = []
        file.visititems(lambda name, item: datasets.append(name) if isinstance(item, h5py.Dataset) else None)
        assert sorted(datasets) == sorted(found)
        for name, (values, unit) in found.items():
            np.testing.assert_array_equal(file[name][()], values)
            assert file[name].dtype == values.dtype
            assert file[name].attrs["unit"] == unit
        texts = {name: value.decode() for name, value in file.attrs.items() if isinstance(value, bytes)}
        assert texts["schema"] == "retarget.trajectory/1"
        assert texts["quat_order"] == "wxyz"
        assert (texts["robot"], texts["base_frame"]) == ("g1", "pelvis")
        assert texts["robot_description"] == expected.robot_description
        assert [name.decode() for name in file.attrs["joint_names"]] == list(expected.joint_names)


def test_absent_is_absent(tmp_path: Path, make_trajectory: Maker) -> None:
    path = tmp_path / "arm.h5"
    unknown = ("base_position", "base_orientation", "base_linear_velocity", "base_angular_velocity")
    formats.write_trajectory(path, make_trajectory(**dict.fromkeys(unknown)))
    with h5py.File(path) as file:
        assert "base" not in file


def test_long_description(tmp_path: Path, make_trajectory: Maker) -> None:
    """Attributes of the old HDF5 format end at 64 kB; a URDF is longer."""
    path = tmp_path / "walk.h5"
    formats.write_trajectory(path, make_trajectory(robot_description="<robot/>" * 100_000))
    assert formats.read_trajectory(path).robot_description == "<robot/>" * 100_000


def test_orientation_in_the_other_order_is_reordered_by_its_attribute(path: Path, make_trajectory: Maker) -> None:
    with h5py.File(path, "r+") as file:
        file["base/orientation"][:] = file["base/orientation"][()][:, [1, 2, 3, 0]]
        file.attrs["quat_order"] = "xyzw"
    np.testing.assert_array_equal(formats.read_trajectory(path).base_orientation, make_trajectory().base_orientation)


def test_missing_velocity_is_differentiated_and_said(path: Path) -> None:
    with h5py.File(path, "r+") as file:
        del file["joint/velocity"]
        file["joint/position"][:] = 4 * file["time"][:][:, None]
    back = formats.read_trajectory(path)
    np.testing.assert_allclose(back.velocity, 4, atol=1e-12)
    assert "velocity missing" in back.provenance["warnings"][0]


def _delete_attribute(name: str) -> Callable[[h5py.File], None]:
    return lambda file: file.attrs.__delitem__(name)


def _set_attribute(name: str, value: object) -> Callable[[h5py.File], None]:
    return lambda file: file.attrs.__setitem__(name, value)


def _delete(name: str) -> Callable[[h5py.File], None]:
    return lambda file: file.__delitem__(name)


def _put(name: str, value: object) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        del file[name]
        file[name] = value

    return change


def _group(file: h5py.File) -> None:
    del file["time"]
    file.create_group("time")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (_delete_attribute("quat_order"), r"attribute quat_order: no such attribute; expected text"),
        (_set_attribute("quat_order", "wzyx"), r"attribute quat_order: found 'wzyx'; expected 'wxyz' or 'xyzw'"),
        (_delete_attribute("schema"), r"attribute schema: no such attribute"),
        (_set_attribute("schema", "retarget.trajectory/9"), r"found schema 'retarget\.trajectory/9'"),
        (_set_attribute("robot", 3.5), r"attribute robot: found a float64; expected text"),
        (_set_attribute("robot", b"\xff"), r"attribute robot: not UTF-8"),
        (_delete_attribute("joint_names"), r"attribute joint_names: missing"),
        (_set_attribute("joint_names", [1, 2, 3]), r"attribute joint_names: missing or no list of text"),
        (_set_attribute("joint_names", ["a", "b"]), r"position: found shape \(6, 3\), expected \(6, 2\)"),
        (_set_attribute("source", "{"), r"provenance: not JSON"),
        (_set_attribute("source", "[]"), r"provenance: found a JSON list; expected an object"),
        (_delete("time"), r"/time: no such dataset"),
        (_group, r"/time: found <HDF5 group .*expected an array of numbers with 1 dimensions"),
        (_put("time", np.zeros((6, 1))), r"/time: found <HDF5 dataset .*expected an array of numbers with 1 dim"),
        (_put("time", ["a"] * 6), r"/time: found <HDF5 dataset"),
        (_put("time", np.zeros(6)), r"time.*frame 1\b"),
        (_put("joint/position", np.full((6, 3), np.nan)), r"position: found nan at \(0, 0\)"),
        (
            _put("base/orientation", np.full((6, 4), 3.0)),
            r"/base/orientation, frame 0: found quaternion \[3. 3. 3. 3.\]",
        ),
        (_put("base/orientation", np.zeros((6, 3))), r"/base/orientation: found shape \(6, 3\)"),
        (_put("status", np.zeros(5, np.int8)), r"status: found shape \(5,\), expected \(6,\)"),
    ],
)
def test_files_not_of_this_layout(path: Path, change: Callable[[h5py.File], None], message: str) -> None:
    with h5py.File(path, "r+") as file:
        change(file)
    with pytest.raises(FormatError, match=r"walk\.hdf5.*" + message) as caught:
        formats.read_trajectory(path)
    assert "\n" not in str(caught.value)


def test_truncated_anywhere(path: Path) -> None:
    data = path.read_bytes()
    for size in range(8, len(data), 37):
        with pytest.raises(FormatError, match=r"^walk: not a readable HDF5 file"):
            formats.read_trajectory(io.BytesIO(data[:size]), "walk", "hdf5")
