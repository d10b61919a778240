"""What one file format is to the house: a name, how to know its files, and up to three functions.

Each format lives in one file of this folder and exposes one `FORMAT`. Readers and writers get an open binary stream and a display
name for messages; opening, renaming into place, decompression by suffix and pipes are done once, in `formats/__init__.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, BinaryIO

from retarget.core.types import HumanMotion, JointTrajectory

MotionReader = Callable[[BinaryIO, str], HumanMotion]
TrajectoryReader = Callable[[BinaryIO, str], JointTrajectory]
TrajectoryWriter = Callable[[BinaryIO, JointTrajectory, str], None]
Describer = Callable[[BinaryIO, str], Mapping[str, Any]]


@dataclass(frozen=True)
class Format:
    """One file format.

    suffixes: lower case, longest first where one ends with another (".mvnx.gz" before ".gz").
    magic: byte strings of which a file starts with one, for files whose suffix tells nothing; empty = no magic.
    read_motion, read_trajectory: (binary stream, display name) → type; None = this format doesn't hold that.
    write_trajectory: (binary stream, trajectory, style) → nothing.
    describe: (binary stream, display name) → facts for `retarget info`, cheaper than a full read; None = from a full read.
    pipeable: whether it can be written to and read from a stream that can't seek.
    styles: names accepted as `style` by `write_trajectory`, the default first.
    """

    name: str
    description: str
    suffixes: tuple[str, ...]
    magic: tuple[bytes, ...] = ()
    read_motion: MotionReader | None = None
    read_trajectory: TrajectoryReader | None = None
    write_trajectory: TrajectoryWriter | None = None
    describe: Describer | None = None
    pipeable: bool = False
    styles: tuple[str, ...] = field(default=("default",))
