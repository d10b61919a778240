"""The committed files: complete, small, honest about what they are, and exactly what the generator writes."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from retarget.core.errors import UnknownNameError
from retarget.samples import generate, sample_names, sample_path

NAMES = sorted(generate.SAMPLES)


@pytest.fixture(scope="module")
def fresh(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("samples")
    generate.write_all(folder)
    return folder


def test_every_sample_is_committed_and_no_other() -> None:
    assert list(sample_names()) == sorted([*NAMES, *generate.TRACKER_SAMPLES])
    assert {"walk", "walk_v3", "reach", "squat", *(f"yaw_{h:03d}" for h in range(0, 360, 45))} == set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_generator_reproduces_the_committed_files(name: str, fresh: Path) -> None:
    committed, again = sample_path(name), fresh / f"{name}.mvnx.gz"
    assert gzip.decompress(again.read_bytes()) == gzip.decompress(committed.read_bytes())
    assert (fresh / f"{name}.json").read_bytes() == committed.with_name(f"{name}.json").read_bytes()
    # Another zlib may compress the same bytes otherwise, so of the packing only the header is compared: flags 0 means no file name.
    assert again.read_bytes()[:8] == committed.read_bytes()[:8] == b"\x1f\x8b\x08\x00" + bytes(4)


def test_samples_are_small() -> None:
    assert sum(path.stat().st_size for name in NAMES for path in sample_path(name).parent.glob(f"{name}.*")) < 6e6


def test_unknown_name_offers_the_nearest() -> None:
    with pytest.raises(UnknownNameError, match="unknown sample 'walk3'; did you mean walk or walk_v3"):
        sample_path("walk3")


@pytest.mark.parametrize("name", NAMES)
def test_labelled_synthetic_and_anonymous(name: str, document: Callable[[str], Any]) -> None:
    content = document(name)
    assert "Synthetic" in content.comment
    assert "not recorded from a person" in content.comment
    assert not {"originalFilename", "recDate"} & set(content.attributes)


@pytest.mark.parametrize("name", NAMES)
def test_layout_of_its_version(name: str, document: Callable[[str], Any]) -> None:
    content = document(name)
    version_3 = name.endswith("v3")
    assert content.attributes["version"] == ("3" if version_3 else "4")
    assert list(content.reference) == (["npose", "tpose"] if version_3 else ["identity", "tpose", "tpose-isb"])
    assert (content.contacts is None) == version_3
    assert content.attributes["segmentCount"] == "23" == str(len(content.segments))
    assert ("jRightC7Shoulder" if version_3 else "jRightT4Shoulder") in content.points["T8"]
    index = np.array([int(frame["index"]) for frame in content.frames])
    milliseconds = np.array([int(frame["time"]) for frame in content.frames])
    assert (index == np.arange(len(index))).all()
    assert np.abs(milliseconds - 1000 * index / content.rate_hz).max() <= 0.5
