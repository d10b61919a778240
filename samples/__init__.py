"""Small recordings of a synthetic person, made by `retarget.samples.generate`, and beside each the JSON it must decode to."""

from __future__ import annotations

from pathlib import Path

from retarget.core.errors import UnknownNameError

_FOLDER = Path(__file__).parent
_SUFFIX = ".mvnx.gz"


def sample_names() -> tuple[str, ...]:
    """Names of the samples, sorted."""
    return tuple(sorted(path.name.removesuffix(_SUFFIX) for path in _FOLDER.glob(f"*{_SUFFIX}")))


def sample_path(name: str) -> Path:
    """The recording called `name`. Raises `UnknownNameError` with the nearest names when there is none."""
    if name not in sample_names():
        raise UnknownNameError("sample", name, sample_names())
    return _FOLDER / f"{name}{_SUFFIX}"
