"""The curves that motions are made of, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from retarget.samples import curves, normative, steps


def test_periodic_curve_finds_the_waves_it_was_sampled_from() -> None:
    phase = np.arange(20) / 20

    def wave(x: np.ndarray) -> np.ndarray:
        return 3 + 2 * np.cos(2 * np.pi * x - 0.3) - 0.5 * np.sin(2 * np.pi * 5 * x)

    fine = np.linspace(-1, 2, 301)
    assert curves.periodic(wave(phase).tolist())(fine) == pytest.approx(wave(fine), abs=1e-12)


@pytest.mark.parametrize(
    ("table", "curve"),
    [
        (normative.HIP_FLEXION_DEG, normative.hip_flexion_deg),
        (normative.KNEE_FLEXION_DEG, normative.knee_flexion_deg),
        (normative.ANKLE_DORSIFLEXION_DEG, normative.ankle_dorsiflexion_deg),
    ],
)
def test_norms_are_met_to_a_degree(table: tuple[int, ...], curve: object) -> None:
    assert callable(curve)
    assert np.abs(curve(np.arange(20) / 20) - table).max() < 1.0


def test_bridge_meets_both_ends_in_value_velocity_and_acceleration() -> None:
    before = (np.array([1.0, -2.0]), np.array([0.5, 3.0]), np.array([-4.0, 1.0]))
    after = (np.array([2.0, 0.0]), np.array([-1.0, 0.2]), np.array([6.0, -3.0]))
    time = np.linspace(2.0, 2.7, 40)
    values = curves.bridge(time, 2.0, 2.7, before, after)
    for column in range(2):
        quintic = Polynomial.fit(time, values[:, column], 5)
        assert quintic(time) == pytest.approx(values[:, column], abs=1e-9), "a quintic"
        for order, (start, end) in enumerate(zip(before, after, strict=True)):
            derivative = quintic.deriv(order) if order else quintic
            assert derivative(2.0) == pytest.approx(start[column], abs=1e-6)
            assert derivative(2.7) == pytest.approx(end[column], abs=1e-6)


def test_jet_of_a_sine() -> None:
    value, velocity, acceleration = curves.jet(lambda t: np.sin(3 * t)[:, None], 0.4)
    assert value == pytest.approx([np.sin(1.2)])
    assert velocity == pytest.approx([3 * np.cos(1.2)], abs=1e-6)
    assert acceleration == pytest.approx([-9 * np.sin(1.2)], abs=2e-5)


def test_ramp_integral_is_the_integral_of_the_ramp() -> None:
    time = np.linspace(0, 5, 50_001)
    ramp = curves.ramp(time, 1.0, 3.5)
    summed = np.concatenate([[0.0], np.cumsum((ramp[1:] + ramp[:-1]) / 2 * np.diff(time))])
    assert curves.ramp_integral(time, 1.0, 3.5) == pytest.approx(summed, abs=1e-7)


def test_keyed_values_rest_at_their_keys() -> None:
    keys = [(1.0, 5.0), (2.0, -1.0), (2.5, -1.0), (4.0, 3.0)]
    at = np.array([0.0, 1.0, 2.0, 2.2, 2.5, 4.0, 9.0])
    assert curves.keyed(at, keys) == pytest.approx([5.0, 5.0, -1.0, -1.0, -1.0, 3.0, 3.0])
    assert np.abs(curves.keyed(at + 1e-4, keys) - curves.keyed(at - 1e-4, keys)).max() < 1e-9


def test_path_is_as_long_as_the_way_and_points_where_it_heads() -> None:
    way = np.linspace(0, 11, 2201)
    points = steps.path(way)
    tangent = np.diff(points, axis=0) / np.diff(way)[:, None]
    middle = steps.heading((way[1:] + way[:-1]) / 2)
    assert np.linalg.norm(tangent, axis=1) == pytest.approx(1.0, abs=1e-5)
    assert tangent == pytest.approx(np.stack([np.cos(middle), np.sin(middle)], axis=1), abs=1e-4)
    assert points[way < steps.TURN_START, 1] == pytest.approx(0.0)
