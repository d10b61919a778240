"""What can go wrong between a name on the command line and a profile: one clear line each, naming file, key and nearest choice."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from retarget import robots
from retarget.core import robot_model
from retarget.core.errors import ProfileError, UnknownNameError

MINE = 'extends = "g1"\n'


def write(folder: Path, text: str, name: str = "mine.toml") -> str:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return str(path)


def refusal(path: str) -> str:
    """The message of the error that loading (and building) the profile raises; one line, naming the file."""
    with pytest.raises(ProfileError) as caught:
        robot_model.build(robots.load(path))
    message = str(caught.value)
    assert "\n" not in message
    return message


def test_names_lists_the_folder() -> None:
    assert robots.names() == sorted(robots.names())
    assert {"atlas", "baxter", "g1", "human", "icub", "talos", "tocabi"} <= set(robots.names())


@pytest.mark.parametrize(("name", "near"), [("g2", "g1"), ("iCub", "icub"), ("tallos", "talos"), ("baxtre", "baxter")])
def test_unknown_robot_names_the_nearest(name: str, near: str) -> None:
    with pytest.raises(UnknownNameError, match=rf"unknown robot '{name}'; did you mean {near}"):
        robots.load(name)


def test_unknown_robot_unlike_any_lists_all() -> None:
    with pytest.raises(UnknownNameError, match="choose from atlas, baxter, g1"):
        robots.load("zzzzzzzz")


def test_missing_file() -> None:
    with pytest.raises(ProfileError, match=r"nowhere/mine\.toml: no such profile file"):
        robots.load("nowhere/mine.toml")


def test_a_folder_is_no_profile(tmp_path: Path) -> None:
    with pytest.raises(ProfileError, match="no such profile file"):
        robots.load(f"{tmp_path}/")


def test_not_toml(tmp_path: Path) -> None:
    assert "mine.toml: not TOML: " in refusal(write(tmp_path, "links = [\n"))


@pytest.mark.parametrize("content", [MINE.encode("utf-16"), b'name = "G\xfc"\n'])
def test_wrong_encoding(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "mine.toml"
    path.write_bytes(content)
    assert "not UTF-8 text" in refusal(str(path))


def test_byte_order_mark_is_taken(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_bytes(b"\xef\xbb\xbf" + MINE.encode())
    assert robots.load(str(path)).links["Pelvis"] == "pelvis"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ('discription = "x"', "top level: unknown key 'discription'; did you mean 'description'?"),
        ('[model]\npth = "x"', "[model]: unknown key 'pth'; did you mean 'path'?"),
        ('[links]\nLeftForearm = "x"', "[links]: unknown key 'LeftForearm'; did you mean 'LeftForeArm'?"),
        (
            "[limits]\ndefault_velocity = 1.0",
            "[limits]: unknown key 'default_velocity'; did you mean 'default",
        ),
        (
            "[limits.joints.left_knee_joint]\nlower = 0",
            "[limits.joints.left_knee_joint]: unknown key 'lower'; did you mean",
        ),
        ("[hands.left]\n", "[hands]: unknown key 'left'; did you mean 'Left'?"),
        (
            "[mapping.limb_plane]\nweight = {}",
            "[mapping.limb_plane]: unknown key 'weight'; did you mean 'weig",
        ),
        ("[[coupled]]\nrow = []", "unknown key 'row'; did you mean 'rows'?"),
        ("[tpose_exceptions]\nT9 = {}", "[tpose_exceptions]: unknown key 'T9'; did you mean 'T8'?"),
    ],
)
def test_unknown_key_names_the_nearest(tmp_path: Path, text: str, told: str) -> None:
    message = refusal(write(tmp_path, f"{MINE}{text}\n"))
    assert "mine.toml" in message
    assert told in message


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("description = 3", "key description: found 3; expected text"),
        ("links = 3", "key links: found 3; expected a table"),
        ("[links]\nHead = 1", "key links.Head: found 1; expected text"),
        ("model = []", "key model: found []; expected a table"),
        ('[model]\nbase = "swimming"', "key model.base: found 'swimming'; expected 'floating' or 'fixed'"),
        ('[model]\nbase_segment = "Hip"', "key model.base_segment: found 'Hip'; expected a canonical segment name"),
        ("[model]\nbase_rpy_rad = [0, 1]", "key model.base_rpy_rad: found [0, 1]; expected a list of 3 finite numbers"),
        ("[model]\nbase_rpy_rad = [0, 1, nan]", "expected a list of 3 finite numbers"),
        ("[model]\nbase_rpy_rad = [0, 1, true]", "expected a list of 3 finite numbers"),
        ("[model]\nlocked_joints = 'all'", "key model.locked_joints: found 'all'; expected a list of texts"),
        ("[reference_posture_rad]\nleft_elbow_joint = '90'", "found '90'; expected a finite number"),
        ("[reference_posture_rad]\nleft_elbow_joint = inf", "found inf; expected a finite number"),
        ("[limits]\ndefault_velocity_rad_s = 0", "found 0.0; expected a number above 0"),
        ("[limits.joints]\nleft_knee_joint = 3", "key limits.joints.left_knee_joint: found 3; expected a table"),
        ("[hands.Left]\nfingers = [1, 1, 0]", "expected a unit vector"),
        ("[hands.Left]\npalm = [1, 0, 0]", "key hands.Left.palm: found (1.0, 0.0, 0.0); expected a direction perpend"),
        ("[feet.Left]\nsole_m = [[0, 0, 0], [1, 0, 0]]", "expected at least three corners"),
        ("[feet.Left]\nsole_m = [[0, 0], [1, 0], [1, 1]]", "expected rows of 3 finite numbers"),
        ("[feet.Left]\nsole_m = [[0, 0, 'x'], [1, 0, 0], [1, 1, 0]]", "expected rows of 3 finite numbers"),
        ("[mapping.limb_plane.weights]\nHead = -1", "found -1.0; expected a number ≥ 0"),
        ('coupled = "rows"', "key coupled: found 'rows'; expected an array of tables"),
        ("[[coupled]]\njoints = ['a', 'b']\nrows = [[1.0]]", "expected rows of 2 finite numbers"),
        (
            "[[coupled]]\njoints = ['a']\nrows = [[1.0]]\nlower_rad = [1]\nupper_rad = [0]",
            "key coupled[0].lower_rad: found [1.0]; expected nothing above upper_rad",
        ),
    ],
)
def test_wrong_value_names_the_key(tmp_path: Path, text: str, told: str) -> None:
    message = refusal(write(tmp_path, f"{MINE}{text}\n"))
    assert "mine.toml" in message
    assert told in message


@pytest.mark.parametrize(
    ("model", "told"),
    [
        ("", "key model: found None; expected a table"),
        ("[model]\n", "expected exactly one of package (with path), file, human"),
        ("[model]\nhuman = true\nfile = 'a.urdf'\n", "found ['file', 'human']; expected exactly one of"),
        ("[model]\nhuman = false\n", "key model.human: found False; expected true"),
        ("[model]\npackage = 'example-robot-data'\n", "key model.path: found None; expected text"),
        ("[model]\npackage = 'no-such-package'\npath = 'a.urdf'\n", "package 'no-such-package' is not installed"),
        ("[model]\npackage = ''\npath = 'a.urdf'\n", "package '' is not installed"),
        ("[model]\npackage = 'numpy-'\npath = 'a.urdf'\n", "is not installed"),
        ("[model]\npackage = 'click'\npath = 'core.urdf'\n", "no model file core.urdf"),
        ("[model]\nfile = 'absent.urdf'\n", "absent.urdf"),
    ],
)
def test_where_the_model_comes_from(tmp_path: Path, model: str, told: str) -> None:
    assert told in refusal(write(tmp_path, model))


def test_missing_model_file_names_the_nearest(tmp_path: Path) -> None:
    text = "[model]\npackage = 'example-robot-data'\npath = 'talos_data/robots/talos_reducd.urdf'\n"
    message = refusal(write(tmp_path, text))
    assert "no model file talos_data/robots/talos_reducd.urdf" in message
    assert "did you mean talos_data/robots/talos_reduced.urdf" in message


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (
            '[links]\nHead = "head_lnk"',
            "[links] Head: the model has no link 'head_lnk'; did you mean head_link",
        ),
        (
            '[hands.Left]\nlink = "left_rubber_hnd"',
            "[hands.Left]: the model has no link 'left_rubber_hnd'; did you mean",
        ),
        ('[feet.Right]\nlink = "nothing_like_it_at_all"', "[feet.Right]: the model has no link"),
        ('[limb_ends]\nLeftForeArm = "left_rubber"', "[limb_ends] LeftForeArm: the model has no link 'left_rubber'"),
        (
            '[mapping.link_orientation.links]\nHead = "hd_link"',
            "[mapping.link_orientation.links] Head: the model has no",
        ),
        (
            "[reference_posture_rad]\nleft_elbow = 0",
            "[reference_posture_rad]: the model has no joint 'left_elbow'; did you mean",
        ),
        (
            "[limits.joints.left_kne_joint]\nlower_rad = 0",
            "the model has no joint 'left_kne_joint'; did you mean",
        ),
        ("[model]\nlocked_joints = ['wheel_*']", "[model] locked_joints: the model has no joint 'wheel_*'"),
        (
            "[tpose_exceptions]\nHead = { joint = 'neck', error_deg = 1 }",
            "[tpose_exceptions]: the model has no joint 'nec",
        ),
        (
            "[[coupled]]\njoints = ['left_knee']\nrows = [[1.0]]\nlower_rad = [0]\nupper_rad = [1]",
            "[[coupled]] joints: the model has no joint 'left_knee'; did you mean left_knee_joint",
        ),
        (
            "[limits.joints.left_knee_joint]\nlower_rad = 4.0",
            "[limits]: joint 'left_knee_joint' has range 4…2.8798 and speed limit 20; expected lower ≤ upper",
        ),
    ],
)
def test_what_the_model_lacks(tmp_path: Path, text: str, told: str) -> None:
    message = refusal(write(tmp_path, f"{MINE}{text}\n"))
    assert "mine.toml" in message
    assert told in message


def test_unknown_mapping(tmp_path: Path) -> None:
    profile = robots.load(write(tmp_path, f"{MINE}[mapping.limb_plain.weights]\nHead = 1.0\n"))
    with pytest.raises(UnknownNameError, match=r"\[mapping\]: unknown mapping 'limb_plain'; did you mean limb_plane"):
        robot_model.build(profile)


class TestExtends:
    def test_a_variant_changes_what_it_names_and_nothing_else(self, tmp_path: Path) -> None:
        text = f"{MINE}[limits.joints.left_knee_joint]\nvelocity_rad_s = 5.0\n[links]\nHead = 'head_link'\n"
        mine, parent = robots.load(write(tmp_path, text)), robots.load("g1")
        assert mine.name == "mine"
        assert mine.links == {**parent.links, "Head": "head_link"}
        assert mine.reference_posture == parent.reference_posture
        model, original = robot_model.build(mine), robot_model.build(parent)
        changed = np.flatnonzero(model.velocity_limit != original.velocity_limit)
        assert [model.joint_names[i] for i in changed] == ["left_knee_joint"]
        assert model.velocity_limit[changed] == [5.0]

    def test_a_variant_with_a_model_of_its_own_forgets_the_parents(self, tmp_path: Path) -> None:
        (tmp_path / "own.urdf").write_bytes(b"<robot name='x'/>")
        mine = robots.load(write(tmp_path, f"{MINE}[model]\nfile = 'own.urdf'\n"))
        assert (mine.model.kind, mine.model.path) == ("file", str(tmp_path / "own.urdf"))
        assert mine.model.package == ""

    def test_a_chain_of_files_each_beside_the_other(self, tmp_path: Path) -> None:
        (tmp_path / "deep").mkdir()
        write(tmp_path / "deep", f"{MINE}description = 'first'\n", "first.toml")
        write(tmp_path, "extends = 'deep/first.toml'\n", "second.toml")
        mine = robots.load(write(tmp_path, "extends = 'second.toml'\n"))
        assert mine.description == "first"

    def test_a_list_is_replaced_not_added_to(self, tmp_path: Path) -> None:
        text = "extends = 'icub'\ntpose_exceptions = {}\n[[coupled]]\njoints = ['l_elbow']\nrows = [[1.0]]\n"
        mine = robots.load(write(tmp_path, f"{text}lower_rad = [0.2]\nupper_rad = [1.0]\n"))
        assert [rows.joints for rows in mine.coupled] == [("l_elbow",)]

    @pytest.mark.parametrize("parent", ["itself.toml", "other.toml"])
    def test_a_circle(self, tmp_path: Path, parent: str) -> None:
        write(tmp_path, "extends = 'itself.toml'\n", "other.toml")
        path = write(tmp_path, f"extends = '{parent}'\n", "itself.toml")
        assert "extends more than 8 profiles deep" in refusal(path)

    def test_unknown_parent(self, tmp_path: Path) -> None:
        with pytest.raises(UnknownNameError, match=r"mine\.toml, key extends: unknown robot 'g2'; did you mean g1"):
            robots.load(write(tmp_path, "extends = 'g2'\n"))

    def test_missing_parent_file(self, tmp_path: Path) -> None:
        assert "key extends: no such profile file" in refusal(write(tmp_path, "extends = 'absent.toml'\n"))

    def test_no_name_at_all(self, tmp_path: Path) -> None:
        assert "key extends: found 3; expected a robot's name or a TOML path" in refusal(
            write(tmp_path, "extends = 3\n")
        )
