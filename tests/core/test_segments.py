"""The segment tree against the recordings' own lists and against what the T-pose invariant implies."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from retarget.core.segments import FOOT_CONTACTS, LIMB_END, LOWER_BODY, PARENT, SEGMENTS


def test_parents_stand_before_children() -> None:
    for child, parent in PARENT.items():
        assert parent is None or SEGMENTS.index(parent) < SEGMENTS.index(child)
    assert [child for child, parent in PARENT.items() if parent is None] == ["Pelvis"]


@pytest.mark.parametrize("file", ["upper_body_v4_60hz.mvnx", "full_body_v3_240hz_4frames.mvnx"])
def test_names_order_and_tree_are_those_of_real_recordings(shared_data: Path, file: str) -> None:
    text = (shared_data / "mvnx" / file).read_text(encoding="utf-8")
    assert tuple(re.findall(r'<segment [^>]*label="(\w+)"', text)) == SEGMENTS
    joints = re.findall(r"<connector1>(\w+)/\w+</connector1>\s*<connector2>(\w+)/\w+</connector2>", text)
    assert {child: parent for parent, child in joints} == {c: p for c, p in PARENT.items() if p is not None}


def test_contact_columns_are_those_of_a_real_recording(shared_data: Path) -> None:
    text = (shared_data / "mvnx" / "upper_body_v4_60hz.mvnx").read_text(encoding="utf-8")
    assert tuple(re.findall(r'<contactDefinition label="(\w+)"', text)) == FOOT_CONTACTS


def test_left_and_right_mirror() -> None:
    def mirrored(name: str | None) -> str | None:
        if name is None:
            return None
        return name.replace("Left", "*").replace("Right", "Left").replace("*", "Right")

    assert {mirrored(c): mirrored(p) for c, p in PARENT.items()} == PARENT
    assert {mirrored(a): mirrored(b) for a, b in LIMB_END.items()} == LIMB_END


def test_a_limbs_bone_ends_where_its_child_begins() -> None:
    assert len(LIMB_END) == 8
    for bone, end in LIMB_END.items():
        assert PARENT[end] == bone


def test_the_lower_body_is_what_hangs_from_the_pelvis_by_the_hips() -> None:
    def chain(name: str | None) -> list[str]:
        return [] if name is None else [name, *chain(PARENT[name])]

    hips = {"LeftUpperLeg", "RightUpperLeg"}
    assert {name for name in SEGMENTS if hips & set(chain(name))} == LOWER_BODY
