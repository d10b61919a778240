"""Writes `docs/measured.md`, what the samples become on every robot: `python -m retarget.cli.measured docs/measured.md`; two minutes.

Every number comes from the program's own commands, run as a user runs them, and their JSON lines. A test measures a part of it again.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

ROBOTS = ("g1", "icub", "talos", "tocabi", "atlas", "baxter")
CLIPS = ("walk", "reach", "squat")
TRACKER_CLIPS = ("circles", "box", "clap")
TRACKER_ROBOTS = ("tocabi", "g1")
DIGITS = 2
"""Of every number: fewer than what differs from one machine to the next."""
HEAD = """<!-- Written by `python -m retarget.cli.measured docs/measured.md`; changes here are lost. -->

# Measured

What this package's samples become on its robots, and whether their motors can follow. Numbers have two digits; the commands are

```bash
{commands}
```

| column | is |
|---|---|
| limbs | angle between the person's and the robot's limbs, mean and 95th percentile over limbs and frames |
| hands | distance of the hands from where the operator's own poses put them, mean |
| limits broken | frames × joints outside the robot's limits of position or speed |
| motion asks | greatest torque that the motion itself takes, by inverse dynamics, of the motor's limit |
| tracking | root mean square of the joints' errors under torque control on a held base, over joints and time |
| saturated | steps in which any motor is at its limit |
| links meet | deepest overlap of two links that are no neighbours, mesh against mesh where it is deep |
| verdict | `retarget validate`'s: passed, or the checks that failed |

Motors reach their limits where the motion asks for more than they have, and with gains that let a leg ring (`--gains profile`: TOCABI's published
ones are for standing legs).
"""
COLUMNS = ("clip", "robot", "limbs / °", "hands / mm", "limits broken", "motion asks", "tracking / °", "saturated / %", "links meet / mm", "verdict")  # fmt: skip


@dataclass(frozen=True)
class Clip:
    """A sample on a robot. trackers: it is a log of six trackers, whose operator is calibrated first. gains: as `validate --gains` takes them."""

    sample: str
    robot: str
    trackers: bool = False
    gains: str = ""


def every_clip() -> Iterator[Clip]:
    """All that the page shows, in its order."""
    yield from (Clip(sample, robot) for sample in CLIPS for robot in ROBOTS)
    yield from (Clip(sample, "tocabi", gains="profile") for sample in CLIPS)
    yield from (Clip(sample, robot, trackers=True) for sample in TRACKER_CLIPS for robot in TRACKER_ROBOTS)


def commands(clip: Clip, samples: Path, folder: Path) -> list[list[str]]:
    """What a user types for `clip`: [calibrate,] convert, validate. folder: where their outputs go."""
    output = str(folder / f"{clip.sample}_{clip.robot}.mcap")
    validate = ["validate", output, *(["--gains", clip.gains] if clip.gains else [])]
    if not clip.trackers:
        convert = ["convert", str(samples / f"{clip.sample}.mvnx.gz"), "--robot", clip.robot, "-o", output]
        return [convert, validate]
    operator = str(folder / "operator.json")
    return [
        ["calibrate", str(samples / "calibration_trackers.csv"), "--up", "y", "-o", operator, "--force"],
        [
            "convert", str(samples / f"{clip.sample}_trackers.csv"), "--up", "y", "--calibration", operator,
            "--method", "telemanipulation", "--robot", clip.robot, "-o", output,
        ],
        validate,
    ]  # fmt: skip


def row(clip: Clip, samples: Path) -> list[str]:
    """The cells of `COLUMNS` for `clip`. Raises `click.ClickException` when a command fails otherwise than by its verdict."""
    with tempfile.TemporaryDirectory() as folder:
        *before, convert, validate = commands(clip, samples, Path(folder))
        for arguments in before:
            _run(arguments)
        metrics = _run([*convert, "--json"])["metrics"]
        verdict = _run([*validate, "--json"], allowed=(0, 3))
    checks = {check["name"]: check for check in verdict["checks"]}
    limbs, hands = metrics["limb_direction_error_deg"], metrics["hand_position_error_mm"]
    overlap = checks["self_collision_depth_mm"]
    failed = [name for name, check in checks.items() if check["passed"] is False and check["limit"] is not None]
    return [
        clip.sample,
        clip.robot + (f" `--gains {clip.gains}`" if clip.gains else ""),
        f"{rounded(limbs['mean'])} / {rounded(limbs['p95'])}" if not clip.trackers else "",
        rounded(hands["mean"]) if hands else "",
        str(metrics["position_limit_violations"] + metrics["velocity_limit_violations"]),
        rounded(checks["reference_torque_ratio_max"]["value"]),
        rounded(checks["joint_tracking_rmse_deg"]["value"]),
        rounded(checks["torque_saturation_percent"]["value"]),
        rounded(overlap["value"]) + (f" ({overlap['where']})" if overlap["where"] else ""),
        "passed" if verdict["passed"] else ", ".join(f"`{name}`" for name in failed),
    ]


def page(clips: Iterable[Clip], samples: Path) -> str:
    """The page over `clips`, as Markdown."""
    shown = [
        commands(Clip("walk", "g1"), Path("samples"), Path()),
        commands(Clip("box", "tocabi", True), Path("samples"), Path()),
    ]
    text = "\n".join(" ".join(["retarget", *arguments]) for arguments in [*shown[0], *shown[1]])
    lines = [HEAD.format(commands=text), "| " + " | ".join(COLUMNS) + " |", "|" + "---|" * len(COLUMNS)]
    lines += ["| " + " | ".join(row(clip, samples)) + " |" for clip in clips]
    return "\n".join(lines) + "\n"


def rounded(value: float | None) -> str:
    """`value` with `DIGITS` significant digits; a dash for None."""
    return "–" if value is None else f"{float(f'{value:.{DIGITS}g}'):.15g}"


def _run(arguments: list[str], allowed: tuple[int, ...] = (0,)) -> dict[str, Any]:
    """The JSON line that `retarget` prints, {} for none."""
    done = subprocess.run(
        [sys.executable, "-m", "retarget.cli", *arguments, "--quiet"], capture_output=True, text=True, check=False
    )
    if done.returncode not in allowed:
        raise click.ClickException(
            f"retarget {' '.join(arguments)}: exit code {done.returncode}: {done.stderr.strip()}"
        )
    return dict(json.loads(done.stdout)) if done.stdout.strip() else {}


@click.command(help=__doc__)
@click.argument("output", type=click.Path(dir_okay=False, path_type=Path))
def write(output: Path) -> None:
    """Measure everything and write the page."""
    from retarget import samples

    output.write_text(page(every_clip(), samples.sample_path("walk").parent), encoding="utf-8")


if __name__ == "__main__":
    write()
