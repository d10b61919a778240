"""Every key of every table of a profile: what stands there, in which unit and frame, what holds without it, what it means.

The parser refuses what is not here (`TableReader.only`), and docs/profiles.md is written from here, so neither can know a key that the other doesn't.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from retarget.core.profile import DEFAULT_POSTURE_WEIGHT, Hierarchy, Level, LevelTask, RobotProfile
from retarget.core.segments import SEGMENTS

NEEDED = "needed"


@dataclass(frozen=True)
class Key:
    """One key. value: type and unit; default: what holds without it, as text, `NEEDED` where nothing does; meaning: Markdown."""

    value: str
    default: str
    meaning: str


@dataclass(frozen=True)
class TableKeys:
    """One table. place: as its heading is written, with a word in capitals where a name of the robot's stands. keys: in the order shown.

    any_of: what stands for all keys in a table whose keys are names and all mean the same; `keys` holds every name.
    """

    place: str
    meaning: str
    keys: Mapping[str, Key]
    any_of: str = ""


TOP: Mapping[str, Key] = {
    "extends": Key("text", "", "Another profile, by name or path, that this one is laid over: tables are merged, all else is replaced."),
    "name": Key("text", "the file's name", "What outputs and messages call the robot."),
    "description": Key("text", "", "One line for `retarget robots list`."),
    "model": Key("table", NEEDED, "Where the URDF or MJCF is, and how the robot stands."),
    "links": Key("table", "", "Which link follows which segment of the person."),
    "limb_ends": Key("table", "", "Links whose origins end a limb that no mapped link follows."),
    "reference_posture_rad": Key(
        "table joint → rad", "0, clipped into the limits",
        "An approximate T-pose: arms out to the sides, elbows and knees straight, palms down. Here joint centres are measured, here the solver "
        "starts, and what the targets leave open is drawn here. Sliding joints: m.",
    ),
    "solver": Key("table", "", "How strongly joints are drawn to the reference posture."),
    "limits": Key("table", "", "Position and speed limits in place of the model's own."),
    "coupled": Key("array of tables", "", "Linear inequalities over several joints, as cables and closed chains need."),
    "hands": Key("table", "", "Where fingers and palms point."),
    "feet": Key("table", "", "Where the soles are. With them the base follows the stance feet (`--base contact`) and floor and feet are checked."),
    "tpose_exceptions": Key("table", "", "Where the robot can't take the T-pose, and by how much."),
    "mapping": Key("table", "", "Weights and rotations of single [mappings](mappings.md)."),
    "arms": Key("table", "", "Shoulders and hand points, for hand mappings (`--method telemanipulation`)."),
    "hierarchy": Key("table", "", "Strict priorities, for `--method telemanipulation`."),
    "torque": Key("table", "", "Gains and torque limits, for `retarget validate`."),
}  # fmt: skip

MODEL: Mapping[str, Key] = {
    "package": Key("text", "one of three", "An installed Python distribution that brings robots, with `path`."),
    "path": Key("text", "needed with `package`", "The URDF or MJCF, below the package's robots folder."),
    "file": Key("text", "one of three", "The URDF or MJCF, a path relative to this profile. MJCF is known by its root element `<mujoco>`."),
    "human": Key("true", "one of three", "The robot is built from the recording's own segments."),
    "base": Key('"floating" or "fixed"', '"floating"', "Whether the root link moves in the world, or stands still at the origin."),
    "base_segment": Key("segment", RobotProfile.base_segment, "Whose heading is taken out of the motion when the base does not move."),
    "base_rpy_rad": Key(
        "3 numbers, rad", "[0, 0, 0]",
        "Fixed-axis roll, pitch, yaw of the root link in the world when the robot stands upright and faces +X. A root link whose x points backward: `[0, 0, 3.14159]`. Floating bases only: a fixed one faces +X in its model.",
    ),
    "locked_joints": Key("list of joints", "[]", "Joints held at 0, fingers and grippers for example; `*` stands for any text."),
}  # fmt: skip

SOLVER: Mapping[str, Key] = {
    "posture_weight": Key(
        "number > 0", f"{DEFAULT_POSTURE_WEIGHT:g}",
        "Pull of every joint to the reference posture, beside task weights of about 1. Larger is calmer and less exact; raise it where arms that hang "
        "along a shoulder axis spin.",
    ),
}  # fmt: skip

LIMITS: Mapping[str, Key] = {
    "default_velocity_rad_s": Key(
        "rad/s", "the model's own",
        "Caps every joint's speed, and stands in where the model states none, as MJCF never does.",
    ),
    "joints": Key("table", "", "Limits of single joints."),
}  # fmt: skip

JOINT_LIMITS: Mapping[str, Key] = {
    "lower_rad": Key("rad (sliding: m)", "the model's own", "Smallest value."),
    "upper_rad": Key("rad (sliding: m)", "the model's own", "Largest value."),
    "velocity_rad_s": Key("rad/s (sliding: m/s)", "the model's own", "Largest speed; wins over `default_velocity_rad_s`."),
}  # fmt: skip

COUPLED: Mapping[str, Key] = {
    "joints": Key("list of k joints", NEEDED, "The joints q, in the order of the columns."),
    "rows": Key("m rows of k numbers", NEEDED, "The matrix A of lower ≤ A q ≤ upper."),
    "lower_rad": Key("m numbers, rad", NEEDED, "Lower bounds; −1000 where there is none."),
    "upper_rad": Key("m numbers, rad", NEEDED, "Upper bounds; 1000 where there is none."),
}

HAND: Mapping[str, Key] = {
    "link": Key("link", NEEDED, "The link that `[links]` maps to this hand."),
    "fingers": Key("unit vector, link frame", NEEDED, "Toward the fingertips."),
    "palm": Key("unit vector, link frame", NEEDED, "Out of the palm, perpendicular to `fingers`."),
}

FOOT: Mapping[str, Key] = {
    "link": Key("link", NEEDED, "The link that carries the sole, behind the last ankle joint."),
    "sole_m": Key("3 or more points [x, y, z], m, link frame", NEEDED, "The sole's corners. All lie on the floor when the foot stands flat."),
}  # fmt: skip

TPOSE_EXCEPTION: Mapping[str, Key] = {
    "joint": Key("joint", NEEDED, "What forbids more, by its limit or by its axis; `retarget robots check` proves that it does."),
    "error_deg": Key("deg", NEEDED, "What is left in T-pose: of the bone's direction for limbs, of the orientation for all else."),
}  # fmt: skip

MAPPING: Mapping[str, Key] = {
    "weights": Key("table segment → number ≥ 0", "the mapping's own", "Weight of the segment's orientation task; 0 ignores it."),
    "twist_weights": Key(
        "table segment → number ≥ 0", "the mapping's own",
        "`limb_plane`: factor on rotation about the limb's own bone, beside 1 across it.",
    ),
    "rotations_rpy_rad": Key(
        "table segment → 3 numbers, rad", "from the reference posture",
        "`link_orientation`: fixed-axis roll, pitch, yaw of the link in the world while the robot stands in T-pose facing +X.",
    ),
    "links": Key("table segment → link", "`[links]`", "`link_orientation`: drives this link in place of the one in `[links]`."),
}  # fmt: skip

ARM: Mapping[str, Key] = {
    "shoulder_link": Key("link", NEEDED, "A link that the arm doesn't move, the chest as a rule."),
    "shoulder_m": Key("3 numbers, m, frame of `shoulder_link`", NEEDED, "The shoulder's centre, where its axes meet or pass closest."),
    "hand_link": Key("link", NEEDED, "The link that carries the hand point."),
    "hand_m": Key("3 numbers, m, frame of `hand_link`", NEEDED, "The hand point: the palm's centre, or between a gripper's fingertips."),
    "length_m": Key("m", "measured in the reference posture", "From shoulder to hand point, the arm stretched."),
    "elbow_link": Key("link", "the joint centre found by geometry", "The link whose origin is the elbow."),
}  # fmt: skip

HIERARCHY: Mapping[str, Key] = {
    "joints": Key("list of joints", "all that carry a mapped link", "The joints that may move; `*` stands for any text."),
    "limit_gain_1_s": Key("1/s", f"{Hierarchy.limit_gain:g}", "How quickly a joint may approach its limit: speed ≤ gain × distance."),
    "hand_speed_m_s": Key("m/s", f"{Hierarchy.hand_speed_m_s:g}", "Largest speed of a hand along each world axis."),
    "hand_rate_rad_s": Key("rad/s", f"{Hierarchy.hand_rate_rad_s:g}", "Largest turn rate of a hand about each world axis."),
    "inertia_diagonal": Key("kg m²", f"{Hierarchy.inertia_diagonal:g}", "Added to every joint in the inertia matrix A of the cost ‖q̇‖²_A."),
    "extra_inertia": Key("table joint → kg m²", "0", "Added for single joints (`*` stands for any text): a larger value spares the joint."),
    "lower_rad": Key("table joint → rad", "the joint's own", "Narrower limits where only the hand says where to go: an elbow must not bend backward."),
    "upper_rad": Key("table joint → rad", "the joint's own", "The same, above."),
    "levels": Key("array of tables", "from the links mapped", "The priorities, highest first. Limits always come before all."),
}  # fmt: skip

LEVEL: Mapping[str, Key] = {
    "weight": Key("number > 0", f"{Level.weight:g}", "ρ of [Lim2022 eq. 14]: the level's tasks beside ‖q̇‖²_A."),
    "acceleration_s2": Key("s²", f"{Level.acceleration_s2:g}", "Factor on ‖q̈‖²; for levels that leave joints free."),
    "tasks": Key("array of tables", NEEDED, "What the level asks for; at least one."),
}

TASK: Mapping[str, Key] = {
    "segment": Key("segment", NEEDED, "Which segment of the person the task follows."),
    "kind": Key(
        '"orientation", "position" or "axis"', NEEDED,
        "The whole orientation; the hand point of `[arms]` (hands only); or only where one axis of the link points.",
    ),
    "gain_1_s": Key("1/s", NEEDED, "Feedback on the task's error."),
    "link": Key("link", "that of `[links]`", "Drives another link. Not with `position`."),
    "axis": Key("unit vector, link frame", "[1, 0, 0]", "The axis, with kind `axis` only."),
    "weight": Key("number > 0", f"{LevelTask.weight:g}", "Beside the level's other tasks; at equal weights 1 rad counts as 1 m."),
}  # fmt: skip

TORQUE: Mapping[str, Key] = {
    "stiffness_nm_rad": Key("table joint → Nm/rad", "from the joint's inertia", "kp of τ = kp (q_d − q) + kd (q̇_d − q̇) + gravity."),
    "damping_nms_rad": Key("table joint → Nms/rad", "from the joint's inertia", "kd. Both gains have to be stated for a joint to be used."),
    "limit_nm": Key("table joint → Nm", "the model's effort", "Torque is clipped here; what the real motor gives behind its gear."),
    "standing_joints": Key("list of joints", "[]", "Joints whose gains hold for a leg that stands: a leg in the air takes them on request only (`--gains profile`)."),
}  # fmt: skip

_SIDES = ("Left", "Right")


def by_name(names: tuple[str, ...], key: Key) -> dict[str, Key]:
    """A table in which each of `names` may be a key, all with one meaning."""
    return dict.fromkeys(names, key)


LINKS = by_name(SEGMENTS, Key("link", "the segment is not followed", "The link that turns as the segment does."))
LIMB_ENDS = by_name(
    SEGMENTS, Key("link", "the next mapped link's joints", "For a forearm or shank: the link whose origin ends it.")
)
TPOSE_EXCEPTIONS = by_name(SEGMENTS, Key("table", "none", "One exception."))
HANDS = by_name(_SIDES, Key("table", "none", "One hand."))
FEET = by_name(_SIDES, Key("table", "none", "One foot."))
ARMS = by_name(_SIDES, Key("table", "none", "One arm."))

TABLES = (
    TableKeys("", "Top level, before the first table.", TOP),
    TableKeys("[model]", "The model and how it stands. Exactly one of `package` (with `path`), `file` and `human`.", MODEL),
    TableKeys(
        "[links]",
        "A limb's links follow each other outward in the tree, and each must turn with its bone: for an upper arm the link **behind the last shoulder joint**, for a "
        "forearm the first one behind the elbow, for a hand the last one behind the wrist; legs alike. Segments without a link are not followed.",
        LINKS, "SEGMENT",
    ),
    TableKeys("[limb_ends]", "Only for limbs that end without a mapped hand or foot.", LIMB_ENDS, "SEGMENT"),
    TableKeys("[solver]", "", SOLVER),
    TableKeys("[limits]", "", LIMITS),
    TableKeys("[limits.joints.JOINT]", "JOINT is a joint's name, or a pattern with `*` in quotes; of several that match, each adds to those before.", JOINT_LIMITS),
    TableKeys("[[coupled]]", "One table for each set of rows.", COUPLED),
    TableKeys("[hands]", "", HANDS, "SIDE"),
    TableKeys("[hands.SIDE]", "Without it a hand's rotation comes from the reference posture.", HAND),
    TableKeys("[feet]", "", FEET, "SIDE"),
    TableKeys("[feet.SIDE]", "", FOOT),
    TableKeys("[tpose_exceptions]", "", TPOSE_EXCEPTIONS, "SEGMENT"),
    TableKeys("[tpose_exceptions.SEGMENT]", "", TPOSE_EXCEPTION),
    TableKeys("[mapping.MAPPING]", "MAPPING is a mapping's name: `limb_plane`, `link_orientation`.", MAPPING),
    TableKeys("[arms]", "", ARMS, "SIDE"),
    TableKeys("[arms.SIDE]", "", ARM),
    TableKeys("[hierarchy]", "Strict priorities [Lim2022 sec. III]. Without levels they are derived from `[links]` and `[arms]`.", HIERARCHY),
    TableKeys("[[hierarchy.levels]]", "", LEVEL),
    TableKeys("[[hierarchy.levels.tasks]]", "", TASK),
    TableKeys("[torque]", "Joints are names, or patterns with `*` in quotes; of several that match a joint the last one wins.", TORQUE),
)  # fmt: skip
"""Every table that the parser reads, in the order of the page."""
