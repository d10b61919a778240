"""Joint names and patterns with * of a profile's control tables → the model's own joint names."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase

from retarget.core.profile import RobotProfile


def control_patterns(profile: RobotProfile) -> Iterator[tuple[str, str]]:
    """(name or pattern, place in the profile) of every joint that [hierarchy] and [torque] name."""
    hierarchy, torque = profile.hierarchy, profile.torque
    yield from ((name, "[hierarchy] joints") for name in hierarchy.joints)
    yield from ((name, "[hierarchy.extra_inertia]") for name in hierarchy.extra_inertia)
    yield from ((name, "[hierarchy.lower_rad]") for name in hierarchy.lower)
    yield from ((name, "[hierarchy.upper_rad]") for name in hierarchy.upper)
    yield from ((name, "[torque.stiffness_nm_rad]") for name in torque.stiffness)
    yield from ((name, "[torque.damping_nms_rad]") for name in torque.damping)
    yield from ((name, "[torque.limit_nm]") for name in torque.torque_limit)
    yield from ((name, "[torque] standing_joints") for name in torque.standing_joints)


def matches(pattern: str, joints: Iterable[str]) -> bool:
    """Whether any of `joints` is meant by `pattern`."""
    return any(fnmatchcase(joint, pattern) for joint in joints)


def with_joint_names(profile: RobotProfile, joints: Sequence[str]) -> RobotProfile:
    """`profile` with the patterns of its control tables replaced by the `joints` that they match, in the order of `joints`.

    Of several that match a joint the last one wins. Whatever matches nothing is dropped: `robot_model.build` refuses it before.
    """
    hierarchy, torque = profile.hierarchy, profile.torque
    return replace(
        profile,
        hierarchy=replace(
            hierarchy,
            joints=_named(hierarchy.joints, joints),
            extra_inertia=_values(hierarchy.extra_inertia, joints),
            lower=_values(hierarchy.lower, joints),
            upper=_values(hierarchy.upper, joints),
        ),
        torque=replace(
            torque,
            stiffness=_values(torque.stiffness, joints),
            damping=_values(torque.damping, joints),
            torque_limit=_values(torque.torque_limit, joints),
            standing_joints=_named(torque.standing_joints, joints),
        ),
    )


def _named(patterns: Iterable[str], joints: Sequence[str]) -> tuple[str, ...]:
    return tuple(joint for joint in joints if any(fnmatchcase(joint, pattern) for pattern in patterns))


def _values(table: Mapping[str, float], joints: Sequence[str]) -> dict[str, float]:
    found = {joint: [value for name, value in table.items() if fnmatchcase(joint, name)] for joint in joints}
    return {joint: values[-1] for joint, values in found.items() if values}
