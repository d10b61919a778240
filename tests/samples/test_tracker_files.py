"""The committed tracker logs, read by NumPy and SciPy alone, against the JSON beside them; and the world they are written in."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from functools import cache
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from retarget.core.types import TrackerRecording
from retarget.samples import generate, sample_path, tasks, tracker_csv
from retarget.samples.takes import operator_recording
from scipy.spatial.transform import Rotation

NAMES = sorted(generate.TRACKER_SAMPLES)
CLEAN = [name for name in NAMES if name != "calibration_serials"]
SIDES = ("Left", "Right")
FROM_OPENVR = np.array([[0, 0, -1], [-1, 0, 0], [0, 1, 0]])
"""(x, y, z) → (−z, −x, y)."""


class Log:
    """A log in the house's world: columns by name, poses by segment."""

    def __init__(self, content: bytes, truth: dict[str, Any]) -> None:
        self.header = content.decode().splitlines()[0].split(",")
        self.rows = np.loadtxt(io.BytesIO(content), delimiter=",", skiprows=1)
        self.name_of = dict(zip(truth["segments"], truth["trackers"], strict=True))

    def column(self, name: str) -> np.ndarray:
        return self.rows[:, self.header.index(name)]

    def _columns(self, segment: str, *fields: str) -> np.ndarray:
        return np.stack([self.column(f"{self.name_of[segment]}_{field}") for field in fields], axis=-1)

    def position(self, segment: str) -> np.ndarray:
        return self._columns(segment, "x_m", "y_m", "z_m") @ FROM_OPENVR.T

    def rotation(self, segment: str) -> Rotation:
        return Rotation.from_matrix(FROM_OPENVR) * Rotation.from_quat(self._columns(segment, "qx", "qy", "qz", "qw"))

    def valid(self, segment: str) -> np.ndarray:
        return self._columns(segment, "valid")[:, 0]


@cache
def truth(name: str) -> dict[str, Any]:
    loaded: dict[str, Any] = json.loads(sample_path(name).with_name(f"{name}.json").read_text())
    return loaded


@cache
def log(name: str) -> Log:
    return Log(sample_path(name).read_bytes(), truth(name))


def _wxyz(values: list[float]) -> Rotation:
    return Rotation.from_quat(np.array(values)[[1, 2, 3, 0]])


@pytest.fixture(scope="module")
def fresh(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("trackers")
    generate.write_trackers(folder)
    return folder


@pytest.mark.parametrize("name", NAMES)
def test_generator_reproduces_the_committed_files(name: str, fresh: Path) -> None:
    committed = sample_path(name)
    assert committed.suffix == ".csv"
    assert (fresh / f"{name}.csv").read_bytes() == committed.read_bytes()
    assert (fresh / f"{name}.json").read_bytes() == committed.with_suffix(".json").read_bytes()


def test_files_are_small() -> None:
    assert sum(path.stat().st_size for name in NAMES for path in sample_path(name).parent.glob(f"{name}.*")) < 3e6


@pytest.mark.parametrize("name", NAMES)
def test_every_column_is_named_once_and_every_number_is_there(name: str) -> None:
    content, expected = log(name), truth(name)
    fields = ("x_m", "y_m", "z_m", "qw", "qx", "qy", "qz", "valid")
    assert content.header == ["time_s", *(f"{tracker}_{field}" for tracker in expected["trackers"] for field in fields)]
    assert content.rows.shape == (expected["frames"], 1 + 6 * 8)
    assert np.isfinite(content.rows).all()
    assert content.column("time_s") == pytest.approx(np.arange(expected["frames"]) / 90, abs=1e-6)
    assert "synthetic" in expected
    for segment in expected["segments"]:
        quaternion = content._columns(segment, "qw", "qx", "qy", "qz")
        assert np.linalg.norm(quaternion, axis=1) == pytest.approx(1, abs=2e-7)
        assert (quaternion[:, 0] >= 0).all()


def test_trackers_go_by_role_or_by_serial_number() -> None:
    assert truth("box_trackers")["trackers"] == [
        "chest",
        "head",
        "left_upper_arm",
        "right_upper_arm",
        "left_hand",
        "right_hand",
    ]
    serials = truth("calibration_serials")["trackers"]
    assert all(name.startswith("LHR-") for name in serials)
    assert truth("calibration_serials")["segments"] != truth("box_trackers")["segments"]


@pytest.mark.parametrize("name", CLEAN)
def test_hand_points_and_segments_are_the_true_ones(name: str) -> None:
    content, expected = log(name), truth(name)
    for frame in expected["selected"]:
        at = frame["frame"]
        for side in SIDES:
            tracker = f"{side}Hand"
            offset = content.rotation(tracker)[at].apply(expected["hand_offset_m"][side])
            assert content.position(tracker)[at] + offset == pytest.approx(frame["hand_point_m"][side], abs=1e-6)
        for segment, orientation in frame["orientation"].items():
            found = content.rotation(segment)[at] * _wxyz(expected["tracker_rotation"][segment])
            assert (found.inv() * _wxyz(orientation)).magnitude() < 5e-7
        chest = content.position("T8")[at] - _wxyz(frame["orientation"]["T8"]).apply(
            expected["tracker_position_m"]["T8"]
        )
        assert chest == pytest.approx(frame["t8_m"], abs=1e-6)
        for side in SIDES:
            shoulder = chest + _wxyz(frame["orientation"]["T8"]).apply(expected["shoulder_in_chest_m"][side])
            assert shoulder == pytest.approx(frame["shoulder_m"][side], abs=1e-6)
            bone = _wxyz(frame["orientation"][f"{side}UpperArm"]).apply([0, 1 if side == "Left" else -1, 0])
            elbow = np.array(frame["shoulder_m"][side]) + expected["bones_m"]["upper_arm"] * bone
            assert elbow == pytest.approx(frame["elbow_m"][side], abs=1e-7)


@pytest.mark.parametrize(("name", "tolerance"), [("calibration_trackers", 2e-6), ("calibration_serials", 1e-3)])
def test_calibrating_by_hand_finds_what_the_json_says(name: str, tolerance: float) -> None:
    """[Lim2022 eq. 1] on window averages, the chest's motion since the Still pose undone.

    Noise of 0.5 mm, and of 2 mrad at the chest with hands 0.9 m away, averages out over 145 frames to some 0.2 mm.
    """
    content, expected = log(name), truth(name)
    time = content.column("time_s")
    windows = [(time >= start) & (time <= end) for start, end in expected["windows_s"].values()]
    chest = content.rotation("T8")
    yaw = Rotation.from_euler("z", -expected["heading_rad"])
    at_still = windows[0] & (content.valid("T8") > 0)
    still_rotation, still_position = chest[at_still].mean(), content.position("T8")[at_still].mean(axis=0)
    for side in SIDES:
        hand, turned = content.position(f"{side}Hand"), content.rotation(f"{side}Hand")
        point = hand + turned.apply(expected["hand_offset_m"][side])
        local = chest.inv().apply(point - content.position("T8"))
        poses = np.array([still_position + still_rotation.apply(local[window].mean(axis=0)) for window in windows])
        poses = yaw.apply(poses - expected["origin_m"])
        assert poses == pytest.approx(np.array(list(expected["hand_points_m"][side].values())), abs=tolerance)
        a, b, c = poses
        normal = np.cross(b - a, c - a)
        normal /= np.linalg.norm(normal)
        rows = np.array([b - a, c - a, normal])
        center = np.linalg.solve(rows, [(b - a) @ (a + b) / 2, (c - a) @ (a + c) / 2, normal @ a])
        k = [np.sqrt((p - q) @ (p - q) / 2 - (a - center) @ (a - center)) for p, q in combinations(poses, 2)]
        assert np.ptp(k) < 0.1
        true = np.array(expected["shoulder_m"][side])
        found = min((center + sign * np.mean(k) * normal for sign in (1, -1)), key=lambda at: np.linalg.norm(at - true))
        assert np.linalg.norm(found - true) < 2 * tolerance
        assert np.linalg.norm(poses - found, axis=1) == pytest.approx(expected["arm_length_m"], abs=2 * tolerance)


@pytest.mark.parametrize("side", SIDES)
def test_the_logged_circles_become_round_in_the_axes_of_the_poses(side: str) -> None:
    content, expected = log("circles_trackers"), truth("circles_trackers")
    time = content.column("time_s")
    start, end = expected["windows_s"]["circles"]
    frames = (time >= start) & (time <= end)
    chest = content.rotation("T8") * _wxyz(expected["tracker_rotation"]["T8"])
    origin = content.position("T8") - chest.apply(expected["tracker_position_m"]["T8"])
    hand = content.rotation(f"{side}Hand").apply(expected["hand_offset_m"][side]) + content.position(f"{side}Hand")
    drawn = (chest.inv().apply(hand - origin) - expected["shoulder_in_chest_m"][side])[frames]
    circle = expected["circles"]
    meant = np.linalg.solve(circle["drawn_from_meant"][side], drawn.T).T - circle["center_from_shoulder_m"][side]
    assert np.linalg.norm(meant, axis=1) == pytest.approx(circle["diameter_m"] / 2, abs=2e-6)
    assert np.abs(meant[:, 0]).max() < 2e-6


def test_faults_of_the_serial_log_are_marked_where_a_log_marks_them() -> None:
    content, expected = log("calibration_serials"), truth("calibration_serials")
    time = content.column("time_s")
    lost = {"RightHand": (2.60, 2.75), "Head": (10.0, 10.2)}
    for segment in expected["segments"]:
        start, end = lost.get(segment, (0.0, 0.0))
        out = (time > start - 5e-7) & (time < end - 5e-7)
        assert (content.valid(segment) == ~out).all()
        assert expected["untracked_frames"][content.name_of[segment]] == out.sum()
        if segment in lost:
            assert np.ptp(content.position(segment)[out], axis=0).max() == 0
    repeated = (np.diff(content.rows[:, 1:], axis=0) == 0).all(axis=1)
    assert 10 < repeated.sum() < 60
    gap = content.position("T8") - log("calibration_trackers").position("T8")
    assert 0.0004 < np.std(gap) < 0.0007


def _one_tracker(position: np.ndarray, quaternion: list[float]) -> TrackerRecording:
    count = len(position)
    return TrackerRecording(
        time=np.arange(count) / 90,
        trackers=("chest",),
        orientation=np.broadcast_to(quaternion, (count, 1, 4)).copy(),
        position=position[:, None],
        tracked=np.ones((count, 1), bool),
    )


def test_known_directions_in_openvr() -> None:
    """Forward is −Z, left is −X, up is Y; a tracker whose axes are the house's has OpenVR's −Z as its X."""
    recording = _one_tracker(np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0]]), [1.0, 0, 0, 0])
    rows = np.loadtxt(io.BytesIO(tracker_csv.write(recording)), delimiter=",", skiprows=1)
    assert rows[:, 1:4].tolist() == [[0, 0, -1], [-1, 0, 0], [0, 1, 0]]
    turned = Rotation.from_quat(rows[:, [5, 6, 7, 4]])
    assert turned.apply([1, 0, 0]) == pytest.approx(np.tile([0, 0, -1], (3, 1)), abs=1e-6)
    assert turned.apply([0, 0, 1]) == pytest.approx(np.tile([0, 1, 0], (3, 1)), abs=1e-6)


def test_right_hand_moving_right_moves_along_openvr_x() -> None:
    done = operator_recording(tasks.Calibration())
    rows = Log(tracker_csv.write(done.recording), {"segments": ["RightHand"], "trackers": ["right_hand"]})
    start, end = 2 * 90, 4 * 90
    assert done.hand_point["Right"][end, 1] - done.hand_point["Right"][start, 1] < -0.4
    assert rows.column("right_hand_x_m")[end] - rows.column("right_hand_x_m")[start] > 0.4
    assert rows.column("right_hand_y_m")[end] - rows.column("right_hand_y_m")[start] > 0.5
    assert abs(rows.column("right_hand_z_m")[end] - rows.column("right_hand_z_m")[start]) < 0.1
    # The floor stays at height zero.
    assert 0.7 < rows.column("right_hand_y_m").min() < rows.column("right_hand_y_m").max() < 1.6


def test_lost_poses_can_be_left_out() -> None:
    recording = replace(
        _one_tracker(np.zeros((2, 3)), [1.0, 0, 0, 0]), tracked=np.array([[True], [False]]), position=np.ones((2, 1, 3))
    )
    _, first, second = tracker_csv.write(recording, lost="empty").decode().splitlines()
    assert first.endswith(",1")
    assert second == "0.011111,,,,,,,,0"
    assert tracker_csv.write(recording).decode().splitlines()[2].startswith("0.011111,-1.0000000,1.0000000,-1.0000000,")


def test_text_of_a_row() -> None:
    recording = _one_tracker(np.array([[0.25, -0.0000000001, 1.5]]), [-1.0, 0, 0, 0])
    header, row = tracker_csv.write(recording).decode().splitlines()
    assert header == "time_s,chest_x_m,chest_y_m,chest_z_m,chest_qw,chest_qx,chest_qy,chest_qz,chest_valid"
    # By hand: the matrix with rows (0, −1, 0), (0, 0, 1), (−1, 0, 0) is the quaternion (1, −1, 1, 1)/2.
    assert row == "0.000000,0.0000000,1.5000000,-0.2500000,0.5000000,-0.5000000,0.5000000,0.5000000,1"
