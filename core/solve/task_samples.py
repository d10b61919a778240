"""What tasks of three kinds want, at the frames of a clip and at control steps between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from retarget.core import rotations
from retarget.core.robot_model import RobotModel
from retarget.core.types import Array, Task


@dataclass(frozen=True, eq=False)
class TaskSample:
    """Desired values at one instant, or with a leading axis at M of them; O, A, P tasks of the three kinds.

    orientation: (O, 3, 3) world ← frame of the joint that carries the link. axis: (A, 3) unit, world. position: (P, 3) m, world.
    *_rate: their feed-forward, (O, 3) and (A, 3) rad/s, (P, 3) m/s, world.
    """

    orientation: Array
    axis: Array
    position: Array
    orientation_rate: Array
    axis_rate: Array
    position_rate: Array

    def __getitem__(self, at: int) -> TaskSample:
        """One of the M instants."""
        return TaskSample(
            self.orientation[at],
            self.axis[at],
            self.position[at],
            self.orientation_rate[at],
            self.axis_rate[at],
            self.position_rate[at],
        )

    def standing(self) -> TaskSample:
        """The same values, with nothing moving."""
        return TaskSample(
            self.orientation,
            self.axis,
            self.position,
            np.zeros_like(self.orientation_rate),
            np.zeros_like(self.axis_rate),
            np.zeros_like(self.position_rate),
        )


class TaskSamples:
    """Desired values of `tasks` over the frames of a clip; each kind keeps the tasks' order."""

    def __init__(self, tasks: Sequence[Task], model: RobotModel) -> None:
        frames = len(tasks[0].value)
        orientation, axis, position = (
            [task for task in tasks if task.kind == kind] for kind in ("orientation", "axis", "position")
        )
        placements = [rotations.from_matrix(model.link_in_joint(task.frame)[1]) for task in orientation]
        self._orientation = _stacked(
            [
                rotations.make_continuous(rotations.multiply(task.value, rotations.conjugate(placement)))
                for task, placement in zip(orientation, placements, strict=True)
            ],
            (frames, 0, 4),
        )
        self._axis = _stacked([task.value for task in axis], (frames, 0, 3))
        self._position = _stacked([task.value for task in position], (frames, 0, 3))
        self._rates = tuple(
            _stacked(
                [np.zeros((frames, 3)) if task.feed_forward is None else task.feed_forward for task in group],
                (frames, 0, 3),
            )
            for group in (orientation, axis, position)
        )

    def at(self, frame: int) -> TaskSample:
        """The values at `frame`."""
        rates = (rate[frame] for rate in self._rates)
        return TaskSample(
            rotations.to_matrix(self._orientation[frame]), self._axis[frame], self._position[frame], *rates
        )

    def between(self, frame: int, count: int) -> TaskSample:
        """The values at `count` equally spaced instants from `frame` on, the next frame excluded.

        Positions and feed-forward change linearly, orientations and axes along the shortest arc.
        """
        share = (np.arange(count) / count)[:, None, None]
        orientation, axis = self._orientation[frame : frame + 2], self._axis[frame : frame + 2]
        # Between neighbouring frames the normalised line is the arc to third order in the angle, and the ends are exact.
        turned = rotations.slerp(orientation[0], orientation[1], share[..., 0]) if orientation.size else None
        line = _on_the_line(axis, share)
        length = np.linalg.norm(line, axis=-1, keepdims=True)
        return TaskSample(
            np.zeros((count, 0, 3, 3)) if turned is None else rotations.to_matrix(turned),
            np.where(length > 1e-6, line / np.where(length > 1e-6, length, 1.0), axis[0]),
            _on_the_line(self._position[frame : frame + 2], share),
            *(_on_the_line(rate[frame : frame + 2], share) for rate in self._rates),
        )


def _on_the_line(ends: Array, share: Array) -> Array:
    between: Array = ends[0] + share * (ends[1] - ends[0])
    return between


def _stacked(values: list[Array], empty: tuple[int, ...]) -> Array:
    return np.stack(values, axis=1) if values else np.zeros(empty)
