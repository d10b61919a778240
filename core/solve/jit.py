"""numba for the solvers' inner loops: compiled once and kept, where there is a folder for that."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import njit

_F = TypeVar("_F", bound=Callable[..., Any])

kept = True
"""Whether there is a folder that keeps the compiled code; without, every process compiles it anew."""


def jit(function: _F) -> _F:
    """`function` compiled at its first call, and for later processes if it can be kept."""
    global kept
    try:
        return cast(_F, njit(cache=True)(function))
    except RuntimeError:
        kept = False
        return cast(_F, njit(function))
