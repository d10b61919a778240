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
from retarget.core.segments import FOOT_CONTACTS, LOWER_BODY, PARENT
from retarget.core.types import Array, BoolArray, HumanMotion, Source
from retarget.formats import _mvnx_body as body
from retarget.formats import _mvnx_gaps as gaps
from retarget.formats._mvnx_header import is_prop
from retarget.formats._mvnx_parser import MvnxRecording, parse_mvnx
from retarget.formats.base import Format

_CLOSURE_FRAMES = 256
_CLOSURE_LIMIT_M = 0.01
_FIELDS = (("orientation", 4), ("position", 3), ("angularVelocity", 3))


def read_motion(stream: BinaryIO, name: str) -> HumanMotion:
    """The motion of an MVNX document. `stream` need not seek and may be gzip; `name` is what messages call it.

    Raises `FormatError` for anything that is not an MVNX recording of version 3 or 4, and for values missing for longer than
    `_mvnx_gaps.LONGEST_GAP_S`; shorter gaps are interpolated, counted and warned of. Beside the motion's own arrays this needs a few MB.
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
    if position is None and offsets:
        position = body.forward_positions(content.segments, orientation, offsets)
        warnings.append("the file has no positions: computed from the joints' points, the pelvis at the origin")
    elif position is None:
        position = np.full((*orientation.shape[:2], 3), np.nan)
        warnings.append("the file has no positions and no points to compute them from")
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
        "foot_contacts": _foot_contacts(recording, content) is not None,
        "gaps": [*gaps.dropped_frames(recording.index, content.time), *missing],
        "warnings": content.warnings,
    }


@dataclass(frozen=True)
class _Content:
    """A recording as understood, values still the file's own. T frames, S segments.

    values: field → (T, S, 3 or 4), NaN where missing. missing: field → (T, S), of those with something missing.
    reference: (S, 4) the file's T-pose orientations, reference_source: where they come from.
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

    step = gaps.usual_step(recording.index)
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
        time=recording.index / header.rate_hz,
        rate_hz=header.rate_hz / step,
        measured=body.measured_segments(header, segments, warnings),
        values=values,
        missing=missing,
        reference=reference[columns],
        reference_source=reference_source,
        warnings=warnings,
    )
    if dropped := gaps.dropped_frames(recording.index, content.time):
        count, longest = sum(gap["frames"] for gap in dropped), max(gap["duration_s"] for gap in dropped)
        warnings.append(f"dropped frames: {count}, gaps: {len(dropped)}, the longest {longest:.3g} s")
    return content


def _fill(content: _Content, field: str, name: str) -> BoolArray:
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


def _closure_warning(
    content: _Content, orientation: Array, position: Array, offsets: Mapping[str, Array]
) -> Iterator[str]:
    some = np.unique(np.linspace(0, len(orientation) - 1, _CLOSURE_FRAMES).astype(int))
    measured = {segment for segment, ok in zip(content.segments, content.measured, strict=True) if ok}
    known = {segment: offset for segment, offset in offsets.items() if {segment, PARENT[segment]} <= measured}
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
    describe=describe,
    pipeable=True,
)
