"""Defaults, a file over them, texts over that; every wrong name and value is refused."""

from __future__ import annotations

from pathlib import Path

import pytest
from retarget.core.errors import RetargetError, UnknownNameError, UsageError
from retarget.core.replay.thresholds import TABLE, Thresholds, modes_of


def test_every_default_has_a_reason_and_a_name_with_its_unit() -> None:
    suffixes = {
        "deg": "_deg", "mm": "_mm", "m": "_m", "m/s": "_m_s", "rad": "_rad", "rad/s": "_rad_s", "rad/s²": "_rad_s2",
        "rad/s³": "_rad_s3", "%": "_percent", "s": "_s", "Nm": "_nm", "W": "_w", "J": "_j",
    }  # fmt: skip
    for mode, rows in TABLE.items():
        assert len({row.name for row in rows}) == len(rows), mode
        for row in rows:
            assert len(row.why) > 20
            assert row.limit is None or row.limit >= 0
            assert row.name.endswith(suffixes[row.unit] if row.unit else row.name)


def test_check_is_judged_with_rounding_and_names_place_and_time() -> None:
    limits = Thresholds("kinematic").overridden(["joint_jump_max_rad=0.25"])
    check = limits.check("joint_jump_max_rad", 0.26, "there and back", where="knee", time_s=1.23456)
    assert (check.passed, check.limit, check.unit) == (False, 0.25, "rad")
    assert check.note == "knee at 1.235 s; there and back"
    assert limits.check("joint_jump_max_rad", 0.25 * (1 + 1e-12)).passed is True
    assert limits.check("joint_jump_max_rad", None, "a single frame").passed is None
    assert limits.check("jerk_max_rad_s3", 5.0).note == "reported only: no limit set"
    assert limits.check("marked_frames", 1).passed is False


def test_file_then_texts(tmp_path: Path) -> None:
    path = tmp_path / "limits.toml"
    path.write_text(
        'marked_frames = 3\n[kinematic]\nground_penetration_mm = 5\nacceleration_max_rad_s2 = "none"\n'
        "[fixed]\njoint_tracking_rmse_deg = 0.5\n"
    )
    kinematic, fixed = Thresholds.load(path, "kinematic"), Thresholds.load(path, "fixed")
    assert kinematic.limits["marked_frames"] == 3
    assert kinematic.limits["ground_penetration_mm"] == 5
    assert kinematic.limits["acceleration_max_rad_s2"] is None
    assert kinematic.limits["joint_jump_max_rad"] == Thresholds("kinematic").limits["joint_jump_max_rad"]
    assert fixed.limits["joint_tracking_rmse_deg"] == 0.5
    assert "marked_frames" not in fixed.limits
    over = kinematic.overridden(
        ["ground_penetration_mm = 7.5", "ground_penetration_mm=8", "acceleration_max_rad_s2=90", "marked_frames=None"]
    )
    assert [over.limits[n] for n in ("ground_penetration_mm", "acceleration_max_rad_s2", "marked_frames")] == [
        8,
        90,
        None,
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("ground_penetration=5", "unknown threshold 'ground_penetration'; did you mean ground_penetration_mm"),
        ("joint_tracking_rmse_deg=1", "belongs to mode fixed"),
        ("ground_penetration_mm", "expected NAME=VALUE"),
        ("ground_penetration_mm=", "found '', expected a number ≥ 0 or \"none\""),
        ("ground_penetration_mm=5mm", "found '5mm'"),
        ("ground_penetration_mm=-1", "found -1.0"),
        ("ground_penetration_mm=nan", "found nan"),
        ("ground_penetration_mm=inf", "found inf"),
    ],
)
def test_texts_that_are_refused(text: str, message: str) -> None:
    with pytest.raises(UsageError) as caught:
        Thresholds("kinematic").overridden([text])
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("ground_penetration = 5", "unknown threshold 'ground_penetration'; did you mean ground_penetration_mm"),
        ("[kinematics]\nx = 1", "unknown validation mode 'kinematics'; did you mean kinematic"),
        ("[fixed]\nground_penetration_mm = 1", "[fixed]: threshold 'ground_penetration_mm' belongs to mode kinematic"),
        (
            "[fixed]\njoint_tracking_rms_deg = 1",
            "[fixed]: unknown threshold 'joint_tracking_rms_deg'; did you mean joint_tracking_rmse_deg",
        ),
        ("marked_frames = true", "marked_frames: found True"),
        ("[kinematic]\nmarked_frames = [1]", "[kinematic] marked_frames: found [1]"),
        ("marked_frames = ", "no readable thresholds"),
    ],
)
def test_files_that_are_refused(tmp_path: Path, content: str, message: str) -> None:
    path = tmp_path / "limits.toml"
    path.write_text(content)
    with pytest.raises(RetargetError) as caught:
        Thresholds.load(path, "kinematic")
    assert message in str(caught.value)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)
    assert caught.value.exit_code == 2


def test_file_that_is_not_there_and_unknown_mode(tmp_path: Path) -> None:
    with pytest.raises(RetargetError, match="No such file"):
        Thresholds.load(tmp_path / "none.toml", "kinematic")
    with pytest.raises(UnknownNameError, match="did you mean fixed"):
        Thresholds("fixd")
    assert modes_of("marked_frames") == ("kinematic",)
    assert modes_of("nothing") == ()
