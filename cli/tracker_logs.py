"""What tracker logs don't say of themselves, as options that several commands share; and recordings of either kind as a motion."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click
from retarget.cli import options as o
from retarget.cli.plan import PIPE
from retarget.core.errors import FormatError, MotionError, RetargetError, UsageError

if TYPE_CHECKING:
    from retarget.core.calibration import Calibration
    from retarget.core.types import HumanMotion, TrackerRecording
    from retarget.formats import TrackerOptions

Command = TypeVar("Command", bound=Callable[..., Any])

LOG_RATE = "--log-rate"
"""The rate of a tracker log, of commands whose --rate is another one."""
LOG_CHOICES = {
    "columns": "--columns",
    "up": "--up",
    "log_rate_hz": LOG_RATE,
    "role": "--roles",
    "roles_file": "--roles-file",
    "frames": "--frames",
    "clock": "--clock",
    "msg_def": "--msg-def",
}
"""Arguments that `log_options` adds to a command, and what each is called there."""


def log_options(*rate_names: str) -> Callable[[Command], Command]:
    """Adds --columns, --up, --roles, --roles-file, --frames, --clock, --msg-def and `rate_names`, as the arguments `LOG_CHOICES`."""

    def add(command: Command) -> Command:
        for option in (
            click.option(
                "--msg-def",
                multiple=True,
                metavar="PATH",
                help="Message definitions that a ROS recording lacks: a .msg file or a folder; repeat for several.",
            ),
            click.option(
                "--clock",
                type=click.Choice(["header", "log"]),
                help="Times of a ROS recording: the messages' own stamps (default), or the recorder's.",
            ),
            click.option("--frames", metavar="FILE.toml", help="Which frame of a ROS recording is what."),
            click.option(
                *rate_names,
                "log_rate_hz",
                type=o.Number("HZ", above=0),
                help="Frame rate of a tracker log without times.",
            ),
            click.option("--up", type=click.Choice(["y", "z"]), help="Vertical axis of a tracker log."),
            click.option("--columns", metavar="FILE.toml", help="Which column of a tracker log is what."),
            click.option("--roles-file", metavar="FILE", help="More of these, one SERIAL=SEGMENT a line."),
            click.option(
                "--roles",
                "role",
                multiple=True,
                type=o.Pair("SERIAL=SEGMENT"),
                help="A tracker's segment or role; repeat for several.",
            ),
        ):
            command = option(command)
        return command

    return add


def log_facts(choices: dict[str, Any]) -> dict[str, Any]:
    """Takes `LOG_CHOICES` out of a command's arguments: keyword arguments of `TrackerOptions`, in plain types. Raises `UsageError`."""
    columns, up, rate_hz, role, roles_file, frames, clock, msg_def = (choices.pop(name) for name in LOG_CHOICES)
    roles = {**(_roles_of(roles_file) if roles_file else {}), **_unique(role, "--roles")}
    facts = {"columns": columns, "up": up, "rate_hz": rate_hz, "roles": roles}
    return {**facts, "frames": frames, "clock": clock, "msg_defs": list(msg_def)}


def tracker_options(facts: Mapping[str, Any]) -> TrackerOptions:
    """The reader's options of what `log_facts` gave."""
    from retarget.formats import TrackerOptions

    files = {name: Path(facts[name]) if facts.get(name) else None for name in ("columns", "frames")}
    return TrackerOptions(**{**facts, **files, "msg_defs": tuple(Path(path) for path in facts.get("msg_defs", ()))})


def read_recording(path: str, facts: Mapping[str, Any]) -> HumanMotion | TrackerRecording:
    """The motion or the tracker log at `path`, or on stdin for "-"."""
    from retarget import formats

    options = tracker_options(facts)
    if path == PIPE:
        return formats.read_recording(sys.stdin.buffer, "stdin", options=options)
    return formats.read_recording(path, options=options)


def read_calibrated(path: str, calibration: str | None, facts: Mapping[str, Any]) -> HumanMotion:
    """The motion at `path` with the calibration in the file `calibration`; of a tracker log, which needs one, of its calibrated trackers.

    Raises `UsageError` for a log without calibration, `MotionError` for a calibration of other trackers.
    """
    recording = read_recording(path, facts)
    return _calibrated(recording, load_calibration(calibration) if calibration else None, _shown(path))


def stream_calibrated(
    path: str, calibration: str | None, facts: Mapping[str, Any], first_s: float
) -> Iterator[HumanMotion]:
    """As `read_calibrated`, in consecutive parts while the recording arrives, the first lasting `first_s`, as `formats.stream_recording` says."""
    from retarget import formats

    known = load_calibration(calibration) if calibration else None
    source: Any = sys.stdin.buffer if path == PIPE else path
    for part in formats.stream_recording(source, first_s, _shown(path), tracker_options(facts)):
        yield _calibrated(part, known, _shown(path))


def _shown(path: str) -> str:
    return "stdin" if path == PIPE else path


def _calibrated(recording: HumanMotion | TrackerRecording, known: Calibration | None, shown: str) -> HumanMotion:
    from dataclasses import replace

    from retarget.core.calibrate.apply import apply
    from retarget.core.types import TrackerRecording

    if isinstance(recording, TrackerRecording):
        if known is None:
            raise UsageError(
                f"{shown}: a tracker log says nothing of the person; give --calibration FILE.json (retarget calibrate makes it)"
            )
        try:
            return apply(known, recording)
        except MotionError as error:
            raise MotionError(f"{shown}: {error}") from error
    if known is not None and known.trackers:
        raise MotionError(
            f"{shown}: calibration of another tracker set: it is of {', '.join(sorted(known.trackers.values()))}; "
            "the recording is a suit's"
        )
    return replace(recording, calibration=known) if known else recording


def load_calibration(path: str) -> Calibration:
    """The calibration in the JSON file `path`. Raises `UsageError` where there is none that can be read."""
    from retarget.core import calibration

    try:
        return calibration.load(path)
    except UsageError:
        raise
    except RetargetError as error:
        raise UsageError(str(error)) from error


def _roles_of(path: str) -> dict[str, str]:
    """Tracker → segment from lines SERIAL=SEGMENT; empty lines and what follows a # don't count."""
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except (OSError, ValueError) as error:
        reason = error.strerror.lower() if isinstance(error, OSError) and error.strerror else "not text"
        raise UsageError(f"--roles-file {path}: {reason}") from None
    pairs = []
    for number, line in enumerate(text.splitlines(), 1):
        content = line.partition("#")[0].strip()
        if not content:
            continue
        serial, equals, segment = (part.strip() for part in content.partition("="))
        if not (serial and equals and segment):
            raise FormatError(path, f"found '{content}'", place=f"line {number}", expected="SERIAL=SEGMENT")
        pairs.append((serial, segment))
    if not pairs:
        raise UsageError(f"--roles-file {path}: names no tracker; expected lines SERIAL=SEGMENT")
    return _unique(pairs, f"--roles-file {path}")


def _unique(pairs: Sequence[tuple[str, str]], where: str) -> dict[str, str]:
    found: dict[str, str] = {}
    for serial, segment in pairs:
        if found.setdefault(serial, segment) != segment:
            raise UsageError(f"{where}: tracker '{serial}' is given as {found[serial]} and as {segment}; choose one")
    return found
