"""The perfect calibration and the motion it makes, put together again from the trackers' own poses by SciPy."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from retarget.core.calibrate.apply import apply
from retarget.samples import tasks
from retarget.samples.takes import Take, operator_recording
from retarget.samples.true_calibration import true_calibration, true_motion
from scipy.spatial.transform import Rotation

SIDES = ("Left", "Right")


def _take(task: tasks.Task | None = None, *, serials: bool = False) -> Take:
    return operator_recording(task, heading_rad=-2.4, origin=(1.0, 2.0, 0.1), mount_seed=5, serials=serials)


def _scipy(wxyz: np.ndarray) -> Rotation:
    return Rotation.from_quat(wxyz[..., [1, 2, 3, 0]])


def test_hand_points_are_where_the_hands_were() -> None:
    done = _take()
    found = true_calibration(done)
    yaw = Rotation.from_euler("z", -2.4)
    assert found.windows_s == {"still": (0.2, 1.8), "tpose": (4.0, 5.6), "forward": (7.8, 9.4)}
    still = yaw.inv() * _scipy(done.motion.orientation[90, done.motion.index("T8")])
    for row, (start, end) in enumerate(found.windows_s.values()):
        at = round((start + end) / 2 * 90)
        chest = _scipy(done.motion.orientation[at, done.motion.index("T8")])
        for side in SIDES:
            # As if the chest had stayed where it was in the Still pose.
            local = chest.inv().apply(done.hand_point[side][at] - done.position("T8")[at])
            seen = still.apply(local) + yaw.inv().apply(done.position("T8")[90] - done.position("Pelvis")[90])
            assert seen == pytest.approx(found.arms[side].hand_points[row], abs=1e-12)
            shoulder = yaw.apply(np.array(found.arms[side].shoulder)) + found.origin
            # After 1 s the sway goes through its middle.
            assert shoulder == pytest.approx(done.position(f"{side}UpperArm")[90], abs=1e-12)


@pytest.mark.parametrize("side", SIDES)
def test_figures_of_an_arm_agree_with_its_points(side: str) -> None:
    arm = true_calibration(_take()).arms[side]
    still, tpose, forward = arm.hand_points
    assert np.linalg.norm(arm.hand_points - arm.shoulder, axis=1) == pytest.approx(arm.length_m, abs=1e-12)
    pairs = ((still, tpose), (tpose, forward), (forward, still))
    # Circumradius of a triangle: abc over four times its area.
    a, b, c = (np.linalg.norm(p - q) for p, q in pairs)
    radius = a * b * c / (2 * np.linalg.norm(np.cross(tpose - still, forward - still)))
    k = [np.sqrt(np.sum((p - q) ** 2) / 2 - radius**2) for p, q in pairs]
    assert arm.offsets_m == pytest.approx(k, abs=1e-12)
    assert np.mean(k) == pytest.approx(np.sqrt(arm.length_m**2 - radius**2), abs=1e-12)
    assert max(abs(x - y) for x, y in combinations(k, 2)) < 0.1


@pytest.mark.parametrize("serials", [False, True])
def test_trackers_make_the_motion(serials: bool) -> None:
    done = _take(tasks.BoxCarrying(), serials=serials)
    motion = true_motion(done)
    assert motion.calibration is not None
    calibration, recording = motion.calibration, done.recording
    assert set(calibration.trackers.values()) == set(recording.trackers)
    assert calibration.windows_s == {}
    place = {segment: recording.index(name) for segment, name in calibration.trackers.items()}
    back = Rotation.from_euler("z", 2.4)
    for at, segment in enumerate(motion.segments):
        tracker = back * _scipy(recording.orientation[:, place[segment]])
        made = tracker * _scipy(calibration.tracker_rotation[segment])
        assert (made.inv() * _scipy(motion.orientation[:, at])).magnitude().max() < 1e-12
        point = back.apply(recording.position[:, place[segment]] - done.still.position[0, done.still.index("Pelvis")])
        if segment.endswith("Hand"):
            point = point + tracker.apply([-0.08, 0.0, 0.0])
        if not segment.endswith("UpperArm"):
            assert motion.position[:, at] == pytest.approx(point, abs=1e-12)
    # [Lim2022 eq. 2]: the shoulders go with the chest.
    chest = _scipy(motion.orientation[:, motion.index("T8")]) * _scipy(calibration.chest_orientation).inv()
    for side in SIDES:
        offset = calibration.arms[side].shoulder - calibration.chest_position
        live = motion.position[:, motion.index("T8")] + chest.apply(offset)
        assert motion.position[:, motion.index(f"{side}UpperArm")] == pytest.approx(live, abs=1e-12)


def test_the_motion_is_what_applying_the_calibration_gives() -> None:
    done = _take(tasks.Clapping())
    motion = true_motion(done)
    applied = apply(true_calibration(done), done.recording)
    assert motion.segments == applied.segments
    assert motion.position == pytest.approx(applied.position, abs=1e-12)
    away = _scipy(motion.orientation.reshape(-1, 4)).inv() * _scipy(applied.orientation.reshape(-1, 4))
    assert away.magnitude().max() < 1e-12


def test_still_orientations_are_those_of_the_still_pose_facing_x() -> None:
    found = true_calibration(_take())
    assert found.heading_rad == -2.4
    assert found.still_orientation["T8"] == pytest.approx([1, 0, 0, 0], abs=1e-12)
    # The left arm hangs 4° outward of the vertical, which is 86° down from the T-pose.
    hanging = _scipy(found.still_orientation["LeftUpperArm"]).as_rotvec(degrees=True)
    assert hanging == pytest.approx([-86, 0, 0], abs=1e-9)
    assert _scipy(found.still_orientation["RightHand"]).as_rotvec(degrees=True) == pytest.approx([86, 0, 0], abs=1e-9)
