"""An object whose pickle is a call that leaves a trace."""

from __future__ import annotations

from collections.abc import Callable


class Bomb:
    """Sets `ran` when it is unpickled."""

    ran = False

    def __reduce__(self) -> tuple[Callable[[], None], tuple[()]]:
        return _explode, ()


def _explode() -> None:
    Bomb.ran = True
