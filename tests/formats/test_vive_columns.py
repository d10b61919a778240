"""The columns file: what it can say, and one clear line for each way in which it is wrong."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from retarget.core.errors import UsageError
from retarget.formats import _vive_columns
from scipy.spatial.transform import Rotation

from tests.formats.tracker_logs import POSE, in_house, read, text, wandering

TIME = np.arange(20) / 100
POSES, OTHER = wandering(20, about=(0.1, 0.6, 1.2)), wandering(20, seed=1)
CHEST = {part: place for place, part in enumerate(POSE, 1)}
BARE = text(POSE, POSES.tolist()).split("\n", 1)[1]


def test_headerless_columns_by_number(tmp_path: Path) -> None:
    """xyzw quaternions of the second tracker, in millimetres: what only the file can say."""
    rows = np.hstack([POSES, OTHER[:, :3] * 1000, OTHER[:, [4, 5, 6, 3]]])
    path = tmp_path / "columns.toml"
    path.write_text(
        """
        skip_lines = 2
        header = false
        delimiter = "space"
        rate_hz = 50
        up = "z"
        trackers.chest = { x = 1, y = 2, z = 3, qw = 4, qx = 5, qy = 6, qz = 7 }
        [trackers."LHR-1"]
        x = 8
        y = 9
        z = 10
        unit = "mm"
        qx = 11
        qy = 12
        qz = 13
        qw = 14
        [roles]
        "LHR-1" = "left_hand"
        "LHR-2" = "right_hand"
        """
    )
    content = text(["any", "words"], [["", ""], *rows.tolist()], delimiter=" ")
    found = read(content, up=None, columns=path)
    np.testing.assert_allclose(found.position, np.stack([POSES[:, :3], OTHER[:, :3]], axis=1), atol=1e-12)
    np.testing.assert_allclose(np.abs(np.einsum("ti,ti->t", found.orientation[:, 1], OTHER[:, 3:])), 1, atol=1e-12)
    assert found.rate_hz == pytest.approx(50)
    assert dict(found.segments) == {"chest": "T8", "LHR-1": "LeftHand"}
    assert found.source.warnings == ()
    # The command line's word goes before the file's.
    np.testing.assert_allclose(read(content, up="y", columns=path).position[:, 0], in_house(POSES[:, :3]), atol=1e-12)


def test_named_columns_with_validity_and_time() -> None:
    names = ["stamp", *(f"a{i}" for i in range(7)), "good", "covered"]
    rows = [
        [repr(1000 * float(t)), *POSES[i], "0" if i == 3 else "1", "yes" if i == 7 else "no"]
        for i, t in enumerate(TIME)
    ]
    columns = {
        "time": "stamp",
        "time_unit": "ms",
        "trackers": {
            "tip": {part: f"a{i}" for i, part in enumerate(POSE)}
            | {"valid": ["good"], "lost": 10, "role": "right_hand"}
        },
    }
    found = read(text(names, rows), columns=columns)
    np.testing.assert_allclose(found.time, TIME, atol=1e-12)
    assert np.flatnonzero(~found.tracked[:, 0]).tolist() == [3, 7]
    assert dict(found.segments) == {"tip": "RightHand"}


def test_long_form() -> None:
    rows = [
        [repr(float(t)), name, *values[i]] for i, t in enumerate(TIME) for name, values in (("A", POSES), ("B", OTHER))
    ]
    columns = {"time": 1, "device": "who", "columns": {part: i + 3 for i, part in enumerate(POSE)}}
    found = read(text(["when", "who", *"abcdefg"], rows), columns=columns)
    assert found.trackers == ("A", "B")
    np.testing.assert_array_equal(found.position[:, 1], in_house(OTHER[:, :3]))


def test_left_handed_file() -> None:
    mirrored = POSES * [1, 1, -1, 1, -1, -1, 1]
    columns = {"header": False, "rate_hz": 100, "handedness": "left", "trackers": {"chest": CHEST}}
    found = read(text(POSE, mirrored.tolist()).split("\n", 1)[1], columns=columns)
    np.testing.assert_array_equal(found.position[:, 0], in_house(POSES[:, :3]))
    expected = Rotation.from_matrix([[0, 0, -1], [-1, 0, 0], [0, 1, 0]]) * Rotation.from_quat(POSES[:, [4, 5, 6, 3]])
    assert (Rotation.from_quat(found.orientation[:, 0, [1, 2, 3, 0]]) * expected.inv()).magnitude().max() < 1e-12


def test_the_example_of_the_documentation_and_of_the_messages_work(tmp_path: Path) -> None:
    import tomllib

    shown = (_vive_columns.__doc__ or "").split("```toml\n")[1].split("```")[0]
    checked = _vive_columns.read_columns(tomllib.loads(shown))
    assert checked.poses["chest"]["lost"] == "chest_occluded"
    path = tmp_path / "columns.toml"
    path.write_text("\n".join(part for part in _vive_columns.EXAMPLE.split("'") if "=" in part))
    assert read(BARE, columns=path).frames == 20
    path.write_text("\n".join(part for part in _vive_columns.EXAMPLE_NAMED.split("'") if "=" in part))
    names = ["stamp", "px", "py", "pz", "o4", "o1", "o2", "o3"]
    assert read(text(names, np.hstack([TIME[:, None], POSES]).tolist()), columns=path).frames == 20


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rate": 90}, "unknown key 'rate'; did you mean rate_hz"),
        ({"trackers": {"chest": CHEST | {"quat_w": 4}}}, r"unknown key in \[trackers.chest\] 'quat_w'; did you mean"),
        ({"trackers": {}}, r"no table \[trackers.<name>\]; expected lines such as 'header = false'"),
        ({"trackers": {"chest": {"x": 1, "y": 2}}}, r"\[trackers.chest\] has no z"),
        (
            {"trackers": {"chest": {"x": 1, "y": 2, "z": 3, "qx": 4}}},
            "has only qx; expected qw, qx, qy and qz, or none",
        ),
        ({"trackers": {"chest": CHEST | {"unit": "inch"}}}, "unit = 'inch'; expected m, cm or mm"),
        ({"trackers": {"chest": CHEST | {"unit": ["mm"]}}}, r"unit = \['mm'\]; expected m, cm or mm"),
        ({"trackers": {"chest": CHEST | {"valid": [None]}}}, "chest.valid = None; expected a column's name or number"),
        ({"trackers": {"chest": CHEST | {"role": 3}}}, "role = 3; expected a role or segment in quotes"),
        ({"trackers": {"chest": CHEST | {"x": 8}}}, "chest.x = 8; the log has columns 1 to 7"),
        ({"trackers": {"chest": CHEST | {"x": 0}}}, "chest.x = 0; the log has columns 1 to 7"),
        (
            {"trackers": {"chest": CHEST | {"x": "px"}}},
            "chest.x = 'px', but header = false; expected a column's number",
        ),
        ({"trackers": {"chest": CHEST | {"x": 1.5}}}, "chest.x = 1.5; expected a column's name or number"),
        ({"device": 1}, r"\[trackers\] beside device; expected \[columns\]"),
        ({"delimiter": "pipe"}, "delimiter = 'pipe'; expected comma, semicolon, tab, space or one character"),
        ({"skip_lines": -1}, "skip_lines = -1; expected a whole number"),
        ({"header": "none"}, "header = 'none'; expected true or false"),
        ({"rate_hz": 0}, "rate_hz = 0; expected a positive number"),
        ({"up": "x"}, "up = 'x'; expected y or z"),
        ({"handedness": 1}, "handedness = 1; expected right or left"),
        ({"time_unit": "h"}, "time_unit = 'h'; expected s, ms, us or ns"),
        ({"roles": ["chest"]}, r"\[roles\]; expected lines such as"),
    ],
)
def test_one_line_for_each_mistake(change: dict[str, Any], message: str) -> None:
    columns = {"header": False, "rate_hz": 100, "trackers": {"chest": CHEST}} | change
    with pytest.raises(UsageError, match=message) as caught:
        read(BARE, columns=columns)
    assert "\n" not in str(caught.value)


def test_an_unknown_column_names_the_nearest() -> None:
    columns = {"rate_hz": 100, "trackers": {"chest": CHEST | {"x": "chest_pox"}}}
    names = ["chest_pos", *POSE[1:]]
    with pytest.raises(UsageError, match=r"columns, chest\.x: unknown column 'chest_pox'; did you mean chest_pos"):
        read(text(names, POSES.tolist()), columns=columns)


def test_a_file_that_is_not_there_and_one_that_is_no_toml(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="columns file can't be read: no such file"):
        read(BARE, columns=tmp_path / "none.toml")
    path = tmp_path / "columns.toml"
    path.write_text("x = = 1")
    with pytest.raises(UsageError, match="no valid TOML"):
        read(BARE, columns=path)
