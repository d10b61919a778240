"""The twist of a limb from the plane that its two bones span, chosen smoothly over the clip.

An elbow or knee that is bent shows its hinge: the normal of the plane of its bones. A straight one does not, and there the segment's own
twist has to do. Measured against that own twist, the plane's angle is nearly constant (a carrying angle, a strapping error): it
can be averaged over a quarter of a second without lagging behind anything.
"""

from __future__ import annotations

import numpy as np
from retarget.core import rotations
from retarget.core.types import Array

STRAIGHT_SINE = 0.15
"""Sine of the bend at which the plane and the segment's own twist count alike."""
OVERSTRETCHED_SINE = 0.5
"""Sine of the bend below which a plane that contradicts the own twist shows a joint bent the wrong way, above it a wrong twist."""
WINDOW_S = 0.25


def hinge_directions(time: Array, upper: Array, lower: Array, own_hinge: Array, flexion: float) -> Array:
    """World directions (T, 3) of the limb's hinge, unit and perpendicular to `upper`.

    time: (T,) s. upper, lower: (T, 3) unit bone directions, world. own_hinge: (T, 3) unit, the upper segment's own hinge axis, world.
    flexion: +1 where bending turns the lower bone about +hinge, -1 where about -hinge.

    The plane normal n = ± upper × lower is known to about 1/sin(bend), so it weighs sin²(bend) against STRAIGHT_SINE² for the own
    twist; angles are averaged as vectors in the plane across the bone, weights and all.
    """
    own = own_hinge - np.einsum("ti,ti->t", own_hinge, upper)[:, None] * upper
    own /= np.linalg.norm(own, axis=1, keepdims=True)
    normal = flexion * np.cross(upper, lower)  # length sin(bend)
    sine = np.linalg.norm(normal, axis=1)
    across = np.cross(upper, own)
    # |n|·(cos φ, sin φ), once more times |n| for the weight: no division by a vanishing sine anywhere.
    cosine, sine_angle = (sine * np.einsum("ti,ti->t", normal, axis) for axis in (own, across))
    trust = _trust(cosine, sine_angle, sine)
    cosine = _average(time, trust * cosine + STRAIGHT_SINE**2)
    sine_angle = _average(time, trust * sine_angle)
    angle = np.arctan2(sine_angle, cosine)[:, None]
    return np.asarray(np.cos(angle) * own + np.sin(angle) * across)


def _trust(cosine: Array, sine_angle: Array, sine: Array) -> Array:
    """Factor (T,) in [-1, 1] on the plane's word: 1 but where it contradicts the own twist, by more than a right angle.

    Elbows and knees overstretch by some 10°, which turns the normal around while the hinge stays: there the factor is negative. Yet
    recordings whose own twist is wrong by a right angle and more exist, and a limb bent far shows its plane beyond doubt.
    """
    contradiction = np.minimum(cosine, 0.0) ** 2 / np.maximum(cosine**2 + sine_angle**2, np.finfo(float).tiny)
    far = (sine**2 - OVERSTRETCHED_SINE**2) / (sine**2 + OVERSTRETCHED_SINE**2)  # -1 straight, 1 bent far
    return np.asarray(1.0 + (far - 1.0) * contradiction)


def _average(time: Array, values: Array) -> Array:
    from retarget.core.timebase import smooth

    return smooth(time, values, WINDOW_S)


def frame_from_bone(bone: Array, hinge: Array, *, left: bool, arm: bool) -> Array:
    """Orientations (T, 4) wxyz, world ← segment, whose bone points along `bone` and whose hinge is as near to `hinge` as that allows.

    T-pose axes: an arm's bone is +y (left) or -y (right) and its hinge z; a leg's bone is -z and its hinge y. bone, hinge: (T, 3).
    """
    across = hinge - np.einsum("ti,ti->t", hinge, bone)[:, None] * bone
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    if arm:
        y, z = (bone if left else -bone), across
    else:
        y, z = across, -bone
    return rotations.make_continuous(rotations.from_matrix(np.stack([np.cross(y, z), y, z], axis=-1)))
