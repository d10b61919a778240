"""Bad MVNX: each is one clear line that names the file, the place, what was found and what was expected."""

from __future__ import annotations

import gzip
import io
import re
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from retarget.core.errors import FormatError, RetargetError
from retarget.core.types import HumanMotion
from retarget.formats._byte_chunks import CHUNK_BYTES
from retarget.formats.mvnx import describe, read_motion

from tests.formats.mvnx_documents import contact_definition, edit, mvnx

MotionFactory = Callable[..., HumanMotion]
ENTITIES = '<!DOCTYPE mvnx [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;">]>'


@pytest.fixture(scope="module")
def text(make_motion: MotionFactory) -> str:
    """Six frames in T-pose, with contacts."""
    motion = make_motion(np.arange(6) / 60, angular_velocity=np.zeros((6, 23, 3)))
    contacts = "<footContacts>1 1 1 1</footContacts>"
    return mvnx(motion, header=contact_definition(), extra=lambda _: contacts)


def error_of(data: str | bytes, name: str = "walk.mvnx") -> str:
    """The one line that reading and describing `data` both give."""
    data = data.encode() if isinstance(data, str) else data
    messages = []
    for read in (read_motion, describe):
        with pytest.raises(FormatError) as caught:
            read(io.BytesIO(data), name)
        messages.append(str(caught.value))
    assert messages[0] == messages[1]
    assert "\n" not in messages[0]
    assert messages[0].startswith(f"{name}")
    return messages[0]


def line_of(text: str, part: str, count: int = 1) -> int:
    """Line, from 1, of the `count`-th occurrence of `part`."""
    at = -1
    for _ in range(count):
        at = text.index(part, at + 1)
    return text.count("\n", 0, at) + 1


def replace_nth(text: str, old: str, new: str, nth: int) -> str:
    parts = text.split(old)
    return old.join(parts[:nth]) + new + old.join(parts[nth:])


FRAME_3 = 'index="3" tc="0"'

WHOLE: list[tuple[str, Callable[[str], str | bytes], str]] = [
    ("empty", lambda _: "", "walk.mvnx: empty file; expected an MVNX document"),
    ("white space", lambda _: " \n\n", "walk.mvnx, line 3: not XML (no element found); expected an MVNX document"),
    ("binary", lambda _: bytes(range(256)) * 8, "walk.mvnx, line 1: not XML (not well-formed (invalid token)); expected an MVNX document"),
    ("text", lambda _: "time,x,y\n0,1,2\n", "walk.mvnx, line 1: not XML (syntax error); expected an MVNX document"),
    ("wrong root", lambda text: text.replace("mvnx ", "bvh ", 1).replace("/mvnx>", "/bvh>"), "walk.mvnx, line 2: root element <bvh>; expected <mvnx>"),
    ("HTML", lambda _: "<html><body/></html>", "walk.mvnx, line 1: root element <html>; expected <mvnx>"),
    ("version 2", lambda text: text.replace('version="4"', 'version="2"'),
     "walk.mvnx, line 2: MVNX of version 2 (Moven); expected version 3 or 4; export again from MVN Studio 3 or later"),
    ("Moven", lambda _: '<mvnx><mvnxInfo frameRate="100"/><F v="1 2 3"/></mvnx>',
     "walk.mvnx, line 1: MVNX of version 2 (Moven); expected version 3 or 4; export again from MVN Studio 3 or later"),
    ("no subject", lambda _: '<mvnx version="4"><mvn version="1"/></mvnx>', "walk.mvnx: no <subject> with <frames>; expected an MVNX recording"),
    ("no frames", lambda text: re.sub(r"(?s)<frames>.*</frames>", "", text), "walk.mvnx: no <subject> with <frames>; expected an MVNX recording"),
    ("empty frames", lambda text: re.sub(r"(?s)<frames>.*</frames>", "<frames/>", text), "walk.mvnx: no frame of type 'normal'; expected a motion; found frames: none"),
    ("no normal frame", lambda text: text.replace('type="normal"', 'type="static"'),
     "walk.mvnx: no frame of type 'normal'; expected a motion; found frames: 1 identity, 1 tpose, 6 static"),
    ("frames of many types", lambda text: re.sub(r'(?s)<frames>.*</frames>', "<frames>" + "".join(f"<frame type='t&#10;{i}'/>" for i in range(9)) + "<frame/></frames>", text),
     "walk.mvnx: no frame of type 'normal'; expected a motion; found frames: 1 t 0, 1 t 1, 1 t 2, 1 t 3, 1 t 4, …"),
    ("no version, no reference", lambda text: re.sub(r"(?s)<frame time='0' type='identity'>.*?</frame>", "", text).replace(' version="4"', "", 1),
     "walk.mvnx: <mvnx> has no version; expected 3 or 4: they use different segment frames for the arms"),
    ("no rate", lambda text: text.replace('frameRate="60" ', ""), "walk.mvnx, line 5: <subject> has no frameRate; expected a number of Hz from 0.01 to 10000"),
    *((f"rate {rate}", lambda text, rate=rate: text.replace('frameRate="60"', f'frameRate="{rate}"'),
       f"walk.mvnx, line 5: frameRate '{rate}'; expected a number of Hz from 0.01 to 10000")
      for rate in ("0", "-60", "nan", "inf", "10001", "1e300", "1e-320", "sixty", "")),
    ("line break in a rate", lambda text: text.replace('frameRate="60"', 'frameRate="6&#10;0"'), "walk.mvnx, line 5: frameRate '6 0'; expected a number"),
    ("line break in a label", lambda text: text.replace('label="L5"', 'label="L&#10;5"'), "unknown segment 'L 5'; expected"),
    ("unknown segment", lambda text: text.replace('label="RightForeArm"', 'label="RightForearms"'),
     "unknown segment 'RightForearms'; expected RightForeArm or"),
    ("strange segment", lambda text: text.replace('label="Pelvis"', 'label="Xq"'), "unknown segment 'Xq'; expected one of Pelvis, L5,"),
    ("segment twice", lambda text: text.replace('label="L5"', 'label="Pelvis"'), "segment 'Pelvis' stands twice; expected each label once"),
    ("only props", lambda text: re.sub(r"(?s)<segments>.*</segments>", '<segments><segment label="Prop1"/></segments>', re.sub(r">(?:[-0-9. ]+)</(orientation|position|angularVelocity)>", lambda m: f">{'1 0 0 0'[: 7 if m[1] == 'orientation' else 5]}</{m[1]}>", text)),
     "walk.mvnx: only props among the segments; expected a person"),
    ("no segments", lambda text: re.sub(r"(?s)<segments>.*</segments>", "", text), "no <segment> before <frames>; expected the segments whose values the frames hold"),
    ("two people", lambda text: text.replace("<segments>", '</subject><subject frameRate="60"><segments>'), "a second <subject>; expected one person, one recording"),
    ("two takes", lambda text: text.replace("</frames>", "</frames><frames></frames>"), "a second <frames>; expected one person, one recording"),
    ("point of two numbers", lambda text: replace_nth(text, "<pos_b>0.000000 ", "<pos_b>", 1), "point 'jPelvis': 2 values; expected 3 coordinates in m"),
    ("point of words", lambda text: replace_nth(text, "<pos_b>0.000000 ", "<pos_b>here ", 1), "point 'jPelvis': 'here' is not a number; expected 3 coordinates in m"),
    ("point at infinity", lambda text: replace_nth(text, "<pos_b>0.000000 ", "<pos_b>inf ", 1), "point 'jPelvis': [inf  0.  0.] m; expected finite coordinates"),
    ("contact twice", lambda text: text.replace('index="2"/>', 'index="1"/>'), "contactDefinition 'RightFoot_Heel' with index '1'; expected each label and index once"),
    ("entities", lambda text: text.replace("<mvnx", f"{ENTITIES}<mvnx", 1), "walk.mvnx, line 2: entity 'a'; expected no entities: they are neither expanded nor fetched"),
    ("external entity", lambda text: text.replace("<mvnx", '<!DOCTYPE mvnx [<!ENTITY x SYSTEM "file:///etc/passwd">]><mvnx', 1), "entity 'x'"),
    ("parameter entity", lambda text: text.replace("<mvnx", '<!DOCTYPE mvnx [<!ENTITY % x SYSTEM "http://localhost/x">%x;]><mvnx', 1), "entity 'x'"),
    ("undefined entity", lambda text: text.replace("<orientation>1", "<orientation>&one;", 1), "undefined entity"),
    ("entity of a DTD that is not fetched", lambda text: text.replace("<mvnx", '<!DOCTYPE mvnx SYSTEM "http://localhost/x.dtd"><mvnx', 1).replace("<orientation>1", "<orientation>&one;", 1), "entity 'one'"),
    ("unknown encoding", lambda text: text.replace("UTF-8", "EBCDIC-9"), "walk.mvnx, line 1: unknown encoding"),
    ("wrong encoding", lambda text: text.replace("Jane", "J\xe4ne").encode("latin-1"), "walk.mvnx, line 4: broken XML (not well-formed (invalid token)) after 0 whole frames"),
    ("mismatched tag", lambda text: replace_nth(text, "</position>", "</positions>", 4), "broken XML (mismatched tag) after 3 whole frames; expected an MVNX document"),
    ("second root", lambda text: text + text.partition("\n")[2], "broken XML (junk after document element) after 6 whole frames"),
    ("nested field", lambda text: replace_nth(text, "</position>", "<x/></position>", 4), "frame 3: element <x> inside <position>; expected numbers only"),
    ("deep", lambda text: text.replace("<frames>", "<a>" * 200 + "</a>" * 200 + "<frames>"), "elements nested more than 100 deep"),
    ("deep in a frame", lambda text: text.replace("<position>", "<a>" * 200 + "</a>" * 200 + "<position>"), "elements nested more than 100 deep"),
]  # fmt: skip


@pytest.mark.parametrize(("change", "expected"), [case[1:] for case in WHOLE], ids=[case[0] for case in WHOLE])
def test_one_clear_line(text: str, change: Callable[[str], str | bytes], expected: str) -> None:
    changed = change(text)
    assert changed != text
    message = error_of(changed)
    assert message.startswith(expected) if expected.startswith("walk") else expected in message


@pytest.mark.parametrize(
    ("field", "width", "per", "found"),
    [("orientation", 92, "4 for each of 23 segments", 91), ("position", 69, "3 for each of 23 segments", 70),
     ("angularVelocity", 69, "3 for each of 23 segments", 0), ("footContacts", 4, "one a contactDefinition", 5)],
)  # fmt: skip
def test_wrong_counts_name_line_frame_found_and_expected(
    text: str, field: str, width: int, per: str, found: int
) -> None:
    changed = edit(text, field, lambda frame, words: (words * 2)[: found if frame == 3 else width])
    line = line_of(changed, f"<{field}>", (2 if field == "orientation" else 0) + 4)
    message = f"walk.mvnx, line {line}, frame 3: {found} values in <{field}>; expected {width} values, {per}"
    assert error_of(changed) == message


def test_counts_that_make_up_for_each_other(text: str) -> None:
    """One frame has a number too many and the next one too few."""
    moved = edit(
        text, "orientation", lambda frame, words: [*words, "0.5"] if frame == 2 else words[1:] if frame == 3 else words
    )
    assert "frame 2: 93 values in <orientation>" in error_of(moved)


@pytest.mark.parametrize("word", ["abc", "0.1abc", "1,5", "0x10", "1_0", "١", "--1", "1.2.3", "."])
@pytest.mark.parametrize("field", ["orientation", "position", "angularVelocity", "footContacts"])
def test_words_that_are_no_numbers(text: str, field: str, word: str) -> None:
    for at in (0, 2, -1):
        changed = edit(
            text,
            field,
            lambda frame, words, at=at: (
                [*words[:at], word, *words[len(words) + at + 1 if at < 0 else at + 1 :]] if frame == 4 else words
            ),
        )
        line = line_of(changed, f"<{field}>", (2 if field == "orientation" else 0) + 5)
        message = error_of(changed)
        assert message.startswith(f"walk.mvnx, line {line}, frame 4: '{word}' is not a number in <{field}>; expected")


def test_a_number_too_many_is_not_cut_off(text: str) -> None:
    assert "'x' is not a number" not in error_of(edit(text, "orientation", lambda _, words: [*words, "x"]))
    assert "93 values in <orientation>" in error_of(edit(text, "orientation", lambda _, words: [*words, "x"]))


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda text: re.sub(r"(index=\"3\".*\n)<orientation>.*\n", r"\1", text), "frame 3: no <orientation>; expected 92 values"),
        (lambda text: re.sub(r"(index=\"3\".*\n)(<orientation>.*\n)", r"\1\2\2", text), "frame 3: a second <orientation>; expected one"),
        (lambda text: re.sub(r"(type='identity'>\n)<orientation>.*\n", r"\1", text), "identity frame: no <orientation>; expected 92 values"),
        (lambda text: text.replace("<orientation>1.000000", "<orientation>", 1), "identity frame: 91 values in <orientation>; expected 92"),
        (lambda text: text.replace("'tpose'", "'identity'", 1), "a second frame of type 'identity'; expected one"),
        (lambda text: text.replace('index="3" tc', "tc"), "a frame without index; expected all frames with index, or none"),
        (lambda text: text.replace('index="0" tc', "tc"), "a frame with index; expected all frames with index, or none"),
        (lambda text: text.replace('index="3" tc', 'index="2" tc'), "frame index 2 after 2; expected increasing numbers"),
        (lambda text: text.replace('index="3" tc', 'index="1" tc'), "frame index 1 after 2; expected increasing numbers"),
        (lambda text: text.replace('index="3" tc', 'index="3.5" tc'), "frame index '3.5'; expected a whole number"),
        (lambda text: text.replace('index="3" tc', 'index="" tc'), "frame index ''; expected a whole number"),
        (lambda text: text.replace('index="5" tc', 'index="&#10;9999999999999" tc'), r"frame index '\n9999999999999'; expected at most 1e+12"),
        (lambda text: text.replace('index="5" tc', f'index="{"9" * 30}" tc'), "frame index '999999999999999999999999999999'; expected at most 1e+12"),
    ],
)  # fmt: skip
def test_frames(text: str, change: Callable[[str], str], expected: str) -> None:
    assert change(text) != text
    message = error_of(change(text))
    assert expected in message
    assert re.match(r"walk\.mvnx, line \d+", message)


@pytest.mark.parametrize(
    "cut", ["<position>", FRAME_3, "</orientation>", "<frames>", "<segments>", "</mvnx>", "</frames>"]
)
def test_truncated_names_line_and_whole_frames(text: str, cut: str) -> None:
    end = text.rindex(cut) if cut.startswith("</") else text.index(cut)
    part = text[:end]
    whole = max(part.count("</frame>") - 2, 0)  # two reference frames come first
    message = error_of(part)
    assert message == (
        f"walk.mvnx, line {part.count(chr(10)) + 1}: the document ends early, after {whole} whole frames; expected an MVNX document"
    )


def test_every_truncation_is_refused(text: str) -> None:
    data = text.rstrip().encode()
    for end in range(0, len(data), 97):
        error_of(data[:end])


class TestGzip:
    def test_truncated(self, text: str) -> None:
        packed = gzip.compress(text.encode())
        for end in (2, 9, 200, len(packed) // 2, len(packed) - 1):
            message = error_of(packed[:end], "walk.mvnx.gz")
            assert message == "walk.mvnx.gz: the gzip stream ends before its end mark; the file was cut off"

    def test_damaged(self, text: str) -> None:
        packed = bytearray(gzip.compress(text.encode()))
        packed[-5] ^= 255  # in the checksum
        assert error_of(bytes(packed), "walk.mvnx.gz").startswith("walk.mvnx.gz: damaged gzip stream (")

    def test_followed_by_something_else(self, text: str) -> None:
        message = error_of(gzip.compress(text.encode()) + b"rubbish", "walk.mvnx.gz")
        assert message == "walk.mvnx.gz: bytes that are not gzip follow the gzip stream"

    def test_of_nothing(self) -> None:
        assert "empty file" in error_of(gzip.compress(b""), "walk.mvnx.gz")


@pytest.mark.parametrize(
    "long",
    [b"<comment>" + b"<!--" + b"x" * (40 << 20) + b"--></comment>", b"<x a='" + b"y" * (40 << 20) + b"'/>"],
    ids=["comment", "attribute"],
)
def test_endless_tokens_are_refused(text: str, long: bytes) -> None:
    before, after = text.encode().split(b"<segments>")
    assert "longer than 16 MB" in error_of(before + long + b"<segments>" + after)


def test_endless_fields_are_refused(text: str) -> None:
    before, _, after = text.encode().partition(b"<position>")
    for filler in (b"0 " * (20 << 20), b"0\n" * (20 << 20)):
        assert "longer than 16 MB" in error_of(before + b"<position>" + filler + after)


def test_errors_behind_the_first_chunk_have_the_right_line(make_motion: MotionFactory) -> None:
    long = mvnx(make_motion(np.arange(3000) / 60))
    assert len(long) > 2 * CHUNK_BYTES
    for frame in (2, 700, 1499, 2999):
        changed = edit(long, "position", lambda at, words, frame=frame: words[1:] if at == frame else words)
        line = line_of(changed, f'index="{frame}" tc') + 2
        with pytest.raises(
            FormatError, match=rf"^walk, line {line}, frame {frame}: 68 values in <position>; expected 69"
        ):
            read_motion(io.BytesIO(changed.encode()), "walk")


class TestMissingValues:
    """NaN, infinities and quaternions of no unit length: interpolated over at most 0.25 s, refused beyond."""

    @pytest.fixture
    def moving(self, make_motion: MotionFactory) -> HumanMotion:
        """Three seconds at 60 Hz: the pelvis turns at 30°/s and walks at 1 m/s."""
        time = np.arange(180) / 60
        half = np.radians(30 * time) / 2
        yaw = np.stack([np.cos(half), 0 * half, 0 * half, np.sin(half)], axis=1)
        spin = np.tile([0, 0, np.radians(30)], (180, 23, 1))
        return make_motion(
            time, {"Pelvis": yaw}, pelvis=np.stack([time, 0 * time, 0 * time + 1], axis=1), angular_velocity=spin
        )

    @pytest.mark.parametrize("spoilt", ["nan", "-nan", "NaN", "inf", "-1.#IND00", "1.#QNAN0", "nan(ind)", "1e400"])
    @pytest.mark.parametrize("field", ["orientation", "position", "angularVelocity"])
    def test_short_gaps_are_interpolated_and_counted(self, moving: HumanMotion, field: str, spoilt: str) -> None:
        text = edit(mvnx(moving), field, lambda at, words: [spoilt, *words[1:]] if 50 <= at < 64 else words)
        motion = read_motion(io.BytesIO(text.encode()), "walk")
        assert motion.source.interpolated_frames == 14
        assert motion.source.warnings == ("missing values of 14 frames were interpolated",)
        # A steady turn and a straight walk: interpolation finds what was there.
        np.testing.assert_allclose(motion.orientation, moving.orientation, atol=2e-6)
        np.testing.assert_allclose(motion.position, moving.position, atol=2e-6)
        np.testing.assert_allclose(motion.angular_velocity, moving.angular_velocity, atol=2e-6)
        (gap,) = describe(io.BytesIO(text.encode()), "walk")["gaps"]
        assert gap == {
            "kind": "missing values",
            "field": field,
            "segments": ["Pelvis"],
            "start_s": pytest.approx(49 / 60),
            "duration_s": pytest.approx(15 / 60),
            "frames": 14,
        }

    @pytest.mark.parametrize("field", ["orientation", "position", "angularVelocity"])
    @pytest.mark.parametrize("frames", [15, 130])
    def test_long_gaps_are_refused(self, moving: HumanMotion, field: str, frames: int) -> None:
        text = edit(mvnx(moving), field, lambda at, words: ["nan", *words[1:]] if 50 <= at < 50 + frames else words)
        seconds = f"{(frames + 1) / 60:.3g}" if frames == 15 else f"{129 / 60 + 1 / 60:.3g}"
        with pytest.raises(
            FormatError,
            match=rf"^walk: <{field}> of Pelvis: values missing for {seconds} s from 0.817 s on; gaps up to 0.25 s",
        ):
            read_motion(io.BytesIO(text.encode()), "walk")
        facts = describe(io.BytesIO(text.encode()), "walk")
        assert facts["gaps"][0]["frames"] == frames
        assert facts["warnings"] == ["values are missing for longer than 0.25 s: it can't be converted"]

    def test_gaps_are_those_of_each_segment(self, moving: HumanMotion) -> None:
        """Two segments that are missing one after the other for 0.2 s each, not one gap of 0.4 s."""

        def spoil(at: int, words: list[str]) -> list[str]:
            return ["nan", *words[1:]] if 50 <= at < 62 else [*words[:4], "nan", *words[5:]] if 62 <= at < 74 else words

        text = edit(mvnx(moving), "orientation", spoil)
        assert read_motion(io.BytesIO(text.encode()), "walk").source.interpolated_frames == 24
        facts = describe(io.BytesIO(text.encode()), "walk")
        assert [(gap["segments"], gap["frames"]) for gap in facts["gaps"]] == [(["Pelvis"], 12), (["L5"], 12)]
        assert facts["warnings"] == []

    def test_nothing_but_nan(self, moving: HumanMotion) -> None:
        text = edit(mvnx(moving), "orientation", lambda _, words: ["nan", *words[1:]])
        with pytest.raises(FormatError, match=r"^walk: <orientation> of Pelvis: no frame holds finite values$"):
            read_motion(io.BytesIO(text.encode()), "walk")

    @pytest.mark.parametrize("factor", [0.0, 0.5, 0.98, 1.02, 3.0, 1e200])
    def test_quaternions_of_no_unit_length_are_missing_not_normalised(self, moving: HumanMotion, factor: float) -> None:
        def spoil(at: int, words: list[str]) -> list[str]:
            # Besides its length, the quaternion is turned somewhere else: normalising it would show.
            return [repr(factor * v) for v in (0.5, 0.5, 0.5, 0.5)] + words[4:] if at in (70, 71) else words

        motion = read_motion(io.BytesIO(edit(mvnx(moving), "orientation", spoil).encode()), "walk")
        assert motion.source.interpolated_frames == 2
        np.testing.assert_allclose(motion.orientation, moving.orientation, atol=2e-6)

    @pytest.mark.parametrize("factor", [0.991, 1.009])
    def test_rounded_quaternions_are_normalised(self, moving: HumanMotion, factor: float) -> None:
        text = edit(mvnx(moving), "orientation", lambda _, words: [f"{factor * float(word):.6f}" for word in words])
        motion = read_motion(io.BytesIO(text.encode()), "walk")
        assert motion.source.interpolated_frames == 0
        np.testing.assert_allclose(motion.orientation, moving.orientation, atol=3e-6)

    def test_a_frame_without_an_optional_field(self, moving: HumanMotion) -> None:
        for field in ("position", "angularVelocity"):
            text = re.sub(rf'(index="7[0-3]" tc(?:.*\n)*?)<{field}>.*\n', r"\1", mvnx(moving))
            motion = read_motion(io.BytesIO(text.encode()), "walk")
            assert motion.source.interpolated_frames == 4
            np.testing.assert_allclose(motion.position[:, 0], moving.position[:, 0], atol=2e-6)
            # Hands move on arcs, of which interpolation takes the chord: (0.9 m)·(30°/s · 5/60 s)²/8.
            np.testing.assert_allclose(motion.position, moving.position, atol=2.2e-4)

    def test_gaps_count_by_the_clock(self, moving: HumanMotion) -> None:
        """Two missing frames are a short gap, unless frames were dropped between them, too."""
        index = [i + 30 * (i > 70) for i in range(180)]
        text = edit(
            mvnx(moving, index=index), "orientation", lambda at, words: ["nan", *words[1:]] if at in (70, 71) else words
        )
        with pytest.raises(FormatError, match=r"values missing for 0.55 s"):
            read_motion(io.BytesIO(text.encode()), "walk")


ALPHABET = [b"<", b">", b"&", b"'", b'"', b"/", b" ", b"\n", b"\0", b"\xff", b"-", b".", b"nan", b"1e999", b"<frame>", b"</frame>",
            b"<!--", b"]]>", b"<![CDATA[", b"<?x?>", b"&#0;", b"&#10;", b"&lt;", b"<frames>", b"</frames>", b"type='normal'", b"index='-1'", b"\xc3\xa9"]  # fmt: skip


def assert_motion_or_one_line(content: bytes) -> None:
    message, motion = "", None
    try:
        motion = read_motion(io.BytesIO(content), "walk")
    except RetargetError as error:
        message = str(error)
    if motion is None:
        assert message.startswith("walk")
        assert "\n" not in message
    else:
        assert motion.frames > 0
        assert np.isfinite(motion.orientation).all()


@settings(max_examples=600, deadline=None)
@given(data=st.data())
def test_mutated_bytes_give_a_motion_or_one_line(text: str, data: st.DataObject) -> None:
    raw = bytearray(text.encode())
    for _ in range(data.draw(st.integers(1, 4))):
        start = data.draw(st.integers(0, len(raw)))
        stop = start + data.draw(st.sampled_from([0, 1, 1, 2, 7, 40]))
        raw[start:stop] = data.draw(st.sampled_from(ALPHABET) | st.binary(max_size=6))
    packed = data.draw(st.booleans())
    content = gzip.compress(bytes(raw), 1) if packed else bytes(raw)
    assert_motion_or_one_line(content)


@settings(max_examples=150, deadline=None)
@given(at=st.floats(0, 1, exclude_max=True), value=st.integers(1, 255), cut=st.booleans())
def test_damaged_gzip_gives_a_motion_or_one_line(text: str, at: float, value: int, cut: bool) -> None:
    packed = bytearray(gzip.compress(text.encode()))
    place = int(at * len(packed))
    packed[place] ^= value
    assert_motion_or_one_line(bytes(packed[: place + 1] if cut else packed))
