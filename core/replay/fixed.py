"""Replay on a fixed base under torque control at 2000 Hz: does the robot's own dynamics, within its motors' limits, follow the motion?

The base link is held upright where the model puts it, whatever the trajectory says of its base: what is tried is the joints' motion, against gravity,
inertia, friction and torque limits, not balance. The robot starts in the first frame, moving as the reference does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from retarget.core.errors import UsageError
from retarget.core.replay.fixed_measures import FixedMeasures
from retarget.core.replay.gains import NATURAL_FREQUENCY_RAD_S, Gains, GainSource, gains
from retarget.core.replay.model import ReplayModel
from retarget.core.replay.reference import Reference
from retarget.core.replay.reference_torque import ReferenceTorque
from retarget.core.replay.thresholds import Thresholds
from retarget.core.replay.torque_law import CONTROL_RATE_HZ, controlled_model
from retarget.core.replay.torque_loop import Signals, run
from retarget.core.report import Check, ValidationReport
from retarget.core.types import Array, BoolArray, JointTrajectory


@dataclass(frozen=True)
class FixedOptions:
    """How the robot is controlled.

    gains: "profile", "inertia", or "auto", the profile's where it states a joint's. natural_frequency_rad_s: for gains from inertia.
    feed_forward: add inverse dynamics of the reference, so that feedback has only errors to correct.
    friction_compensation: add what the joints' friction along the reference takes, as drives with torque sensors do.
    self_collision: links push each other; needs a model that was built with self-collision.
    """

    gains: GainSource = "auto"
    natural_frequency_rad_s: float = NATURAL_FREQUENCY_RAD_S
    feed_forward: bool = False
    friction_compensation: bool = True
    self_collision: bool = False


def replay(
    trajectory: JointTrajectory,
    model: ReplayModel,
    options: FixedOptions | None = None,
    thresholds: Thresholds | None = None,
    log: Callable[[Signals], None] | None = None,
) -> ValidationReport:
    """Follow `trajectory` with `model`, built on a fixed base, and report how well it went (mode "fixed").

    log: gets every control step's signals, some thousand at a time, in order; `Signals.joined` makes one of them.
    series, (B,) each: "time" in s; per joint "reference_deg/<joint>" and "position_deg/<joint>" at that time; "joint_error_deg/<joint>",
    "torque_nm/<joint>", and "power_w", of the steps from there to the next time the value of the largest size. Sliding joints: mm for deg, N for Nm.
    facts: "options", "control_rate_hz", "duration_s", "base", "model_warnings", and "joints": joint → its errors, torques, limit (None where unknown) and gains.
    Raises `InvalidDataError` for joints that don't fit the robot, `MotionError` for less than one control step, `UsageError` for options that
    contradict the model.
    """
    options, thresholds = options or FixedOptions(), thresholds or Thresholds("fixed")
    if thresholds.mode != "fixed":
        raise UsageError(f"thresholds are for mode '{thresholds.mode}'; expected 'fixed'")
    chosen = gains(model, options.gains, options.natural_frequency_rad_s)
    controlled = controlled_model(model, chosen, contacts=options.self_collision)
    reference = Reference.of(trajectory, model.robot, CONTROL_RATE_HZ)
    measures = FixedMeasures(model, reference.steps, reference.step_s)
    for signals in run(
        controlled,
        model,
        reference,
        chosen,
        friction_compensation=options.friction_compensation,
        feed_forward=options.feed_forward,
    ):
        measures.add(signals)
        if log is not None:
            log(signals)
    asked = ReferenceTorque.of(reference, model)
    checks = _Checks(model, thresholds, measures, reference, asked, chosen)
    return ValidationReport(
        trajectory.robot or model.robot.profile.name,
        tuple(checks.all()),
        _series(model, measures),
        mode="fixed",
        facts=_facts(trajectory, model, options, chosen, measures, asked),
    )


class _Checks:
    """The report's checks, each with the joint and the time at fault."""

    def __init__(
        self,
        model: ReplayModel,
        thresholds: Thresholds,
        measures: FixedMeasures,
        reference: Reference,
        asked: ReferenceTorque,
        chosen: Gains,
    ) -> None:
        self.names = model.robot.joint_names
        self.turning = _turning(model)
        self.check, self.measures, self.reference, self.asked = thresholds.check, measures, reference, asked
        self.damping_ratio = chosen.damping_ratio

    def all(self) -> Iterator[Check]:
        yield self.completed()
        yield from self.tracking("deg", self.turning, np.degrees(1.0))
        if not self.turning.all():
            yield from self.tracking("mm", ~self.turning, 1e3)
        yield from self.torques()
        yield from self.powers()

    def completed(self) -> Check:
        """A simulation that blew up is no verdict on the rest of the clip."""
        lost = self.reference.steps - self.measures.steps
        if not lost:
            return self.check("simulation_lost_s", 0.0)
        at = self.reference.time(self.measures.steps, self.measures.steps + 1)[0]
        worst = self.names[int(self.measures.peak_error.argmax())]
        note = "the simulation blew up: gains too high for these inertias at 2000 Hz, or links pressed into each other"
        return self.check("simulation_lost_s", lost * self.reference.step_s, note, where=worst, time_s=float(at))

    def tracking(self, unit: str, joints: BoolArray, scale: float) -> Iterator[Check]:
        """Errors of `joints` (n,) bool, in `unit`, `scale` of them a rad or m."""
        measures, chosen = self.measures, np.flatnonzero(joints)
        if not len(chosen):
            return
        rms, peak = measures.rms_error[chosen] * scale, measures.peak_error[chosen] * scale
        worst = int(rms.argmax())
        yield self.check(
            f"joint_tracking_rmse_{unit}",
            float(np.sqrt(np.mean(rms**2))),
            f"{rms[worst]:.3g} {unit} there, over the clip",
            where=self.names[chosen[worst]],
        )
        at = int(chosen[peak.argmax()])
        yield self.check(
            f"joint_tracking_peak_{unit}",
            float(peak.max()),
            where=self.names[at],
            time_s=float(measures.peak_error_s[at]),
        )

    def torques(self) -> Iterator[Check]:
        """How near the motors come to their limits."""
        measures = self.measures
        if not np.isfinite(measures.limit).any():
            for name in ("torque_saturation_percent", "torque_peak_ratio", "reference_torque_ratio_max"):
                yield self.check(name, None, "no joint's torque limit is known")
        else:
            percent, note, where, when = 100.0 * measures.saturated_steps / max(measures.steps, 1), "", "", None
            if measures.saturated_steps:
                worst = int(measures.joint_saturated_steps.argmax())
                where, when = self.names[worst], float(measures.first_saturated_s[worst])
                share = 100.0 * measures.joint_saturated_steps[worst] / measures.steps
                others = int(np.count_nonzero(measures.joint_saturated_steps)) - 1
                note = f"{share:.3g} % there, from then on" + (
                    f"; {others} more joint{'s' if others > 1 else ''}" if others else ""
                )
                asked = float(self.asked.ratio[worst])
                note += f"; the motion itself asks for {asked:.3g} of the limit there"
                if asked <= 1:
                    note += f", the rest is the controller's, whose gains damp it at {self.damping_ratio[worst]:.2g} of critical"
            yield self.check("torque_saturation_percent", percent, note, where=where, time_s=when)
            at = int(measures.torque_ratio.argmax())
            yield self.check(
                "torque_peak_ratio",
                float(measures.torque_ratio[at]),
                f"{measures.peak_torque[at]:.3g} of {measures.limit[at]:.3g} Nm",
                where=self.names[at],
                time_s=float(measures.peak_torque_s[at]),
            )
            yield self.asked_for()
        strongest = int(measures.rms_torque.argmax())
        yield self.check("torque_rms_nm", float(measures.rms_torque[strongest]), where=self.names[strongest])

    def asked_for(self) -> Check:
        """What the motion itself takes, whatever the controller."""
        asked = self.asked
        at = int(asked.ratio.argmax())
        note = f"{asked.peak[at]:.3g} of {self.measures.limit[at]:.3g} Nm"
        if asked.any_over_percent:
            note += f"; above the limit {asked.any_over_percent:.3g} % of the time"
        return self.check(
            "reference_torque_ratio_max",
            float(asked.ratio[at]),
            note,
            where=self.names[at],
            time_s=float(asked.time_s[at]),
        )

    def powers(self) -> Iterator[Check]:
        """What the motors give, and whether the simulation's energy adds up."""
        measures = self.measures
        yield self.check("power_peak_w", measures.peak_power_w, time_s=measures.peak_power_s)
        yield self.check("power_mean_w", measures.mean_power_w)
        yield self.check("energy_j", measures.energy_j)
        missing, gross = measures.energy_balance_j
        yield self.check("energy_balance_error_j", abs(missing), f"of {gross:.4g} J that the motors gave or took")


def _turning(model: ReplayModel) -> BoolArray:
    """(n,) bool: which joints turn; the others slide."""
    import mujoco

    kinds = model.mj.jnt_type[model.mj.dof_jntid[model.qvel]]
    return np.asarray(kinds == mujoco.mjtJoint.mjJNT_HINGE)


def _series(model: ReplayModel, measures: FixedMeasures) -> dict[str, Array]:
    points = measures.points()
    series = {"time": points.time, "power_w": points.power}
    for i, (name, turns) in enumerate(zip(model.robot.joint_names, _turning(model), strict=True)):
        unit, scale = ("deg", np.degrees(1.0)) if turns else ("mm", 1e3)
        series[f"reference_{unit}/{name}"] = points.reference[:, i] * scale
        series[f"position_{unit}/{name}"] = points.position[:, i] * scale
        series[f"joint_error_{unit}/{name}"] = points.error[:, i] * scale
        series[f"torque_nm/{name}"] = points.torque[:, i]
    return series


def _facts(
    trajectory: JointTrajectory,
    model: ReplayModel,
    options: FixedOptions,
    chosen: Gains,
    measures: FixedMeasures,
    asked: ReferenceTorque,
) -> dict[str, Any]:
    turning, rms_error, rms_torque = _turning(model), measures.rms_error, measures.rms_torque
    joints = {}
    for i, name in enumerate(model.robot.joint_names):
        unit, scale = ("deg", float(np.degrees(1.0))) if turning[i] else ("mm", 1e3)
        limit = float(measures.limit[i])
        joints[name] = {
            f"tracking_rmse_{unit}": float(rms_error[i]) * scale,
            f"tracking_peak_{unit}": float(measures.peak_error[i]) * scale,
            "tracking_peak_s": float(measures.peak_error_s[i]),
            "torque_rms_nm": float(rms_torque[i]),
            "torque_peak_nm": float(measures.peak_torque[i]),
            "torque_peak_s": float(measures.peak_torque_s[i]),
            "torque_limit_nm": limit if np.isfinite(limit) else None,
            "reference_torque_peak_nm": float(asked.peak[i]),
            "reference_torque_peak_s": float(asked.time_s[i]),
            "reference_torque_over_percent": float(asked.over_percent[i]),
            "saturated_percent": 100.0 * float(measures.joint_saturated_steps[i]) / max(measures.steps, 1),
            "stiffness_nm_rad": float(chosen.stiffness[i]),
            "damping_nms_rad": float(chosen.damping[i]),
            "damping_ratio": float(ratio) if np.isfinite(ratio := chosen.damping_ratio[i]) else None,
            "gains_from": "profile" if name in chosen.from_profile else "inertia",
        }
    base = "held upright"
    if trajectory.base_position is not None:
        base += "; the trajectory's base motion is not replayed"
    return {
        "options": asdict(options),
        "control_rate_hz": CONTROL_RATE_HZ,
        "duration_s": float(trajectory.time[-1] - trajectory.time[0]),
        "base": base,
        "model_warnings": list(model.warnings),
        "joints": joints,
    }
