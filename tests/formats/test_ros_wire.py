"""Poses of many messages read at once: what each alone gives, however little the messages are alike."""

from __future__ import annotations

import numpy as np
import pytest
from retarget.formats._ros_wire import READERS, BadMessage, Cursor, read_all

from tests.formats.ros_recordings import Ros

KIND = "tf2_msgs/TFMessage"


@pytest.mark.parametrize("version", [1, 2])
def test_more_layouts_than_are_looked_for(version: int) -> None:
    """Two hundred frames with names of one length, each in a message of its own, twice."""
    ros, rng = Ros(version), np.random.default_rng(0)
    payloads = []
    for i in range(400):
        moved = ros.transform(i * 1_000_000, "world", f"t{i % 200:03d}", rng.normal(size=3), np.array([1.0, 0, 0, 0]))
        store, name = ros.store, "tf2_msgs/msg/TFMessage"
        raw = store.serialize_ros1(ros.tf(moved), name) if version == 1 else store.serialize_cdr(ros.tf(moved), name)
        payloads.append(memoryview(raw))
    found = {}
    for one in read_all(payloads, READERS[KIND], ros1=version == 1):
        for index, stamp, values in zip(one.message.tolist(), one.stamps.tolist(), one.values.tolist(), strict=True):
            assert found.setdefault(index, (one.parent, one.child, stamp, tuple(values)))[1] == one.child
    assert len(found) == len(payloads)
    for index, payload in enumerate(payloads):
        (alone,) = READERS[KIND](Cursor(payload, ros1=version == 1))
        assert found[index] == tuple(alone)
    with pytest.raises(BadMessage) as caught:
        list(read_all([*payloads, payloads[0][:-1]], READERS[KIND], ros1=version == 1))
    assert caught.value.index == 400
