"""MJCF whose mesh files are missing: read all the same, and told."""

from __future__ import annotations

from pathlib import Path

import pytest
from retarget.core.replay import model as replay_model
from retarget.core.replay.shapes import shapes_of

from tests.core.mjcf_robots import arm, built


@pytest.mark.parametrize("kind", ["mesh", "capsule"])
def test_a_missing_mesh_is_left_out_with_a_warning(kind: str, tmp_path: Path) -> None:
    text = arm(
        more='<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>' + f'<geom type="{kind}" mesh="gone"/>',
        sections='<asset><mesh file="gone.stl"/></asset>',
    )
    robot = built(tmp_path, text)
    assert shapes_of(robot)[1] == ["1 × mesh not found (collision): gone.stl"]
    replay = replay_model.build(robot, base="fixed", cache=tmp_path)
    assert replay.warnings == ("1 × mesh not found (collision): gone.stl",)


def test_a_missing_mesh_of_the_scene_does_not_matter(tmp_path: Path) -> None:
    scene = '<asset><mesh file="hall.obj"/></asset><worldbody><geom type="mesh" mesh="hall"/></worldbody>'
    assert built(tmp_path, arm(sections=scene)).warnings == ()
