"""Every mapped link fully oriented like its segment: R*_link = R_segment · H_R_R [Darvish2019 eq. 2]. The paper's own mapping."""

from __future__ import annotations

import numpy as np
from retarget.core import rotations
from retarget.core.mapping import Mapping
from retarget.core.mapping.link_rotations import as_in_paper
from retarget.core.profile import MappingParameters
from retarget.core.robot_model import RobotModel
from retarget.core.types import HumanMotion, Targets, Task


def targets(motion: HumanMotion, model: RobotModel) -> Targets:
    """One orientation task per measured and mapped segment, all weighted 1 unless the profile says otherwise.

    The feed-forward ω* is the recording's own angular velocity, or the difference of its orientations where it has none.
    """
    constants = as_in_paper(model)
    parameters = model.profile.mappings.get("link_orientation", MappingParameters())
    tasks = []
    for segment, link in {**model.links, **parameters.links}.items():
        if not motion.has(segment):
            continue
        index = motion.index(segment)
        orientation = motion.orientation[:, index]
        omega = motion.angular_velocity
        tasks.append(
            Task(
                frame=link,
                kind="orientation",
                value=rotations.multiply(orientation, rotations.from_matrix(constants[segment])),
                feed_forward=rotations.angular_velocity(motion.time, orientation) if omega is None else omega[:, index],
                weight=np.array(parameters.weights.get(segment, 1.0)),
                segment=segment,
            )
        )
    return Targets(motion.time, tuple(tasks), "link_orientation")


MAPPING = Mapping("link_orientation", "every link oriented like its segment [Darvish2019 eq. 2]", targets)
