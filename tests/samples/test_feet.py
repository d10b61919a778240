"""Feet that the files call in contact do not move, and the others do. All from the decoded files."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from retarget.core.segments import FOOT_CONTACTS
from retarget.samples import generate

WITH_CONTACTS = sorted(name for name, sample in generate.SAMPLES.items() if sample.foot_contacts)
Documents = Callable[[str], Any]


def _ground_points(content: Any, contact: str) -> list[np.ndarray]:
    """The points (T, 3) of the sole that a contact is about: the heel, or the ball and the toes' tip."""
    side = contact.removesuffix("Foot_Heel").removesuffix("Foot_Toe")
    if contact.endswith("Heel"):
        return [content.at(f"{side}Foot", f"p{side}HeelFoot")]
    return [content.at(f"{side}Toe"), content.at(f"{side}Toe", f"p{side}Toe")]


@pytest.mark.parametrize("name", WITH_CONTACTS)
@pytest.mark.parametrize("column", range(4))
def test_a_contact_stays_where_it_is(name: str, column: int, document: Documents) -> None:
    content = document(name)
    touching = content.contacts[:, column]
    assert touching.any()
    for point in _ground_points(content, FOOT_CONTACTS[column]):
        assert np.abs(point[touching, 2]).max() < 1e-3
        step = np.linalg.norm(np.diff(point[:, :2], axis=0), axis=1)[touching[1:] & touching[:-1]]
        assert step.max() < 0.5e-3
        # Not only from frame to frame: over a whole contact nothing creeps.
        for start, end in _runs(touching):
            assert np.ptp(point[start:end, :2], axis=0).max() < 0.5e-3


@pytest.mark.parametrize("name", WITH_CONTACTS)
def test_no_part_of_a_foot_goes_through_the_floor(name: str, document: Documents) -> None:
    content = document(name)
    for contact in FOOT_CONTACTS:
        for point in _ground_points(content, contact):
            assert point[:, 2].min() > -2e-3, contact


@pytest.mark.parametrize("side", ["Left", "Right"])
def test_walking_feet_lift_swing_and_land_in_order(side: str, document: Documents) -> None:
    content = document("walk")
    heel, toe = (content.contacts[:, FOOT_CONTACTS.index(f"{side}Foot_{part}")] for part in ("Heel", "Toe"))
    assert heel[0]
    assert toe[0]
    assert heel[-1]
    assert toe[-1]
    heel_runs, toe_runs = _runs(heel), _runs(toe)
    assert len(heel_runs) == len(toe_runs) >= 9
    for (heel_down, heel_up), (toe_down, toe_up) in zip(heel_runs[1:-1], toe_runs[1:-1], strict=True):
        assert heel_down < toe_down < heel_up < toe_up
    height = _ground_points(content, f"{side}Foot_Heel")[0][:, 2]
    for (_, up), (down, _) in pairwise(heel_runs):
        assert height[up:down].max() > 0.08


@pytest.mark.parametrize("side", ["Left", "Right"])
def test_toes_clear_the_floor_in_the_middle_of_every_swing(side: str, document: Documents) -> None:
    """Least clearance in mid-swing is one to two centimetres in healthy walking (Winter 1991)."""
    content = document("walk")
    toe = content.contacts[:, FOOT_CONTACTS.index(f"{side}Foot_Toe")]
    lowest = np.min([point[:, 2] for point in _ground_points(content, f"{side}Foot_Toe")], axis=0)
    for (_, up), (down, _) in pairwise(_runs(toe)):
        middle = slice(up + (down - up) // 2, up + 2 * (down - up) // 3)
        assert 0.010 < lowest[middle].min() < 0.040


def test_one_foot_at_least_always_stands(document: Documents) -> None:
    assert document("walk").contacts.any(axis=1).all()


@pytest.mark.parametrize("name", [name for name in WITH_CONTACTS if name != "walk"])
def test_exercises_keep_both_feet_flat(name: str, document: Documents) -> None:
    assert document(name).contacts.all()


def _runs(flags: np.ndarray) -> list[tuple[int, int]]:
    """(first, one past last) of every stretch of true flags."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
