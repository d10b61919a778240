"""ROS recordings on the command line: folders, bags, MCAP files and pipes; what `info` says; outputs are no inputs."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from retarget import formats
from retarget.core import timebase

from tests.formats.ros_recordings import (
    EVO_BAG,
    EVO_FOLDER,
    Ros,
    Sent,
    flat_tf,
    stamps,
    storage,
    write_bag,
    write_folder,
)
from tests.formats.test_ros_suits import walk

Run = Callable[..., Result]
RunProgram = Callable[..., "subprocess.CompletedProcess[bytes]"]


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with one short walk as `sqlite` (rosbag2), `walk.bag` and `walk.mcap`."""
    folder = tmp_path_factory.mktemp("recordings")
    short = timebase.cut(walk(), 0.0, 0.4)
    ros, ros1 = Ros(2), Ros(1)
    write_folder(folder / "sqlite", ros, flat_tf(ros, short, short.orientation))
    write_bag(folder / "walk.bag", ros1, flat_tf(ros1, short, short.orientation))
    in_mcap = write_folder(folder / "mcap", ros, flat_tf(ros, short, short.orientation), mcap=True)
    shutil.move(storage(in_mcap), folder / "walk.mcap")
    shutil.rmtree(in_mcap)
    return folder


def test_a_folder_of_recordings_is_converted_and_outputs_in_it_are_no_inputs(
    run: Run, recordings: Path, tmp_path: Path
) -> None:
    shutil.copytree(recordings, tmp_path / "in")
    result = run("convert", "-r", "in", "--robot", "icub", "-o", "in/{stem}_out.mcap", "--dry-run", "-q", "--json")
    assert result.exit_code == 2  # walk.bag and walk.mcap have one stem
    assert "one output for" in result.stderr
    (tmp_path / "in" / "walk.bag").rename(tmp_path / "in" / "ros1.bag")
    result = run("convert", "-r", "in", "--robot", "icub", "-o", "in/{stem}_out.mcap", "-q", "--json")
    assert result.exit_code == 0, result.stderr
    names = sorted(json.loads(line)["input"] for line in result.stdout.splitlines())
    assert names == ["in/ros1.bag", "in/sqlite", "in/walk.mcap"]
    first, *others = [
        formats.read_trajectory(tmp_path / "in" / f"{stem}_out.mcap") for stem in ("sqlite", "ros1", "walk")
    ]
    for other in others:
        assert np.array_equal(first.position, other.position)
    again = run("convert", "-r", "in", "--robot", "icub", "-o", "in/{stem}_out.mcap", "--skip-existing", "-n", "-q")
    assert again.exit_code == 0, again.stderr


def test_mcap_from_a_file_and_from_a_pipe_give_the_same_bytes(program: RunProgram, recordings: Path) -> None:
    arguments = ("--robot", "icub", "-o", "-", "-q")
    path = recordings / "walk.mcap"
    from_file = program("convert", path, *arguments)
    with path.open("rb") as stream, subprocess.Popen(["cat"], stdin=stream, stdout=subprocess.PIPE) as cat:
        from_pipe = program("convert", "-", *arguments, stdin=cat.stdout)
    assert from_file.returncode == from_pipe.returncode == 0, from_pipe.stderr
    assert len(from_file.stdout) > 1000
    assert from_file.stdout == from_pipe.stdout


def test_info_lists_topics_frames_and_what_they_are(run: Run, recordings: Path) -> None:
    for name, kind in (("sqlite", "rosbag"), ("walk.mcap", "mcap")):
        result = run("info", recordings / name, "--json")
        assert result.exit_code == 0, result.stderr
        facts = json.loads(result.stdout)
        assert (facts["format"], facts["kind"], facts["frames"]) == (kind, "motion", 25)
        assert facts["topics"][0].startswith("/tf tf2_msgs/TFMessage 575 messages")
        assert "skeleton_pelvis in world 25 poses 60 Hz" in facts["frames_found"]
        assert 'Pelvis = "skeleton_pelvis"' in facts["suggested_map"]
    assert "topics" in run("info", recordings / "sqlite").stdout


def test_a_map_a_clock_and_definitions_are_options(run: Run, tmp_path: Path) -> None:
    ros = Ros(2)
    pose = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0, 0.0])
    sent = [
        Sent(
            "/rig", "geometry_msgs/msg/PoseStamped", stamp + 10**9 + frame * 10**6, ros.pose_stamped(stamp, "w", *pose)
        )
        for frame, stamp in enumerate(stamps(np.arange(91) / 90.0))
    ]
    write_folder(tmp_path / "rig", ros, sent)
    refused = run("info", "rig", "--json")
    assert json.loads(refused.stdout)["kind"] == "messages"
    (tmp_path / "map.toml").write_text('[trackers]\nwaist = "/rig"\n')
    facts = json.loads(run("info", "rig", "--json", "--frames", "map.toml", "--clock", "log", "--msg-def", ".").stdout)
    assert facts["segments"] == {"waist": "Pelvis"}
    assert abs(facts["duration_s"] - 1.09) < 1e-6
    missing = run("info", "rig", "--frames", "none.toml")
    assert (missing.exit_code, "--frames none.toml: no such file" in missing.stderr) == (2, True)
    no_toml = run("info", "rig", "--frames", "rig/metadata.yaml")
    assert (no_toml.exit_code, "not TOML" in no_toml.stderr) == (2, True)


@pytest.mark.skipif(not EVO_BAG.exists(), reason=f"the real recordings are not at {EVO_BAG.parent}")
def test_a_real_recording_by_roles(run: Run) -> None:
    for path in (EVO_BAG, EVO_FOLDER):
        result = run("info", path, "--json", "--roles", "base_link=waist")
        facts = json.loads(result.stdout)
        assert facts["trackers"][facts["trackers"].index("base_link")] == "base_link"
        assert facts["segments"]["base_link"] == "Pelvis"
        assert facts["frames"] == 517
