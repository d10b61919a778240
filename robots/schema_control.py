"""The tables of a profile that hand mappings, the hierarchical solver and torque control read: [arms], [hierarchy], [torque]."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Literal, cast

from retarget.core.profile import Arm, Hierarchy, Level, LevelTask, TorqueControl
from retarget.core.segments import SEGMENTS
from retarget.robots import profile_keys as keys
from retarget.robots.toml_table import TableReader

KINDS = ("orientation", "position", "axis")
HANDS = {"LeftHand": "Left", "RightHand": "Right"}
"""The segments that have a hand point, and the arm it belongs to."""


def parse_arms(table: TableReader) -> dict[str, Arm]:
    """ "Left", "Right" → arm, from [arms.Left] and [arms.Right]. Raises `ProfileError`."""
    return {side: _arm(entry) for side, entry in table.sides()}


def parse_hierarchy(table: TableReader, links: Collection[str], arms: Mapping[str, Arm]) -> Hierarchy:
    """The priorities in [hierarchy]. links: segments that the profile maps; arms: what it says of its arms, for tasks that need them.

    Raises `ProfileError`.
    """
    table.only(keys.HIERARCHY)
    default, extra = Hierarchy(), table.table("extra_inertia")
    lower, upper = table.table("lower_rad"), table.table("upper_rad")
    return Hierarchy(
        levels=tuple(_level(entry, links, arms) for entry in table.tables("levels")),
        joints=tuple(table.texts("joints")),
        lower={joint: lower.number(joint) for joint in lower.table_},
        upper={joint: upper.number(joint) for joint in upper.table_},
        limit_gain=table.positive("limit_gain_1_s") or default.limit_gain,
        hand_speed_m_s=table.positive("hand_speed_m_s") or default.hand_speed_m_s,
        hand_rate_rad_s=table.positive("hand_rate_rad_s") or default.hand_rate_rad_s,
        inertia_diagonal=table.not_negative("inertia_diagonal", default.inertia_diagonal),
        extra_inertia={joint: extra.not_negative(joint) for joint in extra.table_},
    )


def parse_torque(table: TableReader) -> TorqueControl:
    """Gains and limits in [torque]: tables joint, or pattern with *, → number; and a list of joints. Raises `ProfileError`."""
    table.only(keys.TORQUE)
    stiffness, damping, limit = (table.table(key) for key in ("stiffness_nm_rad", "damping_nms_rad", "limit_nm"))
    return TorqueControl(
        stiffness={joint: stiffness.not_negative(joint) for joint in stiffness.table_},
        damping={joint: damping.not_negative(joint) for joint in damping.table_},
        torque_limit={joint: limit.required_positive(joint) for joint in limit.table_},
        standing_joints=tuple(table.texts("standing_joints")),
    )


def _arm(table: TableReader) -> Arm:
    table.only(keys.ARM)
    return Arm(
        shoulder_link=table.text("shoulder_link"),
        shoulder_m=table.triple("shoulder_m"),
        hand_link=table.text("hand_link"),
        hand_m=table.triple("hand_m"),
        length_m=table.positive("length_m"),
        elbow_link=table.text("elbow_link", ""),
    )


def _level(table: TableReader, links: Collection[str], arms: Mapping[str, Arm]) -> Level:
    table.only(keys.LEVEL)
    tasks = tuple(_task(entry, links, arms) for entry in table.tables("tasks"))
    if not tasks:
        table.fail("tasks", [], "at least one task")
    default = Level(tasks)
    return Level(
        tasks,
        table.positive("weight") or default.weight,
        table.not_negative("acceleration_s2", default.acceleration_s2),
    )


def _task(table: TableReader, links: Collection[str], arms: Mapping[str, Arm]) -> LevelTask:
    table.only(keys.TASK)
    segment = table.choice("segment", SEGMENTS)
    # `choice` lets nothing but these three through
    kind = cast(Literal["orientation", "position", "axis"], table.choice("kind", KINDS))
    if kind == "position":
        if segment not in HANDS:
            table.fail(
                "segment", segment, "LeftHand or RightHand, the segments with a hand point, where kind is 'position'"
            )
        if HANDS[segment] not in arms:
            table.fail("segment", segment, f"an arm for its hand point, [arms.{HANDS[segment]}]")
        if "link" in table.table_:
            table.fail(
                "link", table.text("link"), f"no link where kind is 'position': [arms.{HANDS[segment]}] tells it"
            )
    elif "link" not in table.table_ and segment not in links:
        table.fail("segment", segment, f"a segment of [links], or a link of its own; [links] has {', '.join(links)}")
    if kind != "axis" and "axis" in table.table_:
        table.fail("axis", table.table_["axis"], "no axis unless kind is 'axis'")
    return LevelTask(
        segment,
        kind,
        table.required_positive("gain_1_s"),
        table.text("link", ""),
        table.unit("axis", LevelTask.axis),
        table.positive("weight") or LevelTask.weight,
    )
