"""Published norms of human walking, and the curves through them.

Sagittal joint angles over one stride, heel strike to heel strike of the same foot, in steps of 5 %, in whole degrees: mean
curves of healthy adults at natural cadence after Winter, "The Biomechanics and Motor Control of Human Gait" (2nd ed., 1991),
in agreement with the values at the ends of the gait phases in Perry & Burnfield, "Gait Analysis: Normal and Pathological
Function" (2nd ed., 2010). Published means differ between laboratories by some degrees; these are rounded values of the common
shape.

Flexion and dorsiflexion are positive. The hip angle is that of the thigh to the pelvis, standing upright being zero.
"""

from __future__ import annotations

from typing import Final

from retarget.samples.curves import periodic

HIP_FLEXION_DEG: Final = (20, 20, 18, 15, 11, 7, 3, -1, -5, -8, -10, -9, -4, 4, 12, 18, 21, 22, 22, 21)
KNEE_FLEXION_DEG: Final = (5, 11, 17, 19, 18, 15, 12, 9, 7, 8, 12, 21, 35, 51, 61, 62, 55, 41, 23, 9)
ANKLE_DORSIFLEXION_DEG: Final = (0, -4, -3, 1, 4, 6, 7, 8, 10, 10, 7, -2, -14, -17, -11, -5, -2, 0, 1, 1)

TOE_OFF: Final = 0.62
"""End of stance, fraction of the stride."""

hip_flexion_deg = periodic(HIP_FLEXION_DEG)
knee_flexion_deg = periodic(KNEE_FLEXION_DEG)
ankle_dorsiflexion_deg = periodic(ANKLE_DORSIFLEXION_DEG)
