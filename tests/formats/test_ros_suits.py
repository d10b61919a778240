"""The walk sample as the Xsens drivers would record it, from each kind of recording: the same motion, the same robot joints."""

from __future__ import annotations

import io
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from retarget import formats, robots, samples
from retarget.core import pipeline, robot_model, rotations, timebase
from retarget.core.errors import FormatError
from retarget.core.segments import PARENT
from retarget.core.types import HumanMotion
from retarget.formats import TrackerOptions

from tests.formats.ros_recordings import (
    Array,
    Ros,
    flat_tf,
    hanging_arms,
    link_states,
    storage,
    tree_tf,
    write_bag,
    write_folder,
)


@cache
def walk() -> HumanMotion:
    """Four seconds of steps; the first frame is at time 0."""
    motion = timebase.cut(formats.read_motion(samples.sample_path("walk")), 1.95, 5.95)
    return replace(motion, time=motion.time - motion.time[0])


@cache
def joints(motion: HumanMotion) -> Array:
    """Joint angles on iCub, by the default mapping."""
    model = robot_model.build(robots.load("icub"))
    return pipeline.convert(motion, model, pipeline.ConvertOptions()).trajectory.position


def difference_deg(motion: HumanMotion) -> float:
    """The largest angle between orientations of `motion` and the walk's, over all segments."""
    assert motion.segments == walk().segments
    return float(np.degrees(rotations.angle(motion.orientation, walk().orientation)).max())


def test_flat_tf_gives_the_same_joint_angles_as_the_suits_own_file(tmp_path: Path) -> None:
    ros = Ros(2)
    path = write_folder(tmp_path / "flat", ros, flat_tf(ros, walk(), walk().orientation))
    motion = formats.read_motion(path)
    assert isinstance(motion, HumanMotion)
    assert motion.source.format == "rosbag"
    assert motion.source.warnings == ()
    assert np.abs(motion.time - walk().time).max() < 1e-9
    assert np.abs(motion.position - walk().position).max() < 1e-12
    assert np.abs(joints(motion) - joints(walk())).max() < 1e-5


def test_all_kinds_of_recordings_hold_the_same_motion_bit_for_bit(tmp_path: Path) -> None:
    short = timebase.cut(walk(), 0.0, 0.5)
    ros, ros1 = Ros(2), Ros(1)
    folder = write_folder(tmp_path / "sqlite", ros, flat_tf(ros, short, short.orientation))
    in_mcap = write_folder(tmp_path / "mcap", ros, flat_tf(ros, short, short.orientation), mcap=True)
    bag = write_bag(tmp_path / "walk.bag", ros1, flat_tf(ros1, short, short.orientation, root="/world"))
    first = formats.read_motion(folder)
    pipe = _Pipe(storage(in_mcap).read_bytes())
    for other in (bag, storage(folder), in_mcap, storage(in_mcap), pipe, io.BytesIO(bag.read_bytes())):
        motion = formats.read_motion(other, "stream" if isinstance(other, io.BytesIO) else None)
        for field in ("time", "orientation", "position"):
            assert np.array_equal(getattr(motion, field), getattr(first, field)), (other, field)
        assert motion.segments == first.segments


class _Pipe(io.BytesIO):
    def seekable(self) -> bool:
        return False

    def seek(self, *_: Any) -> int:
        raise io.UnsupportedOperation

    def tell(self) -> int:
        raise io.UnsupportedOperation


def test_a_tree_without_transforms_near_the_identity_is_within_half_a_degree(tmp_path: Path) -> None:
    ros, motion = Ros(2), walk()
    # As the driver: nothing of a segment whose own or parent's orientation in the world is near the identity. In these steps L5, L3 and the
    # head come within two degrees of it, for up to a tenth of a second.
    near = np.degrees(rotations.angle(motion.orientation, np.array([1.0, 0.0, 0.0, 0.0]))) < 2.0
    assert near.sum() > 80
    column = {segment: index for index, segment in enumerate(motion.segments)}

    def dropped(frame: int, at: int) -> bool:
        parent = PARENT[motion.segments[at]]
        return bool(near[frame, at] or (parent and near[frame, column[parent]]))

    path = write_folder(tmp_path / "tree", ros, tree_tf(ros, motion, motion.orientation, PARENT, dropped))
    read = formats.read_motion(path)
    assert read.frames == motion.frames
    assert read.source.interpolated_frames > 50
    assert any(line.startswith("skeleton_l5 in skeleton_pelvis: ") for line in read.source.warnings)
    assert 0 < difference_deg(read) < 0.5
    assert 0 < np.degrees(np.abs(joints(read) - joints(motion))).max() < 0.5


@pytest.mark.parametrize("version", [1, 2])
def test_link_states_are_read_by_the_definition_in_the_recording(tmp_path: Path, version: int) -> None:
    ros = Ros(version)
    sent = link_states(ros, walk(), walk().orientation)
    path = (
        write_bag(tmp_path / "l.bag", ros, sent) if version == 1 else write_folder(tmp_path / "l", ros, sent, mcap=True)
    )
    motion = formats.read_motion(path)
    assert np.abs(motion.position - walk().position).max() < 1e-12
    assert difference_deg(motion) < 1e-6
    if version == 2:
        assert np.abs(joints(motion) - joints(walk())).max() < 1e-5


def test_frames_of_hanging_arms_are_turned_into_those_of_the_t_pose(tmp_path: Path) -> None:
    ros = Ros(2)
    path = write_folder(tmp_path / "hrii", ros, flat_tf(ros, walk(), hanging_arms(walk().segments, walk().orientation)))
    motion = formats.read_motion(path)
    assert difference_deg(motion) < 1e-6
    assert sum("frames of hanging arms" in line for line in motion.source.warnings) == 2


def _without_definitions(folder: Path) -> Path:
    """The `.db3` of a folder as distributions before Iron wrote it."""
    import sqlite3

    path = storage(folder)
    with sqlite3.connect(path) as database:
        database.executescript("DROP TABLE message_definitions; DROP TABLE schema; DROP TABLE metadata;")
        database.executescript("ALTER TABLE topics DROP COLUMN type_description_hash;")
    database.close()
    return path


def test_an_old_db3_needs_the_definitions(tmp_path: Path) -> None:
    short, ros = timebase.cut(walk(), 0.0, 0.2), Ros(2)
    path = _without_definitions(write_folder(tmp_path / "old", ros, link_states(ros, short, short.orientation)))
    with pytest.raises(
        FormatError, match=r"topic /link_states: unknown message definition .*LinkStateArray; expected --msg-def"
    ):
        formats.read_motion(path)
    from tests.formats.ros_recordings import LINK_STATE, LINK_STATE_ARRAY

    folder = tmp_path / "xsens_mvn_ros_msgs" / "msg"
    folder.mkdir(parents=True)
    (folder / "LinkState.msg").write_text(LINK_STATE)
    (folder / "LinkStateArray.msg").write_text(LINK_STATE_ARRAY)
    for given in ((tmp_path,), (folder / "LinkState.msg", folder / "LinkStateArray.msg")):
        motion = formats.read_motion(path, options=TrackerOptions(msg_defs=given))
        assert np.abs(motion.position - short.position).max() < 1e-12
    with pytest.raises(FormatError, match="--msg-def holds LinkState"):
        formats.read_motion(path, options=TrackerOptions(msg_defs=(folder / "LinkState.msg",)))


def test_segments_stamped_one_after_another_come_onto_one_time_base(tmp_path: Path) -> None:
    # The ROS 1 driver asks the clock anew for each segment.
    ros, short = Ros(2), timebase.cut(walk(), 0.0, 1.0)
    path = write_folder(tmp_path / "apart", ros, flat_tf(ros, short, short.orientation, apart_ns=9_000))
    motion = formats.read_motion(path)
    assert motion.frames == short.frames
    assert abs(motion.rate_hz - 60.0) < 1e-3
    assert any("times are uneven or differ between" in line for line in motion.source.warnings)
    # 0.2 ms at most, at the speeds of this walk
    assert np.degrees(rotations.angle(motion.orientation, short.orientation)).max() < 0.1
    assert np.abs(motion.position - short.position).max() < 1e-3


def test_of_several_people_one_is_taken_and_the_others_are_named(tmp_path: Path) -> None:
    short, ros = timebase.cut(walk(), 0.0, 0.1), Ros(2)
    moved = replace(short, position=short.position + np.array([0.0, 2.0, 0.0]))
    both = [
        *flat_tf(ros, short, short.orientation),
        *flat_tf(ros, moved, moved.orientation, prefix="skeleton_1_"),
    ]
    path = write_folder(tmp_path / "two", ros, sorted(both, key=lambda sent: sent.log_time))
    motion = formats.read_motion(path)
    assert np.abs(motion.position - short.position).max() < 1e-12
    assert any("several people, with prefixes 'skeleton_', 'skeleton_1_'" in line for line in motion.source.warnings)
    other = formats.read_motion(path, options=TrackerOptions(frames={"prefix": "skeleton_1_"}))
    assert np.abs(other.position - moved.position).max() < 1e-12


def test_a_map_with_rotations_brings_other_frames_into_the_t_pose(tmp_path: Path) -> None:
    short, ros = timebase.cut(walk(), 0.0, 0.2), Ros(2)
    reference = np.array([0.5, 0.5, 0.5, 0.5])
    turned = rotations.multiply(short.orientation, reference)
    path = write_folder(tmp_path / "mocap", ros, flat_tf(ros, short, turned, prefix="rig/bone_"))
    chosen = {"Pelvis": "/rig/bone_pelvis", "LeftUpperArm": "rig/bone_left_upper_arm"}
    options = TrackerOptions(frames={"segments": chosen, "rotations": dict.fromkeys(chosen, reference.tolist())})
    motion = formats.read_motion(path, options=options)
    assert motion.segments == ("Pelvis", "LeftUpperArm")
    columns = [walk().index(segment) for segment in motion.segments]
    assert rotations.angle(motion.orientation, short.orientation[:, columns]).max() < 1e-7


def test_a_driver_faster_than_the_suit_repeats_frames_which_are_left_out(tmp_path: Path) -> None:
    ros, motion = Ros(2), timebase.cut(walk(), 0.0, 1.0)
    twice = np.repeat(np.arange(motion.frames), 2)
    held = replace(
        motion,
        time=motion.time[0] + np.arange(len(twice)) / 120.0,
        orientation=motion.orientation[twice],
        position=motion.position[twice],
        angular_velocity=None,
        foot_contacts=None,
    )
    read = formats.read_motion(write_folder(tmp_path / "held", ros, flat_tf(ros, held, held.orientation)))
    assert read.frames == motion.frames
    assert np.abs(read.position - motion.position).max() < 1e-12
    assert any("repeat the whole pose before" in line for line in read.source.warnings)
