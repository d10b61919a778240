"""A file that exists is finished: outputs appear whole or not at all, and what was there before is kept on any failure."""

from __future__ import annotations

import errno
import io
import os
import resource
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from retarget import formats
from retarget.core.errors import RetargetError, UnknownNameError, UsageError
from retarget.core.types import JointTrajectory
from retarget.formats import _output
from retarget.formats.base import Format

Maker = Callable[..., JointTrajectory]
WRITABLE = [name for name, f in formats.available().items() if f.write_trajectory]


@pytest.fixture
def trajectory(make_trajectory: Maker) -> JointTrajectory:
    return make_trajectory()


@pytest.mark.parametrize("name", WRITABLE)
def test_folder_holds_the_file_and_nothing_else(tmp_path: Path, trajectory: JointTrajectory, name: str) -> None:
    path = tmp_path / f"walk{formats.get(name).suffixes[0]}"
    formats.write_trajectory(path, trajectory)
    assert list(tmp_path.iterdir()) == [path]
    assert formats.read_trajectory(path).joint_names == trajectory.joint_names


def test_new_file_has_the_permissions_of_any_new_file(tmp_path: Path, trajectory: JointTrajectory) -> None:
    (tmp_path / "other").touch()
    formats.write_trajectory(tmp_path / "walk.mcap", trajectory)
    assert (tmp_path / "walk.mcap").stat().st_mode == (tmp_path / "other").stat().st_mode


def test_existing_output_is_kept_unless_told(tmp_path: Path, trajectory: JointTrajectory) -> None:
    path = tmp_path / "walk.mcap"
    path.write_bytes(b"precious")
    with pytest.raises(UsageError, match=r"walk\.mcap: exists already"):
        formats.write_trajectory(path, trajectory)
    assert path.read_bytes() == b"precious"
    formats.write_trajectory(path, trajectory, overwrite=True)
    assert formats.read_trajectory(path).robot == "g1"
    assert list(tmp_path.iterdir()) == [path]


def test_output_that_appears_meanwhile_is_kept(
    tmp_path: Path, trajectory: JointTrajectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "walk.slow"

    def slow(*_: object) -> None:
        path.write_bytes(b"of another process")

    _only(monkeypatch, slow)
    with pytest.raises(UsageError, match="exists already"):
        formats.write_trajectory(path, trajectory)
    assert path.read_bytes() == b"of another process"
    assert list(tmp_path.iterdir()) == [path]


def test_missing_folder_names_the_near(tmp_path: Path, trajectory: JointTrajectory) -> None:
    (tmp_path / "results").mkdir()
    with pytest.raises(UsageError, match=r"there is no folder .*resluts; did you mean .*results\?"):
        formats.write_trajectory(tmp_path / "resluts" / "walk.mcap", trajectory)


def test_target_that_is_no_file(tmp_path: Path, trajectory: JointTrajectory) -> None:
    (tmp_path / "folder.mcap").mkdir()
    with pytest.raises(UsageError, match="is a directory"):
        formats.write_trajectory(tmp_path / "folder.mcap", trajectory, overwrite=True)
    os.mkfifo(tmp_path / "fifo.mcap")
    with pytest.raises(UsageError, match="is not a regular file"):
        formats.write_trajectory(tmp_path / "fifo.mcap", trajectory, overwrite=True)
    with pytest.raises(UsageError, match="is not a regular file"):
        formats.write_trajectory(os.devnull, trajectory, format="mcap", overwrite=True)
    (tmp_path / "file").touch()
    with pytest.raises(UsageError, match="can't be written: not a directory"):
        formats.write_trajectory(tmp_path / "file" / "walk.mcap", trajectory)
    with pytest.raises(UsageError, match="file name too long"):
        formats.write_trajectory(tmp_path / ("x" * 300 + ".mcap"), trajectory)


def test_link_is_followed_and_stays(tmp_path: Path, trajectory: JointTrajectory) -> None:
    (tmp_path / "store").mkdir()
    real, link = tmp_path / "store" / "walk.mcap", tmp_path / "walk.mcap"
    real.write_bytes(b"old")
    link.symlink_to(real)
    formats.write_trajectory(link, trajectory, overwrite=True)
    assert link.is_symlink()
    assert formats.read_trajectory(real).robot == "g1"


def test_unwritable_folder(trajectory: JointTrajectory) -> None:
    # As root everything is writable: the test becomes somebody else then, in a folder that others may enter.
    folder = Path(tempfile.mkdtemp())
    try:
        folder.chmod(0o555)
        if root := os.geteuid() == 0:
            os.seteuid(65534)
        try:
            with pytest.raises(UsageError, match=r"walk\.mcap: can't be written: permission denied"):
                formats.write_trajectory(folder / "walk.mcap", trajectory)
        finally:
            if root:
                os.seteuid(0)
        assert not list(folder.iterdir())
    finally:
        folder.chmod(0o755)
        shutil.rmtree(folder)


@pytest.fixture
def small_disk() -> Iterator[None]:
    """Files can't grow beyond 4 kB: the kernel refuses the write as it does on a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, hard))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.usefixtures("small_disk")
@pytest.mark.parametrize("name", WRITABLE)
def test_full_disk_keeps_the_old_file(tmp_path: Path, make_trajectory: Maker, name: str) -> None:
    path = tmp_path / f"walk{formats.get(name).suffixes[0]}"
    path.write_bytes(b"precious")
    with pytest.raises(RetargetError, match="can't be written: file too large") as caught:
        formats.write_trajectory(path, make_trajectory(frames=200), overwrite=True)
    assert not isinstance(caught.value, UsageError)
    assert path.read_bytes() == b"precious"
    assert list(tmp_path.iterdir()) == [path]


def test_disk_that_is_found_full_only_when_flushed(
    tmp_path: Path, trajectory: JointTrajectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As network shares do: every write is accepted, and the last flush fails."""
    path = tmp_path / "walk.mcap"
    path.write_bytes(b"precious")

    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(RetargetError, match=r"walk\.mcap: can't be written: no space left on device$"):
        formats.write_trajectory(path, trajectory, overwrite=True)
    assert [p.read_bytes() for p in tmp_path.iterdir()] == [b"precious"]


@pytest.mark.parametrize("name", [n for n in WRITABLE if formats.get(n).pipeable])
@pytest.mark.parametrize("buffering", [-1, 0])
def test_full_device_behind_a_stream(make_trajectory: Maker, name: str, buffering: int) -> None:
    full = Path("/dev/full")
    if not full.exists():
        pytest.skip("needs /dev/full")
    stream = full.open("wb", buffering=buffering)
    with pytest.raises(RetargetError, match="output stream: can't be written: no space left on device"):
        formats.write_trajectory_stream(stream, make_trajectory(frames=2000), name)
    assert not stream.closed
    getattr(stream, "raw", stream).close()


@pytest.mark.parametrize("failure", [KeyboardInterrupt(), RetargetError("no"), RuntimeError("bug")])
def test_interrupted_write_leaves_nothing(
    tmp_path: Path, trajectory: JointTrajectory, monkeypatch: pytest.MonkeyPatch, failure: BaseException
) -> None:
    def broken(stream: io.BytesIO, *_: object) -> None:
        stream.write(b"half")
        raise failure

    _only(monkeypatch, broken)
    (tmp_path / "walk.slow").write_bytes(b"precious")
    with pytest.raises(type(failure)):
        formats.write_trajectory(tmp_path / "walk.slow", trajectory, overwrite=True)
    assert [p.read_bytes() for p in tmp_path.iterdir()] == [b"precious"]


def _only(monkeypatch: pytest.MonkeyPatch, writer: Callable[..., None]) -> None:
    only = Format("slow", "for this test", suffixes=(".slow",), write_trajectory=writer)
    monkeypatch.setattr(_output._registry, "available", lambda: {"slow": only})


def test_unknown_suffix_format_and_style(tmp_path: Path, trajectory: JointTrajectory) -> None:
    with pytest.raises(UnknownNameError, match=r"unknown output suffix '\.mcp'; did you mean \.mcap"):
        formats.write_trajectory(tmp_path / "walk.mcp", trajectory)
    with pytest.raises(UsageError, match="no suffix tells the format"):
        formats.write_trajectory(tmp_path / "walk", trajectory)
    with pytest.raises(UnknownNameError, match="unknown format 'mcpa'; did you mean mcap"):
        formats.write_trajectory(tmp_path / "walk", trajectory, format="mcpa")
    with pytest.raises(UnknownNameError, match="unknown csv style 'unitre'; did you mean unitree"):
        formats.write_trajectory(tmp_path / "walk.csv", trajectory, style="unitre")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", WRITABLE)
@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"joint_names": ("a", "b\0", "c")}, r"joint_names\[1\] holds a NUL"),
        ({"robot": "\ud800"}, "robot can't be written as UTF-8"),
    ],
)
def test_text_that_no_format_holds(
    tmp_path: Path, trajectory: JointTrajectory, name: str, change: dict[str, object], message: str
) -> None:
    with pytest.raises(RetargetError, match=message):
        formats.write_trajectory(tmp_path / "walk", replace(trajectory, **change), format=name)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["mcap", "hdf5", "npz"])
@pytest.mark.parametrize("value", [float("nan"), object()])
def test_provenance_that_is_no_json(tmp_path: Path, trajectory: JointTrajectory, name: str, value: object) -> None:
    with pytest.raises(RetargetError, match="provenance can't be written as JSON"):
        formats.write_trajectory(tmp_path / "walk", replace(trajectory, provenance={"x": value}), format=name)
    assert not list(tmp_path.iterdir())


class _Pipe(io.RawIOBase):
    """A stream as poor as stdout to a pipe can be: it can't seek nor tell, and takes at most 100 bytes at once."""

    def __init__(self) -> None:
        self.data = b""

    def writable(self) -> bool:
        return True

    def write(self, data: bytes | memoryview, /) -> int:
        self.data += bytes(data[:100])
        return min(len(data), 100)


def test_stream_that_cannot_seek_gets_the_same_bytes(tmp_path: Path, trajectory: JointTrajectory) -> None:
    pipe = _Pipe()
    formats.write_trajectory_stream(pipe, trajectory)
    formats.write_trajectory(tmp_path / "walk.mcap", trajectory)
    assert pipe.data == (tmp_path / "walk.mcap").read_bytes()
    assert not pipe.closed


@pytest.mark.parametrize("name", ["hdf5", "npz"])
def test_format_that_cannot_be_piped_asks_for_a_file(trajectory: JointTrajectory, name: str) -> None:
    out = io.BytesIO()
    with pytest.raises(UsageError, match=f"{name} can't be written to a pipe; write it to a file with -o FILE"):
        formats.write_trajectory_stream(out, trajectory, name)
    assert not out.getvalue()


def test_closed_pipe_is_passed_on(make_trajectory: Maker) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    stream = os.fdopen(writer, "wb")
    with pytest.raises(BrokenPipeError):
        formats.write_trajectory_stream(stream, make_trajectory(frames=5000))
    stream.raw.close()


FOLDERS = [name for name, f in formats.available().items() if f.write_folder]


@pytest.mark.parametrize("name", FOLDERS)
def test_a_folder_is_replaced_only_by_its_own_kind(tmp_path: Path, make_trajectory: Maker, name: str) -> None:
    if name == "lerobot":
        pytest.importorskip("pyarrow", reason="the extra lerobot is not installed")
    path = tmp_path / "out"
    formats.write_trajectory(path, make_trajectory(), format=name)
    with pytest.raises(UsageError, match="exists already"):
        formats.write_trajectory(path, make_trajectory(), format=name)
    formats.write_trajectory(path, make_trajectory(joints=2), format=name, overwrite=True)
    assert len(formats.read_trajectory(path).joint_names) == 2
    assert list(tmp_path.iterdir()) == [path]
    written = [file for file in path.rglob("*") if file.is_file()]
    (path / "precious").touch()
    for _ in range(2):  # beside an output of ours, then without one
        with pytest.raises(UsageError, match=f"is a folder that is no {name} written here, so it is never replaced"):
            formats.write_trajectory(path, make_trajectory(), format=name, overwrite=True)
        assert (path / "precious").exists()
        for file in written:
            file.unlink(missing_ok=True)
    (tmp_path / "file").touch()
    with pytest.raises(UsageError, match=f"is a file; {name} is a folder"):
        formats.write_trajectory(tmp_path / "file", make_trajectory(), format=name, overwrite=True)
    with pytest.raises(UsageError, match="there is no folder"):
        formats.write_trajectory(tmp_path / "none" / "out", make_trajectory(), format=name)


@pytest.mark.parametrize(
    ("name", "files"),
    [
        ("rosbag2", {"metadata.yaml": "name: a network", "weights": ""}),
        ("rosbag2", {"metadata.yaml": "rosbag2_bagfile_information:", "recorded_0.db3": ""}),
        ("lerobot", {"meta/info.json": "{}", "data/chunk-000/file-000.parquet": ""}),
    ],
)
def test_folders_of_others_are_never_replaced(
    tmp_path: Path, make_trajectory: Maker, name: str, files: dict[str, str]
) -> None:
    for file, text in files.items():
        (tmp_path / "out" / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "out" / file).write_text(text)
    with pytest.raises(UsageError, match=f"is a folder that is no {name} written here"):
        formats.write_trajectory(tmp_path / "out", make_trajectory(), format=name, overwrite=True)
    assert {str(p.relative_to(tmp_path / "out")) for p in tmp_path.rglob("*") if p.is_file()} == set(files)


@pytest.fixture(scope="module")
def tiny_disk() -> Iterator[Path]:
    """A file system of 256 kB."""
    if os.geteuid() != 0 or shutil.which("mount") is None:
        pytest.skip("only root can mount a small disk")
    folder = Path(tempfile.mkdtemp())
    command = ["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", str(folder)]
    if subprocess.run(command, capture_output=True, check=False).returncode:
        folder.rmdir()
        pytest.skip("this machine lets nobody mount a small disk")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)
    folder.rmdir()


@pytest.mark.parametrize("name", [*WRITABLE, *FOLDERS])
def test_a_disk_that_is_full_keeps_what_was_there(tiny_disk: Path, make_trajectory: Maker, name: str) -> None:
    if name == "lerobot":
        pytest.importorskip("pyarrow", reason="the extra lerobot is not installed")
    path = tiny_disk / "walk"
    formats.write_trajectory(path, make_trajectory(frames=30), format=name)
    with pytest.raises(RetargetError, match=r"walk: can't be written: no space left on device$"):
        formats.write_trajectory(path, make_trajectory(frames=4000, joints=29), format=name, overwrite=True)
    assert list(tiny_disk.iterdir()) == [path]
    assert formats.read_trajectory(path, format=name).frames == 30
    shutil.rmtree(path) if path.is_dir() else path.unlink()


def test_where_files_need_a_name_the_part_is_removed(
    tmp_path: Path, trajectory: JointTrajectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As on network file systems: nameless files are refused, and everything works all the same."""
    real = os.open

    def refuse(path: object, flags: int, *rest: int, **more: int) -> int:
        if flags & os.O_TMPFILE == os.O_TMPFILE:
            raise OSError(errno.EOPNOTSUPP, os.strerror(errno.EOPNOTSUPP))
        return real(path, flags, *rest, **more)  # type: ignore[call-overload,no-any-return]  # passed on as it came

    monkeypatch.setattr(os, "open", refuse)
    formats.write_trajectory(tmp_path / "walk.mcap", trajectory)
    assert list(tmp_path.iterdir()) == [tmp_path / "walk.mcap"]

    def broken(*_: object) -> None:
        assert len(list(tmp_path.iterdir())) == 2
        raise KeyboardInterrupt

    _only(monkeypatch, broken)
    with pytest.raises(KeyboardInterrupt):
        formats.write_trajectory(tmp_path / "walk.slow", trajectory)
    assert list(tmp_path.iterdir()) == [tmp_path / "walk.mcap"]


def test_an_unfinished_file_has_no_name(
    tmp_path: Path, trajectory: JointTrajectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So a process that is killed while it writes leaves nothing."""
    seen = []
    _only(
        monkeypatch, lambda stream, *_: (stream.write(b"half"), stream.flush(), seen.append(list(tmp_path.iterdir())))
    )
    formats.write_trajectory(tmp_path / "walk.slow", trajectory)
    if not Path("/proc/self/fd").is_dir():
        pytest.skip("nameless files need /proc")
    assert seen == [[]]
