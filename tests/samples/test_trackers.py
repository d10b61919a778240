"""Virtual trackers: where they sit, and the faults they are asked to have."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from retarget.core.errors import InvalidDataError
from retarget.samples import tasks, trackers
from retarget.samples.takes import Take, operator_recording
from retarget.samples.trackers import Dropout, Faults
from scipy.spatial.transform import Rotation

SEGMENTS = ("T8", "Head", "LeftUpperArm", "RightUpperArm", "LeftHand", "RightHand")


@cache
def _take(faults: Faults = trackers.NO_FAULTS, mount_seed: int = 0) -> Take:
    return operator_recording(tasks.Calibration(), faults=faults, mount_seed=mount_seed)


def _scipy(wxyz: np.ndarray) -> Rotation:
    return Rotation.from_quat(wxyz[..., [1, 2, 3, 0]])


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_hand_point_is_eight_centimetres_behind_the_hand_tracker(seed: int) -> None:
    done = _take(mount_seed=seed)
    for side in ("Left", "Right"):
        at = done.recording.index(f"{side.lower()}_hand")
        point = done.recording.position[:, at] + _scipy(done.recording.orientation[:, at]).apply([-0.08, 0, 0])
        assert np.abs(point - done.hand_point[side]).max() < 1e-12
        # It sits on the back of the hand: in T-pose above the palm and toward the wrist.
        out = done.mounts[f"{side}Hand"].position
        assert out[2] > 0.03
        assert abs(out[1]) < 0.085


def test_trackers_turn_and_travel_with_their_segments() -> None:
    done = _take()
    assert [done.recording.segments[name] for name in done.recording.trackers] == list(SEGMENTS)
    for at, segment in enumerate(SEGMENTS):
        mount, body = done.mounts[segment], _scipy(done.motion.orientation[:, done.motion.index(segment)])
        measured = _scipy(done.recording.orientation[:, at])
        assert (measured * _scipy(mount.tracker_rotation) * body.inv()).magnitude().max() < 1e-12
        local = body.inv().apply(done.recording.position[:, at] - done.position(segment))
        assert local == pytest.approx(np.broadcast_to(mount.position, local.shape), abs=1e-12)
    assert done.recording.tracked.all()


def test_mounts_differ_by_seed_and_repeat_for_the_same() -> None:
    first, again, other = trackers.mounts(3), trackers.mounts(3), trackers.mounts(4)
    for segment in SEGMENTS:
        assert (first[segment].rotation == again[segment].rotation).all()
        assert first[segment].serial == again[segment].serial
        apart = (_scipy(first[segment].rotation).inv() * _scipy(other[segment].rotation)).magnitude()
        assert np.degrees(apart) > 1.0
    turned = np.degrees([_scipy(trackers.mounts(seed)["T8"].rotation).magnitude() for seed in range(200)])
    # Of uniformly random rotations 59.4 % turn by more than 120°... and hardly any by less than 20°: (θ − sin θ)/π is their distribution.
    for angle in (60.0, 90.0, 120.0):
        share = (np.radians(angle) - np.sin(np.radians(angle))) / np.pi
        assert np.mean(turned < angle) == pytest.approx(share, abs=3 * np.sqrt(share * (1 - share) / 200))


def test_noise_has_the_size_asked_for() -> None:
    clean = _take()
    noisy = _take(Faults(position_noise_m=0.005, rotation_noise_rad=0.01, seed=8))
    wrong = noisy.recording.position - clean.recording.position
    turned = (
        _scipy(clean.recording.orientation.reshape(-1, 4)).inv() * _scipy(noisy.recording.orientation.reshape(-1, 4))
    ).as_rotvec()
    for errors, size in ((wrong.reshape(-1, 3), 0.005), (turned, 0.01)):
        assert np.std(errors, axis=0) == pytest.approx(size, rel=0.04)
        assert np.abs(np.mean(errors, axis=0)).max() < 4 * size / np.sqrt(len(errors))
    # White: neighbouring frames know nothing of each other.
    x = wrong[:, 0, 0]
    assert abs(np.corrcoef(x[1:], x[:-1])[0, 1]) < 0.1
    again = operator_recording(
        tasks.Calibration(), faults=Faults(position_noise_m=0.005, rotation_noise_rad=0.01, seed=8)
    )
    assert (again.recording.position == noisy.recording.position).all()
    # What is true stays so.
    assert (noisy.motion.position == clean.motion.position).all()


def test_a_lost_tracker_holds_its_last_pose() -> None:
    clean, lossy = _take(), _take(Faults(dropouts=(Dropout("RightHand", 2.5, 3.0), Dropout("T8", 0.0, 0.1))))
    at, time = clean.recording.index("right_hand"), clean.motion.time
    lost = (time >= 2.5) & (time < 3.0)
    assert (lossy.recording.tracked[:, at] == ~lost).all()
    last = np.flatnonzero(lost)[0] - 1
    assert (lossy.recording.position[lost, at] == clean.recording.position[last, at]).all()
    assert (lossy.recording.position[~lost, at] == clean.recording.position[~lost, at]).all()
    # Lost from the start: the first pose known.
    assert (lossy.recording.tracked[:, 0] == (time >= 0.1)).all()
    assert (lossy.recording.position[time < 0.1, 0] == clean.recording.position[9, 0]).all()
    assert lossy.recording.tracked[:, [1, 2, 3, 4]].all()


def test_repeated_rows_repeat_all_trackers_and_are_not_marked() -> None:
    clean, repeating = _take(), _take(Faults(repeats=0.2, seed=1))
    moving = np.flatnonzero((np.diff(clean.recording.position, axis=0) != 0).any(axis=(1, 2))) + 1
    same = (np.diff(repeating.recording.position, axis=0) == 0).all(axis=(1, 2))[moving - 1]
    assert 0.15 < same.mean() < 0.25
    assert repeating.recording.tracked.all()


def test_serials_tell_nothing_of_the_segments() -> None:
    done = operator_recording(tasks.Calibration(), serials=True)
    assert done.recording.segments == {}
    assert list(done.recording.trackers) == sorted(mount.serial for mount in done.mounts.values())
    assert all(name.startswith("LHR-") and len(name) == 12 for name in done.recording.trackers)
    named = _take()
    for segment, mount in done.mounts.items():
        there, here = done.recording.index(mount.serial), named.recording.index(trackers.ROLES[segment])
        assert (done.recording.position[:, there] == named.recording.position[:, here]).all()


def test_impossible_dropouts_are_refused() -> None:
    with pytest.raises(InvalidDataError, match="dropout of Pelvis; expected one of T8, Head, LeftUpperArm"):
        _take(Faults(dropouts=(Dropout("Pelvis", 1.0, 2.0),)))
    with pytest.raises(InvalidDataError, match="dropout of Head from 0 to 99 s leaves no frame"):
        _take(Faults(dropouts=(Dropout("Head", 0.0, 99.0),)))
