"""MVNX, the XML export of Xsens MVN, versions 3 and 4, plain or gzip.

What comes out obeys the house's invariant: every segment frame is the identity in T-pose, whatever version the file is of
(`R = R_file · R_refᵀ`, `R_ref` the orientations of the file's own reference frame). Quaternions of the file are wxyz, segment → world, with
signs that flip; world X forward, Y left, Z up, metres; `angularVelocity` is rad/s in the world frame. Time is `index / frameRate`,
because the `time` attribute is rounded to milliseconds. Names of people, which headers hold, are not read.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, BinaryIO

import numpy as np
from retarget.core import rotations
from retarget.core.errors import FormatError, MotionError
from retarget.core.segments import FOOT_CONTACTS, LOWER_BODY
from retarget.core.timebase import fill_gaps
from retarget.core.types import Array, BoolArray, HumanMotion, Source
from retarget.formats import _mvnx_body as body
from retarget.formats._mvnx_header import is_prop
from retarget.formats._mvnx_parser import MvnxRecording, parse_mvnx
from retarget.formats.base import Format

LONGEST_GAP_S = 0.25
"""Missing values are interpolated over at most this time, from the last good frame to the next."""

_BLOCK = 4096  # frames worked on at a time, so that temporaries stay small beside the recording
_CLOSURE_FRAMES = 256
_CLOSURE_LIMIT_M = 0.01
_FIELDS = (("orientation", 4), ("position", 3), ("angularVelocity", 3))


def read_motion(stream: BinaryIO, name: str) -> HumanMotion:
    """The motion of an MVNX document. `stream` need not seek and may be gzip; `name` is what messages call it.

    Raises `FormatError` for anything that is not an MVNX recording of version 3 or 4, and for values missing for longer than
    `LONGEST_GAP_S`; shorter gaps are interpolated, counted and warned of. Beside the motion's own arrays this needs a few MB.
    """
    recording = parse_mvnx(stream, name)
    content = _understand(recording, name)
    warnings = content.warnings
    filled = np.zeros(len(content.time), bool)
    for field, _ in _FIELDS:
        filled |= _fill(content, field, name)

    orientation = _normalise(content.values["orientation"], content.reference)
    offsets = body.joint_offsets(recording.header, content.segments)
    position = content.values.get("position")
    if position is None:
        position = body.forward_positions(content.segments, orientation, offsets)
        made = "computed from the joints' points, the pelvis at the origin" if offsets else "not tracked"
        warnings.append(f"the file has no positions: they are {made}")
    else:
        warnings.extend(_closure_warning(content, orientation, position, offsets))
    if count := int(filled.sum()):
        warnings.append(f"missing values of {count} frames were interpolated")
    angular_velocity = content.values.get("angularVelocity")
    for array in (orientation, position, angular_velocity):
        _freeze(array)
    return HumanMotion(
        time=content.time,
        segments=content.segments,
        orientation=orientation,
        position=position,
        angular_velocity=angular_velocity,
        foot_contacts=_foot_contacts(recording, content),
        measured=content.measured,
        joint_offsets=offsets,
        source=Source(
            format=FORMAT.name,
            version=recording.header.version,
            rate_hz=content.rate_hz,
            configuration=recording.header.configuration,
            sha256=recording.sha256,
            warnings=tuple(warnings),
            interpolated_frames=count,
        ),
    )


def describe(stream: BinaryIO, name: str) -> Mapping[str, Any]:
    """Facts of an MVNX document for `retarget info`, JSON-able. Gaps of any length are reported, none is refused.

    Raises `FormatError` as `read_motion` does, gaps apart.
    """
    recording = parse_mvnx(stream, name)
    header, content = recording.header, _understand(recording, name)
    gaps = [*_dropped_frames(recording, content), *_missing_values(content)]
    long = [gap for gap in gaps if gap["kind"] == "missing values" and gap["duration_s"] > LONGEST_GAP_S]
    if long:
        content.warnings.append(
            f"{len(long)} gaps of missing values are longer than {LONGEST_GAP_S:g} s: it can't be converted"
        )
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
        "unmeasured_segments": [s for s, ok in zip(content.segments, content.measured, strict=True) if not ok],
        "fields": list(recording.fields),
        "segment_frames": content.reference_source,
        "foot_contacts": _foot_contacts(recording, content) is not None,
        "gaps": gaps,
        "warnings": content.warnings,
    }


@dataclass(frozen=True)
class _Content:
    """A recording as understood, values still the file's own. T frames, S segments.

    values: field → (T, S, 3 or 4), NaN where missing. missing: field → (T, S). reference: (S, 4) the file's T-pose orientations.
    """

    segments: tuple[str, ...]
    time: Array
    rate_hz: float
    measured: BoolArray
    values: dict[str, Array]
    missing: dict[str, BoolArray]
    reference: Array
    reference_source: str
    warnings: list[str]


def _understand(recording: MvnxRecording, name: str) -> _Content:
    header, warnings = recording.header, list[str]()
    columns = [column for column, label in enumerate(header.labels) if not is_prop(label)]
    segments = tuple(header.labels[column] for column in columns)
    if not segments:
        raise FormatError(name, "only props among the segments", expected="a person")
    if len(columns) < len(header.labels):
        warnings.append("props are left out")
    reference, reference_source = body.reference_orientation(header, recording.references, name, warnings)

    step = _usual_step(recording)
    if step > 1:
        warnings.append(
            f"every frame's index is {step} more than the one before: the rate is {header.rate_hz / step:g} Hz"
        )
    if not recording.indexed:
        warnings.append("frames have no index: times are counted")
    values, missing = {}, {}
    for field, width in _FIELDS:
        if field in recording.values:
            value = recording.values[field].reshape(len(recording.index), -1, width)
            value = value if len(columns) == len(header.labels) else value[:, columns]
            missing[field] = _missing(value)
            value[missing[field]] = np.nan
            values[field] = value
    content = _Content(
        segments=segments,
        time=recording.index / header.rate_hz,
        rate_hz=header.rate_hz / step,
        measured=body.measured_segments(header, segments, warnings),
        values=values,
        missing=missing,
        reference=reference[columns],
        reference_source=reference_source,
        warnings=warnings,
    )
    if dropped := _dropped_frames(recording, content):
        count, longest = sum(gap["frames"] for gap in dropped), max(gap["duration_s"] for gap in dropped)
        warnings.append(f"{count} frames were dropped in {len(dropped)} places, for at most {longest:.3g} s")
    return content


def _missing(value: Array) -> BoolArray:
    """Which (T, S) vectors or quaternions can't be used: not finite, or for quaternions not of unit length."""
    missing = np.empty(value.shape[:2], bool)
    for block in _blocks(len(value)):
        part = value[block]
        usable = np.isfinite(part).all(axis=2)
        if value.shape[2] == 4:
            with np.errstate(over="ignore", invalid="ignore"):
                norm = np.sqrt(np.einsum("tsi,tsi->ts", part, part))
                usable &= np.abs(norm - 1) <= body.UNIT_TOLERANCE
        missing[block] = ~usable
    return missing


def _fill(content: _Content, field: str, name: str) -> BoolArray:
    """Interpolate missing values of `field` in place; which frames (T,) that concerned.

    What was not measured must not stop a conversion: there, a gap too long becomes the T-pose, no position, no motion.
    """
    filled = np.zeros(len(content.time), bool)
    if field not in content.values:
        return filled
    value, missing = content.values[field], content.missing[field]
    for column in np.flatnonzero(missing.any(axis=0)):
        segment = content.segments[column]
        try:
            value[:, column], rows = fill_gaps(
                content.time, value[:, column], longest_s=LONGEST_GAP_S, quaternions=field == "orientation"
            )
            filled |= rows
        except MotionError as error:
            if content.measured[column]:
                raise FormatError(name, f"<{field}> of {segment}: {error}") from None
            neutral = {"orientation": content.reference[column], "position": np.nan, "angularVelocity": 0.0}
            value[:, column] = neutral[field]
            content.warnings.append(f"<{field}> of {segment}, which was not measured, is missing")
    return filled


def _normalise(orientation: Array, reference: Array) -> Array:
    """Orientations (T, S, 4) from the file's segment frames to T-pose frames, unit and continuous in sign, in place."""
    turned = np.flatnonzero(np.abs(rotations.log(reference)).max(axis=1) > 0)
    from_reference = rotations.conjugate(reference[turned])
    last: Array | None = None
    for block in _blocks(len(orientation)):
        part = orientation[block]
        if len(turned):
            part[:, turned] = rotations.multiply(part[:, turned], from_reference)
        part = rotations.normalize(part)
        with_last = part if last is None else np.concatenate([last, part])
        orientation[block] = rotations.make_continuous(with_last)[-len(part) :]
        last = orientation[block][-1:]
    return orientation


def _closure_warning(
    content: _Content, orientation: Array, position: Array, offsets: Mapping[str, Array]
) -> Iterator[str]:
    some = np.unique(np.linspace(0, len(orientation) - 1, _CLOSURE_FRAMES).astype(int))
    known = {
        segment: offset for segment, offset in offsets.items() if content.measured[content.segments.index(segment)]
    }
    distance, segment = body.worst_joint_distance(content.segments, orientation[some], position[some], known)
    if not distance <= _CLOSURE_LIMIT_M:
        yield f"{segment} is {distance * 1e3:.0f} mm away from its joint: orientations, positions and points do not fit together"


def _foot_contacts(recording: MvnxRecording, content: _Content) -> BoolArray | None:
    """Contacts (T, 4) in the house's order; None when the file has none, or no feet were measured (MVN then writes 1)."""
    values, contacts = recording.values.get("footContacts"), recording.header.contacts
    if values is None:
        if "footContacts" in recording.fields:
            content.warnings.append("no footContactDefinition: foot contacts are not used")
        return None
    if any(segment in LOWER_BODY for segment, ok in zip(content.segments, content.measured, strict=True) if not ok):
        return None
    columns = [contacts.get(label, -1) for label in FOOT_CONTACTS]
    if not all(0 <= column < values.shape[1] for column in columns):
        content.warnings.append(
            f"footContactDefinition lacks one of {', '.join(FOOT_CONTACTS)}: foot contacts are not used"
        )
        return None
    if not np.isfinite(values).all():
        content.warnings.append("foot contacts are missing in some frames: they are not used")
        return None
    return np.asarray(values[:, columns] > 0.5)


def _usual_step(recording: MvnxRecording) -> int:
    return int(np.median(np.diff(recording.index))) if len(recording.index) > 1 else 1


def _dropped_frames(recording: MvnxRecording, content: _Content) -> list[dict[str, Any]]:
    usual, steps, time = _usual_step(recording), np.diff(recording.index), content.time
    return [
        {
            "kind": "dropped frames",
            "start_s": float(time[at]),
            "duration_s": float(time[at + 1] - time[at]),
            "frames": int(steps[at] // usual - 1),
        }
        for at in np.flatnonzero(steps >= 2 * usual)
    ]


def _missing_values(content: _Content) -> list[dict[str, Any]]:
    gaps: list[dict[str, Any]] = []
    time = content.time
    for field, missing in content.missing.items():
        edges = np.flatnonzero(np.diff(np.concatenate([[False], missing.any(axis=1), [False]]).astype(int)))
        for start, stop in edges.reshape(-1, 2):
            before, after = max(start - 1, 0), min(stop, len(time) - 1)
            gaps.append(
                {
                    "kind": "missing values",
                    "field": field,
                    "segments": [content.segments[s] for s in np.flatnonzero(missing[start:stop].any(axis=0))],
                    "start_s": float(time[before]),
                    "duration_s": float(time[after] - time[before]),
                    "frames": int(stop - start),
                }
            )
    return gaps


def _freeze(array: Array | None) -> None:
    """Make `array`, and what it is a view of, read-only: such arrays `HumanMotion` shares instead of copying them."""
    while array is not None:
        array.flags.writeable = False
        array = array.base if isinstance(array.base, np.ndarray) else None


def _blocks(frames: int) -> Iterator[slice]:
    return (slice(start, start + _BLOCK) for start in range(0, frames, _BLOCK))


FORMAT = Format(
    name="mvnx",
    description="Xsens MVN, XML export (MVNX 3 and 4)",
    suffixes=(".mvnx.gz", ".mvnx"),
    magic=(b"<?xml", b"\xef\xbb\xbf<?xml", b"<mvnx"),
    read_motion=read_motion,
    describe=describe,
    pipeable=True,
)
