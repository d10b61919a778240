"""Robot motions of other tools: read when told what they don't say, never guessed at, pickle never opened."""

from __future__ import annotations

import io
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from retarget import formats
from retarget.core.errors import FormatError, RetargetError, UnknownNameError, UsageError
from retarget.core.types import JointTrajectory
from retarget.formats import TrajectoryOptions

from tests.formats.pickle_bomb import Bomb

Maker = Callable[..., JointTrajectory]
NAMES = ("left_hip", "left_knee")

# Two frames that turn 90° to the left: in w x y z (1, 0, 0, 0), then (√½, 0, 0, √½).
UNITREE = "0.1,0.2,0.79,0.0,0.0,0.0,1.0,0.5,-0.25\n1.1,1.2,0.8,0.0,0.0,0.70710678,0.70710678,0.6,-0.35\n"


def unitree(text: str = UNITREE, **options: Any) -> JointTrajectory:
    given = {"style": "unitree", "rate_hz": 30.0, "joint_names": NAMES} | options
    return formats.read_trajectory(io.BytesIO(text.encode()), "walk.csv", "csv", TrajectoryOptions(**given))


def npz(name: str = "walk.npz", options: TrajectoryOptions | None = None, **arrays: Any) -> JointTrajectory:
    out = io.BytesIO()
    np.savez(out, **{key: value for key, value in arrays.items() if value is not ...})
    out.seek(0)
    return formats.read_trajectory(out, name, "npz", options)


def gmr(options: TrajectoryOptions | None = None, **changes: Any) -> JointTrajectory:
    """The dictionary that GMR pickles, as `np.savez(path, **motion)` saves it: what its scripts leave at None is an array of objects."""
    arrays = {
        "fps": 30,
        "root_pos": np.array([[0.1, 0.2, 0.79], [1.1, 1.2, 0.8]]),
        "root_rot": np.array([[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.70710678, 0.70710678]]),
        "dof_pos": np.array([[0.5, -0.25], [0.6, -0.35]]),
        "local_body_pos": None,
        "link_body_list": None,
    } | changes
    return npz(options=options or TrajectoryOptions(joint_names=NAMES), **arrays)


def check_content(back: JointTrajectory) -> None:
    np.testing.assert_allclose(back.time, [0, 1 / 30], atol=1e-15)
    assert back.joint_names == NAMES
    np.testing.assert_array_equal(back.position, [[0.5, -0.25], [0.6, -0.35]])
    np.testing.assert_allclose(back.velocity, [[3.0, -3.0]] * 2, atol=1e-12)
    np.testing.assert_array_equal(back.base_position, [[0.1, 0.2, 0.79], [1.1, 1.2, 0.8]])
    np.testing.assert_allclose(back.base_orientation, [[1, 0, 0, 0], [np.sqrt(0.5), 0, 0, np.sqrt(0.5)]], atol=1e-8)
    assert back.base_linear_velocity is None
    assert "velocity missing: differentiated from the positions" in back.provenance["warnings"]


def test_unitree_rows() -> None:
    check_content(unitree())
    check_content(unitree("\ufeff" + UNITREE.replace("\n", "\r\n") + "\r\n"))


def test_gmr_arrays() -> None:
    back = gmr()
    check_content(back)
    assert "root_rot taken as x y z w, as GMR saves it" in back.provenance["warnings"]
    assert gmr(TrajectoryOptions(), dof_names=np.array(NAMES)).joint_names == NAMES


def test_order_of_the_quaternion_can_be_given() -> None:
    """Some copies of GMR save w x y z; a headerless file can hold anything."""
    wxyz = np.array([[1.0, 0.0, 0.0, 0.0], [0.70710678, 0.0, 0.0, 0.70710678]])
    check_content(gmr(TrajectoryOptions(joint_names=NAMES, quaternion_order="wxyz"), root_rot=wxyz))
    text = "0.1,0.2,0.79,1,0,0,0,0.5,-0.25\n1.1,1.2,0.8,0.70710678,0,0,0.70710678,0.6,-0.35\n"
    check_content(unitree(text, quaternion_order="wxyz"))


def test_beyond_mimic_without_names() -> None:
    """Columns are taken in the order of the names given; a name that the file has goes before."""
    arrays: dict[str, Any] = {
        "fps": [50],
        "joint_pos": np.array([[0.5, -0.25], [0.6, -0.35]], np.float32),
        "joint_vel": np.array([[1.0, 2.0], [3.0, 4.0]], np.float32),
        "body_pos_w": np.zeros((2, 3, 3), np.float32),
        "body_quat_w": np.tile(np.array([0.6, 0.0, 0.0, 0.8], np.float32), (2, 3, 1)),
        "body_lin_vel_w": np.zeros((2, 3, 3), np.float32),
        "body_ang_vel_w": np.zeros((2, 3, 3), np.float32),
    }
    back = npz(options=TrajectoryOptions(joint_names=("b", "a")), **arrays)
    assert back.joint_names == ("b", "a")
    np.testing.assert_array_equal(back.velocity, arrays["joint_vel"])
    np.testing.assert_allclose(back.base_orientation, [[0.6, 0, 0, 0.8]] * 2, atol=1e-7)
    assert back.provenance["warnings"] == ["the file names no joints: taken in the order given"]
    named = npz(options=TrajectoryOptions(joint_names=("b", "a")), joint_names=np.array(["c", "d"]), **arrays)
    assert named.joint_names == ("c", "d")
    with pytest.raises(FormatError, match=r"found 2 of joints; expected 3 joints, of the robot named"):
        npz(options=TrajectoryOptions(joint_names=("b", "a", "c")), **arrays)


def test_own_unitree_file_comes_back(make_trajectory: Maker) -> None:
    trajectory, out = make_trajectory(frames=40, joints=5, rate_hz=50.0), io.BytesIO()
    formats.write_trajectory_stream(out, trajectory, "csv", style="unitree")
    back = unitree(out.getvalue().decode(), rate_hz=50.0, joint_names=trajectory.joint_names)
    np.testing.assert_array_equal(back.position, trajectory.position)
    np.testing.assert_array_equal(back.base_position, trajectory.base_position)
    np.testing.assert_array_equal(back.base_orientation, trajectory.base_orientation)
    np.testing.assert_allclose(back.time, trajectory.time, atol=1e-15)


def test_our_own_files_need_none_of_the_options(make_trajectory: Maker, tmp_path: Path) -> None:
    trajectory = make_trajectory()
    options = TrajectoryOptions(rate_hz=1.0, joint_names=("x", "y", "z"), quaternion_order="xyzw")
    for suffix in ("npz", "csv", "h5", "mcap"):
        formats.write_trajectory(tmp_path / f"a.{suffix}", trajectory)
        back = formats.read_trajectory(tmp_path / f"a.{suffix}", options=options)
        assert back.joint_names == trajectory.joint_names
        np.testing.assert_allclose(back.time, trajectory.time, atol=1e-9)
        np.testing.assert_allclose(back.base_orientation, trajectory.base_orientation, atol=1e-15)


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"rate_hz": None}, UsageError, "don't say how many are a second; expected a rate in Hz"),
        ({"joint_names": None}, UsageError, "don't name the joints; expected the robot"),
        ({"joint_names": ("a",)}, FormatError, "found 7 columns of the root and 2 of joints; expected 1 joints"),
        ({"style": "unitre"}, UnknownNameError, "unknown csv style 'unitre'; did you mean unitree"),
        ({"style": None}, FormatError, "starts with numbers, without a header.*or the style 'unitree' named"),
        ({"text": ""}, FormatError, "empty file"),
        ({"text": "\n\n"}, FormatError, "no frames"),
        ({"text": "time_s,q_a_rad\n0,1\n"}, FormatError, "line 1: starts with 'time_s'; expected numbers"),
        ({"text": "1,2,3\n"}, FormatError, "line 1: 3 numbers a line; expected root x y z"),
        ({"text": UNITREE + "1,2,3\n"}, FormatError, "expected 9 numbers a line as in the first"),
        ({"text": UNITREE + "1,2,3,0,0,0,1,0.5,x\n"}, FormatError, "could not convert string 'x'"),
        ({"text": UNITREE.replace("-0.25", "nan")}, FormatError, r"position: found nan at \(0, 1\)"),
        ({"text": UNITREE.replace("0.0,1.0", "0.0,2.0")}, FormatError, "root quaternion, frame 0: found quaternion"),
        ({"quaternion_order": "zyxw"}, UsageError, "quaternion order: found 'zyxw', expected wxyz or xyzw"),
        ({"rate_hz": 0.0}, UsageError, "rate 0 Hz; expected a positive number"),
    ],
)
def test_rows_that_are_refused(changes: dict[str, Any], error: type[RetargetError], message: str) -> None:
    with pytest.raises(error, match=message) as caught:
        unitree(**changes)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"root_rot": ...}, "no array 'root_rot'"),
        ({"root_rot": np.zeros((2, 3))}, r"root_rot: found shape \(2, 3\); expected \(T, 4\)"),
        ({"root_pos": np.zeros((3, 3))}, r"base_position: found shape \(3, 3\)"),
        ({"fps": ...}, "neither 'time' nor 'fps'"),
        ({"time": np.arange(3.0)}, r"time: found shape \(3,\); expected \(2,\), as dof_pos"),
        ({"options": TrajectoryOptions()}, "no array 'joint_names'; .*or the robot named, and the order of its joints"),
        ({"dof_pos": np.array([[1.0, np.nan], [0.0, 0.0]])}, r"position: found nan at \(0, 1\)"),
        (
            {"dof_pos": np.array([[None, 1], [2, 3]], object)},
            "not a readable NPZ archive: Object arrays cannot be loaded",
        ),
    ],
)
def test_arrays_that_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(FormatError, match=message):
        gmr(**changes)
    assert gmr(TrajectoryOptions(joint_names=NAMES, rate_hz=30), fps=...).rate_hz == pytest.approx(30)


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
@pytest.mark.parametrize("name", ["motion.pkl", "motion.PICKLE", "motion.npz"])
def test_pickle_is_refused_unopened(tmp_path: Path, name: str, protocol: int) -> None:
    path = tmp_path / name
    path.write_bytes(pickle.dumps({"fps": 30, "root_pos": Bomb()}, protocol))
    with pytest.raises(FormatError, match=r"never is; expected the same arrays as \.npz|not a readable NPZ") as caught:
        formats.read_trajectory(path)
    assert str(caught.value).startswith(str(path))
    assert not Bomb.ran
