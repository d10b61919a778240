"""Whether the declared vertical can be right: on people made of a few trackers, and on logs that say nothing of it."""

from __future__ import annotations

import numpy as np
import pytest

from tests.formats.tracker_logs import Array, poses, read, wide

TIME = np.arange(200) / 50
PERSON = {
    "waist": (0.0, 1.0, 0.0),
    "chest": (0.0, 1.35, 0.0),
    "head": (0.0, 1.7, 0.02),
    "left_elbow": (-0.3, 1.2, 0.0),
    "right_elbow": (0.3, 1.2, 0.0),
    "left_hand": (-0.35, 0.9, -0.1),
    "right_hand": (0.35, 0.9, -0.1),
}
"""Places in OpenVR's world, m: X right, Y up, Z backward."""
OTHER = {"y": "z", "z": "y"}


def to_z_up(position: Array) -> Array:
    return np.stack([position[:, 0], -position[:, 2], position[:, 1]], axis=1)


def moving(place: tuple[float, float, float], seed: int) -> Array:
    rng = np.random.default_rng(seed)
    return np.array(place) + 0.1 * np.sin(2 * TIME[:, None] + rng.uniform(0, 6, 3))


def doubts(trackers: dict[str, Array], up: str) -> list[str]:
    content = wide(TIME, **{name: poses(position) for name, position in trackers.items()})
    return [line for line in read(content, up=up).source.warnings if "unlikely" in line]


@pytest.mark.parametrize("names", [list(PERSON), ["head", "chest", "left_hand", "right_hand"], ["chest", "waist"]])
@pytest.mark.parametrize("up", ["y", "z"])
def test_a_person(names: list[str], up: str) -> None:
    trackers = {name: moving(PERSON[name], seed) for seed, name in enumerate(names)}
    if up == "z":
        trackers = {name: to_z_up(position) for name, position in trackers.items()}
    assert doubts(trackers, up) == []
    (line,) = doubts(trackers, OTHER[up])
    assert line.startswith(f"up = {OTHER[up]} is unlikely: ")


def test_a_person_upside_down() -> None:
    trackers = {name: moving(PERSON[name], seed) * [1, -1, -1] for seed, name in enumerate(PERSON)}
    (line,) = doubts(trackers, "y")
    assert "Head is -0.69 m above Pelvis along y" in line


def test_a_person_is_believed_rather_than_the_plane_that_the_hands_draw() -> None:
    """Circles in front of the body lie in a plane across OpenVR's z: with head and chest known that says nothing."""
    circle = 0.25 * np.stack([np.cos(3 * TIME), np.sin(3 * TIME), np.zeros_like(TIME)], axis=1)
    hands = {name: circle + PERSON[name] for name in ("left_hand", "right_hand")}
    still = {name: np.tile(PERSON[name], (200, 1)) for name in ("head", "chest")}
    assert doubts(hands | still, "y") == []
    assert doubts(hands, "y") == [
        "up = y is unlikely: all motion lies in a plane across z (within 0°), as on a floor or a table"
    ]


@pytest.mark.parametrize("up", ["y", "z"])
def test_unnamed_trackers_on_a_table(up: str) -> None:
    flat = np.stack([0.3 * np.sin(TIME), 0.002 * np.cos(9 * TIME), 0.2 * np.cos(2 * TIME)], axis=1) - [0, 0.7, 0]
    trackers = {"LHR-1": flat if up == "y" else to_z_up(flat)}
    assert doubts(trackers, up) == []
    assert len(doubts(trackers, OTHER[up])) == 1


def test_unnamed_trackers_that_move_all_ways_by_their_heights() -> None:
    trackers = {"LHR-1": moving((0.5, 1.1, -1.4), 0), "LHR-2": moving((0.1, 0.7, 1.2), 1)}
    assert doubts(trackers, "y") == []
    (line,) = doubts(trackers, "z")
    assert "heights go down to -1.50 m, along y all are above 0" in line


def test_one_tracker_at_rest_says_nothing() -> None:
    trackers = {"LHR-1": np.tile([0.2, 0.1, 0.3], (200, 1))}
    assert doubts(trackers, "y") == doubts(trackers, "z") == []


def test_undeclared_is_y_and_said() -> None:
    content = wide(TIME, chest=poses(moving(PERSON["chest"], 0)))
    found, declared = read(content, up=None), read(content, up="y")
    np.testing.assert_array_equal(found.position, declared.position)
    assert "up axis not declared: taken as y" in found.source.warnings[0]
    assert declared.source.warnings == ()
