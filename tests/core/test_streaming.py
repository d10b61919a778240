"""Converted in blocks, a motion moves as it does as a whole: seams, limits, base, what stands in the provenance."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest
from retarget import formats, robots, samples
from retarget.core import pipeline, robot_model, timebase
from retarget.core.errors import UsageError
from retarget.core.joint_ranges import JointRanges
from retarget.core.pipeline import ConvertOptions, ConvertResult
from retarget.core.stream_windows import Blocks
from retarget.core.streaming import StreamedConversion, can_stream
from retarget.core.types import Array, HumanMotion, JointTrajectory

SHORT = Blocks(first_s=1.0, block_s=3.0, lead_s=pipeline.LEAD_S)
Model = Callable[[str], robot_model.RobotModel]
ARRAYS = ("position", "velocity", "base_position", "base_orientation", "base_linear_velocity", "base_angular_velocity")


@pytest.fixture(scope="module")
def model() -> Model:
    made: dict[str, robot_model.RobotModel] = {}

    def get(name: str) -> robot_model.RobotModel:
        if name not in made:
            made[name] = robot_model.build(robots.load(name))
        return made[name]

    return get


@pytest.fixture(scope="module")
def walk() -> HumanMotion:
    """At half its rate: half the work."""
    return timebase.resample(timebase.cut(formats.read_motion(samples.sample_path("walk")), 0.0, 9.0), 30.0)


def in_parts(motion: HumanMotion, seconds: float) -> Iterator[HumanMotion]:
    """`motion` in parts; only the last one knows the hash."""
    begin = float(motion.time[0])
    while begin <= motion.time[-1]:
        part = timebase.cut(motion, begin, begin + seconds - 1e-3)
        is_last = part.time[-1] == motion.time[-1]
        yield part if is_last else replace(part, source=replace(part.source, sha256=""))
        begin += seconds


def streamed(
    motion: HumanMotion, model: robot_model.RobotModel, blocks: Blocks = SHORT, **options: object
) -> tuple[StreamedConversion, list[JointTrajectory]]:
    conversion = StreamedConversion(in_parts(motion, 0.7), model, ConvertOptions(**options), blocks)  # type: ignore[arg-type]  # vary
    return conversion, list(conversion)


def all_of(parts: list[JointTrajectory], name: str) -> Array:
    return np.concatenate([getattr(part, name) for part in parts])


def assert_like(parts: list[JointTrajectory], whole: ConvertResult, tolerance: float) -> None:
    trajectory = whole.trajectory
    np.testing.assert_allclose(all_of(parts, "time"), trajectory.time, rtol=0, atol=1e-9)
    for name in ARRAYS:
        expected = getattr(trajectory, name)
        if expected is None:
            assert all(getattr(part, name) is None for part in parts)
            continue
        # Differences of neighbours: 60 times as large.
        far = tolerance * (100 if "velocity" in name else 1)
        np.testing.assert_allclose(all_of(parts, name), expected, rtol=0, atol=far, err_msg=name)


@pytest.mark.parametrize(
    ("robot", "options"),
    [
        ("g1", {}),
        ("g1", {"base": "human"}),
        ("g1", {"base": "fixed"}),
        ("g1", {"start_s": 1.25, "end_s": 7.1, "rate_hz": 24.0, "smooth_s": 0.2}),
        ("g1", {"mapping": "link_orientation"}),
        ("icub", {}),
    ],
    ids=str,
)
def test_blocks_move_as_the_whole_does(walk: HumanMotion, model: Model, robot: str, options: dict[str, object]) -> None:
    whole = pipeline.convert(walk, model(robot), ConvertOptions(**options))  # type: ignore[arg-type]  # vary
    conversion, parts = streamed(walk, model(robot), **options)
    assert len(parts) > 2
    if options.get("base") == "human":
        # A constant height, by the first block and what is looked at with it: that of a recording which ends there.
        begin = pipeline.convert(timebase.cut(walk, 0.0, 6.0), model(robot), ConvertOptions(base="human")).trajectory
        heights = [trajectory.base_position[0, 2] for trajectory in (begin, parts[0], whole.trajectory)]  # type: ignore[index]  # G1 floats
        assert heights[0] == pytest.approx(heights[1], abs=1e-7)
        parts = [
            replace(part, base_position=part.base_position + np.array([0.0, 0.0, heights[2] - heights[1]]))
            for part in parts
        ]
    assert_like(parts, whole, 1e-7)
    figures = conversion.metrics
    assert figures["position_limit_violations"] == figures["velocity_limit_violations"] == 0
    for name in ("mean", "max"):
        found, expected = figures["limb_direction_error_deg"][name], whole.metrics["limb_direction_error_deg"][name]
        assert found == pytest.approx(expected, abs=1e-5)
    assert figures["limb_direction_error_deg"]["p95"] == pytest.approx(
        whole.metrics["limb_direction_error_deg"]["p95"], abs=0.05
    )


def test_where_joints_are_too_slow_seams_hold_the_limits(walk: HumanMotion, model: Model) -> None:
    """Six times as fast, a person is quicker than joints: blocks then disagree, and have to meet all the same."""
    walk = timebase.cut(walk, 0.0, 6.0)
    fast = replace(walk, time=walk.time / 6, angular_velocity=None)
    robot = model("g1")
    blocks = Blocks(first_s=0.25, block_s=0.5, lead_s=0.1)
    conversion, parts = streamed(fast, robot, blocks)
    joints, time = all_of(parts, "position"), all_of(parts, "time")
    np.testing.assert_array_equal(time, fast.time)
    speed = np.abs(np.diff(joints, axis=0)) / np.diff(time)[:, None]
    assert (speed <= robot.velocity_limit * (1 + 1e-9)).all()
    assert ((joints >= robot.lower) & (joints <= robot.upper)).all()
    facts = parts[-1].provenance["solver"]
    assert facts["blocks"] == len(parts) == 3
    assert facts["blocks_apart_rad"] > 1e-3  # else nothing was tried here
    assert conversion.metrics["velocity_limit_violations"] == 0
    # Written speeds are those of the written positions, over the seams, too.
    inside = slice(1, -1)
    central = np.gradient(joints, time, axis=0)[inside]
    np.testing.assert_allclose(all_of(parts, "velocity")[inside], central, atol=1e-6 + 1e-3 * np.abs(central).max())


def test_the_last_part_tells_of_the_whole(walk: HumanMotion, model: Model) -> None:
    conversion, parts = streamed(walk, model("g1"))
    whole = pipeline.convert(walk, model("g1"), ConvertOptions()).trajectory.provenance
    first, last = parts[0].provenance, parts[-1].provenance
    assert first["input_sha256"] == ""
    assert last["input_sha256"] == walk.source.sha256 != ""
    for name in ("input_format", "retarget_version", "robot_model_sha256", "options"):
        assert first[name] == last[name] == whole[name]
    assert first["solver"] == {"name": "dynamical"}
    assert last["solver"].keys() == {*whole["solver"], "blocks", "blocks_apart_rad", "shortened_steps"}
    ranges = JointRanges.of(parts[0].joint_names, all_of(parts, "position"))
    assert "joint_ranges" not in first
    assert {"joint_ranges": last["joint_ranges"]} == ranges.provenance()
    assert conversion.frames == walk.frames
    assert conversion.time_s == (walk.time[0], walk.time[-1])
    assert conversion.provenance == last
    assert conversion.source == walk.source


def test_blocks_do_not_depend_on_how_parts_arrive(walk: HumanMotion, model: Model) -> None:
    motion = timebase.cut(walk, 0.0, 4.0)
    found = [
        list(StreamedConversion(in_parts(motion, seconds), model("g1"), ConvertOptions(), SHORT))
        for seconds in (0.31, 10.0)
    ]
    for name in ("time", *ARRAYS):
        np.testing.assert_array_equal(all_of(found[0], name), all_of(found[1], name), err_msg=name)


@pytest.mark.parametrize(
    ("options", "yes"),
    [
        (ConvertOptions(), True),
        (ConvertOptions(smooth_s=1.0, rate_hz=30.0), True),
        (ConvertOptions(online=True), False),
        (ConvertOptions(mapping="hand_position"), False),
        (ConvertOptions(solver="hierarchical"), False),
        (ConvertOptions(smooth_s=5.0), False),
        (ConvertOptions(rate_hz=0.1), False),
    ],
)
def test_what_needs_the_whole(options: ConvertOptions, yes: bool, model: Model) -> None:
    assert can_stream(options) is yes
    if not yes:
        with pytest.raises(UsageError, match=r"^these options need the whole recording"):
            StreamedConversion([], model("g1"), options)
