"""The reader on real recordings, against lxml's DOM and two properties of the data that the reader does not use."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from retarget.core import rotations
from retarget.core.segments import LOWER_BODY, SEGMENTS
from retarget.core.types import HumanMotion
from retarget.formats.mvnx import describe, read_motion

from tests.formats.mvnx_oracles import (
    FULL_BODY_V3,
    UPPER_BODY_V4,
    Document,
    closure_mm,
    joint_angles_deg,
    npose_constants,
    read_document,
    rotation,
)


@pytest.fixture(scope="module", params=[FULL_BODY_V3, UPPER_BODY_V4], ids=["v3", "v4"])
def path(request: pytest.FixtureRequest) -> Path:
    if not request.param.is_file():
        pytest.skip("the real recordings (../shared/data) are not on this machine")
    return request.param


@pytest.fixture(scope="module")
def motion(path: Path) -> HumanMotion:
    with path.open("rb") as stream:
        return read_motion(stream, path.name)


@pytest.fixture(scope="module")
def document(path: Path) -> Document:
    return read_document(path)


def test_joints_meet(motion: HumanMotion, document: Document) -> None:
    distances = closure_mm(document, motion.segments, motion.orientation, motion.position)
    assert len(distances) == 22
    assert max(distances.values()) <= 2.0


def test_joints_do_not_meet_without_the_reference_frame(path: Path, document: Document) -> None:
    """The closure test can fail: version 3's own frames miss the elbows by decimetres."""
    raw = document.fields["orientation"].reshape(len(document.index), -1, 4)
    position = document.fields["position"].reshape(len(document.index), -1, 3)
    worst = max(closure_mm(document, tuple(document.labels), raw, position).values())
    assert worst > 390 if path == FULL_BODY_V3 else worst <= 2.0


def test_joint_angles_of_the_file_come_out(motion: HumanMotion, document: Document) -> None:
    written = document.fields["jointAngle"].reshape(motion.frames, -1, 3)
    error = joint_angles_deg(document, motion.segments, motion.orientation) - written
    assert written.shape[1] == 22
    assert np.abs(written).max() > 90
    assert np.abs((error + 180) % 360 - 180).max() <= 0.01


def test_values_are_those_of_the_file(path: Path, motion: HumanMotion, document: Document) -> None:
    frames = len(document.index)
    assert motion.frames == frames
    assert motion.segments == tuple(document.labels) == SEGMENTS
    rate = 240 if path == FULL_BODY_V3 else 60
    np.testing.assert_array_equal(motion.time, document.index / rate)
    np.testing.assert_array_equal(motion.position, document.fields["position"].reshape(frames, -1, 3))
    np.testing.assert_array_equal(motion.angular_velocity, document.fields["angularVelocity"].reshape(frames, -1, 3))
    reference = np.tile(npose_constants(document), (frames, 1)) if path == FULL_BODY_V3 else [[1.0, 0, 0, 0]]
    expected = rotation(document.fields["orientation"]) * rotation(reference).inv()
    assert (rotation(motion.orientation) * expected.inv()).magnitude().max() < 1e-9


def test_signs_are_continuous_though_the_file_flips(motion: HumanMotion, document: Document) -> None:
    raw = document.fields["orientation"].reshape(motion.frames, -1, 4)
    flips = [int((np.einsum("tsi,tsi->ts", q[1:], q[:-1]) < 0).sum()) for q in (raw, motion.orientation)]
    assert flips[1] == 0
    if motion.frames > 4:
        assert flips[0] > 0


def test_offsets_are_the_parents_points(motion: HumanMotion, document: Document) -> None:
    assert len(motion.joint_offsets) == 22
    for parent, point, child, _ in document.joints:
        np.testing.assert_array_equal(motion.joint_offsets[child], document.points[parent][point])


def test_angular_velocity_is_in_the_world_frame() -> None:
    """Of the two frames it could be in, only the world's fits the orientations: rms 0.05 against 0.6 rad/s."""
    if not UPPER_BODY_V4.is_file():
        pytest.skip("the real recordings (../shared/data) are not on this machine")
    with UPPER_BODY_V4.open("rb") as stream:
        motion = read_motion(stream, "v4")
    assert motion.angular_velocity is not None
    q = rotation(motion.orientation[:-2]), rotation(motion.orientation[2:])
    differenced = (q[1] * q[0].inv()).as_rotvec().reshape(-1, 23, 3) / (2 / 60)
    written = motion.angular_velocity[1:-1]
    local = rotations.rotate(rotations.conjugate(motion.orientation[1:-1]), written)
    rms = [float(np.sqrt(((differenced - candidate) ** 2).mean())) for candidate in (written, local)]
    assert rms[0] < 0.1
    assert rms[1] > 5 * rms[0]


def test_what_was_not_measured(path: Path, motion: HumanMotion) -> None:
    if path == FULL_BODY_V3:
        assert motion.unmeasured_segments == ()
    else:
        assert set(motion.unmeasured_segments) == LOWER_BODY
    assert motion.foot_contacts is None  # version 3 has none; without measured legs they are stuck at 1


def test_source_and_description(path: Path, motion: HumanMotion) -> None:
    import hashlib

    v3 = path == FULL_BODY_V3
    source = motion.source
    assert (source.format, source.version, source.rate_hz) == ("mvnx", "3" if v3 else "4", 240.0 if v3 else 60.0)
    assert source.configuration == ("" if v3 else "UpperBody")
    assert source.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert (source.warnings, source.interpolated_frames) == ((), 0)
    with path.open("rb") as stream:
        facts = describe(stream, path.name)
    assert (facts["frames"], facts["rate_hz"], facts["gaps"], facts["warnings"]) == (
        motion.frames,
        source.rate_hz,
        [],
        [],
    )
    assert facts["duration_s"] == pytest.approx(3 / 240 if v3 else 111 / 60)
    assert facts["mvn_version"] == ("4.2.4" if v3 else "2019.0.0")
    assert facts["segment_frames"] == ("npose" if v3 else "identity")
    assert facts["unmeasured_segments"] == list(motion.unmeasured_segments)
    assert {"jointAngle", "orientation"} < set(facts["fields"])
    # Headers hold names of people and of their files.
    assert "redacted" not in str(facts) + str(source)
    assert "MVN System" not in str(facts) + str(source)
