"""MuJoCo's model of every robot against pinocchio's, and of small robots against closed forms."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from retarget import robots
from retarget.core.errors import ProfileError
from retarget.core.profile import TorqueControl
from retarget.core.replay import model_cache
from retarget.core.replay.inertia import link_inertias
from retarget.core.replay.model import ReplayModel, build, torque_limits
from retarget.core.replay.spec import body_names
from retarget.core.robot_model import RobotModel
from retarget.core.types import Array

from tests.core.replay.conftest import RobotFactory, collision, hinge, link

ROBOTS = robots.names()
Replayed = Callable[..., ReplayModel]


def postures(replay: ReplayModel, count: int) -> list[tuple[Array, Array, Array]]:
    """Random joints inside the limits, base orientations and base positions."""
    generator = np.random.default_rng(3)
    turns = generator.normal(size=(count, 4))
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    joints = generator.uniform(replay.robot.lower, replay.robot.upper, (count, len(replay.robot.joint_names)))
    return list(zip(joints, turns, generator.normal(size=(count, 3)), strict=True))


@pytest.mark.parametrize("base", ["fixed", "floating"])
@pytest.mark.parametrize("name", ROBOTS)
def test_mass_joints_and_order_are_those_of_pinocchio(replayed: Replayed, name: str, base: str) -> None:
    replay = replayed(name, base)
    mj, robot = replay.mj, replay.robot
    n = len(robot.joint_names)
    mass = sum(inertia.mass for inertia in robot.pin_model.inertias)
    assert mj.body_mass.sum() == pytest.approx(mass, rel=1e-8)
    assert mj.nv == n + 6 * (base == "floating")
    assert [mj.joint(int(mj.dof_jntid[address])).name for address in replay.qvel] == list(robot.pin_model.names)[-n:]
    assert [mj.joint(int(mj.dof_jntid[address])).qposadr[0] for address in replay.qvel] == list(replay.qpos)
    assert [mj.actuator(int(i)).name for i in replay.actuators] == list(robot.joint_names)
    assert [int(mj.actuator_trnid[i, 0]) for i in replay.actuators] == [int(mj.dof_jntid[a]) for a in replay.qvel]
    np.testing.assert_array_equal(mj.jnt_range[mj.dof_jntid[replay.qvel]], np.stack([robot.lower, robot.upper], axis=1))
    assert (replay.base_qpos, replay.base_qvel) == ((0, 0) if base == "floating" else (None, None))


@pytest.mark.parametrize("name", ROBOTS)
def test_bodies_stand_where_pinocchio_puts_their_links(replayed: Replayed, name: str) -> None:
    replay = replayed(name)
    pin_model, data = replay.robot.pin_model, mujoco.MjData(replay.mj)
    pin_data = pin_model.createData()
    for joints, turn, place in postures(replay, 10):
        data.qpos[:] = replay.configuration(joints, turn, place)
        mujoco.mj_kinematics(replay.mj, data)
        pin.framesForwardKinematics(pin_model, pin_data, replay.robot.configuration(joints, turn, place))
        for body in body_names(replay.robot).values():
            frame = pin_data.oMf[pin_model.getFrameId(body)]
            np.testing.assert_allclose(data.body(body).xpos, frame.translation, rtol=0, atol=1e-9)
            np.testing.assert_allclose(data.body(body).xmat.reshape(3, 3), frame.rotation, rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", ROBOTS)
def test_gravity_torques_are_those_of_pinocchio(replayed: Replayed, name: str) -> None:
    """With the links' mass and centre alone; repaired tensors don't matter to them."""
    replay = replayed(name)
    pin_model, data = replay.robot.pin_model, mujoco.MjData(replay.mj)
    n = len(replay.robot.joint_names)
    for joints, turn, place in postures(replay, 10):
        data.qpos[:] = replay.configuration(joints, turn, place)
        mujoco.mj_forward(replay.mj, data)
        expected = pin.computeGeneralizedGravity(
            pin_model, pin_model.createData(), replay.robot.configuration(joints, turn, place)
        )[-n:]
        np.testing.assert_allclose(data.qfrc_bias[replay.qvel], expected, rtol=0, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("name", ROBOTS)
def test_mass_matrix_is_that_of_pinocchio(replayed: Replayed, name: str) -> None:
    """pinocchio is given the same rotors and repaired tensors, where there are any; for all other robots it is the model as loaded."""
    replay = replayed(name)
    pin_model, data = replay.robot.pin_model.copy(), mujoco.MjData(replay.mj)
    n = len(replay.robot.joint_names)
    for i, given in link_inertias(replay.robot).items():
        if given.rotor or given.repaired:
            pin_model.inertias[i] = pin.Inertia(given.mass, pin_model.inertias[i].lever, given.tensor)
    assert (name in ("icub", "tocabi")) == bool(replay.repaired)
    for joints, turn, place in postures(replay, 5):
        data.qpos[:] = replay.configuration(joints, turn, place)
        mujoco.mj_forward(replay.mj, data)
        full = np.zeros((replay.mj.nv, replay.mj.nv))
        mujoco.mj_fullM(replay.mj, data, full)
        matrix = np.triu(pin.crba(pin_model, pin_model.createData(), replay.robot.configuration(joints, turn, place)))
        expected = (matrix + np.triu(matrix, 1).T)[-n:, -n:]
        mine = full[np.ix_(replay.qvel, replay.qvel)] - np.diag(replay.armature)
        np.testing.assert_allclose(mine, expected, rtol=0, atol=2e-6 * np.abs(expected).max())


@pytest.mark.parametrize("name", ROBOTS)
def test_nothing_touches_in_the_reference_posture(replayed: Replayed, name: str) -> None:
    replay = replayed(name)
    data = mujoco.MjData(replay.mj)
    data.qpos[:] = replay.configuration(replay.robot.reference_posture)
    mujoco.mj_forward(replay.mj, data)
    assert data.ncon == 0
    assert replay.touching == ()
    assert replay.warnings == ()


def test_no_robot_has_a_torque_limit_that_is_a_placeholder(any_robot: Callable[[str], RobotModel]) -> None:
    unknown = {name: sum(np.isinf(torque_limits(any_robot(name)))) for name in ROBOTS if name != "human"}
    assert unknown == {**dict.fromkeys(unknown, 0), "baxter": 1}  # head_pan: 50000 in the URDF
    tocabi = any_robot("tocabi")
    assert torque_limits(tocabi)[tocabi.joint_index("L_Elbow_Joint")] == 23.0


PENDULUM = link("base") + link("rod", mass=2.0, com="0 0 -0.5", inertia=0.03) + hinge("swing", "base", "rod")


def test_a_pendulum_swings_with_its_period(robot_from: RobotFactory, tmp_path: Path) -> None:
    """Small swings: T = 2π √(I / m g l), I about the hinge and with the rotor; gravity torque m g l sin q."""
    replay = build(robot_from(PENDULUM), base="fixed", cache=tmp_path)
    mj, data = replay.mj, mujoco.MjData(replay.mj)
    about_hinge = 0.03 + 2.0 * 0.25
    assert replay.armature[0] == pytest.approx(0.05 * about_hinge)
    data.qpos[:] = 0.8
    mujoco.mj_forward(mj, data)
    assert data.qfrc_bias[0] == pytest.approx(2.0 * 9.81 * 0.5 * math.sin(0.8), rel=1e-12)
    data.qpos[:], data.qvel[:] = 1e-3, 0.0
    period = 2 * math.pi * math.sqrt(1.05 * about_hinge / (2.0 * 9.81 * 0.5))
    for _ in range(round(period / mj.opt.timestep)):
        mujoco.mj_step(mj, data)
    assert data.qpos[0] == pytest.approx(1e-3, rel=1e-3)
    assert abs(data.qvel[0]) < 1e-3 * 1e-3 * 2 * math.pi / period * 2


def test_friction_damping_and_limits_come_from_the_urdf_and_the_profile(
    robot_from: RobotFactory, tmp_path: Path
) -> None:
    more = '<dynamics damping="0.7" friction="1.5"/>'
    body = link("base") + link("a") + link("b") + hinge("one", "base", "a", more=more) + hinge("two", "a", "b")
    robot = robot_from(body, torque=TorqueControl(torque_limit={"two": 7.0}))
    replay = build(robot, base="fixed", cache=tmp_path)
    np.testing.assert_array_equal(replay.friction_nm, [1.5, 0.0])
    np.testing.assert_array_equal(replay.damping_nms_rad, [0.7, 0.0])
    np.testing.assert_array_equal(replay.torque_limit_nm, [40.0, 7.0])
    data = mujoco.MjData(replay.mj)
    data.ctrl[replay.actuators] = [100.0, -100.0]
    mujoco.mj_forward(replay.mj, data)
    np.testing.assert_allclose(data.qfrc_actuator[replay.qvel], [40.0, -7.0])


@pytest.mark.parametrize(("effort", "limit"), [("0", math.inf), ("50000", math.inf), ("2000", 2000.0), ("0.5", 0.5)])
def test_efforts_that_no_joint_has_are_unknown(robot_from: RobotFactory, effort: str, limit: float) -> None:
    body = PENDULUM.replace('effort="40"', f'effort="{effort}"')
    assert torque_limits(robot_from(body)).tolist() == [limit]


def test_a_fixed_base_stands_upright_and_with_a_floor_on_its_soles(
    any_robot: Callable[[str], RobotModel], tmp_path: Path
) -> None:
    """iCub's root link looks backward: upright is half a turn."""
    robot = any_robot("icub")
    for base in ("fixed", "floating"):
        replay = build(robot, base=base, floor=True, cache=tmp_path)  # type: ignore[arg-type]  # a literal
        data = mujoco.MjData(replay.mj)
        data.qpos[:] = replay.configuration(robot.reference_posture)
        mujoco.mj_kinematics(replay.mj, data)
        np.testing.assert_allclose(
            data.body(robot.base_link).xmat.reshape(3, 3), np.diag([-1.0, -1.0, 1.0]), atol=1e-12
        )
        _, turn, offset = robot.link_in_joint("l_foot")
        body = data.body(replay.body_of_link["l_foot"])
        corners = robot.profile.feet["Left"].sole @ turn.T + offset
        heights = (corners @ body.xmat.reshape(3, 3).T + body.xpos)[:, 2]
        assert heights.min() == pytest.approx(0.0, abs=1e-4)


def test_without_self_collision_shapes_still_meet_the_floor(robot_from: RobotFactory, tmp_path: Path) -> None:
    ball = collision('<sphere radius="0.1"/>')
    names = "abcd"
    body = link("base", shapes=ball) + "".join(link(name, shapes=ball) for name in names)
    body += "".join(hinge(f"j{c}", p, c, at="0.25 0 0") for p, c in zip(("base", *names), names, strict=False))
    robot = robot_from(body, base="floating")
    folded = np.array([0.0, 0.0, 3.0, 0.0])  # d comes to lie on b, three joints from the base
    contacts = {}
    for own in (False, True):
        replay = build(robot, base="floating", floor=True, self_collision=own, cache=tmp_path)
        data = mujoco.MjData(replay.mj)
        for height in (0.05, 5.0):
            data.qpos[:] = replay.configuration(folded, base_position=np.array([0.0, 0.0, height]))
            mujoco.mj_forward(replay.mj, data)
            contacts[own, height] = data.ncon
        assert replay.self_collision is own
    assert contacts[False, 5.0] == 0
    assert contacts[False, 0.05] >= 4
    assert contacts[True, 0.05] == contacts[False, 0.05] + contacts[True, 5.0]


def test_links_know_the_body_that_carries_them(replayed: Replayed) -> None:
    replay = replayed("g1")
    assert replay.mj.body(replay.body_of_link["left_rubber_hand"]).name == "left_wrist_yaw_link"
    assert replay.mj.body(replay.body_of_link["pelvis"]).name == "pelvis"


def test_from_the_cache_comes_the_same_model(any_robot: Callable[[str], RobotModel], tmp_path: Path) -> None:
    robot = any_robot("icub")
    first = build(robot, base="fixed", self_collision=True, cache=tmp_path)
    (stored,) = tmp_path.iterdir()
    second = build(robot, base="fixed", self_collision=True, cache=tmp_path)
    for field in ("body_inertia", "body_pos", "geom_pos", "mesh_vert", "exclude_signature", "dof_armature"):
        np.testing.assert_array_equal(getattr(first.mj, field), getattr(second.mj, field))
    assert first.excluded == second.excluded
    stored.write_bytes(stored.read_bytes()[:1000])
    assert build(robot, base="fixed", self_collision=True, cache=tmp_path).excluded == first.excluded
    build(robot, base="fixed", cache=tmp_path)
    changed = replace(robot, profile=replace(robot.profile, torque=TorqueControl(torque_limit={"l_elbow": 3.0})))
    assert build(changed, base="fixed", cache=tmp_path).torque_limit_nm[robot.joint_index("l_elbow")] == 3.0
    assert len(list(tmp_path.iterdir())) == 3


def test_a_mesh_that_changes_makes_another_model(robot_from: RobotFactory, tmp_path: Path) -> None:
    mesh = tmp_path / "urdf" / "part.obj"
    robot = robot_from(
        link("base") + link("rod", shapes=collision('<mesh filename="part.obj"/>')) + hinge("swing", "base", "rod")
    )
    extents = []
    for edge in (1.0, 2.0):
        mesh.write_text(f"v 0 0 0\nv {edge} 0 0\nv 0 {edge} 0\nv 0 0 {edge}\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n")
        mj = build(robot, base="fixed", cache=tmp_path / "cache").mj
        extents.append(np.ptp(mj.mesh_vert, axis=0).max() / edge)
    assert extents[0] == pytest.approx(extents[1])


def test_a_cache_that_cannot_be_written_costs_only_time(robot_from: RobotFactory, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert build(robot_from(PENDULUM), base="fixed", cache=tmp_path / "file" / "cache").mj.nv == 1


def test_the_default_cache_follows_xdg(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert model_cache.default_folder() == tmp_path / "retarget"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert model_cache.default_folder() == tmp_path / "home" / ".cache" / "retarget"


def test_a_cache_folder_that_others_may_write_is_not_used(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "retarget").mkdir()
    (tmp_path / "retarget").chmod(0o777)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "temporary"))
    (tmp_path / "temporary").mkdir()
    folder = model_cache.default_folder()
    assert folder is not None
    assert folder.parent == tmp_path / "temporary"
    assert folder.stat().st_mode & 0o077 == 0


def test_missing_meshes_are_counted_and_left_out(robot_from: RobotFactory, tmp_path: Path) -> None:
    shapes = collision('<mesh filename="package://small/gone.stl"/>') + collision('<mesh filename="gone.stl"/>')
    shapes += collision('<sphere radius="0.1"/>') + collision('<sphere radius="0"/>') + collision("")
    body = link("base") + link("rod", shapes=shapes) + hinge("swing", "base", "rod")
    replay = build(robot_from(body), base="fixed", cache=tmp_path)
    assert replay.mj.ngeom == 1
    assert replay.warnings == (
        "2 × mesh not found (collision): package://small/gone.stl, …",
        "1 × sphere without a size (collision): rod",
        "1 × geometry without a shape (collision): rod",
    )


def test_a_sheet_cannot_collide_but_be_seen(robot_from: RobotFactory, tmp_path: Path) -> None:
    sheet = collision('<mesh filename="sheet.obj"/>')
    shapes = sheet + sheet.replace("collision", "visual")
    robot = robot_from(link("base") + link("rod", shapes=shapes) + hinge("swing", "base", "rod"))
    (tmp_path / "urdf" / "sheet.obj").write_text("v 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\nf 1 2 3 4\n")
    for _ in ("compiled", "from the cache"):
        replay = build(robot, base="fixed", visuals=True, cache=tmp_path / "cache")
        assert replay.mj.geom_group.tolist() == [2]
        assert replay.warnings == ("1 × flat mesh, which has no solid (collision): rod",)


def test_a_full_cache_forgets_what_was_not_used_for_longest(
    robot_from: RobotFactory, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bodies = [PENDULUM.replace("0 0 -0.5", f"0 0 -0.{i}") for i in range(1, 5)]
    folder = tmp_path / "cache"
    for i, body in enumerate(bodies[:3]):
        build(robot_from(body), base="fixed", cache=folder)
        for age, path in enumerate(sorted(folder.iterdir(), key=lambda path: -path.stat().st_mtime_ns)):
            os.utime(path, (1e9 - 100 * (age + 1),) * 2)
        assert len(list(folder.iterdir())) == i + 1
    used = build(robot_from(bodies[0]), base="fixed", cache=folder)
    size = next(folder.iterdir()).stat().st_size
    monkeypatch.setattr(model_cache, "LARGEST_FOLDER_BYTES", 2.5 * size)
    build(robot_from(bodies[3]), base="fixed", cache=folder)
    assert len(list(folder.iterdir())) == 2
    monkeypatch.setattr(mujoco.MjSpec, "compile", None)  # from the cache, or not at all
    assert build(robot_from(bodies[0]), base="fixed", cache=folder).mj.nv == used.mj.nv


@pytest.mark.parametrize(
    ("shapes", "message"),
    [
        ('<mesh filename="bad.stl"/>', "bad.stl: no readable mesh: the file is shorter than its header says"),
        ('<mesh filename="bad.ply"/>', "unknown mesh format '.ply'; expected .stl, .obj, .dae"),
        ('<box size="1 2"/>', "link 'rod' has size=\"1 2\"; expected 3 finite numbers"),
        ('<sphere radius="nan"/>', "link 'rod' has radius=\"nan\"; expected 1 finite number"),
    ],
)
def test_shapes_that_cannot_be_read_are_one_clear_line(
    robot_from: RobotFactory, tmp_path: Path, shapes: str, message: str
) -> None:
    body = link("base") + link("rod", shapes=collision(shapes)) + hinge("swing", "base", "rod")
    robot = robot_from(body)
    for suffix in (".stl", ".ply"):
        (tmp_path / "urdf" / f"bad{suffix}").write_bytes(b"nothing")
    with pytest.raises(ProfileError) as raised:
        build(robot, base="fixed", cache=tmp_path)
    assert message in str(raised.value)
    assert "\n" not in str(raised.value)


def test_what_is_only_seen_never_collides(any_robot: Callable[[str], RobotModel], tmp_path: Path) -> None:
    robot = any_robot("atlas")
    seen = build(robot, base="floating", self_collision=True, visuals=True, cache=tmp_path)
    solid = build(robot, base="floating", self_collision=True, cache=tmp_path)
    assert seen.mj.ngeom == solid.mj.ngeom + 35
    assert seen.excluded == solid.excluded
    added = seen.mj.geom_group == 2
    assert added.sum() == 35
    assert not seen.mj.geom_contype[added].any()
    assert not seen.mj.geom_conaffinity[added].any()
