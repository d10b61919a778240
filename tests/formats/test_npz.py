"""NPZ with BeyondMimic's keys: as its loader sees it, and files of others."""

from __future__ import annotations

import io
import re
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from retarget import formats
from retarget.core.errors import FormatError
from retarget.core.types import JointTrajectory

from tests.formats.pickle_bomb import Bomb

Maker = Callable[..., JointTrajectory]


@pytest.fixture
def path(tmp_path: Path, make_trajectory: Maker) -> Path:
    formats.write_trajectory(tmp_path / "walk.npz", make_trajectory())
    return tmp_path / "walk.npz"


def load(path: Path) -> dict[str, Any]:
    with np.load(path, allow_pickle=False) as archive:
        return dict(archive)


def test_keys_and_shapes_of_beyond_mimic(path: Path, make_trajectory: Maker) -> None:
    expected, found = make_trajectory(), load(path)
    assert found["fps"].shape == (1,)
    np.testing.assert_allclose(found["fps"], 60, rtol=1e-12)
    np.testing.assert_array_equal(found["joint_pos"], expected.position)
    np.testing.assert_array_equal(found["joint_vel"], expected.velocity)
    for key, values in (
        ("body_pos_w", expected.base_position),
        ("body_quat_w", expected.base_orientation),
        ("body_lin_vel_w", expected.base_linear_velocity),
        ("body_ang_vel_w", expected.base_angular_velocity),
    ):
        assert values is not None
        assert found[key].shape == (6, 1, values.shape[1])
        np.testing.assert_array_equal(found[key][:, 0], values)
    assert found["joint_names"].tolist() == list(expected.joint_names)
    assert found["body_names"].tolist() == ["pelvis"]
    assert all(array.dtype != object for array in found.values())


def test_what_beyond_mimic_needs_is_there_even_when_it_is_not_known(tmp_path: Path, make_trajectory: Maker) -> None:
    """A base moving at 3 m/s along X and turning at 2 rad/s about Z, its twist not known; and a fixed one."""
    time = np.arange(6) / 60
    turn = np.stack([np.cos(time), 0 * time, 0 * time, np.sin(time)], axis=1)
    way = np.stack([3 * time, 0 * time, 0 * time + 1], axis=1)
    unknown: dict[str, Any] = {"base_linear_velocity": None, "base_angular_velocity": None}
    formats.write_trajectory(tmp_path / "a.npz", make_trajectory(base_position=way, base_orientation=turn, **unknown))
    found = load(tmp_path / "a.npz")
    np.testing.assert_allclose(found["body_lin_vel_w"][:, 0], [[3, 0, 0]] * 6, atol=1e-12)
    np.testing.assert_allclose(found["body_ang_vel_w"][:, 0], [[0, 0, 2]] * 6, atol=1e-12)
    assert formats.read_trajectory(tmp_path / "a.npz").base_linear_velocity is None
    assert formats.read_trajectory(tmp_path / "a.npz").base_angular_velocity is None
    formats.write_trajectory(tmp_path / "b.npz", make_trajectory(base_position=None, base_orientation=None))
    found = load(tmp_path / "b.npz")
    np.testing.assert_array_equal(found["body_pos_w"], np.zeros((6, 1, 3)))
    np.testing.assert_array_equal(found["body_quat_w"], [[[1, 0, 0, 0]]] * 6)
    assert formats.read_trajectory(tmp_path / "b.npz").base_position is None


def foreign(**changes: Any) -> io.BytesIO:
    """A file as BeyondMimic's converter writes it, with joint names beside: four bodies, whole fps, no time."""
    rng = np.random.default_rng(0)
    quaternion = np.tile([0.6, 0.0, 0.0, 0.8], (5, 4, 1))
    arrays: dict[str, Any] = {
        "fps": np.array([50]),
        "joint_pos": rng.normal(size=(5, 2)).astype(np.float32),
        "joint_vel": rng.normal(size=(5, 2)).astype(np.float32),
        "body_pos_w": rng.normal(size=(5, 4, 3)).astype(np.float32),
        "body_quat_w": quaternion.astype(np.float32),
        "body_lin_vel_w": rng.normal(size=(5, 4, 3)).astype(np.float32),
        "body_ang_vel_w": rng.normal(size=(5, 4, 3)).astype(np.float32),
        "joint_names": np.array(["a", "b"]),
    } | changes
    out = io.BytesIO()
    np.savez(out, **{key: value for key, value in arrays.items() if value is not None})
    out.seek(0)
    return out


def read(stream: io.BytesIO) -> JointTrajectory:
    return formats.read_trajectory(stream, "walk.npz", "npz")


def test_file_of_others_with_names() -> None:
    back = read(foreign())
    rng = np.random.default_rng(0)
    np.testing.assert_array_equal(back.position, rng.normal(size=(5, 2)).astype(np.float32))
    np.testing.assert_allclose(back.time, np.arange(5) / 50, rtol=0, atol=1e-15)
    assert back.joint_names == ("a", "b")
    # Single precision: made unit again in double.
    np.testing.assert_allclose(back.base_orientation, [[0.6, 0, 0, 0.8]] * 5, atol=1e-7)
    assert read(foreign(joint_names=np.array([b"a", "é".encode()]))).joint_names == ("a", "é")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"joint_names": None}, "no array 'joint_names'; expected it beside those found"),
        ({"joint_pos": None}, r"no array 'joint_pos'; .*joint_"),
        ({"joint_names": np.array(["a"])}, r"position: found shape \(5, 2\), expected \(5, 1\)"),
        ({"joint_names": np.array(["a", "a"])}, "joint_names.*twice"),
        ({"joint_names": np.array([b"\xff", b"b"])}, "joint_names: not Unicode text"),
        ({"joint_names": np.array([1, 2])}, "joint_names: found int64 of shape .*expected texts with 1 dimensions"),
        ({"joint_pos": np.zeros(5)}, r"joint_pos: found float64 of shape \(5,\); expected numbers with 2 dimensions"),
        ({"joint_pos": np.full((5, 2), np.nan)}, r"position: found nan at \(0, 0\)"),
        ({"joint_pos": np.zeros((5, 2), complex)}, "joint_pos: found complex128"),
        ({"body_quat_w": np.zeros((5, 4, 3))}, r"body_quat_w: found shape \(5, 4, 3\)"),
        ({"body_quat_w": np.zeros((5, 0, 4))}, r"body_quat_w: found shape \(5, 0, 4\)"),
        ({"body_quat_w": np.zeros((5, 4, 4))}, "body_quat_w, frame 0: found quaternion"),
        ({"body_pos_w": np.zeros((4, 4, 3))}, r"base_position: found shape \(4, 3\)"),
        ({"fps": None}, "neither 'time' nor 'fps'"),
        ({"fps": np.array([0])}, r"fps: found \[0\]; expected one positive number"),
        ({"fps": np.array([50, 50])}, "fps: found"),
        ({"fps": np.array(5e-324)}, "time: found inf"),
        ({"fps": np.array("fast")}, "fps: found fast"),
        ({"twist_known": np.array([True])}, "twist_known"),
        ({"base_fixed": np.array(2.0)}, "base_fixed: found float64.*expected truth values"),
        ({"status": np.zeros(3, np.int8)}, r"status: found shape \(3,\)"),
        ({"schema": np.array("retarget.trajectory/7")}, "found schema"),
        ({"provenance": np.array("{")}, "provenance: not JSON"),
    ],
)
def test_files_not_of_these_keys(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(FormatError, match=message) as caught:
        read(foreign(**changes))
    assert str(caught.value).startswith("walk.npz")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("key", "descr", "shape", "found"),
    [
        ("joint_names", "<U0", (2**62,), "<U0"),
        ("joint_pos", "<f8", (2**59, 0), "float64"),
        ("joint_pos", "<f8", (0, 2**59), "float64"),
    ],
)
def test_what_takes_no_bytes_is_not_counted(key: str, descr: str, shape: tuple[int, ...], found: str) -> None:
    """A small archive may claim any number of texts without length and of rows without columns."""
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": descr, "fortran_order": False, "shape": shape})
    stream = foreign(**{key: None})
    with zipfile.ZipFile(stream, "a") as archive:
        archive.writestr(f"{key}.npy", header.getvalue())
    stream.seek(0)
    with pytest.raises(
        FormatError, match=rf"{key}: found {found} of shape {re.escape(str(shape))}; expected no endless"
    ):
        read(stream)


def test_pickle_is_never_run() -> None:
    with pytest.raises(FormatError, match="Object arrays cannot be loaded"):
        read(foreign(joint_names=np.array([Bomb(), Bomb()], object)))
    assert not Bomb.ran


@pytest.mark.parametrize("content", [b"PK\x03\x04", b"PK\x05\x06" + bytes(18), b"no zip at all", b"\x93NUMPY\x01\x00"])
def test_what_is_no_archive(content: bytes) -> None:
    with pytest.raises(FormatError, match=r"^walk\.npz: "):
        read(io.BytesIO(content))


def test_bare_npy_array() -> None:
    out = io.BytesIO()
    np.save(out, np.zeros(3))
    out.seek(0)
    with pytest.raises(FormatError, match="not a readable NPZ archive"):
        read(out)


def test_truncated_anywhere(path: Path) -> None:
    data = path.read_bytes()
    for size in range(1, len(data), 11):
        with pytest.raises(FormatError, match="not a readable NPZ archive"):
            read(io.BytesIO(data[:size]))


def test_gmr_style_holds_what_its_viewer_takes(make_trajectory: Maker, tmp_path: Path) -> None:
    """Keys, shapes and the order x y z w of the dictionary that GMR pickles; names and times beside it."""
    trajectory = make_trajectory(frames=40, joints=5, rate_hz=50.0)
    formats.write_trajectory(tmp_path / "walk.npz", trajectory, style="gmr")
    with np.load(tmp_path / "walk.npz", allow_pickle=False) as motion:
        assert set(motion.files) == {"fps", "root_pos", "root_rot", "dof_pos", "time", "joint_names"}
        assert float(motion["fps"]) == pytest.approx(50.0)
        np.testing.assert_array_equal(motion["root_pos"], trajectory.base_position)
        np.testing.assert_array_equal(motion["root_rot"][:, 3], trajectory.base_orientation[:, 0])
        np.testing.assert_array_equal(motion["root_rot"][:, :3], trajectory.base_orientation[:, 1:])
        np.testing.assert_array_equal(motion["dof_pos"], trajectory.position)
        assert tuple(motion["joint_names"]) == trajectory.joint_names
