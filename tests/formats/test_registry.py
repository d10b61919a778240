"""Formats are found without being told of, cheaply, and recognised by suffix and content."""

from __future__ import annotations

import subprocess
import sys
import types
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest
from retarget import formats
from retarget.core.errors import FormatError, UnknownNameError
from retarget.formats import _registry
from retarget.formats.base import Format

HEAVY = ("h5py", "rosbags", "mcap", "mujoco", "pinocchio", "lz4", "zstandard")


def test_names_are_the_modules_of_the_folder() -> None:
    folder = Path(formats.__file__).parent
    modules = {p.stem for p in folder.glob("*.py") if not p.stem.startswith("_")} - {"base"}
    assert {"mcap", "hdf5", "csv", "npz"} <= modules
    assert set(formats.available()) == modules == set(formats.names())


@pytest.mark.parametrize("call", ["names()", "available()", "detect('a.mcap', b'')"])
def test_listing_and_detecting_import_nothing_heavy(call: str) -> None:
    code = (
        f"import sys; from retarget import formats; formats.{call}; print([m for m in {HEAVY!r} if m in sys.modules])"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


def test_every_format_is_called_as_its_module_and_who_shares_a_suffix_knows_its_own() -> None:
    found = formats.available()
    assert all(name == format_.name for name, format_ in found.items())
    suffixes = [suffix for format_ in found.values() for suffix in format_.suffixes]
    assert all(suffix.startswith(".") and suffix == suffix.lower() for suffix in suffixes)
    functions = ("read_motion", "read_trajectory", "read_trackers", "read_recording", "writable")
    assert all(any(getattr(f, function) for function in functions) for f in found.values())
    for suffix in {suffix for suffix in suffixes if suffixes.count(suffix) > 1}:
        sharing = [f for f in found.values() if suffix in f.suffixes]
        assert all(f.recognises is not None and not f.recognises(b"") for f in sharing)
        assert sum(f.write_trajectory is not None for f in sharing) <= 1


@pytest.mark.parametrize(
    ("head", "reader", "name"),
    [
        (b"time_s,base_x_m,base_y_m,base_z_m,base_qw,base_qx,base_qy,base_qz,q_knee_rad,status\n0,0", "", "csv"),
        (b"\xef\xbb\xbftime_s,q_knee_rad,dq_knee_rad_s,status\n", "read_trackers", "csv"),
        (b"time_s,waist_x,waist_y,waist_z,waist_qw,waist_qx,waist_qy,waist_qz\n0,0", "", "vive"),
        (b"time_s,waist_x,waist_y,waist_z,waist_qw,waist_qx,waist_qy,waist_qz\n0,0", "read_trajectory", "vive"),
        (b"# made by hand\ntime;device;x;y;z;qx;qy;qz;qw\n", "", "vive"),
        (b"1,2,3,4,5,6,7\n", "read_trackers", "vive"),
        (b"1,2,3,4,5,6,7\n", "read_trajectory", "csv"),
        (b"1,2,3,4,5,6,7\n", "", "csv"),
    ],
)
def test_content_decides_between_trajectories_and_tracker_logs_of_one_suffix(
    head: bytes, reader: str, name: str
) -> None:
    assert formats.detect("walk.csv", head, reader).name == name


def test_a_shared_suffix_is_written_by_the_format_that_can() -> None:
    found = _registry.of_suffix("walk.csv")
    assert found is not None
    assert found.name == "csv"


@pytest.mark.parametrize(
    ("path", "head", "name"),
    [
        ("walk.mcap", b"", "mcap"),
        ("WALK.MCAP", b"\x89MCAP0\r\n", "mcap"),
        ("a.b/walk.h5", b"\x89HDF\r\n\x1a\n", "hdf5"),
        ("walk.csv", b"PK\x03\x04", "csv"),
        ("walk", b"PK\x03\x04....", "npz"),
        ("walk.dat", b"\x89HDF\r\n\x1a\n....", "hdf5"),
        ("walk.npz", b"garbage", "npz"),
    ],
)
def test_suffix_first_then_magic(path: str, head: bytes, name: str) -> None:
    assert formats.detect(path, head).name == name


@pytest.mark.parametrize("order", [1, -1])
def test_longest_suffix_wins(order: int) -> None:
    pair = [Format("packed", "", suffixes=(".gz",)), Format("gait", "", suffixes=(".gait", ".gait.gz"))][::order]
    known = {format_.name: format_ for format_ in pair}
    found = [_registry.of_suffix(path, known) for path in ("a.gait.gz", "a.gz", "a.gait", "a")]
    assert [format_ and format_.name for format_ in found] == ["gait", "packed", "gait", None]


def test_unknown_content_names_the_near_and_all_readable_suffixes() -> None:
    with pytest.raises(FormatError, match=r"unknown suffix '\.mcp'.*did you mean \.mcap.*\.csv.*\.npz"):
        formats.detect("walk.mcp", b"garbage")
    with pytest.raises(FormatError, match="no suffix"):
        formats.detect("walk", b"garbage")


def test_a_suffix_that_its_content_contradicts_is_refused() -> None:
    with pytest.raises(FormatError, match=r"suffix says mcap, the content is hdf5.*\.h5"):
        formats.detect("walk.mcap", b"\x89HDF\r\n\x1a\n")


def test_unknown_format_names_the_near() -> None:
    with pytest.raises(UnknownNameError, match="unknown format 'hdf'; did you mean hdf5"):
        formats.get("hdf")
    with pytest.raises(UnknownNameError, match="unknown format 'base'"):
        formats.get("base")


def _plugin(monkeypatch: pytest.MonkeyPatch, name: str, value: str) -> None:
    point = EntryPoint(name=name, value=value, group=_registry.GROUP)
    monkeypatch.setattr(_registry, "entry_points", lambda group: [point] if group == _registry.GROUP else [])


def test_plugin_is_found_by_its_entry_point(monkeypatch: pytest.MonkeyPatch) -> None:
    module = types.ModuleType("plugin_of_others")
    plugin = Format("gait", "a plugin", suffixes=(".gait",), magic=(b"GAIT",))
    module.FORMAT = plugin
    monkeypatch.setitem(sys.modules, "plugin_of_others", module)
    for value in ("plugin_of_others", "plugin_of_others:FORMAT"):
        _plugin(monkeypatch, "gait", value)
        assert "gait" in formats.names()
        assert formats.get("gait") is formats.available()["gait"] is plugin
        assert formats.detect("x.gait", b"") is formats.detect("x", b"GAIT!") is plugin


def test_plugin_does_not_replace_a_built_in_format(monkeypatch: pytest.MonkeyPatch) -> None:
    own = formats.get("csv")
    _plugin(monkeypatch, "csv", "nowhere")
    assert formats.get("csv") is formats.available()["csv"] is own


@pytest.mark.parametrize("value", ["module_that_is_not_there", "json:dumps"])
def test_broken_plugin_is_warned_of_and_leaves_the_rest(monkeypatch: pytest.MonkeyPatch, value: str) -> None:
    _plugin(monkeypatch, "gait", value)
    with pytest.warns(UserWarning, match="format plugin 'gait'"):
        found = formats.available()
    assert "gait" not in found
    assert "mcap" in found
