"""Atlas (v5, as in the DARPA Robotics Challenge) in figures, and a body of simple shapes. `robots/atlas.urdf` is written from these alone.

Joint frames, axes, limits, motors, masses, centres of mass and inertias are the figures of the robot's published description; links without a
body (frames, cameras of 0.1 kg) are left out. Shapes and soles are ours: nothing but the joints' places and the centres of mass is behind them.
"""

from __future__ import annotations

from retarget.robots.urdf_writer import Box, Cylinder, Drive, Inertia, Joint, Shape, Sphere, on_both_sides

NAME = "atlas"
COMMENT = "Written by retarget.robots.generate from retarget.robots.atlas_figures: change these, not this file."

# fmt: off
JOINTS: tuple[Joint, ...] = (
    Joint("back_bkx", "mtorso", "utorso", (0, 0, 0.05), (0, 0, 0), (1, 0, 0), -0.523599, 0.523599),
    Joint("back_bky", "ltorso", "mtorso", (0, 0, 0.162), (0, 0, 0), (0, 1, 0), -0.219388, 0.538783),
    Joint("back_bkz", "pelvis", "ltorso", (-0.0125, 0, 0), (0, 0, 0), (0, 0, 1), -0.663225, 0.663225),
    Joint("l_arm_elx", "l_uarm", "l_larm", (0, 0.119, 0.0092), (0, 0, 0), (1, 0, 0), 0, 2.35619),
    Joint("l_arm_ely", "l_scap", "l_uarm", (0, 0.187, -0.016), (0, 0, 0), (0, 1, 0), 0, 3.14159),
    Joint("l_arm_shx", "l_clav", "l_scap", (0, 0.11, -0.245), (0, 0, 0), (1, 0, 0), -1.5708, 1.5708),
    Joint("l_arm_shz", "utorso", "l_clav", (0.1406, 0.2256, 0.4776), (0, 0, 0), (0, 0, 1), -1.5708, 0.785398),
    Joint("l_arm_wrx", "l_ufarm", "l_lfarm", (0, 0, 0), (0, 0, 0), (1, 0, 0), -1.7628, 1.7628),
    Joint("l_arm_wry", "l_larm", "l_ufarm", (0, 0.29955, -0.00921), (0, 0, 0), (0, 1, 0), -3.011, 3.011),
    Joint("l_arm_wry2", "l_lfarm", "l_hand", (0, 0, 0), (0, 0, 0), (0, 1, 0), -2.9671, 2.9671),
    Joint("l_leg_akx", "l_talus", "l_foot", (0, 0, 0), (0, 0, 0), (1, 0, 0), -0.8, 0.8),
    Joint("l_leg_aky", "l_lleg", "l_talus", (0, 0, -0.422), (0, 0, 0), (0, 1, 0), -1, 0.7),
    Joint("l_leg_hpx", "l_uglut", "l_lglut", (0, 0, 0), (0, 0, 0), (1, 0, 0), -0.523599, 0.523599),
    Joint("l_leg_hpy", "l_lglut", "l_uleg", (0.05, 0.0225, -0.066), (0, 0, 0), (0, 1, 0), -1.61234, 0.65764),
    Joint("l_leg_hpz", "pelvis", "l_uglut", (0, 0.089, 0), (0, 0, 0), (0, 0, 1), -0.174358, 0.786794),
    Joint("l_leg_kny", "l_uleg", "l_lleg", (-0.05, 0, -0.374), (0, 0, 0), (0, 1, 0), 0, 2.35637),
    Joint("neck_ry", "utorso", "head", (0.2546, 0, 0.6215), (0, 0, 0), (0, 1, 0), -0.602139, 1.14319),
    Joint("r_arm_elx", "r_uarm", "r_larm", (0, -0.119, 0.0092), (0, 0, 0), (1, 0, 0), -2.35619, 0),
    Joint("r_arm_ely", "r_scap", "r_uarm", (0, -0.187, -0.016), (0, 0, 0), (0, 1, 0), 0, 3.14159),
    Joint("r_arm_shx", "r_clav", "r_scap", (0, -0.11, -0.245), (0, 0, 0), (1, 0, 0), -1.5708, 1.5708),
    Joint("r_arm_shz", "utorso", "r_clav", (0.1406, -0.2256, 0.4776), (0, 0, 0), (0, 0, 1), -0.785398, 1.5708),
    Joint("r_arm_wrx", "r_ufarm", "r_lfarm", (0, 0, 0), (0, 0, 0), (1, 0, 0), -1.7628, 1.7628),
    Joint("r_arm_wry", "r_larm", "r_ufarm", (0, -0.29955, -0.00921), (0, 0, 0), (0, 1, 0), -3.011, 3.011),
    Joint("r_arm_wry2", "r_lfarm", "r_hand", (0, 0, 0), (0, 0, 0), (0, 1, 0), -2.9671, 2.9671),
    Joint("r_leg_akx", "r_talus", "r_foot", (0, 0, 0), (0, 0, 0), (1, 0, 0), -0.8, 0.8),
    Joint("r_leg_aky", "r_lleg", "r_talus", (0, 0, -0.422), (0, 0, 0), (0, 1, 0), -1, 0.7),
    Joint("r_leg_hpx", "r_uglut", "r_lglut", (0, 0, 0), (0, 0, 0), (1, 0, 0), -0.523599, 0.523599),
    Joint("r_leg_hpy", "r_lglut", "r_uleg", (0.05, -0.0225, -0.066), (0, 0, 0), (0, 1, 0), -1.61234, 0.65764),
    Joint("r_leg_hpz", "pelvis", "r_uglut", (0, -0.089, 0), (0, 0, 0), (0, 0, 1), -0.786794, 0.174358),
    Joint("r_leg_kny", "r_uleg", "r_lleg", (-0.05, 0, -0.374), (0, 0, 0), (0, 1, 0), 0, 2.35637),
)

INERTIAS: dict[str, Inertia] = {
    "head": Inertia(3.751, (-0.0481, 0, 0.0457), (0.0108, 0.0182, 0.0108, -0.0001, -0.0007, -0.0003)),
    "l_clav": Inertia(3.45, (0, 0.048, -0.084), (0.011, 0.009, 0.004, 0, 0, -0.004)),
    "l_foot": Inertia(2.05, (0.027, 0, -0.067), (0.002, 0.007, 0.008, 0, 0, 0)),
    "l_hand": Inertia(0.53, (0, 0.06, 0), (0.00265, 0.00446, 0.00446, 0, 0, 0)),
    "l_larm": Inertia(2.509, (0, 0, 0), (0.00265, 0.00446, 0.00446, 0, 0, 0)),
    "l_lfarm": Inertia(2.65, (0, -0.07, 0), (0.007, 0.004, 0.007, 0, 0, 0)),
    "l_lglut": Inertia(0.866, (0.0133341, 0.0170484, -0.0312052), (0.000691326, 0.00126856, 0.00106487, -2.24344e-05, 2.50508e-06, 0.000137862)),
    "l_lleg": Inertia(5.479, (0.001, 0, -0.187), (0.077, 0.076, 0.01, 0, -0.003, 0)),
    "l_scap": Inertia(3.012, (0, 0, 0), (0.00319, 0.00583, 0.00583, 0, 0, 0)),
    "l_talus": Inertia(0.125, (0, 0, 0), (1.01674e-05, 8.42775e-06, 1.30101e-05, 0, 0, 0)),
    "l_uarm": Inertia(3.388, (0, -0.065, 0), (0.00656, 0.00358, 0.00656, 0, 0, 0)),
    "l_ufarm": Inertia(2.12, (0, -0.2, 0), (0.006, 0.003, 0.006, 0, 0, 0)),
    "l_uglut": Inertia(0.648, (0.00529262, -0.00344732, 0.00313046), (0.00074276, 0.000688179, 0.00041242, -3.79607e-08, -2.79549e-05, -3.2735e-08)),
    "l_uleg": Inertia(9.209, (0, 0, -0.21), (0.09, 0.09, 0.02, 0, 0, 0)),
    "ltorso": Inertia(2.409, (-0.0112984, -3.15366e-06, 0.0746835), (0.0039092, 0.00341694, 0.00174492, -5.04491e-08, -0.000342157, 4.87119e-07)),
    "mtorso": Inertia(0.69, (-0.00816266, -0.0131245, 0.0305974), (0.000454181, 0.000483282, 0.000444215, -6.10764e-05, 3.94009e-05, 5.27463e-05)),
    "pelvis": Inertia(17.882, (0.0111, 0, 0.0271), (0.1244, 0.0958, 0.1167, 0.0008, -0.0007, -0.0005)),
    "r_clav": Inertia(3.45, (0, -0.048, -0.084), (0.011, 0.009, 0.004, 0, 0, 0.004)),
    "r_foot": Inertia(2.05, (0.027, 0, -0.067), (0.002, 0.007, 0.008, 0, 0, 0)),
    "r_hand": Inertia(0.53, (0, -0.06, 0), (0.00265, 0.00446, 0.00446, 0, 0, 0)),
    "r_larm": Inertia(2.509, (0, 0, 0), (0.00265, 0.00446, 0.00446, 0, 0, 0)),
    "r_lfarm": Inertia(2.65, (0, 0.07, 0), (0.007, 0.004, 0.007, 0, 0, 0)),
    "r_lglut": Inertia(0.866, (0.0133341, -0.0170484, -0.0312052), (0.000691326, 0.00126856, 0.00106487, 2.24344e-05, 2.50508e-06, -0.000137862)),
    "r_lleg": Inertia(5.479, (0.001, 0, -0.187), (0.077, 0.076, 0.01, 0, -0.003, 0)),
    "r_scap": Inertia(3.012, (0, 0, 0), (0.00319, 0.00583, 0.00583, 0, 0, 0)),
    "r_talus": Inertia(0.125, (0, 0, 0), (1.01674e-05, 8.42775e-06, 1.30101e-05, 0, 0, 0)),
    "r_uarm": Inertia(3.388, (0, 0.065, 0), (0.00656, 0.00358, 0.00656, 0, 0, 0)),
    "r_ufarm": Inertia(2.12, (0, 0.2, 0), (0.006, 0.003, 0.006, 0, 0, 0)),
    "r_uglut": Inertia(0.648, (0.00529262, 0.00344732, 0.00313046), (0.00074276, 0.000688179, 0.00041242, 3.79607e-08, -2.79549e-05, 3.2735e-08)),
    "r_uleg": Inertia(9.209, (0, 0, -0.21), (0.09, 0.09, 0.02, 0, 0, 0)),
    "utorso": Inertia(63.73, (-0.0581, 0, 0.3056), (1.466, 1.51, 1.3, 0.00362, 0.336, 0.001)),
}

DRIVES: dict[str, Drive] = {
    "back_bkx": Drive(300, 12),
    "back_bky": Drive(445, 9),
    "back_bkz": Drive(106, 12),
    "l_arm_elx": Drive(112, 12),
    "l_arm_ely": Drive(63, 12),
    "l_arm_shx": Drive(99, 12),
    "l_arm_shz": Drive(87, 12),
    "l_arm_wrx": Drive(25, 10),
    "l_arm_wry": Drive(25, 10),
    "l_arm_wry2": Drive(25, 10),
    "l_leg_akx": Drive(360, 12),
    "l_leg_aky": Drive(740, 12),
    "l_leg_hpx": Drive(530, 12),
    "l_leg_hpy": Drive(840, 12),
    "l_leg_hpz": Drive(275, 12),
    "l_leg_kny": Drive(890, 12),
    "neck_ry": Drive(25, 6.28),
    "r_arm_elx": Drive(112, 12),
    "r_arm_ely": Drive(63, 12),
    "r_arm_shx": Drive(99, 12),
    "r_arm_shz": Drive(87, 12),
    "r_arm_wrx": Drive(25, 10),
    "r_arm_wry": Drive(25, 10),
    "r_arm_wry2": Drive(25, 10),
    "r_leg_akx": Drive(360, 12),
    "r_leg_aky": Drive(740, 12),
    "r_leg_hpx": Drive(530, 12),
    "r_leg_hpy": Drive(840, 12),
    "r_leg_hpz": Drive(275, 12),
    "r_leg_kny": Drive(890, 12),
}
# fmt: on

SOLE_M = ((-0.08, 0.17), 0.06, -0.08)
"""Heel and toe, half the width, height, m in the foot link's frame, which is the ankle's: our choice, around the foot's centre of mass."""

_MIDDLE: dict[str, tuple[Shape, ...]] = {
    "pelvis": (Box((0.20, 0.24, 0.14), (0.0, 0.0, 0.03)),),
    "ltorso": (Cylinder(0.07, (0.0, 0.0, 0.0), (0.0, 0.0, 0.12), solid=False),),
    "mtorso": (Cylinder(0.06, (0.0, -0.08, 0.0), (0.0, 0.08, 0.0), solid=False),),
    "utorso": (Box((0.36, 0.30, 0.44), (-0.02, 0.0, 0.32)),),
    "head": (Box((0.16, 0.16, 0.20), (0.02, 0.0, 0.06)),),
}
_LEFT: dict[str, tuple[Shape, ...]] = {
    "uglut": (Sphere(0.05, (0.0, 0.0, 0.0), solid=False),),
    "lglut": (Cylinder(0.04, (0.0, 0.0, 0.0), (0.05, 0.0225, -0.066), solid=False),),
    "uleg": (Cylinder(0.065, (0.0, 0.0, -0.06), (-0.045, 0.0, -0.32)),),
    "lleg": (
        Cylinder(0.05, (0.0, -0.06, 0.0), (0.0, 0.06, 0.0), solid=False),
        Cylinder(0.055, (0.0, 0.0, -0.06), (0.0, 0.0, -0.35)),
    ),
    "talus": (Cylinder(0.03, (0.0, -0.04, 0.0), (0.0, 0.04, 0.0), solid=False),),
    "foot": (
        Cylinder(0.04, (0.0, 0.0, -0.02), (0.0, 0.0, SOLE_M[2] + 0.02), solid=False),
        Box(
            (SOLE_M[0][1] - SOLE_M[0][0], 2 * SOLE_M[1], 0.03),
            ((SOLE_M[0][0] + SOLE_M[0][1]) / 2, 0.0, SOLE_M[2] + 0.015),
        ),
    ),
    "clav": (Cylinder(0.05, (0.0, 0.0, 0.0), (0.0, 0.05, -0.18), solid=False),),
    "scap": (Cylinder(0.06, (0.0, 0.0, 0.0), (0.0, 0.16, -0.01)),),
    "uarm": (Cylinder(0.05, (0.0, 0.0, 0.0), (0.0, 0.09, 0.005)),),
    "larm": (Cylinder(0.05, (0.0, 0.03, 0.0), (0.0, 0.24, -0.007)),),
    "ufarm": (Sphere(0.045, (0.0, 0.0, 0.0), solid=False),),
    "lfarm": (Sphere(0.04, (0.0, 0.0, 0.0), solid=False),),
    "hand": (Box((0.04, 0.16, 0.08), (0.0, 0.12, 0.0)),),
}

SHAPES: dict[str, tuple[Shape, ...]] = {**_MIDDLE, **on_both_sides(_LEFT, "l_", "r_")}
