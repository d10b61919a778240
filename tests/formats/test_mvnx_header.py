"""What MVNX headers and reference frames say of the person: what was measured, in which frames, at which times."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from retarget.core import rotations
from retarget.core.segments import LOWER_BODY, SEGMENTS
from retarget.core.types import HumanMotion

from tests.formats.mvnx_documents import (
    IDENTITY,
    about,
    angle_deg,
    edit,
    facts,
    mvnx,
    read,
)

MotionFactory = Callable[..., HumanMotion]
HANDS = {"LeftHand", "RightHand"}
ARMS = {f"{side}{bone}" for side in ("Left", "Right") for bone in ("Shoulder", "UpperArm", "ForeArm")}


class TestMeasured:
    """Which segments count, by the suit's configuration or its sensors."""

    @pytest.mark.parametrize(
        ("configuration", "lost"),
        [
            ("FullBody", set()),
            ("UpperBody", set(LOWER_BODY)),
            ("upper body, no hands", set(LOWER_BODY) | HANDS),
            ("FullBodyNoHands", HANDS),
            ("LowerBody", set(SEGMENTS) - LOWER_BODY - {"Pelvis"}),
            ("LowerBodyPlus", ARMS | HANDS | {"Neck", "Head"}),
        ],
    )
    def test_configuration(self, moving: HumanMotion, configuration: str, lost: set[str]) -> None:
        text = mvnx(moving, subject=f'configuration="{configuration}"')
        assert set(read(text).unmeasured_segments) == lost
        assert set(facts(text)["unmeasured_segments"]) == lost
        assert read(text).source.configuration == configuration

    @pytest.mark.parametrize(
        ("sensors", "lost"),
        [
            (SEGMENTS, set()),
            (["Pelvis", "T8", "Head", "RightUpperArm", "RightHand", "LeftHand"], set(LOWER_BODY)),
            (["Pelvis", "T8", "RightFoot"], ARMS | HANDS | {"Neck", "Head"}),
            (["Sensor 1", "Sensor 2"], set()),
            ([], set()),
        ],
    )
    def test_sensors_where_no_configuration_is_stated(
        self, moving: HumanMotion, sensors: list[str], lost: set[str]
    ) -> None:
        header = "<sensors>" + "".join(f'<sensor label="{sensor}"/>' for sensor in sensors) + "</sensors>"
        assert set(read(mvnx(moving, subject="", header=header)).unmeasured_segments) == lost

    def test_unknown_configuration_is_warned_of(self, moving: HumanMotion) -> None:
        motion = read(mvnx(moving, subject='configuration="TailOnly"'))
        assert motion.measured.all()
        assert any("TailOnly" in warning for warning in motion.source.warnings)

    def test_unmeasured_segments_may_be_missing(self, moving: HumanMotion) -> None:
        text = mvnx(moving, subject='configuration="UpperBody"')
        text = edit(text, "orientation", lambda _, words: words[:-16] + ["0.000000"] * 16)
        text = edit(text, "position", lambda _, words: words[:-12] + ["nan"] * 12)
        text = edit(text, "angularVelocity", lambda _, words: words[:-12] + ["nan"] * 12)
        assert facts(text)["warnings"] == []  # it can be converted
        motion = read(text)
        left_leg = [motion.index(f"Left{part}") for part in ("UpperLeg", "LowerLeg", "Foot", "Toe")]
        np.testing.assert_array_equal(motion.orientation[:, left_leg], np.broadcast_to([1.0, 0, 0, 0], (40, 4, 4)))
        assert np.isnan(motion.position[:, left_leg]).all()
        assert np.isfinite(motion.position[:, : left_leg[0]]).all()
        assert sum("LeftFoot, which was not measured, is missing" in warning for warning in motion.source.warnings) == 3


class TestReferenceFrame:
    """What the file's segment frames are when its reference frame is missing or unusable."""

    @pytest.mark.parametrize(("version", "kind"), [("3", "npose"), ("4", "identity")])
    def test_known_constants_with_a_warning(self, moving: HumanMotion, version: str, kind: str) -> None:
        motion = read(mvnx(moving, version=version, reference=False))
        assert angle_deg(motion.orientation, moving.orientation) < 3e-4
        assert motion.source.warnings == (
            f"no '{kind}' frame: segment frames are taken to be those of version {version}",
        )
        assert facts(mvnx(moving, version=version, reference=False))["segment_frames"] == f"version {version}"

    @pytest.mark.parametrize("spoilt", ["nan", "0.0", "5.0"])
    def test_unusable(self, moving: HumanMotion, spoilt: str) -> None:
        text = mvnx(moving, version="3").replace("<orientation>1.000000", f"<orientation>{spoilt}", 1)
        motion = read(text)
        assert angle_deg(motion.orientation, moving.orientation) < 3e-4
        assert "unusable 'npose' frame" in motion.source.warnings[0]

    def test_any_reference_is_taken_out(self, moving: HumanMotion) -> None:
        """R = R_file · R_refᵀ, whatever the constant offset is."""
        constant = about("xyz", [20, 30, 40])
        text = mvnx(moving)
        before, after = text.split('type="normal"', 1)
        before = before.replace(IDENTITY, " ".join(f"{v:.6f}" for v in constant))
        motion = read(f'{before}type="normal"{after}')
        expected = rotations.multiply(moving.orientation, rotations.conjugate(constant))
        assert angle_deg(motion.orientation, expected) < 3e-4

    @pytest.mark.parametrize("version", ["3", "4"])
    def test_no_version_stated(self, moving: HumanMotion, version: str) -> None:
        motion = read(mvnx(moving, version=version).replace(f' version="{version}"', "", 1))
        assert angle_deg(motion.orientation, moving.orientation) < 3e-4
        assert f"read as version {version}" in motion.source.warnings[0]

    def test_newer_version(self, moving: HumanMotion) -> None:
        motion = read(mvnx(moving).replace('version="4"', 'version="5"', 1))
        assert angle_deg(motion.orientation, moving.orientation) < 3e-4
        assert motion.source.warnings == ("version 5 is newer than any known: read as version 4",)

    def test_frames_that_do_not_fit_are_warned_of(self, moving: HumanMotion) -> None:
        """Version 3 written with the frames of version 4: the elbows are far from the joints."""
        text = mvnx(moving, version="4", reference=False).replace('version="4"', 'version="3"', 1)
        (_, warning) = read(text).source.warnings
        assert "ForeArm is 424 mm away from its joint" in warning  # 0.30 m · √2


class TestTime:
    def test_time_is_index_by_rate(self, moving: HumanMotion) -> None:
        index = [100 + i for i in range(40)]
        motion = read(mvnx(moving, index=index, rate="240"))
        np.testing.assert_array_equal(motion.time, np.array(index) / 240)
        assert motion.source.rate_hz == 240
        assert motion.source.warnings == ()

    def test_fractional_rate(self, moving: HumanMotion) -> None:
        assert read(mvnx(moving, rate="59.94")).time[30] == 30 / 59.94

    def test_dropped_frames_keep_the_clock(self, moving: HumanMotion) -> None:
        index = [i + 3 * (i >= 10) + 60 * (i >= 30) for i in range(40)]
        text = mvnx(moving, index=index)
        motion = read(text)
        np.testing.assert_array_equal(motion.time, np.array(index) / 60)
        assert motion.source.warnings == ("dropped frames: 63, gaps: 2, the longest 1.02 s",)
        first, second = facts(text)["gaps"]
        assert first == {"kind": "dropped frames", "start_s": 9 / 60, "duration_s": pytest.approx(4 / 60), "frames": 3}
        assert (second["start_s"], second["frames"]) == (pytest.approx(32 / 60), 60)

    def test_every_fourth_frame(self, moving: HumanMotion) -> None:
        motion = read(mvnx(moving, index=list(range(0, 160, 4)), rate="240"))
        np.testing.assert_allclose(motion.time, np.arange(40) / 60, rtol=0, atol=1e-15)
        assert motion.source.rate_hz == 60
        assert motion.source.warnings == ("every frame's index is 4 more than the one before: the rate is 60 Hz",)

    def test_every_fourth_frame_with_some_dropped(self, moving: HumanMotion) -> None:
        index = [4 * (i + (i >= 20)) for i in range(40)]
        motion = read(mvnx(moving, index=index, rate="240"))
        np.testing.assert_array_equal(motion.time, np.array(index) / 240)
        assert motion.source.rate_hz == 60
        assert motion.source.warnings[1] == "dropped frames: 1, gaps: 1, the longest 0.0333 s"

    def test_no_index_at_all(self, moving: HumanMotion) -> None:
        text = mvnx(moving)
        for i in range(40):
            text = text.replace(f' index="{i}" tc', " tc", 1)
        motion = read(text)
        np.testing.assert_array_equal(motion.time, np.arange(40) / 60)
        assert motion.source.warnings == ("frames have no index: times are counted",)

    def test_a_single_frame(self, make_motion: MotionFactory) -> None:
        motion = read(mvnx(make_motion([0.0])))
        assert (motion.frames, motion.rate_hz) == (1, 60)
