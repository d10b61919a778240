"""Mappings: a person's motion → `Targets` for a robot's frames. One file each, exposing one `MAPPING`.

Found by listing this folder and through the entry-point group `retarget.mappings`.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import entry_points

from retarget.core.errors import UnknownNameError
from retarget.core.robot_model import RobotModel
from retarget.core.types import HumanMotion, Targets


@dataclass(frozen=True)
class Mapping:
    """A name, one line of description with its source, and the function (motion, robot) → targets."""

    name: str
    description: str
    targets: Callable[[HumanMotion, RobotModel], Targets]


def names() -> list[str]:
    """Names of all mappings, sorted. Imports none of them."""
    local = [m.name for m in pkgutil.iter_modules(__path__) if not m.name.startswith("_") and m.name not in SHARED]
    return sorted({*local, *(point.name for point in entry_points(group="retarget.mappings"))})


def load(name: str) -> Mapping:
    """The mapping called `name`. Raises `UnknownNameError` with the nearest names."""
    if name not in names():
        raise UnknownNameError("mapping", name, names())
    for point in entry_points(group="retarget.mappings"):
        if point.name == name:
            loaded = point.load()
            break
    else:
        loaded = import_module(f"{__name__}.{name}").MAPPING
    if not isinstance(loaded, Mapping):
        raise TypeError(f"mapping '{name}' exposes {type(loaded).__name__}, expected Mapping")
    return loaded


SHARED = frozenset({"heading", "link_rotations", "limb_twist"})
"""Modules of this folder that serve the mappings and are none themselves."""
