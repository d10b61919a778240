"""A person's motion, or poses of trackers, out of the messages of a ROS recording.

Frames of trees are composed to their root, each transform interpolated on its own before: a transform that a driver leaves out (the Xsens
drivers do, where an orientation is exactly the identity) is a gap of that transform only. Gaps are treated, marked and counted as in
tracker logs: interpolated up to half a second, held and blended beyond. Times are whole ns since the first pose until they become seconds.

`JointState` of the Xsens drivers is not used: signs, offsets and order of its angles are the driver's own and say nothing of the base.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from retarget.core.errors import FormatError, UnknownNameError
from retarget.core.types import HumanMotion, TrackerRecording
from retarget.formats import _foxglove, _frame_map, _ros_frames
from retarget.formats._bag_storage import Unread
from retarget.formats._mcap_reader import Batch
from retarget.formats._ros_definitions import Definition
from retarget.formats._ros_frames import LINKS, POSES, TREE, Clock, Edge, Frames
from retarget.formats._ros_motion import motion_of
from retarget.formats._ros_placing import composed, samples_of, without_held
from retarget.formats._ros_source import short_type
from retarget.formats._ros_wire import READERS, BadMessage, Cursor, Pose, read_all
from retarget.formats._tracker_faults import Samples
from retarget.formats._tracker_recording import Log, assemble, place
from retarget.formats.base import TrackerOptions

JOINT_STATE = "sensor_msgs/JointState"
_TREES = ("tf2_msgs/TFMessage", "tf/tfMessage")
_ENCODINGS = ("cdr", "ros1", "json", "protobuf")
Decoder = Callable[[memoryview], Iterable[Pose]] | str
"""What makes poses of one message, or the key of `READERS` by which many are read at once."""


@dataclass
class Topic:
    """What there is on a topic: messages, and the log times in ns of the first and last, where they were read."""

    message_type: str
    count: int = 0
    first: int | None = None
    last: int | None = None

    @property
    def rate_hz(self) -> float | None:
        """Mean rate by log times; None where they weren't read or there is a single message."""
        if self.first is None or self.last is None or self.last <= self.first:
            return None
        return (self.count - 1) / ((self.last - self.first) * 1e-9)


@dataclass(frozen=True)
class Choice:
    """Which frames are used as what: name (segment or tracker) → the edges from the root to its frame."""

    chains: dict[str, list[Edge]]
    suit: bool
    clock: Clock
    warnings: list[str]

    def moving(self) -> list[Edge]:
        """The edges that are not static, each once."""
        return list({id(edge): edge for edges in self.chains.values() for edge in edges if not edge.static}.values())


def is_wanted(message_type: str) -> bool:
    """Whether messages of this type, as `short_type`, are looked at."""
    return (
        message_type in READERS
        or message_type == JOINT_STATE
        or _is_links(message_type)
        or bool(_foxglove_kind(message_type))
    )


def _is_links(message_type: str) -> bool:
    return message_type.endswith("/LinkStateArray")


def _foxglove_kind(message_type: str) -> str:
    package, _, name = message_type.replace(".", "/").rpartition("/")
    return name if package in ("foxglove", "foxglove_msgs") and name in _foxglove.TYPES else ""


class RosRecording:
    """Takes in batches of messages, then says what they hold of a person. options: as of the format's reader."""

    def __init__(self, name: str, format_name: str, options: TrackerOptions) -> None:
        self.name, self.format_name, self.options = name, format_name, options
        self.map = _frame_map.load(options.frames)
        self.topics: dict[str, Topic] = {}
        self.frames = Frames(name)
        self.warnings: list[str] = []
        self.joint_names: tuple[str, ...] = ()
        self._decoders: dict[str, Decoder | None] = {}
        self._undefined: FormatError | None = None

    def add(self, item: Batch | Unread) -> None:
        """Take in messages. Raises `FormatError` for those that are not what their type says."""
        kind = short_type(item.message_type)
        topic = self.topics.setdefault(item.topic, Topic(kind))
        if isinstance(item, Unread):
            topic.count += item.count
            return
        first = topic.count
        topic.count += len(item.payloads)
        low, high = min(item.log_times), max(item.log_times)
        topic.first = low if topic.first is None else min(topic.first, low)
        topic.last = high if topic.last is None else max(topic.last, high)
        if item.topic not in self._decoders:
            self._decoders[item.topic] = self._decoder(item, kind)
        decode = self._decoders[item.topic]
        if decode is None:
            return
        source = (
            LINKS if _is_links(kind) else TREE if kind in _TREES or _foxglove_kind(kind) == "FrameTransforms" else POSES
        )
        names = self.map.poses.get("/" + item.topic.lstrip("/"), ())
        if not callable(decode):
            try:
                batch = read_all(item.payloads, READERS[decode], ros1=item.encoding == "ros1")
                self.frames.add_all(item.topic, source, batch, item.log_times, names)
            except BadMessage as error:
                place = f"topic {item.topic}, message {first + error.index}"
                raise FormatError(self.name, f"not a {kind}: {error}", place=place) from error
            return
        for index, (payload, log_time) in enumerate(zip(item.payloads, item.log_times, strict=True), first):
            try:
                self.frames.add(item.topic, source, decode(payload), log_time, names)
            except (struct.error, ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
                problem = f"not a {kind}: {str(error) or type(error).__name__}"
                raise FormatError(self.name, problem, place=f"topic {item.topic}, message {index}") from error

    def _decoder(self, batch: Batch, kind: str) -> Decoder | None:
        """What turns the topic's messages into poses; None for topics that hold none."""
        if not is_wanted(kind):
            return None
        ros1 = batch.encoding == "ros1"
        if batch.encoding not in _ENCODINGS or (batch.encoding in _ENCODINGS[2:] and not _foxglove_kind(kind)):
            encoding = batch.encoding or "no encoding"
            self.warnings.append(
                f"{batch.topic} not read: {kind} as {encoding}, expected one of {', '.join(_ENCODINGS)}"
            )
            return None
        if kind == JOINT_STATE:
            self.joint_names = self.joint_names or _joint_names(batch.payloads[0], ros1=ros1)
            return None
        if kind == "geometry_msgs/PoseArray" and "/" + batch.topic.lstrip("/") not in self.map.poses:
            self.warnings.append(
                f'{batch.topic} not read: a PoseArray names nothing; name its poses in --frames, [poses] "{batch.topic}"'
            )
            return None
        if foxglove := _foxglove_kind(kind):
            if batch.encoding == "json":
                return lambda payload: _foxglove.from_json(payload, foxglove)
            if batch.encoding == "protobuf":
                return lambda payload: _foxglove.from_protobuf(payload, foxglove)
            kind = f"foxglove_msgs/{foxglove}"
        if _is_links(kind):
            return self._links(batch, kind, ros1=ros1)
        return kind

    def _links(self, batch: Batch, kind: str, *, ros1: bool) -> Decoder | None:
        try:
            definition = Definition(
                self.name,
                batch.topic,
                kind,
                batch.schema.decode("utf-8", "replace"),
                batch.schema_encoding,
                ros1=ros1,
                msg_defs=self.options.msg_defs,
            )
        except FormatError as error:
            # tf may hold the same motion: then this is worth a line, no more.
            self._undefined = error
            return None
        return definition.links

    def is_robot(self) -> bool:
        """Whether there are joint states, no frame is known as a person's, and the user names none: a robot's recording."""
        named = self.map.segments or self.map.trackers or self.options.roles
        return bool(self.joint_names) and not named and not _is_xsens(self.joint_names) and not self._builtin()[0]

    def result(self, sha256: str = "") -> tuple[HumanMotion | TrackerRecording, dict[str, Any]]:
        """The motion or the trackers, with JSON-able facts.

        Raises `FormatError` where no frame is known, or the known ones don't fit together, `UsageError` for a map or roles that don't fit.
        """
        choice = self.choice()
        log, start = self._log(choice)
        log = replace(log, sha256=sha256)
        placed = composed(self.name, choice.chains, place(log, suit=choice.suit))
        recording: HumanMotion | TrackerRecording
        if choice.suit:
            recording, facts = motion_of(log, placed, self.map)
        else:
            recording, facts = assemble(log, placed)
        return recording, {**facts, "start_stamp_ns": start, "clock": choice.clock, **self.facts(choice)}

    def facts(self, choice: Choice | None = None) -> dict[str, Any]:
        """Topics, frames and lines for a map: those that `choice` comes to, else those whose names come near; JSON-able."""
        chosen = choice.chains.items() if choice else ()
        used = [f'{item} = "{edges[-1].child}"' for item, edges in chosen if edges]
        edges = {**self.frames.chosen(LINKS), **self.frames.chosen()}
        return {
            "topics": [_topic_line(name, topic) for name, topic in sorted(self.topics.items())],
            "frames_found": [_edge_line(edge) for _, edge in sorted(edges.items())],
            "suggested_map": used or _frame_map.suggestion(sorted(edges)),
        }

    def describe(self, sha256: str = "") -> dict[str, Any]:
        """Facts for `retarget info`; where nothing is known of a person, those of topics and frames, with the reason as a warning."""
        try:
            return self.result(sha256)[1]
        except FormatError as error:
            reason = f"{error.problem}; expected {error.expected}" if error.expected else error.problem
            return {
                "format": self.format_name,
                "kind": "messages",
                **self.facts(),
                "warnings": [*self.warnings, reason],
            }

    def _builtin(self) -> tuple[dict[str, Edge], dict[str, Edge], list[str]]:
        """Segment → edge of the suit's frame, the edges they hang in, and the prefixes of all people; empty without a suit."""
        tree, links = self.frames.chosen(), self.frames.chosen(LINKS)
        in_tree, people = _frame_map.suit_segments(tree, self.map.prefix)
        in_links, other = _frame_map.suit_segments(links, self.map.prefix)
        if len(in_links) >= len(in_tree):
            return {segment: links[frame] for segment, frame in in_links.items()}, links, other
        return {segment: tree[frame] for segment, frame in in_tree.items()}, tree, people

    def choice(self) -> Choice:
        """Which frames are whose, by what has come so far. Raises as `result`."""
        warnings = list(self.warnings)
        tree, links = self.frames.chosen(), self.frames.chosen(LINKS)
        wanted = self.map.segments or self.map.trackers
        suit = bool(self.map.segments)
        edges = tree
        if wanted:
            for frame in wanted.values():
                if frame not in tree and frame not in links:
                    raise UnknownNameError("frame", frame, {*tree, *links}, where=self.map.name)
            if not set(wanted.values()) <= set(tree):
                edges = {**tree, **links}
        else:
            found, edges, people = self._builtin()
            wanted, suit = {segment: edge.child for segment, edge in found.items()}, bool(found)
            if suit and len(people) > 1 and self.map.prefix is None:
                shown = ", ".join(f"'{one}'" for one in people)
                warnings.append(
                    f"several people, with prefixes {shown}: the most complete is taken; --frames with prefix chooses"
                )
            if not suit and self.map.prefix is not None:
                raise UnknownNameError("prefix", self.map.prefix, people, where=self.map.name)
            if not suit:
                edges = tree
                wanted = _frame_map.tracker_frames({c: e.parent for c, e in tree.items()}, self.options.roles)
        if not wanted:
            self._nothing_known(sorted({*tree, *links, *(edge.parent for edge in tree.values())}))
        if self._undefined is not None:
            warnings.append(f"{self._undefined.place} not used: {self._undefined.problem}")
        chains = {item: _ros_frames.chain(edges, frame, self.map.root, self.name) for item, frame in wanted.items()}
        roots = sorted({(found[0].parent if found else "") for found in chains.values()})
        if len(roots) > 1:
            problem = f"frames hang in different trees, with roots {', '.join(repr(root) for root in roots[:5])}"
            raise FormatError(self.name, problem, expected="frames of one tree, named in --frames map.toml")
        return Choice(chains, suit, self._clock(chains, warnings), warnings)

    def _nothing_known(self, frames: list[str]) -> None:
        if self._undefined is not None:
            raise self._undefined
        if _is_xsens(self.joint_names):
            problem = "joint angles of an Xsens driver, which say nothing of the base and are the driver's own"
            raise FormatError(self.name, problem, expected="its /tf or /link_states recorded, too")
        expected = "--frames map.toml with [segments] or [trackers]"
        if not frames:
            held = ", ".join(f"{name} ({topic.message_type})" for name, topic in sorted(self.topics.items())[:6])
            raise FormatError(
                self.name, f"no poses: found {held or 'no messages'}", expected="tf, poses, odometry or link states"
            )
        raise FormatError(self.name, _frame_map.unmapped(frames), expected=expected)

    def _clock(self, chains: dict[str, list[Edge]], warnings: list[str]) -> Clock:
        clock: Clock = self.options.clock or "header"
        moving = [edge for edges in chains.values() for edge in edges if not edge.static]
        if clock == "header" and moving and not any(any(edge.stamps) for edge in moving):
            warnings.append("poses without stamps: the recorder's log time is used")
            return "log"
        return clock

    def _log(self, choice: Choice) -> tuple[Log, int]:
        """The moving edges as trackers of a log, each in its parent, and the first stamp in ns, which is their time 0."""
        moving = choice.moving()
        if not moving:
            raise FormatError(self.name, "nothing moves: all transforms are static", expected="a recording of motion")
        times = [edge.times(choice.clock) for edge in moving]
        start = min(int(time.min()) for time in times)
        samples = [samples_of(edge, time - start, choice.warnings) for edge, time in zip(moving, times, strict=True)]
        if choice.suit:
            samples = without_held(samples, choice.warnings)
        return self.log(samples, choice.warnings), start

    def log(self, samples: Sequence[Samples], warnings: list[str]) -> Log:
        """`samples` of edges as those of a tracker log."""
        options = self.options
        return Log(
            name=self.name,
            format=self.format_name,
            trackers=samples,
            up=options.up or "z",
            handedness=options.handedness or "right",
            roles={tracker.lstrip("/"): role for tracker, role in options.roles.items()},
            warnings=warnings,
        )


def _joint_names(payload: memoryview, *, ros1: bool) -> tuple[str, ...]:
    try:
        cursor = Cursor(payload, ros1=ros1)
        cursor.header()
        return tuple(cursor.string() for _ in range(cursor.count()))
    except (struct.error, ValueError):
        return ()


def _is_xsens(joint_names: Sequence[str]) -> bool:
    """Whether the joints are a person's 22, three angles each."""
    return len(joint_names) >= 60 and all(name[-2:] in ("_x", "_y", "_z") for name in joint_names)


def _topic_line(name: str, topic: Topic) -> str:
    rate = f" {topic.rate_hz:.4g} Hz" if topic.rate_hz is not None else ""
    return f"{name} {topic.message_type} {topic.count} messages{rate}"


def _edge_line(edge: Edge) -> str:
    if edge.static:
        return f"{edge.label} static"
    time = np.sort(edge.times("header"))
    span_ns = int(time[-1]) - int(time[0]) if len(time) else 0  # 64 bits may not hold it
    rate = (len(time) - 1) / (span_ns * 1e-9) if span_ns else 0.0
    return f"{edge.label} {len(time)} poses {rate:.4g} Hz"
