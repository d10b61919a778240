"""Every format that reads and writes trajectories gives back what it got, to the precision and with the losses it states.

A new format or style is tested here without being named, and must then keep everything bit for bit.
"""

from __future__ import annotations

import io
import tempfile
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from retarget import formats
from retarget.core import rotations
from retarget.core.types import JointTrajectory

READABLE = [f for f in formats.available().values() if f.read_trajectory or f.read_folder]
ELSEWHERE = {"csv-unitree", "lerobot"}
"""Only evenly spaced frames survive these, and float32 the second: test_peers.py and test_lerobot.py test them."""
BOTH_WAYS = [
    name
    for f in READABLE
    if f.writable
    for name in (f.name, *(f"{f.name}-{style}" for style in f.styles[1:]))
    if name not in ELSEWHERE
]

TIME_TOLERANCE_S = {"mcap": 0.5e-9, "rosbag2": 0.5e-9}
"""ROS stamps are whole nanoseconds; every other format keeps times bit for bit."""
NAMES = {"base_frame", "robot", "provenance", "robot_description"}
LOST = {
    "csv": NAMES,
    "npz-gmr": NAMES | {"velocity", "status", "base_linear_velocity", "base_angular_velocity"},
}
"""What these have no place for."""
WITHOUT_FIXED_BASE = {"npz-gmr"}
"""A fixed base comes back as one that stays at the origin."""

finite = st.floats(allow_nan=False, allow_infinity=False, allow_subnormal=True)
text = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=12)
json_values = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**60), 2**60) | finite | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=6,
)


@st.composite
def trajectories(draw: st.DrawFn) -> JointTrajectory:
    """Any trajectory that the type allows and whose times ROS can hold; numbers of every size, names in every script."""
    frames, joints = draw(st.integers(1, 5)), draw(st.integers(0, 4))

    def numbers(*shape: int) -> Any:
        return draw(arrays(np.float64, shape, elements=finite))

    steps = draw(arrays(np.float64, frames, elements=st.floats(1e-6, 1e6, allow_subnormal=False)))
    time = draw(st.sampled_from([0.0, 1e-9, 12.5, 86400.0])) + np.cumsum(steps) - steps[0] * draw(st.booleans())
    optional = st.booleans()
    changes: dict[str, Any] = {}
    if draw(optional):
        turns = draw(arrays(np.float64, (frames, 3), elements=st.floats(-1e3, 1e3)))
        # As far from unit as the type allows.
        orientation = rotations.make_continuous(rotations.exp(turns)) * (1 + draw(st.floats(-4e-7, 4e-7)))
        changes = {"base_position": numbers(frames, 3), "base_orientation": orientation}
    for name in ("base_linear_velocity", "base_angular_velocity"):
        if draw(optional):
            changes[name] = numbers(frames, 3)
    return JointTrajectory(
        time=time,
        joint_names=tuple(draw(st.lists(text, min_size=joints, max_size=joints, unique=True))),
        position=numbers(frames, joints),
        velocity=numbers(frames, joints),
        status=draw(arrays(np.int8, frames, elements=st.integers(0, 1))),
        base_frame=draw(text),
        robot=draw(text),
        provenance=draw(st.dictionaries(st.text(max_size=6), json_values, max_size=4)),
        robot_description=draw(text),
        **changes,
    )


def check_same(name: str, before: JointTrajectory, after: JointTrajectory) -> None:
    """Every field is the same, bit for bit where nothing else is stated for the format."""
    tolerance = TIME_TOLERANCE_S.get(name.split("-")[0], 0.0)
    if name in WITHOUT_FIXED_BASE and before.base_position is None:
        still = np.tile([1.0, 0.0, 0.0, 0.0], (before.frames, 1))
        before = replace(before, base_position=np.zeros((before.frames, 3)), base_orientation=still)
    resolution = np.spacing(before.time[-1]) if tolerance else 0.0
    assert np.abs(after.time - before.time).max() <= tolerance + resolution
    for field in (f.name for f in fields(JointTrajectory)):
        old, new = getattr(before, field), getattr(after, field)
        if field == "time" or field in LOST.get(name, set()):
            continue
        if isinstance(old, np.ndarray):
            assert isinstance(new, np.ndarray), field
            assert (old.dtype, old.shape) == (new.dtype, new.shape), field
            # As bytes: a zero keeps its sign.
            assert old.tobytes() == new.tobytes(), field
        else:
            assert old == new, field


def through(name: str, trajectory: JointTrajectory) -> JointTrajectory:
    """`trajectory` written and read back; name: the format's, with "-" and the style where that is not the default."""
    format_name, _, style = name.partition("-")
    format_ = formats.get(format_name)
    if format_.write_folder is not None:
        with tempfile.TemporaryDirectory() as folder:
            formats.write_trajectory(Path(folder) / "out", trajectory, format=format_name, style=style or None)
            return formats.read_trajectory(Path(folder) / "out")
    assert format_.write_trajectory is not None
    out = io.BytesIO()
    format_.write_trajectory(out, trajectory, style or format_.styles[0])
    out.seek(0)
    return formats.read_trajectory(out, "memory", format_name)


@pytest.mark.parametrize("name", BOTH_WAYS)
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(trajectory=trajectories())
def test_any_trajectory_comes_back(name: str, trajectory: JointTrajectory) -> None:
    if "velocity" in LOST.get(name, set()):
        base = [] if trajectory.base_position is None else [trajectory.base_position]
        # Rates that are worked out again from steps of a microsecond must be numbers.
        assume(all(np.abs(values).max(initial=0.0) < 1e300 for values in (trajectory.position, *base)))
    check_same(name, trajectory, through(name, trajectory))


@pytest.mark.parametrize("name", BOTH_WAYS)
def test_long_clip_comes_back(name: str, make_trajectory: Callable[..., JointTrajectory]) -> None:
    trajectory = make_trajectory(frames=5000, joints=29, rate_hz=240)
    check_same(name, trajectory, through(name, trajectory))


@pytest.mark.parametrize("name", BOTH_WAYS)
def test_from_one_format_through_all_others(name: str, make_trajectory: Callable[..., JointTrajectory]) -> None:
    """What a format can keep survives any chain: here each format follows each other once."""
    start = through(name, make_trajectory())
    for other in BOTH_WAYS:
        check_same(other, start, through(other, start))
