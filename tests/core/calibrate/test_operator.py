"""A synthetic operator calibrated: exact without noise, in any heading and under any mount; and everything that must be refused."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from retarget import formats, samples
from retarget.core import rotations
from retarget.core.calibrate.operator import calibrate
from retarget.core.calibrate.roles import virtual_trackers
from retarget.core.calibration import Calibration
from retarget.core.errors import MotionError, UsageError
from retarget.core.types import HumanMotion, TrackerRecording
from scipy.spatial.transform import Rotation

from tests.core.calibrate.operators import ROLES, SERIAL, SIDES, Operator, arm_rotation, windows, wxyz

POSES = ("still", "tpose", "forward")
LEANS = {"tpose": (3.0, -4.0, 20.0), "forward": (0.0, 5.0, -12.0)}


def shoulder_errors(person: Operator, calibration: Calibration) -> list[float]:
    """Distance in m from each found shoulder, carried to the world, to the true one."""
    turn = Rotation.from_euler("z", calibration.heading_rad)
    return [
        float(
            np.linalg.norm(
                turn.apply(np.array(calibration.arms[side].shoulder))
                + calibration.origin
                - person.world(person.shoulder(side))
            )
        )
        for side in SIDES
    ]


@pytest.mark.parametrize("seed", range(25))
def test_without_noise_it_is_exact(seed: int) -> None:
    """Floor origin, any heading, build and mounts, the whole body leaning and turning between the poses."""
    person = Operator.random(seed, roles=(*ROLES, "Pelvis"))
    found = calibrate(person.record(lean_deg=LEANS, rate_hz=30), windows=windows(), hand_offset_m=person.offset)
    assert max(shoulder_errors(person, found)) < 1e-9
    assert np.cos(found.heading_rad - person.heading) == pytest.approx(1, abs=1e-12)
    assert found.origin == pytest.approx(person.tracker("Pelvis", "still")[0], abs=1e-9)
    for side in SIDES:
        assert found.arms[side].length_m == pytest.approx(person.arm_length, abs=1e-9)
        assert found.arms[side].angles_deg == pytest.approx((90, 90, 90), abs=1e-6)
    assert found.trackers == {name: SERIAL[name] for name in (*ROLES, "Pelvis")}
    for name in found.trackers:
        assert rotations.angle(found.tracker_rotation[name], wxyz(person.mount[name])) < 1e-7
        side = "Left" if name.startswith("Left") else "Right"
        still = arm_rotation(side, "still") if name.endswith(("Arm", "Hand")) else Rotation.identity()
        assert rotations.angle(found.still_orientation[name], wxyz(still)) < 1e-7
    assert found.chest_orientation == pytest.approx([1, 0, 0, 0], abs=1e-9)
    assert found.residuals["chest_turned_deg/tpose"] == pytest.approx(np.sqrt(3**2 + 4**2 + 20**2))
    assert found.warnings == ()
    assert dict(found.input_sha256) == dict.fromkeys(POSES, "0" * 64)


def test_with_noise_the_shoulders_stay_close() -> None:
    """5 mm on every sample and axis, half a degree on every orientation, 40 operators: far inside 15 mm."""
    errors = []
    for seed in range(40):
        person = Operator.random(seed)
        recording = person.record(noise_m=0.005, noise_deg=0.5, lean_deg=LEANS, seed=seed)
        errors += shoulder_errors(person, calibrate(recording, windows=windows(), hand_offset_m=person.offset))
    assert np.max(errors) < 0.004
    assert np.median(errors) < 0.002


@pytest.mark.parametrize("named", [True, False], ids=["roles", "no roles"])
@pytest.mark.parametrize("seed", range(12))
def test_poses_and_trackers_found_by_themselves(seed: int, named: bool) -> None:
    """The poses in any order, one of them twice, elbows bent in between; the trackers' roles known or not."""
    order = list(itertools.permutations(POSES))[seed % 6]
    person = Operator.random(seed, hand_offset=dict.fromkeys(SIDES, (0.0, 0.0, 0.0)))
    recording = person.record((*order, order[0]), noise_m=0.003, lean_deg=LEANS, named=named, seed=seed)
    found = calibrate(recording, hand_offset_m=(0, 0, 0))
    assert dict(found.trackers) == {name: SERIAL[name] for name in ROLES}
    assert max(shoulder_errors(person, found)) < 0.005
    assert ("assignment_margin_m/Head" in found.residuals) is not named
    held = windows((*order, "again"))
    for pose in POSES:
        start, end = found.windows_s[pose]
        stretches = [held[pose], *([held["again"]] if pose == order[0] else [])]
        assert any(first - 0.15 < start < end < last + 0.15 for first, last in stretches)


def test_three_recordings_each_with_a_pose_of_its_own() -> None:
    person = Operator.random(5)
    by_pose = {pose: person.record((pose,), hold_s=2.0, lean_deg=LEANS) for pose in POSES}
    found = calibrate(by_pose, hand_offset_m=person.offset)
    assert max(shoulder_errors(person, found)) < 1e-9
    # Arms hang before they go out and up: the stretch that fits is taken, not the longest.
    with_more = {
        **by_pose,
        "tpose": person.record(("still", "tpose"), hold_s=1.0, lean_deg=LEANS),
        "forward": person.record(("still", "forward", "still"), hold_s=2.0, lean_deg=LEANS),
    }
    for named in (True, False):
        unnamed = {pose: r if named else replace(r, segments={}) for pose, r in with_more.items()}
        found = calibrate(unnamed, hand_offset_m=person.offset)
        assert max(shoulder_errors(person, found)) < 1e-9
        assert found.windows_s["tpose"][0] > 2.0
        assert 3.0 < found.windows_s["forward"][0] < found.windows_s["forward"][1] < 5.0
    given = calibrate(by_pose, windows={"tpose": (0.2, 0.4)}, hand_offset_m=person.offset)
    assert given.windows_s["tpose"] == (0.2, 0.4)
    fewer = {**by_pose, "tpose": replace(by_pose["tpose"], trackers=("A", "B", "C", "D", "E", "F"), segments={})}
    with pytest.raises(MotionError, match="T-pose: found trackers A, B, C, D, E, F, expected those of the Still pose"):
        calibrate(fewer)


def test_the_hand_offset_in_the_hands_own_axes_fits_any_mount() -> None:
    ahead, outward, up = 0.01, 0.07, -0.02
    for seed in range(5):
        person = Operator.random(seed)
        person.hand_offset = {
            side: person.mount[f"{side}Hand"].apply([ahead, outward if side == "Left" else -outward, up])
            for side in SIDES
        }
        found = calibrate(
            person.record(rate_hz=30), windows=windows(), hand_offset_m=(ahead, outward, up), hand_offset_frame="hand"
        )
        # The offset turns with a facing direction from the trackers alone: exact here, as both hands are mirror images.
        assert max(shoulder_errors(person, found)) < 1e-9
        for side in SIDES:
            assert found.hand_offset_m[side] == pytest.approx(person.hand_offset[side], abs=1e-9)


def test_without_a_pelvis_tracker_the_origin_is_below_the_shoulders() -> None:
    """By Drillis and Contini the wrist is 0.332 and the palm's centre 0.386 of the stature from the shoulder; shoulders are 0.288 over hips."""
    person = Operator(heading=0.7, place=(2.0, 1.0, 0.0), arm_length=(0.332 + 0.386) / 2 * 1.75)
    found = calibrate(person.record(rate_hz=30), windows=windows())
    assert found.origin == pytest.approx(person.world([0, 0, person.shoulder_height - 0.288 * 1.75]), abs=1e-9)


@pytest.mark.parametrize("order", list(itertools.permutations(POSES))[1:], ids="-".join)
def test_swapped_poses_are_named(order: tuple[str, ...]) -> None:
    held = windows()
    names = {"still": "Still pose", "tpose": "T-pose", "forward": "Forward pose"}
    with pytest.raises(MotionError, match=r"^the poses are swapped: ") as caught:
        calibrate(
            Operator(heading=2.0).record(rate_hz=30),
            windows={pose: held[real] for pose, real in zip(POSES, order, strict=True)},
        )
    for pose, real in zip(POSES, order, strict=True):
        said = f"what is given as {names[pose]} looks like the {names[real]}" in str(caught.value)
        assert said is (pose != real)


@pytest.mark.parametrize("bend", [60, 90, 120])
@pytest.mark.parametrize(("pose", "name"), [("still", "Still pose"), ("tpose", "T-pose"), ("forward", "Forward pose")])
@pytest.mark.parametrize("side", SIDES)
def test_one_bent_arm_is_named(side: str, pose: str, name: str, bend: float) -> None:
    person = Operator(heading=-2.5, elbow_deg={(side, pose): bend})
    reach = person.arm_length * np.cos(np.radians(bend / 2))
    with pytest.raises(
        MotionError,
        match=rf"^{side.lower()} arm, {name}: .* {reach:.2f} m from the shoulder, not 0\.58 m.*elbow bent\?$",
    ):
        calibrate(person.record(rate_hz=30), windows=windows())


@pytest.mark.parametrize("aim", [-90, -60, -40, -25, 25, 40, 60, 90])
@pytest.mark.parametrize(("pose", "name"), [("tpose", "T-pose"), ("forward", "Forward pose")])
@pytest.mark.parametrize("side", SIDES)
def test_one_arm_that_points_elsewhere_is_named(side: str, pose: str, name: str, aim: float) -> None:
    person = Operator(heading=1.0, aim_deg={(side, pose): aim})
    with pytest.raises(MotionError, match=rf"^{side.lower()} arm, {name}: ") as caught:
        calibrate(person.record(rate_hz=30), windows=windows())
    found = re.search(r"(\d+)° off straight", str(caught.value))
    assert found is not None
    assert float(found[1]) == pytest.approx(abs(aim), abs=2)


def test_arms_that_never_hang() -> None:
    held = windows()
    with pytest.raises(MotionError, match="no pose has the arms hanging"):
        calibrate(Operator().record(rate_hz=30), windows={**held, "still": held["forward"]})


def test_left_and_right_swapped() -> None:
    recording = Operator(heading=1.0).record(rate_hz=30)
    swapped = dict(recording.segments)
    swapped[SERIAL["LeftHand"]], swapped[SERIAL["RightHand"]] = "RightHand", "LeftHand"
    with pytest.raises(MotionError, match="the hand called left is on the right"):
        calibrate(replace(recording, segments=swapped), windows=windows())


def test_a_missing_tracker_and_one_that_is_lost() -> None:
    recording = Operator().record(rate_hz=30)
    fewer = {tracker: segment for tracker, segment in recording.segments.items() if segment != "RightHand"}
    with pytest.raises(MotionError, match=r"no tracker on RightHand .*LHR-00A0 on T8"):
        calibrate(replace(recording, segments=fewer), windows=windows(), assign_by="roles")
    lost = np.array(recording.tracked)
    lost[recording.time > 4.5, recording.index(SERIAL["LeftHand"])] = False
    with pytest.raises(
        MotionError, match=r"^Forward pose: tracker LHR-00A4 \(LeftHand\) is not tracked from 5\.1 to 6\.4 s"
    ):
        calibrate(replace(recording, tracked=lost), windows=windows())


def test_frames_that_were_not_tracked_do_not_count() -> None:
    person = Operator(heading=0.4)
    recording = person.record(rate_hz=30)
    position, tracked = np.array(recording.position), np.array(recording.tracked)
    hand = recording.index(SERIAL["LeftHand"])
    position[10:20, hand] += 1.0
    tracked[10:20, hand] = False
    found = calibrate(replace(recording, position=position, tracked=tracked), windows=windows())
    assert max(shoulder_errors(person, found)) < 1e-9


def test_a_shaky_pose_and_unequal_arms_are_warned_of() -> None:
    recording = Operator().record(rate_hz=30)
    position = np.array(recording.position)
    hand = recording.index(SERIAL["RightHand"])
    position[:45, hand, 0] += 0.06 * np.sin(2 * np.pi * 2 * recording.time[:45])
    found = calibrate(replace(recording, position=position), windows=windows())
    assert any(w.startswith("right arm, Still pose: the hand moves by 4") for w in found.warnings)
    without_head = {tracker: segment for tracker, segment in recording.segments.items() if segment != "Head"}
    found = calibrate(replace(recording, segments=without_head), windows=windows(), hand_offset_m=(-0.08, 0, 0))
    assert found.warnings == ("no tracker on Head",)


def test_the_default_hand_offset_under_another_mount_is_warned_of() -> None:
    """x of the left tracker across the arm, of the right one along it."""
    across = Rotation.from_euler("z", 90, degrees=True)
    for turned, warned in ((Rotation.identity(), True), (across, False)):
        person = Operator(mount={"LeftHand": turned, "RightHand": across})
        found = calibrate(person.record(rate_hz=30), windows=windows())
        message = (
            "left hand: the default hand offset (-0.08, 0, 0) m points 90° off the arm with this mount; measure it"
        )
        assert [w.startswith(message) for w in found.warnings] == [True] * warned
        told = calibrate(person.record(rate_hz=30), windows=windows(), hand_offset_m=person.offset)
        assert told.warnings == ()


def test_requests_that_contradict_themselves() -> None:
    recording = Operator().record(rate_hz=30)
    with pytest.raises(UsageError, match="found a window of 't-pose', expected still, tpose, forward"):
        calibrate(recording, windows={"t-pose": (2.6, 3.9)})
    with pytest.raises(UsageError, match="Still pose: found 3 to 2 s, expected a start before its end"):
        calibrate(recording, windows={**windows(), "still": (3, 2)})
    with pytest.raises(UsageError, match=r"hand offset .*three finite numbers"):
        calibrate(recording, windows=windows(), hand_offset_m=(0, np.nan, 0))
    with pytest.raises(
        MotionError, match=r"Forward pose: no frame from 90 to 91 s; the recording runs from 0 to 6\.46667 s"
    ):
        calibrate(recording, windows={**windows(), "forward": (90, 91)})
    with pytest.raises(MotionError, match=r"^no Still, T and Forward pose among 2 still stretches .*START:END$"):
        calibrate(Operator().record(("still", "tpose"), rate_hz=30))
    with pytest.raises(MotionError, match=r"^Still pose: nowhere do chest and hands stand still for 0\.6 s"):
        calibrate(Operator().record(hold_s=0.2, rate_hz=30))


class TestFromASuit:
    """A calibration from a `HumanMotion`, whose segments serve as trackers."""

    @pytest.fixture
    def motion(self, make_motion: Callable[..., HumanMotion]) -> HumanMotion:
        """The person of the fixtures, facing 40° to the left, in the three poses for 1 s each; hands turned as the arms are."""
        heading, frames = Rotation.from_euler("z", 40, degrees=True), 30
        world = {"Pelvis": wxyz(heading)}
        for side in SIDES:
            turns = [wxyz(heading * arm_rotation(side, pose)) for pose in POSES]
            world[f"{side}UpperArm"] = np.repeat(turns, frames, axis=0)
        return make_motion(np.arange(3 * frames) / 30, world, pelvis=(1.0, -2.0, 0.95))

    def test_is_exact(self, motion: HumanMotion) -> None:
        found = calibrate(motion, windows={"still": (0, 0.9), "tpose": (1, 1.9), "forward": (2, 2.9)})
        assert found.heading_rad == pytest.approx(np.radians(40), abs=1e-9)
        assert found.origin == pytest.approx([1.0, -2.0, 0.95], abs=1e-9)
        # Pelvis to T8 0.4 m, shoulder at (0, ±0.17, 0.10) of T8; upper arm and forearm 0.30 and 0.25 m.
        for side, left in (("Left", 1), ("Right", -1)):
            assert found.arms[side].shoulder == pytest.approx([0, 0.17 * left, 0.5], abs=1e-9)
            assert found.arms[side].length_m == pytest.approx(0.55, abs=1e-9)
            assert found.residuals[f"shoulder_from_segment_m/{side}"] < 1e-9
            assert rotations.angle(found.still_orientation[f"{side}Hand"], wxyz(arm_rotation(side, "still"))) < 1e-7
            assert found.hand_offset_m[side].tolist() == [0, 0, 0]
        assert found.chest_position == pytest.approx([0, 0, 0.4], abs=1e-9)
        assert not found.trackers
        assert not found.tracker_rotation

    def test_a_hand_point_beyond_the_wrist(self, motion: HumanMotion) -> None:
        held = {"still": (0, 0.9), "tpose": (1, 1.9), "forward": (2, 2.9)}
        found = calibrate(motion, windows=held, hand_offset_m=(0, 0.08, 0), hand_offset_frame="hand")
        for side, left in (("Left", 1), ("Right", -1)):
            assert found.arms[side].length_m == pytest.approx(0.63, abs=1e-9)
            assert found.hand_offset_m[side] == pytest.approx([0, 0.08 * left, 0], abs=1e-12)

    def test_the_sample_reach(self) -> None:
        """Holds N- and T-pose; its arms go ahead with bent elbows and a leaning chest, near enough to a Forward pose at 3.6 s."""
        motion = formats.read_motion(samples.sample_path("reach"))
        found = calibrate(motion, windows={"still": (0.0, 0.8), "tpose": (2.0, 2.5), "forward": (3.55, 3.7)})
        for side in SIDES:
            # 0.332 of a stature of 1.75 m.
            assert found.arms[side].length_m == pytest.approx(0.581, abs=0.01)
            assert found.residuals[f"shoulder_from_segment_m/{side}"] < 0.015
        assert found.residuals["chest_turned_deg/forward"] > 5

    def test_segments_that_are_not_tracked(self, motion: HumanMotion) -> None:
        measured = np.array([name != "LeftHand" for name in motion.segments])
        with pytest.raises(MotionError, match="doesn't track LeftHand"):
            virtual_trackers(replace(motion, measured=measured))

    def test_beside_trackers(self, motion: HumanMotion) -> None:
        trackers: TrackerRecording = Operator().record(rate_hz=30)
        with pytest.raises(UsageError, match="from one system"):
            calibrate({"still": motion, "tpose": trackers, "forward": trackers})
