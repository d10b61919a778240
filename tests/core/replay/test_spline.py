"""The spline against SciPy's, whose default ends are not-a-knot, too."""

from __future__ import annotations

import numpy as np
import pytest
from retarget.core.replay.spline import CubicSpline
from scipy import interpolate


@pytest.mark.parametrize("knots", [2, 3, 4, 5, 50])
def test_values_are_scipys_inside_and_beyond_on_uneven_knots(knots: int) -> None:
    rng = np.random.default_rng(knots)
    time = np.cumsum(rng.uniform(0.01, 0.05, knots))
    values = rng.normal(size=(knots, 3))
    at = np.linspace(time[0] - 0.002, time[-1] + 0.002, 999)
    expected = interpolate.CubicSpline(time, values, bc_type="not-a-knot")(at)
    np.testing.assert_allclose(CubicSpline.through(time, values)(at), expected, rtol=0, atol=1e-11)


def test_a_cubic_is_met_exactly_everywhere() -> None:
    time = np.array([0.0, 0.3, 0.4, 1.0, 1.7])
    spline = CubicSpline.through(time, (2 - time + 3 * time**2 - 0.5 * time**3)[:, None])
    at = np.linspace(0, 1.7, 100)
    np.testing.assert_allclose(spline(at)[:, 0], 2 - at + 3 * at**2 - 0.5 * at**3, rtol=0, atol=1e-13)


def test_knots_are_met() -> None:
    rng = np.random.default_rng(1)
    time, values = np.arange(20) / 60, rng.normal(size=(20, 2))
    np.testing.assert_allclose(CubicSpline.through(time, values)(time), values, rtol=0, atol=1e-14)
