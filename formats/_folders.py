"""Formats that are folders: known by what they hold, written beside their place and renamed into it when complete."""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path

from retarget.core.errors import UsageError
from retarget.formats import _files, _registry
from retarget.formats.base import Format


def format_of(path: object) -> Format | None:
    """The format that the folder `path` is of; None where it is of none, or no folder."""
    if not isinstance(path, str | Path) or not is_folder(path):
        return None
    formats = _registry.available().values()
    return next((f for f in formats if f.recognises_folder is not None and f.recognises_folder(Path(path))), None)


def is_folder(path: str | Path) -> bool:
    """Whether there is a folder at `path`; not for names that are none, where pathlib raises (too long, a NUL)."""
    try:
        return Path(path).is_dir()
    except (OSError, ValueError):
        return False


def is_output(folder: Path, chosen: Format) -> bool:
    """Whether `folder` is an earlier output of format `chosen`, which is a folder, and nothing else."""
    return chosen.is_own_folder is not None and is_folder(folder) and chosen.is_own_folder(folder)


def holds_only(folder: Path, names: Collection[str]) -> bool:
    """Whether all files below `folder` are among `names`, paths within it; links count as files."""
    below = (path for path in folder.rglob("*") if path.is_symlink() or not path.is_dir())
    return all(path.relative_to(folder).as_posix() in names for path in below)


@contextmanager
def placed(path: str | Path, target: Path, chosen: Format, overwrite: bool) -> Iterator[Path]:
    """A new, empty folder beside `target` that takes its place when the body ends well, and is removed otherwise.

    An older folder is replaced only if it holds what this format wrote and nothing else: a recorded bag, or a folder with a `metadata.yaml` of
    another program, is more than an output. It is moved aside first, as no system call of POSIX replaces a folder that holds something. A killed process leaves at most a hidden `.retarget-….part`.
    Raises `UsageError` for a target that may not be replaced, `RetargetError` for what the file system refuses.
    """
    _check(path, target, chosen, overwrite)
    part = target.parent / _files.part_name()
    try:
        part.mkdir()
    except OSError as error:
        raise _files.refusal(path, error) from None
    try:
        try:
            yield part
            for place in (*part.rglob("*"), part):
                _sync(place)
            _check(path, target, chosen, overwrite)
            _replace(part, target)
        except OSError as error:
            raise _files.refusal(path, error) from error
    except BaseException:
        shutil.rmtree(part, ignore_errors=True)
        raise


def _check(path: str | Path, target: Path, chosen: Format, overwrite: bool) -> None:
    if not os.path.lexists(target):
        if not target.parent.is_dir():
            raise UsageError(f"{path}: there is no folder {target.parent}")
        return
    if not target.is_dir():
        raise UsageError(f"{path}: is a file; {chosen.name} is a folder")
    if not is_output(target, chosen):
        raise UsageError(
            f"{path}: is a folder that is no {chosen.name} written here, so it is never replaced; expected another name"
        )
    if not overwrite:
        raise UsageError(f"{path}: exists already; overwriting must be asked for")


def _replace(part: Path, target: Path) -> None:
    if not target.exists():
        part.rename(target)
        return
    old = target.parent / _files.part_name()
    target.rename(old)
    try:
        part.rename(target)
    except BaseException:
        with contextlib.suppress(OSError):
            old.rename(target)
        raise
    shutil.rmtree(old, ignore_errors=True)


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
