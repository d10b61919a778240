"""HDF5 of what a replay measured at every step of its simulation: written for analysis elsewhere, not read back here.

| path | shape | holds |
|---|---|---|
| `/time` | (K,) | s, of every step |
| `/<signal>` | (K,) or (K, n) | one dataset a signal, its attribute `unit` from its name's ending; columns in the order of `joint_names` |

Attributes of the file: `schema joint_names robot mode rate_hz` and whatever else the caller knows of the run.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, BinaryIO

from retarget.core.types import Array

SCHEMA = "retarget.replay/1"
UNITS = {"_rad_s": "rad/s", "_rad": "rad", "_nm": "Nm", "_w": "W", "_j": "J", "_m": "m", "_n": "N", "_s": "s"}
"""Ending of a signal's name → its unit; the first that fits."""


def write_log(stream: BinaryIO, time: Array, signals: Mapping[str, Array], facts: Mapping[str, Any]) -> None:
    """Write signals (K,) or (K, n), sampled at `time` (K,) s, to a stream that can seek. facts: texts, numbers, lists of texts."""
    import h5py
    import numpy as np

    with h5py.File(stream, "w") as file:
        file.attrs["schema"] = SCHEMA
        for name, value in facts.items():
            texts = isinstance(value, list | tuple)
            file.attrs[name] = np.array(value, dtype=h5py.string_dtype()) if texts else value
        file.create_dataset("time", data=time).attrs["unit"] = "s"
        for name, values in signals.items():
            chunks = (min(len(values), 4096), *values.shape[1:])
            dataset = file.create_dataset(name, data=values, chunks=chunks, compression="gzip", compression_opts=1)
            dataset.attrs["unit"] = next((unit for ending, unit in UNITS.items() if name.endswith(ending)), "")
