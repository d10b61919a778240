"""`retarget compare`: the samples, a tracker log and a suit; table, JSON and page; and what it refuses."""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from click.testing import Result
from retarget import formats, samples
from retarget.core import comparison, experiments
from retarget.core.calibrate import operator
from retarget.core.calibration import POSES, Calibration
from retarget.core.timebase import cut
from retarget.core.types import HumanMotion

from tests.cli.test_report import Page

Run = Callable[..., Result]

CIRCLES = samples.sample_path("circles_trackers")
BOX = samples.sample_path("box_trackers")
SHORT = ("--up", "y", "--mapping", "hand_position")


@pytest.fixture(scope="module")
def calibrated() -> Calibration:
    options = formats.TrackerOptions(up="y")
    poses = formats.read_trackers(str(samples.sample_path("calibration_trackers")), options=options)
    return operator.calibrate(dict.fromkeys(POSES, poses))


@pytest.fixture
def person(tmp_path: Path, calibrated: Calibration) -> Path:
    """The samples' operator as a file."""
    path = tmp_path / "operator.json"
    path.write_text(calibrated.to_json())
    return path


@pytest.fixture
def briefly(monkeypatch: pytest.MonkeyPatch) -> None:
    """Arms are compared over the first tenth of a second only."""

    def few(motion: HumanMotion) -> HumanMotion:
        return cut(motion, None, float(motion.time[0]) + 0.1)

    monkeypatch.setattr(comparison, "at_rate", few)


@pytest.mark.usefixtures("briefly")
def test_the_samples(run: Run) -> None:
    """Circles of one sample, arms of two others, all three mappings; numbers of the table are those of the JSON."""
    result = run("compare", "--json")
    assert result.exit_code == 0, result.stderr
    assert result.stdout.count("\n") == 1
    assert result.stderr == "The samples are synthetic: computed, not recorded from a person.\n"
    record = json.loads(result.stdout)
    assert record["robot"] == "tocabi"
    assert record["operator"]["left"]["arm_length_m"] == pytest.approx(0.66605, abs=1e-5)
    assert record["operator"]["right"]["angles_deg"] == pytest.approx(
        {"still_tpose": 86.0, "tpose_forward": 93.38682352, "forward_still": 91.0}, abs=1e-3
    )
    assert record["robot_arm_length_m"] == {"left": 0.78, "right": 0.78}
    assert record["circles"]["input"] == "circles_trackers"
    for side in ("left", "right"):
        index, change = record["circles"][side]["index"], record["circles"][side]["change"]
        assert set(index) == {"original", *experiments.HAND_MAPPINGS}
        assert change["hand_position"] == pytest.approx(index["hand_position"] / index["original"] - 1)
        assert change["hand_position"] < -0.5
        assert change["absolute"] == pytest.approx(0, abs=1e-9)
    assert record["square"]["left"]["corner_deg"] == pytest.approx(
        180 - record["square"]["right"]["corner_deg"], abs=1e-3
    )
    assert [clip["input"] for clip in record["similarity"]] == ["box_trackers", "clap_trackers"]
    for clip in record["similarity"]:
        assert [variant["name"] for variant in clip["variants"]] == [
            "hand_position",
            "proportional, raised 0.15 m",
            "proportional, shoulders level",
            "absolute, raised 0.15 m",
            "absolute, shoulders level",
        ]
        ours, *others = (variant["arm_direction_error_deg"]["arm"]["mean"] for variant in clip["variants"])
        assert ours < min(others)
    assert record["notes"] == []
    shown = run("compare", "--mapping", "hand_position", "--mapping", "absolute", "-q")
    assert shown.stderr == ""
    index = record["circles"]["left"]["index"]["hand_position"]
    assert re.search(rf"^  hand_position +{index:.4f} \(-\d\d\.\d %\)", shown.stdout, re.MULTILINE)
    lengths = "  ".join(f"{record['operator'][side]['arm_length_m']:.4f} m" for side in ("left", "right"))
    assert f"  operator's arm     {lengths}\n" in shown.stdout
    assert re.search(r"^  absolute +0\.03\d\d \(same\)", shown.stdout, re.MULTILINE)
    assert "arm direction error in degrees, clap_trackers: " in shown.stdout


@pytest.mark.usefixtures("briefly")
def test_a_tracker_log_with_circles_and_its_page(run: Run, person: Path) -> None:
    result = run("compare", CIRCLES, "--calibration", person, *SHORT, "--report", "pages", "--json", "--robot", "g1")
    assert result.exit_code == 0, result.stderr
    record = json.loads(result.stdout)
    assert record["circles"]["input"] == "circles_trackers.csv"
    assert record["circles"]["left"]["window_s"] == pytest.approx([2.6, 9.2], abs=0.03)
    assert [clip["input"] for clip in record["similarity"]] == ["circles_trackers.csv"]
    assert "pages/compare_circles_trackers_g1.html: written" in result.stderr
    text = Path("pages/compare_circles_trackers_g1.html").read_text()
    page = Page(text)
    assert "script" not in page.tags
    assert "link" not in page.tags
    assert "url(" not in text
    assert page.tags.count("img") == len(page.references) == 4
    for reference in page.references:
        kind, _, data = reference.partition(",")
        assert kind == "data:image/svg+xml;base64"
        assert ElementTree.fromstring(base64.b64decode(data)).tag == "{http://www.w3.org/2000/svg}svg"
    assert f"{record['circles']['left']['index']['hand_position']:.4f}" in text
    again = run("compare", CIRCLES, "--calibration", person, *SHORT, "--report", "pages", "--robot", "g1")
    assert again.exit_code == 2
    assert "compare_circles_trackers_g1.html: exists; --force replaces it" in again.stderr


@pytest.mark.usefixtures("briefly")
def test_the_window_that_is_given_counts(run: Run, person: Path) -> None:
    result = run("compare", CIRCLES, "--calibration", person, *SHORT, "--window", "2.6:4.8", "--json", "-q")
    assert result.exit_code == 0, result.stderr
    circles = json.loads(result.stdout)["circles"]
    assert circles["left"]["window_s"] == circles["right"]["window_s"] == [2.6, 4.8]


@pytest.mark.usefixtures("briefly")
def test_no_circles_are_said_to_be_none(run: Run, person: Path) -> None:
    arguments = ("compare", BOX, "--calibration", person, *SHORT)
    result = run(*arguments, "--json", "--report", "box.html")
    assert result.exit_code == 0, result.stderr
    record = json.loads(result.stdout)
    assert record["circles"] is None
    note = "box_trackers.csv: neither hand draws circles, so that no circle index is given; --window START:END tells where they are"
    assert record["notes"] == [note]
    assert f"warning: {note}" in result.stderr
    assert note in Path("box.html").read_text()
    assert len(Page(Path("box.html").read_text()).references) == 3
    table = run(*arguments).stdout
    assert "circle" not in table
    assert "hand off target" in table


def test_arms_are_compared_between_start_and_end_at_30_hz(run: Run, person: Path) -> None:
    result = run("compare", BOX, "--calibration", person, *SHORT, "--start", "2", "--end", "2.5", "--json", "-q")
    assert result.exit_code == 0, result.stderr
    (clip,) = json.loads(result.stdout)["similarity"]
    assert (clip["frames"], clip["rate_hz"]) == (16, pytest.approx(30))
    (variant,) = clip["variants"]
    lines: dict[str, Any] = variant["arm_direction_error_deg"]
    assert set(lines["per_line"]) == {f"{side}{line}" for side in ("Left", "Right") for line in experiments.LINES}
    sides = [lines["per_line"][f"{side}Arm"]["mean"] for side in ("Left", "Right")]
    assert lines["arm"]["mean"] == pytest.approx(sum(sides) / 2)
    assert lines["arm"]["max"] == max(lines["per_line"][f"{side}Arm"]["max"] for side in ("Left", "Right"))
    assert variant["unsolved_frames"] == 0


def test_a_suit(run: Run) -> None:
    reach = samples.sample_path("reach")
    held = ("--still=0:0.8", "--tpose=2:2.5", "--forward=3.55:3.7")
    assert run("calibrate", reach, *held, "-o", "suit.json", "-q").exit_code == 0
    common = ("compare", reach, "--calibration", "suit.json", "--mapping", "hand_position")
    result = run(*common, "--start", "1.8", "--end", "2.1", "--json", "--report", "suit.html")
    assert result.exit_code == 0, result.stderr
    (clip,) = json.loads(result.stdout)["similarity"]
    assert clip["variants"][0]["arm_direction_error_deg"]["arm"]["mean"] < 5
    assert Path("suit.html").is_file()


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (
            (BOX, "--up", "y"),
            2,
            "box_trackers.csv: a tracker log says nothing of the person; give --calibration FILE.json",
        ),
        (
            (samples.sample_path("reach"),),
            2,
            "reach.mvnx.gz: nothing is known of the person; give --calibration FILE.json",
        ),
        ((samples.sample_path("reach"), "--calibration", "operator.json"), 1, "calibration of another tracker set"),
        (
            (samples.sample_path("calibration_serials"), "--up", "y", "--calibration", "operator.json"),
            1,
            "calibration of another tracker set: it is of chest,",
        ),
        (("--calibration", "operator.json"), 2, "no INPUT: the samples are compared, with a calibration of their own"),
        (("--up", "y"), 2, "no INPUT"),
        (("--end", "3"), 2, "no INPUT"),
        (("--robot", "human"), 2, "a hand mapping needs the left arm, but [links] lacks LeftUpperArm"),
        (("--robot", "tocabbi"), 2, "unknown robot 'tocabbi'; did you mean tocabi?"),
        (("--mapping", "limb_plane"), 2, "mapping 'limb_plane' gives hands no positions; expected one of"),
        (("--window", "20:30"), 2, "--window 20:30: circles_trackers: found a window from 20 to 30 s, expected one in"),
        (("--window", "0.1:0.115"), 2, "fewer than three frames from 0.1 to 0.115 s, expected a circle"),
        (("--window", "3"), 2, "expected START:END"),
        (("--report", "nowhere/page.html"), 2, "nowhere: no such folder"),
        (("nofile.csv", "--calibration", "operator.json"), 2, "nofile.csv: no such file"),
        ((BOX, "--up", "y", "--calibration", "operatr.json"), 2, "no such file; did you mean operator.json?"),
    ],
)
@pytest.mark.usefixtures("person")
def test_refused(run: Run, arguments: tuple[object, ...], code: int, message: str) -> None:
    result = run("compare", *arguments, "-q")
    assert result.exit_code == code
    assert message in result.stderr
    assert result.stderr.count("\n") == 1
    assert result.stdout == ""
