"""Calibrations as JSON: there and back exactly, and every way in which a file can be wrong in one line."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from retarget.core import calibration
from retarget.core.calibration import ArmCalibration, Calibration
from retarget.core.errors import FormatError, InvalidDataError, UsageError


def arm(left: float) -> ArmCalibration:
    hands = np.array([[0.01, 0.2 * left, -0.1], [0.0, 0.79 * left, 0.5], [0.6, 0.2 * left, 0.5]])
    return ArmCalibration(hands, np.array([1 / 3, 0.2 * left, 0.5]), 0.6, (90.1, 89.7, 91.3), (0.34, 0.36, 0.35))


@pytest.fixture
def operator() -> Calibration:
    half = np.sqrt(0.5)
    return Calibration(
        arms={"Left": arm(1.0), "Right": arm(-1.0)},
        origin=np.array([1.1, -2.2, 0.1 + 0.2]),
        heading_rad=2.5,
        chest_position=np.array([0.1, 0.0, 0.4]),
        chest_orientation=np.array([1.0, 0, 0, 0]),
        still_orientation={"T8": np.array([1.0, 0, 0, 0]), "LeftHand": np.array([half, -half, 0, 0])},
        trackers={"T8": "LHR-1", "LeftHand": "LHR-2", "RightHand": "Hände/3"},
        tracker_rotation={"T8": np.array([0, half, half, 0])},
        hand_offset_m={"Left": np.array([-0.08, 0, 0]), "Right": np.array([-0.08, 0, 0])},
        windows_s={"still": (2.0, 3.0), "tpose": (5.0, 6.5), "forward": (8, 9)},
        input_sha256={"still": "ab" * 32},
        residuals={"shoulder_spread_m/Left": 0.02},
        warnings=("one", "two"),
    )


def plain(value: Any) -> Any:
    """`value` comparable: arrays as lists, dataclasses and mappings as dicts."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, ArmCalibration | Calibration):
        return {field.name: plain(getattr(value, field.name)) for field in fields(value)}
    if hasattr(value, "items"):
        return {key: plain(item) for key, item in value.items()}
    return value


def test_there_and_back_is_exact(operator: Calibration, tmp_path: Path) -> None:
    text = operator.to_json()
    back = calibration.from_json(text)
    assert plain(back) == plain(operator)
    assert back.to_json() == text
    (tmp_path / "operator.json").write_text(text, encoding="utf-8")
    assert plain(calibration.load(tmp_path / "operator.json")) == plain(operator)


def test_what_stands_in_the_file(operator: Calibration) -> None:
    record = json.loads(operator.to_json())
    assert record["schema"] == "retarget.calibration/1"
    assert record["arms"]["Right"]["hand_points_m"]["forward"] == [0.6, -0.2, 0.5]
    assert record["arms"]["Left"]["angles_deg"] == {"still_tpose": 90.1, "tpose_forward": 89.7, "forward_still": 91.3}
    assert record["windows_s"]["tpose"] == [5.0, 6.5]


Change = Callable[[dict[str, Any]], Any]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda r: r.update(schema="retarget.calibration/9"), r'schema "retarget.calibration/9"; expected "schema": "retarget'),
        (lambda r: r.pop("schema"), "no schema; expected"),
        (lambda r: r.pop("origin"), "no key 'origin'; expected all of"),
        (lambda r: r.update(orgin=r.pop("origin")), "unknown key 'orgin'; did you mean origin"),
        (lambda r: r["arms"].pop("Left"), "arms: no key 'Left'"),
        (lambda r: r["arms"].update(Left=[1, 2]), r"arms.Left: found \[1, 2\]; expected an object with hand_points_m"),
        (lambda r: r["arms"]["Left"].pop("shoulder_m"), "arms.Left: no key 'shoulder_m'"),
        (lambda r: r["arms"]["Left"]["hand_points_m"].pop("tpose"), "arms.Left.hand_points_m: no key 'tpose'"),
        (lambda r: r["arms"]["Left"].update(shoulder_m=[1, 2]), r"arms.Left: ArmCalibration.shoulder: found shape \(2,\)"),
        (lambda r: r["arms"]["Left"].update(shoulder_m=["a", 2, 3]), r"arms.Left: ArmCalibration.shoulder: found .* expected an array"),
        (lambda r: r["arms"]["Left"].update(length_m=9), "arms.Left: ArmCalibration.length_m: found 9"),
        (lambda r: r["arms"]["Left"].update(length_m="long"), 'arms.Left.length_m: found "long"; expected a number'),
        (lambda r: r.update(heading_rad=None), "heading_rad: found null; expected a number"),
        (lambda r: r.update(origin=[0, 0]), r"Calibration.origin: found shape \(2,\)"),
        (lambda r: r.update(chest_orientation=[1, 1, 0, 0]), "chest_orientation: found length"),
        (lambda r: r.update(trackers=["LHR-1"]), r'trackers: found \["LHR-1"\]; expected an object'),
        (lambda r: r.update(trackers={"T8": 3}), "trackers: found 3; expected text"),
        (lambda r: r.update(trackers={"Chest": "LHR-1"}), "unknown segment 'Chest'"),
        (lambda r: r.update(tracker_rotation={"T8": [0, 0, 0, 0]}), r"tracker_rotation\[T8\]: found length 0"),
        (lambda r: r.update(windows_s={"t-pose": [1, 2]}), "windows_s: found 't-pose', expected still, tpose, forward"),
        (lambda r: r.update(windows_s={"still": [1]}), r"windows_s\[still\]: found shape"),
        (lambda r: r.update(hand_offset_m={"Middle": [0, 0, 0]}), "hand_offset_m: found 'Middle'"),
        (lambda r: r.update(residuals={"x": "y"}), 'residuals: found "y"; expected a number'),
        (lambda r: r.update(warnings="none"), 'warnings: found "none"; expected a list'),
        (lambda r: r.update(warnings=[1]), "warnings: found 1; expected text"),
    ],
)  # fmt: skip
def test_a_bad_file_is_one_line(operator: Calibration, change: Change, message: str) -> None:
    record = json.loads(operator.to_json())
    change(record)
    with pytest.raises(FormatError, match=message) as caught:
        calibration.from_json(json.dumps(record), "operator.json")
    assert str(caught.value).startswith("operator.json")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("constant", ["NaN", "Infinity", "-Infinity"])
def test_numbers_that_are_none(operator: Calibration, constant: str) -> None:
    text = operator.to_json().replace("2.5", constant)
    with pytest.raises(FormatError, match=f"found {constant}; expected finite numbers"):
        calibration.from_json(text)


def test_whole_numbers_of_any_size(operator: Calibration) -> None:
    """NumPy has no such integers."""
    record = json.loads(operator.to_json())
    record.update(heading_rad=10**30, residuals={"x": 10**30})
    again = calibration.from_json(json.dumps(record))
    assert (again.heading_rad, again.residuals["x"]) == (1e30, 1e30)


@pytest.mark.parametrize("text", ["", "{", "walk", "[" * 100_000])
def test_no_json(text: str) -> None:
    with pytest.raises(FormatError, match=r"not JSON|nested too deeply"):
        calibration.from_json(text)
    with pytest.raises(FormatError, match="no schema"):
        calibration.from_json("[1]")


def test_no_number_beyond_what_floats_hold(operator: Calibration) -> None:
    with pytest.raises(FormatError, match="heading_rad"):
        calibration.from_json(operator.to_json().replace("2.5", "1e999"))


def test_no_such_file(operator: Calibration, tmp_path: Path) -> None:
    (tmp_path / "operator.json").write_text(operator.to_json(), encoding="utf-8")
    with pytest.raises(UsageError, match=r"oprator\.json: no such file; did you mean operator\.json"):
        calibration.load(tmp_path / "oprator.json")
    with pytest.raises(UsageError, match="is a directory"):
        calibration.load(tmp_path)
    (tmp_path / "binary.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FormatError, match="not text"):
        calibration.load(tmp_path / "binary.json")


def test_the_type_itself_refuses(operator: Calibration) -> None:
    with pytest.raises(InvalidDataError, match=r"residuals\[a\]: found nan"):
        replace(operator, residuals={"a": np.nan})
    with pytest.raises(InvalidDataError, match="length_m: found nan"):
        replace(operator.arms["Left"], length_m=np.nan)
