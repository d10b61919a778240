"""The committed samples, decoded here by lxml and SciPy alone: no code of the package reads or turns anything."""

from __future__ import annotations

import gzip
import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lxml import etree
from numpy.typing import NDArray
from retarget.samples import generate, sample_path
from retarget.samples.recording import Recording
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
TREE = {
    "L5": "Pelvis",
    "L3": "L5",
    "T12": "L3",
    "T8": "T12",
    "Neck": "T8",
    "Head": "Neck",
    **{
        f"{side}{child}": parent if parent in ("T8", "Pelvis") else f"{side}{parent}"
        for side in ("Right", "Left")
        for child, parent in {
            "Shoulder": "T8",
            "UpperArm": "Shoulder",
            "ForeArm": "UpperArm",
            "Hand": "ForeArm",
            "UpperLeg": "Pelvis",
            "LowerLeg": "UpperLeg",
            "Foot": "LowerLeg",
            "Toe": "Foot",
        }.items()
    },
}
"""Child → parent."""


@dataclass(frozen=True)
class Document:
    """What stands in a file. orientation: (T, S, 4) wxyz as written. reference: frame type → ((S, 4), (S, 3))."""

    attributes: dict[str, str]
    comment: str
    segments: tuple[str, ...]
    points: dict[str, dict[str, Array]]
    reference: dict[str, tuple[Array, Array]]
    orientation: Array
    position: Array
    angular_velocity: Array | None
    contacts: NDArray[np.bool_] | None
    frames: list[dict[str, str]]

    @property
    def rate_hz(self) -> float:
        return float(self.attributes["frameRate"])

    def world(self, segment: str) -> Rotation:
        """The segment's T-pose-invariant rotation in every frame: R_file · R_refᵀ, the reference as the version has it."""
        at = self.segments.index(segment)
        reference = self.reference["npose" if self.attributes["version"] == "3" else "identity"][0][at]
        return rotation(self.orientation[:, at]) * rotation(reference).inv()

    def relative(self, segment: str) -> Rotation:
        """The segment's rotation in its parent's frame."""
        return self.world(TREE[segment]).inv() * self.world(segment)

    def at(self, segment: str, point: str | None = None) -> Array:
        """World position (T, 3) m of the segment's origin or of one of its points."""
        origin = self.position[:, self.segments.index(segment)]
        return origin if point is None else origin + self.world(segment).apply(self.points[segment][point])


def rotation(quaternion: Array) -> Rotation:
    """SciPy's rotation of wxyz quaternions."""
    return Rotation.from_quat(np.asarray(quaternion)[..., [1, 2, 3, 0]])


@cache
def _read(path: Path) -> Document:
    with gzip.open(path) as stream:
        root = etree.parse(stream).getroot()
    space = "{" + root.nsmap[None] + "}"
    subject = root.find(f"{space}subject")
    assert subject is not None

    def numbers(element: Any, tag: str, width: int) -> Array:
        return np.array(element.find(space + tag).text.split(), float).reshape(-1, width)

    normal = [frame for frame in subject.iter(f"{space}frame") if frame.get("type") == "normal"]
    special = [frame for frame in subject.iter(f"{space}frame") if frame.get("type") != "normal"]

    def every(tag: str, width: int) -> Array | None:
        return (
            None if normal[0].find(space + tag) is None else np.array([numbers(frame, tag, width) for frame in normal])
        )

    orientation, position, contacts = every("orientation", 4), every("position", 3), every("footContacts", 4)
    assert orientation is not None
    assert position is not None
    return Document(
        {str(key): str(value) for key, value in (*root.attrib.items(), *subject.attrib.items())},
        str(root.find(f"{space}comment").text),
        tuple(segment.get("label") for segment in subject.iter(f"{space}segment")),
        {
            segment.get("label"): {
                p.get("label"): np.array(p[0].text.split(), float) for p in segment.iter(f"{space}point")
            }
            for segment in subject.iter(f"{space}segment")
        },
        {frame.get("type"): (numbers(frame, "orientation", 4), numbers(frame, "position", 3)) for frame in special},
        orientation,
        position,
        every("angularVelocity", 3),
        None if contacts is None else contacts[:, 0] > 0,
        [dict(frame.attrib) for frame in normal],
    )


@pytest.fixture(scope="session")
def document() -> Callable[[str], Document]:
    """`document(name)`: the committed sample, decoded once."""
    return lambda name: _read(sample_path(name))


@pytest.fixture(scope="session")
def truth() -> Callable[[str], Recording]:
    """`truth(name)`: the motion itself, before it was rounded or written."""
    return cache(lambda name: generate.SAMPLES[name].record())


@pytest.fixture(scope="session")
def golden() -> Callable[[str], dict[str, Any]]:
    """`golden(name)`: the committed JSON."""
    return cache(lambda name: json.loads(sample_path(name).with_name(f"{name}.json").read_text()))
