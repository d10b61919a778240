"""MVNX read in parts as it arrives: joined, it is what is read at once, whatever the pieces that it comes in."""

from __future__ import annotations

import gzip
import io
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO, cast

import numpy as np
import pytest
from retarget import formats, samples
from retarget.core.errors import FormatError
from retarget.core.timebase import joined
from retarget.core.types import HumanMotion
from retarget.formats import mvnx as mvnx_format
from retarget.formats.mvnx import PART_FRAMES, read_motion, stream_motion

from tests.formats.mvnx_documents import CONTACTS, contact_definition, edit, mvnx
from tests.formats.mvnx_oracles import FULL_BODY_V3, UPPER_BODY_V4

MotionFactory = Callable[..., HumanMotion]
ARRAYS = ("time", "orientation", "position", "angular_velocity", "foot_contacts", "measured")
NAMES = ("walk", "walk_v3", "squat", "reach", "yaw_090")


class Pieces(io.RawIOBase):
    """A pipe that gives at most so many bytes at a time."""

    def __init__(self, data: bytes, size: int) -> None:
        self._data, self._size = io.BytesIO(data), size

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        block = self._data.read(min(len(buffer), self._size))
        buffer[: len(block)] = block
        return len(block)


def pipe(data: bytes, size: int = 65536) -> BinaryIO:
    return io.BufferedReader(Pieces(data, size))


def in_parts(data: bytes | str, first_s: float = 0.5, size: int = 65536) -> list[HumanMotion]:
    data = data if isinstance(data, bytes) else data.encode()
    return list(stream_motion(pipe(data, size), "clip", first_s))


def assert_same(parts: list[HumanMotion], whole: HumanMotion) -> None:
    found = joined(parts)
    for name in ARRAYS:
        values, expected = getattr(found, name), getattr(whole, name)
        assert (values is None) == (expected is None), name
        if expected is not None:
            np.testing.assert_array_equal(values, expected, err_msg=name)
    assert found.segments == whole.segments
    assert found.source == whole.source


@pytest.mark.parametrize("first_s", [0.5, 6.0, 60.0])
@pytest.mark.parametrize("name", NAMES)
def test_samples(name: str, first_s: float) -> None:
    data = samples.sample_path(name).read_bytes()
    whole = read_motion(io.BytesIO(data), "clip")
    parts = in_parts(data, first_s)
    assert len(parts) == (
        1 if whole.time[-1] <= first_s else 2 + (whole.frames - round(60 * first_s) - 16) // PART_FRAMES
    )
    assert_same(parts, whole)
    if len(parts) > 1:
        assert parts[0].time[-1] == pytest.approx(first_s)
        assert all(part.source.sha256 == "" for part in parts[:-1])


@pytest.mark.parametrize("path", [UPPER_BODY_V4, FULL_BODY_V3], ids=lambda path: path.stem)
def test_real_recordings(path: Path) -> None:
    if not path.is_file():
        pytest.skip("the real recordings (../shared/data) are not on this machine")
    data = path.read_bytes()
    assert_same(in_parts(data, 0.005), read_motion(io.BytesIO(data), "clip"))


@pytest.mark.parametrize("size", [97, 4096, 1 << 20])
def test_parts_do_not_depend_on_the_pieces(size: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mvnx_format, "PART_FRAMES", 50)
    data = samples.sample_path("yaw_000").read_bytes()
    parts = in_parts(data, 1.0, size)
    assert [part.frames for part in parts] == [61, 50, 50, 50, 50, 40]
    assert_same(parts, read_motion(io.BytesIO(data), "clip"))


def test_a_part_is_there_before_the_next_arrives() -> None:
    """A stream that would block for ever behind the first second and a bit."""
    text = gzip.decompress(samples.sample_path("walk").read_bytes())
    cut = text.index(b'index="90"')

    def blocks() -> Iterator[bytes]:
        yield text[:cut]
        raise AssertionError("asked for more than was needed")

    class Live:
        def __init__(self) -> None:
            self._blocks = blocks()

        def read1(self, _size: int) -> bytes:
            return next(self._blocks)

        read = read1

    parts = stream_motion(cast(BinaryIO, Live()), "clip", 1.0)
    assert next(parts).frames == 61


class TestGaps:
    """Two seconds at 60 Hz; parts of 20 frames, the first of 31."""

    @pytest.fixture(autouse=True)
    def small_parts(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(mvnx_format, "PART_FRAMES", 20)

    @pytest.fixture
    def text(self, make_motion: MotionFactory) -> str:
        rng = np.random.default_rng(5)
        motion = make_motion(np.arange(120) / 60, angular_velocity=rng.normal(size=(120, 23, 3)))
        contacts = rng.integers(0, 2, (120, 4))

        def extra(frame: int) -> str:
            return f"<footContacts>{' '.join(map(str, contacts[frame]))}</footContacts>"

        return mvnx(motion, header=contact_definition(CONTACTS), extra=extra)

    @staticmethod
    def lost(text: str, field: str, first: int, stop: int) -> str:
        """`field` with its last segment's numbers missing in frames `first` to `stop` - 1."""
        width = {"orientation": 4, "position": 3, "angularVelocity": 3}[field]

        def change(frame: int, words: list[str]) -> list[str]:
            return [*words[:-width], *["NaN"] * width] if first <= frame < stop else words

        return edit(text, field, change)

    @pytest.mark.parametrize("first", range(18, 60, 3))
    @pytest.mark.parametrize("field", ["orientation", "position", "angularVelocity"])
    def test_short_gaps_over_the_borders(self, text: str, field: str, first: int) -> None:
        changed = self.lost(text, field, first, first + 13)
        whole = read_motion(io.BytesIO(changed.encode()), "clip")
        assert whole.source.interpolated_frames == 13
        assert_same(in_parts(changed), whole)

    @pytest.mark.parametrize(("first", "stop"), [(0, 13), (107, 120)])
    def test_short_gaps_at_the_ends(self, text: str, first: int, stop: int) -> None:
        changed = self.lost(text, "position", first, stop)
        assert_same(in_parts(changed), read_motion(io.BytesIO(changed.encode()), "clip"))

    @pytest.mark.parametrize("first", [0, 20, 31, 50, 98])
    def test_long_gaps(self, text: str, first: int) -> None:
        changed = self.lost(text, "position", first, first + 22)
        with pytest.raises(FormatError, match=r"^clip: <position> of LeftToe: values missing for 0\.\d+ s from"):
            read_motion(io.BytesIO(changed.encode()), "clip")
        with pytest.raises(FormatError, match=r"^clip: <position> of LeftToe: values missing for 0\.\d+ s from"):
            in_parts(changed)

    def test_dropped_frames_are_told_at_the_end(self, make_motion: MotionFactory) -> None:
        index = [*range(40), *range(50, 130)]
        text = mvnx(make_motion(np.arange(120) / 60), index=index)
        whole = read_motion(io.BytesIO(text.encode()), "clip")
        assert whole.source.warnings == ("dropped frames: 10, gaps: 1, the longest 0.183 s",)
        assert_same(in_parts(text), whole)

    def test_contacts_that_end_hold(self, text: str) -> None:
        def change(frame: int, words: list[str]) -> list[str]:
            return ["NaN"] * 4 if frame in (60, 61, 62, 99) else words

        parts = in_parts(edit(text, "footContacts", change))
        contacts, given = joined(parts).foot_contacts, read_motion(io.BytesIO(text.encode()), "clip").foot_contacts
        assert contacts is not None
        assert given is not None
        expected = given.copy()
        expected[60:63], expected[99] = given[59], given[98]
        np.testing.assert_array_equal(contacts, expected)
        assert parts[-1].source.warnings == ("foot contacts are missing in some frames: the last ones before hold",)

    def test_contacts_that_lack_at_once_are_not_used(self, text: str) -> None:
        changed = edit(text, "footContacts", lambda frame, words: ["NaN"] * 4 if frame == 3 else words)
        parts = in_parts(changed)
        assert all(part.foot_contacts is None for part in parts)
        assert parts[-1].source.warnings == ("foot contacts are missing in some frames: they are not used",)

    def test_what_was_not_measured_is_held(self, make_motion: MotionFactory) -> None:
        """Toes that nobody measured, and that are lost for good after a second."""
        motion = make_motion(np.arange(120) / 60)
        text = mvnx(motion, subject='configuration="UpperBody"')
        changed = self.lost(text, "position", 60, 120)
        parts = in_parts(changed)
        toe = joined(parts).position[:, motion.index("LeftToe")]
        assert np.isfinite(toe).all()
        np.testing.assert_array_equal(toe[80:], np.tile(toe[80], (40, 1)))
        assert parts[-1].source.warnings == ("<position> of LeftToe, which was not measured, is missing",)

    def test_a_field_that_begins_late(self, text: str) -> None:
        lines = text.split("\n")
        starts = [i for i, line in enumerate(lines) if line.startswith("<position>")][:70]
        late = "\n".join(line for i, line in enumerate(lines) if i not in set(starts))
        with pytest.raises(FormatError, match=r"^clip, frame \d+: <position> begins late; expected it in all frames"):
            in_parts(late, size=1000)

    def test_what_describes_the_person_behind_the_frames(self, make_motion: MotionFactory) -> None:
        """Sensors only on the upper body, which the document says at its end."""
        sensors = "".join(f'<sensor label="{name}"/>' for name in ("Pelvis", "T8", "Head", "LeftHand", "RightHand"))
        text = mvnx(make_motion(np.arange(120) / 60), subject="")
        late = text.replace("</frames>", f"</frames><sensors>{sensors}</sensors>")
        with pytest.raises(FormatError, match="what describes the person stands behind the frames"):
            in_parts(late)
        assert read_motion(io.BytesIO(late.encode()), "clip").unmeasured_segments


@pytest.mark.parametrize("part", [0.3, 0.7])
def test_a_document_that_ends_early(part: float) -> None:
    text = gzip.decompress(samples.sample_path("walk").read_bytes())
    parts = stream_motion(pipe(text[: int(part * len(text))]), "clip", 1.0)
    assert next(parts).frames == 61
    with pytest.raises(FormatError, match=r"^clip, line \d+: the document ends early, after \d+ whole frames"):
        list(parts)


def test_by_the_door_of_all_formats() -> None:
    path = samples.sample_path("walk")
    (whole,) = formats.stream_recording(path, 60.0)
    assert isinstance(whole, HumanMotion)
    parts = list(formats.stream_recording(pipe(path.read_bytes()), 2.0, "walk.mvnx.gz"))
    assert len(parts) == 4
    assert_same(cast(list[HumanMotion], parts), whole)
    # Trackers come as one: what they are on is known only when all is read.
    assert len(list(formats.stream_recording(samples.sample_path("box_trackers"), 1.0))) == 1
