"""`retarget convert` of tracker logs: both methods, also of a suit's recording, and what is refused, each in one line."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from retarget import formats, samples
from retarget.core import calibration
from retarget.core.calibrate.operator import calibrate
from retarget.formats import TrackerOptions

Run = Callable[..., Result]

LOG = ["--up", "y", "--end", "0.6"]


@pytest.fixture(scope="session")
def operator(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The calibration of the sample's operator."""
    log = formats.read_trackers(samples.sample_path("calibration_trackers"), options=TrackerOptions(up="y"))
    path = tmp_path_factory.mktemp("operator") / "operator.json"
    path.write_text(calibrate(dict.fromkeys(calibration.POSES, log)).to_json(), encoding="utf-8")
    return path


def box() -> str:
    return str(samples.sample_path("box_trackers"))


def record(result: Result) -> dict[str, object]:
    assert result.exit_code == 0, result.stderr
    found: dict[str, object] = json.loads(result.stdout)
    return found


@pytest.mark.parametrize("robot", ["tocabi", "g1"])
def test_hands_from_six_trackers(run: Run, operator: Path, robot: str) -> None:
    found = record(
        run(
            "convert", box(), *LOG, "--calibration", str(operator), "--method", "telemanipulation",
            "--robot", robot, "-o", "box.mcap", "--json", "-q",
        )
    )  # fmt: skip
    metrics, provenance = found["metrics"], found["provenance"]
    assert isinstance(metrics, dict)
    assert isinstance(provenance, dict)
    assert (found["method"], found["mapping"]) == ("telemanipulation", "hand_position")
    assert set(metrics["hand_position_error_mm"]) == {"mean", "p95", "max", "per_hand"}
    assert set(metrics["hand_position_error_mm"]["per_hand"]) == {"LeftHand", "RightHand"}
    assert metrics["position_limit_violations"] == metrics["velocity_limit_violations"] == 0
    assert provenance["solver"]["name"] == "hierarchical"
    assert len(provenance["calibration_sha256"]) == 64
    trajectory = formats.read_trajectory("box.mcap")
    assert trajectory.frames == 55  # 0.6 s at 90 Hz
    legs = [i for i, name in enumerate(trajectory.joint_names) if "Knee" in name or "knee" in name]
    assert len(legs) == 2
    assert (np.ptp(trajectory.position[:, legs], axis=0) == 0).all(), "legs were not measured"


def test_the_geometric_method_drives_what_six_trackers_measure(run: Run, operator: Path) -> None:
    arguments = [
        "convert",
        box(),
        *LOG,
        "--calibration",
        str(operator),
        "--robot",
        "g1",
        "-o",
        "box.npz",
        "--json",
        "-q",
    ]
    found = record(run(*arguments))
    metrics = found["metrics"]
    assert isinstance(metrics, dict)
    assert (found["method"], found["mapping"]) == ("geometric", "limb_plane")
    assert metrics["hand_position_error_mm"] is None
    assert set(metrics["limb_direction_error_deg"]["per_limb"]) == {"LeftUpperArm", "RightUpperArm"}
    assert metrics["limb_direction_error_deg"]["max"] < 1.0
    assert set(metrics["orientation_error_deg"]["per_link"]) == {
        "T8", "LeftUpperArm", "LeftHand", "RightUpperArm", "RightHand",
    }  # fmt: skip


def test_a_suit_and_its_calibration(run: Run, operator: Path) -> None:
    """Calibrated from its own poses; the calibration of somebody's trackers is refused."""
    reach = str(samples.sample_path("reach"))
    held = ("--still=0:0.8", "--tpose=2:2.5", "--forward=3.55:3.7")
    assert run("calibrate", reach, *held, "-o", "suit.json", "-q").exit_code == 0
    arguments = [
        "convert",
        reach,
        "--end",
        "0.2",
        "--method",
        "telemanipulation",
        "--robot",
        "tocabi",
        "-o",
        "reach.mcap",
    ]
    found = record(run(*arguments, "--calibration", "suit.json", "--json", "-q"))
    metrics = found["metrics"]
    assert isinstance(metrics, dict)
    assert metrics["velocity_limit_violations"] == 0
    assert metrics["hand_position_error_mm"]["mean"] < 1.0
    refused = run(*arguments, "--calibration", operator, "--force", "-q")
    assert refused.exit_code == 1
    assert "another tracker set" in refused.stderr


def test_limb_plane_by_strict_priorities(run: Run, operator: Path) -> None:
    """Mappings and solvers combine: one level then."""
    arguments = ["convert", box(), *LOG, "--calibration", str(operator), "--robot", "g1", "--solver", "hierarchical"]
    found = record(run(*arguments, "-o", "box.mcap", "--json", "-q"))
    provenance = found["provenance"]
    assert isinstance(provenance, dict)
    assert provenance["solver"]["name"] == "hierarchical"
    assert list(provenance["solver"]["frames_without_freedom"]) == ["0"]


def test_blending_is_written_into_the_provenance(run: Run, operator: Path) -> None:
    arguments = [
        "convert",
        box(),
        *LOG,
        "--calibration",
        str(operator),
        "--method",
        "telemanipulation",
        "--blend-hands",
    ]
    found = record(run(*arguments, "--robot", "tocabi", "-o", "box.mcap", "--json", "-q"))
    provenance = found["provenance"]
    assert isinstance(provenance, dict)
    assert provenance["options"]["settings"] == {"blend_hands": True}


@pytest.mark.parametrize(
    ("options", "code", "words"),
    [
        ([], 2, ["tracker log", "--calibration"]),
        (["--method", "telemanipulation"], 2, ["hand_position", "needs the operator", "--calibration"]),
        (["--calibration", "nowhere.json"], 2, ["nowhere.json", "no such file"]),
        (["--calibration", "OPERATOR", "--mapping", "hand_positon"], 2, ["hand_positon", "hand_position"]),
        (["--calibration", "OPERATOR", "--blend-hands"], 2, ["limb_plane", "no settings"]),
        (["--calibration", "OPERATOR", "--mapping", "absolute", "--blend-hands"], 2, ["blend_hands", "height_m"]),
        (["--calibration", "OPERATOR", "--mapping", "absolute", "--solver", "dynamical"], 2, ["dynamical", "hierarchical"]),
        (["--calibration", "OPERATOR", "--method", "telemanipulation", "--base", "human"], 2, ["base", "human"]),
        (["--calibration", "OPERATOR", "--method", "telemanipulation", "--online"], 2, ["online"]),
        (["--calibration", "OPERATOR", "--base", "human"], 1, ["Pelvis", "not measured"]),
    ],
)  # fmt: skip
def test_what_can_not_work_is_one_line(
    run: Run, operator: Path, options: list[str], code: int, words: list[str]
) -> None:
    options = [str(operator) if option == "OPERATOR" else option for option in options]
    robot = [] if "--robot" in options else ["--robot", "g1"]
    result = run("convert", box(), *LOG, *robot, "-o", "box.mcap", "-q", *options)
    assert result.exit_code == code
    assert result.stdout == ""
    assert len(result.stderr.strip().splitlines()) == 1
    for word in words:
        assert word in result.stderr
    assert not Path("box.mcap").exists()


def test_a_calibration_that_is_none(run: Run) -> None:
    Path("broken.json").write_text('{"schema": "retarget.calibration/1"', encoding="utf-8")
    result = run("convert", box(), *LOG, "--robot", "g1", "--calibration", "broken.json", "-o", "box.mcap")
    assert result.exit_code == 2
    assert "broken.json" in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1


def test_a_calibration_of_another_tracker_set(run: Run, operator: Path) -> None:
    text = operator.read_text(encoding="utf-8").replace('"left_hand"', '"LHR-00000001"')
    Path("other.json").write_text(text, encoding="utf-8")
    result = run("convert", box(), *LOG, "--robot", "g1", "--calibration", "other.json", "-o", "box.mcap", "-q")
    assert result.exit_code == 1
    assert "another tracker set" in result.stderr
    assert "LHR-00000001" in result.stderr


def changed_log(change: Callable[[list[list[str]]], list[list[str]]]) -> str:
    rows = [line.split(",") for line in Path(box()).read_text(encoding="utf-8").splitlines()[:200]]
    Path("changed.csv").write_text("\n".join(",".join(row) for row in change(rows)) + "\n", encoding="utf-8")
    return "changed.csv"


def without(prefix: str, rows: list[list[str]]) -> list[list[str]]:
    keep = [i for i, name in enumerate(rows[0]) if not name.startswith(prefix)]
    return [[row[i] for i in keep] for row in rows]


def never_valid(tracker: str, rows: list[list[str]]) -> list[list[str]]:
    column = rows[0].index(f"{tracker}_valid")
    return [rows[0], *([*row[:column], "0", *row[column + 1 :]] for row in rows[1:])]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda rows: without("left_hand", rows), ["LeftHand", "measured positions"]),
        (lambda rows: never_valid("left_hand", rows), ["left_hand", "never tracked"]),
        (lambda rows: [rows[0], *rows[1:60], rows[40], *rows[60:]], ["line 61", "goes back"]),
    ],
    ids=["missing", "lost throughout", "time backward"],
)
def test_broken_logs_are_one_line(
    run: Run, operator: Path, change: Callable[[list[list[str]]], list[list[str]]], words: list[str]
) -> None:
    arguments = ["--up", "y", "--calibration", str(operator), "--method", "telemanipulation", "--robot", "tocabi"]
    result = run("convert", changed_log(change), *arguments, "-o", "box.mcap", "-q")
    assert result.exit_code == 1
    assert len(result.stderr.strip().splitlines()) == 1, result.stderr
    for word in words:
        assert word in result.stderr, result.stderr
    assert not Path("box.mcap").exists()
