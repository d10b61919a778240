"""Robot profiles: TOML files of this folder, of entry points in group `retarget.robots`, or any path a user names."""

from __future__ import annotations

import tomllib
from importlib.metadata import entry_points
from importlib.resources import files
from pathlib import Path
from typing import Any

from retarget.core.errors import ProfileError, UnknownNameError
from retarget.core.profile import RobotProfile
from retarget.robots.schema import parse_profile

MAX_EXTENDS = 8
MODEL_SOURCES = ("package", "path", "file", "human")


def _paths() -> dict[str, Path]:
    folder = Path(str(files("retarget.robots")))
    found = {path.stem: path for path in folder.glob("*.toml")}
    for point in entry_points(group="retarget.robots"):
        found.setdefault(point.name, Path(str(point.load())))
    return found


def names() -> list[str]:
    """Names of the robots that can be given by name, sorted. Reads no profile."""
    return sorted(_paths())


def load(name_or_path: str) -> RobotProfile:
    """The profile called `name_or_path`, or the one in the TOML file at that path (anything with a slash or ending in .toml).

    Raises `UnknownNameError` with the nearest names, or `ProfileError` naming file, key and what was expected.
    """
    path = _find(name_or_path, where="")
    return parse_profile(_read_merged(path, depth=0), path)


def _find(name_or_path: str, *, where: str, beside: Path | None = None) -> Path:
    if name_or_path.endswith(".toml") or "/" in name_or_path:
        path = Path(name_or_path)
        if beside is not None and not path.is_absolute():
            path = beside / path
        if not path.is_file():
            raise ProfileError(name_or_path, "no such profile file", place=where)
        return path.resolve()
    known = _paths()
    if name_or_path not in known:
        raise UnknownNameError("robot", name_or_path, known, where=where)
    return known[name_or_path]


def _read_merged(path: Path, *, depth: int) -> dict[str, Any]:
    """The file's tables, laid over those of the profile that it `extends`."""
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except UnicodeDecodeError:
        raise ProfileError(path, "not UTF-8 text", expected="a TOML file") from None
    except (ValueError, RecursionError) as error:  # ValueError: TOMLDecodeError, and numbers of thousands of digits
        raise ProfileError(path, f"not TOML: {error}") from None
    except OSError as error:
        raise ProfileError(path, f"can't be read: {error.strerror}") from None
    parent = table.pop("extends", None)
    if parent is None:
        _make_model_file_absolute(table, path)
        return table
    if not isinstance(parent, str):
        raise ProfileError(path, f"found {parent!r}", place="key extends", expected="a robot's name or a TOML path")
    if depth >= MAX_EXTENDS:
        raise ProfileError(path, f"extends more than {MAX_EXTENDS} profiles deep", place="key extends")
    base = _read_merged(_find(parent, where=f"{path}, key extends", beside=path.parent), depth=depth + 1)
    base.pop("name", None)  # a variant is called by its own file unless it says otherwise
    _make_model_file_absolute(table, path)
    mine, theirs = table.get("model"), base.get("model")
    if isinstance(mine, dict) and isinstance(theirs, dict) and any(key in mine for key in MODEL_SOURCES):
        # A variant with a model of its own must not inherit where the other one comes from.
        base["model"] = {key: value for key, value in theirs.items() if key not in MODEL_SOURCES}
    return _merge(base, table)


def _make_model_file_absolute(table: dict[str, Any], path: Path) -> None:
    model = table.get("model")
    if isinstance(model, dict) and isinstance(model.get("file"), str):
        model["file"] = str((path.parent / model["file"]).resolve())


def _merge(base: dict[str, Any], over: dict[str, Any]) -> dict[str, Any]:
    merged = dict(base)
    for key, value in over.items():
        mine = merged.get(key)
        merged[key] = _merge(mine, value) if isinstance(mine, dict) and isinstance(value, dict) else value
    return merged
