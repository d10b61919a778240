"""Guessed profiles beside the packaged ones, which people wrote, and for a small MJCF humanoid whose links are known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from retarget import robots
from retarget.core import robot_model
from retarget.core.errors import ProfileError
from retarget.core.profile import ModelSource, RobotProfile
from retarget.core.profile_guess import Guess, guess
from retarget.core.robot_check import solved_tpose

PACKAGED = ("atlas", "baxter", "g1", "icub", "talos", "tocabi")
COLLARBONES = {"LeftShoulder", "RightShoulder"}
_GUESSES: dict[str, Guess] = {}


def of_package(name: str) -> Guess:
    if name not in _GUESSES:
        model = robots.load(name).model
        _GUESSES[name] = guess(RobotProfile(name, "", model, "floating", {}))
    return _GUESSES[name]


@pytest.mark.parametrize("name", PACKAGED)
def test_the_links_move_as_those_that_people_chose(name: str) -> None:
    """The same link, or one fixed to it, as an ankle's last link is to the foot's; collarbones are not guessed."""
    written, found = robots.load(name), of_package(name).profile
    model = robot_model.build(written)
    assert set(found.links) == set(written.links) - COLLARBONES
    for segment, link in found.links.items():
        assert model.link_in_joint(link)[0] == model.link_in_joint(written.links[segment])[0], segment


@pytest.mark.parametrize("name", PACKAGED)
def test_base_and_fingers_are_as_people_wrote(name: str) -> None:
    written, found = robots.load(name), of_package(name).profile
    assert (found.base, found.base_segment) == (written.base, written.base_segment)
    if found.base == "floating":
        np.testing.assert_allclose(found.base_rpy, written.base_rpy, atol=1e-6)
    assert robot_model.build(found).joint_names == robot_model.build(written).joint_names


@pytest.mark.parametrize("name", [name for name in PACKAGED if name != "icub"])
def test_arms_are_out_to_the_sides_in_the_guessed_posture(name: str) -> None:
    """By forward kinematics within what the written profile's T-pose leaves, and 5° for the two rounds that it took; iCub's cables are in no URDF."""
    import pinocchio as pin

    model = robot_model.build(of_package(name).profile)
    data = model.pin_model.createData()
    pin.framesForwardKinematics(model.pin_model, data, model.configuration(model.reference_posture))
    for side, out in (("Left", 1.0), ("Right", -1.0)):
        limb = model.limbs[f"{side}UpperArm"]
        rotation = np.array(data.oMf[model.pin_model.getFrameId(limb.link, pin.FrameType.BODY)].rotation)
        assert (rotation @ limb.bone)[1] * out > np.cos(np.radians(15))


@pytest.mark.parametrize("name", ["g1", "talos", "baxter", "icub"])
def test_the_solver_finds_a_t_pose_with_the_guesses(name: str) -> None:
    model = robot_model.build(of_package(name).profile)
    _, errors = solved_tpose(model)
    assert max(error for segment, error in errors.items() if segment in model.limbs) < 1.0


HUMANOID = """
<mujoco model="small">
  <worldbody>
    <geom type="plane" size="5 5 .1"/>
    <body name="torso" pos="0 0 1.3">
      <freejoint/>
      <geom type="capsule" fromto="0 -.07 0 0 .07 0" size=".07"/>
      <body name="head" pos="0 0 .19"><geom type="sphere" size=".09"/></body>
      <body name="waist" pos="0 0 -.26">
        <joint name="abdomen_z" axis="0 0 1" range="-45 45"/><joint name="abdomen_y" axis="0 1 0" range="-75 30"/>
        <geom type="capsule" fromto="0 -.06 0 0 .06 0" size=".06"/>
        <body name="pelvis" pos="0 0 -.165">
          <joint name="abdomen_x" axis="1 0 0" range="-35 35"/>
          <geom type="capsule" fromto="0 -.07 0 0 .07 0" size=".09"/>
          {legs}
        </body>
      </body>
      {arms}
    </body>
  </worldbody>
</mujoco>
"""
LEG = """
<body name="{side}_thigh" pos="0 {y} -.04">
  <joint name="{side}_hip_x" axis="1 0 0" range="-30 30"/><joint name="{side}_hip_z" axis="0 0 1" range="-60 60"/>
  <joint name="{side}_hip_y" axis="0 1 0" range="-150 20"/>
  <geom type="capsule" fromto="0 0 0 0 0 -.34" size=".06"/>
  <body name="{side}_shin" pos="0 0 -.4">
    <joint name="{side}_knee" axis="0 1 0" range="-2 160"/>
    <geom type="capsule" fromto="0 0 0 0 0 -.3" size=".049"/>
    <body name="{side}_foot" pos="0 0 -.39">
      <joint name="{side}_ankle_y" axis="0 1 0" range="-50 50"/><joint name="{side}_ankle_x" axis="1 0 0" range="-50 50"/>
      <geom type="capsule" fromto="-.07 0 -.03 .14 0 -.03" size=".027"/>
    </body>
  </body>
</body>
"""
ARM = """
<body name="{side}_upper_arm" pos="0 {y} .06">
  <joint name="{side}_shoulder_x" axis="1 0 0" range="-170 170"/><joint name="{side}_shoulder_y" axis="0 1 0" range="-170 170"/>
  <joint name="{side}_shoulder_z" axis="0 0 1" range="-170 170"/>
  <geom type="capsule" fromto="0 0 0 0 0 -.24" size=".04"/>
  <body name="{side}_lower_arm" pos="0 0 -.28">
    <joint name="{side}_elbow" axis="0 1 0" range="-150 5"/>
    <geom type="capsule" fromto="0 0 0 0 0 -.2" size=".031"/>
    <body name="{side}_hand" pos="0 0 -.26"><joint name="{side}_wrist" axis="1 0 0" range="-60 60"/><geom type="sphere" size=".04"/></body>
  </body>
</body>
"""


def mjcf(folder: Path, hips: float = 0.1, shoulders: float = 0.17) -> RobotProfile:
    text = HUMANOID.format(
        legs=LEG.format(side="left", y=hips) + LEG.format(side="right", y=-hips),
        arms=ARM.format(side="left", y=shoulders) + ARM.format(side="right", y=-shoulders),
    )
    (folder / "small.xml").write_text(text, encoding="utf-8")
    return RobotProfile("small", "", ModelSource("file", str(folder / "small.xml")), "floating", {})


def test_an_mjcf_whose_root_is_the_chest(tmp_path: Path) -> None:
    """Bodies with several joints, no speeds, and the pelvis behind the waist's joints."""
    found = guess(mjcf(tmp_path)).profile
    sides = ("left", "right")
    expected = {"Pelvis": "pelvis"}
    for side in sides:
        parts = {
            "UpperArm": "upper_arm",
            "ForeArm": "lower_arm",
            "Hand": "hand",
            "UpperLeg": "thigh",
            "LowerLeg": "shin",
            "Foot": "foot",
        }
        expected |= {f"{side.capitalize()}{part}": f"{side}_{body}" for part, body in parts.items()}
    assert {segment: found.links[segment] for segment in expected} == expected
    assert found.links.get("T8") == "torso"
    assert found.default_velocity_limit == 10.0
    model = robot_model.build(found)
    _, errors = solved_tpose(model)
    assert max(errors[segment] for segment in model.limbs) < 1.0


@pytest.mark.parametrize(
    ("left", "right"),
    [
        ("left_", "right_"),
        ("L_", "R_"),
        ("l_", "r_"),
        ("L", "R"),
        ("LEFT.", "RIGHT."),
        ("LINK_L_", "LINK_R_"),
        ("Body-l-", "Body-r-"),
    ],
)
def test_ways_to_name_sides(tmp_path: Path, left: str, right: str) -> None:
    profile = mjcf(tmp_path)
    path = Path(profile.model.path)
    text = path.read_text().replace("left_", left).replace("right_", right)
    if left == "L":  # as Romeo's LHipYaw
        for word in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist"):
            text = text.replace(f'"L{word}', f'"L{word.capitalize()}').replace(f'"R{word}', f'"R{word.capitalize()}')
    path.write_text(text)
    links = guess(profile).profile.links
    assert links["LeftForeArm"].removeprefix(left) == links["RightForeArm"].removeprefix(right) == "lower_arm"
    assert len(links) == 14


def test_a_robot_that_faces_backward_is_seen(tmp_path: Path) -> None:
    """Its left side is where the root link's right is."""
    found = guess(mjcf(tmp_path, hips=-0.1, shoulders=-0.17)).profile
    np.testing.assert_allclose(found.base_rpy, (0, 0, np.pi), atol=1e-6)


def test_no_limbs_is_one_line(tmp_path: Path) -> None:
    profile = mjcf(tmp_path)
    path = Path(profile.model.path)
    path.write_text(path.read_text().replace("left", "a").replace("right", "b"))
    with pytest.raises(ProfileError, match=r"no pair of limbs in .* whose names tell left from right"):
        guess(replace(profile, origin="small.xml"))
