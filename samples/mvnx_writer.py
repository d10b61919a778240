"""Writes a recording as an Xsens MVNX file, version 4 or 3, gzip-compressed and the same to the byte every time.

Version 4 states orientations in segment frames that are aligned with the world in T-pose; version 3 in frames aligned in
N-pose (arms down), while its `npose` frame shows the arms horizontal and so holds the constant offset between the two: 90°
for upper arms, 120° for forearms and hands. Points are in T-pose axes in both.
"""

from __future__ import annotations

import gzip
import io
from collections.abc import Iterator, Mapping
from typing import Final, Literal
from xml.sax.saxutils import quoteattr

import numpy as np
from retarget.core import rotations
from retarget.core.segments import FOOT_CONTACTS, PARENT, SEGMENTS
from retarget.core.types import Array
from retarget.samples import person
from retarget.samples.recording import Recording

Version = Literal[3, 4]

_JOINT: Final = {
    "L5": "jL5S1",
    "L3": "jL4L3",
    "T12": "jL1T12",
    "T8": "jT9T8",
    "Neck": "jT1C7",
    "Head": "jC1Head",
    "Shoulder": "T4Shoulder",
    "UpperArm": "Shoulder",
    "ForeArm": "Elbow",
    "Hand": "Wrist",
    "UpperLeg": "Hip",
    "LowerLeg": "Knee",
    "Foot": "Ankle",
    "Toe": "BallFoot",
}
_HALF: Final = float(np.sqrt(0.5))


def _n_pose_axes() -> Array:
    """(23, 4): each segment's N-pose-aligned frame, seen in T-pose."""
    axes = np.zeros((len(SEGMENTS), 4))
    axes[:, 0] = 1.0
    for side, left in (("Left", 1.0), ("Right", -1.0)):
        axes[SEGMENTS.index(f"{side}UpperArm")] = (_HALF, left * _HALF, 0.0, 0.0)
        for segment in ("ForeArm", "Hand"):
            axes[SEGMENTS.index(f"{side}{segment}")] = (0.5, left * 0.5, 0.5, -left * 0.5)
    return axes


N_POSE_AXES: Final = _n_pose_axes()


def joint_label(segment: str, version: Version) -> str:
    """The name that MVNX gives to the proximal joint of `segment`."""
    for side in ("Left", "Right"):
        if segment.startswith(side):
            name = _JOINT[segment.removeprefix(side)]
            # The joint between chest and shoulder was renamed between the versions.
            return f"j{side}{name.replace('T4', 'C7') if version == 3 else name}"
    return _JOINT[segment]


def write(recording: Recording, version: Version, name: str, fields: Mapping[str, bool]) -> bytes:
    """The gzip-compressed file. fields: which optional ones are written, "angularVelocity" and "footContacts"."""
    text = "\n".join(_document(recording, version, name, fields)) + "\n"
    stream = io.BytesIO()
    # No time stamp and no file name in the gzip header.
    with gzip.GzipFile(filename="", mode="wb", fileobj=stream, compresslevel=9, mtime=0) as packed:
        packed.write(text.encode())
    return stream.getvalue()


def _document(recording: Recording, version: Version, name: str, fields: Mapping[str, bool]) -> Iterator[str]:
    comment = (
        f"Synthetic sample '{name}': computed by retarget.samples from published norms, not recorded from a person."
    )
    yield '<?xml version="1.0" encoding="UTF-8"?>'
    yield f"<!-- {comment} -->"
    yield f'<mvnx xmlns="http://www.xsens.com/mvn/mvnx" version="{version}">'
    yield f"<comment>{comment}</comment>"
    extra = ' configuration="FullBody" userScenario="singleLevel"' if version == 4 else ""
    label = quoteattr(f"synthetic {name}")
    yield f'<subject label={label} frameRate="{recording.rate_hz}" segmentCount="{len(SEGMENTS)}"{extra}>'
    yield from _segments(version)
    yield from _joints(version)
    if fields["footContacts"]:
        yield "<footContactDefinition>"
        yield from (f'<contactDefinition label="{label}" index="{i}"/>' for i, label in enumerate(FOOT_CONTACTS))
        yield "</footContactDefinition>"
    yield f'<frames segmentCount="{len(SEGMENTS)}" sensorCount="0" jointCount="{len(SEGMENTS) - 1}">'
    yield from _reference_frames(version)
    yield from _normal_frames(recording, version, fields)
    yield "</frames>"
    yield "</subject>"
    yield "</mvnx>"


def _segments(version: Version) -> Iterator[str]:
    tag = "pos_b" if version == 4 else "pos_s"
    yield "<segments>"
    for number, segment in enumerate(SEGMENTS, start=1):
        points = dict(person.SURFACE_POINTS.get(segment, {}))
        if PARENT[segment] is not None:
            points[joint_label(segment, version)] = np.zeros(3)
        for child, parent in PARENT.items():
            if parent == segment:
                points[joint_label(child, version)] = person.JOINT_OFFSETS[child]
        yield f'<segment label="{segment}" id="{number}"><points>'
        for label, xyz in points.items():
            yield f'<point label="{label}"><{tag}>{_numbers(xyz)}</{tag}></point>'
        yield "</points></segment>"
    yield "</segments>"


def _joints(version: Version) -> Iterator[str]:
    yield "<joints>"
    for segment, parent in PARENT.items():
        if parent is not None:
            label = joint_label(segment, version)
            ends = f"<connector1>{parent}/{label}</connector1><connector2>{segment}/{label}</connector2>"
            yield f'<joint label="{label}">{ends}</joint>'
    yield "</joints>"


def _reference_frames(version: Version) -> Iterator[str]:
    root = np.array([[0.0, 0.0, person.HIP_HEIGHT]])
    straight, at = person.forward(root, {"Pelvis": np.array([[1.0, 0.0, 0.0, 0.0]])})
    natural, natural_at = person.forward(root, _natural_stance())
    natural_at = natural_at - [0.0, 0.0, natural_at[0, SEGMENTS.index("LeftFoot"), 2] - person.ANKLE_HEIGHT]
    rows = (
        [("npose", N_POSE_AXES, at[0]), ("tpose", rotations.multiply(natural[0], N_POSE_AXES), natural_at[0])]
        if version == 3
        else [
            ("identity", straight[0], at[0]),
            ("tpose", natural[0], natural_at[0]),
            ("tpose-isb", rotations.multiply(natural[0], N_POSE_AXES), natural_at[0]),
        ]
    )
    for i, (kind, orientation, position) in enumerate(rows):
        index = f' index="{i - 3}"' if version == 3 else ""
        yield f'<frame time="0"{index} tc="00:00:00:00" ms="0" type="{kind}">'
        yield f"<orientation>{_numbers(orientation)}</orientation>"
        yield f"<position>{_numbers(position)}</position>"
        yield "</frame>"


def _natural_stance() -> dict[str, Array]:
    """T-pose as people hold it, the pelvis and knees a little bent: what the `tpose` frame shows beside the exact axes."""

    def pitch(degrees: float) -> Array:
        return rotations.exp(np.array([[0.0, np.radians(degrees), 0.0]]))

    joints = {"Pelvis": pitch(-4.0), "L5": pitch(7.0), "L3": pitch(-3.0), "Neck": pitch(9.0)}
    for side in ("Left", "Right"):
        joints |= {f"{side}UpperLeg": pitch(6.5), f"{side}LowerLeg": pitch(2.0), f"{side}Foot": pitch(-4.5)}
    return joints


def _normal_frames(recording: Recording, version: Version, fields: Mapping[str, bool]) -> Iterator[str]:
    orientation = recording.orientation
    if version == 3:
        orientation = rotations.multiply(orientation, N_POSE_AXES)
    # Recordings hold either sign of a quaternion: some runs of some segments are negated here, by a fixed pattern.
    frame, segment = np.indices(orientation.shape[:2])
    orientation = np.where(((frame // 37 + 5 * segment) % 7 == 3)[..., None], -orientation, orientation)
    for i in range(recording.frames):
        ms = round(1000 * i / recording.rate_hz)
        yield f'<frame time="{ms}" index="{i}" tc="{_time_code(i, recording.rate_hz)}" ms="{ms}" type="normal">'
        yield f"<orientation>{_numbers(orientation[i])}</orientation>"
        yield f"<position>{_numbers(recording.position[i])}</position>"
        if fields["angularVelocity"]:
            yield f"<angularVelocity>{_numbers(recording.angular_velocity[i])}</angularVelocity>"
        if fields["footContacts"]:
            yield f"<footContacts>{' '.join(str(int(c)) for c in recording.foot_contacts[i])}</footContacts>"
        yield "</frame>"


def _time_code(frame: int, rate_hz: int) -> str:
    seconds, rest = divmod(frame, rate_hz)
    return f"00:{seconds // 60:02d}:{seconds % 60:02d}:{rest:02d}"


def _numbers(values: Array) -> str:
    # Adding zero turns −0.0, whose sign is chance, into 0.0.
    return " ".join(f"{v:.6f}" for v in (np.round(np.ravel(values), 6) + 0.0).tolist())
