"""Names and roles of trackers that name a segment, and those that name none."""

from __future__ import annotations

import pytest
from retarget.core.segments import SEGMENTS
from retarget.formats._tracker_roles import ROLES, assign, segment_of


@pytest.mark.parametrize(
    ("name", "segment"),
    [
        ("waist", "Pelvis"),
        ("chest", "T8"),
        ("TrackerRole_Chest", "T8"),
        ("vive_tracker_left_foot", "LeftFoot"),
        ("ViveTrackerRightHand", "RightHand"),
        ("TrackerRole_LeftElbow", "LeftUpperArm"),
        ("left_upper_arm", "LeftUpperArm"),
        ("left_shoulder", "LeftShoulder"),
        ("right wrist", "RightForeArm"),
        ("hand_l", "LeftHand"),
        ("R-Hand", "RightHand"),
        ("LeftController", "LeftHand"),
        ("HMD", "Head"),
        ("headset", "Head"),
        ("right_knee", "RightUpperLeg"),
        ("TrackerRole_RightAnkle", "RightLowerLeg"),
        ("t8", "T8"),
        ("TrackerRole_Handed", None),
        ("camera", None),
        ("LHR-1234ABCD", None),
        ("T20", None),
        ("WM0", None),
        ("tracker", None),
        ("tracker 1", None),
        ("", None),
        ("hand", None),
        ("chestnut", None),
    ],
)
def test_names(name: str, segment: str | None) -> None:
    assert segment_of(name) == segment


def test_every_segment_and_every_role_that_is_suggested_is_understood() -> None:
    assert [segment_of(segment) for segment in SEGMENTS] == list(SEGMENTS)
    assert all(segment_of(role) for role in ROLES)


def test_two_names_for_one_segment_keep_the_first_and_say_so() -> None:
    warnings: list[str] = []
    assert assign(["waist", "pelvis", "chest"], {}, {}, warnings) == {"waist": "Pelvis", "chest": "T8"}
    assert warnings == ["trackers 'waist' and 'pelvis' both name Pelvis: taken from 'waist'"]
    assert assign(["waist", "pelvis"], {}, {"pelvis": "waist"}, warnings) == {"pelvis": "Pelvis"}
    assert len(warnings) == 1


def test_the_role_that_the_file_gives_goes_before_the_name() -> None:
    assert assign(["LHR-1", "waist"], {"LHR-1": "TrackerRole_Waist", "waist": "handed"}, {}, []) == {"LHR-1": "Pelvis"}
