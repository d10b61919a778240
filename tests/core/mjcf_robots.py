"""Robots from MJCF texts, for the tests of what becomes of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from retarget.core import robot_model
from retarget.core.profile import ModelSource, RobotProfile
from retarget.core.robot_model import RobotModel


def numbers(values: Any) -> str:
    return " ".join(repr(float(v)) for v in np.ravel(values))


def profile_of(path: Path, **changed: Any) -> RobotProfile:
    facts: dict[str, Any] = {
        "name": "robot",
        "description": "",
        "model": ModelSource("file", str(path)),
        "base": "fixed",
        "links": {},
        "origin": "robot.toml",
        "default_velocity_limit": 10.0,
    }
    return RobotProfile(**{**facts, **changed})


def built(folder: Path, text: str, **changed: Any) -> RobotModel:
    path = folder / "robot.xml"
    path.write_text(text, encoding="utf-8")
    return robot_model.build(profile_of(path, **changed))


ARM = """<mujoco model="arm"><compiler angle="radian"/>
  <worldbody><body name="base" pos="0 0 1"><geom size="0.1" mass="1"/>
    <body name="link" pos="0.1 0 0">
      <joint name="one" axis="0 0 1" range="-1 2" {one}/>
      <joint name="two" axis="0 1 0" range="-1 2" armature="0.25"/>
      <geom name="g" type="capsule" size="0.05 0.2" pos="0 0 0.2" mass="1"/>
      {more}
    </body></body></worldbody>
  {sections}
</mujoco>"""


def arm(one: str = "", more: str = "", sections: str = "") -> str:
    return ARM.format(one=one, more=more, sections=sections)
