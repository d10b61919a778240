"""Tracker logs in columns: both forms, the spellings of names, units, times, and the house's world, against hand-written values and SciPy."""

from __future__ import annotations

import io
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from retarget import formats
from retarget.core.errors import FormatError, UnknownNameError, UsageError
from retarget.core.types import JointTrajectory, TrackerRecording
from retarget.formats import TrackerOptions
from scipy.spatial.transform import Rotation

from tests.formats.tracker_logs import POSE, in_house, poses, read, rotation, text, wandering, wide, wxyz

FRAMES = 40
TIME = np.arange(FRAMES) / 100
POSES = wandering(FRAMES)


def one_tracker(names: list[str], values: np.ndarray = POSES, **how: str) -> str:
    return text(["time_s", *names], np.hstack([TIME[:, None], values]).tolist(), **how)


def assert_is(recording: TrackerRecording, values: np.ndarray = POSES, column: int = 0) -> None:
    np.testing.assert_array_equal(recording.position[:, column], in_house(values[:, :3]))
    turned = Rotation.from_matrix([[0, 0, -1], [-1, 0, 0], [0, 1, 0]]) * rotation(values[:, 3:])
    assert (turned * rotation(recording.orientation[:, column]).inv()).magnitude().max() < 1e-12


def test_wide_form() -> None:
    other = wandering(FRAMES, seed=1)
    found = read(wide(TIME, waist=POSES, **{"LHR-1234ABCD": other}))
    assert found.trackers == ("waist", "LHR-1234ABCD")
    assert dict(found.segments) == {"waist": "Pelvis"}
    np.testing.assert_array_equal(found.time, TIME)
    assert found.rate_hz == pytest.approx(100)
    assert found.tracked.all()
    assert found.source.warnings == ()
    assert_is(found, POSES, 0)
    assert_is(found, other, 1)


@pytest.mark.parametrize("together", [True, False])
def test_long_form(together: bool) -> None:
    """Rows of both trackers by turns, or one tracker after the other."""
    trackers = {"left_hand": POSES, "LHR-7": wandering(FRAMES, seed=1)}
    rows = [[str(TIME[t]), name, *trackers[name][t]] for t in range(FRAMES) for name in trackers]
    if not together:
        rows.sort(key=lambda row: row[1])
    found = read(text(["timestamp", "serial", *POSE], rows))
    assert set(found.trackers) == set(trackers)
    assert dict(found.segments) == {"left_hand": "LeftHand"}
    assert found.source.configuration == "long"
    for name, values in trackers.items():
        assert_is(found, values, found.index(name))


def test_a_role_column_beside_serials() -> None:
    rows = [
        [str(t), serial, role, *POSES[t]]
        for t in range(3)
        for serial, role in (("LHR-1", "TrackerRole_Chest"), ("LHR-2", "left_elbow"))
    ]
    found = read(text(["time", "serial", "role", *POSE], rows))
    assert dict(found.segments) == {"LHR-1": "T8", "LHR-2": "LeftUpperArm"}


@pytest.mark.parametrize(
    ("names", "tracker"),
    [
        (
            ["left_hand.pos.x", "left_hand.pos.y", "left_hand.pos.z", *(f"left_hand.rot.{c}" for c in "wxyz")],
            "left_hand",
        ),
        ([f"LHR-1234_{c}" for c in POSE], "LHR-1234"),
        ([f"chest/position/{c} [m]" for c in "xyz"] + [f"chest/orientation/{c}" for c in "wxyz"], "chest"),
        ([f"HeadPos{c}" for c in "XYZ"] + [f"HeadRot{c}" for c in "WXYZ"], "Head"),
        ([f"pose.position.{c}" for c in "xyz"] + [f"pose.orientation.{c}" for c in "wxyz"], "tracker"),
        (["tx", "ty", "tz", "qw", "qx", "qy", "qz"], "tracker"),
        (["x", "y", "z", "w", "i", "j", "k"], "tracker"),
        ([f"tracker 1 {c}" for c in ("X", "Y", "Z", "quat_w", "quat_x", "quat_y", "quat_z")], "tracker 1"),
        ([f"/waist/pose/position/{c}" for c in "xyz"] + [f"/waist/pose/orientation/{c}" for c in "wxyz"], "waist"),
        ([f"right_hand_translation_{c}" for c in "xyz"] + [f"right_hand_quaternion_{c}" for c in "wxyz"], "right_hand"),
        ([f"l_foot_p{c}" for c in "xyz"] + [f"l_foot_q{c}" for c in "wijk"], "l_foot"),
    ],
)
def test_spellings(names: list[str], tracker: str) -> None:
    found = read(one_tracker(names))
    assert found.trackers == (tracker,)
    assert_is(found)


@pytest.mark.parametrize("order", [(3, 4, 5, 6), (4, 5, 6, 3), (6, 3, 5, 4)])
def test_quaternion_order_is_that_of_the_names(order: tuple[int, ...]) -> None:
    places = [*order, 0, 2, 1]
    assert_is(read(one_tracker([POSE[i] for i in places], POSES[:, places])))


def test_bare_letters_with_two_trackers_are_refused() -> None:
    names = ["x", "y", "z", "w", "i", "j", "k"] * 2
    with pytest.raises(
        FormatError, match=r"log, line 1.*each once; expected names such as.*--columns.*qw = 4"
    ) as caught:
        read(one_tracker(names, np.hstack([POSES, POSES])))
    assert "\n" not in str(caught.value)


def test_euler_angles_are_no_quaternion() -> None:
    with pytest.raises(FormatError, match="no header that names"):
        read(one_tracker(["x", "y", "z", "rot_x", "rot_y", "rot_z", "u"]))


def test_numbers_without_header_are_refused_with_an_example() -> None:
    with pytest.raises(
        FormatError, match=r"starts with numbers, without a header.*'header = false'.*trackers\.chest"
    ) as caught:
        read("\n".join(one_tracker(["a"] * 7).split("\n")[1:]))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("unit", ["_mm", " [mm]", "(mm)", "_cm"])
def test_units_in_names(unit: str) -> None:
    factor = 100 if "cm" in unit else 1000
    values = np.hstack([POSES[:, :3] * factor, POSES[:, 3:]])
    found = read(
        one_tracker([f"waist_x{unit}", f"waist_y{unit}", f"waist_z{unit}", *(f"waist_{c}" for c in POSE[3:])], values)
    )
    np.testing.assert_allclose(found.position[:, 0], in_house(POSES[:, :3]), rtol=1e-14)


def test_unknown_unit_is_refused() -> None:
    with pytest.raises(FormatError, match="no header that names"):
        read(one_tracker(["x [inch]", "y [inch]", "z [inch]", *POSE[3:]]))


@pytest.mark.parametrize(
    ("delimiter", "end"), [(",", "\n"), (";", "\r\n"), ("\t", "\n"), (" ", "\r"), (", ", "\n"), (",", ",\n")]
)
def test_separators_and_line_ends(delimiter: str, end: str) -> None:
    assert_is(read(one_tracker(list(POSE), delimiter=delimiter, end=end)))


def test_decimal_commas_between_semicolons() -> None:
    assert_is(read(one_tracker(list(POSE), delimiter=";").replace(".", ",")))


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-8"])
def test_byte_order_marks(encoding: str) -> None:
    assert_is(read(one_tracker(list(POSE)).encode(encoding)))


def test_quotes_comments_and_free_text_before_the_header() -> None:
    content = one_tracker([f'"{name}"' for name in POSE]).replace("\n", "\n# lighthouse moved\n\n", 3)
    assert_is(read("recorded with x y z, 100 Hz; trial 3\n# waist\n\n" + content))
    assert_is(read("# " + one_tracker(list(POSE), delimiter=" ")))


@pytest.mark.parametrize(
    ("name", "per_s"),
    [
        ("time", 1),
        ("t", 1),
        ("Time [s]", 1),
        ("time_ms", 1e3),
        ("timestamp (us)", 1e6),
        ("stamp_ns", 1e9),
        ("elapsed_s", 1),
    ],
)
def test_times(name: str, per_s: float) -> None:
    rows = np.hstack([np.round(TIME[:, None] * per_s, 6), POSES])
    found = read(text([name, *POSE], rows.tolist()))
    np.testing.assert_allclose(found.time, TIME, atol=1e-12)


@pytest.mark.parametrize("zone", ["Z", "+00:00", "", "+09:00"])
def test_calendar_times_count_from_the_first(zone: str) -> None:
    start = datetime(2026, 5, 23, 23, 59, 59, 990000, tzinfo=UTC)
    stamps = [(start + timedelta(seconds=float(t))).strftime("%Y-%m-%dT%H:%M:%S.%f") + zone for t in TIME]
    found = read(text(["timestamp_utc", *POSE], [[stamp, *pose] for stamp, pose in zip(stamps, POSES, strict=True)]))
    np.testing.assert_allclose(found.time, TIME, atol=1e-9)


def test_unix_times_count_from_the_first() -> None:
    rows = np.hstack([1.7e9 + TIME[:, None], POSES]).tolist()
    np.testing.assert_allclose(read(text(["time", *POSE], rows)).time, TIME, atol=1e-6)


def test_milliseconds_that_claim_nothing_are_refused() -> None:
    rows = np.hstack([TIME[:, None] * 1000, POSES]).tolist()
    with pytest.raises(
        FormatError, match=r"rows come every 10 in column 'time', which is unlikely in seconds.*time_ms"
    ):
        read(text(["time", *POSE], rows))


def test_rate_in_place_of_times() -> None:
    content = text(POSE, POSES.tolist())
    with pytest.raises(FormatError, match=r"no time column among x, y, z.*--rate 90"):
        read(content)
    found = read(content, rate_hz=50)
    np.testing.assert_allclose(found.time, np.arange(FRAMES) / 50)
    assert_is(found)
    assert any(
        "the rate 50 Hz is not used" in line for line in read(wide(TIME, waist=POSES), rate_hz=50).source.warnings
    )


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("valid", ("1", "0")),
        ("waist_tracked", ("true", "False")),
        ("waist.isTracked", ("TRUE", "FALSE")),
        ("tracking_result", ("200", "201")),
        ("status", ("ok", "lost")),
        ("waist_lost", ("0", "1")),
        ("pose_valid", ("1.0", "")),
    ],
)
def test_validity_columns(name: str, words: tuple[str, str]) -> None:
    values = POSES.copy()
    values[10:13] = 77.0
    rows = [[str(t), *values[i], words[1] if 10 <= i < 13 else words[0]] for i, t in enumerate(TIME)]
    found = read(text(["time_s", *(f"waist_{part}" for part in POSE), name], rows))
    assert found.tracked[:, 0].tolist() == [not 10 <= i < 13 for i in range(FRAMES)]
    expected = np.linspace(POSES[9, :3], POSES[13, :3], 5)[1:-1]
    np.testing.assert_allclose(found.position[10:13, 0], in_house(expected), atol=1e-12)
    assert any("waist: 3 rows marked as not tracked" in line for line in found.source.warnings)


def test_a_word_that_is_neither_valid_nor_lost_is_named() -> None:
    rows = [[str(t), *POSES[i], "maybe" if i == 4 else "1"] for i, t in enumerate(TIME)]
    with pytest.raises(FormatError, match=r"log, line 6: 'maybe' in column 'valid' says neither"):
        read(text(["time_s", *POSE, "valid"], rows))


def test_velocities_and_other_columns_are_left_out_with_a_note() -> None:
    names = [
        "time_s",
        *(f"chest_{part}" for part in POSE),
        "chest_vx",
        "chest_vel_x",
        "battery",
        "target_x",
        "target_y",
        "target_z",
    ]
    found = read(text(names, np.hstack([TIME[:, None], POSES, np.ones((FRAMES, 6))]).tolist()))
    assert found.trackers == ("chest",)
    assert found.source.warnings == ("columns not used: chest_vx, chest_vel_x, battery, target_x, target_y, target_z",)


def test_a_cell_that_is_no_number_is_named() -> None:
    content = wide(TIME, waist=POSES).split("\n")
    cells = content[7].split(",")
    content[7] = ",".join([*cells[:3], "1.2.3", *cells[4:]])
    with pytest.raises(FormatError, match=r"log, line 8: '1\.2\.3' in column 'waist_z' is no number"):
        read("\n".join(content))


def test_a_line_of_other_length_is_named_and_a_last_one_cut_short_left_out() -> None:
    content = wide(TIME, waist=POSES)
    lines = content.split("\n")
    with pytest.raises(FormatError, match=r"log, line 5: 9 cells; expected 8"):
        read("\n".join([*lines[:4], lines[4] + ",1", *lines[5:]]))
    cut = read(content[: content.rindex(",") - 30])
    assert cut.frames == FRAMES - 1
    assert cut.source.warnings == (f"line {FRAMES + 1} is cut short and left out",)


@pytest.mark.parametrize("content", ["", "\n\n", "time_s,x,y,z,qw,qx,qy,qz\n", "\0\1\2", "hello"])
def test_nothing_to_read(content: str) -> None:
    with pytest.raises(FormatError, match="log"):
        read(content)


def test_through_a_path_the_suffix_and_the_content_decide(tmp_path: Path) -> None:
    path = tmp_path / "trackers.csv"
    path.write_text(wide(TIME, waist=POSES))
    assert_is(formats.read_trackers(path, options=TrackerOptions(up="y")))
    facts = formats.describe(path)
    assert (facts["format"], facts["kind"], facts["trackers"], facts["frames"]) == (
        "vive",
        "trackers",
        ["waist"],
        FRAMES,
    )
    with pytest.raises(UsageError, match="vive holds poses of trackers, not recorded motion"):
        formats.read_motion(path)
    with pytest.raises(UsageError, match="vive holds poses of trackers, not a robot trajectory"):
        formats.read_trajectory(path)


def test_trajectories_are_no_tracker_logs(tmp_path: Path, make_trajectory: Callable[..., JointTrajectory]) -> None:
    path = tmp_path / "robot.csv"
    formats.write_trajectory(path, make_trajectory())
    assert formats.describe(path)["kind"] == "trajectory"
    with pytest.raises(
        UsageError,
        match="csv holds robot trajectories, not poses of trackers; expected one of libsurvive, mcap, rosbag, vive",
    ):
        formats.read_trackers(path)


def test_facts() -> None:
    values = POSES.copy()
    values[5, 3:] *= 0.5
    content = wide(TIME, waist=values, **{"LHR-2": POSES})
    found = formats.describe(io.BytesIO(content.encode()), "log", "vive", TrackerOptions(up="y"))
    assert found["rate_hz"] == pytest.approx(100)
    assert found["duration_s"] == pytest.approx(0.39)
    assert found["segments"] == {"waist": "Pelvis"}
    assert found["bad_quaternions"] == 1
    assert found["gaps"] == [
        {"tracker": "waist", "start_s": pytest.approx(0.04), "duration_s": pytest.approx(0.02), "frames": 1}
    ]


@pytest.mark.parametrize("options", [{"up": "x"}, {"rate_hz": 0.0}, {"rate_hz": float("nan")}, {"handedness": "l"}])
def test_options_that_are_none(options: dict[str, object]) -> None:
    with pytest.raises(UsageError, match="expected"):
        TrackerOptions(**options)


def test_roles_of_the_user_go_first() -> None:
    content = wide(TIME, waist=POSES, **{"LHR-2": POSES, "LHR-3": POSES})
    found = read(content, roles={"LHR-2": "waist", "LHR-3": "LeftUpperArm"})
    assert dict(found.segments) == {"LHR-2": "Pelvis", "LHR-3": "LeftUpperArm"}
    assert dict(read(content, roles={"waist": "none"}).segments) == {}
    with pytest.raises(
        UnknownNameError, match=r"roles, tracker 'LHR-2': unknown role 'left_elbo'; did you mean left_elbow"
    ):
        read(content, roles={"LHR-2": "left_elbo"})
    with pytest.raises(UnknownNameError, match=r"roles: unknown tracker 'LHR-9'; did you mean LHR-"):
        read(content, roles={"LHR-9": "chest"})
    with pytest.raises(UsageError, match="both 'LHR-2' and 'LHR-3' are T8"):
        read(content, roles={"LHR-2": "chest", "LHR-3": "T8"})


def test_a_person_turning_left_yaws_left() -> None:
    """About OpenVR's Y, which points up, a positive angle is a turn to the left."""
    angle = np.linspace(0, np.pi / 2, FRAMES)
    mounted = Rotation.from_euler("xyz", [20, -70, 130], degrees=True)
    turned = Rotation.from_euler("y", angle[:, None]) * mounted
    found = read(wide(TIME, chest=poses(np.zeros((FRAMES, 3)), turned)))
    relative = rotation(found.orientation[:, 0]) * rotation(found.orientation[0, 0]).inv()
    np.testing.assert_allclose(relative.as_rotvec(), np.outer(angle, [0, 0, 1]), atol=1e-12)


@pytest.mark.parametrize(
    ("moved", "expected"),
    [([1, 0, 0], [0, -1, 0]), ([0, 1, 0], [0, 0, 1]), ([0, 0, -1], [1, 0, 0])],
    ids=["right", "up", "forward"],
)
def test_a_hand_that_moves(moved: list[float], expected: list[float]) -> None:
    found = read(wide(TIME, right_hand=poses(np.outer(TIME, moved))))
    np.testing.assert_allclose(found.position[:, 0], np.outer(TIME, expected), atol=1e-15)


def test_a_vector_fixed_in_the_tracker_is_seen_alike_from_both_worlds() -> None:
    """A point on the tracker, p + R v: first taken in OpenVR's world and then renamed, or taken in the house."""
    point = np.array([0.1, -0.2, 0.3])
    found = read(wide(TIME, chest=POSES))
    outside = in_house(POSES[:, :3] + rotation(POSES[:, 3:]).apply(point))
    inside = found.position[:, 0] + rotation(found.orientation[:, 0]).apply(point)
    np.testing.assert_allclose(inside, outside, atol=1e-12)


def test_z_up_is_the_house_already() -> None:
    found = read(wide(TIME, chest=POSES), up="z")
    np.testing.assert_array_equal(found.position[:, 0], POSES[:, :3])
    assert (rotation(found.orientation[:, 0]) * rotation(POSES[:, 3:]).inv()).magnitude().max() < 1e-12


@pytest.mark.parametrize(("up", "flip"), [("y", [1, 1, -1]), ("z", [1, -1, 1])])
def test_left_handed_worlds_are_mirrored(up: str, flip: list[int]) -> None:
    """The same scene in a world with one axis mirrored, as Unity (Y up) and Unreal (Z up) have it: S p and S R S."""
    mirror = np.diag(flip).astype(float)
    mirrored = poses(POSES[:, :3] @ mirror, Rotation.from_matrix(mirror @ rotation(POSES[:, 3:]).as_matrix() @ mirror))
    found = read(wide(TIME, chest=mirrored), up=up, handedness="left")
    expected = read(wide(TIME, chest=POSES), up=up)
    np.testing.assert_allclose(found.position, expected.position, atol=1e-15)
    assert (rotation(found.orientation[:, 0]) * rotation(expected.orientation[:, 0]).inv()).magnitude().max() < 1e-12


def test_signs_of_quaternions_are_continuous() -> None:
    values = POSES.copy()
    values[::3, 3:] *= -1
    found = read(wide(TIME, chest=values))
    assert (np.einsum("ti,ti->t", found.orientation[1:, 0], found.orientation[:-1, 0]) > 0).all()
    assert_is(found)
    assert wxyz(rotation(found.orientation[:, 0])).shape == (FRAMES, 4)
