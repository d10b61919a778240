"""Taking the person's heading out of a motion, for robots whose base stands still."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from retarget.core import rotations
from retarget.core.types import HumanMotion


def without_heading(motion: HumanMotion, segment: str) -> HumanMotion:
    """The motion turned about world Z, frame by frame, so that `segment` always faces +X; positions relative to that segment.

    Only the heading goes: a person who bends forward still bends forward. A motion without `segment` is returned unchanged.
    Angular velocities lose the heading's own rate.
    """
    if not motion.has(segment):
        return motion
    index = motion.index(segment)
    heading = np.unwrap(rotations.yaw(motion.orientation[:, index]))
    turn = rotations.about_z(-heading)[:, None]
    position = rotations.rotate(turn, motion.position - np.nan_to_num(motion.position[:, index : index + 1]))
    omega = motion.angular_velocity
    if omega is not None:
        rate = np.gradient(heading, motion.time) if motion.frames > 1 else np.zeros(1)
        omega = rotations.rotate(turn, omega) - rate[:, None, None] * np.array([0.0, 0.0, 1.0])
    return replace(
        motion,
        orientation=rotations.make_continuous(rotations.multiply(turn, motion.orientation)),
        position=position,
        angular_velocity=omega,
    )
