"""What the operator does, against what each task promises in closed form."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from retarget.samples import tasks
from retarget.samples.takes import Take, operator_recording
from retarget.samples.tasks import Task
from scipy.spatial.transform import Rotation

TASKS: dict[str, Callable[[], Task]] = {
    "calibration": tasks.Calibration,
    "circles": tasks.Circles,
    "box": tasks.BoxCarrying,
    "clap": tasks.Clapping,
}
LEFT = {"Left": 1.0, "Right": -1.0}
SHOULDER_HALF_WIDTH = 0.104 * 1.75
HEADING, ORIGIN = 2.1, np.array([0.8, -0.4, 0.3])


@cache
def take(name: str) -> Take:
    return operator_recording(TASKS[name]())


def _rotation(done: Take, segment: str) -> Rotation:
    return Rotation.from_quat(done.motion.orientation[:, done.motion.index(segment)][:, [1, 2, 3, 0]])


def _in_chest(done: Take, points: np.ndarray) -> np.ndarray:
    return _rotation(done, "T8").inv().apply(points - done.position("T8"))


def _from_shoulder(done: Take, side: str) -> np.ndarray:
    """Hand point (T, 3) m in the chest's axes, from the shoulder: what [Lim2022 eq. 3] maps."""
    return _rotation(done, "T8").inv().apply(done.hand_point[side] - done.position(f"{side}UpperArm"))


def _during(done: Take, window: str) -> np.ndarray:
    start, end = done.task.windows[window]
    return (done.motion.time >= start - 1e-9) & (done.motion.time <= end + 1e-9)


@pytest.mark.parametrize("name", TASKS)
def test_bones_keep_their_lengths(name: str) -> None:
    done = take(name)
    for side in LEFT:
        shoulder, elbow, wrist = (done.position(f"{side}{part}") for part in ("UpperArm", "ForeArm", "Hand"))
        for a, b, length in (
            (shoulder, elbow, 0.186 * 1.75),
            (elbow, wrist, 0.146 * 1.75),
            (wrist, done.hand_point[side], 0.45 * 0.108 * 1.75),
        ):
            assert np.abs(np.linalg.norm(b - a, axis=1) - length).max() < 1e-9
        # The wrist is straight: elbow, wrist and hand point lie on a line.
        assert np.linalg.norm(np.cross(wrist - elbow, done.hand_point[side] - wrist), axis=1).max() < 1e-9
        # Chest and shoulders are one rigid body, as eq. 2 takes them.
        assert np.ptp(_in_chest(done, shoulder), axis=0).max() < 1e-9


@pytest.mark.parametrize("name", TASKS)
def test_speeds_are_human_and_nothing_jumps(name: str) -> None:
    done = take(name)
    step = 1 / 90
    for points in (*done.hand_point.values(), done.position("LeftForeArm"), done.position("Head")):
        assert np.linalg.norm(np.diff(points, axis=0), axis=1).max() / step < 3.0
        assert np.linalg.norm(np.diff(points, 2, axis=0), axis=1).max() / step**2 < 20.0
    for segment in done.motion.segments:
        turned = _rotation(done, segment)
        rate = (turned[1:] * turned[:-1].inv()).as_rotvec() / step
        assert np.linalg.norm(rate, axis=1).max() < 5.0, segment
        assert np.linalg.norm(np.diff(rate, axis=0), axis=1).max() / step < 60.0, segment
    # At either end the hands rest on the chest, and only sway with it.
    for side, hand in done.hand_point.items():
        for rest in (slice(None, 2), slice(-2, None)):
            assert np.ptp(_from_shoulder(done, side)[rest], axis=0).max() < 1e-9
            assert np.linalg.norm(np.diff(hand[rest], axis=0)) / step < 0.03


@pytest.mark.parametrize("name", TASKS)
def test_every_task_starts_upright_in_the_still_pose(name: str) -> None:
    done = take(name)
    for side in LEFT:
        assert _from_shoulder(done, side)[0] == pytest.approx(done.task.operator.basis(side)[:, 0], abs=1e-12)
    assert done.still.position[0, 0] == pytest.approx([0, 0, done.position("Pelvis")[0, 2]], abs=1e-12)
    for segment in done.motion.segments:
        at = done.motion.index(segment)
        start, still = (Rotation.from_quat(m.orientation[0, at][[1, 2, 3, 0]]) for m in (done.motion, done.still))
        if segment in ("Pelvis", "T8", "Head"):
            assert still.magnitude() < 1e-12
        # What the sway makes of it.
        assert np.degrees((start * still.inv()).magnitude()) < 0.5
        assert np.linalg.norm(done.position(segment)[0] - done.still.position[0, at]) < 0.008


@pytest.mark.parametrize("name", TASKS)
def test_nobody_ever_stands_perfectly_still(name: str) -> None:
    """Any tracker's pose changes from one row to the next by at least fifty times the last digit that is written."""
    done = take(name)
    poses = np.concatenate([done.recording.position, done.recording.orientation], axis=-1)
    assert np.abs(np.diff(poses, axis=0)).max(axis=-1).min() > 5e-6


def test_calibration_holds_the_three_poses() -> None:
    done = take("calibration")
    for column, window in enumerate(("still", "tpose", "forward")):
        start, end = done.task.windows[window]
        assert end - start >= 1.5
        frames = _during(done, window)
        for side in LEFT:
            pose = _from_shoulder(done, side)[frames]
            assert np.abs(pose - done.task.operator.basis(side)[:, column]).max() < 1e-9
            # Seen from the room it goes with the chest, by millimetres.
            assert 0.003 < np.ptp(done.hand_point[side][frames], axis=0).max() < 0.015


def test_t_pose_is_the_reference_posture() -> None:
    done = take("calibration")
    held = _during(done, "tpose")
    chest = _rotation(done, "T8")
    for segment in done.motion.segments:
        turned = _rotation(done, segment)
        assert np.degrees(turned[held].magnitude().max()) < 0.5, segment
        if segment not in ("Pelvis", "Head"):
            assert (chest.inv() * turned)[held].magnitude().max() < 1e-9, segment


@pytest.mark.parametrize("window", ["still", "tpose"])
def test_the_sway_averages_out_over_a_held_pose(window: str) -> None:
    """So that what a pose shows on average is the upright body, but for the second order of some tenths of a degree."""
    done = take("calibration")
    held = _during(done, window)
    for segment in ("T8", "Head"):
        turned, place = _rotation(done, segment)[held], done.position(segment)[held]
        assert np.degrees(turned.mean().magnitude()) < 1e-3
        assert 0.1 < np.degrees(turned.magnitude().max()) < 0.5
        planned = {"still": (0.0, 0.0), "tpose": (-0.006, 0.008)}[window]
        assert place[:, :2].mean(axis=0) == pytest.approx(planned, abs=1e-5)
        assert 0.002 < np.ptp(place, axis=0).max() < 0.012


def test_chest_moves_between_the_poses() -> None:
    """Or nothing would show whether a calibration allows for it."""
    done = take("calibration")
    still, forward = (np.flatnonzero(_during(done, window))[0] for window in ("still", "forward"))
    assert np.linalg.norm(done.position("T8")[forward] - done.position("T8")[still]) > 0.01
    turned = _rotation(done, "T8")
    assert np.degrees((turned[forward] * turned[still].inv()).magnitude()) > 1.0


@pytest.mark.parametrize("side", LEFT)
def test_circles_are_round_in_the_axes_of_the_poses_and_nowhere_else(side: str) -> None:
    done = take("circles")
    frames = _during(done, "circles")
    drawn = _from_shoulder(done, side)[frames]
    weights = np.linalg.solve(done.task.operator.basis(side), drawn.T)
    robot = 0.78 * np.array([[0, 0, 1], [0, LEFT[side], 0], [-1, 0, 0]]) @ weights
    center = np.array([0.45, 0.05 * LEFT[side], -0.10])
    # The same circle in the size of the robot's arm.
    scale = 0.78 / ((0.186 + 0.146 + 0.45 * 0.108) * 1.75)
    away = robot.T - scale * center
    assert np.linalg.norm(away, axis=1) == pytest.approx(scale * 0.15, abs=1e-9)
    assert np.abs(away[:, 0]).max() < 1e-9
    radii = np.linalg.norm((drawn - drawn.mean(axis=0))[:, 1:], axis=1)
    assert np.std(radii) / np.mean(radii) > 0.01


@pytest.mark.parametrize("side", LEFT)
def test_circles_are_drawn_in_full_and_at_constant_speed(side: str) -> None:
    task = tasks.Circles(turns=10, diameter=0.25, period=2.0)
    done = operator_recording(task)
    time, meant = done.motion.time, task.meant(side, done.motion.time)
    start, end = task.windows["circles"]
    angle = np.unwrap(np.arctan2(*((meant - task.center(side))[:, 1:] * [LEFT[side], -1]).T))
    first, last = np.searchsorted(time, [start - 1e-9, end - 1e-9])
    assert (angle[first], angle[last] - angle[first]) == pytest.approx((0, 10 * 2 * np.pi), abs=1e-9)
    speed = np.linalg.norm(np.gradient(meant, time, axis=0), axis=1)[first + 1 : last]
    assert speed == pytest.approx(np.pi * 0.25 / 2.0, rel=1e-3)
    assert end - start == pytest.approx(10 * 2.0)


def test_an_unsteady_hand_strays_from_the_circle_by_what_was_asked() -> None:
    steady = operator_recording(tasks.Circles(turns=10))
    unsteady = operator_recording(tasks.Circles(turns=10, unsteadiness=0.015))
    start, end = steady.task.windows["circles"]
    frames = (steady.motion.time > start + 1) & (steady.motion.time < end - 1)
    for side in LEFT:
        strayed = _from_shoulder(unsteady, side) - _from_shoulder(steady, side)
        assert np.sqrt(np.mean(strayed[frames] ** 2, axis=0)) == pytest.approx(0.015, rel=0.15)
        assert np.abs(strayed[[0, -1]]).max() < 1e-12
        assert np.abs(np.corrcoef(strayed[frames].T) - np.eye(3)).max() < 0.4
    # Left and right stray apart.
    left, right = (_from_shoulder(unsteady, side) - _from_shoulder(steady, side) for side in LEFT)
    assert np.abs(left - right).max() > 0.015


def test_hands_keep_the_box_between_them() -> None:
    done = take("box")
    apart = done.hand_point["Left"] - done.hand_point["Right"]
    held = _during(done, "held")
    assert np.linalg.norm(apart[held], axis=1) == pytest.approx(0.30, abs=1e-9)
    middle = (done.hand_point["Left"] + done.hand_point["Right"])[held] / 2
    height, aside = np.ptp(middle[:, 2]), np.ptp(middle[:, 1])
    assert height > 0.2
    assert aside > 0.2
    assert middle[0, 2] == pytest.approx(middle[-1, 2], abs=0.03)
    for side, left in LEFT.items():
        palm = (_rotation(done, "T8").inv() * _rotation(done, f"{side}Hand")).apply([0, 0, -1])[held]
        assert (palm @ [0, -left, 0]).min() > 0.85


def test_hands_meet_at_every_clap() -> None:
    done = take("clap")
    apart = np.linalg.norm(done.hand_point["Left"] - done.hand_point["Right"], axis=1)
    for window in done.task.windows:
        assert apart[_during(done, window)] == pytest.approx(0.03, abs=1e-9)
    together = apart < 0.1
    assert (np.diff(together.astype(int)) == 1).sum() == len(done.task.windows) == 5
    assert apart[done.motion.time > 1.8].max() == pytest.approx(0.40, abs=1e-9)
    middle = _in_chest(done, (done.hand_point["Left"] + done.hand_point["Right"]) / 2)
    assert np.abs(middle[done.motion.time > 1.8, 1]).max() < 1e-9


def test_heading_and_origin_move_everything_together() -> None:
    here, there = take("box"), operator_recording(tasks.BoxCarrying(), heading_rad=HEADING, origin=ORIGIN)
    turn = Rotation.from_euler("z", HEADING)
    for segment in here.motion.segments:
        assert there.position(segment) == pytest.approx(
            ORIGIN + turn.apply(np.array(here.position(segment))), abs=1e-12
        )
        assert (_rotation(there, segment).inv() * turn * _rotation(here, segment)).magnitude().max() < 1e-12
    for at in range(6):
        assert there.recording.position[:, at] == pytest.approx(
            ORIGIN + turn.apply(np.array(here.recording.position[:, at])), abs=1e-12
        )


def test_rate_is_free() -> None:
    slow, fast = operator_recording(tasks.Clapping(), rate_hz=45.0), take("clap")
    assert slow.recording.rate_hz == pytest.approx(45.0)
    assert slow.hand_point["Left"] == pytest.approx(fast.hand_point["Left"][::2], abs=1e-12)
