"""The page of a validation: self-contained, well-formed, and its plots show the report's own numbers, in a real browser too."""

from __future__ import annotations

import io
import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from matplotlib.colors import to_rgb
from PIL import Image
from retarget.cli import validation_figures as plots
from retarget.cli import validation_page
from retarget.cli.validation_figures import Curves
from retarget.cli.validation_page import Section, Shot
from retarget.cli.validation_views import _pooled
from retarget.core.errors import UsageError

from tests.cli.html_page import Page, check_self_contained

Run = Callable[..., Result]
JOINTS = ("neck", "left_elbow", "right_elbow", "left_knee")
FAULT_S, FAULT_JOINT = 2.5, 1


def curves(phase: float = 0.0) -> Curves:
    """4 s of four joints; the left elbow is off by 2° around 2.5 s, where its torque is at the limit."""
    time = np.linspace(0.0, 4.0, 401)
    wanted = 0.5 * np.sin(time[:, None] + phase + np.arange(4))
    bump = np.exp(-(((time - FAULT_S) / 0.1) ** 2))
    error = np.zeros_like(wanted)
    error[:, FAULT_JOINT] = np.radians(2.0) * bump
    torque = np.full_like(wanted, 3.0)
    torque[:, FAULT_JOINT] += 17.0 * bump
    limit = np.array([10.0, 20.0, 20.0, np.inf])
    edges, starts = plots.strip_edges(time)
    kind = "torque at its limit"
    ratio = np.abs(torque) / np.where(np.isfinite(limit), limit, np.inf)
    strip = np.maximum.reduceat(np.where(ratio > 0.999, 1.001, ratio), starts)
    return Curves(
        joints=JOINTS,
        time=time,
        wanted=wanted,
        lower=np.full(4, -1.0),
        upper=np.full(4, 1.0),
        strip_time=edges,
        actual=wanted + error,
        torque=torque,
        rms_error=np.sqrt(np.mean(error**2, axis=0)),
        peak_error=np.abs(error).max(axis=0),
        torque_limit=limit,
        torque_ratio=ratio.max(axis=0),
        problems={kind: strip},
        whole_body={"self-collision": ("links in each other", np.zeros(len(starts)))},
    )


def record(passed: bool = False) -> dict[str, Any]:
    check = {"name": "joint_tracking_peak_deg", "value": 2.0, "unit": "deg", "limit": 1.0, "passed": passed}
    return {
        "input": "a <walk>.mcap",
        "robot": "g1",
        "mode": "fixed",
        "passed": passed,
        "checks": [{**check, "note": "left_elbow at 2.500 s"}],
        "frames": 241,
        "rate_hz": 60.0,
        "duration_s": 4.0,
    }


def picture(colour: tuple[int, int, int]) -> bytes:
    buffer = io.BytesIO()
    Image.new("RGB", (40, 50), colour).save(buffer, "PNG")
    return buffer.getvalue()


@pytest.fixture(scope="module")
def section() -> Section:
    shots = (Shot(0.0, picture((0, 90, 200))), Shot(2.5, picture((200, 90, 0)), "left_elbow"))
    return Section("a <walk>.mcap", record(), curves(), shots)


def test_the_page_is_self_contained_and_names_the_fault(section: Section) -> None:
    page = check_self_contained(validation_page.page([section]))
    assert len(page.references) == 2 + 4  # snapshots; problems, tracking, error map, torque
    assert "joint_tracking_peak_deg: 2 deg (limit 1) left_elbow at 2.500 s" in page.words
    assert re.search(r"Worst: left_elbow at 2\.[45]\d s \(torque at its limit", page.words)
    assert "FAILED" in page.words


def test_several_trajectories_stand_side_by_side(section: Section) -> None:
    other = replace(section, title="other", record=record(passed=True), curves=curves(0.3))
    text = validation_page.page([section, other])
    page = check_self_contained(text)
    assert (
        len(page.references) == 2 * (2 + 4) + 2 + 2
    )  # and the snapshots at even instants, tracking and torque of both
    head = page.words[: page.words.index("Side by side")]
    assert "a <walk>.mcap" in head
    assert "other" in head
    assert text.count('class="verdict bad"') == text.count('class="verdict ok"') == 1


def test_robots_with_other_joints_are_not_drawn_into_one_panel(section: Section) -> None:
    other = replace(section, curves=replace(section.curves, joints=("a", "b", "c", "d")))
    assert "Robots with different joints" in Page(validation_page.page([section, other])).words


def test_the_worst_joint_is_drawn_first_with_its_true_error() -> None:
    figure = plots.tracking([curves()], ["walk"])
    assert figure is not None
    above, below = figure.axes[:2]
    assert above.get_title(loc="left").startswith("left_elbow")
    error = below.get_lines()[0]
    assert np.max(error.get_ydata()) == pytest.approx(2.0)
    assert error.get_xdata()[np.argmax(error.get_ydata())] == pytest.approx(FAULT_S)


def test_the_joint_at_its_limit_is_drawn_first_between_its_limits() -> None:
    figure = plots.torques([curves()], ["walk"])
    assert figure is not None
    panel = figure.axes[0]
    assert panel.get_title(loc="left") == "left_elbow    peak 100 % of 20 Nm"
    assert sorted(line.get_ydata()[0] for line in panel.get_lines()[1:]) == [-20.0, 20.0]


def test_the_strip_colours_the_joint_and_the_time_of_the_problem() -> None:
    drawn = curves()
    (image,) = plots.problem_strip(drawn).axes[0].get_images()
    cells = np.asarray(image.get_array())
    colour = to_rgb(plots.KIND_COLOURS["torque at its limit"])
    rows, columns = np.nonzero(np.isclose(cells, colour).all(axis=-1))
    assert set(rows) == {FAULT_JOINT}
    assert np.allclose(drawn.strip_time[columns], FAULT_S, atol=0.05)
    assert plots.worst_problem(replace(drawn, problems={})) is None


def test_sliding_joints_are_drawn_in_millimetres() -> None:
    sliding = replace(curves(), sliding=(False, True, False, False))
    figure = plots.tracking([sliding], ["walk"])
    assert figure is not None
    assert figure.axes[0].get_title(loc="left").endswith("peak 35 mm")
    assert np.max(figure.axes[1].get_lines()[0].get_ydata()) == pytest.approx(1000 * np.radians(2.0))


def test_a_single_frame_has_a_page() -> None:
    full = curves()
    edges, _ = plots.strip_edges(full.time[:1])
    one = Curves(
        full.joints,
        full.time[:1],
        full.wanted[:1],
        full.lower,
        full.upper,
        edges,
        problems={"motion": np.full((1, 4), 2.0)},
    )
    check_self_contained(validation_page.page([Section("one", {**record(), "mode": "kinematic"}, one)]))


def test_without_dynamics_angles_stand_for_tracking(section: Section) -> None:
    still = replace(section.curves, actual=None, torque=None, rms_error=None, peak_error=None)
    page = check_self_contained(validation_page.page([replace(section, curves=still)]))
    assert "Angles" in page.words
    assert "Tracking" not in page.words


def test_no_peak_is_lost_between_columns() -> None:
    time = np.linspace(0, 1, 5000)
    values = np.zeros((5000, 2))
    values[1234, 1] = 0.7
    edges, _ = plots.strip_edges(np.linspace(0, 1, 61))
    pooled = _pooled(values, time, edges)
    assert pooled.shape == (len(edges) - 1, 2)
    assert pooled.max() == 0.7
    column = int(np.argmax(pooled[:, 1]))
    assert edges[column] <= time[1234] < edges[column + 1]
    coarse = _pooled(np.array([[1.0], [3.0], [2.0]]), np.array([0.0, 0.4, 0.8]), np.linspace(0, 1, 11))
    assert coarse[:, 0].tolist() == [1, 1, 1, 1, 3, 3, 3, 3, 2, 2]


def test_the_same_page_again(section: Section) -> None:
    assert validation_page.page([section]) == validation_page.page([section])


def test_a_page_is_not_replaced_unasked(section: Section, tmp_path: Path) -> None:
    path = tmp_path / "page.html"
    path.write_text("mine")
    with pytest.raises(UsageError, match="exists"):
        validation_page.write_page(path, [section])
    assert path.read_text() == "mine"


@pytest.fixture
def chromium() -> str:
    found = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if found is None:
        pytest.skip("no Chromium is installed (Debian: apt-get install chromium)")
    return found


def test_a_browser_without_network_shows_the_plots(section: Section, chromium: str, tmp_path: Path) -> None:
    """The page in headless Chromium: no error on its console, all pictures decoded, and their colours on the screen."""
    page = tmp_path / "page.html"
    validation_page.write_page(page, [section])
    command = [chromium, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--enable-logging=stderr"]
    command += ["--host-resolver-rules=MAP * ~NOTFOUND", f"--user-data-dir={tmp_path / 'profile'}"]
    command += ["--window-size=1200,2600", f"--screenshot={tmp_path / 'page.png'}", page.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert "CONSOLE" not in done.stderr
    shown = np.asarray(Image.open(tmp_path / "page.png").convert("RGB")).astype(int)
    for colour in ((0, 90, 200), (200, 90, 0), *(_rgb(c) for c in (plots.CLIP_COLOURS[0], plots.LIMIT))):
        near = (np.abs(shown - colour).max(axis=-1) < 12).sum()
        assert near > 50, colour


def _rgb(colour: str) -> tuple[int, ...]:
    return tuple(round(255 * part) for part in to_rgb(colour))


def test_a_real_replay_s_page(run: Run, walk: Path, tmp_path: Path) -> None:
    """From the command line: snapshots (or the reason why there are none), the person beside the robot."""
    assert run("convert", walk, "--robot", "g1", "-o", "walk.mcap", "-q").exit_code == 0
    result = run("validate", "walk.mcap", "--report", "walk.html", "--recording", walk, "-q")
    assert result.exit_code in (0, 3)
    page = check_self_contained((tmp_path / "walk.html").read_text(encoding="utf-8"))
    assert "No snapshots" in page.words or len(page.references) in (6 + 4, 7 + 4)
    assert run("validate", "walk.mcap", "--report", "pages", "--mode", "kinematic", "-q").exit_code in (0, 3)
    assert [path.name for path in (tmp_path / "pages").iterdir()] == ["walk_validation.html"]
