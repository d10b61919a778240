"""Independent truth about MVNX files: lxml and SciPy only, nothing of the reader under test."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from lxml import etree
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "mvnx"
FULL_BODY_V3 = DATA / "full_body_v3_240hz_4frames.mvnx"
UPPER_BODY_V4 = DATA / "upper_body_v4_60hz.mvnx"


@dataclass(frozen=True)
class Document:
    """A whole MVNX file as lxml's DOM has it; values as written."""

    labels: list[str]
    points: dict[str, dict[str, Array]]
    joints: list[tuple[str, str, str, str]]
    """(parent segment, its point, child segment, its point), in the order of `jointAngle`."""
    reference: dict[str, dict[str, Array]]
    """Frame type → field → values, for frames that are not normal."""
    index: Array
    fields: dict[str, Array]
    """Field → (T, numbers) of normal frames."""


def read_document(path: Path) -> Document:
    """Parse with lxml, match local names by XPath."""
    root = etree.parse(path).getroot()

    def find(node: etree._Element, *names: str) -> list[etree._Element]:
        return node.xpath("./" + "/".join(f"*[local-name()='{name}']" for name in names))

    def numbers(node: etree._Element) -> Array:
        return np.array([float(word) for word in node.text.split()])

    (subject,) = find(root, "subject")
    points = {
        segment.get("label"): {point.get("label"): numbers(point[0]) for point in find(segment, "points", "point")}
        for segment in find(subject, "segments", "segment")
    }
    joints = []
    for joint in find(subject, "joints", "joint"):
        parent, child = (find(joint, connector)[0].text.split("/") for connector in ("connector1", "connector2"))
        joints.append((*parent, *child))
    frames = find(subject, "frames", "frame")
    normal = [frame for frame in frames if frame.get("type") == "normal"]
    names = [etree.QName(field).localname for field in normal[0]]
    return Document(
        labels=list(points),
        points=points,
        joints=joints,
        reference={
            frame.get("type"): {etree.QName(field).localname: numbers(field) for field in frame}
            for frame in frames
            if frame.get("type") != "normal"
        },
        index=np.array([int(frame.get("index")) for frame in normal]),
        fields={name: np.array([numbers(find(frame, name)[0]) for frame in normal]) for name in names},
    )


def rotation(wxyz: Array) -> Rotation:
    """SciPy's rotation of quaternions (..., 4), flattened to (N, 4)."""
    return Rotation.from_quat(np.asarray(wxyz).reshape(-1, 4)[:, [1, 2, 3, 0]])


def closure_mm(document: Document, segments: tuple[str, ...], orientation: Array, position: Array) -> dict[str, float]:
    """Child segment → largest distance over time, mm, between its origin and where its parent's point puts the joint."""
    distances = {}
    for parent, point, child, own_point in document.joints:
        assert not document.points[child][own_point].any()  # a segment's origin is its proximal joint
        at, to = segments.index(parent), segments.index(child)
        joint = position[:, at] + rotation(orientation[:, at]).apply(document.points[parent][point])
        distances[child] = float(np.linalg.norm(joint - position[:, to], axis=1).max() * 1e3)
    return distances


def npose_constants(document: Document) -> Array:
    """(S, 4) wxyz: what a T-pose frame is followed by to become the N-pose frame that joint angles are defined in."""
    if "npose" in document.reference:
        return document.reference["npose"]["orientation"].reshape(-1, 4)
    tpose, isb = (rotation(document.reference[kind]["orientation"]) for kind in ("tpose", "tpose-isb"))
    return (tpose.inv() * isb).as_quat()[:, [3, 0, 1, 2]]


_TRUNK, _RIGHT, _RIGHT_LEG, _LEFT, _LEFT_LEG = (1, 1, -1), (-1, 1, 1), (-1, 1, -1), (1, -1, 1), (1, -1, -1)


def _signs(joint: str) -> tuple[int, int, int]:
    side = "Right" if "Right" in joint else "Left" if "Left" in joint else ""
    if not side:
        return _TRUNK
    if "Knee" in joint or "BallFoot" in joint:
        return _RIGHT_LEG if side == "Right" else _LEFT_LEG
    return _RIGHT if side == "Right" else _LEFT


def joint_angles_deg(document: Document, segments: tuple[str, ...], orientation: Array) -> Array:
    """`jointAngle` (T, J, 3) degrees recomputed from T-pose orientations (T, S, 4): abduction, axial rotation, flexion.

    M = P (R_parentᵀ R_child) Pᵀ in N-pose frames, P: (x, y, z) → (x, z, -y), taken apart as M = Rz Rx Ry, with the signs by which
    Xsens makes left and right alike.
    """
    p = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    constants = npose_constants(document)
    angles = np.empty((len(orientation), len(document.joints), 3))
    for j, (parent, point, child, _) in enumerate(document.joints):
        bodies = []
        for segment in (parent, child):
            s = segments.index(segment)
            constant = rotation(constants[document.labels.index(segment)])
            bodies.append((rotation(orientation[:, s]) * constant).as_matrix())
        m = p @ (bodies[0].transpose(0, 2, 1) @ bodies[1]) @ p.T
        # Intrinsic z, x, y: M = Rz(c) Rx(a) Ry(b).
        c, a, b = Rotation.from_matrix(m).as_euler("ZXY", degrees=True).T
        angles[:, j] = np.stack([a, b, c], axis=1) * _signs(point)
    return angles
