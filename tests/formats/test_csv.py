"""CSV: every column named with its unit, every digit kept, nothing guessed."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from retarget import formats
from retarget.core.errors import FormatError
from retarget.core.types import JointTrajectory

Maker = Callable[..., JointTrajectory]

SMALL = JointTrajectory(
    time=np.array([0.0, 0.1]),
    joint_names=("knee", "hip, left"),
    position=np.array([[0.1, -1e-300], [1 / 3, 2.0]]),
    velocity=np.array([[1.5, 0.0], [-0.0, 1e22]]),
    base_position=np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]),
    base_orientation=np.array([[1.0, 0.0, 0.0, 0.0], [0.8, 0.0, 0.6, 0.0]]),
    base_angular_velocity=np.array([[7.0, 8.0, 9.0], [0.0, 0.0, 0.25]]),
    status=np.array([0, 1], np.int8),
)
HEADER = (
    "time_s,base_x_m,base_y_m,base_z_m,base_qw,base_qx,base_qy,base_qz,base_wx_rad_s,base_wy_rad_s,base_wz_rad_s,"
    'q_knee_rad,"q_hip, left_rad",dq_knee_rad_s,"dq_hip, left_rad_s",status\n'
)
LINES = (
    "0.0,1.0,2.0,3.0,1.0,0.0,0.0,0.0,7.0,8.0,9.0,0.1,-1e-300,1.5,0.0,0\n"
    "0.1,4.0,5.0,6.0,0.8,0.0,0.6,0.0,0.0,0.0,0.25,0.3333333333333333,2.0,-0.0,1e+22,1\n"
)


def write(trajectory: JointTrajectory, style: str | None = None) -> str:
    out = io.BytesIO()
    formats.write_trajectory_stream(out, trajectory, "csv", style=style)
    return out.getvalue().decode()


def read(text: str | bytes) -> JointTrajectory:
    data = text if isinstance(text, bytes) else text.encode()
    return formats.read_trajectory(io.BytesIO(data), "walk.csv", "csv")


def test_exact_text() -> None:
    assert write(SMALL) == HEADER + LINES


def test_unitree_style_is_position_then_xyzw_then_joints() -> None:
    assert write(SMALL, "unitree") == (
        "1.0,2.0,3.0,0.0,0.0,0.0,1.0,0.1,-1e-300\n4.0,5.0,6.0,0.0,0.6,0.0,0.8,0.3333333333333333,2.0\n"
    )
    fixed = replace(SMALL, base_position=None, base_orientation=None)
    assert write(fixed, "unitree").startswith("0.0,0.0,0.0,0.0,0.0,0.0,1.0,0.1,")


def test_python_csv_reads_the_same_numbers(make_trajectory: Maker) -> None:
    trajectory = make_trajectory(frames=3000, joints=7)
    rows = list(csv.DictReader(io.StringIO(write(trajectory))))
    assert len(rows) == 3000
    assert [float(row["time_s"]) for row in rows] == trajectory.time.tolist()
    assert [float(row["q_left_joint_4_rad"]) for row in rows] == trajectory.position[:, 4].tolist()
    assert [float(row["dq_left_joint_6_rad_s"]) for row in rows] == trajectory.velocity[:, 6].tolist()
    assert trajectory.base_orientation is not None
    assert trajectory.base_linear_velocity is not None
    assert [float(row["base_qy"]) for row in rows] == trajectory.base_orientation[:, 2].tolist()
    assert [float(row["base_vz_m_s"]) for row in rows] == trajectory.base_linear_velocity[:, 2].tolist()
    assert [int(row["status"]) for row in rows] == trajectory.status.tolist()


def test_columns_may_stand_in_any_order_and_lines_end_in_any_way() -> None:
    table = list(csv.reader(io.StringIO(HEADER + LINES)))
    for end in ("\n", "\r\n"):
        out = io.StringIO()
        csv.writer(out, lineterminator=end).writerows(row[::-1] for row in table)
        back = read("\ufeff" + out.getvalue().removesuffix(end))
        assert back.joint_names == ("hip, left", "knee")
        np.testing.assert_array_equal(back.position, SMALL.position[:, ::-1])
        np.testing.assert_array_equal(back.base_orientation, SMALL.base_orientation)
        np.testing.assert_array_equal(back.status, SMALL.status)


def test_quaternions_of_others_are_made_unit_and_continuous() -> None:
    header = "time_s,base_x_m,base_y_m,base_z_m,base_qw,base_qx,base_qy,base_qz\n"
    back = read(header + "0,0,0,0,0.6,0,0,0.8\n1,0,0,0,-0.6001,0,0,-0.8\n")
    assert back.base_orientation is not None
    expected = np.array([[0.6, 0, 0, 0.8], np.array([0.6001, 0, 0, 0.8]) / np.hypot(0.6001, 0.8)])
    np.testing.assert_allclose(back.base_orientation, expected, rtol=0, atol=1e-15)


def test_columns_of_others_are_left_out_and_said() -> None:
    back = read("time_s,q_a_rad,dq_a_rad_s,tau_a_Nm\n0,1,2,3\n1,2,3,4\n")
    np.testing.assert_array_equal(back.position, [[1], [2]])
    assert back.provenance["warnings"] == ["columns not used: tau_a_Nm"]


def test_velocity_of_a_joint_that_has_no_position_is_a_column_of_others() -> None:
    back = read("time_s,q_a_rad,dq_b_rad_s\n0,1,9\n1,3,9\n")
    np.testing.assert_allclose(back.velocity, 2)
    assert "columns not used: dq_b_rad_s" in back.provenance["warnings"]


def test_missing_velocity_is_differentiated_and_said() -> None:
    back = read("time_s,q_a_rad\n0,1\n0.5,3\n1,5\n")
    np.testing.assert_allclose(back.velocity, 4)
    assert "velocity missing" in back.provenance["warnings"][0]


@pytest.mark.parametrize("style_line", ["1,2,3,0,0,0,1,0.1\n", "1e-3,-2.5\n"])
def test_headerless_file_is_refused_for_its_quaternion_order(style_line: str) -> None:
    with pytest.raises(
        FormatError, match=r"starts with numbers, without a header.*quaternion order of a headerless file"
    ):
        read(style_line * 3)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "empty file"),
        ("\n", "no column 'time_s'"),
        ("time,q_a_rad\n0,1\n", r"no column 'time_s' \(is it 'time'\?\)"),
        ("time_s,q_a_rad,q_a_rad\n0,1,1\n", "column 'q_a_rad' stands twice"),
        (f"time_s,{','.join(f'q_{i}_rad' for i in range(100_000))},q_7_rad\n0\n", "column 'q_7_rad' stands twice"),
        ("time_s,q_a_rad\n", "no frames below the header"),
        ("time_s,q_a_rad\n\n\n", "no frames below the header"),
        ("time_s,q_a_rad,q_b_rad,dq_a_rad_s\n0,1,2,3\n", "no column 'dq_b_rad_s'"),
        ("time_s,base_x_m,base_y_m\n0,1,2\n", "no column 'base_z_m'"),
        ("time_s,base_qw,base_qx,base_qy,base_qs\n0,1,0,0,0\n", r"no column 'base_qz' \(is it 'base_qs'\?\)"),
        ("time_s,base_x_m,base_y_m,base_z_m\n0,1,2,3\n", "base_orientation.*base_position"),
        ("time_s,q_a_rad\n0,1,2\n", "3 numbers a line; expected 2 as in the header"),
        ("time_s,q_a_rad\n0,1\n0.1\n", "below the header: .*column.*expected 2 numbers a line"),
        ("time_s,q_a_rad\n0,fast\n", "could not convert string 'fast'"),
        ("time_s,q_a_rad\n0,\n", "could not convert string ''"),
        ("time_s,q_a_rad\n0,nan\n", r"position: found nan at \(0, 0\)"),
        ("time_s,q_a_rad\n0,inf\n", r"position: found inf"),
        ("time_s,q_a_rad\n1,0\n0,0\n", r"time.*frame 1\b.* 0 s"),
        ("time_s,q_a_rad,status\n0,0,0\n1,0,0.5\n", r"status: found 0\.5 at \(1,\)"),
        ("time_s,q_a_rad,status\n0,0,300\n", r"status: found 300"),
        (b"time_s,q_a_rad\n0,\xff\n", "not UTF-8"),
        (b"\xff\xfet\0i\0m\0e\0", "not UTF-8"),
    ],
)
def test_what_is_no_such_table(text: str | bytes, message: str) -> None:
    with pytest.raises(FormatError, match=message) as caught:
        read(text)
    assert str(caught.value).startswith("walk.csv")
    assert "\n" not in str(caught.value)


def test_line_cut_short_is_noticed_at_any_byte(make_trajectory: Maker) -> None:
    """Only a cut right behind a line, or behind all but its line end, can't be told from a whole file."""
    data = write(make_trajectory(frames=3)).encode()
    body = data.index(b"\n") + 1
    ends = {i for i in range(body + 1, len(data) + 1) if data[i - 1 : i] == b"\n"}
    for size in range(1, len(data)):
        if size in ends or size + 1 in ends:
            assert read(data[:size]).frames < 4
        else:
            with pytest.raises(FormatError):
                read(data[:size])


def test_file_and_stream_hold_the_same(tmp_path: Path, make_trajectory: Maker) -> None:
    trajectory = make_trajectory()
    formats.write_trajectory(tmp_path / "walk.csv", trajectory, style="unitree")
    assert (tmp_path / "walk.csv").read_text() == write(trajectory, "unitree")
