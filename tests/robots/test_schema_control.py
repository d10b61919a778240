"""[arms], [hierarchy] and [torque] of a profile: what they say arrives, and every mistake is one line with place and nearest choice."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from retarget import robots
from retarget.core import robot_model
from retarget.core.errors import ProfileError
from retarget.core.profile import Arm, Hierarchy, LevelTask, TorqueControl

ARM = 'shoulder_link = "torso_link"\nshoulder_m = [0, 0.1, 0.2]\nhand_link = "left_wrist_yaw_link"\nhand_m = [0.1, 0, 0]\n'
TASK = "[[hierarchy.levels]]\n[[hierarchy.levels.tasks]]\n"
ORIENTATION = f'{TASK}segment = "T8"\nkind = "orientation"\ngain_1_s = 100\n'
NO_ARMS = 'name = "mine"\n[model]\npackage = "example-robot-data"\npath = "g1_description/urdf/g1_29dof_rev_1_0.urdf"\n'


def write(folder: Path, text: str, start: str = 'extends = "g1"\n') -> str:
    path = folder / "mine.toml"
    path.write_text(start + text, encoding="utf-8")
    return str(path)


def refusal(path: str) -> str:
    with pytest.raises(ProfileError) as caught:
        robot_model.build(robots.load(path))
    message = str(caught.value)
    assert "\n" not in message
    assert "mine.toml" in message
    return message


FULL = """
[arms.Left]
shoulder_link = "pelvis"
shoulder_m = [0.0, 0.1, 0.2]
hand_link = "left_wrist_yaw_link"
hand_m = [0.1, 0.0, 0.0]
elbow_link = "left_elbow_link"
length_m = 0.4

[hierarchy]
joints = ["waist_*", "*_elbow_joint"]
limit_gain_1_s = 10
hand_speed_m_s = 1.5
hand_rate_rad_s = 4
inertia_diagonal = 0

[hierarchy.extra_inertia]
"*_shoulder_*" = 1
left_shoulder_roll_joint = 7

[hierarchy.lower_rad]
"*_elbow_joint" = -0.5
[hierarchy.upper_rad]
right_elbow_joint = 1.2

[[hierarchy.levels]]
weight = 20
acceleration_s2 = 1e-4
tasks = [{ segment = "LeftHand", kind = "position", gain_1_s = 200 }]

[[hierarchy.levels]]
[[hierarchy.levels.tasks]]
segment = "LeftUpperArm"
kind = "axis"
axis = [0, 0, -1]
gain_1_s = 50
weight = 0.25
[[hierarchy.levels.tasks]]
segment = "Head"
kind = "axis"
link = "head_link"
gain_1_s = 60

[torque]
standing_joints = ["left_knee_joint", "*_hip_yaw_joint"]
[torque.stiffness_nm_rad]
"*" = 100
left_knee_joint = 300
[torque.damping_nms_rad]
left_knee_joint = 5
[torque.limit_nm]
"left_*_joint" = 50
"""


def test_everything_said_arrives(tmp_path: Path) -> None:
    mine = robots.load(write(tmp_path, FULL))
    assert mine.arms["Left"] == Arm(
        "pelvis", (0.0, 0.1, 0.2), "left_wrist_yaw_link", (0.1, 0.0, 0.0), 0.4, "left_elbow_link"
    )
    assert mine.arms["Right"] == robots.load("g1").arms["Right"]
    hierarchy = mine.hierarchy
    assert (hierarchy.limit_gain, hierarchy.hand_speed_m_s, hierarchy.hand_rate_rad_s) == (10.0, 1.5, 4.0)
    assert hierarchy.inertia_diagonal == 0.0
    assert hierarchy.lower == {"*_elbow_joint": -0.5}
    assert hierarchy.upper == {"*_elbow_joint": 1.55, "right_elbow_joint": 1.2}  # the parent's own stays
    first, second = hierarchy.levels
    assert (first.weight, first.acceleration_s2) == (20.0, 1e-4)
    assert first.tasks == (LevelTask("LeftHand", "position", 200.0),)
    assert (second.weight, second.acceleration_s2) == (50.0, 0.0)
    assert second.tasks == (
        LevelTask("LeftUpperArm", "axis", 50.0, "", (0.0, 0.0, -1.0), 0.25),
        LevelTask("Head", "axis", 60.0, "head_link", (1.0, 0.0, 0.0)),
    )


def test_patterns_become_joint_names_and_the_last_match_wins(tmp_path: Path) -> None:
    model = robot_model.build(robots.load(write(tmp_path, FULL)))
    hierarchy, torque = model.profile.hierarchy, model.profile.torque
    assert set(hierarchy.joints) == {
        "waist_yaw_joint", "waist_roll_joint", "waist_pitch_joint", "left_elbow_joint", "right_elbow_joint",
    }  # fmt: skip
    assert hierarchy.lower == {"left_elbow_joint": -0.5, "right_elbow_joint": -0.5}
    assert hierarchy.upper == {"left_elbow_joint": 1.55, "right_elbow_joint": 1.2}
    assert hierarchy.extra_inertia == {
        f"{side}_shoulder_{axis}_joint": 7.0 if (side, axis) == ("left", "roll") else 1.0
        for side in ("left", "right")
        for axis in ("pitch", "roll", "yaw")
    }
    assert set(torque.stiffness) == set(model.joint_names)
    assert {joint for joint, value in torque.stiffness.items() if value != 100.0} == {"left_knee_joint"}
    assert torque.damping == {"left_knee_joint": 5.0}
    assert torque.standing_joints == ("left_hip_yaw_joint", "left_knee_joint", "right_hip_yaw_joint")
    assert len(torque.torque_limit) == 13
    assert set(torque.torque_limit.values()) == {50.0}


def test_a_profile_without_these_tables_has_the_papers_defaults() -> None:
    human = robots.load("human")
    assert (human.arms, human.hierarchy, human.torque) == ({}, Hierarchy(), TorqueControl())


def test_a_variant_adds_to_tables_and_replaces_levels(tmp_path: Path) -> None:
    text = 'extends = "tocabi"\n[torque.limit_nm]\n"*_Elbow_Joint" = 20\n[hierarchy.extra_inertia]\nHead_Joint = 1\n'
    path = write(tmp_path, ORIENTATION, start=text)
    mine, parent = robot_model.build(robots.load(path)).profile, robot_model.build(robots.load("tocabi")).profile
    changed = {j for j, value in mine.torque.torque_limit.items() if value != parent.torque.torque_limit[j]}
    assert changed == {"L_Elbow_Joint", "R_Elbow_Joint"}
    assert mine.hierarchy.extra_inertia == {**parent.hierarchy.extra_inertia, "Head_Joint": 1.0}
    assert mine.hierarchy.joints == parent.hierarchy.joints
    assert [len(level.tasks) for level in mine.hierarchy.levels] == [1]
    assert mine.arms == parent.arms


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("[arms.left]\n", "[arms]: unknown key 'left'; did you mean 'Left'?"),
        ("[arms.Left]\nshoulder = 3\n", "[arms.Left]: unknown key 'shoulder'; did you mean 'shoulder_"),
        ("[arms.Left]\nlength_mm = 3\n", "[arms.Left]: unknown key 'length_mm'; did you mean 'length_m'?"),
        (
            "[hierarchy]\nlimit_gain = 3\n",
            "[hierarchy]: unknown key 'limit_gain'; did you mean 'limit_gain_1_s'",
        ),
        (
            "[[hierarchy.levels]]\nweigth = 3\n",
            "[hierarchy.levels[0]]: unknown key 'weigth'; did you mean 'weight'?",
        ),
        (
            f"{TASK}gain = 3\n",
            "[hierarchy.levels[0].tasks[0]]: unknown key 'gain'; did you mean 'gain_1_s'?",
        ),
        ("[torque]\nstiffness = {}\n", "[torque]: unknown key 'stiffness'; did you mean 'stiffness_nm_rad'?"),
        ("[torque.limit_n]\n", "[torque]: unknown key 'limit_n'; did you mean 'limit_nm'?"),
    ],
)
def test_unknown_key_names_the_nearest(tmp_path: Path, text: str, told: str) -> None:
    assert told in refusal(write(tmp_path, text))


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("arms = 3\n", "key arms: found 3; expected a table"),
        ("[arms.Left]\nshoulder_m = [0, 1]\n", "key arms.Left.shoulder_m: found [0, 1]; expected a list of 3 finite"),
        ("[arms.Left]\nhand_m = [0, 1, nan]\n", "key arms.Left.hand_m: found [0, 1, nan]; expected a list of 3 finite"),
        ("[arms.Left]\nlength_m = 0\n", "key arms.Left.length_m: found 0.0; expected a number above 0"),
        ("[arms.Left]\nhand_link = 3\n", "key arms.Left.hand_link: found 3; expected text"),
        ("[hierarchy]\njoints = 'all'\n", "key hierarchy.joints: found 'all'; expected a list of texts"),
        ("[hierarchy]\nlimit_gain_1_s = 0\n", "key hierarchy.limit_gain_1_s: found 0.0; expected a number above 0"),
        ("[hierarchy]\nhand_speed_m_s = -2\n", "key hierarchy.hand_speed_m_s: found -2.0; expected a number above 0"),
        ("[hierarchy]\nhand_rate_rad_s = inf\n", "key hierarchy.hand_rate_rad_s: found inf; expected a finite number"),
        ("[hierarchy]\ninertia_diagonal = -1\n", "key hierarchy.inertia_diagonal: found -1.0; expected a number ≥ 0"),
        (
            "[hierarchy.extra_inertia]\nleft_knee_joint = -1\n",
            "extra_inertia.left_knee_joint: found -1.0; expected a n",
        ),
        ("[hierarchy]\nlevels = 3\n", "key hierarchy.levels: found 3; expected an array of tables"),
        ("[[hierarchy.levels]]\n", "key hierarchy.levels[0].tasks: found []; expected at least one task"),
        (
            ORIENTATION.replace("[[hierarchy.levels]]", "[[hierarchy.levels]]\nweight = 0", 1),
            "key hierarchy.levels[0].weight: found 0.0; expected a number above 0",
        ),
        (
            ORIENTATION.replace("[[hierarchy.levels]]", "[[hierarchy.levels]]\nacceleration_s2 = -1", 1),
            "key hierarchy.levels[0].acceleration_s2: found -1.0; expected a number ≥ 0",
        ),
        (f"{TASK}kind = 'axis'\n", "key hierarchy.levels[0].tasks[0].segment: found None; expected text"),
        (ORIENTATION.replace("T8", "T9"), "tasks[0].segment: found 'T9'; did you mean 'T8'?"),
        (ORIENTATION.replace("T8", "Chest"), "tasks[0].segment: found 'Chest'; expected "),
        (
            ORIENTATION.replace("orientation", "position"),
            "found 'T8'; expected LeftHand or RightHand, the segments with",
        ),
        (ORIENTATION.replace("orientation", "pose"), "tasks[0].kind: found 'pose'; did you mean 'position'?"),
        (ORIENTATION.replace("100", "0"), "tasks[0].gain_1_s: found 0.0; expected a number above 0"),
        (ORIENTATION.replace("gain_1_s = 100\n", ""), "tasks[0].gain_1_s: found None; expected a finite number"),
        (f"{ORIENTATION}axis = [1, 0, 0]\n", "tasks[0].axis: found [1, 0, 0]; expected no axis unless kind is 'axis'"),
        (
            ORIENTATION.replace("orientation", "axis") + "axis = [1, 1, 0]\n",
            "tasks[0].axis: found [1.0, 1.0, 0.0]; expected a unit vector",
        ),
        (
            ORIENTATION.replace("T8", "Head"),
            "found 'Head'; expected a segment of [links], or a link of its own; [links] ha",
        ),
        (
            f'{TASK}segment = "LeftHand"\nkind = "position"\nlink = "pelvis"\ngain_1_s = 1\n',
            "tasks[0].link: found 'pelvis'; expected no link where kind is 'position': [arms.Left] tells it",
        ),
        ("[torque]\nlimit_nm = 3\n", "key torque.limit_nm: found 3; expected a table"),
        (
            "[torque.limit_nm]\nleft_knee_joint = 0\n",
            "torque.limit_nm.left_knee_joint: found 0.0; expected a number above",
        ),
        ("[torque.stiffness_nm_rad]\nleft_knee_joint = -1\n", "left_knee_joint: found -1.0; expected a number ≥ 0"),
        (
            "[torque.damping_nms_rad]\nleft_knee_joint = 'low'\n",
            "left_knee_joint: found 'low'; expected a finite number",
        ),
    ],
)
def test_wrong_value_names_the_key(tmp_path: Path, text: str, told: str) -> None:
    assert told in refusal(write(tmp_path, text))


def test_a_position_task_needs_its_arm(tmp_path: Path) -> None:
    text = f'{TASK}segment = "RightHand"\nkind = "position"\ngain_1_s = 1\n[arms.Left]\n{ARM}'
    assert "found 'RightHand'; expected an arm for its hand point, [arms.Right]" in refusal(
        write(tmp_path, text, start=NO_ARMS)
    )


def test_an_arm_must_be_whole(tmp_path: Path) -> None:
    for key in ("shoulder_link", "shoulder_m", "hand_link", "hand_m"):
        lines = "".join(line for line in ARM.splitlines(keepends=True) if not line.startswith(key))
        message = refusal(write(tmp_path, f"[arms.Left]\n{lines}", start=NO_ARMS))
        assert f"key arms.Left.{key}: found None; expected" in message


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (
            "[arms.Left]\nshoulder_link = 'torso_lnk'\n",
            "[arms.Left] shoulder_link: the model has no link 'torso_lnk'; did you mean torso_link",
        ),
        ("[arms.Right]\nhand_link = 'right_hnd'\n", "[arms.Right] hand_link: the model has no link 'right_hnd'; did you mean"),
        ("[arms.Left]\nhand_link = ''\n", "[arms.Left] hand_link: the model has no link ''; expected one of"),
        ("[arms.Left]\nelbow_link = 'left_elbo'\n", "[arms.Left] elbow_link: the model has no link 'left_elbo'; did you mean"),
        (
            f"{ORIENTATION}link = 'tors_link'\n",
            "hierarchy.levels[0] T8: the model has no link 'tors_link'; did you mean torso_link",
        ),
        ("[hierarchy]\njoints = ['arm_*']\n", "[hierarchy] joints: the model has no joint 'arm_*'"),
        (
            "[hierarchy.extra_inertia]\nleft_kne_joint = 1\n",
            "[hierarchy.extra_inertia]: the model has no joint 'left_kne_joint'; did you mean left_knee_joint",
        ),
        ("[torque.limit_nm]\n'*_finger' = 1\n", "[torque.limit_nm]: the model has no joint '*_finger'"),
        ("[torque.damping_nms_rad]\nleft_knee = 1\n", "[torque.damping_nms_rad]: the model has no joint 'left_knee'; did you mean"),
        ("[torque]\nstanding_joints = ['left_knee']\n", "[torque] standing_joints: the model has no joint 'left_knee'"),
        ("[torque.stiffness_nm_rad]\nleft_knee = 1\n", "[torque.stiffness_nm_rad]: the model has no joint 'left_knee'"),
    ],
)  # fmt: skip
def test_what_the_model_lacks(tmp_path: Path, text: str, told: str) -> None:
    assert told in refusal(write(tmp_path, text))


def test_nearly_unit_axes_are_made_exact(tmp_path: Path) -> None:
    text = ORIENTATION.replace("orientation", "axis") + "axis = [0.6, 0.8001, 0]\n"
    axis = robots.load(write(tmp_path, text)).hierarchy.levels[0].tasks[0].axis
    assert np.linalg.norm(axis) == pytest.approx(1.0, abs=1e-15)
