"""The plan of `retarget convert`: names of outputs, and everything that is refused before any work."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from retarget import formats
from retarget.cli import plan
from retarget.core.errors import UnknownNameError, UsageError

VALUES = {"stem": "walk", "robot": "icub", "mapping": "limb_plane", "format": "mcap"}


def test_placeholders_are_filled_and_braces_can_be_written() -> None:
    assert plan.fill("out/{robot}/{stem}_{mapping}.{format}", VALUES) == "out/icub/walk_limb_plane.mcap"
    assert plan.fill("{{{stem}}}.mcap", VALUES) == "{walk}.mcap"


@pytest.mark.parametrize(
    ("template", "message"),
    [
        ("{stm}.mcap", "unknown placeholder 'stm'; did you mean stem?"),
        ("{xyz}.mcap", "unknown placeholder 'xyz'; choose from format, mapping, robot, stem"),
        ("{}.mcap", "unknown placeholder ''; choose from format, mapping, robot, stem"),
        ("{stem.mcap", "expected '}'"),
        ("stem}.mcap", "Single '}'"),
        ("{stem!r}.mcap", "takes no format or conversion"),
        ("{stem:>9}.mcap", "takes no format or conversion"),
    ],
)
def test_templates_that_mean_nothing_are_refused(template: str, message: str) -> None:
    with pytest.raises(UsageError, match="-o ") as caught:
        plan.fill(template, VALUES)
    assert message in str(caught.value)


@given(st.text(max_size=12))
def test_a_value_never_leaves_the_template_s_folder(value: str) -> None:
    try:
        path = plan.fill("out/{stem}/x.mcap", {**VALUES, "stem": value})
    except UsageError:
        return
    assert Path(os.path.normpath(path)).parts[0::2] == ("out", "x.mcap")


@pytest.mark.parametrize("value", ["..", ".", "", "a/b", "/etc", "a\0b"])
def test_values_that_would_leave_it_are_refused(value: str) -> None:
    with pytest.raises(UsageError, match="is no file name"):
        plan.fill("out/{stem}", {**VALUES, "stem": value})


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        ("a/walk.mvnx", "walk"),
        ("walk.mvnx.gz", "walk"),
        ("WALK.MVNX.GZ", "WALK"),
        ("walk.v2.mvnx", "walk.v2"),
        ("walk", "walk"),
        ("walk.dat", "walk"),
        (".mvnx", ".mvnx"),
        ("-", "stdin"),
    ],
)
def test_stems(path: str, expected: str) -> None:
    assert plan.stem(path, [".mvnx.gz", ".mvnx", ".gz"]) == expected


@pytest.mark.parametrize(
    ("template", "wanted", "expected"),
    [
        (None, None, "mcap"),
        ("-", None, "mcap"),
        (None, "npz", "npz"),
        ("-", "csv", "csv"),
        ("x.CSV", None, "csv"),
        ("x.h5", None, "hdf5"),
        ("{stem}.{format}", "npz", "npz"),
        ("x.dat", "hdf5", "hdf5"),
    ],
)
def test_the_output_format(template: str | None, wanted: str | None, expected: str) -> None:
    assert plan.output_format(template, wanted, formats.available()).name == expected


@pytest.mark.parametrize(
    ("template", "wanted", "message"),
    [
        ("x.dat", None, "no format has this suffix; expected one of .csv"),
        ("x.npz", "mcap", "is a name for npz, but --format is mcap"),
        ("-", "npz", "npz can't be written to a pipe; use -o FILE"),
        ("-", "hdf5", "hdf5 can't be written to a pipe; use -o FILE"),
    ],
)
def test_formats_that_contradict_the_output(template: str, wanted: str | None, message: str) -> None:
    with pytest.raises(UsageError) as caught:
        plan.output_format(template, wanted, formats.available())
    assert message in str(caught.value)


def clip(output: Path, *, overwrite: bool = False) -> plan.Clip:
    return plan.Clip("walk.mvnx", str(output), "icub", "icub", "mcap", overwrite=overwrite)


def test_folders_named_by_placeholders_are_made_the_others_must_exist(tmp_path: Path) -> None:
    plan.check_outputs([clip(tmp_path / "icub/deep/walk.mcap")], f"{tmp_path}/{{robot}}/deep/{{stem}}.mcap")
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(UsageError, match=f"{tmp_path}/out: no such folder; make it first"):
        plan.check_outputs([clip(tmp_path / "out/icub/walk.mcap")], f"{tmp_path}/out/{{robot}}/{{stem}}.mcap")
    with pytest.raises(UsageError, match="no such folder"):
        plan.check_outputs([clip(tmp_path / "out/walk.mcap")], f"{tmp_path}/out/{{stem}}.mcap")


def test_braces_in_a_folder_s_name(tmp_path: Path) -> None:
    (tmp_path / "{a}").mkdir()
    plan.check_outputs([clip(tmp_path / "{a}/icub/walk.mcap")], f"{tmp_path}/{{{{a}}}}/{{robot}}/{{stem}}.mcap")


def test_a_device_is_never_replaced(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="/dev/null: not a regular file"):
        plan.check_outputs([clip(Path("/dev/null"), overwrite=True)], "/dev/null")
    os.mkfifo(tmp_path / "pipe.mcap")
    with pytest.raises(UsageError, match="not a regular file"):
        plan.check_outputs([clip(tmp_path / "pipe.mcap", overwrite=True)], f"{tmp_path}/pipe.mcap")


def test_folders_that_can_t_be_written(tmp_path: Path) -> None:
    """Cases that hold for every user, the superuser too."""
    (tmp_path / "file").touch()
    with pytest.raises(UsageError, match="file: not a folder"):
        plan.check_outputs([clip(tmp_path / "file/walk.mcap")], f"{tmp_path}/file/walk.mcap")
    with pytest.raises(UsageError, match="/proc: can't write into this folder"):
        plan.check_outputs([clip(Path("/proc/walk.mcap"))], "/proc/walk.mcap")


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may write into any folder; the test above covers it")
def test_a_folder_without_permission(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    try:
        with pytest.raises(UsageError, match="can't write into this folder"):
            plan.check_outputs([clip(tmp_path / "walk.mcap")], f"{tmp_path}/walk.mcap")
    finally:
        tmp_path.chmod(0o700)


def test_the_probe_leaves_nothing(tmp_path: Path) -> None:
    plan.check_outputs([clip(tmp_path / "walk.mcap")], f"{tmp_path}/walk.mcap")
    assert list(tmp_path.iterdir()) == []


def test_unknown_placeholders_name_the_valid_ones() -> None:
    with pytest.raises(UnknownNameError) as caught:
        plan.fill("{robots}", VALUES)
    assert caught.value.choices == sorted(plan.PLACEHOLDERS)
