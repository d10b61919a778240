"""Recordings of minutes, made of a short sample that is walked forth and back: no jumps, and every frame a real one."""

from __future__ import annotations

import gzip
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
from retarget import formats, samples
from retarget.core import timebase

from tests.formats.ros_recordings import Ros, flat_tf, hanging_arms, storage, write_folder


def write_long_walk(path: Path, seconds: float) -> None:
    """The sample walk, 60 Hz, forth and back for so long, as MVNX without compression."""
    text = gzip.decompress(samples.sample_path("walk").read_bytes()).decode()
    frames = re.findall(r"<frame .*?</frame>", text, re.DOTALL)
    once = [frame for frame in frames if 'type="normal"' in frame]
    cycle = once + once[-2:0:-1]
    start, stop = text.index(once[0]), text.rindex("</frame>") + len("</frame>")
    with path.open("w", encoding="utf-8") as out:
        out.write(text[:start])
        for index in range(round(seconds * 60)):
            out.write(re.sub(r'index="\d*"', f'index="{index}"', cycle[index % len(cycle)], count=1) + "\n")
        out.write(text[stop:])


def write_long_walk_mcap(path: Path, seconds: float, rate_hz: float = 60.0) -> None:
    """The same as an MCAP of tf, as the Xsens drivers for ROS 2 publish it."""
    walk = formats.read_motion(samples.sample_path("walk"))
    walk = timebase.resample(walk, rate_hz) if rate_hz != walk.source.rate_hz else walk
    rows = np.resize(np.r_[0 : walk.frames, walk.frames - 2 : 0 : -1], round(seconds * rate_hz))
    time = np.arange(len(rows)) / rate_hz
    long = replace(
        walk,
        time=time,
        orientation=walk.orientation[rows],
        position=walk.position[rows],
        angular_velocity=None,
        foot_contacts=None,
    )
    ros, folder = Ros(2), path.with_suffix(".folder")
    arms = hanging_arms(long.segments, long.orientation)
    write_folder(folder, ros, flat_tf(ros, long, arms), mcap=True)
    storage(folder).rename(path)
    shutil.rmtree(folder)
