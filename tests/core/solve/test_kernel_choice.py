"""When compiled code is worth its loading."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from retarget.core.errors import UsageError
from retarget.core.solve import kernel_choice
from retarget.core.solve.kernel_choice import chosen


class Plain: ...


class Compiled(Plain): ...


Choice = Callable[[str, int], type[Plain]]


@pytest.fixture
def choice() -> Choice:
    """Of clips that pay from 10 on, or from 50 on where nothing is kept."""
    pytest.importorskip("numba", reason="numba is not there for this Python")
    return lambda kernel, size: chosen(kernel, Plain, lambda: Compiled, size, 10, 50)


@pytest.mark.parametrize(
    ("size", "kept", "found"), [(9, True, Plain), (10, True, Compiled), (49, False, Plain), (50, False, Compiled)]
)
def test_auto_goes_by_size(choice: Choice, monkeypatch: pytest.MonkeyPatch, size: int, kept: bool, found: type) -> None:
    from retarget.core.solve import jit

    monkeypatch.setattr(jit, "kept", kept)
    assert choice("auto", size) is found
    assert choice("numpy", size) is Plain
    assert choice("compiled", size) is Compiled


def broken() -> type[Plain]:
    raise ImportError("Numba needs NumPy 2.3 or less")


def test_numba_that_cannot_be_imported_is_done_without() -> None:
    assert chosen("auto", Plain, broken, 50, 10, 50) is Plain


def test_but_not_silently_when_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernel_choice, "find_spec", lambda _: object())
    with pytest.raises(UsageError, match=r"numba can't be used: Numba needs NumPy 2\.3 or less"):
        chosen("compiled", Plain, broken, 50, 10, 50)
    monkeypatch.setattr(kernel_choice, "find_spec", lambda _: None)
    with pytest.raises(UsageError, match="pip install numba"):
        chosen("compiled", Plain, broken, 50, 10, 50)
