"""Small files of every kind, as other tools write them or as they lie: what fuzzing and the tables of bad input start from."""

from __future__ import annotations

import gzip
import io
import re
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np
from retarget import formats
from retarget.core.types import JointTrajectory


def sample(name: str) -> bytes:
    """A file of `retarget.samples`."""
    return files("retarget.samples").joinpath(name).read_bytes()


def short_mvnx(name: str, frames: int = 4) -> bytes:
    """A sample recording cut down to its first frames."""
    text = gzip.decompress(sample(name))
    ends = [match.end() for match in re.finditer(rb"</frame>\s*", text)]
    return text[: ends[frames + 2]] + text[ends[-1] :]


def trajectory(joints: int = 2, frames: int = 4) -> JointTrajectory:
    """A small one with everything set."""
    time = np.arange(frames) / 50.0
    return JointTrajectory(
        time=time,
        joint_names=tuple(f"joint_{i}" for i in range(joints)),
        position=np.sin(time[:, None] + np.arange(joints)),
        velocity=np.cos(time[:, None] + np.arange(joints)),
        base_position=np.zeros((frames, 3)) + time[:, None],
        base_orientation=np.tile([1.0, 0.0, 0.0, 0.0], (frames, 1)),
        base_linear_velocity=np.ones((frames, 3)),
        base_angular_velocity=np.zeros((frames, 3)),
        status=np.arange(frames) == 1,
        base_frame="pelvis",
        robot="g1",
        provenance={"options": {"rate": 60}},
        robot_description='<robot name="g1"><link name="pelvis"/></robot>',
    )


@cache
def written(format_name: str, style: str | None = None) -> bytes:
    """The small trajectory as a file of that format."""
    out = io.BytesIO()
    format_ = formats.get(format_name)
    assert format_.write_trajectory is not None
    format_.write_trajectory(out, trajectory(), style or format_.styles[0])
    return out.getvalue()


def unchecked_mcap() -> bytes:
    """The MCAP without chunks and checksums, as some recorders write it: damage reaches the messages."""
    import zstandard
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader

    data = written("mcap")
    chunks = [r for r in StreamReader(io.BytesIO(data), emit_chunks=True).records if isinstance(r, Chunk)]
    content = b"".join(zstandard.decompress(chunk.data) for chunk in chunks)
    header = b"\x01" + (8).to_bytes(8, "little") + bytes(8)
    footer = b"\x02" + (20).to_bytes(8, "little") + bytes(20)
    return data[:8] + header + content + footer + data[:8]


def foreign_hdf5(*, checksums: bool = False, **changes: Any) -> bytes:
    """The same layout as h5py writes it by default: metadata without checksums, texts in a heap; or with them. Named datasets replaced:
    by an array, or by one that is declared of a shape and never written."""
    import h5py

    t = trajectory()
    data = {
        "time": t.time,
        "joint/position": t.position,
        "joint/velocity": t.velocity,
        "base/position": t.base_position,
        "base/orientation": t.base_orientation,
        **changes,
    }
    out = io.BytesIO()
    texts = {"schema": "retarget.trajectory/1", "quat_order": "wxyz", "joint_names": list(t.joint_names)}
    with h5py.File(out, "w", libver=("v108", "v110") if checksums else None) as file:
        for name, text in texts.items():
            file.attrs[name] = np.array(text, "S") if checksums else text
        for path, value in data.items():
            if isinstance(value, tuple):
                file.create_dataset(path, value, "f8", chunks=(1000,) * len(value))
            else:
                file[path] = value
    return out.getvalue()


def lying_npz() -> bytes:
    """An array header that claims 8 TB."""
    import zipfile

    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(written("npz"))) as source, zipfile.ZipFile(out, "w") as archive:
        for name in source.namelist():
            content = source.read(name)
            archive.writestr(
                name, content.replace(b"(4, 2), }", b"(1000000000000, 2), }") if "joint_pos" in name else content
            )
    return out.getvalue()


def npz_bomb(megabytes: int = 200) -> bytes:
    """A megabyte or less that unpacks to much more."""
    out = io.BytesIO()
    np.savez_compressed(out, fps=50.0, joint_pos=np.zeros((megabytes << 16, 2)), joint_names=np.array(["a", "b"]))
    return out.getvalue()


def tracker_log(kind: str) -> bytes:
    """A short log: "wide" and "long" columns, or lines of libsurvive."""
    if kind == "wide":
        return b"\n".join(sample("clap_trackers.csv").split(b"\n")[:5]) + b"\n"
    if kind == "libsurvive":
        return b"".join(
            b"0.%d %s POSE 0.1 %d.2 1.%d 1 0 0 0\n" % (i, device, i, i) for i in range(8) for device in (b"HMD", b"T20")
        )
    rows = [b"%.2f,%s,0.%d,1.%d,0.3,1,0,0,0,1" % (i / 50, dev, i, i) for i in range(6) for dev in (b"waist", b"LHR-1")]
    return b"\n".join([b"time,device,x,y,z,qw,qx,qy,qz,valid", *rows]) + b"\n"


COLUMNS_TOML = b"""delimiter = "comma"
skip_lines = 0
header = true
up = "y"
handedness = "right"
time = "time_s"
time_unit = "s"

[trackers.chest]
x = "chest_x_m"
y = "chest_y_m"
z = 4
qw = "chest_qw"
qx = "chest_qx"
qy = "chest_qy"
qz = "chest_qz"
unit = "m"
valid = "chest_valid"
role = "chest"

[roles]
"chest" = "T8"
"""
THRESHOLDS_TOML = b"""joint_jump_max_rad = 0.2
[kinematic]
ground_penetration_mm = 5
acceleration_max_rad_s2 = "none"
[fixed]
joint_tracking_rmse_deg = 0.5
"""
