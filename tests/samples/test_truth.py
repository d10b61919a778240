"""What the files say, decoded without the package, against the motion they were written from."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from retarget.core.segments import PARENT, SEGMENTS
from retarget.samples import generate, mvnx_writer
from scipy.spatial.transform import Rotation

NAMES = sorted(generate.SAMPLES)
ROUNDING = 0.5e-6
Documents = Callable[[str], Any]


def _wxyz(rotation: Rotation) -> np.ndarray:
    return rotation.as_quat()[..., [3, 0, 1, 2]]


def _apart(a: np.ndarray, b: np.ndarray) -> float:
    """Largest difference of quaternions, sign left aside."""
    return float(np.minimum(np.abs(a - b).max(axis=-1), np.abs(a + b).max(axis=-1)).max())


@pytest.mark.parametrize("name", NAMES)
def test_every_frame_decodes_to_the_motion(name: str, document: Documents, truth: Documents) -> None:
    content, motion = document(name), truth(name)
    assert len(content.orientation) == motion.frames
    assert content.rate_hz == motion.rate_hz == 60
    assert np.abs(content.position - motion.position).max() <= 1.01 * ROUNDING
    for i, segment in enumerate(SEGMENTS):
        # Rounding moves each of the eight numbers of the two quaternions that are multiplied in version 3.
        assert _apart(_wxyz(content.world(segment)), motion.orientation[:, i]) < 4 * ROUNDING, segment
    if content.contacts is not None:
        assert (content.contacts == motion.foot_contacts).all()
    if content.angular_velocity is not None:
        assert np.abs(content.angular_velocity - motion.angular_velocity).max() <= 1.01 * ROUNDING


@pytest.mark.parametrize("name", NAMES)
def test_golden_frames_are_the_decoded_ones(name: str, document: Documents, golden: Documents) -> None:
    content, expected = document(name), golden(name)
    assert expected["segments"] == list(content.segments) == list(SEGMENTS)
    assert (expected["frames"], expected["rate_hz"], expected["version"]) == (
        len(content.frames),
        content.rate_hz,
        content.attributes["version"],
    )
    assert len(expected["selected"]) == 5
    assert [frame["frame"] for frame in expected["selected"]][:: len(expected["selected"]) - 1] == [
        0,
        expected["frames"] - 1,
    ]
    for frame in expected["selected"]:
        i = frame["frame"]
        decoded = np.array([_wxyz(content.world(segment)[i]) for segment in SEGMENTS])
        assert _apart(decoded, np.array(frame["orientation"])) < 4 * ROUNDING
        assert np.abs(content.position[i] - frame["position"]).max() < 1.1 * ROUNDING
        if content.contacts is not None:
            assert content.contacts[i].tolist() == frame["foot_contacts"]
    if content.contacts is not None:
        assert content.contacts.sum(axis=0).tolist() == list(expected["contact_frames"].values())


@pytest.mark.parametrize("name", NAMES)
def test_forward_closure(name: str, document: Documents) -> None:
    """Each child's origin is its joint in the parent's frame, carried by the parent: below 1 mm (here: below the digits written)."""
    content = document(name)
    for segment, parent in PARENT.items():
        if parent is not None:
            shared = (set(content.points[parent]) & set(content.points[segment])) - {"pHipOrigin"}
            (joint,) = (label for label in shared if label.startswith("j"))
            assert np.abs(content.points[segment][joint]).max() == 0
            gap = np.linalg.norm(content.at(parent, joint) - content.at(segment), axis=1).max()
            assert gap < 5e-6, f"{segment}: {gap * 1e3:.4f} mm"


def test_version_3_without_its_reference_is_far_off(document: Documents) -> None:
    """The twin is worth its place: a reader that forgets the N-pose frames misses the wrist by decimetres."""
    content = document("walk_v3")
    at = content.segments.index("LeftForeArm")
    raw = Rotation.from_quat(content.orientation[:, at][:, [1, 2, 3, 0]])
    offset = content.points["LeftForeArm"]["jLeftWrist"]
    missed = np.linalg.norm(content.at("LeftForeArm") + raw.apply(offset) - content.at("LeftHand"), axis=1)
    assert missed.min() > 0.2


def test_both_versions_of_the_walk_hold_the_same_motion(document: Documents) -> None:
    four, three = document("walk"), document("walk_v3")
    for segment in SEGMENTS:
        apart = (four.world(segment).inv() * three.world(segment)).magnitude().max()
        assert apart < 4e-6, segment
    assert (four.position == three.position).all()


@pytest.mark.parametrize("name", [n for n in NAMES if not n.startswith("yaw")])
def test_angular_velocity_is_the_derivative_in_world_axes(name: str, document: Documents) -> None:
    content = document(name)
    for i, segment in enumerate(SEGMENTS):
        turned = content.world(segment)
        near = (turned[3:-1] * turned[1:-3].inv()).as_rotvec() * content.rate_hz / 2
        far = (turned[4:] * turned[:-4].inv()).as_rotvec() * content.rate_hz / 4
        # Two central differences, extrapolated to a step of zero.
        wrong = (4 * near - far) / 3 - content.angular_velocity[2:-2, i]
        assert np.abs(wrong).max() < 0.1, segment
        assert np.sqrt(np.mean(wrong**2)) < 0.01, segment
    arm = content.world("LeftForeArm")
    local = arm[1:-1].inv().apply(content.angular_velocity[1:-1, SEGMENTS.index("LeftForeArm")])
    assert np.abs(local - content.angular_velocity[1:-1, SEGMENTS.index("LeftForeArm")]).max() > 1.0


@pytest.mark.parametrize("heading", range(0, 360, 45))
def test_yaw_clips_are_one_motion_turned(heading: int, document: Documents) -> None:
    ahead, turned = document("yaw_000"), document(f"yaw_{heading:03d}")
    turn = Rotation.from_euler("z", heading, degrees=True)
    assert (
        np.abs(turned.position - turn.apply(ahead.position.reshape(-1, 3)).reshape(ahead.position.shape)).max()
        < 3 * ROUNDING
    )
    for segment in SEGMENTS:
        assert (turned.world(segment).inv() * (turn * ahead.world(segment))).magnitude().max() < 4e-6, segment


def test_signs_of_quaternions_flip_as_in_real_files(document: Documents) -> None:
    orientation = document("walk").orientation
    assert (np.einsum("tsi,tsi->ts", orientation[1:], orientation[:-1]) < 0).sum() > 50


def test_reference_frames_are_those_of_real_recordings(shared_data: Path, document: Documents) -> None:
    """The constant frames of version 3, and of tpose-isb in version 4, are those that Xsens writes."""
    for name, file, kind in (
        ("walk_v3", "full_body_v3_240hz_4frames.mvnx", "npose"),
        ("walk", "upper_body_v4_60hz.mvnx", "identity"),
    ):
        real = _real_frames(shared_data / "mvnx" / file)
        assert _apart(document(name).reference[kind][0], real[kind]) < 2 * ROUNDING
    assert (
        _apart(mvnx_writer.N_POSE_AXES, _real_frames(shared_data / "mvnx/full_body_v3_240hz_4frames.mvnx")["npose"])
        < 2 * ROUNDING
    )
    real, ours = _real_frames(shared_data / "mvnx/upper_body_v4_60hz.mvnx"), document("walk").reference
    for i, segment in enumerate(SEGMENTS):
        change = _rotation(real["tpose"][i]).inv() * _rotation(real["tpose-isb"][i])
        own = _rotation(ours["tpose"][0][i]).inv() * _rotation(ours["tpose-isb"][0][i])
        assert (change.inv() * own).magnitude() < 5e-6, segment


def _rotation(quaternion: np.ndarray) -> Rotation:
    return Rotation.from_quat(quaternion[..., [1, 2, 3, 0]])


def _real_frames(path: Path) -> dict[str, np.ndarray]:
    from lxml import etree

    root = etree.parse(path).getroot()
    space = "{" + root.nsmap[None] + "}"
    return {
        frame.get("type"): np.array(frame.find(f"{space}orientation").text.split(), float).reshape(-1, 4)
        for frame in root.iter(f"{space}frame")
        if frame.get("type") != "normal"
    }
