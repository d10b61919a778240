"""How mappings are found: this folder first, then what is installed."""

from __future__ import annotations

import subprocess
import sys
from importlib.metadata import EntryPoint

import pytest
from retarget.core import mapping
from retarget.core.errors import UnknownNameError, UsageError
from retarget.core.mapping import Mapping


def installed(monkeypatch: pytest.MonkeyPatch, name: str, value: str) -> None:
    point = EntryPoint(name, value, mapping.GROUP)
    monkeypatch.setattr(mapping, "entry_points", lambda *, group: [point] if group == mapping.GROUP else [])


def test_names() -> None:
    names = mapping.names()
    assert {"limb_plane", "link_orientation"} <= set(names)
    assert names == sorted(set(names))
    assert not mapping.SHARED & set(names)


@pytest.mark.parametrize("name", mapping.names())
def test_each_is_what_it_is_called_and_names_its_source(name: str) -> None:
    found = mapping.load(name)
    assert isinstance(found, Mapping)
    assert found.name == name
    assert "[" in found.description
    assert "\n" not in found.description
    assert callable(found.targets)


def test_listing_imports_none() -> None:
    code = (
        "import sys; from retarget.core import mapping; assert mapping.names();"
        "print([m for m in sys.modules if m.startswith('retarget.core.mapping.')])"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"


def test_unknown_names_offer_the_nearest() -> None:
    with pytest.raises(UnknownNameError, match=r"^unknown mapping 'limb_plain'; did you mean limb_plane"):
        mapping.load("limb_plain")
    for helper in mapping.SHARED:
        with pytest.raises(UnknownNameError):
            mapping.load(helper)


def test_an_installed_mapping_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    installed(monkeypatch, "mine", "retarget.core.mapping.link_orientation:MAPPING")
    assert "mine" in mapping.names()
    assert mapping.load("mine").name == "link_orientation"


def test_an_installed_mapping_cannot_replace_one_of_this_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    installed(monkeypatch, "limb_plane", "retarget.core.mapping.link_orientation:MAPPING")
    assert mapping.load("limb_plane").name == "limb_plane"
    assert mapping.names().count("limb_plane") == 1


def test_an_installed_thing_that_is_no_mapping(monkeypatch: pytest.MonkeyPatch) -> None:
    installed(monkeypatch, "mine", "math:tau")
    with pytest.raises(UsageError, match=r"^mapping 'mine' \(math:tau\): found float, expected a Mapping$"):
        mapping.load("mine")
