"""Whether a clip is worth compiled code, which takes a while to load, and much longer to compile."""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec
from typing import TypeVar

from retarget.core.errors import UsageError

T = TypeVar("T")


def chosen(
    kernel: str, plain: type[T], compiled: Callable[[], type[T]], size: int, pays: int, unkept_pays: int
) -> type[T]:
    """What `compiled` imports, or `plain`, which gives the same answers with NumPy.

    kernel: "compiled", "numpy", or "auto", compiled if numba is there and the clip's `size` at least `pays`, or `unkept_pays` where no folder keeps
    compiled code. Raises `UsageError` for "compiled" when numba is not installed.
    """
    if kernel == "compiled" and find_spec("numba") is None:
        raise UsageError("the compiled kernel needs numba; expected pip install numba, or the numpy kernel")
    if kernel == "numpy" or (kernel == "auto" and size < pays):
        return plain
    try:
        found = compiled()
        from retarget.core.solve import jit
    except ImportError as error:  # not installed, or not for this version of NumPy
        if kernel == "compiled":
            raise UsageError(f"numba can't be used: {error}") from None
        return plain
    return found if kernel == "compiled" or jit.kept or size >= unkept_pays else plain
