"""What the batch tests let worker processes do: here, because a worker must be able to import it by name."""

from __future__ import annotations

import os
import signal
import time
from functools import lru_cache
from pathlib import Path

from retarget.core.errors import FormatError


def slow_square(number: int) -> int:
    """Later items are done first, so that order can't come from luck."""
    time.sleep(0.02 * (5 - number % 5))
    return number * number


def picky(number: int) -> int:
    if number == 1:
        raise FormatError("one.mvnx", "no frames", expected="at least one")
    if number == 2:
        raise ZeroDivisionError("two\nlines")
    if number == 3:
        raise FileNotFoundError(2, "No such file or directory", "three.mvnx")
    return number


@lru_cache(maxsize=1)
def expensive() -> tuple[int, float]:
    return os.getpid(), time.monotonic()


def where_built(_item: int) -> tuple[int, tuple[int, float], str | None]:
    time.sleep(0.02)
    return os.getpid(), expensive(), os.environ.get("OMP_NUM_THREADS")


def die(number: int) -> int:
    if number == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(0.2)
    return number


def write_until_interrupted(path: str) -> None:
    """Leaves a mark of how it ended: an interrupted worker must get to clean up."""
    Path(path + ".started").touch()
    try:
        time.sleep(60)
    except KeyboardInterrupt:
        Path(path + ".cleaned").touch()
        raise
