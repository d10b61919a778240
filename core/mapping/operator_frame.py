"""The operator as the calibration saw them: a motion in the operator frame, whatever way the person has turned since.

A robot that stands still can't walk off with the person: where the pelvis is tracked, the frame goes along with it, turning about
the vertical only; without it the frame stays where it was in the Still pose [Lim2022, the authors' code]. A robot without a waist
(`base_segment` T8) gets the frame of the chest. Done twice it changes nothing, so it does not matter whether the heading had been
taken out before.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from retarget.core import rotations
from retarget.core.calibration import Calibration
from retarget.core.types import Array, HumanMotion


def in_operator_frame(motion: HumanMotion, calibration: Calibration, segment: str = "Pelvis") -> HumanMotion:
    """The motion in the operator frame of `calibration`: X forward, Y left, Z up, origin at the pelvis of the Still pose.

    segment: "Pelvis" or "T8", which carries the frame; where it isn't measured the frame stands still, and a motion of calibrated
    trackers, which is in it already (`core.calibrate.apply`), is returned as it is. In the Still pose the result is the same
    either way. Angular velocities are dropped: they would hold the frame's own rate.
    """
    segment = "T8" if segment == "T8" else "Pelvis"
    if calibration.trackers and not motion.has(segment):
        return motion
    if motion.has(segment):
        index = motion.index(segment)
        still = calibration.chest_orientation if segment == "T8" else calibration.still_orientation.get(segment)
        heading = np.unwrap(rotations.yaw(motion.orientation[:, index])) - (
            0.0 if still is None else rotations.yaw(still)
        )
    else:
        heading = np.full(motion.frames, calibration.heading_rad)
    centre: Array = np.broadcast_to(calibration.origin, (motion.frames, 3))
    anchor = np.zeros(3)
    if motion.has(segment) and np.isfinite(motion.position[:, motion.index(segment)]).all():
        centre = motion.position[:, motion.index(segment)]
        anchor = calibration.chest_position if segment == "T8" else anchor
    turn = rotations.about_z(-heading)[:, None]
    return replace(
        motion,
        orientation=rotations.make_continuous(rotations.multiply(turn, motion.orientation)),
        position=anchor + rotations.rotate(turn, motion.position - centre[:, None]),
        angular_velocity=None,
    )
