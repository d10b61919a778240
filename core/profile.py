"""What a robot profile says: the parsed, checked content of one `robots/<name>.toml`.

A profile names links and joints; it computes nothing. Whether these exist in the model is checked where the model is built
(`core.robot_model`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


DEFAULT_POSTURE_WEIGHT = 1e-3


@dataclass(frozen=True)
class ModelSource:
    """Where the model comes from: a URDF, or an MJCF, known by its root element <mujoco>.

    kind "package": `path` below the robots folder of the installed distribution `package`.
    kind "file": `path` is absolute (resolved against the profile's own folder).
    kind "human": built from the recording's own segments; `package` and `path` are empty.
    """

    kind: Literal["package", "file", "human"]
    path: str = ""
    package: str = ""


@dataclass(frozen=True)
class JointLimit:
    """Overrides of the URDF's limits for one joint; None keeps what the URDF says. rad (or m) and rad/s (or m/s)."""

    lower: float | None = None
    upper: float | None = None
    velocity: float | None = None


@dataclass(frozen=True)
class Hand:
    """A hand link and two of its directions, both unit vectors in the link's frame: toward the fingertips, out of the palm."""

    link: str
    fingers: tuple[float, float, float]
    palm: tuple[float, float, float]


@dataclass(frozen=True)
class Foot:
    """A foot link and the corners of its sole, (K, 3) m in the link's frame; all lie on the ground when the foot is flat."""

    link: str
    sole: Array


@dataclass(frozen=True)
class CoupledJoints:
    """Linear inequalities over several joints: lower ≤ matrix · q[joints] ≤ upper, rad. matrix (m, k), lower and upper (m,)."""

    joints: tuple[str, ...]
    matrix: Array
    lower: Array
    upper: Array


@dataclass(frozen=True)
class TposeException:
    """A segment that can't reach the T-pose: the error that is left, in degrees, and the joint that forbids more, by its limit or by its axis."""

    joint: str
    error_deg: float


@dataclass(frozen=True)
class MappingParameters:
    """One mapping's parameters for this robot.

    weights: segment → weight of its orientation task; `twist_weights`: segment → factor on rotation about the limb's bone.
    rotations_rpy: segment → fixed-axis roll, pitch, yaw (rad) of the link in the robot's T-pose, world ← link; where absent
    it is computed by forward kinematics from the reference posture.
    links: segment → link, where this mapping drives another link than the profile's own map says.
    """

    weights: Mapping[str, float] = field(default_factory=dict)
    twist_weights: Mapping[str, float] = field(default_factory=dict)
    rotations_rpy: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    links: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Arm:
    """What a hand mapping needs of one arm.

    shoulder_link, shoulder_m: the shoulder's centre, (3,) m in the frame of a link that the arm doesn't move.
    hand_link, hand_m: the hand point, (3,) m in the hand link's frame. length_m: from shoulder to hand point, arm stretched; None = measured by
    forward kinematics where the arm is straightest in the reference posture.
    elbow_link: the link whose origin is the elbow, "" = the limb geometry's own joint centre.
    """

    shoulder_link: str
    shoulder_m: tuple[float, float, float]
    hand_link: str
    hand_m: tuple[float, float, float]
    length_m: float | None = None
    elbow_link: str = ""


@dataclass(frozen=True)
class LevelTask:
    """One task of a priority level [Lim2022 tables II, III]: which segment it follows, and how.

    kind: "orientation", "position" (the arm's hand point), "axis" (where the link's own `axis`, a unit vector, points).
    link: "" = the link that the profile maps to the segment. gain: 1/s. weight: beside the other tasks of its level; 1 rad counts as 1 m
    where weights are alike.
    """

    segment: str
    kind: Literal["orientation", "position", "axis"]
    gain: float
    link: str = ""
    axis: tuple[float, float, float] = (1.0, 0.0, 0.0)
    weight: float = 1.0


@dataclass(frozen=True)
class Level:
    """One priority level, after the limits, which always come first. weight: ρ of [Lim2022 eq. 14] beside ‖q̇‖²_A.

    acceleration_s2: factor on ‖q̈‖², the cost that levels with freedom to spare carry.
    """

    tasks: tuple[LevelTask, ...]
    weight: float = 50.0
    acceleration_s2: float = 0.0


@dataclass(frozen=True)
class Hierarchy:
    """A robot's strict priorities [Lim2022 sec. III]; levels in order, empty = derived from what the profile maps.

    joints: the joints that may move, names or patterns with *; empty = all that carry a mapped link. limit_gain: K_q, 1/s.
    lower, upper: joint → rad, limits narrower than the joint's own: an
    elbow that could bend backward must not, when only the hand says where to go. hand_speed_m_s, hand_rate_rad_s: box on hand velocities. inertia_diagonal: added to A's diagonal everywhere; `extra_inertia`: joint → more.
    """

    levels: tuple[Level, ...] = ()
    joints: tuple[str, ...] = ()
    lower: Mapping[str, float] = field(default_factory=dict)
    upper: Mapping[str, float] = field(default_factory=dict)
    limit_gain: float = 20.0
    hand_speed_m_s: float = 2.0
    hand_rate_rad_s: float = 6.0
    inertia_diagonal: float = 0.02
    extra_inertia: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class TorqueControl:
    """τ = kp (q_d - q) + kd (q̇_d - q̇) + gravity, clipped [Lim2022 sec. III-C]: joint → Nm/rad, Nms/rad, Nm; absent joints: unknown.

    standing_joints: names or patterns of joints whose gains are meant for a leg that stands; one that swings rings with them.
    """

    stiffness: Mapping[str, float] = field(default_factory=dict)
    damping: Mapping[str, float] = field(default_factory=dict)
    torque_limit: Mapping[str, float] = field(default_factory=dict)
    standing_joints: tuple[str, ...] = ()


@dataclass(frozen=True)
class RobotProfile:
    """One robot, as its TOML describes it.

    base: "floating" (the base link moves) or "fixed" (it stands still at the origin, heading 0).
    base_segment: the human segment whose heading is taken out of the targets when the base does not move.
    base_rpy: fixed-axis roll, pitch, yaw (rad) of the base link when the robot stands upright and faces +X.
    links: segment → link name. reference_posture: joint → rad, an approximate T-pose, absent joints at 0 clipped into limits.
    posture_weight: how much every joint is drawn to the reference posture, beside task weights of about 1: it decides what targets leave open,
    and keeps arms that hang along a shoulder axis from spinning. Larger is calmer and less exact.
    arms: "Left", "Right" → what hand mappings need. hierarchy: strict priorities. torque: gains and limits for replay.
    limb_ends: limb segment → link whose origin ends the limb where no mapped link follows it.
    default_velocity_limit: rad/s, caps every joint's speed and stands in where the URDF states none, as MJCF never does. joint_limits: joint, or pattern with *,
    → overrides, which win over the cap; of several that match a joint each adds to those before. locked_joints: may be patterns, too.
    """

    name: str
    description: str
    model: ModelSource
    base: Literal["floating", "fixed"]
    links: Mapping[str, str]
    origin: str = ""
    base_segment: str = "Pelvis"
    base_rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)
    reference_posture: Mapping[str, float] = field(default_factory=dict)
    locked_joints: tuple[str, ...] = ()
    posture_weight: float = DEFAULT_POSTURE_WEIGHT
    limb_ends: Mapping[str, str] = field(default_factory=dict)
    default_velocity_limit: float | None = None
    joint_limits: Mapping[str, JointLimit] = field(default_factory=dict)
    coupled: tuple[CoupledJoints, ...] = ()
    hands: Mapping[str, Hand] = field(default_factory=dict)
    feet: Mapping[str, Foot] = field(default_factory=dict)
    tpose_exceptions: Mapping[str, TposeException] = field(default_factory=dict)
    mappings: Mapping[str, MappingParameters] = field(default_factory=dict)
    arms: Mapping[str, Arm] = field(default_factory=dict)
    hierarchy: Hierarchy = field(default_factory=Hierarchy)
    torque: TorqueControl = field(default_factory=TorqueControl)
