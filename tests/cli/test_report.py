"""The report: figures that show the trajectory's own numbers, on a page that needs nothing from elsewhere."""

from __future__ import annotations

import base64
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from click.testing import Result
from matplotlib.collections import LineCollection
from retarget import formats, robots, samples
from retarget.cli import figures, report_page, stick_figures
from retarget.core.errors import UsageError
from retarget.core.pipeline import ConvertOptions, ConvertResult, convert
from retarget.core.robot_model import RobotModel, build

from tests.cli.html_page import Page

Run = Callable[..., Result]


@pytest.fixture(scope="module")
def model() -> RobotModel:
    return build(robots.load("g1"))


@pytest.fixture(scope="module")
def result(model: RobotModel) -> ConvertResult:
    motion = formats.read_motion(samples.sample_path("walk"))
    return convert(motion, model, ConvertOptions(start_s=3.0, end_s=5.0))


@pytest.fixture(scope="module")
def text(result: ConvertResult, model: RobotModel) -> str:
    """A page of one section."""
    return report_page.page([report_page.Section("a <walk> & more", result, model, "walk.mcap")], "Report")


def test_the_page_is_self_contained_and_well_formed(text: str, result: ConvertResult, model: RobotModel) -> None:
    page = Page(text)
    assert "script" not in page.tags
    assert "link" not in page.tags
    assert "a &lt;walk&gt; &amp; more" in text
    assert "<walk>" not in text
    assert "url(" not in text
    assert "@import" not in text
    assert len(page.references) == len(report_page.figures_of(result, model)) == 5
    for reference in page.references:
        kind, _, data = reference.partition(",")
        assert kind == "data:image/svg+xml;base64"
        picture = ElementTree.fromstring(base64.b64decode(data))
        assert picture.tag == "{http://www.w3.org/2000/svg}svg"
        for element in picture.iter():
            links = [value for name, value in element.attrib.items() if name.endswith("href")]
            assert all(link.startswith(("#", "data:image/png;base64,")) for link in links)


def test_the_numbers_of_the_page_are_the_metrics(
    text: str, result: ConvertResult, model: RobotModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = dict(re.findall(r"<tr><th>([^<]+)</th><td[^>]*>([^<]+)</td></tr>", text))
    limbs = result.metrics["limb_direction_error_deg"]
    assert rows["limb direction error, mean (p95)"] == f"{limbs['mean']:.2f}° ({limbs['p95']:.2f}°)"
    assert rows["position limits broken"] == "0"
    assert 'class="bad"' not in text
    monkeypatch.setattr(report_page, "figures_of", lambda *_: [])
    broken = replace(result, metrics={**result.metrics, "velocity_limit_violations": 7})
    assert '<td class="bad">7</td>' in report_page.page([report_page.Section("walk", broken, model)], "Report")


def test_every_joint_is_drawn_between_its_limits(result: ConvertResult, model: RobotModel) -> None:
    figure = figures.joints(result, model)
    drawn = [axes for axes in figure.axes if axes.get_visible()]
    assert [axes.get_title(loc="left") for axes in drawn] == list(model.joint_names)
    for index, axes in enumerate(drawn):
        (line,) = axes.get_lines()
        np.testing.assert_allclose(line.get_ydata(), np.degrees(result.trajectory.position[:, index]))
        np.testing.assert_allclose(line.get_xdata(), result.trajectory.time)
        bounds = [patch.get_bbox() for patch in axes.patches]
        assert bounds[0].y1 == pytest.approx(np.degrees(model.lower[index]))
        assert bounds[1].y0 == pytest.approx(np.degrees(model.upper[index]))


def test_speeds_are_shown_without_losing_a_peak(result: ConvertResult, model: RobotModel) -> None:
    (image,) = figures.speeds(result, model).axes[0].get_images()
    ratio = np.abs(result.trajectory.velocity) / model.velocity_limit
    np.testing.assert_allclose(np.asarray(image.get_array()), ratio.T)
    long = np.zeros((10_000, 3))
    long[6789, 1] = 0.9
    pooled = figures._pooled_maximum(long, 600)
    assert pooled.shape == (600, 3)
    assert pooled.max() == 0.9


def test_limb_errors_are_the_series(result: ConvertResult) -> None:
    figure = figures.limbs(result)
    assert figure is not None
    for axes in figure.axes:
        for line in axes.get_lines():
            name = f"limb_direction_error_deg/{str(line.get_label()).capitalize()}{axes.get_title(loc='left')}"
            np.testing.assert_array_equal(line.get_ydata(), result.series[name])
    assert sum(len(axes.get_lines()) for axes in figure.axes) == 8


def test_feet_show_height_and_the_recorded_stance(result: ConvertResult) -> None:
    figure = figures.feet(result)
    assert figure is not None
    left_height = figure.axes[0]
    np.testing.assert_allclose(left_height.get_lines()[0].get_ydata(), 1000 * result.series["foot_height_m/Left"])
    assert result.motion.foot_contacts is not None
    touching = result.motion.foot_contacts[:, :2].any(axis=1)
    starts = np.count_nonzero(np.diff(touching.astype(int), prepend=0) == 1)
    assert len(left_height.patches) == starts


def test_robots_without_feet_have_no_feet_figure(result: ConvertResult) -> None:
    series = {name: values for name, values in result.series.items() if not name.startswith("foot_")}
    without = replace(result)
    without.__dict__["series"] = series
    assert figures.feet(without) is None


def test_stick_figures_stand_to_scale_side_by_side(result: ConvertResult) -> None:
    """Seen from the side the picture keeps lengths: a bone perpendicular to the view has its true length."""
    figure = stick_figures.strip([result], instants=4)
    (axes,) = figure.axes
    bodies = [c for c in axes.collections if isinstance(c, LineCollection)]
    assert len(bodies) == 8
    assert [text.get_text() for text in axes.texts] == ["3.0 s", "3.7 s", "4.3 s", "5.0 s"]
    for body, points in zip(bodies, [result.series["human_points"][0], result.series["robot_points"][0]], strict=False):
        ends = np.concatenate(body.get_segments())
        height = np.ptp(points[:, 2])
        assert np.ptp(ends[:, 1]) == pytest.approx(height, rel=0.1)
        assert ends[:, 1].min() == pytest.approx(0, abs=1e-9)
    lefts = [np.concatenate(body.get_segments())[:, 0].min() for body in bodies]
    rights = [np.concatenate(body.get_segments())[:, 0].max() for body in bodies]
    assert all(right < left for right, left in zip(rights[:-1], lefts[1:], strict=True))


def test_a_recording_without_positions_shows_the_robot_alone(result: ConvertResult, model: RobotModel) -> None:
    unplaced = replace(result.motion, position=np.full_like(result.motion.position, np.nan), foot_contacts=None)
    (axes,) = stick_figures.strip([convert(unplaced, model, ConvertOptions())], instants=4).axes
    assert len([c for c in axes.collections if isinstance(c, LineCollection)]) == 4


def test_the_view_from_front_right() -> None:
    """The viewer sees forward (+X) to the right, and the person's right side (−Y) nearer."""
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    view = stick_figures._view(points) - stick_figures._view(points)[0]
    assert view[1, 0] > 0.5
    assert view[2, 2] > 0.5 > -0.5 > view[3, 2]
    assert view[5, 1] == pytest.approx(np.cos(stick_figures.ELEVATION))


def test_figures_are_the_same_bytes_again(result: ConvertResult, model: RobotModel) -> None:
    assert figures.svg(figures.speeds(result, model)) == figures.svg(figures.speeds(result, model))
    assert figures.svg(stick_figures.strip([result])) == figures.svg(stick_figures.strip([result]))


def test_thinning_keeps_both_ends() -> None:
    assert figures.thinned(1).tolist() == [0]
    kept = figures.thinned(100_000)
    assert (kept[0], kept[-1], len(kept)) == (0, 99_999, figures.MAX_POINTS)


def test_a_single_frame_can_be_reported(model: RobotModel) -> None:
    motion = formats.read_motion(samples.sample_path("walk"))
    single = convert(motion, model, ConvertOptions(start_s=3.0, end_s=3.001))
    assert single.trajectory.frames == 1
    Page(report_page.page([report_page.Section("one", single, model)], "Report"))


def test_a_page_is_not_replaced_unasked_and_leaves_nothing_when_it_fails(
    result: ConvertResult, model: RobotModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "page.html"
    path.write_text("mine")
    section = report_page.Section("walk", result, model)
    with pytest.raises(UsageError, match="exists"):
        report_page.write_page(path, [section])
    monkeypatch.setattr(figures, "limbs", lambda _: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        report_page.write_page(path, [section], overwrite=True)
    assert path.read_text() == "mine"
    assert list(tmp_path.iterdir()) == [path]


def test_demo_writes_its_files_and_a_table(run: Run, tmp_path: Path) -> None:
    result = run("demo", "-o", "out/demo")
    assert result.exit_code == 0
    folder = tmp_path / "out/demo"
    assert sorted(path.name for path in folder.iterdir()) == ["report.html", "walk_g1.mcap", "walk_icub.mcap"]
    head, *rows = result.stdout.splitlines()
    assert head.split() == ["icub", "g1"]
    values = {row[:36].strip(): row[36:].split() for row in rows}
    assert values["position limits broken"] == values["velocity limits broken"] == ["0", "0"]
    for robot in ("icub", "g1"):
        assert formats.read_trajectory(folder / f"walk_{robot}.mcap").robot == robot
    page = (folder / "report.html").read_text()
    assert "The walk is synthetic" in page
    Page(page)
    assert run("demo", "-o", "out/demo", "--robot", "g1", "-q").exit_code == 0


def test_demo_into_a_place_that_can_t_be(run: Run, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    result = run("demo", "-o", "file/demo")
    assert (result.exit_code, result.stdout) == (2, "")
    assert result.stderr == "retarget: file/demo: can't be made a folder (Not a directory)\n"
