"""Finds formats: every module of this folder that exposes `FORMAT`, and the entry points of group `retarget.formats`.

Listing names imports nothing. Format modules are light: heavy libraries are imported inside their functions.
"""

from __future__ import annotations

import importlib
import pkgutil
import warnings
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path

from retarget.core.errors import FormatError, UnknownNameError, nearest
from retarget.formats.base import Format

GROUP = "retarget.formats"
_PACKAGE = "retarget.formats"


def names() -> list[str]:
    """Names of all formats, sorted, without importing any."""
    return sorted({*_built_in(), *_plugins()})


def get(name: str) -> Format:
    """The format called `name`; `UnknownNameError` names those near it."""
    if name in _built_in():
        found = getattr(importlib.import_module(f"{_PACKAGE}.{name}"), "FORMAT", None)
    elif name in (plugins := _plugins()):
        found = _load(plugins[name])
    else:
        found = None
    if not isinstance(found, Format):
        raise UnknownNameError("format", name, available())
    return found


def available() -> dict[str, Format]:
    """All formats by name. A plugin that can't be loaded is left out with a warning; one can't replace a format of this package."""
    found = {}
    for name in _built_in():
        module = importlib.import_module(f"{_PACKAGE}.{name}")
        if isinstance(format_ := getattr(module, "FORMAT", None), Format):
            found[name] = format_
    for name, plugin in _plugins().items():
        if name not in found and (loaded := _load(plugin)) is not None:
            found[name] = loaded
    return dict(sorted(found.items()))


def detect(path: str | Path, head: bytes, reader: str = "") -> Format:
    """The format of a file: by its suffix, else by the magic bytes that `head`, its first bytes, starts with.

    Of formats that share the suffix it is the one that recognises `head`, else the one that has `reader` ("read_trackers" …).
    Raises `FormatError` when the suffix is one format's but the content starts as another's, and when nothing matches;
    the latter names the readable suffixes and the nearest.
    """
    formats = available()
    by_suffix = _chosen(_of_suffix(path, formats), head, reader)
    if by_suffix is not None and (not by_suffix.magic or _starts(head, by_suffix)):
        return by_suffix
    by_magic = next((f for f in formats.values() if _starts(head, f)), None)
    if by_suffix is None and by_magic is None:
        readable = {
            suffix
            for f in formats.values()
            if f.read_motion or f.read_trajectory or f.read_trackers or f.read_recording
            for suffix in f.suffixes
        }
        found = f"unknown suffix '{Path(path).suffix}'" if Path(path).suffix else "no suffix"
        near = nearest(Path(path).suffix, readable)
        hint = f"did you mean {' or '.join(near)}? " if near else ""
        problem = f"{found}, and the content is of no known format"
        raise FormatError(path, problem, expected=f"{hint}one of {', '.join(sorted(readable))}")
    if by_suffix is not None and by_magic is not None:
        raise FormatError(
            path,
            f"the suffix says {by_suffix.name}, the content is {by_magic.name}",
            expected=f"a matching suffix ({', '.join(by_magic.suffixes)}) or the format '{by_magic.name}' named explicitly",
        )
    chosen = by_suffix or by_magic
    assert chosen is not None
    # A suffix without its magic bytes: the format's reader says best what is wrong with the content.
    return chosen


def of_suffix(path: str | Path, formats: dict[str, Format] | None = None) -> Format | None:
    """The format whose suffix the file name ends with, the longest suffix winning; None when there is none.

    Of several that share the suffix it is the one that can be written.
    """
    return _chosen(_of_suffix(path, formats or available()), b"", "write_trajectory")


def _of_suffix(path: str | Path, formats: dict[str, Format]) -> list[Format]:
    """The formats with the longest suffix that the file name ends with."""
    lower = Path(path).name.lower()
    pairs = [(len(s), f) for f in formats.values() for s in f.suffixes if lower.endswith(s)]
    longest = max((length for length, _ in pairs), default=0)
    return [format_ for length, format_ in pairs if length == longest]


def _chosen(sharing: list[Format], head: bytes, reader: str) -> Format | None:
    if len(sharing) < 2:
        return sharing[0] if sharing else None
    for format_ in sharing:
        if format_.recognises is not None and format_.recognises(head):
            return format_
    return next((format_ for format_ in sharing if getattr(format_, reader, None)), sharing[0])


def _starts(head: bytes, format_: Format) -> bool:
    return any(head.startswith(magic) for magic in format_.magic)


def _built_in() -> list[str]:
    folder = [str(Path(__file__).parent)]
    return [
        module.name
        for module in pkgutil.iter_modules(folder)
        if not module.name.startswith("_") and module.name != "base"
    ]


def _plugins() -> dict[str, EntryPoint]:
    return {point.name: point for point in entry_points(group=GROUP)}


def _load(plugin: EntryPoint) -> Format | None:
    # A plugin is foreign code: whatever it raises must not take the formats of this package with it.
    try:
        loaded = plugin.load()
    except Exception as error:
        warnings.warn(f"format plugin '{plugin.name}' ({plugin.value}) can't be loaded: {error}", stacklevel=2)
        return None
    found = getattr(loaded, "FORMAT", loaded)
    if not isinstance(found, Format):
        warnings.warn(f"format plugin '{plugin.name}' ({plugin.value}) holds no Format", stacklevel=2)
        return None
    return found
