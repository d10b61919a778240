"""A suit's ROS recording read in parts as it arrives: joined, they are the motion of the whole, bit for bit, whatever is wrong with the recording."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cache
from typing import Any, BinaryIO, cast

import numpy as np
import pytest
from mcap.writer import Writer
from retarget import formats, samples
from retarget.core import rotations, timebase
from retarget.core.errors import FormatError, UsageError
from retarget.core.segments import PARENT
from retarget.core.timebase import joined
from retarget.core.types import HumanMotion, TrackerRecording
from retarget.formats import TrackerOptions, _ros_stream

from tests.formats.ros_recordings import START_NS, XSENS, Ros, Sent, flat_tf, hanging_arms, link_states, tree_tf

FIRST_S = 2.0
TF, STATIC, POSE = "tf2_msgs/msg/TFMessage", "/tf_static", "geometry_msgs/msg/PoseStamped"
SEGMENTS = ("Pelvis", "T8", "Head", "RightUpperArm", "RightForeArm", "LeftUpperArm", "LeftForeArm")


@pytest.fixture(autouse=True)
def small_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_ros_stream, "PART_S", 1.0)
    monkeypatch.setattr(_ros_stream, "SLACK_S", 0.3)


@cache
def ros() -> Ros:
    return Ros(2)


@cache
def motion() -> HumanMotion:
    """Twelve seconds of seven segments, at 30 Hz from 0: steps forth and back, never still."""
    walk = timebase.resample(timebase.cut(formats.read_motion(samples.sample_path("walk")), 2.0, 6.0), 30.0)
    forth = [walk.segments.index(segment) for segment in SEGMENTS]
    rows = np.resize(np.r_[0 : walk.frames, walk.frames - 2 : 0 : -1], 360)
    return HumanMotion(
        time=np.arange(len(rows)) / 30.0,
        segments=SEGMENTS,
        orientation=rotations.make_continuous(walk.orientation[rows][:, forth]),
        position=walk.position[rows][:, forth],
        source=walk.source,
    )


@cache
def flat(apart_ns: int = 0) -> tuple[Sent, ...]:
    """Seven messages a frame."""
    return tuple(flat_tf(ros(), motion(), motion().orientation, apart_ns=apart_ns))


def renamed(sent: Iterable[Sent], name: Callable[[str], str]) -> list[Sent]:
    """The messages with frames called name(segment as the drivers spell it)."""
    found = []
    for one in sent:
        (transform,) = one.message.transforms
        called = replace(transform, child_frame_id=name(transform.child_frame_id.removeprefix("skeleton_")))
        found.append(one._replace(message=ros().tf(called)))
    return found


def recorded(sent: Iterable[Sent], chunk_size: int = 8192, rest: bytes = b"") -> bytes:
    """An MCAP in chunks of less than a quarter of a second of `flat`."""
    stream = io.BytesIO()
    writer = Writer(stream, chunk_size=chunk_size)
    writer.start()
    channels: dict[str, int] = {}
    for one in sent:
        if one.topic not in channels:
            text, _ = ros().store.generate_msgdef(one.message_type, ros_version=2)
            schema = writer.register_schema(one.message_type, "ros2msg", text.encode())
            channels[one.topic] = writer.register_channel(one.topic, "cdr", schema)
        payload = bytes(ros().store.serialize_cdr(one.message, one.message_type))
        writer.add_message(channels[one.topic], one.log_time, payload, one.log_time)
    writer.finish()
    return stream.getvalue() + rest


class Pipe(io.RawIOBase):
    """What can't seek, and counts what was read."""

    def __init__(self, data: bytes) -> None:
        self._data, self.taken = io.BytesIO(data), 0

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        block = self._data.read(len(buffer))
        buffer[: len(block)] = block
        self.taken += len(block)
        return len(block)


def in_parts(data: bytes, options: TrackerOptions | None = None) -> list[HumanMotion]:
    parts = list(formats.stream_recording(cast(BinaryIO, Pipe(data)), FIRST_S, "clip", options))
    assert all(isinstance(part, HumanMotion) for part in parts)
    return cast(list[HumanMotion], parts)


def assert_same(
    data: bytes, least_parts: int = 5, options: TrackerOptions | None = None, *, sizes: bool = True
) -> HumanMotion:
    """That parts, at least so many, are the whole. sizes: also in what the first part alone decides of the person, which blends distort."""
    whole = formats.read_recording(io.BytesIO(data), "clip", options=options)
    assert isinstance(whole, HumanMotion)
    parts = in_parts(data, options)
    assert len(parts) >= least_parts
    found = joined(parts)
    for name in ("time", "orientation", "position"):
        np.testing.assert_array_equal(getattr(found, name), getattr(whole, name), err_msg=name)
    assert found.segments == whole.segments
    if sizes:
        assert found.source == whole.source
    assert _rows_of(found) == _rows_of(whole)
    if sizes:
        assert found.joint_offsets.keys() == whole.joint_offsets.keys()
        for segment, offset in found.joint_offsets.items():
            np.testing.assert_allclose(offset, whole.joint_offsets[segment], atol=1e-3)
    assert parts[0].time[-1] >= FIRST_S
    assert all(part.source.sha256 == "" for part in parts[:-1])
    return whole


def _rows_of(motion: HumanMotion) -> list[str]:
    """What is said of the recording's rows."""
    return [line for line in motion.source.warnings if "off its direction" not in line]


def without(sent: Iterable[Sent], dropped: Any) -> list[Sent]:
    """Messages but those for which dropped(frame's time in s, frame's name)."""
    return [
        one
        for one in sent
        if not dropped(
            (one.log_time - 1000 - START_NS) / 1e9, one.message.transforms[0].child_frame_id.removeprefix("skeleton_")
        )
    ]


class TestTheSameAsTheWhole:
    def test_flat_tf(self) -> None:
        whole = assert_same(recorded(flat()), 8)
        assert whole.source.warnings == ()

    def test_link_states(self) -> None:
        assert_same(recorded(link_states(ros(), motion(), motion().orientation)), 8)

    def test_hanging_arms_are_turned_in_all_parts(self) -> None:
        sent = flat_tf(ros(), motion(), hanging_arms(SEGMENTS, motion().orientation))
        whole = assert_same(recorded(sent), 8)
        assert np.degrees(rotations.angle(whole.orientation, motion().orientation)).max() < 1e-5

    def test_a_tree_with_dropped_transforms(self) -> None:
        parents = {segment: PARENT[segment] if PARENT[segment] in SEGMENTS else "T8" for segment in SEGMENTS}
        parents |= {"Pelvis": None, "T8": "Pelvis"}
        rng = np.random.default_rng(0)
        lost = rng.random((360, len(SEGMENTS))) < 0.15
        lost[:, 0] = False
        sent = tree_tf(ros(), motion(), motion().orientation, parents, lambda frame, column: bool(lost[frame, column]))
        whole = assert_same(recorded(sent), 5)
        assert whole.source.interpolated_frames > 200

    def test_signs_of_quaternions_do_not_count(self) -> None:
        rng = np.random.default_rng(1)
        signs = rng.choice([-1.0, 1.0], (360, len(SEGMENTS), 1))
        assert_same(recorded(flat_tf(ros(), motion(), signs * motion().orientation)), 8)

    @pytest.mark.parametrize("lasts_s", [0.4, 0.6, 3.0])
    @pytest.mark.parametrize("since_s", [1.0, 2.05, 4.5])
    def test_a_frame_is_lost_for_a_while(self, since_s: float, lasts_s: float) -> None:
        sent = without(flat(), lambda time, frame: frame == "head" and since_s < time < since_s + lasts_s)
        # Lost in the first part, it is waited for, and for the end of the longest blend that may follow.
        whole = assert_same(recorded(sent), 1 if since_s < FIRST_S and lasts_s > 0.5 else 2)
        assert any("marked" in line for line in whole.source.warnings)

    def test_a_frame_is_lost_for_good(self) -> None:
        data = recorded(without(flat(), lambda time, frame: frame == "head" and time > 4.0))
        assert_same(data, 2)

    def test_two_frames_are_lost_one_after_the_other(self) -> None:
        def dropped(time: float, frame: str) -> bool:
            return (frame == "head" and 3.0 < time < 4.0) or (frame == "t8" and 3.9 < time < 5.0)

        assert_same(recorded(without(flat(), dropped)), 2)

    def test_messages_out_of_order(self) -> None:
        sent = list(flat())
        rng = np.random.default_rng(2)
        order = np.argsort(np.arange(len(sent)) + rng.uniform(0, 40, len(sent)), kind="stable")
        whole = assert_same(recorded([sent[index] for index in order]), 5)
        assert any("out of order" in line for line in whole.source.warnings)

    def test_published_twice_as_fast_as_measured(self) -> None:
        twice = []
        for first in range(0, len(flat()), len(SEGMENTS)):
            for late in (0, 16_666_666):
                for one in flat()[first : first + len(SEGMENTS)]:
                    (transform,) = one.message.transforms
                    stamp = one.log_time - 1000 + late
                    later = replace(transform, header=ros().header(stamp, "world"))
                    twice.append(Sent("/tf", TF, stamp + 1000, ros().tf(later)))
        whole = assert_same(recorded(twice), 5)
        assert whole.frames == 360
        assert any("published faster" in line for line in whole.source.warnings)

    def test_bad_quaternions_and_placeholders(self) -> None:
        wrong = motion().orientation.copy()
        wrong[100:103, 2] *= 3.0
        wrong[200, 4] = 0.0
        whole = assert_same(recorded(flat_tf(ros(), motion(), wrong)), 5)
        assert any("quaternions rejected" in line for line in whole.source.warnings)

    def test_bytes_behind_the_document(self) -> None:
        whole = assert_same(recorded(flat(), rest=b"abc"), 5)
        assert "3 bytes after the end of the MCAP document were not read" in whole.source.warnings

    def test_the_readers_options_are_noted_in_every_part(self) -> None:
        options = TrackerOptions(clock="log", frames={"segments": {s: f"skeleton_{XSENS[s]}" for s in SEGMENTS}})
        data = recorded(flat())
        assert_same(data, 5, options)
        parts = in_parts(data, options)
        assert all(part.source.options["clock"] == "log" for part in parts)

    @pytest.mark.parametrize("seed", range(12))
    def test_faults_at_random(self, seed: int) -> None:
        """Losses of any length, at any time, of any frame, of which some run into each other; unturned quaternions and lengths."""
        rng = np.random.default_rng(seed)
        losses = [
            (XSENS[SEGMENTS[rng.integers(1, 7)]], start, start + float(rng.exponential(0.5)))
            for start in rng.uniform(0.0, 11.0, rng.integers(1, 9))
        ]
        wrong = motion().orientation * rng.choice([-1.0, 1.0, 1.0], (360, len(SEGMENTS), 1))
        wrong[rng.integers(0, 360, 4), rng.integers(0, 7, 4)] *= 2.0
        sent = flat_tf(ros(), motion(), wrong)
        kept = without(sent, lambda time, frame: any(frame == f and a < time < b for f, a, b in losses))
        assert_same(recorded(kept, int(rng.integers(2_000, 50_000))), 1, sizes=False)


class TestTimes:
    def test_frames_stamped_one_after_the_other_come_onto_an_even_grid(self) -> None:
        """The rate is that of the first part, not of the whole: a few ppb."""
        data = recorded(flat(1_000_000))
        whole = formats.read_motion(io.BytesIO(data), "clip")
        found = joined(in_parts(data))
        assert found.frames == whole.frames
        np.testing.assert_allclose(found.time, whole.time, atol=1e-6)
        assert np.abs(rotations.angle(found.orientation, whole.orientation)).max() < 1e-4
        np.testing.assert_allclose(found.position, whole.position, atol=1e-5)
        assert found.source.warnings == whole.source.warnings

    @pytest.mark.parametrize("lasts_s", [0.04, 0.3, 2.5])
    def test_no_frame_for_a_while_makes_an_even_grid_from_there_on(self, lasts_s: float) -> None:
        data = recorded(without(flat(), lambda time, _frame: 6.01 < time < 6.01 + lasts_s))
        parts = in_parts(data)
        assert len(parts) >= 3
        found, whole = joined(parts), formats.read_motion(io.BytesIO(data), "clip")
        np.testing.assert_allclose(np.diff(found.time), 1 / 30, atol=1e-6)
        np.testing.assert_allclose(found.time, whole.time, atol=1e-6)
        np.testing.assert_allclose(found.position, whole.position, atol=1e-5)
        assert np.abs(rotations.angle(found.orientation, whole.orientation)).max() < 1e-4
        (line,) = [line for line in found.source.warnings if "uneven" in line]
        assert "from there on interpolated onto an even 30 Hz" in line

    def test_poses_that_come_after_their_time_was_given_out(self) -> None:
        sent = list(flat())
        early = sent.pop(len(SEGMENTS) * 60)
        data = recorded([*sent[:1500], early, *sent[1500:]])
        assert isinstance(formats.read_motion(io.BytesIO(data), "clip"), HumanMotion)
        with pytest.raises(
            FormatError, match=r"topic /tf: pelvis|skeleton_pelvis in world: poses of before .* s arrive"
        ) as error:
            in_parts(data)
        assert "-o FILE" in str(error.value)


class TestWhatIsReadAsAWhole:
    def only(self, sent: Sequence[Sent]) -> HumanMotion | TrackerRecording:
        data = recorded(sent)
        (found,) = formats.stream_recording(cast(BinaryIO, Pipe(data)), FIRST_S, "clip")
        whole = formats.read_recording(io.BytesIO(data), "clip")
        assert type(found) is type(whole)
        np.testing.assert_array_equal(found.position, whole.position)
        assert found.source == whole.source
        return found

    def test_shorter_than_the_first_part(self) -> None:
        self.only(flat()[: len(SEGMENTS) * 65])

    def test_trackers(self) -> None:
        named = {"pelvis": "tracker_LHR_1", "head": "tracker_LHR_2"}
        sent = renamed(without(flat(), lambda _time, frame: frame not in named), lambda frame: named[frame])
        assert isinstance(self.only(sent), TrackerRecording)

    def test_topics_that_may_stand_one_after_the_other(self) -> None:
        """Frames of one topic are complete at any time; of several, one may come behind the end of another."""
        sent = []
        for column, segment in enumerate(SEGMENTS):
            for frame in range(0, 360, 4):
                stamp = START_NS + round(frame / 30 * 1e9)
                pose = motion().position[frame, column], motion().orientation[frame, column]
                sent.append(Sent(f"/{XSENS[segment]}", POSE, stamp, ros().pose_stamped(stamp, "world", *pose)))
        found = self.only(sent)
        assert isinstance(found, HumanMotion)
        assert found.segments == SEGMENTS

    def test_a_robot(self) -> None:
        stamps = [START_NS + frame * 10**8 for frame in range(60)]
        sent = [
            Sent("/joint_states", "sensor_msgs/msg/JointState", s, ros().joint_state(s, ["hip", "knee"]))
            for s in stamps
        ]
        with pytest.raises(UsageError, match="not a person's motion"):
            list(formats.stream_recording(cast(BinaryIO, Pipe(recorded(sent))), FIRST_S, "clip"))

    def test_frames_that_nobody_knows(self) -> None:
        sent = renamed(flat(), lambda frame: f"thing_{len(frame)}")
        with pytest.raises(FormatError, match="--frames"):
            list(formats.stream_recording(cast(BinaryIO, Pipe(recorded(sent))), FIRST_S, "clip"))


def test_a_person_who_comes_late() -> None:
    """Nothing but another topic for three times as long as the first part."""
    stamps = [START_NS - 10**8 * k for k in range(60, 0, -1)]
    sent = [Sent("/waist", POSE, s, ros().pose_stamped(s, "map", np.ones(3), np.array([1.0, 0, 0, 0]))) for s in stamps]
    assert_same(recorded([*sent, *flat()]), 2)


def test_a_segment_that_comes_late_is_not_used_and_named() -> None:
    sent = without(flat(), lambda time, frame: frame == "head" and time < 6.0)
    parts = in_parts(recorded(sent))
    assert all("Head" not in part.segments for part in parts)
    assert "Head: not used, as first seen behind the first 2 s" in parts[-1].source.warnings


def test_static_frames_are_not_forgotten() -> None:
    at = np.array([0.5, -0.2, 0.1])
    placed = ros().tf(ros().transform(START_NS, "map", "world", at, np.array([1.0, 0.0, 0.0, 0.0])))
    whole = assert_same(recorded([Sent(STATIC, TF, START_NS, placed), *flat()]), 8)
    np.testing.assert_allclose(whole.position, motion().position + at, atol=1e-12)


def test_a_part_is_given_out_before_the_next_arrives_and_forgotten() -> None:
    data = recorded(flat())
    pipe = Pipe(data)
    parts = formats.stream_recording(cast(BinaryIO, pipe), FIRST_S, "clip")
    taken = []
    for _ in range(4):
        next(parts)
        taken.append(pipe.taken / len(data))
    # twelve seconds; what a buffered reader takes at once is little
    assert taken[0] < 0.35
    assert max(np.diff(taken)) < 0.2


def test_what_was_given_out_is_forgotten() -> None:
    from retarget.formats import _mcap_reader
    from retarget.formats._ros_recording import RosRecording

    recording = RosRecording("clip", "mcap", TrackerOptions())
    stream = _ros_stream.SuitStream(recording, FIRST_S)
    most = 0
    for item in _mcap_reader.read(io.BytesIO(recorded(flat())), "clip"):
        assert isinstance(item, _mcap_reader.Batch)
        for _ in stream.add(item):
            pass
        most = max(most, *(len(edge.stamps) for edge in recording.frames.edges.values()))
    assert most < 30 * (FIRST_S + 2.5)


def breaking_off(data: bytes, at: float) -> Iterator[HumanMotion | TrackerRecording]:
    return formats.stream_recording(cast(BinaryIO, Pipe(data[: int(at * len(data))])), FIRST_S, "clip")


def test_a_recording_that_breaks_off() -> None:
    parts = breaking_off(recorded(flat()), 0.6)
    assert isinstance(next(parts), HumanMotion)
    with pytest.raises(FormatError, match="the file ends inside"):
        list(parts)
