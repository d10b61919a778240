"""The URDF that everything downstream uses: what the profile writes into it, and what it refuses."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from math import pi
from typing import Any

import pytest
from retarget.core.errors import ProfileError
from retarget.core.profile import JointLimit, ModelSource, RobotProfile
from retarget.core.robot_urdf import CONTINUOUS_LIMIT_RAD, prepared_urdf

URDF = """<robot name="arm">
  <link name="base"/><link name="a"/><link name="b"/><link name="c"/><link name="d"/>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/>
    <limit lower="-1.5" upper="2" velocity="100" effort="3"/></joint>
  <joint name="elbow" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/>
    <limit velocity="2" effort="3"/></joint>
  <joint name="slide" type="prismatic"><parent link="b"/><child link="c"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="0.4" velocity="0" effort="3"/></joint>
  <joint name="finger" type="revolute"><parent link="c"/><child link="d"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="1" velocity="1" effort="3"/><mimic joint="slide"/><dynamics damping="1"/></joint>
  <transmission name="t"/><gazebo/>
</robot>"""


def profile(**changed: Any) -> RobotProfile:
    facts: dict[str, Any] = {
        "name": "arm",
        "description": "",
        "model": ModelSource("file", "arm.urdf"),
        "base": "fixed",
        "links": {},
        "origin": "arm.toml",
        "default_velocity_limit": 10.0,
    }
    return RobotProfile(**{**facts, **changed})


def limits(prepared: str) -> dict[str, tuple[float, float, float]]:
    found = {}
    for joint in ET.fromstring(prepared).iter("joint"):
        limit = joint.find("limit")
        if limit is not None:
            found[joint.get("name", "")] = tuple(float(limit.get(key, "nan")) for key in ("lower", "upper", "velocity"))
    return found  # type: ignore[return-value]  # three values each


def test_limits_are_capped_filled_in_and_kept() -> None:
    found = limits(prepared_urdf(profile(), URDF))
    assert found["shoulder"] == (-1.5, 2.0, 10.0)  # placeholder of 100 capped
    assert found["elbow"] == (-CONTINUOUS_LIMIT_RAD, CONTINUOUS_LIMIT_RAD, 2.0)  # its own speed, below the cap
    assert found["slide"] == (0.0, 0.4, 10.0)  # a speed of 0 is none
    assert found["finger"] == (0.0, 1.0, 1.0)


def test_the_profiles_limits_win_over_the_cap_and_later_ones_over_earlier() -> None:
    given = {"*": JointLimit(velocity=3.0), "shoulder": JointLimit(lower=-1.0), "s*": JointLimit(upper=0.5)}
    found = limits(prepared_urdf(profile(joint_limits=given), URDF))
    assert found["shoulder"] == (-1.0, 0.5, 3.0)
    assert found["slide"] == (0.0, 0.5, 3.0)
    assert found["elbow"] == (-4 * pi, 4 * pi, 3.0)


def test_locked_joints_are_fixed_and_lose_what_only_movable_ones_have() -> None:
    root = ET.fromstring(prepared_urdf(profile(locked_joints=("fing*",)), URDF))
    finger = next(joint for joint in root.iter("joint") if joint.get("name") == "finger")
    assert finger.get("type") == "fixed"
    assert {element.tag for element in finger} == {"parent", "child"}


def test_nothing_else_changes() -> None:
    before, after = ET.fromstring(URDF), ET.fromstring(prepared_urdf(profile(), URDF))
    assert [e.attrib for e in before.iter("axis")] == [e.attrib for e in after.iter("axis")]
    assert [e.attrib for e in before.iter("link")] == [e.attrib for e in after.iter("link")]
    assert before.find("transmission") is not None
    assert after.find("transmission") is None
    assert after.find("gazebo") is None


def test_bytes_are_decoded_as_their_declaration_says() -> None:
    latin = '<?xml version="1.0" encoding="iso-8859-1"?>' + URDF.replace('name="base"', 'name="Fuß"')
    assert "Fuß" in prepared_urdf(profile(), latin.encode("iso-8859-1"))


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("<robot", "the model is not XML"),
        (b'<?xml version="1.0" encoding="klingon"?><robot/>', "the model is not XML: unknown encoding"),
        (b"\xff\xfe\x00", "the model is not XML"),
        ("<sdf/>", r"the model's root element is <sdf>; expected <robot> \(URDF\) or <mujoco> \(MJCF\)"),
        (
            '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:include filename="x"/></robot>',
            r"the model holds the macro <xacro:include>; expected expanded URDF",
        ),
        (URDF.replace("prismatic", "planar"), "joint 'slide' is of type 'planar'; expected revolute, continuous"),
        (URDF.replace('lower="-1.5"', 'lower="low"'), "joint 'shoulder' has the limits .*; expected numbers"),
        (
            URDF.replace('lower="-1.5"', 'lower="3"'),
            "joint 'shoulder' has range 3…2 and speed limit 10; expected lower",
        ),
        (URDF.replace('upper="2"', 'upper="inf"'), "joint 'shoulder' has range -1.5…inf"),
        (URDF.replace('upper="2"', 'upper="nan"'), "joint 'shoulder' has range -1.5…nan"),
    ],
)
def test_text_that_is_no_robot_is_refused(text: str | bytes, told: str) -> None:
    with pytest.raises(ProfileError, match=rf"^arm\.toml, \[(model|limits)\]: {told}"):
        prepared_urdf(profile(), text)


def test_a_joint_without_any_speed_is_refused() -> None:
    with pytest.raises(ProfileError, match=r"joint 'slide' has range 0…0\.4 and speed limit 0; expected"):
        prepared_urdf(profile(default_velocity_limit=None), URDF)


def test_entities_do_not_expand_without_end() -> None:
    bomb = "".join(f'<!ENTITY e{i} "{f"&e{i - 1};" * 10}">' for i in range(1, 12))
    text = f'<?xml version="1.0"?><!DOCTYPE r [<!ENTITY e0 "aaaaaaaaaa">{bomb}]><robot name="&e11;"/>'
    with pytest.raises(ProfileError, match="the model is not XML"):
        prepared_urdf(profile(), text)


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        (
            {"locked_joints": ("elbo",)},
            r"\[model\] locked_joints: the model has no joint 'elbo'; did you mean elbow",
        ),
        (
            {"joint_limits": {"x*": JointLimit()}},
            r"\[limits.joints\]: the model has no joint 'x\*'; expected one of shoulder",
        ),
        (
            {"locked_joints": ("finger",), "joint_limits": {"finger": JointLimit()}},
            r"\[limits.joints\]: the model has no joint 'finger'",
        ),
    ],
)
def test_joints_that_are_not_there(changed: dict[str, Any], told: str) -> None:
    with pytest.raises(ProfileError, match=told):
        prepared_urdf(profile(**changed), URDF)
