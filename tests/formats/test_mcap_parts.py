"""A trajectory written to MCAP in parts: the messages of the whole, read by independent readers, and no end where its writer failed."""

from __future__ import annotations

import io
import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import NonSeekingReader, SeekingReader, make_reader
from retarget import formats
from retarget.core.errors import FormatError, RetargetError, UsageError
from retarget.core.types import JointTrajectory
from retarget.formats import mcap
from rosbags.highlevel import AnyReader

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)
    from mcap_ros2.reader import read_ros2_messages

Maker = Callable[..., JointTrajectory]
ARRAYS = ("time", "position", "velocity", "base_position", "base_orientation", "base_linear_velocity", "status")


def part_of(trajectory: JointTrajectory, first: int, stop: int, **changes: Any) -> JointTrajectory:
    names = (*ARRAYS, "base_angular_velocity")
    arrays = {name: getattr(trajectory, name) for name in names}
    return replace(trajectory, **{n: None if a is None else a[first:stop] for n, a in arrays.items()}, **changes)


def parts_of(trajectory: JointTrajectory, *borders: int) -> Iterator[JointTrajectory]:
    edges = [0, *borders, trajectory.frames]
    for first, stop in pairwise(edges):
        known = trajectory.provenance if stop == trajectory.frames else {"input_sha256": ""}
        yield part_of(trajectory, first, stop, provenance=known)


def in_parts(trajectory: JointTrajectory, *borders: int) -> bytes:
    out = io.BytesIO()
    formats.write_trajectory_parts(out, parts_of(trajectory, *borders))
    return out.getvalue()


def at_once(trajectory: JointTrajectory) -> bytes:
    out = io.BytesIO()
    formats.write_trajectory_stream(out, trajectory)
    return out.getvalue()


def messages(data: bytes) -> dict[str, list[tuple[int, int, bytes]]]:
    """Topic → (log time, sequence, content) by the mcap package's reader, which checks every checksum."""
    found: dict[str, list[tuple[int, int, bytes]]] = {}
    for _, channel, message in make_reader(io.BytesIO(data), validate_crcs=True).iter_messages():
        found.setdefault(channel.topic, []).append((message.log_time, message.sequence, message.data))
    return found


@pytest.fixture(scope="module")
def walk(make_trajectory: Maker) -> JointTrajectory:
    return make_trajectory(frames=1200, joints=29, rate_hz=240)


@pytest.mark.parametrize("borders", [(), (1,), (600,), (1199,), (7, 8, 900)], ids=str)
def test_the_messages_are_those_of_the_whole(walk: JointTrajectory, borders: tuple[int, ...]) -> None:
    found, expected = messages(in_parts(walk, *borders)), messages(at_once(walk))
    marked = expected.pop("/frame_status")
    # Parts without a marked frame have no status messages; the others have one for each of their frames.
    assert [m for m in found.pop("/frame_status") if m[2] != marked[0][2]] == [
        m for m in marked if m[2] != marked[0][2]
    ]
    assert found == expected


def test_it_comes_back(walk: JointTrajectory) -> None:
    data = in_parts(walk, 300, 700)
    for source in (io.BytesIO(data), io.BufferedReader(Unseekable(data))):
        found = formats.read_trajectory(source, "clip")
        for name in (*ARRAYS, "base_angular_velocity"):
            np.testing.assert_allclose(getattr(found, name), getattr(walk, name), rtol=0, atol=5e-10, err_msg=name)
        assert found.provenance == walk.provenance
        assert (found.robot, found.joint_names, found.robot_description) == (
            walk.robot, walk.joint_names, walk.robot_description,
        )  # fmt: skip
    assert formats.describe(io.BytesIO(data), "clip")["frames"] == walk.frames


class Unseekable(io.RawIOBase):
    """A pipe."""

    def __init__(self, data: bytes) -> None:
        self._data = io.BytesIO(data)

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        return self._data.readinto(buffer)


@pytest.mark.parametrize("marked", [True, False])
def test_independent_readers(walk: JointTrajectory, marked: bool, tmp_path: Path) -> None:
    walk = walk if marked else replace(walk, status=np.zeros(walk.frames, np.int8))
    data = in_parts(walk, 500)
    for reader in (NonSeekingReader(io.BytesIO(data)), SeekingReader(io.BytesIO(data))):
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        counts = {summary.channels[i].topic: n for i, n in summary.statistics.channel_message_counts.items()}
        assert counts["/joint_states"] == counts["/tf"] == walk.frames
        assert counts["/frame_status"] == (700 if marked else 0)
        assert len(summary.metadata_indexes) == 2
    states = [m.ros_msg for m in read_ros2_messages(io.BytesIO(data), topics=["/joint_states"])]
    np.testing.assert_array_equal([state.position for state in states], walk.position)
    path = tmp_path / "clip.mcap"
    path.write_bytes(data)
    with AnyReader([path]) as bag:
        read = [
            bag.deserialize(raw, connection.msgtype)
            for connection, _, raw in bag.messages(bag.connections)
            if connection.topic == "/joint_states"
        ]
        np.testing.assert_array_equal([state.velocity for state in read], walk.velocity)  # type: ignore[attr-defined]  # of its type


def test_a_part_is_out_before_the_next_is_asked_for(walk: JointTrajectory) -> None:
    out = io.BytesIO()
    sizes = []

    def watched() -> Iterator[JointTrajectory]:
        for part in parts_of(walk, 400, 800):
            sizes.append(out.tell())
            yield part

    formats.write_trajectory_parts(out, watched())
    assert sizes[0] == 0
    assert sizes[1] > 100_000
    assert sizes[2] > sizes[1] + 100_000


def test_what_fails_midway_has_no_end(walk: JointTrajectory) -> None:
    out = io.BytesIO()

    def failing() -> Iterator[JointTrajectory]:
        yield part_of(walk, 0, 600)
        raise RetargetError("the recording was cut off")

    with pytest.raises(RetargetError, match=r"^the recording was cut off$"):
        formats.write_trajectory_parts(out, failing())
    with pytest.raises(
        FormatError, match=r"^clip, byte \d+: the file ends inside a record's head.*was the writer inter"
    ):
        formats.read_trajectory(io.BytesIO(out.getvalue()), "clip")


def test_metadata_is_repeated_only_where_it_changed(walk: JointTrajectory) -> None:
    out = io.BytesIO()
    mcap.write_parts(out, [part_of(walk, 0, 600), part_of(walk, 600, 1200)])
    summary = make_reader(io.BytesIO(out.getvalue())).get_summary()
    assert summary is not None
    assert len(summary.metadata_indexes) == 1


def test_parts_that_do_not_fit_together(walk: JointTrajectory, make_trajectory: Maker) -> None:
    for other in (part_of(walk, 500, 700), part_of(make_trajectory(frames=1200, joints=28, rate_hz=240), 600, 1200)):
        with pytest.raises(RetargetError, match=r"^mcap: the part from \S+ s on does not continue the one before$"):
            mcap.write_parts(io.BytesIO(), [part_of(walk, 0, 600), other])
    with pytest.raises(RetargetError, match=r"robot holds a NUL character"):
        formats.write_trajectory_parts(io.BytesIO(), [replace(walk, robot="a\0b")])
    with pytest.raises(UsageError, match=r"^csv can't be written in parts; expected a whole trajectory$"):
        formats.write_trajectory_parts(io.BytesIO(), [walk], "csv")
