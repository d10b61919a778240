"""Definitions of messages that a recording brings: rosbags makes Python code of them, so what is in them is checked before."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
from retarget import formats
from retarget.core.errors import FormatError
from retarget.formats._ros_definitions import check
from rosbags.interfaces import Nodetype

from tests.formats.ros_recordings import LINK_STATE, LINK_STATE_ARRAY, LINKS, mcap_bytes

WHOLE = f"{LINK_STATE_ARRAY}{'=' * 80}\nMSG: xsens_mvn_ros_msgs/LinkState\n{LINK_STATE}"


def refusal(message_type: str, definition: str, *payloads: bytes, ros1: bool = False) -> str:
    schema, encoding = ("ros1msg", "ros1") if ros1 else ("ros2msg", "cdr")
    messages = [("/l", time, payload) for time, payload in enumerate(payloads or [bytes(40)], 1)]
    data = mcap_bytes([("/l", message_type, schema, encoding, definition.encode())], messages)
    with pytest.raises(FormatError) as caught:
        formats.read_recording(io.BytesIO(data), "a.mcap")
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize(
    "message_type",
    [
        "x:\n    pass\nopen('{path}', 'w')\nclass y/msg/LinkStateArray",
        "x(open('{path}', 'w'))/msg/LinkStateArray",
        'x:\n    """\n    pass\nopen(\'{path}\', "w")\nclass y/LinkStateArray',
    ],
)
def test_a_type_whose_name_is_code_is_not_run(tmp_path: Path, message_type: str) -> None:
    """rosbags writes names into the code of a class as they are; its parser refuses these, and so does ours."""
    path = str(tmp_path / "ran").replace("/", "' + chr(47) + '")
    line = refusal(message_type.format(path=path), "uint8 x\n")
    assert "can't be read: " in line
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize("ros1", [True, False])
@pytest.mark.parametrize(
    ("definition", "problem"),
    [
        ("xsens_mvn_ros_msgs/LinkState[{many}] states", "states of {type} is a fixed array of 100000000"),
        ("string[{many}] names", "names of {type} is a fixed array of 100000000"),
        ("float64[{many}] numbers", "numbers of {type} is a fixed array of 100000000"),
        ("std_msgs/Empty[] states", "states of {type} is of std_msgs/msg/Empty, which holds nothing"),
        ("xsens_mvn_ros_msgs/LinkStateArray[] states", "{type} holds itself"),
        ("nobody_msgs/Knows[] states", "it refers to nobody_msgs/msg/Knows, which is not defined"),
        (
            f"a_msgs/A a\na_msgs/A b\n{'=' * 80}\nMSG: a_msgs/A\na_msgs/B a\na_msgs/B b\n{'=' * 80}\nMSG: a_msgs/B\n",
            "a of a_msgs/msg/A is of a_msgs/msg/B, which holds nothing",
        ),
    ],
)
def test_definitions_that_would_take_for_ever(definition: str, problem: str, ros1: bool) -> None:
    payload = b"\xff" * 4 if ros1 else b"\0\1\0\0" + b"\xff" * 4
    line = refusal(LINKS, definition.replace("{many}", "100000000"), payload, ros1=ros1)
    assert (
        f"topic /l: the recording's definition of xsens_mvn_ros_msgs/LinkStateArray can't be read: {problem.format(type=LINKS)}"
        in line
    )


@pytest.mark.parametrize("names", [("a b/msg/C", "x"), ("a/msg/C", "x: int = print()"), ("a/msg/C\n", "x"), ("C", "x")])
def test_names_that_are_none(names: tuple[str, str]) -> None:
    """What no parser lets through today."""
    types = {names[0]: ([], [(names[1], (Nodetype.BASE, ("uint8", 0)))])}
    with pytest.raises(ValueError, match="where a name belongs"):
        check(types)


def test_more_links_than_there_are_bytes() -> None:
    line = refusal(LINKS, WHOLE, b"\0\1\0\0" + bytes(4), b"\0\1\0\0" + b"\xff" * 4)
    assert "topic /l, message 1: not a xsens_mvn_ros_msgs/LinkStateArray" in line
