"""What a recording doesn't say of itself, on the command line: `convert` writes it into the provenance, `validate` takes it for --recording."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result
from retarget import formats, samples
from retarget.core import calibration, timebase
from retarget.core.calibrate.operator import calibrate
from retarget.formats import TrackerOptions

from tests.formats.ros_recordings import Ros, flat_tf, write_folder
from tests.formats.test_ros_suits import walk

Run = Callable[..., Result]
SECOND = 'prefix = "skeleton_1_"\n'


@pytest.fixture(scope="module")
def two_people(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bag of two people half a step apart: `skeleton_` and `skeleton_1_`."""
    first, later = timebase.cut(walk(), 0.0, 0.4), timebase.cut(walk(), 0.55, 0.95)
    count = min(first.frames, later.frames)
    first = timebase.cut(first, 0.0, float(first.time[count - 1]))
    later = replace(timebase.cut(later, later.time[0], float(later.time[count - 1])), time=first.time)
    ros = Ros(2)
    both = [
        *flat_tf(ros, first, first.orientation),
        *flat_tf(ros, later, later.orientation, prefix="skeleton_1_"),
    ]
    folder = tmp_path_factory.mktemp("people") / "two"
    return write_folder(folder, ros, sorted(both, key=lambda sent: sent.log_time))


def provenance(result: Result) -> dict[str, Any]:
    assert result.exit_code == 0, result.stderr
    found: dict[str, Any] = json.loads(result.stdout)["provenance"]
    return found


def limbs(result: Result) -> dict[str, Any]:
    assert result.stdout, result.stderr
    checks = json.loads(result.stdout)["checks"]
    found: dict[str, Any] = next(check for check in checks if check["name"] == "limb_direction_error_deg")
    return found


def test_map_and_clock_go_into_the_provenance_without_paths(run: Run, two_people: Path, tmp_path: Path) -> None:
    (tmp_path / "second.toml").write_text(SECOND)
    common = ("convert", two_people, "--robot", "icub", "--json", "-q", "--force", "-o", "out.mcap")
    found = provenance(run(*common, "--frames", "second.toml", "--clock", "log"))
    assert found["reader_options"] == {"clock": "log", "frames_sha256": hashlib.sha256(SECOND.encode()).hexdigest()}
    assert formats.read_trajectory("out.mcap").provenance["reader_options"] == found["reader_options"]
    assert "second.toml" not in json.dumps(found)
    assert "reader_options" not in provenance(run(*common))


def test_validate_reads_the_recording_as_convert_does(run: Run, two_people: Path, tmp_path: Path) -> None:
    """The second of two people is meant: without the map the robot is compared with the first."""
    (tmp_path / "second.toml").write_text(SECOND)
    done = run("convert", two_people, "--robot", "icub", "-q", "-o", "out.mcap", "--frames", "second.toml")
    assert done.exit_code == 0, done.stderr
    judge = ("validate", "out.mcap", "--mode", "kinematic", "--json", "--recording", two_people)
    own = limbs(run(*judge, "--frames", "second.toml", "--clock", "header"))
    other = limbs(run(*judge))
    assert own["value"] < other["value"] - 10


def test_tracker_logs_with_their_operator(run: Run, tmp_path: Path) -> None:
    log = formats.read_trackers(samples.sample_path("calibration_trackers"), options=TrackerOptions(up="y"))
    operator = tmp_path / "operator.json"
    operator.write_text(calibrate(dict.fromkeys(calibration.POSES, log)).to_json(), encoding="utf-8")
    box = samples.sample_path("box_trackers")
    read = ("--calibration", operator, "--up", "y")
    found = provenance(run("convert", box, *read, "--end", "0.6", "--robot", "g1", "-o", "box.mcap", "--json", "-q"))
    assert found["reader_options"] == {"up": "y"}
    judged = limbs(run("validate", "box.mcap", "--mode", "kinematic", "--json", "--recording", box, *read))
    assert judged["value"] is not None


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("--calibration", "me.json"),
        ("--frames", "map.toml"),
        ("--clock", "log"),
        ("--msg-def", "msg"),
        ("--columns", "columns.toml"),
        ("--up", "y"),
        ("--log-rate", "90"),
        ("--roles", "LHR=left_hand"),
        ("--roles-file", "roles.txt"),
    ],
)
def test_options_of_a_recording_that_isn_t_given(run: Run, tmp_path: Path, option: str, value: str) -> None:
    (tmp_path / "a.mcap").touch()
    result = run("validate", "a.mcap", option, value)
    assert (result.exit_code, result.stdout) == (2, "")
    assert result.stderr == f"retarget: {option} is of the --recording; give it too\n"


def test_ros_options_of_a_suit_s_recording_are_refused(run: Run, two_people: Path, walk: Path) -> None:
    done = run("convert", two_people, "--robot", "icub", "-q", "-o", "out.mcap")
    assert done.exit_code == 0, done.stderr
    result = run("validate", "out.mcap", "--mode", "kinematic", "--recording", walk, "--clock", "log")
    assert result.exit_code == 2
    assert result.stderr.endswith("--clock is for ROS recordings, not for mvnx\n")
    assert result.stderr.count("\n") == 1
