"""docs/profiles.md lists what the parser accepts, no more and no less: the parser is watched while it reads a profile with every key."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import pytest
from retarget import robots
from retarget.cli.profile_page import profiles_page
from retarget.core.segments import SEGMENTS
from retarget.robots.profile_keys import NEEDED, TABLES, TOP, Key
from retarget.robots.schema import parse_profile
from retarget.robots.toml_table import TableReader

EVERY_KEY = """
name = "every"
description = "every key once"
[model]
file = "every.urdf"
base = "fixed"
base_segment = "T8"
base_rpy_rad = [0, 0, 0]
locked_joints = ["finger*"]
[links]
LeftHand = "hand"
[limb_ends]
LeftForeArm = "hand"
[reference_posture_rad]
elbow = 0.1
[solver]
posture_weight = 0.01
[limits]
default_velocity_rad_s = 10
[limits.joints.elbow]
lower_rad = 0
upper_rad = 2
velocity_rad_s = 5
[[coupled]]
joints = ["elbow"]
rows = [[1]]
lower_rad = [0]
upper_rad = [1]
[hands.Left]
link = "hand"
fingers = [1, 0, 0]
palm = [0, 0, 1]
[feet.Left]
link = "foot"
sole_m = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
[tpose_exceptions]
LeftHand = { joint = "elbow", error_deg = 3 }
[mapping.limb_plane]
weights = { LeftHand = 1 }
twist_weights = { LeftHand = 1 }
rotations_rpy_rad = { LeftHand = [0, 0, 0] }
links = { LeftHand = "hand" }
[arms.Left]
shoulder_link = "chest"
shoulder_m = [0, 0, 0]
hand_link = "hand"
hand_m = [0, 0, 0]
length_m = 0.6
elbow_link = "elbow"
[hierarchy]
joints = ["elbow"]
limit_gain_1_s = 10
hand_speed_m_s = 1
hand_rate_rad_s = 1
inertia_diagonal = 0.1
extra_inertia = { elbow = 1 }
lower_rad = { elbow = 0 }
upper_rad = { elbow = 1 }
[[hierarchy.levels]]
weight = 50
acceleration_s2 = 0
[[hierarchy.levels.tasks]]
segment = "LeftHand"
kind = "axis"
gain_1_s = 10
link = "hand"
axis = [1, 0, 0]
weight = 1
[torque]
stiffness_nm_rad = { elbow = 1 }
damping_nms_rad = { elbow = 1 }
limit_nm = { elbow = 1 }
standing_joints = ["elbow"]
"""
OTHERWISE = {"package", "path", "human", "extends"}
"""Keys that can't stand beside those above, or that loading takes out before the parser sees the rest."""


def heading(place: str) -> str:
    """Where the parser was, as the page's heading has it: "hands.Left" → "[hands.SIDE]", "coupled[0]" → "[[coupled]]"."""
    if not place:
        return ""
    place = re.sub(r"^(hands|feet|arms)\.(Left|Right)$", r"\1.SIDE", place)
    place = re.sub(r"^limits\.joints\..+$", "limits.joints.JOINT", place)
    place = re.sub(r"^mapping\.limb_plane$", "mapping.MAPPING", place)
    place = re.sub(r"^tpose_exceptions\..+$", "tpose_exceptions.SEGMENT", place)
    plain = re.sub(r"\[\d+\]", "", place)
    return f"[[{plain}]]" if place.endswith("]") else f"[{plain}]"


@pytest.fixture
def accepted(monkeypatch: pytest.MonkeyPatch) -> Mapping[str, list[str]]:
    """Heading → the keys that the parser accepts there, from what it asks `TableReader.only`."""
    seen: dict[str, list[str]] = {}
    only = TableReader.only

    def watched(self: TableReader, keys: Iterable[str]) -> None:
        valid = list(keys)
        seen[heading(self.place)] = valid
        only(self, valid)

    monkeypatch.setattr(TableReader, "only", watched)
    parse_profile(tomllib.loads(EVERY_KEY), Path("every.toml"))
    return seen


def documented() -> dict[str, Mapping[str, Key]]:
    return {table.place: table.keys for table in TABLES}


def test_every_table_of_the_parser_is_on_the_page_and_the_reverse(accepted: Mapping[str, list[str]]) -> None:
    # tables of one mapping are keyed by segment and told of in their parent's row
    inner = {f"[mapping.limb_plane.{key}]" for key in ("weights", "twist_weights", "rotations_rpy_rad", "links")}
    assert set(accepted) - inner == set(documented())
    for place in inner & set(accepted):
        assert accepted[place] == list(SEGMENTS)
    for place, keys in documented().items():
        assert accepted[place] == list(keys), place


def test_the_profile_above_has_every_key(accepted: Mapping[str, list[str]]) -> None:
    """So every table that a key may open has been read, and a new key has to be tried here."""
    used = {key for line in EVERY_KEY.splitlines() for key in re.findall(r"^\[*([\w.]+?)\]*(?: =|$)", line)}
    words = {part for key in used for part in key.split(".")} | {"joint", "error_deg"}
    names = {*SEGMENTS, "Left", "Right"}
    for place, keys in accepted.items():
        assert set(keys) - names - OTHERWISE <= words, place


def test_the_page_shows_every_table_and_key() -> None:
    page = profiles_page()
    for table in TABLES:
        part = page.split(f"### `{table.place}`\n" if table.place else "### Top level\n")[1].split("\n### ")[0]
        shown = re.findall(r"^\| (?:`(\w+)`|(SEGMENT|SIDE)) \|", part, re.MULTILINE)
        assert [a or b for a, b in shown] == ([table.any_of] if table.any_of else list(table.keys))
        for row in part.splitlines():
            assert not row.startswith("|") or row.count("|") == 5, row


@pytest.mark.parametrize(
    "table", [table for table in TABLES if table.place and not table.any_of], ids=lambda t: t.place
)
def test_needed_keys_are_needed_and_no_others(table: Any) -> None:
    """Each key left out in turn: the parser complains just where the page says "needed"."""
    for key, told in table.keys.items():
        full = tomllib.loads(EVERY_KEY)
        part: Any = full
        for step in re.sub(r"[\[\]]", "", table.place).split("."):
            step = {"SIDE": "Left", "JOINT": "elbow", "MAPPING": "limb_plane", "SEGMENT": "LeftHand"}.get(step, step)
            part = part[step][0] if isinstance(part[step], list) else part[step]
        if key not in part or table.place == "[model]":
            continue
        del part[key]
        try:
            parse_profile(full, Path("every.toml"))
        except robots.ProfileError:
            assert told.default == NEEDED, key
        else:
            assert told.default != NEEDED, key


def test_the_misspelt_extends_is_known(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text('extend = "g1"\n')
    with pytest.raises(robots.ProfileError, match="unknown key 'extend'; did you mean 'extends'"):
        robots.load(str(tmp_path / "mine.toml"))
    assert "extends" in TOP
