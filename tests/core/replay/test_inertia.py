"""Inertia tensors of solids that are known, alone, with a rotor added, and ones that nothing has."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from retarget.core.replay.inertia import SMALLEST_INERTIA_KGM2, SMALLEST_MASS_KG, link_inertia
from retarget.core.types import Array
from scipy.spatial.transform import Rotation

Z = np.array([0.0, 0.0, 1.0])


def second_moments(tensor: Array) -> Array:
    return np.linalg.eigvalsh(np.trace(tensor) / 2 * np.eye(3) - tensor)


def box(mass: float, edges: Array) -> Array:
    x, y, z = np.square(edges)
    return mass / 12 * np.diag([y + z, x + z, x + y])


@pytest.mark.parametrize("edges", [(0.1, 0.2, 0.3), (0.5, 0.02, 0.02), (0.3, 0.3, 1e-3)])
def test_solids_stay_as_they_are(edges: tuple[float, ...]) -> None:
    turn = Rotation.from_rotvec([0.3, -0.4, 0.5]).as_matrix()
    tensor = turn @ box(2.0, np.array(edges)) @ turn.T
    found = link_inertia(2.0, tensor, Z)
    np.testing.assert_allclose(found.tensor, tensor, rtol=0, atol=1e-12)
    assert (found.mass, found.rotor, found.repaired) == (2.0, 0.0, False)


def test_a_rotor_on_the_joints_axis_is_told_from_its_link() -> None:
    """A rod along x, for which Iyy = Izz and Ixx = 0: all that was added about z comes back."""
    rod = np.diag([0.0, 0.02, 0.02])
    found = link_inertia(1.0, rod + 0.3 * np.outer(Z, Z), Z)
    assert found.rotor == pytest.approx(0.3)
    np.testing.assert_allclose(found.tensor, rod, atol=1e-8)
    assert not found.repaired


def test_the_joint_itself_feels_the_same_with_and_without_the_rotor() -> None:
    axis = np.array([2.0, -1.0, 2.0]) / 3
    tensor = box(3.0, np.array([0.1, 0.1, 0.4])) + 0.5 * np.outer(axis, axis)
    found = link_inertia(3.0, tensor, axis)
    assert 0 < found.rotor <= 0.5
    assert axis @ found.tensor @ axis + found.rotor == pytest.approx(axis @ tensor @ axis, rel=1e-6)


def test_a_large_moment_on_another_axis_is_no_rotor() -> None:
    tensor = np.diag([0.001, 0.015, 0.001])
    found = link_inertia(1.0, tensor, Z)
    assert (found.rotor, found.repaired) == (0.0, True)
    np.testing.assert_allclose(found.tensor, np.diag([0.0075, 0.015, 0.0075]), atol=1e-9)


def test_a_link_that_slides_or_has_no_joint_gets_no_rotor() -> None:
    assert link_inertia(1.0, np.diag([0.01, 0.01, 0.5]), None).rotor == 0.0


def test_links_without_mass_or_without_inertia() -> None:
    nothing = link_inertia(0.0, np.zeros((3, 3)), Z)
    assert (nothing.mass, nothing.repaired) == (SMALLEST_MASS_KG, False)
    point = link_inertia(0.5, np.zeros((3, 3)), Z)
    assert (point.mass, point.rotor, point.repaired) == (0.5, 0.0, True)
    assert second_moments(point.tensor).min() > 0
    assert np.abs(point.tensor).max() <= SMALLEST_INERTIA_KGM2 * (1 + 1e-9)


@given(st.lists(st.floats(-1, 1), min_size=6, max_size=6), st.lists(st.floats(-1, 1), min_size=3, max_size=3))
def test_whatever_comes_in_a_body_comes_out(numbers: list[float], direction: list[float]) -> None:
    tensor = np.zeros((3, 3))
    tensor[np.triu_indices(3)] = numbers
    tensor = tensor + np.triu(tensor, 1).T
    length = np.linalg.norm(direction)
    found = link_inertia(1.0, tensor, np.array(direction) / length if length > 0.1 else None)
    assert second_moments(found.tensor).min() > 0
    assert found.rotor >= 0
