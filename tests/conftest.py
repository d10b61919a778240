"""Fixtures for all rooms: the real recordings, a person of known shape in any posture, the robots."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import hypothesis
import numpy as np
import pytest
from numpy.typing import ArrayLike
from retarget.cli.video import choose_opengl
from retarget.core import rotations
from retarget.core.segments import PARENT
from retarget.core.types import Array, HumanMotion

# How long an example takes says nothing about whether it is right, least of all on a busy machine.
hypothesis.settings.register_profile("untimed", deadline=None)
hypothesis.settings.load_profile("untimed")

# mujoco decides when it is first imported, by whichever test that is.
choose_opengl()

# A shell starts what it runs in the background with interrupts ignored, and children inherit that; tests of interrupts would wait in vain.
if threading.current_thread() is threading.main_thread() and signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

REPOSITORY = Path(__file__).resolve().parents[1]

_RIGHT = {
    "Shoulder": (0.0, -0.05, 0.10),
    "UpperArm": (0.0, -0.12, 0.0),
    "ForeArm": (0.0, -0.30, 0.0),
    "Hand": (0.0, -0.25, 0.0),
    "UpperLeg": (0.0, -0.09, 0.0),
    "LowerLeg": (0.0, 0.0, -0.43),
    "Foot": (0.0, 0.0, -0.43),
    "Toe": (0.15, 0.0, -0.09),
}
PERSON_OFFSETS: dict[str, tuple[float, float, float]] = {
    "L5": (0.0, 0.0, 0.10),
    "L3": (0.0, 0.0, 0.10),
    "T12": (0.0, 0.0, 0.10),
    "T8": (0.0, 0.0, 0.10),
    "Neck": (0.0, 0.0, 0.15),
    "Head": (0.0, 0.0, 0.10),
    **{f"Right{name}": offset for name, offset in _RIGHT.items()},
    **{f"Left{name}": (x, -y, z) for name, (x, y, z) in _RIGHT.items()},
}
"""Segment → its proximal joint in the parent's frame, m: whole centimetres, left and right mirrored, ankle 9 cm above the toes."""
PELVIS_HEIGHT_M = 0.95

MotionFactory = Callable[..., HumanMotion]


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of the real recordings, which are not part of the repository."""
    folder = REPOSITORY.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("the real recordings (../shared/data) are not on this machine")
    return folder


@pytest.fixture(scope="session")
def make_motion() -> MotionFactory:
    """`make_motion(time, world, pelvis=…, **fields)`: the person of PERSON_OFFSETS, in T-pose where nothing else is said.

    time: (T,) s. world: segment → orientation world ← segment, (4,) or (T, 4) wxyz; a segment that is not named is turned like its
    parent. pelvis: (3,) or (T, 3) m. fields: further fields of `HumanMotion`, laid over the computed ones.
    """

    def make(
        time: ArrayLike, world: Mapping[str, ArrayLike] | None = None, *, pelvis: ArrayLike | None = None, **fields: Any
    ) -> HumanMotion:
        t = np.asarray(time, float)
        turned: dict[str, Array] = {}
        origin: dict[str, Array] = {}
        given = dict(world or {})
        for segment, parent in PARENT.items():
            own = given.pop(segment, (1.0, 0.0, 0.0, 0.0) if parent is None else turned[parent])
            turned[segment] = rotations.make_continuous(np.broadcast_to(np.asarray(own, float), (len(t), 4)))
            if parent is None:
                start = (0.0, 0.0, PELVIS_HEIGHT_M) if pelvis is None else pelvis
                origin[segment] = np.broadcast_to(np.asarray(start, float), (len(t), 3))
            else:
                origin[segment] = origin[parent] + rotations.rotate(turned[parent], PERSON_OFFSETS[segment])
        assert not given, f"no such segments: {given}"
        computed: dict[str, Any] = {
            "time": t,
            "segments": tuple(PARENT),
            "orientation": np.stack(list(turned.values()), axis=1),
            "position": np.stack(list(origin.values()), axis=1),
            "joint_offsets": PERSON_OFFSETS,
        }
        return HumanMotion(**{**computed, **fields})

    return make


@pytest.fixture(scope="session")
def build_robot() -> Callable[[str], Any]:
    """`build_robot(name)` → `RobotModel`, each built once per session."""
    from retarget import robots
    from retarget.core import robot_model

    @cache
    def build(name: str) -> robot_model.RobotModel:
        return robot_model.build(robots.load(name))

    return build
