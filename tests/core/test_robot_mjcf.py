"""MJCF → URDF: pinocchio's robot must stand, weigh and move as MuJoCo's own does."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from retarget.core import robot_model
from retarget.core.errors import ProfileError
from retarget.core.replay import model as replay_model
from retarget.core.robot_urdf import CONTINUOUS_LIMIT_RAD

from tests.core.mjcf_robots import arm, built, numbers, profile_of

GRAVITY = np.array([0.0, 0.0, -9.81])


def random_tree(seed: int) -> str:
    """A tree of 7 bodies below a base that floats (even seeds), stands, or is the world itself: 0 to 3 joints each, anywhere in the body."""
    rng = np.random.default_rng(seed)
    degrees = bool(rng.integers(2))
    to_file = 180 / math.pi if degrees else 1.0
    root = ET.Element("mujoco", {"model": "random"})
    ET.SubElement(root, "compiler", {"angle": "degree" if degrees else "radian", "autolimits": "true"})
    defaults = ET.SubElement(ET.SubElement(root, "default"), "default", {"class": "stiff"})
    ET.SubElement(
        defaults, "joint", {"damping": "0.7", "frictionloss": "0.2", "range": numbers([-0.5 * to_file, to_file])}
    )
    world = ET.SubElement(root, "worldbody")
    ET.SubElement(world, "geom", {"type": "plane", "size": "1 1 1"})
    bodies = []
    for i in range(7):
        parent = world if i == 0 else bodies[rng.integers(max(0, i - 3), i)]
        body = ET.SubElement(parent, "body", {"pos": numbers(rng.normal(size=3)), "quat": numbers(rng.normal(size=4))})
        if i != 4:  # one body without a name
            body.set("name", f"b{i}")
        bodies.append(body)
        if i == 0 and seed % 2 == 0:
            ET.SubElement(body, "freejoint")
        else:
            for k in range(int(rng.integers(0 if i == 0 else 1, 4))):
                _random_joint(rng, body, f"j{i}{k}", to_file)
        if rng.integers(2):
            inertial = {"pos": numbers(rng.normal(size=3)), "quat": numbers(rng.normal(size=4)), "mass": "1.5"}
            ET.SubElement(body, "inertial", {**inertial, "diaginertia": numbers([0.02, 0.03, 0.04])})
        for shape, size in (("capsule", [0.05, 0.2]), ("box", [0.1, 0.2, 0.05]), ("ellipsoid", [0.1, 0.2, 0.05])):
            placed = {"pos": numbers(rng.normal(size=3)), "quat": numbers(rng.normal(size=4))}
            ET.SubElement(body, "geom", {"type": shape, "size": numbers(size), **placed})
    return ET.tostring(root, encoding="unicode")


def _random_joint(rng: np.random.Generator, body: ET.Element, name: str, to_file: float) -> None:
    slide = bool(rng.integers(4) == 0)
    unit = 1.0 if slide else to_file
    facts = {"name": name, "type": "slide" if slide else "hinge", "axis": numbers(rng.normal(size=3))}
    if rng.integers(2):
        facts["pos"] = numbers(rng.normal(size=3))
    if rng.integers(2):
        facts["ref"] = numbers([rng.normal() * unit])
    if slide or rng.integers(2):
        facts["range"] = numbers([-unit, 0.8 * unit])
    elif rng.integers(2):
        facts["class"] = "stiff"
    facts["armature"] = "0.3"
    ET.SubElement(body, "joint", facts)


@pytest.mark.parametrize("seed", range(24))
def test_random_trees_stand_weigh_and_move_as_in_mujoco(seed: int, tmp_path: Path) -> None:
    text = random_tree(seed)
    mj = mujoco.MjModel.from_xml_string(text)
    floating = seed % 2 == 0
    robot = built(tmp_path, text, base="floating" if floating else "fixed")
    hinges = [mj.joint(i) for i in range(mj.njnt) if mj.jnt_type[i] != mujoco.mjtJoint.mjJNT_FREE]
    assert sorted(robot.joint_names) == sorted(joint.name for joint in hinges)
    data, pin_data = mujoco.MjData(mj), robot.pin_model.createData()
    rng = np.random.default_rng(1000 + seed)
    for _ in range(3):
        data.qpos[:] = rng.normal(size=mj.nq)
        data.qvel[:] = 0.0
        mujoco.mj_normalizeQuat(mj, data.qpos)
        mujoco.mj_forward(mj, data)
        values = np.array([data.qpos[mj.joint(name).qposadr[0]] for name in robot.joint_names])
        base_pose = (data.qpos[3:7], data.qpos[:3]) if floating else ()
        q = robot.configuration(values, *base_pose)
        pin.framesForwardKinematics(robot.pin_model, pin_data, q)
        base_turn, base_origin = np.eye(3), np.zeros(3)
        if (
            robot.base_link != "world" and not floating
        ):  # the body that stands still: the robot's origin, wherever it stands
            base_turn, base_origin = data.xmat[1].reshape(3, 3), data.xpos[1]
        for b in range(1, mj.nbody):
            joint, turn, origin = robot.link_in_joint(mj.body(b).name or f"body{b}")
            placement = pin_data.oMi[joint] * pin.SE3(turn, origin)
            np.testing.assert_allclose(base_turn @ placement.translation + base_origin, data.xpos[b], atol=1e-9)
            np.testing.assert_allclose(base_turn @ placement.rotation, data.xmat[b].reshape(3, 3), atol=1e-9)
        # The joints' block: of a floating base MuJoCo and pinocchio use different velocities.
        columns = [int(mj.joint(name).dofadr[0]) for name in robot.joint_names]
        full = np.zeros((mj.nv, mj.nv))
        mujoco.mj_fullM(mj, data, full)
        full = full[np.ix_(columns, columns)] - np.diag(mj.dof_armature[columns])
        n = len(columns)
        matrix = np.reshape(pin.crba(robot.pin_model, pin_data, q), (robot.pin_model.nv,) * 2)
        np.testing.assert_allclose(matrix[-n:, -n:], full, atol=1e-9 * max(1.0, np.abs(full).max()))
        robot.pin_model.gravity.linear = base_turn.T @ GRAVITY
        gravity = np.ravel(pin.computeGeneralizedGravity(robot.pin_model, pin_data, q))[-n:]
        np.testing.assert_allclose(gravity, data.qfrc_bias[columns], atol=1e-9 * max(1.0, np.abs(gravity).max()))
    assert robot.mass_kg == pytest.approx(mj.body_subtreemass[1], rel=1e-12)
    for k, name in enumerate(robot.joint_names):
        joint = mj.joint(name)
        turn = CONTINUOUS_LIMIT_RAD
        expected = mj.jnt_range[joint.id] if mj.jnt_limited[joint.id] else (-turn, turn)
        np.testing.assert_allclose((robot.lower[k], robot.upper[k]), expected, rtol=1e-15)
        assert robot.pin_model.damping[-n + k] == mj.dof_damping[joint.dofadr[0]]
        assert robot.pin_model.friction[-n + k] == mj.dof_frictionloss[joint.dofadr[0]]


def test_the_random_trees_hold_what_they_are_for() -> None:
    text = "".join(random_tree(seed) for seed in range(24))
    joints = [j for j in ET.fromstring(f"<all>{text}</all>").iter("joint") if j.get("name")]
    for key in ("pos", "ref", "class", "range"):
        assert 10 < sum(key in joint.attrib for joint in joints) < len(joints)
    assert {joint.get("type") for joint in joints} == {"hinge", "slide"}


def test_links_between_carry_the_names_of_body_and_joint(tmp_path: Path) -> None:
    root = ET.fromstring(built(tmp_path, arm(one='pos="0 0 0.1"')).urdf)
    assert [link.get("name") for link in root.findall("link")] == ["base", "link", "link_one"]
    chain = [(j.get("name"), j.find("parent").get("link"), j.find("child").get("link")) for j in root.findall("joint")]  # type: ignore[union-attr]  # each has both
    assert chain == [("one", "base", "link_one"), ("two", "link_one", "link")]


def test_a_link_called_like_a_joint_keeps_its_own_frame(tmp_path: Path) -> None:
    text = """<mujoco><worldbody><body name="base"><geom size="0.1"/><body name="elbow" pos="1 0 0">
      <joint name="elbow" pos="0 0.5 0" range="-90 90"/><geom size="0.1"/></body></body></worldbody></mujoco>"""
    robot = built(tmp_path, text)
    joint, turn, origin = robot.link_in_joint("elbow")
    assert joint == 1
    np.testing.assert_allclose(turn, np.eye(3))
    np.testing.assert_allclose(origin, [0.0, -0.5, 0.0])


@pytest.mark.parametrize(
    ("one", "actuators", "effort"),
    [
        ("", "", math.inf),
        ('actuatorfrcrange="-30 40"', "", 40.0),
        ("", '<motor joint="one" gear="50" ctrlrange="-1 1"/>', 50.0),
        ("", '<motor joint="one" gear="50" ctrlrange="-1 1" forcerange="-0.5 0.5"/>', 25.0),
        ("", '<position joint="one" kp="100" ctrlrange="-1 1"/>', math.inf),
        ("", '<position joint="one" kp="100" forcerange="-88 88"/>', 88.0),
        ('actuatorfrcrange="-30 30"', '<motor joint="one" ctrlrange="-88 88"/>', 30.0),
        ("", '<motor joint="one" ctrlrange="-10 10"/><motor joint="one" ctrlrange="-5 5"/>', 15.0),
        ("", '<motor joint="one" ctrlrange="-10 10"/><motor joint="one"/>', math.inf),
    ],
)
def test_efforts(one: str, actuators: str, effort: float, tmp_path: Path) -> None:
    robot = built(tmp_path, arm(one=one, sections=f"<actuator>{actuators}</actuator>"))
    assert replay_model.torque_limits(robot)[robot.joint_index("one")] == effort


def test_armature_is_the_simulations(tmp_path: Path) -> None:
    robot = built(tmp_path, arm())
    replay = replay_model.build(robot, base="fixed", cache=tmp_path)
    assert replay.armature[robot.joint_index("two")] == 0.25
    assert replay.armature[robot.joint_index("one")] == replay_model.SMALLEST_ARMATURE


def test_a_speed_limit_must_come_from_the_profile(tmp_path: Path) -> None:
    told = r"joint 'one' has range -1…2 and speed limit 0; expected .*; default_velocity_rad_s stands in where"
    with pytest.raises(ProfileError, match=told):
        built(tmp_path, arm(), default_velocity_limit=None)
    assert (built(tmp_path, arm()).velocity_limit == 10.0).all()


def test_the_robot_is_the_part_of_the_scene_that_has_joints(tmp_path: Path) -> None:
    scene = '<mujoco><include file="robot.xml"/><worldbody><body name="table"><geom size="1"/></body><body name="ball"><freejoint/><geom size="1"/></body></worldbody></mujoco>'
    (tmp_path / "robot.xml").write_text(arm(), encoding="utf-8")
    (tmp_path / "scene.xml").write_text(scene, encoding="utf-8")
    robot = robot_model.build(profile_of(tmp_path / "scene.xml"))
    assert robot.base_link == "base"
    assert robot.joint_names == ("one", "two")
    assert robot.warnings == ("2 × body of the scene without joints, left out: table, ball",)


def test_what_urdf_has_no_word_for_is_told(tmp_path: Path) -> None:
    text = arm(one='stiffness="3"', sections='<equality><joint name="couple" joint1="one" joint2="two"/></equality>')
    robot = built(tmp_path, text)
    told = ("1 × equality constraint, not kept: couple", "1 × joint spring, left out: one")
    assert robot.warnings == told
    assert replay_model.build(robot, base="fixed", cache=tmp_path).warnings == told


def test_a_robot_on_the_ground_itself_is_simulated(tmp_path: Path) -> None:
    text = """<mujoco><worldbody><body name="bar" pos="0 0 1"><joint name="hinge" axis="0 1 0" range="-90 90"/>
      <geom type="capsule" size="0.05 0.5" pos="0 0 -0.5"/></body></worldbody></mujoco>"""
    robot = built(tmp_path, text)
    assert robot.base_link == "world"
    replay = replay_model.build(robot, base="fixed", cache=tmp_path)
    np.testing.assert_allclose(replay.mj.body_pos[replay.body_of_link["bar"]], [0, 0, 1])


def test_what_the_compiler_warns_of_is_told_and_leaves_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    robot = built(tmp_path, arm().replace("<compiler", '<compiler settotalmass="5"'))
    assert robot.mass_kg == pytest.approx(5.0)
    assert [warning.startswith("MuJoCo: compiler attribute 'settotalmass'") for warning in robot.warnings] == [True]
    assert list(folder.iterdir()) == []
    assert capfd.readouterr().err == ""


ROBOT = (
    '<body name="r{0}"><freejoint/><geom size="1"/><body name="b{0}"><joint name="j{0}"/><geom size="1"/></body></body>'
)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("<mujoco", "the model is not XML"),
        ("<sdf/>", r"the model's root element is <sdf>; expected <robot> \(URDF\) or <mujoco> \(MJCF\)"),
        ("<mujoco><worldbody><bod/></worldbody></mujoco>", "MuJoCo refuses robot.xml: XML Error: Schema violation: unrecog"),
        (arm(more='<body name="c"><joint/></body>'), "MuJoCo refuses robot.xml: Error: mass and inertia of moving bodies"),
        (arm(more='<body name="c"><joint name="hip" type="ball"/><geom size="1"/></body>'), "'hip' is a ball joint; expected hinges"),
        ("<mujoco/>", "the model has no joint that moves"),
        ('<mujoco><worldbody><body name="b"><freejoint/><geom size="1"/></body></worldbody></mujoco>', "the model has no joint"),
        (arm(one='type="slide"').replace('range="-1 2" type', "type"), "joint 'one' has range -inf…inf"),
        (arm(more='<geom type="mesh" mesh="m"/>', sections='<asset><mesh name="m" file="m.stl"/></asset>'), "body 'link' has its mass from the mesh m.stl, which is missing; expected the file, or an <inertial>"),
        ("<mujoco><include file='no.xml'/></mujoco>", "MuJoCo refuses robot.xml: XML Error: .*no.xml"),
        (f"<mujoco><worldbody>{ROBOT.format(1)}{ROBOT.format(2)}</worldbody></mujoco>", "the model has 2 robots, 'r1', 'r2'; expected a single one"),
    ],
)  # fmt: skip
def test_bad_mjcf_is_one_line(text: str, told: str, tmp_path: Path) -> None:
    with pytest.raises(ProfileError, match=rf"^robot\.toml, \[(model|limits)\]: {told}") as caught:
        built(tmp_path, text)
    assert "\n" not in str(caught.value)
