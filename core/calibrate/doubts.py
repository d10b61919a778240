"""What in a calibration is doubtful, one sentence each; none of it stops anyone."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from retarget.core import rotations
from retarget.core.calibrate import poses
from retarget.core.calibrate.person import Person
from retarget.core.calibrate.roles import TRACKED
from retarget.core.calibration import POSE_NAMES, POSES, SIDES

DOUBTFUL_SPREAD_M = 0.08
DOUBTFUL_FACING_DEG = 15.0
DOUBTFUL_MOTION_M = 0.03
DOUBTFUL_LENGTHS = 0.1
DOUBTFUL_OFFSET_DEG = 60.0


def warnings_of(residuals: Mapping[str, float], person: Person, trackers: Mapping[str, str]) -> list[str]:
    """Of poses, shoulders, facing direction and trackers; residuals: `Person.residuals`, trackers: segment → tracker."""
    found = []
    hands = {side: arm.hand_points for side, arm in person.arms.items()}
    for side in SIDES:
        if (spread := residuals[f"shoulder_spread_m/{side}"]) > DOUBTFUL_SPREAD_M:
            pose = POSE_NAMES[POSES[poses.least_trusted(hands, [side])[1].pose]]
            found.append(
                f"{side.lower()} arm: the estimates of the shoulder lie {1000 * spread:.0f} mm apart; the {pose} fits least"
            )
        for pose in POSES:
            if (motion := residuals[f"hand_motion_m/{side}/{pose}"]) > DOUBTFUL_MOTION_M:
                found.append(f"{side.lower()} arm, {POSE_NAMES[pose]}: the hand moves by {1000 * motion:.0f} mm (RMS)")
    if (angle := residuals["facing_disagreement_deg"]) > DOUBTFUL_FACING_DEG:
        found.append(f"T-pose and Forward pose disagree by {angle:.0f}° about where the person faces")
    lengths = [arm.length_m for arm in person.arms.values()]
    if max(lengths) > (1 + DOUBTFUL_LENGTHS) * min(lengths):
        found.append(
            "arm lengths differ: " + ", ".join(f"{s.lower()} {a.length_m:.3f} m" for s, a in person.arms.items())
        )
    if lacking := [name for name in TRACKED if name not in trackers and name != "Pelvis"]:
        found.append(f"no tracker on {', '.join(lacking)}")
    return found


def offset_warnings(person: Person) -> list[str]:
    """The default offset belongs to one way of mounting: say when it points across the arm."""
    found = []
    for side, offset in person.offsets.items():
        if not offset.any():
            continue
        in_hand = rotations.rotate(rotations.conjugate(person.mounts[f"{side}Hand"]), offset)
        off = float(np.degrees(np.arccos(np.clip(abs(in_hand[1]) / np.linalg.norm(offset), 0, 1))))
        if off > DOUBTFUL_OFFSET_DEG:
            shown = ", ".join(f"{value:g}" for value in offset)
            found.append(
                f"{side.lower()} hand: the default hand offset ({shown}) m points {off:.0f}° off the arm with this mount; "
                "measure it and give --hand-offset, or --hand-offset-frame hand"
            )
    return found
