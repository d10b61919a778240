"""The log of a replay: grows block by block, and any HDF5 reader finds names, units and values."""

from __future__ import annotations

import io

import h5py
import numpy as np
import pytest
from retarget.formats import ReplayLog


def test_blocks_stand_behind_each_other() -> None:
    stream, rng = io.BytesIO(), np.random.default_rng(1)
    time, torque = np.arange(2500) / 2000, rng.normal(size=(2500, 3))
    facts = {"joint_names": ["a", "ü", "c"], "robot": "g1", "feed_forward": True, "rate_hz": 2000.0}
    with ReplayLog(stream, {"time": "s", "torque": "Nm"}, facts) as log:
        for start in range(0, 2500, 1000):
            part = slice(start, start + 1000)
            log.append({"time": time[part], "torque": torque[part], "not asked for": time[part]})
    with h5py.File(io.BytesIO(stream.getvalue())) as file:
        assert set(file) == {"time", "torque"}
        np.testing.assert_array_equal(file["time"], time)
        np.testing.assert_array_equal(file["torque"], torque)
        assert {name: dataset.attrs["unit"] for name, dataset in file.items()} == {"time": "s", "torque": "Nm"}
        assert list(file.attrs["joint_names"]) == ["a", "ü", "c"]
        assert (file.attrs["schema"], file.attrs["robot"]) == ("retarget.replay/1", "g1")
        assert file.attrs["feed_forward"]
        assert file.attrs["rate_hz"] == 2000.0


def test_a_signal_that_is_missing_is_no_gap() -> None:
    with ReplayLog(io.BytesIO(), {"time": "s", "torque": "Nm"}, {}) as log, pytest.raises(KeyError):
        log.append({"time": np.zeros(3)})
