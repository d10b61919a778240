"""Hand mappings side by side: the sample operator against the truth beside the samples, squares and postures against closed forms."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from retarget import formats, samples
from retarget.core import comparison, experiments
from retarget.core.calibrate import operator
from retarget.core.calibrate.apply import apply
from retarget.core.calibration import POSES
from retarget.core.errors import MotionError, UsageError
from retarget.core.types import HumanMotion

from tests.core.mapping.operators import authors_arms, calibration_of, pose

MotionFactory = Callable[..., HumanMotion]
Robots = Callable[[str], Any]


@pytest.fixture(scope="module")
def sample() -> Mapping[str, HumanMotion]:
    """Sample → its motion, with the calibration of the samples' operator."""
    options = formats.TrackerOptions(up="y")
    read = {
        name: formats.read_trackers(str(samples.sample_path(f"{name}_trackers")), options=options)
        for name in ("calibration", "circles", "box", "clap")
    }
    calibration = operator.calibrate(dict.fromkeys(POSES, read.pop("calibration")))
    return {name: apply(calibration, recording) for name, recording in read.items()}


def truth(name: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(samples.sample_path(f"{name}_trackers").with_suffix(".json").read_text())
    return found


def test_circles_of_the_sample_are_found_and_come_out_rounder(
    sample: Mapping[str, HumanMotion], build_robot: Robots
) -> None:
    """Three circles in the window that the sample's truth states; the index is that of the same window given."""
    model, window = build_robot("tocabi"), truth("circles")["windows_s"]["circles"]
    found = comparison.circles(sample["circles"], model, experiments.HAND_MAPPINGS)
    given = comparison.circles(sample["circles"], model, experiments.HAND_MAPPINGS, tuple(window))
    assert set(found) == {"Left", "Right"}
    for side, circles in found.items():
        assert circles.window_s == pytest.approx(window, abs=0.03)
        assert circles.index["original"] == pytest.approx(given[side].index["original"], rel=0.02)
        assert circles.index["hand_position"] < 0.5 * circles.index["original"]
        for name in ("proportional", "absolute"):
            assert circles.index[name] == pytest.approx(circles.index["original"], abs=1e-12)
        inside = experiments.within(sample["circles"].time, circles.window_s).sum()
        assert {len(path) for path in circles.paths.values()} == {inside}
        assert given[side].window_s == tuple(window)


@pytest.mark.parametrize("name", ["box", "clap"])
def test_other_motions_are_no_circles(sample: Mapping[str, HumanMotion], build_robot: Robots, name: str) -> None:
    assert comparison.circles(sample[name], build_robot("tocabi"), ["absolute"]) == {}


@pytest.mark.parametrize(
    ("window", "message"),
    [
        ((20.0, 30.0), "from 20 to 30 s, expected one in the recording, 0 to 9.9 s"),
        ((-1.0, 3.0), "from -1 to 3 s"),
        ((3.001, 3.002), "fewer than three frames"),
    ],
)
def test_windows_without_a_circle(
    sample: Mapping[str, HumanMotion], build_robot: Robots, window: tuple[float, float], message: str
) -> None:
    with pytest.raises(MotionError, match=message):
        comparison.circles(sample["circles"], build_robot("tocabi"), ["absolute"], window)


def test_variants() -> None:
    assert [(v.name, v.mapping, dict(v.settings)) for v in comparison.variants(["hand_position", "absolute"])] == [
        ("hand_position", "hand_position", {}),
        ("absolute, raised 0.15 m", "absolute", {"height_m": 0.15}),
        ("absolute, shoulders level", "absolute", {"height_m": None}),
    ]
    comparison.check_mappings(experiments.HAND_MAPPINGS)
    with pytest.raises(UsageError, match=r"mapping 'limb_plane' gives hands no positions; expected .* hand_position"):
        comparison.check_mappings(["absolute", "limb_plane"])


def test_the_square_of_perfect_poses_is_a_square(make_motion: MotionFactory, build_robot: Robots) -> None:
    """B_h = 0.55 m · axes: only the scale differs, TOCABI's arm of 0.78 m over the person's."""
    for square in comparison.squares(calibration_of(make_motion), build_robot("tocabi")).values():
        assert square.edges_m == pytest.approx([0.3 * 0.78 / 0.55] * 2, abs=1e-12)
        assert square.corner_deg == pytest.approx(90.0, abs=1e-9)
        assert square.tilt_deg == pytest.approx(0.0, abs=1e-5)
        assert square.operator[0] == pytest.approx([0.6 * 0.55, 0.15, 0.15], abs=1e-12)
        assert square.robot == pytest.approx(square.operator * 0.78 / 0.55, abs=1e-12)


def test_the_authors_square(make_motion: MotionFactory, build_robot: Robots) -> None:
    """Edges and angles of B_r B_h⁻¹ applied to the edges' directions."""
    calibration = replace(calibration_of(make_motion), arms=authors_arms())
    for side, square in comparison.squares(calibration, build_robot("tocabi")).items():
        out = 1.0 if side == "Left" else -1.0
        robot = 0.78 * np.array([[0, 0, 1], [0, out, 0], [-1, 0, 0]])
        linear = robot @ np.linalg.inv(calibration.arms[side].basis)
        across, down = linear @ [0, -0.3, 0], linear @ [0, 0, -0.3]
        assert square.edges_m == pytest.approx([np.linalg.norm(across), np.linalg.norm(down)])
        cosine = across @ down / np.prod(square.edges_m)
        assert square.corner_deg == pytest.approx(np.degrees(np.arccos(cosine)))
        normal = np.cross(across, down)
        assert square.tilt_deg == pytest.approx(np.degrees(np.arctan2(np.hypot(*normal[1:]), abs(normal[0]))))
        assert abs(square.corner_deg - 90) > 1
        assert square.tilt_deg > 1


def test_arms_that_hang(make_motion: MotionFactory, build_robot: Robots) -> None:
    """One to one, TOCABI's shoulders being wider than the person's and before its pelvis, the hands go inward and back by as much;
    the proposed mapping lets the arms hang straight [Lim2022 fig. 8]."""
    model = build_robot("tocabi")
    motion = make_motion(np.arange(4) / 30, pose("still"), calibration=calibration_of(make_motion))
    chosen = comparison.variants(["hand_position", "absolute"])
    seen: list[tuple[int, int]] = []
    results = comparison.similarity(motion, model, chosen, lambda done, total: seen.append((done, total)))
    assert [result.variant for result in results] == chosen
    assert seen[-1] == (12, 12)
    ours, raised, level = results
    person = comparison.operator_points(motion, model)
    for side in ("Left", "Right"):
        assert ours.errors_deg[f"{side}Arm"] == pytest.approx(np.zeros(4), abs=0.1)
        shoulder = level.points[f"{side}Shoulder"][-1]
        own = person[f"{side}Shoulder"][-1]
        off = np.hypot(shoulder[0] - own[0], shoulder[1] - own[1])
        assert level.errors_deg[f"{side}Arm"] == pytest.approx(np.degrees(np.arctan2(off, 0.55)), abs=0.1)
        assert level.hand_error_m[side] == pytest.approx(np.zeros(4), abs=1e-3)
        assert raised.points[f"{side}Hand"] - raised.points["Pelvis"] == pytest.approx(
            person[f"{side}Hand"] + [0.0, 0.0, 0.15], abs=1e-3
        )
    assert {result.unsolved_frames for result in results} == {0}


def test_points_of_person_and_robot(make_motion: MotionFactory, build_robot: Robots) -> None:
    """The same names on both, so that one drawing fits; the neck is between the shoulders."""
    motion = make_motion([0.0, 0.1], pose("forward"), calibration=calibration_of(make_motion))
    model = build_robot("tocabi")
    person = comparison.operator_points(motion, model)
    (result,) = comparison.similarity(motion, model, comparison.variants(["hand_position"]))
    assert set(person) == set(result.points)
    for points in (person, result.points):
        assert points["Neck"] == pytest.approx(0.5 * (points["LeftShoulder"] + points["RightShoulder"]))
        assert (points["Head"][:, 2] > points["Neck"][:, 2]).all()
        assert (points["Pelvis"][:, 2] < points["Neck"][:, 2]).all()
    assert person["Pelvis"] == pytest.approx(0.0)


def test_fast_recordings_are_thinned_and_slow_ones_are_not(make_motion: MotionFactory) -> None:
    assert comparison.at_rate(make_motion(np.arange(91) / 90)).rate_hz == pytest.approx(30.0)
    slow = make_motion(np.arange(11) / 10)
    assert comparison.at_rate(slow) is slow
