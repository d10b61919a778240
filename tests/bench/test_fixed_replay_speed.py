"""Torque replay at 2000 Hz on a fixed base: seconds of motion per second of one core, with and without feed-forward and self-collision.

Everything counts that a replay does but building the model: spline, law, simulation, measures, report. The best of several turns, in processor time.
Recorded and printed, not asserted.
"""

from __future__ import annotations

import time

import pytest
from pytest_benchmark.fixture import BenchmarkFixture
from retarget import formats, robots, samples
from retarget.core import robot_model
from retarget.core.pipeline import ConvertOptions, convert
from retarget.core.replay.fixed import FixedOptions, replay
from retarget.core.replay.model import build

TURNS = 3
WAYS = {
    "law": FixedOptions(),
    "with feed-forward": FixedOptions(feed_forward=True),
    "with self-collision": FixedOptions(self_collision=True),
}


@pytest.mark.parametrize("robot", ["g1", "icub", "talos", "tocabi", "baxter"])
def test_fixed_replay_speed(benchmark: BenchmarkFixture, robot: str) -> None:
    robot_ = robot_model.build(robots.load(robot))
    trajectory = convert(formats.read_motion(samples.sample_path("walk")), robot_, ConvertOptions()).trajectory
    model = build(robot_, base="fixed", self_collision=True)
    duration = float(trajectory.time[-1] - trajectory.time[0])
    for name, options in WAYS.items():
        seconds = []
        for _ in range(TURNS):
            begin = time.process_time()
            report = replay(trajectory, model, options)
            seconds.append(time.process_time() - begin)
        assert report.check("simulation_lost_s").value == 0
        benchmark.extra_info[name] = duration / min(seconds)
        print(f"\n{robot}, {name}: {duration / min(seconds):.1f} × real time")
    benchmark.pedantic(replay, args=(trajectory, model), rounds=1)
