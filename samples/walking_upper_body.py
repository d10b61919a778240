"""Trunk, head and arms in walking.

Arm swing after Murray, Sepic & Barnard, "Patterns of sagittal rotation of the upper limbs in walking" (1967): the shoulder
moves through some 30°, most extended at the same side's heel strike, the elbow flexes between about 20° and 45°. The chest
turns against the pelvis, the head stays level and looks where the path goes.
"""

from __future__ import annotations

import numpy as np
from retarget.core.types import Array
from retarget.samples import steps, upper_body

_LOOK_AHEAD = 0.45
"""m along the path."""


def upper_body_in_walking(time: Array, phase: Array) -> dict[str, Array]:
    """Joint rotations (T, 4) from L5 up at `time` (T,) s; phase: (T,) strides since a heel strike of the left foot."""
    amount, angle = steps.pace(time), 2 * np.pi * phase
    way = steps.distance(time)
    look = steps.heading(way + _LOOK_AHEAD * amount) - steps.heading(way)
    joints = upper_body.trunk(
        flexion=np.radians(1.0 + amount * 2.0),
        sidebend=-np.radians(amount * 3.0 * np.cos(angle - 0.9)),
        rotation=np.radians(amount * 7.5 * np.cos(angle)),
    )
    joints |= upper_body.head(
        flexion=-np.radians(amount * (3.0 + 1.0 * np.cos(2 * angle))),
        sidebend=np.zeros(len(time)),
        rotation=look - np.radians(amount * 3.0 * np.cos(angle)),
    )
    for side, own in (("Left", angle), ("Right", angle + np.pi)):
        bending = np.cos(own - 0.35)
        joints |= upper_body.Arm(
            lowering=np.full(len(time), np.radians(84.0)),
            flexion=np.radians(2.0 + amount * (-6.0 - 15.0 * np.cos(own))),
            across=np.zeros(len(time)),
            twist=np.full(len(time), np.radians(5.0)),
            elbow=np.radians(14.0 + amount * (16.0 - 12.0 * bending)),
            pronation=np.radians(8.0 + amount * (6.0 - 6.0 * bending)),
            wrist=np.full(len(time), np.radians(5.0)),
            deviation=np.zeros(len(time)),
        ).rotations_of(side)
    return joints
