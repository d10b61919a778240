"""Mappings: a person's motion → `Targets` for a robot's frames. One file each, exposing one `MAPPING`.

Found by listing this folder and through the entry-point group `retarget.mappings`.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import entry_points

from retarget.core.errors import UnknownNameError, UsageError
from retarget.core.types import Targets

GROUP = "retarget.mappings"
SHARED = frozenset(
    {
        "arm_frames",
        "hand_blend",
        "hand_weights",
        "heading",
        "limb_twist",
        "link_rotations",
        "operator_arms",
        "operator_frame",
        "priority_levels",
        "projection",
        "relative_orientation",
        "telemanipulation",
        "trunk",
    }
)
"""Modules of this folder that serve the mappings and are none themselves."""


@dataclass(frozen=True)
class Mapping:
    """A name, one line of description with its source, and the function (motion, robot, **settings) → targets.

    settings: names of the keyword arguments that `targets` takes beside the two. needs_calibration: whether `motion.calibration` must be there.
    """

    name: str
    description: str
    targets: Callable[..., Targets]
    settings: frozenset[str] = frozenset()
    needs_calibration: bool = False


def names() -> list[str]:
    """Names of all mappings, sorted. Imports none of them."""
    return sorted({*_local(), *(point.name for point in entry_points(group=GROUP))})


def load(name: str) -> Mapping:
    """The mapping called `name`: this folder's, else the installed one.

    Raises `UnknownNameError` with the nearest names, and `UsageError` for an installed one that is no `Mapping`.
    """
    if name in _local():
        local: Mapping = import_module(f"{__name__}.{name}").MAPPING
        return local
    installed = {point.name: point for point in entry_points(group=GROUP)}
    if name not in installed:
        raise UnknownNameError("mapping", name, names())
    loaded = installed[name].load()
    if not isinstance(loaded, Mapping):
        raise UsageError(
            f"mapping '{name}' ({installed[name].value}): found {type(loaded).__name__}, expected a Mapping"
        )
    return loaded


def _local() -> list[str]:
    return [m.name for m in pkgutil.iter_modules(__path__) if not m.name.startswith("_") and m.name not in SHARED]
