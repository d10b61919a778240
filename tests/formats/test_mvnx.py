"""The MVNX reader on small documents whose motion is known."""

from __future__ import annotations

import gzip
import hashlib
import io
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from retarget import formats
from retarget.core import rotations
from retarget.core.segments import LOWER_BODY, PARENT, SEGMENTS
from retarget.core.types import HumanMotion
from retarget.formats.mvnx import FORMAT, read_motion

from tests.formats.mvnx_documents import (
    CONTACTS,
    IDENTITY,
    PARENTS,
    V3_TPOSE,
    about,
    angle_deg,
    contact_definition,
    edit,
    facts,
    mvnx,
    read,
)

MotionFactory = Callable[..., HumanMotion]


@pytest.mark.parametrize("version", ["3", "4"])
def test_a_document_comes_back(moving: HumanMotion, version: str) -> None:
    motion = read(mvnx(moving, version=version))
    np.testing.assert_array_equal(motion.time, moving.time)
    assert motion.segments == SEGMENTS
    # Six decimals: half a unit of the last one in each of four numbers is at most 1e-4 degrees of turn.
    assert angle_deg(motion.orientation, moving.orientation) < 2e-4
    np.testing.assert_allclose(motion.position, moving.position, rtol=0, atol=0.51e-6)
    np.testing.assert_allclose(motion.angular_velocity, moving.angular_velocity, rtol=0, atol=0.51e-6)
    assert dict(motion.joint_offsets).keys() == PARENTS.keys()
    for segment, offset in moving.joint_offsets.items():
        np.testing.assert_array_equal(motion.joint_offsets[segment], offset)
    assert motion.measured.all()
    assert motion.source.version == version
    assert motion.source.warnings == ()


def test_both_versions_of_one_motion_are_the_same_motion(moving: HumanMotion) -> None:
    v3, v4 = (read(mvnx(moving, version=version)) for version in ("3", "4"))
    assert np.abs(v3.orientation - v4.orientation).max() < 2e-6


@pytest.mark.parametrize("version", ["3", "4"])
def test_t_pose_is_the_identity(make_motion: MotionFactory, version: str) -> None:
    arms = V3_TPOSE if version == "3" else {}
    text = mvnx(make_motion([0.0]), version=version)
    assert f"<orientation>{' '.join(arms.get(s, IDENTITY) for s in SEGMENTS)}</orientation>" in text
    np.testing.assert_allclose(read(text).orientation[0], np.tile([1.0, 0, 0, 0], (23, 1)), atol=1e-6)


def test_version_3_without_rotation_is_arms_down(make_motion: MotionFactory) -> None:
    """Version 3's frames are aligned with the world in N-pose; ours in T-pose, where the right arm is along -Y."""
    text = mvnx(make_motion([0.0]), version="3")
    motion = read(edit(text, "orientation", lambda *_: [IDENTITY] * 23))
    for side, along in (("Right", (0.0, -1.0, 0.0)), ("Left", (0.0, 1.0, 0.0))):
        for bone in ("UpperArm", "ForeArm", "Hand"):
            down = rotations.rotate(motion.orientation[0, motion.index(side + bone)], along)
            np.testing.assert_allclose(down, (0, 0, -1), atol=1e-6)


@pytest.mark.parametrize("version", ["3", "4"])
def test_turning_left_and_raising_the_right_arm(make_motion: MotionFactory, version: str) -> None:
    time = np.arange(31) / 60
    left, lift = np.linspace(0, 90, 31), np.linspace(0, 90, 31)
    heading = about("z", left)
    raised = rotations.multiply(heading, about("x", -lift))
    spin = np.zeros((31, 23, 3))
    spin[:, SEGMENTS.index("Pelvis")] = (0, 0, np.radians(180))
    motion = read(
        mvnx(make_motion(time, {"Pelvis": heading, "RightUpperArm": raised}, angular_velocity=spin), version=version)
    )
    pelvis, arm, hand = (motion.index(name) for name in ("Pelvis", "RightUpperArm", "RightHand"))
    np.testing.assert_allclose(np.degrees(rotations.yaw(motion.orientation[:, pelvis])), left, atol=2e-4)
    assert motion.angular_velocity is not None
    np.testing.assert_allclose(motion.angular_velocity[:, pelvis], rotations.angular_velocity(time, motion.orientation[:, pelvis]), atol=1e-3)  # fmt: skip
    bone = rotations.rotate(motion.orientation[:, arm], (0, -1, 0))
    np.testing.assert_allclose(bone[0], (0, -1, 0), atol=1e-5)  # out to the right
    np.testing.assert_allclose(bone[-1], (0, 0, 1), atol=1e-5)  # straight up
    # The elbow is where the arm's own direction says, all the way.
    elbow = motion.position[:, motion.index("RightForeArm")] - motion.position[:, arm]
    np.testing.assert_allclose(elbow, 0.30 * bone, atol=1e-5)
    assert motion.position[-1, hand, 2] > motion.position[0, hand, 2] + 0.5


def test_segments_are_found_by_label(moving: HumanMotion) -> None:
    order = list(reversed(SEGMENTS))
    motion = read(mvnx(moving, segments=order, version="3"))
    assert motion.segments == tuple(order)
    for name in SEGMENTS:
        assert angle_deg(motion.orientation[:, motion.index(name)], moving.orientation[:, moving.index(name)]) < 2e-4


def test_some_segments_only(moving: HumanMotion) -> None:
    upper = [name for name in SEGMENTS if name not in LOWER_BODY and name != "T12"]
    motion = read(mvnx(moving, segments=upper))
    assert motion.segments == tuple(upper)
    assert set(motion.joint_offsets) == set(upper) - {"Pelvis", "T8"}  # those whose parent is there, too


def test_signs_are_made_continuous(moving: HumanMotion) -> None:
    def flip(frame: int, words: list[str]) -> list[str]:
        return [str(-float(word)) for word in words] if frame % 3 == 1 else words

    text = edit(mvnx(moving), "orientation", flip)
    assert text != mvnx(moving)
    motion = read(text)
    assert (np.einsum("tsi,tsi->ts", motion.orientation[1:], motion.orientation[:-1]) > 0).all()
    assert angle_deg(motion.orientation, moving.orientation) < 2e-4


def test_a_long_recording_is_continuous_across_blocks(make_motion: MotionFactory) -> None:
    """Two full turns over more frames than are worked on at a time."""
    frames = 9000
    motion = read(mvnx(make_motion(np.arange(frames) / 60, {"Pelvis": about("z", np.linspace(0, 720, frames))}), fields=("orientation",)))  # fmt: skip
    assert (np.einsum("tsi,tsi->ts", motion.orientation[1:], motion.orientation[:-1]) > 0.99).all()
    turned = np.unwrap(rotations.yaw(motion.orientation[:, 0]))
    np.testing.assert_allclose(np.degrees(turned), np.linspace(0, 720, frames), atol=2e-4)


class TestXml:
    """The same document in other clothes."""

    def test_gzip(self, moving: HumanMotion) -> None:
        text = mvnx(moving).encode()
        packed = gzip.compress(text)
        motion = read(packed, "clip.mvnx.gz")
        np.testing.assert_array_equal(motion.orientation, read(text).orientation)
        assert motion.source.sha256 == hashlib.sha256(packed).hexdigest()
        assert read(text).source.sha256 == hashlib.sha256(text).hexdigest()

    def test_a_pipe(self, moving: HumanMotion) -> None:
        """Blocks of any size, no seeking."""

        class Pipe(io.RawIOBase):
            def __init__(self, data: bytes) -> None:
                self.data, self.at = data, 0

            def read(self, size: int = -1) -> bytes:
                size = min(size, 1 + self.at % 977)
                self.at += size
                return self.data[self.at - size : self.at]

        for data in (mvnx(moving).encode(), gzip.compress(mvnx(moving).encode())):
            motion = read_motion(Pipe(data), "-")  # type: ignore[arg-type]  # a raw stream has all that is used
            np.testing.assert_array_equal(motion.orientation, read(data).orientation)

    @pytest.mark.parametrize(
        "change",
        [
            lambda text: text.replace(' xmlns="http://www.xsens.com/mvn/mvnx"', ""),
            lambda text: text.replace("xmlns=", "xmlns:m=").replace("</", "</m:").replace("\n<", "\n<m:").replace("<m:/m:", "</m:")
            .replace("<pos_b", "<m:pos_b").replace("<?", "<?", 1),
            lambda text: "\ufeff" + text,
            lambda text: text.replace("\n", "\r\n"),
            lambda text: text.replace("\n", ""),
            lambda text: text.replace("<mvn ", "<!-- <!DOCTYPE mvnx SYSTEM 'schema.dtd'> <mvnx version=\"2\"> --><mvn "),
            lambda text: text.replace("<mvnx", '<!DOCTYPE mvnx SYSTEM "http://www.xsens.com/mvn/mvnx/schema.dtd">\n<mvnx'),
            lambda text: text.replace("<orientation>1.000000 ", "<orientation>1.0<!-- x -->00000 "),
            lambda text: text.replace("<orientation>1.000000 ", "<orientation><![CDATA[1.00000]]>0 "),
            lambda text: text.replace("<orientation>1.000000 ", "<orientation>\n  1.000&#48;00\t"),
            lambda text: text.replace("0.000000 ", "0.0 ").replace("1.000000 ", "1e0 "),
            lambda text: text.replace("</mvnx>", "</mvnx>\n<!-- end -->\n"),
            lambda text: text.replace("<frames>", "<frames>\n<!-- <frame type='normal'> -->"),
            lambda text: text.replace('version="4"', 'version="4.0"'),
        ],
        ids=["no namespace", "prefixes", "byte order mark", "CRLF", "one line", "comment with doctype", "doctype", "comment in numbers",
             "CDATA", "character reference", "other decimals", "comment at the end", "comment in frames", "version 4.0"],
    )  # fmt: skip
    def test_other_spellings(self, moving: HumanMotion, change: Callable[[str], str]) -> None:
        text = mvnx(moving)
        assert change(text) != text
        motion = read(change(text))
        np.testing.assert_array_equal(motion.orientation, read(text).orientation)
        np.testing.assert_array_equal(motion.position, read(text).position)
        assert len(motion.joint_offsets) == 22

    @pytest.mark.parametrize("encoding", ["utf-16", "latin-1", "us-ascii"])
    def test_encodings(self, moving: HumanMotion, encoding: str) -> None:
        text = mvnx(moving).replace("UTF-8", encoding)
        np.testing.assert_array_equal(read(text.encode(encoding)).orientation, read(mvnx(moving)).orientation)

    def test_nested_elements_are_not_fields(self, moving: HumanMotion) -> None:
        strange = "<note><orientation>1 2 3</orientation><frame type='normal' index='0'/></note>"
        text = mvnx(moving, extra=lambda _: strange).replace("<frames>", f"<frames><note>{strange}</note>")
        np.testing.assert_array_equal(read(text).orientation, read(mvnx(moving)).orientation)


class TestFields:
    """Any subset of optional fields; newer ones are skipped."""

    def test_orientation_alone_gives_positions_from_the_points(self, moving: HumanMotion) -> None:
        motion = read(mvnx(moving, fields=("orientation",)))
        assert motion.angular_velocity is None
        pelvis = moving.position[:, :1]
        np.testing.assert_allclose(motion.position, moving.position - pelvis, atol=1e-5)
        (warning,) = motion.source.warnings
        assert "no positions" in warning
        assert "the pelvis at the origin" in warning

    def test_orientation_alone_without_points_is_not_tracked(self, moving: HumanMotion) -> None:
        motion = read(mvnx(moving, fields=("orientation",), points=False))
        assert dict(motion.joint_offsets) == {}
        assert np.isnan(motion.position).all()
        assert motion.source.warnings == ("the file has no positions and no points to compute them from",)

    def test_no_angular_velocity(self, moving: HumanMotion) -> None:
        motion = read(mvnx(moving, fields=("orientation", "position")))
        assert motion.angular_velocity is None
        assert motion.source.warnings == ()

    def test_newer_fields_are_skipped(self, moving: HumanMotion) -> None:
        newer = """<orientationFingersLeft>1 0 0 0 words</orientationFingersLeft><centerOfMass>1 2 3 4 5 6 7 8 9</centerOfMass>
            <jointAngleErgoXZY>1 2 3</jointAngleErgoXZY><marker>start</marker><empty/>"""
        fingers = """<fingerTrackingSegmentsLeft><segment label="LeftCarpus" id="1"><points><point label="jWrist"><pos_b>x</pos_b>
            </point></points></segment></fingerTrackingSegmentsLeft><fingerTrackingJointsLeft><joint label="j"/></fingerTrackingJointsLeft>"""
        text = mvnx(moving, extra=lambda _: newer, header=fingers)
        np.testing.assert_array_equal(read(text).orientation, read(mvnx(moving)).orientation)
        assert read(text).segments == SEGMENTS
        fields = [
            "orientation",
            "position",
            "angularVelocity",
            "orientationFingersLeft",
            "centerOfMass",
            "jointAngleErgoXZY",
        ]
        assert facts(text)["fields"] == [*fields, "marker", "empty"]

    def test_props_are_left_out(self, moving: HumanMotion) -> None:
        text = mvnx(moving).replace("</segments>", '<segment label="Prop1" id="24"><points/></segment></segments>')
        text = text.replace("</orientation>", " 0 1 0 0</orientation>").replace("</position>", " 7 7 7</position>")
        motion = read(text.replace("</angularVelocity>", " 8 8 8</angularVelocity>"))
        assert motion.segments == SEGMENTS
        np.testing.assert_array_equal(motion.position, read(mvnx(moving)).position)
        np.testing.assert_array_equal(motion.orientation, read(mvnx(moving)).orientation)
        assert motion.source.warnings == ("props are left out",)

    def test_contacts_by_their_definition(self, moving: HumanMotion) -> None:
        rng = np.random.default_rng(4)
        contacts = rng.integers(0, 2, (40, 4))
        for order in ([0, 1, 2, 3], [2, 0, 3, 1]):
            text = mvnx(
                moving,
                header=contact_definition([CONTACTS[i] for i in order]),
                extra=lambda frame, order=order: (
                    f"<footContacts>{' '.join(str(contacts[frame, i]) for i in order)}</footContacts>"
                ),
            )
            motion = read(text)
            assert motion.foot_contacts is not None
            np.testing.assert_array_equal(motion.foot_contacts, contacts.astype(bool))
            assert facts(text)["foot_contacts"] is True

    @pytest.mark.parametrize(
        ("header", "extra", "subject", "warning"),
        [
            ("", "<footContacts>1 1 1 1</footContacts>", 'configuration="FullBody"', "no footContactDefinition"),
            (
                contact_definition(CONTACTS[:2]),
                "<footContacts>1 1</footContacts>",
                'configuration="FullBody"',
                "lacks one of",
            ),
            (
                contact_definition(),
                "<footContacts>1 nan 1 1</footContacts>",
                'configuration="FullBody"',
                "missing in some",
            ),
            (contact_definition(), "<footContacts>1 1 1 1</footContacts>", 'configuration="UpperBody"', None),
            (contact_definition(), "", 'configuration="FullBody"', None),
        ],
    )
    def test_contacts_that_mean_nothing(
        self, moving: HumanMotion, header: str, extra: str, subject: str, warning: str | None
    ) -> None:
        motion = read(mvnx(moving, header=header, extra=lambda _: extra, subject=subject))
        assert motion.foot_contacts is None
        assert [warning in text for text in motion.source.warnings if warning] == ([True] if warning else [])


def test_no_names_of_people(moving: HumanMotion) -> None:
    text = mvnx(moving)
    assert "Jane Doe" in text
    motion = read(text)
    assert "Jane" not in str(motion.source) + str(facts(text))


def test_arrays_are_shared_not_copied_and_read_only(moving: HumanMotion) -> None:
    motion = read(mvnx(moving))
    assert motion.angular_velocity is not None
    for array in (motion.orientation, motion.position, motion.angular_velocity):
        assert not array.flags.writeable
        assert array.base is not None  # the reader's own memory, seen as (T, S, k)


@pytest.mark.parametrize("name", ["a.mvnx", "A.MVNX", "a.b.mvnx.gz"])
def test_found_by_suffix(name: str, moving: HumanMotion, tmp_path: Any) -> None:
    data = mvnx(moving).encode()
    path = tmp_path / name
    path.write_bytes(gzip.compress(data) if name.endswith("gz") else data)
    assert formats.read_motion(path).frames == 40
    assert formats.describe(path)["format"] == "mvnx"


def test_found_by_content(moving: HumanMotion) -> None:
    for text in (mvnx(moving), "\ufeff" + mvnx(moving), mvnx(moving).partition("\n")[2]):
        assert formats.read_motion(io.BytesIO(text.encode())).frames == 40


def test_parents_of_the_tests_are_those_of_the_house() -> None:
    assert {child: parent for child, parent in PARENT.items() if parent} == PARENTS
    assert FORMAT.name == "mvnx"
