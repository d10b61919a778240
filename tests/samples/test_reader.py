"""The package's own reader gives, for every sample, what stands in the golden JSON."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from retarget.formats.mvnx import FORMAT
from retarget.samples import generate, sample_path


@pytest.mark.parametrize("name", sorted(generate.SAMPLES))
def test_reader_finds_the_golden_motion(name: str, golden: Callable[[str], dict[str, Any]]) -> None:
    expected = golden(name)
    assert FORMAT.read_motion is not None
    with gzip.open(sample_path(name)) as stream:
        motion = FORMAT.read_motion(stream, f"{name}.mvnx.gz")
    assert (motion.source.format, motion.source.version) == (expected["format"], expected["version"])
    assert motion.source.warnings == ()
    assert motion.unmeasured_segments == ()
    assert motion.segments == tuple(expected["segments"])
    assert (motion.frames, motion.source.rate_hz) == (expected["frames"], expected["rate_hz"])
    assert (motion.foot_contacts is None) == (expected["contact_frames"] is None)
    for frame in expected["selected"]:
        i = frame["frame"]
        assert motion.time[i] == pytest.approx(frame["time_s"], abs=1e-5)
        assert motion.position[i] == pytest.approx(np.array(frame["position"]), abs=1e-5)
        wanted = np.array(frame["orientation"])
        same_sign = wanted * np.sign(np.einsum("si,si->s", wanted, motion.orientation[i]))[:, None]
        assert motion.orientation[i] == pytest.approx(same_sign, abs=1e-5)
        if frame["foot_contacts"] is not None:
            assert motion.foot_contacts is not None
            assert motion.foot_contacts[i].tolist() == frame["foot_contacts"]
        if frame["angular_velocity"] is not None:
            assert motion.angular_velocity is not None
            assert motion.angular_velocity[i] == pytest.approx(np.array(frame["angular_velocity"]), abs=1e-5)
