"""Compiled code is kept where it can be."""

from __future__ import annotations

from typing import Any

import pytest

pytest.importorskip("numba", reason="numba is not there for this Python")
from retarget.core.solve import jit


def test_no_folder_for_compiled_code_is_no_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where numba finds no place for a cache it raises as the function is decorated."""

    def njit(function: Any = None, *, cache: bool = False) -> Any:
        if cache:
            raise RuntimeError("cannot cache function: no locator available")
        return function

    monkeypatch.setattr(jit, "kept", True)
    monkeypatch.setattr(jit, "njit", njit)

    def twice(x: float) -> float:
        return 2 * x

    assert jit.jit(twice)(3.0) == 6.0
    assert jit.kept is False
