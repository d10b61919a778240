"""Recordings of libsurvive (`--record`), `.rec` and `.rec.gz`: of their lines those of poses, `t DEVICE POSE x y z qw qx qy qz`.

Seconds and metres, quaternion wxyz, world ← device, **Z up** unless declared otherwise. Devices report at times of their own: they are interpolated onto one
time base. Recordings are seldom closed: what stands before a cut, in the text or in the gzip stream, is read, with a warning. `HMD` sits on the
head; other devices (`WM0`, `T20` …) need a table of roles. Faults are treated as in logs of format `vive`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any, BinaryIO

import numpy as np
from retarget.core.errors import FormatError, UsageError
from retarget.core.types import TrackerRecording
from retarget.formats._byte_chunks import collect_chunks
from retarget.formats._tracker_faults import Samples, since_first
from retarget.formats._tracker_recording import Log, build
from retarget.formats._vive_table import Table
from retarget.formats.base import Format, TrackerOptions

_CELLS = 10


def read_trackers(stream: BinaryIO, name: str, options: TrackerOptions) -> TrackerRecording:
    """The devices of a recording. `stream` need not seek; `name` is what messages call it.

    Raises `FormatError` for a file without pose lines and for lines that hold something else, `UsageError` for a columns file or rate.
    """
    return build(_read(stream, name, options))[0]


def describe(stream: BinaryIO, name: str, options: TrackerOptions) -> Mapping[str, Any]:
    """Facts for `retarget info`, from a full read."""
    return build(_read(stream, name, options))[1]


def _read(stream: BinaryIO, name: str, options: TrackerOptions) -> Log:
    if options.columns is not None or options.rate_hz is not None:
        raise UsageError(
            f"{name}: libsurvive recordings name their columns and times; expected no columns file and no rate"
        )
    warnings: list[str] = []
    digest = hashlib.sha256()
    chunks: list[bytes] = []
    try:
        collect_chunks(stream, name, digest, chunks)
    except FormatError as error:
        if not chunks:
            raise
        warnings.append(f"{error.problem}: read up to there")
    table = _table(b"".join(chunks), name, warnings)
    names, values = table.words([1])[:, 0], table.values([0, *range(3, _CELLS)])
    time = since_first(values[:, 0])
    devices, first = np.unique(names, return_index=True)
    samples = []
    for index in np.argsort(first):
        rows = np.flatnonzero(names == devices[index])
        samples.append(
            Samples(
                tracker=str(devices[index]),
                time=time[rows],
                position=values[rows, 1:4],
                orientation=values[rows, 4:],
                valid=np.ones(len(rows), bool),
                line=table.numbers[rows],
            )
        )
    return Log(
        name=name,
        format=FORMAT.name,
        trackers=samples,
        up=options.up or "z",
        handedness=options.handedness or "right",
        roles=options.roles,
        warnings=warnings,
        sha256=digest.hexdigest(),
    )


def _table(data: bytes, name: str, warnings: list[str]) -> Table:
    """The pose lines. Others are not looked at: among them are measurements of light and configurations of many kilobytes."""
    lines = data.split(b"\n")
    kept = [
        (number, " ".join(line.decode("utf-8", "replace").split()))
        for number, line in enumerate(lines, 1)
        if b" POSE " in line and line.split(None, 3)[2:3] == [b"POSE"]
    ]
    # A number that is cut short is still a number: a last line without its end can't be trusted.
    if kept and kept[-1][0] == len(lines):
        warnings.append(f"line {kept[-1][0]} is cut short and left out")
        kept.pop()
    if not kept:
        raise FormatError(name, "no poses", expected="lines 't DEVICE POSE x y z qw qx qy qz'")
    for number, line in kept:
        if line.count(" ") != _CELLS - 1:
            raise FormatError(
                name, f"{line.count(' ') + 1} cells", place=f"line {number}", expected="t DEVICE POSE x y z qw qx qy qz"
            )
    return Table(
        name=name,
        lines=[line for _, line in kept],
        numbers=np.array([number for number, _ in kept]),
        delimiter=" ",
        columns=("t", "device", "POSE", "x", "y", "z", "qw", "qx", "qy", "qz"),
    )


FORMAT = Format(
    name="libsurvive",
    description="recordings of libsurvive: lines of poses, plain or gzip",
    suffixes=(".rec", ".rec.gz"),
    read_trackers=read_trackers,
    describe_trackers=describe,
    pipeable=True,
)
