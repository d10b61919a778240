"""Which tasks a robot follows at which priority [Lim2022 tables II, III]: the profile's own levels, or the paper's on the links
it maps."""

from __future__ import annotations

import numpy as np
from retarget.core.calibration import SIDES
from retarget.core.mapping.arm_frames import arm_frames
from retarget.core.mapping.link_rotations import from_geometry
from retarget.core.profile import Level, LevelTask
from retarget.core.robot_model import RobotModel
from retarget.core.types import Array

HIGH_WEIGHT, LOW_WEIGHT = 50.0, 5.0
"""ρ of [Lim2022 eq. 14] in the authors' code: chest and hands, then what only serves appearance."""
HAND_ORIENTATION_WEIGHT = 0.01
"""(0.1 m)² per rad²: how far a hand's ends move when it turns. In the paper's table 1 rad counts as 1 m, which TOCABI's long arms and free
wrists afford. A shorter arm whose elbow can't bend as far, or whose wrist can't turn as far as a person's, would give up several
centimetres of position for a degree. Mean errors of the hands while the samples carry a box and clap, with 1 and with 0.01:

| robot | box, mm | box, ° | claps, mm | claps, ° |
|---|---|---|---|---|
| g1 | 34 → 10 | 0.5 → 12 | 55 → 17 | 1.0 → 21 |
| icub | 6.0 → 3.6 | 0.0 → 2.2 | 8.2 → 4.7 | 0.1 → 3.2 |
| baxter | 10 → 6 | 0.2 → 2.9 | 16 → 5 | 0.5 → 4.2 |

A level of its own below the position would be no better: where arms are stretched or at a limit the two conflict by a hair's breadth, and
the solution jumps.
"""
ACCELERATION_S2 = 4e-5
"""The authors' 160‖q̇ - q̇_prev‖² at 2 kHz as a factor on ‖q̈‖²."""


def priority_levels(model: RobotModel) -> tuple[Level, ...]:
    """The profile's levels; where it declares none: chest orientation, hands (position, and with little weight orientation) with the
    head's x-axis, normals of the arm planes.

    Derived levels leave out what the robot lacks: a chest that no joint moves, a head, elbows that are no hinges. They keep their
    places, so a level may be empty. Shoulders follow only where a profile names their link, for few robots can shrug.
    """
    if model.profile.hierarchy.levels:
        return model.profile.hierarchy.levels
    constants = from_geometry(model)
    arms = arm_frames(model)
    chest = [LevelTask("T8", "orientation", 100.0)] if _moves(model, "T8") else []
    hands = [LevelTask(f"{side}Hand", "position", 200.0, arms[side].hand_link) for side in SIDES]
    hands += [
        LevelTask(f"{side}Hand", "orientation", 100.0, weight=HAND_ORIENTATION_WEIGHT)
        for side in SIDES
        if _moves(model, f"{side}Hand")
    ]
    if _moves(model, "Head"):
        hands.append(LevelTask("Head", "axis", 200.0, axis=_unit(constants["Head"].T @ [1.0, 0.0, 0.0])))
    upper = [
        LevelTask(limb.segment, "axis", 100.0, axis=_unit(limb.hinge))
        for limb in (model.limbs.get(f"{side}UpperArm") for side in SIDES)
        if limb is not None and limb.hinge is not None
    ]
    return (
        Level(tuple(chest), HIGH_WEIGHT),
        Level(tuple(hands), HIGH_WEIGHT),
        Level(tuple(upper), LOW_WEIGHT, ACCELERATION_S2),
    )


def _moves(model: RobotModel, segment: str) -> bool:
    """Whether the segment's link is mapped and a joint other than the base's own moves it."""
    if segment not in model.links:
        return False
    return model.link_in_joint(model.links[segment])[0] > (1 if model.base_is_floating else 0)


def _unit(axis: Array) -> tuple[float, float, float]:
    x, y, z = axis / np.linalg.norm(axis)
    return float(x), float(y), float(z)
