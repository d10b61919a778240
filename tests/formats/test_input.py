"""What can't be opened says so in one line; pipes are read like files where the format allows it."""

from __future__ import annotations

import io
import os
import shutil
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pytest
from retarget import formats
from retarget.core.errors import FormatError, RetargetError, UsageError
from retarget.core.types import JointTrajectory

Maker = Callable[..., JointTrajectory]
READERS = (formats.read_trajectory, formats.read_motion, formats.describe)


@pytest.fixture
def written(tmp_path: Path, make_trajectory: Maker) -> Path:
    path = tmp_path / "walk.mcap"
    formats.write_trajectory(path, make_trajectory())
    return path


@contextmanager
def piped(data: bytes, *, buffered: bool = True) -> Iterator[BinaryIO]:
    """The reading end of a real pipe into which a thread writes `data` in small pieces."""
    reader, writer = os.pipe()

    def feed() -> None:
        with os.fdopen(writer, "wb", buffering=0) as out:
            for start in range(0, len(data), 1000):
                out.write(data[start : start + 1000])

    thread = threading.Thread(target=feed, daemon=True)
    thread.start()
    with os.fdopen(reader, "rb", buffering=-1 if buffered else 0) as stream:
        yield stream
    thread.join(5)


@pytest.mark.parametrize("read", READERS)
class TestPathThatCannotBeOpened:
    def test_missing_file_names_the_near(self, written: Path, read: Callable[[Path], object]) -> None:
        with pytest.raises(UsageError, match=r"wlak\.mcap: no such file; did you mean walk\.mcap\?"):
            read(written.with_name("wlak.mcap"))

    def test_missing_folder(self, tmp_path: Path, read: Callable[[Path], object]) -> None:
        with pytest.raises(UsageError, match=r"no such file \(there is no folder .*absent\)"):
            read(tmp_path / "absent" / "walk.mcap")

    def test_directory(self, tmp_path: Path, read: Callable[[Path], object]) -> None:
        (tmp_path / "walk.mcap").mkdir()
        with pytest.raises(UsageError, match="is a directory; expected a file"):
            read(tmp_path / "walk.mcap")

    def test_name_too_long_or_not_a_name(self, tmp_path: Path, read: Callable[[Path], object]) -> None:
        with pytest.raises(UsageError, match="file name too long"):
            read(tmp_path / ("x" * 300 + ".mcap"))
        with pytest.raises(UsageError, match="null"):
            read(tmp_path / "x\0.mcap")

    def test_empty_file(self, tmp_path: Path, read: Callable[[Path], object]) -> None:
        (tmp_path / "walk.mcap").touch()
        with pytest.raises(FormatError, match=r"walk\.mcap: empty file$"):
            read(tmp_path / "walk.mcap")


def test_permission_denied() -> None:
    # Not pytest's folder, which nobody but its owner may enter: the test becomes somebody else when root runs it.
    folder = Path(tempfile.mkdtemp())
    try:
        folder.chmod(0o755)
        secret = folder / "secret.mcap"
        secret.write_bytes(b"x")
        secret.chmod(0)
        if root := os.geteuid() == 0:
            os.seteuid(65534)
        try:
            with pytest.raises(UsageError, match=r"secret\.mcap: permission denied"):
                formats.read_trajectory(secret)
        finally:
            if root:
                os.seteuid(0)
    finally:
        shutil.rmtree(folder)


@pytest.mark.parametrize("name", [n for n, f in formats.available().items() if f.pipeable and f.write_trajectory])
@pytest.mark.parametrize("buffered", [True, False])
def test_pipe_gives_what_the_file_gives(make_trajectory: Maker, name: str, buffered: bool) -> None:
    data = io.BytesIO()
    formats.write_trajectory_stream(data, make_trajectory(frames=500), name)
    expected = formats.read_trajectory(io.BytesIO(data.getvalue()), format=name)
    with piped(data.getvalue(), buffered=buffered) as stream:
        found = formats.read_trajectory(stream, "<stdin>", name)
    assert found.joint_names == expected.joint_names
    np.testing.assert_array_equal(found.position, expected.position)
    np.testing.assert_array_equal(found.time, expected.time)
    assert found.provenance == expected.provenance


def test_format_of_a_pipe_is_known_by_its_content(written: Path) -> None:
    with piped(written.read_bytes()) as stream:
        assert formats.read_trajectory(stream, "<stdin>").robot == "g1"
    with piped(written.read_bytes()) as stream:
        assert formats.describe(stream)["format"] == "mcap"


@pytest.mark.parametrize("name", ["hdf5", "npz"])
def test_format_that_needs_to_seek_is_refused_from_a_pipe(tmp_path: Path, make_trajectory: Maker, name: str) -> None:
    path = tmp_path / f"walk.{name}"
    formats.write_trajectory(path, make_trajectory())
    with (
        piped(path.read_bytes()) as stream,
        pytest.raises(UsageError, match=f"<stdin>: {name} can't be read from a pipe; save it to a file"),
    ):
        formats.read_trajectory(stream, "<stdin>")


def test_short_and_empty_pipes() -> None:
    with piped(b"") as stream, pytest.raises(FormatError, match="<stdin>: empty file"):
        formats.read_trajectory(stream, "<stdin>")
    with piped(b"\x89MCAP0\r\n") as stream, pytest.raises(FormatError, match="ends inside"):
        formats.read_trajectory(stream, "<stdin>")


def test_open_stream_is_read_from_where_it_stands_and_left_open(written: Path) -> None:
    stream = io.BytesIO(b"before" + written.read_bytes())
    stream.seek(6)
    assert formats.read_trajectory(stream, "memory", "mcap").robot == "g1"
    assert not stream.closed


def test_explicit_format_overrules_the_suffix(written: Path) -> None:
    odd = written.rename(written.with_name("walk.csv"))
    assert formats.read_trajectory(odd, format="mcap").robot == "g1"


def test_trajectory_is_no_motion(written: Path) -> None:
    with pytest.raises(UsageError, match=r"walk\.mcap: mcap holds robot trajectories, not recorded motion"):
        formats.read_motion(written)


class _Failing(io.BytesIO):
    def read(self, size: int | None = -1, /) -> bytes:
        if self.tell() > 1000:
            raise OSError(5, "Input/output error")
        return super().read(size)


def test_device_error_is_one_line(written: Path) -> None:
    with pytest.raises(RetargetError, match=r"^tape: can't be read: input/output error$"):
        formats.read_trajectory(_Failing(written.read_bytes()), "tape", "mcap")


def test_describe_says_what_a_trajectory_is(tmp_path: Path, make_trajectory: Maker) -> None:
    path = tmp_path / "walk.hdf5"
    formats.write_trajectory(path, make_trajectory(frames=61, joints=2))
    facts = dict(formats.describe(path))
    assert facts.pop("provenance") == {"input_sha256": "ab12", "options": {"rate": 60, "names": ["é", "b"]}}
    assert facts.pop("rate_hz") == pytest.approx(60)
    assert facts == {
        "format": "hdf5",
        "kind": "trajectory",
        "robot": "g1",
        "joints": ["left_joint_0", "left_joint_1"],
        "frames": 61,
        "duration_s": 1.0,
        "start_s": 0.0,
        "base": "floating",
        "base_frame": "pelvis",
        "marked_frames": 1,
        "has_robot_description": True,
        "warnings": [],
    }
