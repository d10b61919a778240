"""A guessed profile as TOML text in which every guess says so, for its owner to go through."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping

from retarget.core.profile import RobotProfile

TEMPLATE = """
# Where the soles are: three or more corners, m, in the foot link's frame. With them the stance foot stays on the floor.
# [feet.Left]
# link = {left_foot}
# sole_m = [[0.1, 0.05, -0.05], [0.1, -0.05, -0.05], [-0.1, -0.05, -0.05], [-0.1, 0.05, -0.05]]
# [feet.Right]
# …

# Where fingers and palms point: unit vectors in the hand link's frame. Without them the reference posture says it: palms down.
# [hands.Left]
# link = {left_hand}
# fingers = [1.0, 0.0, 0.0]
# palm = [0.0, 0.0, -1.0]
# [hands.Right]
# …
"""


def profile_text(profile: RobotProfile, joints: Mapping[str, str], file: str) -> str:
    """The TOML of a guessed profile. joints: segment → the joint right before its link, "" for the root; file: the model, as [model] shall name it.

    Only what `core.profile_guess` fills in is written.
    """
    return "\n".join(_lines(profile, joints, file)) + "\n"


def _lines(profile: RobotProfile, joints: Mapping[str, str], file: str) -> Iterator[str]:
    yield "# Guessed from the model by `retarget robots new`. Go through it: what stands here was found by the tree of joints, their axes and names."
    yield f"name = {_text(profile.name)}"
    yield f"description = {_text(profile.description)}"
    yield "\n[model]"
    yield f"file = {_text(file)}"
    if profile.base == "floating":
        yield 'base = "floating"   # guess: it has legs'
        yield f"base_rpy_rad = {list(profile.base_rpy)}   # guess: hips above feet, left hip on the left"
    else:
        yield 'base = "fixed"   # guess: no legs were found'
        yield f"base_segment = {_text(profile.base_segment)}"
    if profile.locked_joints:
        yield "# guess: fingers and grippers, by their names"
        yield "locked_joints = ["
        yield from (f"    {_text(name)}," for name in profile.locked_joints)
        yield "]"
    if profile.default_velocity_limit is not None:
        yield "\n# guess: the model states no speeds, or some that no joint has"
        yield "[limits]"
        yield f"default_velocity_rad_s = {profile.default_velocity_limit}"
    yield "\n# guess: an elbow or knee is the joint whose axis passes farthest from both ends of its limb"
    yield "[links]"
    for segment, link in profile.links.items():
        behind = f"behind joint {json.dumps(joints[segment], ensure_ascii=False)}" if joints[segment] else "the root"
        yield f"{segment} = {_text(link)}   # {behind}"
    if profile.reference_posture:
        yield "\n# guess: the T-pose that the solver found; wrists at 0, though palms should point down"
        yield "[reference_posture_rad]"
        yield from (f"{_text(joint)} = {angle}" for joint, angle in profile.reference_posture.items())
    links = profile.links
    yield TEMPLATE.format(
        left_foot=_text(links.get("LeftFoot", "…")), left_hand=_text(links.get("LeftHand", "…"))
    ).rstrip()


def _text(value: str) -> str:
    """A TOML basic string: JSON's, but that TOML escapes DEL, too."""
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007F")
