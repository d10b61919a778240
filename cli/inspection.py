"""What `retarget inspect` says of one file: facts, doubts and suggested options as JSON-able values, and what its pictures are drawn from."""

from __future__ import annotations

import io
import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from retarget import formats, robots
from retarget.cli.plan import PIPE
from retarget.cli.tracker_logs import load_calibration, tracker_options
from retarget.core import inspection
from retarget.core.errors import RetargetError
from retarget.core.types import HumanMotion, JointTrajectory, TrackerRecording

if TYPE_CHECKING:
    from retarget.core.inspection import MotionFindings, TrackerFindings
    from retarget.core.robot_model import RobotModel

SHOWN = 5
"""Fastest segments that are listed."""
FAST_RATE_HZ = 130.0
ALL_FRACTION = 0.999


@dataclass
class Inspection:
    """One file, looked at.

    record: JSON-able facts; its keys "doubts" (sentences) and "suggestions" (option → why) are filled as they are found.
    data: what was read, None where only the facts could be. findings: of recordings. model: the robot of a trajectory, where it is known.
    trackers: what a motion of calibrated trackers was made of.
    """

    path: str
    record: dict[str, Any]
    data: HumanMotion | TrackerRecording | JointTrajectory | None = None
    findings: MotionFindings | TrackerFindings | None = None
    model: RobotModel | None = None
    trackers: TrackerRecording | None = None
    doubts: list[str] = field(default_factory=list)
    suggestions: dict[str, str] = field(default_factory=dict)

    def finished(self) -> Inspection:
        """With doubts and suggestions in the record, the file's own warnings first."""
        said = list(dict.fromkeys([*self.record.get("warnings", ()), *self.doubts]))
        self.record |= {"doubts": said, "suggestions": [{"option": o, "why": w} for o, w in self.suggestions.items()]}
        return self


def inspect_file(path: str, facts: Mapping[str, Any], calibration: str | None, robot: str | None) -> Inspection:
    """Look at the file `path`, or stdin for "-". facts: of tracker logs, from `log_facts`; calibration: makes a motion of a tracker log.

    Raises what the readers raise; a recording that can be described but not read (gaps too long) is described.
    """
    options = tracker_options(facts)
    shown = "stdin" if path == PIPE else path
    # Read twice: once for what the file says of itself (gaps of any length), once for its content.
    data = sys.stdin.buffer.read() if path == PIPE else None

    def source() -> str | BinaryIO:
        return path if data is None else io.BytesIO(data)

    found = Inspection(path, {"input": path, **formats.describe(source(), shown, options=options)})
    try:
        content = formats.read_any(source(), shown, options=options)
    except RetargetError as error:  # it could be described, so this is about what it holds
        found.doubts.append(str(error).removeprefix(f"{shown}: "))
        return found.finished()
    if isinstance(content, TrackerRecording) and calibration is not None:
        from retarget.core.calibrate.apply import apply

        _trackers(found, content, calibrated=True)
        found.trackers, content = content, apply(load_calibration(calibration), content)
    found.data = content
    if isinstance(content, JointTrajectory):
        _trajectory(found, content, robot)
    elif isinstance(content, TrackerRecording):
        _trackers(found, content, calibrated=False)
    else:
        _motion(found, content, calibration)
    return found.finished()


def _motion(found: Inspection, motion: HumanMotion, calibration: str | None) -> None:
    findings = inspection.inspect_motion(motion)
    found.findings = findings
    found.doubts += findings.doubts
    record = found.record
    record["timing"] = _timing(findings.timing)
    record["person"] = {
        "stature_m": findings.stature_m,
        "upright": findings.upright,
        "heading_deg": None
        if findings.heading_deg is None
        else dict(zip(("first", "min", "max"), findings.heading_deg, strict=True)),
        "travel_m": findings.travel_m,
    }
    record["poses"] = {name: [list(span) for span in found_] for name, found_ in findings.poses.items()}
    record["contacts"] = None
    if findings.contacts is not None:
        record["contacts"] = {
            "source": "recorded" if findings.contacts_recorded else "estimated",
            "steps": inspection.step_counts(findings.contacts),
            "on_ground_fraction": float(findings.contacts.any(axis=1).mean()),
        }
    record["fastest"] = _fastest(motion.segments, findings.turn_rad_s, findings.speed_m_s, motion.measured)
    record["robots"] = _fitting_robots(motion)
    record["calibrated"] = calibration is not None
    _suggest_for_motion(found, motion, findings, calibration)


def _suggest_for_motion(
    found: Inspection, motion: HumanMotion, findings: MotionFindings, calibration: str | None
) -> None:
    name, suggest = _quoted(found.path), found.suggestions
    fitting = [entry["robot"] for entry in found.record["robots"] if not entry["lacks"]]
    hands = all(motion.has(segment) for segment in ("T8", "LeftHand", "RightHand"))
    if calibration is not None:
        suggest[
            f"retarget convert {name} --robot tocabi --method telemanipulation --calibration {_quoted(calibration)}"
        ] = "the person is calibrated: hands can be placed"
    elif fitting:
        best = "g1" if "g1" in fitting else fitting[0]
        suggest[f"retarget convert {name} --robot {best}"] = (
            f"fits {', '.join(fitting)}: all segments that they follow were measured"
        )
    legs = all(motion.has(f"{side}{part}") for side in ("Left", "Right") for part in ("UpperLeg", "LowerLeg", "Foot"))
    if not legs and calibration is None:
        suggest["--base fixed"] = "the legs were not measured: a robot's base can't follow them"
    elif (
        findings.contacts is not None
        and findings.contacts.any(axis=1).mean() > ALL_FRACTION
        and (findings.travel_m or 0) > 0.3
    ):
        suggest["--base contact"] = "a foot is always on the ground: the base can be moved so that it stays where it is"
    if hands and calibration is None and all(findings.poses.get(pose) for pose in ("T-pose", "arms forward")):
        suggest[f"retarget calibrate {name} -o operator.json"] = (
            "T-pose and arms ahead are shown: enough for --method telemanipulation, if the arms hang down somewhere, too"
        )
    if findings.timing.uneven:
        suggest[f"--rate {_round_rate(findings.timing.usual_s):g}"] = (
            "frames come unevenly: an even rate is easier to follow"
        )
    elif motion.rate_hz > FAST_RATE_HZ:
        suggest["--rate 120"] = f"{motion.rate_hz:g} Hz is more than most robots are commanded at"
    if (start := _start_of_motion(motion, findings)) is not None:
        suggest[f"--start {start:.2f}"] = "before that, the person stands in a calibration pose"


def _start_of_motion(motion: HumanMotion, findings: MotionFindings) -> float | None:
    """End of the T-pose or N-pose with which the recording starts, if it goes on after it."""
    first, last = float(motion.time[0]), float(motion.time[-1])
    for pose, stretches in findings.poses.items():
        if pose == "T-pose" and stretches and stretches[0][0] - first < 0.5 and last - stretches[0][1] > 1.0:
            return stretches[0][1]
    return None


def _trackers(found: Inspection, recording: TrackerRecording, *, calibrated: bool) -> None:
    findings = inspection.inspect_trackers(recording)
    found.doubts += findings.doubts
    found.record["timing"] = _timing(findings.timing)
    found.record["tracked_fraction"] = {
        name: float(recording.tracked[:, column].mean()) for column, name in enumerate(recording.trackers)
    }
    if calibrated:
        return
    found.findings = findings
    every = np.ones(len(recording.trackers), bool)
    found.record["fastest"] = _fastest(recording.trackers, findings.turn_rad_s, findings.speed_m_s, every)
    name, suggest = _quoted(found.path), found.suggestions
    up = found.record.get("up")
    doubtful = any(f"up = {up} is unlikely" in warning for warning in found.record.get("warnings", ()))
    if doubtful:
        suggest[f"--up {'z' if up == 'y' else 'y'}"] = f"with {up} up, positions look wrong"
    elif any("up axis not declared" in warning for warning in found.record.get("warnings", ())):
        suggest[f"--up {up}"] = (
            "the file doesn't say which axis is up: this one was taken, and nothing speaks against it"
        )
    unknown = [tracker for tracker in recording.trackers if tracker not in recording.segments]
    if unknown:
        suggest[f"--roles {shlex.quote(unknown[0])}=SEGMENT"] = (
            f"nothing says where {', '.join(unknown)} {'is' if len(unknown) == 1 else 'are'} worn; calibrate can also tell from geometry"
        )
    poses, problem = _calibration_poses(recording)
    found.record["calibration_poses"] = poses
    if poses:
        suggest[f"retarget calibrate {name} -o operator.json"] = "Still, T- and Forward pose are in this recording"
    else:
        found.record["calibration_poses_problem"] = problem
        suggest[f"retarget convert {name} --robot tocabi --method telemanipulation --calibration operator.json"] = (
            "a log of trackers needs the operator, whom retarget calibrate gets from a recording of three poses"
        )


def _calibration_poses(recording: TrackerRecording) -> tuple[dict[str, list[float]] | None, str]:
    """(pose → (start, end) s, "") where the three poses can be found, else (None, why not)."""
    from retarget.core.calibrate import operator

    try:
        return {pose: list(window) for pose, window in operator.calibrate(recording).windows_s.items()}, ""
    except RetargetError as error:
        return None, str(error)


def _trajectory(found: Inspection, trajectory: JointTrajectory, robot: str | None) -> None:
    from retarget.core import robot_model

    record, name = found.record, _quoted(found.path)
    timing = inspection.Timing.of(trajectory.time)
    record["timing"] = _timing(timing)
    if trajectory.status.any():
        found.doubts.append(f"{int((trajectory.status != 0).sum())} frames are marked as not solved")
    chosen = robot or (trajectory.robot if trajectory.robot in robots.names() else None) or _robot_of(trajectory)
    record["checked_against"] = chosen
    record["joint_ranges"] = _ranges(trajectory, None)
    if chosen is None:
        found.suggestions["--robot NAME"] = "the file doesn't say which robot it is for, and the joints are nobody's"
        return
    profile = robots.load(chosen)
    if profile.model.kind == "human":
        return  # a model of the person who was recorded, who is not known here
    model = robot_model.build(profile)
    if set(model.joint_names) != set(trajectory.joint_names):
        odd = sorted(set(model.joint_names) ^ set(trajectory.joint_names))
        found.doubts.append(
            f"the joints are not those of {chosen}: {', '.join(odd[:SHOWN])}{' …' if odd[SHOWN:] else ''}"
        )
        return
    order = [trajectory.joint_names.index(joint) for joint in model.joint_names]
    found.data = _reordered(trajectory, model.joint_names, order)
    found.model = model
    record["joint_ranges"] = _ranges(found.data, model)
    outside = [entry["joint"] for entry in record["joint_ranges"] if entry["frames_outside"]]
    fast = [entry["joint"] for entry in record["joint_ranges"] if entry["speed_ratio"] > 1 + 1e-9]
    if outside:
        found.doubts.append(f"beyond their limits: {', '.join(outside)}")
    if fast:
        found.doubts.append(f"faster than their limits: {', '.join(fast)}")
    if timing.uneven:
        found.doubts.append(
            f"{timing.uneven} steps between frames differ from the usual {1000 * timing.usual_s:.3g} ms"
        )
    given = "" if trajectory.robot == chosen else f" --robot {shlex.quote(chosen)}"
    found.suggestions[f"retarget validate {name}{given}"] = "replays it in physics and gives a verdict"


def _robot_of(trajectory: JointTrajectory) -> str | None:
    """The robot that has exactly these joints."""
    from retarget.core import robot_model

    for name in robots.names():
        profile = robots.load(name)
        if profile.model.kind == "human":
            continue
        try:
            joints = robot_model.build(profile).joint_names
        except RetargetError:  # another package's robot whose model is missing
            continue
        if set(joints) == set(trajectory.joint_names):
            return name
    return None


def _reordered(trajectory: JointTrajectory, names: Sequence[str], order: list[int]) -> JointTrajectory:
    from dataclasses import replace

    return replace(
        trajectory,
        joint_names=tuple(names),
        position=trajectory.position[:, order],
        velocity=trajectory.velocity[:, order],
    )


def _ranges(trajectory: JointTrajectory, model: RobotModel | None) -> list[dict[str, Any]]:
    """Each joint's range in its own unit (rad, m), with the limits of the model that has the same joints in the same order."""
    rows = []
    for column, joint in enumerate(trajectory.joint_names):
        angle, speed = trajectory.position[:, column], np.abs(trajectory.velocity[:, column]).max()
        row: dict[str, Any] = {
            "joint": joint,
            "min": float(angle.min()),
            "max": float(angle.max()),
            "speed": float(speed),
        }
        if model is not None:
            lower, upper = float(model.lower[column]), float(model.upper[column])
            outside = (angle < lower - 1e-9) | (angle > upper + 1e-9)
            row |= {
                "lower": lower,
                "upper": upper,
                "frames_outside": int(outside.sum()),
                "speed_ratio": float(speed / model.velocity_limit[column]),
            }
        rows.append(row)
    return rows


def _fitting_robots(motion: HumanMotion) -> list[dict[str, Any]]:
    """Every robot with the segments it follows that this motion lacks, those that lack nothing first."""
    rows = []
    for name in robots.names():
        profile = robots.load(name)
        if profile.model.kind == "human":
            continue
        lacks = [segment for segment in profile.links if not motion.has(segment)]
        rows.append({"robot": name, "follows": len(profile.links), "lacks": lacks, "places_hands": bool(profile.arms)})
    return sorted(rows, key=lambda row: len(row["lacks"]))


def _fastest(names: Sequence[str], turn: Any, speed: Any, among: Any) -> list[dict[str, Any]]:
    peaks = np.where(among, turn.max(axis=0), -1.0)
    rows = []
    for column in np.argsort(peaks)[::-1][:SHOWN].tolist():
        if among[column]:
            fastest = np.nan_to_num(speed[:, column], nan=-1.0).max()
            rows.append(
                {
                    "name": names[column],
                    "rad_s": float(turn[:, column].max()),
                    "rad_s_p95": float(np.percentile(turn[:, column], 95)),
                    "m_s": float(fastest) if fastest >= 0 else None,
                }
            )
    return rows


def _timing(timing: inspection.Timing) -> dict[str, float | int]:
    return {
        "usual_step_s": timing.usual_s,
        "shortest_step_s": timing.shortest_s,
        "longest_step_s": timing.longest_s,
        "uneven_steps": timing.uneven,
    }


def _round_rate(step_s: float) -> float:
    rate = 1.0 / step_s if step_s else 60.0
    return float(round(rate)) if abs(rate - round(rate)) < 0.05 * rate else rate


def _quoted(path: str) -> str:
    return shlex.quote(path)
