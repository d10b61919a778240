"""What `retarget convert` will do, decided completely before it does anything: which outputs of which inputs, and whether that can work."""

from __future__ import annotations

import contextlib
import os
import string
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from retarget.core.errors import UnknownNameError, UsageError

if TYPE_CHECKING:
    from retarget.core.profile import RobotProfile
    from retarget.formats.base import Format

PLACEHOLDERS = ("stem", "robot", "mapping", "format")
PIPE = "-"


@dataclass(frozen=True)
class Clip:
    """One recording for one robot.

    input, output: paths, or "-" for stdin and stdout. robot: name or profile path as given; robot_name: the profile's own.
    format, style: of the output. human: whether the person is written along, where the format can. report, rerun: paths of the HTML page and
    the Rerun recording, "" for none. options: fields of `ConvertOptions`.
    self_collision: whether to look for it. method: what the user asked for. calibration: path of the operator's, or None. log: what a tracker log doesn't say (`tracker_logs`).
    """

    input: str
    output: str
    robot: str
    robot_name: str
    format: str
    style: str | None = None
    overwrite: bool = False
    human: bool = True
    self_collision: bool = False
    report: str = ""
    rerun: str = ""
    options: Mapping[str, Any] | None = None
    method: str = "geometric"
    calibration: str | None = None
    log: Mapping[str, Any] = field(default_factory=dict)


def stem(path: str, suffixes: Sequence[str]) -> str:
    """The file's name without folder and without the longest of `suffixes` it ends with; "stdin" for "-"."""
    if path == PIPE:
        return "stdin"
    name = Path(path).name
    if Path(path).is_dir():  # a rosbag2 folder
        return name or Path(path).resolve().name
    fitting = [suffix for suffix in suffixes if name.lower().endswith(suffix) and len(name) > len(suffix)]
    return name[: -len(max(fitting, key=len))] if fitting else Path(name).stem


def fill(template: str, values: Mapping[str, str]) -> str:
    """`template` with its placeholders replaced. Raises `UsageError` for unknown ones and for values that would change the folder."""
    parts = []
    for literal, name in _parse(template):
        parts.append(literal)
        if name is not None:
            value = values[name]
            if value in ("", ".", "..") or "/" in value or "\0" in value:
                raise UsageError(f"-o {template}: {{{name}}} would be '{value}', which is no file name")
            parts.append(value)
    return "".join(parts)


def with_stem(template: str, stem: str, option: str) -> str:
    """`template` with {stem} replaced. Raises `UsageError` for an input whose stem would change the folder; `option` names the template."""
    if "{stem}" in template and (stem in ("", ".", "..") or "/" in stem or "\0" in stem):
        raise UsageError(f"{option} {template}: {{stem}} would be '{stem}', which is no file name")
    return template.replace("{stem}", stem)


def output_format(template: str | None, wanted: str | None, known: Mapping[str, Format]) -> Format:
    """The format to write: `wanted`, else by the suffix of `template`, else MCAP. Raises `UsageError` when they contradict."""
    writable = {name: format_ for name, format_ in known.items() if format_.writable}
    by_suffix = None
    if template and not _is_folder(template) and template != PIPE:
        name = Path(template).name.lower()
        by_suffix = next((f for f in writable.values() if name.endswith(f.suffixes)), None)
    if wanted:
        chosen = writable[wanted]
        if by_suffix and by_suffix.name != wanted:
            raise UsageError(f"-o {template} is a name for {by_suffix.name}, but --format is {wanted}")
    elif by_suffix:
        chosen = by_suffix
    elif template is None or template == PIPE or _is_folder(template):
        chosen = writable["mcap"]
    else:
        suffixes = ", ".join(s for f in writable.values() for s in f.suffixes)
        raise UsageError(f"-o {template}: no format has this suffix; expected one of {suffixes}, or --format")
    if template == PIPE and not chosen.pipeable:
        raise UsageError(f"{chosen.name} can't be written to a pipe; use -o FILE")
    return chosen


def folder_template(template: str | None, format_: Format) -> str:
    """The template with the default file name where it names none (None) or only a folder."""
    name = "{stem}_{robot}" + next(iter(format_.suffixes), "")
    if template is None:
        return name
    if _is_output_folder(template, format_):
        return template
    return str(Path(template) / name) if _is_folder(template) else template


def _is_folder(template: str) -> bool:
    return template != PIPE and (template.endswith("/") or Path(template).is_dir())


def _is_output_folder(path: str, format_: Format) -> bool:
    """Whether an earlier output of this format, which is a folder, stands at `path`."""
    from retarget import formats

    return formats.is_output_folder(path, format_)


def is_finished(clip: Clip) -> bool:
    """Whether the clip's output is there, and so is complete."""
    from retarget import formats

    return Path(clip.output).is_file() or _is_output_folder(clip.output, formats.get(clip.format))


def make(
    inputs: Sequence[str],
    robots: Mapping[str, RobotProfile],
    template: str,
    format_: Format,
    *,
    known: Mapping[str, Format],
    mapping: str,
    report: str | None,
    rerun: str | None = None,
    **rest: Any,
) -> list[Clip]:
    """One clip for every input and robot, no two with one output. Raises `UsageError`."""
    suffixes = [s for known_ in known.values() for s in known_.suffixes]
    clips = []
    for path in inputs:
        for robot, profile in robots.items():
            values = {"stem": stem(path, suffixes), "robot": profile.name, "mapping": mapping, "format": format_.name}
            output = template if template == PIPE else fill(template, values)
            page = _beside(report, values, ".html", ".htm") if report else ""
            log = _beside(rerun, values, ".rrd") if rerun else ""
            clips.append(Clip(path, output, robot, profile.name, format=format_.name, report=page, rerun=log, **rest))
    if template == PIPE and len(clips) > 1:
        raise UsageError(f"-o - takes one recording and one robot; found {len(clips)}")
    _refuse_shared(clips, "output", template)
    _refuse_shared(clips, "report", report or "")
    _refuse_shared(clips, "rerun", rerun or "")
    return clips


def check_outputs(clips: Sequence[Clip], template: str) -> None:
    """Raise `UsageError` unless every clip's files can be written: not there yet (or `overwrite`), folder there and writable."""
    from retarget import formats

    probed: set[Path] = set()
    fixed = _fixed_folder(template)
    for clip in clips:
        for path in (clip.output, clip.report, clip.rerun):
            if path in ("", PIPE):
                continue
            if path == clip.output and (format_ := formats.get(clip.format)).write_folder is not None:
                _check_folder_target(Path(path), format_, overwrite=clip.overwrite)
            else:
                _check_target(Path(path), overwrite=clip.overwrite)
            folder = Path(path).parent
            if folder not in probed:
                probed.add(folder)
                _check_folder(folder, may_be_made=path == clip.output and folder != fixed, fixed=fixed)


def check_single_files(paths: Sequence[str], inputs: Sequence[str], *, overwrite: bool) -> None:
    """Raise `UsageError` unless each of `paths` can be written to: no folder, none of `inputs`, not there yet (or `overwrite`), none twice."""
    taken = {_identity(path): f"the input {path}" for path in inputs if path != PIPE}
    for path in paths:
        if (place := _identity(path)) in taken:
            raise UsageError(f"{path}: would replace {taken[place]}")
        taken[place] = f"the output {path}"
        if os.path.lexists(path) and not overwrite and not Path(path).is_dir():
            raise UsageError(f"{path}: exists; --force replaces it")
        _check_target(Path(path), overwrite=True)
        _check_folder(Path(path).parent, may_be_made=False, fixed=Path(path).parent)


def write_whole(path: str | Path, data: bytes) -> None:
    """Write `data` to the file `path`, which appears whole or not at all. Raises `RetargetError` when it can't be, such as on a full disk."""
    from retarget import formats

    with formats.new_file(path) as stream:
        stream.write(data)


def _parse(template: str) -> Iterator[tuple[str, str | None]]:
    try:
        fields = list(string.Formatter().parse(template))
    except ValueError as error:
        raise UsageError(f"-o {template}: {error}; write {{{{ or }}}} for a brace itself") from None
    for literal, name, spec, conversion in fields:
        if name is not None and name not in PLACEHOLDERS:
            raise UnknownNameError("placeholder", name, PLACEHOLDERS, where=f"-o {template}")
        if spec or conversion:
            raise UsageError(f"-o {template}: {{{name}}} takes no format or conversion")
        yield literal, name


def _beside(path: str, values: Mapping[str, str], *suffixes: str) -> str:
    """The file that `path` names by ending with one of `suffixes`, else one of the clip's own name in the folder `path`."""
    if path.lower().endswith(suffixes):
        return path
    return str(Path(path) / fill("{stem}_{robot}" + suffixes[0], values))


def _refuse_shared(clips: Sequence[Clip], kind: str, template: str) -> None:
    inputs = {_identity(clip.input): clip.input for clip in clips if clip.input != PIPE}
    taken: dict[str, Clip] = {}
    for clip in clips:
        path = getattr(clip, kind)
        if path in ("", PIPE):
            continue
        place = _identity(path)
        if place in inputs:
            raise UsageError(f"{path}: the {kind} would replace the input {inputs[place]}")
        if place in taken:
            other = taken[place]
            if other.input == clip.input and other.robot_name != clip.robot_name:
                why = f"robots {other.robot_name} and {clip.robot_name}; put {{robot}} into {template}"
            elif other.input == clip.input:
                why = f"{clip.input}, which is given twice for robot {clip.robot_name}"
            else:
                why = f"{other.input} and {clip.input}; put {{stem}} into {template} or give the inputs different names"
            raise UsageError(f"{path}: one {kind} for {why}")
        taken[place] = clip


def _identity(path: str) -> str:
    """The same text for two paths that name the same place."""
    return str(Path(path).parent.resolve() / Path(path).name)


def _check_target(path: Path, *, overwrite: bool) -> None:
    if path.is_dir():
        raise UsageError(f"{path}: is a folder")
    if not os.path.lexists(path):
        return
    if path.exists() and not path.is_file():
        raise UsageError(f"{path}: not a regular file; -o - writes to stdout")
    if not overwrite:
        raise UsageError(f"{path}: exists; --force replaces it, --skip-existing leaves it")


def _check_folder_target(path: Path, format_: Format, *, overwrite: bool) -> None:
    if not os.path.lexists(path):
        return
    if not path.is_dir():
        raise UsageError(f"{path}: is a file; {format_.name} is a folder")
    if not _is_output_folder(str(path), format_):
        raise UsageError(
            f"{path}: is a folder that is no {format_.name} written here, so it is never replaced; give another name"
        )
    if not overwrite:
        raise UsageError(f"{path}: exists; --force replaces it, --skip-existing leaves it")


def _fixed_folder(template: str) -> Path:
    """The part of the template's folder that no placeholder decides: it has to exist; what follows is made when it is needed."""
    fixed = []
    for part in Path(template).parent.parts:
        pieces = list(_parse(part))
        if any(name is not None for _, name in pieces):
            break
        fixed.append("".join(literal for literal, _ in pieces))
    return Path(*fixed)


def _check_folder(folder: Path, *, may_be_made: bool, fixed: Path) -> None:
    start = folder
    while may_be_made and start != fixed and not os.path.lexists(start):
        start = start.parent
    if not start.exists():
        raise UsageError(f"{start}: no such folder; make it first (mkdir -p {start})")
    if not start.is_dir():
        raise UsageError(f"{start}: not a folder")
    # Asking for permission bits says little (root, read-only and virtual file systems): try it. The file has no name on Linux.
    try:
        with contextlib.closing(tempfile.TemporaryFile(dir=start)):
            pass
    except OSError as error:
        raise UsageError(f"{start}: can't write into this folder ({error.strerror})") from None
