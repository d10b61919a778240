"""Real tracker logs, read through columns files, against NumPy's own reading of the same numbers.

The two logs of the robot experiment come from the same experiment but not from the same run: SteamVR's is trial 4_3, libsurvive's 1_1, and they
draw different meanders. What both have is a robot that moves two trackers through a field 0.53 m long, in a horizontal
plane, at 100 mm/s, for 27.6 and 28.1 s. So their shape is compared (length of the field, plane) and the length of the paths, of both
trackers: without jitter and jumps, as `retarget info` gives it, and, of the tracker without jumps, by a window of this file's own.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from retarget import formats
from retarget.core.errors import FormatError
from retarget.core.types import TrackerRecording
from retarget.formats import TrackerOptions
from scipy.spatial.transform import Rotation

from tests.formats.tracker_logs import Array, path_length, read, rotation

DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "vive"
COLUMNS = Path(__file__).parent / "columns"
STEAMVR = DATA / "steamvr_dynamic_20211014_4_3.txt"
LIBSURVIVE = DATA / "libsurvive_dynamic_20211014_1_1.txt"
LINK = DATA / "inha_sample_1link.csv"

RIGHT_UP = {STEAMVR: "y", LIBSURVIVE: "z"}


def read_real(path: Path, up: Any = None, columns: str = "two_trackers.toml") -> TrackerRecording:
    if not path.is_file():
        pytest.skip("the real recordings (../shared/data) are not on this machine")
    return formats.read_trackers(path, options=TrackerOptions(columns=COLUMNS / columns, up=up or RIGHT_UP.get(path)))


def smooth(position: Array, rows: int) -> Array:
    """Low-passed by a Hann window of ± `rows` rows."""
    weights = np.hanning(2 * rows + 3)[1:-1]
    return np.stack([np.convolve(axis, weights / weights.sum(), mode="valid") for axis in position.T], axis=1)


@pytest.mark.parametrize("path", [STEAMVR, LIBSURVIVE], ids=["steamvr", "libsurvive"])
def test_paths_are_as_long_as_numpy_finds_them(path: Path) -> None:
    found = read_real(path)
    numbers = np.loadtxt(path, skiprows=1)
    assert found.frames == len(numbers)
    assert found.rate_hz == pytest.approx(148.77)
    assert found.tracked.all()
    for column, first in enumerate((0, 7)):
        assert path_length(found.position[:, column]) == pytest.approx(
            path_length(numbers[:, first : first + 3]), rel=1e-12
        )
        vertical = 1 if path == STEAMVR else 2
        new = np.append(True, (np.diff(numbers[:, first : first + 7], axis=0) != 0).any(axis=1))
        np.testing.assert_array_equal(found.position[new, column, 2], numbers[new, first + vertical])


def test_orientations_are_turned_with_the_world() -> None:
    found = read_real(STEAMVR)
    quaternion = np.loadtxt(STEAMVR, skiprows=1)[:, 3:7]
    expected = Rotation.from_matrix([[0, 0, -1], [-1, 0, 0], [0, 1, 0]]) * Rotation.from_quat(
        quaternion[:, [1, 2, 3, 0]]
    )
    assert (rotation(found.orientation[:, 0]) * expected.inv()).magnitude().max() < 1e-7


def test_faults_of_the_real_logs() -> None:
    assert read_real(STEAMVR).source.warnings == ()
    assert read_real(LIBSURVIVE).source.warnings == (
        "second: 2 jumps over 30 mm between rows, at 8.839, 11.790 s: kept",
        "rows that repeat the pose before: first 63 of 4184, second 135 of 4184",
    )


@pytest.mark.parametrize("path", [STEAMVR, LIBSURVIVE], ids=["steamvr", "libsurvive"])
def test_wrong_up_warns(path: Path) -> None:
    wrong = {"y": "z", "z": "y"}[RIGHT_UP[path]]
    assert not [line for line in read_real(path).source.warnings if "up = " in line]
    (line,) = [line for line in read_real(path, wrong).source.warnings if "up = " in line]
    assert line.startswith(f"up = {wrong} is unlikely: all motion lies in a plane across {RIGHT_UP[path]}")


@pytest.mark.parametrize("rows", [22, 30, 37, 45])
def test_both_systems_measure_the_same_path_once_up_is_declared(rows: int) -> None:
    """Within 3 % for smoothing by 0.15 to 0.3 s; unsmoothed, libsurvive's jitter makes 5.03 m of what SteamVR sees as 3.08 m."""
    steamvr, libsurvive = (smooth(read_real(path).position[:, 0], rows) for path in (STEAMVR, LIBSURVIVE))
    assert path_length(libsurvive) == pytest.approx(path_length(steamvr), rel=0.03)
    horizontal = [path_length(path[:, :2]) for path in (steamvr, libsurvive)]
    assert horizontal[1] == pytest.approx(horizontal[0], rel=0.03)
    assert horizontal[0] > 0.98 * path_length(steamvr)


@pytest.mark.parametrize("tracker", ["first", "second"])
def test_info_gives_the_same_length_of_path_for_both_systems(tracker: str) -> None:
    """Within 3 % for both trackers (1.4 and 2.1 %), and near what 27.6 s at 100 mm/s make. As sampled, libsurvive's are 1.6 and 1.9 times as long."""
    steady, sampled = [], []
    for path, up in RIGHT_UP.items():
        if not path.is_file():
            pytest.skip("the real recordings (../shared/data) are not on this machine")
        options = TrackerOptions(columns=COLUMNS / "two_trackers.toml", up=up)
        facts = formats.describe(path, options=options)
        steady.append(facts["steady_path_m"][tracker])
        sampled.append(facts["path_m"][tracker])
    assert steady[1] == pytest.approx(steady[0], rel=0.03)
    assert steady[0] == pytest.approx(2.756, rel=0.03)
    assert sampled[1] > 1.5 * sampled[0]


@pytest.mark.parametrize("column", [0, 1])
def test_both_systems_measure_the_same_field(column: int) -> None:
    """0.53 m long on the floor, and flat: what the wrong vertical would turn upright."""
    steamvr, libsurvive = (
        np.ptp(smooth(read_real(path).position[:, column], 30), axis=0) for path in (STEAMVR, LIBSURVIVE)
    )
    assert libsurvive[:2].max() == pytest.approx(steamvr[:2].max(), rel=0.03)
    assert max(steamvr[2], libsurvive[2]) < 0.05


def test_the_same_trial_in_both_worlds_is_the_same_motion() -> None:
    """SteamVR's log renamed to Z up by SciPy (X right, Y forward), as libsurvive would have it: a quarter turn apart, no more."""
    found = read_real(STEAMVR)
    numbers = np.loadtxt(STEAMVR, skiprows=1)
    to_z_up = Rotation.from_euler("x", 90, degrees=True)
    for first in (0, 7):
        numbers[:, first : first + 3] = to_z_up.apply(numbers[:, first : first + 3])
        turned = (to_z_up * Rotation.from_quat(numbers[:, [first + 4, first + 5, first + 6, first + 3]])).as_quat()
        numbers[:, first + 3 : first + 7] = turned[:, [3, 0, 1, 2]]
    content = "free text\n" + "\n".join(" ".join(map(repr, row)) for row in numbers.tolist()) + "\n"
    other = read(content, up="z", columns=COLUMNS / "two_trackers.toml")
    assert other.source.warnings == ()
    quarter = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    for column in (0, 1):
        np.testing.assert_allclose(other.position[:, column], found.position[:, column] @ quarter.T, atol=1e-12)
        assert path_length(other.position[:, column]) == pytest.approx(path_length(found.position[:, column]), rel=1e-9)


def test_refused_without_a_columns_file() -> None:
    for path in (STEAMVR, LIBSURVIVE, LINK):
        if not path.is_file():
            pytest.skip("the real recordings (../shared/data) are not on this machine")
        with pytest.raises(FormatError, match=r"no header that names.*--columns.*qw = 4") as caught:
            formats.read_trackers(path)
        assert "\n" not in str(caught.value)


def test_the_link_with_calendar_times_and_millimetres() -> None:
    found = read_real(LINK, columns="flexible_link.toml")
    assert found.trackers == ("tip",)
    np.testing.assert_allclose(
        found.position[0, 0], [-0.16495597865475924, 0.21212171151031166, 0.18739515323461092], atol=1e-9
    )
    assert found.frames == 5
    assert found.source.warnings == ("the trackers have no orientation: set to the identity",)
