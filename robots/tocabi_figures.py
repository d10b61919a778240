"""TOCABI in figures: kinematics, inertias, motors, and a body of simple shapes. `robots/tocabi.urdf` is written from these alone.

Joint frames, axes, position limits, masses, centres of mass and inertias are the figures of the makers' own published description of the
robot (Dynamic Robotic Systems laboratory, Seoul National University; [Lim2022 sec. II-A]: 33 joints). Shapes are ours: nothing but the
joints' places is behind them.

Two things about these figures have to be known:

- Many inertias hold the motor's rotor as the gear reflects it, on the joint's own axis: R_HipRoll_Link, which turns about z, has izz =
  0.29 beside ixx = 0.018 kg m². No rigid body has such a tensor (no principal moment may exceed the sum of the other two). They are kept as
  published, because the joint feels them; whoever simulates single bodies has to balance them first.
- ±3.14 rad at the legs are placeholders; the profile narrows them.
"""

from __future__ import annotations

from dataclasses import replace
from fnmatch import fnmatchcase

from retarget.robots.urdf_writer import Box, Cylinder, Drive, Inertia, Joint, Shape, Sphere

NAME = "tocabi"
COMMENT = "Written by retarget.robots.generate from retarget.robots.tocabi_figures: change these, not this file."

# fmt: off
JOINTS: tuple[Joint, ...] = (
    Joint("R_HipYaw_Joint", "Pelvis_Link", "R_HipRoll_Link", (0.11, -0.1025, -0.1025), (0, 0, 0), (0, 0, 1), -3.14, 3.14),
    Joint("R_HipRoll_Joint", "R_HipRoll_Link", "R_HipCenter_Link", (0, 0, 0), (0, 0, 0), (1, 0, 0), -3.14, 3.14),
    Joint("R_HipPitch_Joint", "R_HipCenter_Link", "R_Thigh_Link", (0, 0, 0), (0, 0, 0), (0, 1, 0), -3.14, 3.14),
    Joint("R_Knee_Joint", "R_Thigh_Link", "R_Knee_Link", (0, 0, -0.35), (0, 0, 0), (0, 1, 0), -3.14, 3.14),
    Joint("R_AnklePitch_Joint", "R_Knee_Link", "R_AnkleCenter_Link", (0, 0, -0.35), (0, 0, 0), (0, 1, 0), -3.14, 3.14),
    Joint("R_AnkleRoll_Joint", "R_AnkleCenter_Link", "R_AnkleRoll_Link", (0, 0, 0), (0, 0, 0), (1, 0, 0), -3.14, 3.14),
    Joint("R_Foot_Joint", "R_AnkleRoll_Link", "R_Foot_Link", (0, 0, 0), (0, 0, 0)),
    Joint("L_HipYaw_Joint", "Pelvis_Link", "L_HipRoll_Link", (0.11, 0.1025, -0.1025), (0, 0, 0), (0, 0, 1), -3.14, 3.14),
    Joint("L_HipRoll_Joint", "L_HipRoll_Link", "L_HipCenter_Link", (0, 0, 0), (0, 0, 0), (1, 0, 0), -3.14, 3.14),
    Joint("L_HipPitch_Joint", "L_HipCenter_Link", "L_Thigh_Link", (0, 0, 0), (0, 0, 0), (0, 1, 0), -3.14, 3.14),
    Joint("L_Knee_Joint", "L_Thigh_Link", "L_Knee_Link", (0, 0, -0.35), (0, 0, 0), (0, 1, 0), -3.14, 3.14),
    Joint("L_AnklePitch_Joint", "L_Knee_Link", "L_AnkleCenter_Link", (0, 0, -0.35), (0, 0, 0), (0, 1, 0), -3.14, 3.14),
    Joint("L_AnkleRoll_Joint", "L_AnkleCenter_Link", "L_AnkleRoll_Link", (0, 0, 0), (0, 0, 0), (1, 0, 0), -3.14, 3.14),
    Joint("L_Foot_Joint", "L_AnkleRoll_Link", "L_Foot_Link", (0, 0, 0), (0, 0, 0)),
    Joint("Waist1_Joint", "Pelvis_Link", "Waist1_Link", (0.11, 0, 0.1979), (0, 0, 0), (0, 0, 1), -2.094, 2.094),
    Joint("Waist2_Joint", "Waist1_Link", "Waist2_Link", (0, 0, 0), (0, 0, 0), (0, 1, 0), -2.094, 2.094),
    Joint("Upperbody_Joint", "Waist2_Link", "Upperbody_Link", (0, 0, 0), (0, 0, 0), (-1, 0, 0), -2.094, 2.094),
    Joint("Neck_Joint", "Upperbody_Link", "Neck_Link", (-0.036, 0, 0.3795), (0, 0, 0), (0, 0, 1), -1.54, 1.54),
    Joint("Head_Joint", "Neck_Link", "Head_Link", (0, 0, 0.0275), (0, 0, 0), (0, 1, 0), -1.54, 1.54),
    Joint("L_Shoulder1_Joint", "Upperbody_Link", "L_Shoulder1_Link", (0.023, 0.154, 0.2275), (0, 0, 0), (0, 0, 1), -2.09, 1.54),
    Joint("L_Shoulder2_Joint", "L_Shoulder1_Link", "L_Shoulder2_Link", (0, 0.0341, 0.065), (0, 0, 0), (0, 1, 0), -3.14159, 3.14159),
    Joint("L_Shoulder3_Joint", "L_Shoulder2_Link", "L_Shoulder3_Link", (0, 0.115, 0), (0, 0, 0), (-1, 0, 0), -1.9199, 1.9199),
    Joint("L_Armlink_Joint", "L_Shoulder3_Link", "L_Armlink_Link", (0, 0.1281, 0), (0, 0, 0), (0, 1, 0), -3.14159, 3.14159),
    Joint("L_Elbow_Joint", "L_Armlink_Link", "L_Elbow_Link", (0, 0.207, -0.0325), (0, 0, 0), (1, 0, 0), -3.14159, 2.8),
    Joint("L_Forearm_Joint", "L_Elbow_Link", "L_Forearm_Link", (0, 0.1244, 0.0325), (0, 0, 0), (0, 1, 0), -3.14159, 3.14159),
    Joint("L_Wrist1_Joint", "L_Forearm_Link", "L_Wrist1_Link", (0, 0.1451, 0), (0, 0, 0), (1, 0, 0), -3.14159, 3.14159),
    Joint("L_Wrist2_Joint", "L_Wrist1_Link", "L_Wrist2_Link", (0, 0.046, 0), (1.5708, 3.1415, 0), (0, 1, 0), -2.094, 2.094),
    Joint("R_Shoulder1_Joint", "Upperbody_Link", "R_Shoulder1_Link", (0.023, -0.154, 0.2275), (0, 0, 0), (0, 0, 1), -1.54, 2.09),
    Joint("R_Shoulder2_Joint", "R_Shoulder1_Link", "R_Shoulder2_Link", (0, -0.0341, 0.065), (0, 0, 0), (0, -1, 0), -3.14159, 3.14159),
    Joint("R_Shoulder3_Joint", "R_Shoulder2_Link", "R_Shoulder3_Link", (0, -0.115, 0), (0, 0, 0), (-1, 0, 0), -1.9199, 1.9199),
    Joint("R_Armlink_Joint", "R_Shoulder3_Link", "R_Armlink_Link", (0, -0.1281, 0), (0, 0, 0), (0, -1, 0), -3.14159, 3.14159),
    Joint("R_Elbow_Joint", "R_Armlink_Link", "R_Elbow_Link", (0, -0.207, -0.0325), (0, 0, 0), (1, 0, 0), -2.967, 3.14159),
    Joint("R_Forearm_Joint", "R_Elbow_Link", "R_Forearm_Link", (0, -0.1244, 0.0325), (0, 0, 0), (0, -1, 0), -3.14159, 3.14159),
    Joint("R_Wrist1_Joint", "R_Forearm_Link", "R_Wrist1_Link", (0, -0.1451, 0), (0, 0, 0), (1, 0, 0), -3.14159, 3.14159),
    Joint("R_Wrist2_Joint", "R_Wrist1_Link", "R_Wrist2_Link", (0, -0.046, 0), (-1.5708, 3.1415, 0), (0, -1, 0), -2.094, 2.094),
)

INERTIAS: dict[str, Inertia] = {
    "Pelvis_Link": Inertia(12.1952, (0.07809, 0, 0.03985), (0.101833, 0.0724007, 0.144478, -7.0812e-05, -0.0038311, 7.9272e-05)),
    "R_HipRoll_Link": Inertia(2.679, (-0.06477, 0, 0.05149), (0.01821, 0.03121, 0.2928, -1.676e-07, -0.0007745, -4.53e-09)),
    "R_HipCenter_Link": Inertia(2.67, (-0.04801, -0.0022, 2e-05), (0.3553, 0.009161, 0.00876, 1.725e-08, -3.236e-06, -4.778e-06)),
    "R_Thigh_Link": Inertia(5.366, (-0.00042, -0.00032, -0.18904), (0.2987, 0.7088, 0.00982, -4.284e-05, -0.000196, 0.002406)),
    "R_Knee_Link": Inertia(3.883, (0.00429, 0.00214, -0.1428), (0.1506, 0.5588, 0.007451, -2.887e-05, -0.002607, -0.001486)),
    "R_AnkleCenter_Link": Inertia(2.51, (-0.00419, -0.0018, -0.0003), (0.002857, 0.4135, 0.003345, -1.422e-07, 2.222e-06, 4.611e-06)),
    "R_AnkleRoll_Link": Inertia(1.26426, (-0.05196, 5e-05, -0.0219), (0.418697, 0.0062114, 0.00857551, 1.5176e-08, -0.00109598, -5.435e-08)),
    "R_Foot_Link": Inertia(2.326, (0.0162, 8e-05, -0.1209), (0.00338641, 0.0126001, 0.014296, 1.1237e-05, -0.000526477, -1.976e-06)),
    "L_HipRoll_Link": Inertia(2.679, (-0.06477, 0, 0.05149), (0.01821, 0.03121, 0.2928, -1.676e-07, -0.0007745, -4.53e-09)),
    "L_HipCenter_Link": Inertia(2.67, (-0.04801, 0.0022, 2e-05), (0.3553, 0.009161, 0.00876, 1.725e-08, -3.236e-06, -4.778e-06)),
    "L_Thigh_Link": Inertia(5.366, (-0.00042, 0.00032, -0.18904), (0.2987, 0.7088, 0.00982, -4.284e-05, -0.000196, 0.002406)),
    "L_Knee_Link": Inertia(3.883, (0.00429, -0.00214, -0.1428), (0.1506, 0.5588, 0.007451, -2.887e-05, -0.002607, -0.001486)),
    "L_AnkleCenter_Link": Inertia(2.51, (-0.00419, 0.0018, -0.0003), (0.002857, 0.4135, 0.003345, -1.422e-07, 2.222e-06, 4.611e-06)),
    "L_AnkleRoll_Link": Inertia(1.26426, (-0.05196, 5e-05, -0.0219), (0.418697, 0.0062114, 0.00857551, 1.5176e-08, -0.00109598, -5.435e-08)),
    "L_Foot_Link": Inertia(2.326, (0.0162, 8e-05, -0.1209), (0.00338641, 0.0126001, 0.014296, 1.1237e-05, -0.000526477, -1.976e-06)),
    "Waist1_Link": Inertia(0.89722, (0, 0, -0.03647), (0.00374423, 0.00203096, 1.00772, -2.3489e-05, 3.7149e-05, -0.00042489)),
    "Waist2_Link": Inertia(3.752, (-0.00029, 0, 0), (0.00602061, 1.01171, 0.00756169, 1.1504e-05, -5.3e-08, 1.147e-06)),
    "Upperbody_Link": Inertia(18.1338, (-0.07294, 0, 0.16798), (1.27079, 0.238938, 0.179864, 0.000113985, 0.0295335, -2.8977e-05)),
    "Neck_Link": Inertia(0.248, (0, 0, -0.0023), (5.8259e-05, 3.6489e-05, 5.8237e-05, -7.6e-08, 2.68e-07, -1.002e-06)),
    "Head_Link": Inertia(1.417, (0.05, 0, 0.071), (0.0079, 0.012, 0.01, 0, 0.0025, 0)),
    "L_Shoulder1_Link": Inertia(1.6762, (-3e-05, 0.00397, 0.06029), (0.00192561, 0.00193658, 0.18533, 1.433e-06, 2.313e-06, 7.8962e-05)),
    "L_Shoulder2_Link": Inertia(0.4016, (0.00107, 0.0491, -1e-05), (0.000989903, 0.184276, 0.00106758, 2.8237e-05, -4.65e-07, 1.33e-07)),
    "L_Shoulder3_Link": Inertia(2.90141, (0.00262, 0.04826, 0.00023), (0.192093, 0.00249378, 0.00829685, -0.000365084, -2.746e-06, -2.3821e-05)),
    "L_Armlink_Link": Inertia(0.58517, (-0.01896, 0.11642, -0.0119), (0.00287861, 0.184382, 0.00311706, 0.000302586, -3.6001e-05, 0.000398377)),
    "L_Elbow_Link": Inertia(2.06511, (-0.00136, 0.05256, 0.01764), (0.0558655, 0.00189554, 0.00595882, 0.000151764, 5.5158e-05, 0.00153092)),
    "L_Forearm_Link": Inertia(0.35234, (-0.01426, 0.0767, 0.00033), (0.00105364, 0.0498895, 0.00126642, 8.4568e-05, 2.2117e-05, 1.9539e-05)),
    "L_Wrist1_Link": Inertia(0.70923, (-0.00158, 0.02153, 3e-05), (0.0152052, 0.000396376, 0.000683187, 2.4218e-05, -2.63e-07, 6.88e-07)),
    "L_Wrist2_Link": Inertia(0.1, (0.00063, 0.0636, 0.00178), (0.00086545, 0.000696917, 0.0153778, 0, 0, 0)),
    "R_Shoulder1_Link": Inertia(1.6762, (-3e-05, -0.00397, 0.06029), (0.00192561, 0.00193658, 0.18533, -1.433e-06, 2.313e-06, -7.8962e-05)),
    "R_Shoulder2_Link": Inertia(0.4016, (0.00107, -0.0491, -1e-05), (0.000989903, 0.184276, 0.00106758, -2.8237e-05, -4.65e-07, -1.33e-07)),
    "R_Shoulder3_Link": Inertia(2.90141, (0.00262, -0.04826, 0.00023), (0.192093, 0.00249378, 0.00829685, 0.000365084, -2.746e-06, 2.3821e-05)),
    "R_Armlink_Link": Inertia(0.58517, (-0.01896, -0.11642, -0.0119), (0.00287861, 0.184382, 0.00311706, -0.000302586, -3.6001e-05, -0.000398377)),
    "R_Elbow_Link": Inertia(2.06511, (-0.00136, -0.05256, 0.01764), (0.0558655, 0.00189554, 0.00595882, -0.000151764, 5.5158e-05, -0.00153092)),
    "R_Forearm_Link": Inertia(0.35234, (-0.01426, -0.0767, 0.00033), (0.00105364, 0.0498895, 0.00126642, -8.4568e-05, 2.2117e-05, -1.9539e-05)),
    "R_Wrist1_Link": Inertia(0.70923, (-0.00158, -0.02153, 3e-05), (0.0152052, 0.000396376, 0.000683187, -2.4218e-05, -2.63e-07, -6.88e-07)),
    "R_Wrist2_Link": Inertia(0.1, (0.00063, -0.0636, 0.00178), (0.00086545, 0.000696917, 0.0153778, 0, 0, 0)),
}
# fmt: on

SPEED_RAD_S = 6.2832
"""One turn a second for every joint. The published description says 100, a placeholder. The makers' public controllers allow the legs, the
neck and the forearms 2π, the rest of the upper body π to 2π in different versions, the first shoulder joint π/3, which is tuning: it carries the
whole arm. What the motors can do is not published."""

TORQUE_NM = {
    "*_HipYaw_Joint": 333.0,
    "*_HipRoll_Joint": 232.0,
    "*_HipPitch_Joint": 263.0,
    "*_Knee_Joint": 289.0,
    "*_AnklePitch_Joint": 222.0,
    "*_AnkleRoll_Joint": 166.0,
    "Waist*_Joint": 303.0,
    "Upperbody_Joint": 303.0,
    "*_Shoulder?_Joint": 64.0,
    "*_Armlink_Joint": 64.0,
    "*_Elbow_Joint": 23.0,
    "*_Forearm_Joint": 23.0,
    "*_Wrist?_Joint": 10.0,
    "Neck_Joint": 10.0,
    "Head_Joint": 10.0,
}
"""Joints → largest torque, as the makers' public simulation has it; the description's 500 Nm is a placeholder."""

DRIVES: dict[str, Drive] = {
    joint.name: Drive(torque, SPEED_RAD_S)
    for joint in JOINTS
    for pattern, torque in TORQUE_NM.items()
    if joint.axis is not None and fnmatchcase(joint.name, pattern)
}

SOLE_CENTRE_M = (0.03, 0.0, -0.1585)
SOLE_HALF_M = (0.13, 0.06)
"""Where the foot touches the ground, in the frame of the ankle: contact point and half lengths that the makers' public controllers assume."""
SOLE_THICKNESS_M = 0.03

_MIDDLE: dict[str, tuple[Shape, ...]] = {
    "Pelvis_Link": (
        Box((0.20, 0.22, 0.10), (0.09, 0.0, 0.05)),
        Cylinder(0.05, (0.11, 0.0, 0.05), (0.11, 0.0, 0.15), solid=False),
    ),
    "Waist1_Link": (Cylinder(0.06, (0.0, 0.0, -0.05), (0.0, 0.0, 0.03), solid=False),),
    "Waist2_Link": (Cylinder(0.05, (0.0, -0.08, 0.0), (0.0, 0.08, 0.0), solid=False),),
    "Upperbody_Link": (
        Box((0.18, 0.24, 0.28), (-0.04, 0.0, 0.20)),
        Cylinder(0.04, (0.023, -0.154, 0.20), (0.023, 0.154, 0.20), solid=False),
    ),
    "Neck_Link": (Cylinder(0.035, (0.0, 0.0, -0.04), (0.0, 0.0, 0.03), solid=False),),
    "Head_Link": (Box((0.17, 0.15, 0.20), (0.03, 0.0, 0.12)),),
}
_LEFT: dict[str, tuple[Shape, ...]] = {
    "HipRoll_Link": (Cylinder(0.05, (-0.06, 0.0, 0.0), (-0.06, 0.0, 0.10), solid=False),),
    "HipCenter_Link": (Cylinder(0.05, (-0.09, 0.0, 0.0), (0.05, 0.0, 0.0), solid=False),),
    "Thigh_Link": (Cylinder(0.065, (0.0, 0.0, -0.05), (0.0, 0.0, -0.30)),),
    "Knee_Link": (
        Cylinder(0.05, (0.0, -0.06, 0.0), (0.0, 0.06, 0.0), solid=False),
        Cylinder(0.055, (0.0, 0.0, -0.05), (0.0, 0.0, -0.28)),
    ),
    "AnkleCenter_Link": (Cylinder(0.035, (0.0, -0.05, 0.0), (0.0, 0.05, 0.0), solid=False),),
    "AnkleRoll_Link": (Cylinder(0.035, (-0.06, 0.0, 0.0), (0.06, 0.0, 0.0), solid=False),),
    "Foot_Link": (
        Cylinder(0.04, (0.0, 0.0, -0.04), (0.0, 0.0, SOLE_CENTRE_M[2] + SOLE_THICKNESS_M)),
        Box(
            (2 * SOLE_HALF_M[0], 2 * SOLE_HALF_M[1], SOLE_THICKNESS_M),
            (SOLE_CENTRE_M[0], SOLE_CENTRE_M[1], SOLE_CENTRE_M[2] + SOLE_THICKNESS_M / 2),
        ),
    ),
    "Shoulder1_Link": (Cylinder(0.04, (0.0, 0.0, 0.0), (0.0, 0.0, 0.10)),),
    "Shoulder2_Link": (Cylinder(0.04, (0.0, 0.02, 0.0), (0.0, 0.08, 0.0)),),
    "Shoulder3_Link": (Sphere(0.045, (0.0, 0.0, 0.0), solid=False), Cylinder(0.04, (0.0, 0.03, 0.0), (0.0, 0.11, 0.0))),
    "Armlink_Link": (Cylinder(0.04, (0.0, 0.02, 0.0), (0.0, 0.17, 0.0)),),
    "Elbow_Link": (
        Cylinder(0.035, (-0.05, 0.0, 0.0), (0.05, 0.0, 0.0), solid=False),
        Cylinder(0.035, (0.0, 0.03, 0.02), (0.0, 0.115, 0.0325)),
    ),
    "Forearm_Link": (Cylinder(0.035, (0.0, 0.01, 0.0), (0.0, 0.11, 0.0)),),
    "Wrist1_Link": (
        Sphere(0.03, (0.0, 0.0, 0.0), solid=False),
        Cylinder(0.025, (0.0, 0.0, 0.0), (0.0, 0.03, 0.0)),
    ),
}
_HAND = Box((0.04, 0.08, 0.14), (0.0, 0.0, -0.10))
"""Both hand frames have -z toward the fingers and x out of the palm."""


def _mirrored(shape: Shape) -> Shape:
    """The same shape on the right side."""
    if isinstance(shape, Cylinder):
        (x0, y0, z0), (x1, y1, z1) = shape.start, shape.end
        return replace(shape, start=(x0, -y0, z0), end=(x1, -y1, z1))
    x, y, z = shape.centre
    return replace(shape, centre=(x, -y, z))


SHAPES: dict[str, tuple[Shape, ...]] = {
    **_MIDDLE,
    **{f"L_{link}": shapes for link, shapes in _LEFT.items()},
    **{f"R_{link}": tuple(_mirrored(shape) for shape in shapes) for link, shapes in _LEFT.items()},
    "L_Wrist2_Link": (_HAND,),
    "R_Wrist2_Link": (_HAND,),
}
