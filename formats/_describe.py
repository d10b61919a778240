"""What `retarget info` says of a file, for formats that have no cheaper way than a full read."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from retarget.core.types import HumanMotion, JointTrajectory


def trajectory_facts(format_name: str, trajectory: JointTrajectory) -> dict[str, Any]:
    """JSON-able facts of a robot trajectory."""
    provenance = dict(trajectory.provenance)
    warnings = provenance.pop("warnings", [])
    return {
        "format": format_name,
        "kind": "trajectory",
        "robot": trajectory.robot,
        "joints": list(trajectory.joint_names),
        "rate_hz": trajectory.rate_hz,
        "frames": trajectory.frames,
        "duration_s": _duration(trajectory.time),
        "start_s": float(trajectory.time[0]),
        "base": "fixed" if trajectory.base_position is None else "floating",
        "base_frame": trajectory.base_frame,
        "marked_frames": int((trajectory.status != 0).sum()),
        "has_robot_description": bool(trajectory.robot_description),
        "provenance": provenance,
        "warnings": list(warnings),
    }


def motion_facts(format_name: str, motion: HumanMotion) -> Mapping[str, Any]:
    """JSON-able facts of a recorded motion."""
    return {
        "format": motion.source.format or format_name,
        "kind": "motion",
        "version": motion.source.version,
        "rate_hz": motion.rate_hz,
        "frames": motion.frames,
        "duration_s": _duration(motion.time),
        "segments": list(motion.segments),
        "unmeasured_segments": list(motion.unmeasured_segments),
        "gaps": [],
        "interpolated_frames": motion.source.interpolated_frames,
        "warnings": list(motion.source.warnings),
    }


def _duration(time: Any) -> float:
    return float(time[-1] - time[0])
