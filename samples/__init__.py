"""Small recordings of a synthetic person, made by `retarget.samples.generate`, and beside each the JSON it must decode to."""

from __future__ import annotations

from pathlib import Path

from retarget.core.errors import UnknownNameError

_FOLDER = Path(__file__).parent
_SUFFIXES = (".mvnx.gz", ".csv")


def sample_names() -> tuple[str, ...]:
    """Names of the samples, sorted."""
    return tuple(sorted(_paths()))


def sample_path(name: str) -> Path:
    """The recording called `name`. Raises `UnknownNameError` with the nearest names when there is none."""
    paths = _paths()
    if name not in paths:
        raise UnknownNameError("sample", name, paths)
    return paths[name]


def _paths() -> dict[str, Path]:
    return {path.name.removesuffix(suffix): path for suffix in _SUFFIXES for path in _FOLDER.glob(f"*{suffix}")}
