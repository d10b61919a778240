"""Mesh names of a URDF → files, and what must not be read."""

from __future__ import annotations

from pathlib import Path

import pytest
from retarget.core.profile import ModelSource, RobotProfile
from retarget.core.replay.mesh_paths import MISSING, OUTSIDE, MeshPaths


@pytest.fixture
def paths(tmp_path: Path) -> MeshPaths:
    """tmp_path/my_robot/{urdf/r.urdf, meshes/a.stl, meshes/b c.stl}, tmp_path/other/meshes/o.stl, tmp_path/secret.stl."""
    for name in (
        "my_robot/urdf/r.urdf",
        "my_robot/meshes/a.stl",
        "my_robot/meshes/b c.stl",
        "other/meshes/o.stl",
        "secret.stl",
    ):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("")
    source = ModelSource("file", str(tmp_path / "my_robot" / "urdf" / "r.urdf"))
    return MeshPaths.of(RobotProfile("r", "", source, "fixed", {}))


@pytest.mark.parametrize(
    ("name", "file"),
    [
        ("package://my_robot/meshes/a.stl", "my_robot/meshes/a.stl"),
        ("model://my_robot/meshes/a.stl", "my_robot/meshes/a.stl"),
        ("package://other/meshes/o.stl", "other/meshes/o.stl"),
        ("package://my_robot/meshes/b%20c.stl", "my_robot/meshes/b c.stl"),
        ("../meshes/a.stl", "my_robot/meshes/a.stl"),
        ("meshes/a.stl", "my_robot/meshes/a.stl"),
    ],
)
def test_meshes_are_found(paths: MeshPaths, tmp_path: Path, name: str, file: str) -> None:
    assert paths.resolve(name) == (tmp_path / file, "")


def test_absolute_names_inside_the_model_are_found(paths: MeshPaths, tmp_path: Path) -> None:
    mesh = tmp_path / "my_robot" / "meshes" / "a.stl"
    assert paths.resolve(str(mesh)) == (mesh, "")
    assert paths.resolve(f"file://{mesh}") == (mesh, "")


@pytest.mark.parametrize(
    ("name", "problem"),
    [
        ("package://my_robot/meshes/none.stl", MISSING),
        ("package://nobody/meshes/a.stl", MISSING),
        ("package://etc/passwd", MISSING),
        ("package://", MISSING),
        ("package://../secret.stl", MISSING),
        ("", MISSING),
        ("package://my_robot/../secret.stl", OUTSIDE),
        ("../../secret.stl", OUTSIDE),
        ("/etc/hostname", OUTSIDE),
        ("file:///etc/hostname", OUTSIDE),
    ],
)
def test_meshes_that_are_not_there_or_not_the_models(paths: MeshPaths, name: str, problem: str) -> None:
    assert paths.resolve(name) == (None, problem)


def test_a_link_out_of_the_model_is_not_followed(paths: MeshPaths, tmp_path: Path) -> None:
    (tmp_path / "my_robot" / "meshes" / "l.stl").symlink_to(tmp_path / "secret.stl")
    assert paths.resolve("package://my_robot/meshes/l.stl") == (None, OUTSIDE)


def test_a_robot_without_files_has_no_meshes() -> None:
    assert MeshPaths.of(RobotProfile("p", "", ModelSource("human"), "floating", {})).resolve("a.stl") == (None, MISSING)
