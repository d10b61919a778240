"""HDF5 of what a replay measured at every step of its simulation: written for analysis elsewhere, not read back here.

| path | shape | holds |
|---|---|---|
| `/time` | (K,) | s, of every step, on the trajectory's clock |
| `/<signal>` | (K, n) | one dataset a signal, its unit in the attribute `unit`; columns in the order of `joint_names` |

Attributes of the file: `schema joint_names robot` and whatever else the caller knows of the run.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import TracebackType
from typing import Any, BinaryIO, Self

from retarget.core.types import Array

SCHEMA = "retarget.replay/1"
CHUNK_STEPS = 2000


class ReplayLog:
    """An HDF5 file that grows with the simulation, so that a clip's length doesn't show in memory; a context manager."""

    def __init__(self, stream: BinaryIO, units: Mapping[str, str], facts: Mapping[str, Any]) -> None:
        """units: signal → its unit, "time" among them. facts: name → text, number, or list of texts. `stream` has to seek and to read."""
        import h5py

        self._units = dict(units)
        self._file = h5py.File(stream, "w")
        self._file.attrs["schema"] = SCHEMA
        for name, value in facts.items():
            texts = isinstance(value, list | tuple)
            # As array of variable-length strings, which every HDF5 library reads.
            self._file.attrs.create(name, list(value) if texts else value, dtype=h5py.string_dtype() if texts else None)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()

    def append(self, signals: Mapping[str, Array]) -> None:
        """The next K steps: signal → (K,) or (K, n), the signals that have a unit and no others."""
        for name, unit in self._units.items():
            values = signals[name]
            if name not in self._file:
                dataset = self._file.create_dataset(
                    name,
                    shape=(0, *values.shape[1:]),
                    maxshape=(None, *values.shape[1:]),
                    chunks=(CHUNK_STEPS, *values.shape[1:]),
                    dtype="f8",
                    compression="gzip",
                    compression_opts=1,
                )
                dataset.attrs["unit"] = unit
            dataset = self._file[name]
            before = dataset.shape[0]
            dataset.resize(before + len(values), axis=0)
            dataset[before:] = values
