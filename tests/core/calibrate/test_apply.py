"""A calibrated recording as a motion: known movements of the synthetic operator must come out as segment orientations and points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from retarget.core import rotations
from retarget.core.calibrate.apply import apply
from retarget.core.calibrate.operator import calibrate
from retarget.core.calibration import Calibration
from retarget.core.errors import MotionError
from retarget.core.types import HumanMotion, TrackerRecording
from scipy.spatial.transform import Rotation

from tests.core.calibrate.operators import ROLES, SERIAL, SIDES, Operator, arm_rotation, windows, wxyz

Array = NDArray[np.float64]

SEVEN = (*ROLES, "Pelvis")


@pytest.fixture(scope="module")
def person() -> Operator:
    return Operator.random(11, roles=SEVEN)


@pytest.fixture(scope="module")
def calibration(person: Operator) -> Calibration:
    return calibrate(person.record(rate_hz=30), windows=windows(), hand_offset_m=person.offset)


def recorded(
    person: Operator, pose: str, turns: list[Rotation], arm: dict[str, Rotation] | None = None
) -> TrackerRecording:
    """Frames of `pose` with the whole person turned about the vertical through their feet by `turns`, and an arm turned about its shoulder."""
    position = np.empty((len(turns), len(person.roles), 3))
    orientation = np.empty((len(turns), len(person.roles), 4))
    for frame, turn in enumerate(turns):
        for column, name in enumerate(person.roles):
            point, turned = person.segment(name, pose)
            side = "Left" if name.startswith("Left") else "Right"
            if arm and name.endswith(("Arm", "Hand")) and side in arm:
                point = person.shoulder(side) + arm[side].apply(point - person.shoulder(side))
                turned = arm[side] * turned
            device = person.to_world * turn * turned * person.mount[name].inv()
            position[frame, column] = person.world(turn.apply(point))
            if name.endswith("Hand"):
                position[frame, column] -= device.apply(np.array(person.offset))
            orientation[frame, column] = wxyz(device)
    return TrackerRecording(
        time=np.arange(len(turns)) / 90,
        trackers=tuple(SERIAL[name] for name in person.roles),
        orientation=rotations.make_continuous(orientation),
        position=position,
        tracked=np.ones((len(turns), len(person.roles)), bool),
    )


def assert_turned(motion: HumanMotion, segment: str, expected: Rotation, frame: int = -1) -> None:
    assert rotations.angle(motion.orientation[frame, motion.index(segment)], wxyz(expected)) < 1e-7, segment


def test_the_tpose_is_the_identity_and_everything_is_in_the_operator_frame(
    person: Operator, calibration: Calibration
) -> None:
    motion = apply(calibration, recorded(person, "tpose", [Rotation.identity()]))
    assert motion.segments == ("Pelvis", "T8", "Head", "RightUpperArm", "RightHand", "LeftUpperArm", "LeftHand")
    assert motion.calibration is calibration
    assert motion.measured.all()
    origin = person.segment("Pelvis", "still")[0]
    for name in motion.segments:
        assert_turned(motion, name, Rotation.identity())
        point = person.segment(name, "tpose")[0]
        if name.endswith("UpperArm"):
            point = person.shoulder(name.removesuffix("UpperArm"))
        assert motion.position[0, motion.index(name)] == pytest.approx(point - origin, abs=1e-9), name


def test_turning_left_turns_every_segment_and_moves_the_shoulders(person: Operator, calibration: Calibration) -> None:
    """[Lim2022 eq. 2]: the shoulders go with the chest, over more than half a turn without a jump in sign."""
    turns = [Rotation.from_euler("z", angle, degrees=True) for angle in range(0, 271, 10)]
    motion = apply(calibration, recorded(person, "still", turns))
    origin = person.segment("Pelvis", "still")[0]
    for frame, turn in enumerate(turns):
        for name in ("T8", "Head", "Pelvis"):
            assert_turned(motion, name, turn, frame)
        for side in SIDES:
            assert_turned(motion, f"{side}Hand", turn * arm_rotation(side, "still"), frame)
            found = motion.position[frame, motion.index(f"{side}UpperArm")]
            assert found == pytest.approx(turn.apply(person.shoulder(side)) - origin, abs=1e-9)


def test_raising_the_right_arm_moves_it_alone(person: Operator, calibration: Calibration) -> None:
    """From beside the body forward and up by 120° about the person's left axis, which turns forward to down."""
    raised = Rotation.from_rotvec([0, -120, 0], degrees=True)
    motion = apply(calibration, recorded(person, "still", [Rotation.identity()], {"Right": raised}))
    for name in ("RightUpperArm", "RightHand"):
        assert_turned(motion, name, raised * arm_rotation("Right", "still"))
    assert_turned(motion, "LeftHand", arm_rotation("Left", "still"))
    assert_turned(motion, "T8", Rotation.identity())
    along = rotations.rotate(motion.orientation[0, motion.index("RightUpperArm")], [0, -1, 0])
    assert along == pytest.approx([np.sin(np.radians(120)), 0, -np.cos(np.radians(120))], abs=1e-7)
    reach = motion.position[0, motion.index("RightHand")] - motion.position[0, motion.index("RightUpperArm")]
    assert reach == pytest.approx(person.arm_length * along, abs=1e-8)


def test_a_tracker_lost_throughout_is_not_measured(person: Operator, calibration: Calibration) -> None:
    recording = recorded(person, "tpose", [Rotation.identity()] * 4)
    tracked = np.array(recording.tracked)
    tracked[:, recording.index(SERIAL["LeftHand"])] = False
    tracked[:3, recording.index(SERIAL["Head"])] = False
    motion = apply(calibration, replace(recording, tracked=tracked))
    assert motion.unmeasured_segments == ("LeftHand",)
    assert np.isnan(motion.position[:, motion.index("LeftHand")]).all()
    assert_turned(motion, "LeftHand", arm_rotation("Left", "still"))
    assert motion.source.warnings == (
        f"Head: its tracker {SERIAL['Head']} is not tracked in 3 of 4 frames",
        f"LeftHand: its tracker {SERIAL['LeftHand']} is not tracked in any frame",
    )


def test_without_the_chest_there_are_no_shoulders(person: Operator, calibration: Calibration) -> None:
    recording = recorded(person, "tpose", [Rotation.identity()] * 2)
    keep = [column for column, name in enumerate(person.roles) if name != "T8"]
    motion = apply(
        calibration,
        TrackerRecording(
            time=recording.time,
            trackers=tuple(recording.trackers[i] for i in keep),
            orientation=recording.orientation[:, keep],
            position=recording.position[:, keep],
            tracked=recording.tracked[:, keep],
        ),
    )
    assert motion.unmeasured_segments == ("T8",)
    assert np.isnan(motion.position[:, motion.index("LeftUpperArm")]).all()
    assert np.isfinite(motion.position[:, motion.index("LeftHand")]).all()
    assert_turned(motion, "LeftUpperArm", Rotation.identity())


def test_other_trackers(person: Operator, calibration: Calibration) -> None:
    recording = recorded(person, "tpose", [Rotation.identity()])
    others = replace(recording, trackers=tuple("ABCDEFG"))
    known = ", ".join(sorted(SERIAL.values()))
    message = rf"^calibration of another tracker set: it is of {known}; the recording has A, B, C, D, E, F, G$"
    with pytest.raises(MotionError, match=message):
        apply(calibration, others)
    with pytest.raises(MotionError, match=r"another tracker set: .* the recording has LHR-00A0, .*, X$"):
        apply(calibration, replace(recording, trackers=(*recording.trackers[:6], "X")))
    moved = replace(recording, segments={SERIAL["Head"]: "T8"})
    with pytest.raises(MotionError, match=f"it has tracker {SERIAL['Head']} on Head, the recording has it on T8"):
        apply(calibration, moved)


def test_a_calibration_of_a_suit(person: Operator, calibration: Calibration) -> None:
    suit = replace(calibration, trackers={}, tracker_rotation={})
    with pytest.raises(MotionError, match="from a suit's segments and fits no trackers"):
        apply(suit, recorded(person, "tpose", [Rotation.identity()]))
