"""MVNX, the XML export of Xsens MVN, versions 3 and 4, plain or gzip.

What comes out obeys the house's invariant: every segment frame is the identity in T-pose, whatever version the file is of
(`R = R_file · R_refᵀ`, `R_ref` the orientations of the file's own reference frame). Quaternions of the file are wxyz, segment → world, with
signs that flip; world X forward, Y left, Z up, metres; `angularVelocity` is rad/s in the world frame. Time is `index / frameRate`,
because the `time` attribute is rounded to milliseconds. Numbers are read to the last bit of their text. Segments are found by their labels, in
any order; foot contacts by those of `footContactDefinition`. Values missing for up to 0.25 s are interpolated and counted; longer gaps are an
error. Names of people, which headers hold, are not read.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray
from retarget.core import rotations
from retarget.core.errors import FormatError, MotionError
from retarget.core.segments import FOOT_CONTACTS, LOWER_BODY, PARENT
from retarget.core.timebase import CLOCK_SLACK_S
from retarget.core.types import Array, BoolArray, HumanMotion, Source
from retarget.formats import _mvnx_body as body
from retarget.formats import _mvnx_gaps as gaps
from retarget.formats._mvnx_header import is_prop
from retarget.formats._mvnx_parser import MvnxRecording, parse_mvnx, parse_mvnx_parts
from retarget.formats.base import Format

PART_FRAMES = 256
"""Frames of each part of a motion that is read in parts, but the first."""

_CLOSURE_FRAMES = 256
_CLOSURE_LIMIT_M = 0.01
_FIELDS = (("orientation", 4), ("position", 3), ("angularVelocity", 3))


def read_motion(stream: BinaryIO, name: str) -> HumanMotion:
    """The motion of an MVNX document. `stream` need not seek and may be gzip; `name` is what messages call it.

    Raises `FormatError` for anything that is not an MVNX recording of version 3 or 4, and for values missing for longer than
    `_mvnx_gaps.LONGEST_GAP_S`; shorter gaps are interpolated, counted and warned of. Beside the motion's own arrays this needs a few MB.
    """
    recording = parse_mvnx(stream, name)
    return _Reading(name).motion(recording, slice(0, len(recording.index)), recording.index)


def stream_motion(stream: BinaryIO, name: str, first_s: float) -> Iterator[HumanMotion]:
    """The motion of an MVNX document in consecutive parts, each as soon as the document has come so far; errors as those of `read_motion`.

    The first part lasts `first_s`, or is all there is. Joined, the parts are what `read_motion` gives, but for two things that only the end can
    tell: where foot contacts are missing the last ones hold, and so do positions of segments that were not measured. `source.sha256` and
    warnings about the whole are those of the last part.
    """
    reading = _Reading(name)
    for part in parse_mvnx_parts(stream, name, first_s, PART_FRAMES, gaps.LONGEST_GAP_S + CLOCK_SLACK_S):
        yield reading.motion(part.recording, part.own, part.index)


class _Reading:
    """Makes motions of the parts of one document, in order, or of the whole of it."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._header: tuple[set[str], BoolArray, Array] | None = None  # fields, measured, reference of the first part
        self._last: tuple[Array, Array, BoolArray | None] | None = (
            None  # orientation, position, contacts of the frame before
        )
        self._filled, self._unmeasured = 0, list[str]()
        self._closure, self._contacts = (0.0, ""), list[str]()

    def motion(self, recording: MvnxRecording, own: slice, index: NDArray[np.int64]) -> HumanMotion:
        """The motion of the frames `own` of `recording`; index: of all frames so far, from the first on. Hands its arrays over."""
        name = self._name
        content = _understand(recording, name, index)
        self._check_like_before(content)
        filled = np.zeros(len(content.time), bool)
        for field, _ in _FIELDS:
            filled |= self._fill(content, field)
        self._filled += int(filled[own].sum())

        values = {field: value[own] for field, value in content.values.items()}
        before = None if self._last is None else self._last[0]
        orientation = _normalise(values["orientation"], content.reference, before)
        offsets = body.joint_offsets(recording.header, content.segments)
        warnings = [*content.warnings, *dict.fromkeys(self._unmeasured)]
        position = values.get("position")
        if position is None and offsets:
            position = body.forward_positions(content.segments, orientation, offsets)
            warnings.append("the file has no positions: computed from the joints' points, the pelvis at the origin")
        elif position is None:
            position = np.full((*orientation.shape[:2], 3), np.nan)
            warnings.append("the file has no positions and no points to compute them from")
        else:
            distance, segment = _closure(content, orientation, position, offsets)
            if not distance <= self._closure[0]:
                self._closure = distance, segment
            if not self._closure[0] <= _CLOSURE_LIMIT_M:
                off = f"{self._closure[1]} is {self._closure[0] * 1e3:.0f} mm away from its joint"
                warnings.append(f"{off}: orientations, positions and points do not fit together")
        if self._filled:
            warnings.append(f"missing values of {self._filled} frames were interpolated")
        contacts = self._foot_contacts(recording, content, own)
        angular_velocity = values.get("angularVelocity")
        if self._last is not None:
            position = _tracked_as_before(position, self._last[1])
        self._last = orientation[-1].copy(), position[-1].copy(), None if contacts is None else contacts[-1]
        for array in (orientation, position, angular_velocity):
            _freeze(array)
        return HumanMotion(
            time=content.time[own],
            segments=content.segments,
            orientation=orientation,
            position=position,
            angular_velocity=angular_velocity,
            foot_contacts=contacts,
            measured=content.measured,
            joint_offsets=offsets,
            source=Source(
                format=FORMAT.name,
                version=recording.header.version,
                rate_hz=content.rate_hz,
                configuration=recording.header.configuration,
                sha256=recording.sha256,
                warnings=(*warnings, *self._contacts),
                interpolated_frames=self._filled,
            ),
        )

    def _fill(self, content: _Content, field: str) -> BoolArray:
        """Interpolate missing values of `field` in place; which frames (T,) that concerned.

        What was not measured must not stop a conversion: there, a gap too long becomes the T-pose, no position, no motion.
        """
        filled = np.zeros(len(content.time), bool)
        if field not in content.missing:
            return filled
        value, missing = content.values[field], content.missing[field]
        for column in np.flatnonzero(missing.any(axis=0)):
            segment = content.segments[column]
            try:
                filled |= gaps.interpolate(content.time, value[:, column])
            except MotionError as error:
                if content.measured[column]:
                    raise FormatError(self._name, f"<{field}> of {segment}: {error}") from None
                neutral = {"orientation": content.reference[column], "position": np.nan, "angularVelocity": 0.0}
                value[:, column] = neutral[field]
                self._unmeasured.append(f"<{field}> of {segment}, which was not measured, is missing")
        return filled

    def _foot_contacts(self, recording: MvnxRecording, content: _Content, own: slice) -> BoolArray | None:
        """Of the frames `own`, as the function says; once there are contacts the last known ones hold where they are missing."""
        if self._last is None:
            contacts = _foot_contacts(recording, content, self._contacts)
            return None if contacts is None else contacts[own]
        if self._last[2] is None:
            return None
        values, columns = recording.values["footContacts"][own], _contact_columns(recording)
        known = np.isfinite(values).all(axis=1)
        if not known.all() and not self._contacts:
            self._contacts.append("foot contacts are missing in some frames: the last ones before hold")
        held = np.concatenate([self._last[2][None], values[:, columns] > 0.5])
        return np.asarray(held[np.maximum.accumulate(np.where(known, np.arange(1, len(held)), 0))])

    def _check_like_before(self, content: _Content) -> None:
        """Raise `FormatError` where later parts say of the whole what the first ones did not."""
        if self._header is None:
            self._header = set(content.values), content.measured, content.reference
        fields, measured, reference = self._header
        if new := [field for field in content.values if field not in fields]:
            place = f"frame {content.index[0]}"
            raise FormatError(self._name, f"<{new[0]}> begins late", place=place, expected="it in all frames, or none")
        same = np.array_equal(measured, content.measured) and np.array_equal(reference, content.reference)
        if not same:
            problem = "what describes the person stands behind the frames"
            raise FormatError(
                self._name, problem, expected="a header; a file can be read so: write to one with -o FILE"
            )


def describe(stream: BinaryIO, name: str) -> Mapping[str, Any]:
    """Facts of an MVNX document for `retarget info`, JSON-able. Gaps of any length are reported, none is refused.

    Raises `FormatError` as `read_motion` does, gaps apart.
    """
    recording = parse_mvnx(stream, name)
    header, content = recording.header, _understand(recording, name, recording.index)
    missing = gaps.missing_values(content.missing, content.time, content.segments)
    unmeasured = {segment for segment, ok in zip(content.segments, content.measured, strict=True) if not ok}
    if any(gaps.is_too_long(gap, len(content.time)) and set(gap["segments"]) - unmeasured for gap in missing):
        content.warnings.append(f"values are missing for longer than {gaps.LONGEST_GAP_S:g} s: it can't be converted")
    return {
        "format": FORMAT.name,
        "kind": "motion",
        "version": header.version,
        "mvn_version": header.mvn_version,
        "configuration": header.configuration,
        "rate_hz": content.rate_hz,
        "frames": len(content.time),
        "duration_s": float(content.time[-1] - content.time[0]),
        "segments": list(content.segments),
        "unmeasured_segments": [segment for segment in content.segments if segment in unmeasured],
        "fields": list(recording.fields),
        "segment_frames": content.reference_source,
        "foot_contacts": _foot_contacts(recording, content, content.warnings) is not None,
        "gaps": [*gaps.dropped_frames(recording.index, content.time), *missing],
        "warnings": content.warnings,
    }


@dataclass(frozen=True)
class _Content:
    """A recording, or a part of one, as understood, values still the file's own. T frames, S segments.

    index: (T,) the frames' own numbers. values: field → (T, S, 3 or 4), NaN where missing. missing: field → (T, S), of those with something missing.
    reference: (S, 4) the file's T-pose orientations, reference_source: where they come from.
    """

    segments: tuple[str, ...]
    index: NDArray[np.int64]
    time: Array
    rate_hz: float
    measured: BoolArray
    values: dict[str, Array]
    missing: dict[str, BoolArray]
    reference: Array
    reference_source: str
    warnings: list[str]


def _understand(recording: MvnxRecording, name: str, index: NDArray[np.int64]) -> _Content:
    """index: of all frames so far, of which those of `recording` may be a part: what is usual among frames is theirs."""
    header, warnings = recording.header, list[str]()
    columns = [column for column, label in enumerate(header.labels) if not is_prop(label)]
    segments = tuple(header.labels[column] for column in columns)
    if not segments:
        raise FormatError(name, "only props among the segments", expected="a person")
    if len(columns) < len(header.labels):
        warnings.append("props are left out")
    reference, reference_source = body.reference_orientation(header, recording.references, name, warnings)

    step = gaps.usual_step(index)
    if step > 1:
        warnings.append(
            f"every frame's index is {step} more than the one before: the rate is {header.rate_hz / step:g} Hz"
        )
    if not recording.indexed:
        warnings.append("frames have no index: times are counted")
    values: dict[str, Array] = {}
    missing: dict[str, BoolArray] = {}
    for field, width in _FIELDS:
        if field in recording.values:
            value = recording.values[field].reshape(len(recording.index), -1, width)
            value = value if len(columns) == len(header.labels) else value[:, columns]
            if (bad := gaps.unusable(value)).any():
                missing[field] = bad
                value[bad] = np.nan
            values[field] = value
    content = _Content(
        segments=segments,
        index=recording.index,
        time=recording.index / header.rate_hz,
        rate_hz=header.rate_hz / step,
        measured=body.measured_segments(header, segments, warnings),
        values=values,
        missing=missing,
        reference=reference[columns],
        reference_source=reference_source,
        warnings=warnings,
    )
    if dropped := gaps.dropped_frames(index, index / header.rate_hz):
        count, longest = sum(gap["frames"] for gap in dropped), max(gap["duration_s"] for gap in dropped)
        warnings.append(f"dropped frames: {count}, gaps: {len(dropped)}, the longest {longest:.3g} s")
    return content


def _normalise(orientation: Array, reference: Array, last: Array | None) -> Array:
    """Orientations (T, S, 4) from the file's segment frames to T-pose frames, unit and continuous in sign, in place.

    last: (S, 4) those of the frame before, where there is one.
    """
    turned = np.flatnonzero(np.abs(rotations.log(reference)).max(axis=1) > 0)
    from_reference = rotations.conjugate(reference[turned])
    for block in gaps.blocks(len(orientation)):
        part = orientation[block]
        if len(turned):
            part[:, turned] = rotations.multiply(part[:, turned], from_reference)
        part = rotations.make_continuous(rotations.normalize(part))
        if last is not None:
            part *= np.where(np.einsum("si,si->s", part[0], last) < 0, -1.0, 1.0)[:, None]
        orientation[block] = part
        last = part[-1]
    return orientation


def _closure(content: _Content, orientation: Array, position: Array, offsets: Mapping[str, Array]) -> tuple[float, str]:
    """Distance in m between a segment and its joint, and which segment: the worst, see `body.worst_joint_distance`."""
    some = np.unique(np.linspace(0, len(orientation) - 1, _CLOSURE_FRAMES).astype(int))
    measured = {segment for segment, ok in zip(content.segments, content.measured, strict=True) if ok}
    known = {segment: offset for segment, offset in offsets.items() if {segment, PARENT[segment]} <= measured}
    return body.worst_joint_distance(content.segments, orientation[some], position[some], known)


def _foot_contacts(recording: MvnxRecording, content: _Content, warnings: list[str]) -> BoolArray | None:
    """Contacts (T, 4) in the house's order; None when the file has none, or no feet were measured (MVN then writes 1)."""
    values = recording.values.get("footContacts")
    if values is None:
        if "footContacts" in recording.fields:
            warnings.append("no footContactDefinition: foot contacts are not used")
        return None
    if any(segment in LOWER_BODY for segment, ok in zip(content.segments, content.measured, strict=True) if not ok):
        return None
    columns = _contact_columns(recording)
    if not all(0 <= column < values.shape[1] for column in columns):
        warnings.append(f"footContactDefinition lacks one of {', '.join(FOOT_CONTACTS)}: foot contacts are not used")
        return None
    if not np.isfinite(values).all():
        warnings.append("foot contacts are missing in some frames: they are not used")
        return None
    return np.asarray(values[:, columns] > 0.5)


def _contact_columns(recording: MvnxRecording) -> list[int]:
    """Where the house's contacts stand among the file's, -1 for none."""
    return [recording.header.contacts.get(label, -1) for label in FOOT_CONTACTS]


def _tracked_as_before(position: Array, last: Array) -> Array:
    """`position` (T, S, 3) with segments that were not tracked in the frame before, at `last` (S, 3), untracked, and others held there
    where they would be lost: a segment is tracked in all of a motion or not at all."""
    untracked, lost = np.isnan(last).any(axis=1), np.isnan(position).any(axis=(0, 2))
    position[:, untracked] = np.nan
    position[:, lost & ~untracked] = last[lost & ~untracked]
    return position


def _freeze(array: Array | None) -> None:
    """Make `array`, and what it is a view of, read-only: such arrays `HumanMotion` shares instead of copying them."""
    while array is not None:
        array.flags.writeable = False
        array = array.base if isinstance(array.base, np.ndarray) else None


FORMAT = Format(
    name="mvnx",
    description="Xsens MVN, XML export (MVNX 3 and 4)",
    suffixes=(".mvnx.gz", ".mvnx"),
    magic=(b"<?xml", b"\xef\xbb\xbf<?xml", b"<mvnx"),
    read_motion=read_motion,
    stream_motion=stream_motion,
    describe=describe,
    pipeable=True,
)
