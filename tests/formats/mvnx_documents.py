"""Small MVNX documents of known content, written as text for the tests of the reader, and read back."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Sequence
from itertools import count
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from retarget.core import rotations
from retarget.core.types import HumanMotion
from retarget.formats.mvnx import describe, read_motion
from scipy.spatial.transform import Rotation

V3_TPOSE = {
    "RightUpperArm": "0.707107 -0.707107 0.000000 0.000000",
    "RightForeArm": "0.500000 -0.500000 0.500000 0.500000",
    "RightHand": "0.500000 -0.500000 0.500000 0.500000",
    "LeftUpperArm": "0.707107 0.707107 0.000000 0.000000",
    "LeftForeArm": "0.500000 0.500000 0.500000 -0.500000",
    "LeftHand": "0.500000 0.500000 0.500000 -0.500000",
}
"""What version 3 writes for arms in T-pose, as its software does (the `npose` frame of a real recording)."""
IDENTITY = "1.000000 0.000000 0.000000 0.000000"
CONTACTS = ("LeftFoot_Heel", "LeftFoot_Toe", "RightFoot_Heel", "RightFoot_Toe")


def numbers(values: ArrayLike, decimals: int = 6) -> str:
    return " ".join(f"{value:.{decimals}f}" for value in np.ravel(values))


def mvnx(
    motion: HumanMotion,
    *,
    version: str = "4",
    index: Sequence[int] | None = None,
    rate: str = "60",
    segments: Sequence[str] | None = None,
    fields: Sequence[str] = ("orientation", "position", "angularVelocity"),
    reference: bool = True,
    points: bool = True,
    decimals: int = 6,
    subject: str = 'configuration="FullBody"',
    header: str = "",
    extra: Callable[[int], str] = lambda _: "",
) -> str:
    """`motion` as an MVNX document, a tag on each line. Orientations as `version` has them.

    segments: the order of the columns. header: further elements before `<frames>`. extra: further elements of a frame.
    """
    labels = list(segments or motion.segments)
    columns = [motion.index(label) for label in labels]
    tpose = [V3_TPOSE.get(label, IDENTITY) if version == "3" else IDENTITY for label in labels]
    point = "pos_s" if version == "3" else "pos_b"
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<mvnx version="{version}" xmlns="http://www.xsens.com/mvn/mvnx">',
        '<mvn version="2019.0.0" build="none"/>',
        "<comment>Jane Doe lifts a box</comment>",
        f'<subject label="Jane Doe" frameRate="{rate}" segmentCount="{len(labels)}" originalFilename="Jane Doe.mvn" {subject}>',
        "<segments>",
    ]
    for number, label in enumerate(labels, 1):
        lines += [f'<segment label="{label}" id="{number}">', "<points>"]
        if points:
            own = [(f"j{label}", (0.0, 0.0, 0.0)), ("pSkin", (0.1, 0.2, 0.3))]
            children = [
                (f"j{child}", offset) for child, offset in motion.joint_offsets.items() if PARENTS[child] == label
            ]
            for name, where in own + children:
                lines.append(f'<point label="{name}"><{point}>{numbers(where)}</{point}></point>')
        lines += ["</points>", "</segment>"]
    lines += ["</segments>", header, "<frames>"]
    if reference:
        kind = "npose" if version == "3" else "identity"
        pose = ["<frame time='0' type='{}'>", f"<orientation>{' '.join(tpose)}</orientation>", "</frame>"]
        lines += [pose[0].format(kind), *pose[1:], pose[0].format("tpose"), *pose[1:]]
    to_file = np.array([text.split() for text in tpose], float)
    for frame in range(motion.frames):
        at = frame if index is None else index[frame]
        lines.append(
            f'<frame time="{round(1000 * at / float(rate))}" index="{at}" tc="0" ms="1542082631842" type="normal">'
        )
        values = {
            "orientation": after(motion.orientation[frame, columns], to_file),
            "position": motion.position[frame, columns],
        }
        if motion.angular_velocity is not None:
            values["angularVelocity"] = motion.angular_velocity[frame, columns]
        lines += [f"<{name}>{numbers(values[name], decimals)}</{name}>" for name in fields if name in values]
        lines += [extra(frame), "</frame>"]
    lines += ["</frames>", "</subject>", '<securityCode code="0"/>', "</mvnx>", ""]
    return "\n".join(line for line in lines if line or line == lines[-1])


def edit(text: str, field: str, change: Callable[[int, list[str]], Sequence[str]]) -> str:
    """The document with the numbers of `field` changed: (frame counted from 0, words) → words, for every normal frame."""
    frames = count()

    def replace(match: re.Match[str]) -> str:
        return match[1] + " ".join(change(next(frames), match[2].split()))

    changed = re.sub(rf'(type="normal">\n(?:<(?!/frame).*\n)*?<{field}>)([^<]*)', replace, text)
    assert next(frames) > 0
    return changed


def contact_definition(labels: Sequence[str] = CONTACTS) -> str:
    inner = "".join(f'<contactDefinition label="{label}" index="{i}"/>' for i, label in enumerate(labels))
    return f"<footContactDefinition>{inner}</footContactDefinition>"


def after(left: NDArray[np.float64], right: NDArray[np.float64]) -> NDArray[np.float64]:
    """Quaternions wxyz (N, 4) of first `right`, then `left`, by SciPy."""
    xyzw = (Rotation.from_quat(left[:, [1, 2, 3, 0]]) * Rotation.from_quat(right[:, [1, 2, 3, 0]])).as_quat()
    return xyzw[:, [3, 0, 1, 2]]


PARENTS = {
    "L5": "Pelvis", "L3": "L5", "T12": "L3", "T8": "T12", "Neck": "T8", "Head": "Neck",
    "RightShoulder": "T8", "RightUpperArm": "RightShoulder", "RightForeArm": "RightUpperArm", "RightHand": "RightForeArm",
    "LeftShoulder": "T8", "LeftUpperArm": "LeftShoulder", "LeftForeArm": "LeftUpperArm", "LeftHand": "LeftForeArm",
    "RightUpperLeg": "Pelvis", "RightLowerLeg": "RightUpperLeg", "RightFoot": "RightLowerLeg", "RightToe": "RightFoot",
    "LeftUpperLeg": "Pelvis", "LeftLowerLeg": "LeftUpperLeg", "LeftFoot": "LeftLowerLeg", "LeftToe": "LeftFoot",
}  # fmt: skip


def read(text: str | bytes, name: str = "clip.mvnx") -> HumanMotion:
    """The motion of a document."""
    return read_motion(io.BytesIO(text.encode() if isinstance(text, str) else text), name)


def facts(text: str) -> dict[str, Any]:
    """What `retarget info` says of a document."""
    return dict(describe(io.BytesIO(text.encode()), "clip.mvnx"))


def about(axis: str, degrees: ArrayLike) -> NDArray[np.float64]:
    """Quaternions wxyz (..., 4) of turns about a world axis."""
    angles = np.asarray(degrees, float)[..., None] if len(axis) == 1 else degrees
    return Rotation.from_euler(axis, angles, degrees=True).as_quat()[..., [3, 0, 1, 2]]


def angle_deg(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """The largest angle between rotations."""
    return float(np.degrees(rotations.angle(a, b)).max())
