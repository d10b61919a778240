"""Which files a command is to read: named, listed in a file, or found below folders."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from retarget.cli.plan import PIPE
from retarget.core.errors import UsageError, nearest

if TYPE_CHECKING:
    from retarget.formats.base import Format

KINDS = {
    "motion": ("recordings", "converts"),
    "trajectory": ("trajectories", "judges"),
    "any": ("recordings and trajectories", "reads"),
}


def collect_inputs(
    inputs: Sequence[str],
    files_from: str | None,
    *,
    nul: bool = False,
    recursive: bool | None = None,
    kind: Literal["motion", "trajectory", "any"] = "motion",
    logs: bool = False,
) -> list[str]:
    """Paths of all files of this kind named, listed in `files_from`, or found below folders. Raises `UsageError` for what isn't there.

    recursive: whether to look below folders; None for commands that never do. logs: whether tracker logs below folders are wanted, too; every
    other CSV has their suffix.
    """
    from retarget import formats

    what, verb = KINDS[kind]
    named = list(inputs) + (_listed(files_from, nul=nul) if files_from else [])
    if nul and not files_from:
        raise UsageError("-0 says how --files-from is separated; give --files-from too")
    if not named:
        raise UsageError(f"no input; give {what}, or --files-from")
    if named.count(PIPE) > 1 or (PIPE in named and files_from == PIPE):
        raise UsageError("stdin ('-') can be read only once")
    readable = [
        format_
        for format_ in formats.available().values()
        if getattr(format_, f"read_{kind}", None) is not None
        or (kind == "motion" and format_.read_recording is not None)
        or (logs and format_.read_trackers is not None)
    ]
    own = [format_ for format_ in readable if kind == "motion" and format_.is_own_output is not None]
    bags = kind == "any" or any(format_.name == "rosbag" for format_ in readable)
    suffixes = tuple(suffix for format_ in readable for suffix in format_.suffixes if suffix != ".txt")
    found: list[str] = []
    for name in named:
        bag = bags and formats.is_bag_folder(Path(name))
        _check_input(name)
        if name == PIPE or not Path(name).is_dir() or bag or (kind != "motion" and formats.folder_format(name)):
            found.append(name)
        elif recursive:
            found += _below(name, suffixes, what, own=own, bags=bags, folders=kind == "trajectory")
        elif recursive is None:
            raise UsageError(f"{name}: is a folder; expected files, or folders that are {what} themselves")
        else:
            raise UsageError(f"{name}: is a folder; -r {verb} all {what} below it")
    return found


def _listed(source: str, *, nul: bool) -> list[str]:
    if source == PIPE:
        data = sys.stdin.buffer.read()
    else:
        _check_input(source)
        if Path(source).is_dir():
            raise UsageError(f"--files-from {source}: is a folder; expected a file with an input a line")
        data = Path(source).read_bytes()
    names = [os.fsdecode(name) for name in (data.split(b"\0") if nul else data.splitlines()) if name]
    if not names:
        raise UsageError(f"--files-from {source}: lists no file")
    return names


def _check_input(name: str) -> None:
    if name == PIPE:
        return
    path = Path(name)
    try:
        exists = path.exists()
    except (OSError, ValueError) as error:  # a name that is too long, links in a loop, a NUL
        reason = error.strerror.lower() if isinstance(error, OSError) and error.strerror else str(error)
        raise UsageError(f"{name}: {reason}") from None
    if not exists:
        raise UsageError(f"{name}: no such file{_similar(path)}")
    if not os.access(path, os.R_OK):
        raise UsageError(f"{name}: not readable")


def _similar(path: Path) -> str:
    """A hint at files beside `path` with almost its name."""
    try:
        near = nearest(path.name, [entry.name for entry in path.parent.iterdir()])
    except OSError:
        return ""
    return f"; did you mean {' or '.join(str(path.with_name(name)) for name in near)}?" if near else ""


def _below(
    folder: str, suffixes: tuple[str, ...], what: str, *, own: Sequence[Format], bags: bool, folders: bool
) -> list[str]:
    """Files below `folder` with one of `suffixes`, and folders that are recordings (`bags`) or of a format (`folders`), but nothing inside them.

    own: formats of which outputs of ours don't count.
    """
    from retarget import formats

    found = []
    for base, inner, names in os.walk(folder):
        inner.sort()
        whole = [
            name
            for name in inner
            if (bags and formats.is_bag_folder(Path(base) / name))
            or (folders and formats.folder_format(Path(base) / name))
        ]
        found += [str(Path(base) / name) for name in whole if folders or not _is_output_bag(Path(base) / name)]
        inner[:] = [name for name in inner if name not in whole]
        paths = [Path(base) / name for name in sorted(names) if name.lower().endswith(suffixes)]
        found += [str(path) for path in paths if not any(_is_output(path, format_) for format_ in own)]
    if not found:
        raise UsageError(f"{folder}: no {what} below this folder; looked for {', '.join(suffixes)}")
    return found


def _is_output_bag(folder: Path) -> bool:
    from retarget import formats

    return formats.is_output_folder(folder, formats.get("rosbag2"))


def _is_output(path: Path, format_: Format) -> bool:
    if format_.is_own_output is None or not path.name.lower().endswith(format_.suffixes):
        return False
    try:
        with path.open("rb") as stream:
            return format_.is_own_output(stream.read(512))
    except OSError:
        return False
