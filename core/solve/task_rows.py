"""Jacobian rows and commanded velocities of orientation, position and axis tasks [Lim2022 table III, eq. 13].

    orientation (3 rows, world)   J_ω q̇ = ω* + K log(R_d Rᵀ)
    position    (3 rows, world)   J_v q̇ = v* + K (p_d - p),              p the task's point, fixed in its link
    axis        (2 rows, link)    S Rᵀ J_ω q̇ = S Rᵀ (ω* + K φ(a → a_d)),  S the two directions across the link's own axis

φ is the smallest rotation that takes the axis to where it should point; its part about the axis, which eq. 13 drops, is none. A row over the
robot is a row (6,) over the spatial velocity at the world's origin that every joint gives to what it carries: [-[p]ₓ below v_O = v - ω x p],
so that all rows of all tasks are one matrix product with pinocchio's Jacobian.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from retarget.core import rotations
from retarget.core.robot_model import RobotModel
from retarget.core.solve.problem import joint_paths
from retarget.core.solve.task_samples import TaskSample
from retarget.core.types import Array, Task

ROWS_OF = {"orientation": 3, "position": 3, "axis": 2}
HALF_TURN = -1.0 + 1e-4
"""Cosine below which a rotation's axis is not read off its antisymmetric part."""


class TaskRows:
    """The rows of `tasks`, in their order, and six for each hand point: velocity of the point, then angular velocity, world.

    columns: (c,) joints solved for. hands: (link, point in its frame) each. gains: the tasks', 1/s. Not thread-safe: arrays are reused.

    jacobian: (R, c). command: (R,). hand_rows: (6 H, c). inertia: (c, c) joint-space inertia, without additions. All of the last `linearise`.
    """

    def __init__(
        self,
        tasks: Sequence[Task],
        model: RobotModel,
        columns: NDArray[np.intp],
        hands: Sequence[tuple[str, tuple[float, float, float]]],
        gains: Array,
    ) -> None:
        import pinocchio as pin

        self._model, self._pin, self._data = model.pin_model, pin, model.pin_model.createData()
        starts = np.concatenate([[0], np.cumsum([ROWS_OF[task.kind] for task in tasks])]).astype(int)
        count = int(starts[-1])
        self.slices = [slice(int(a), int(b)) for a, b in pairwise(starts)]
        velocity_columns = columns + (model.pin_model.nv - len(model.joint_names))
        self._columns = velocity_columns
        # CRBA promises the upper triangle only.
        low, high = (
            np.minimum.outer(velocity_columns, velocity_columns),
            np.maximum.outer(velocity_columns, velocity_columns),
        )
        self._inertia_index = low * model.pin_model.nv + high
        places = [model.link_in_joint(task.frame) for task in tasks]
        hand_places = [model.link_in_joint(link) for link, _ in hands]
        ids = sorted({joint for joint, _, _ in (*places, *hand_places)})
        # pinocchio's own memory, seen through arrays: asking for it by name costs 2 µs each time.
        self._turns = [self._data.oMi[i].rotation for i in ids]
        self._shifts = [self._data.oMi[i].translation for i in ids]
        self._spatial, self._mass = self._data.J, self._data.M

        kinds = {kind: [i for i, task in enumerate(tasks) if task.kind == kind] for kind in ROWS_OF}
        self._orientation, self._axis = (
            np.array([ids.index(places[i][0]) for i in kinds[kind]], int) for kind in ("orientation", "axis")
        )
        points = [(places[i], tasks[i].offset) for i in kinds["position"]]
        points += [(place, np.array(point)) for place, (_, point) in zip(hand_places, hands, strict=True)]
        self._point = np.array([ids.index(place[0]) for place, _ in points], int)
        self._point_offset = np.array([place[1] @ offset + place[2] for place, offset in points]).reshape(-1, 3)
        self._own_axis = np.array([places[i][1] @ tasks[i].axis for i in kinds["axis"]]).reshape(-1, 3)
        self._across = np.array([across(tasks[i].axis) @ places[i][1].T for i in kinds["axis"]]).reshape(-1, 2, 3)
        self._gain = {kind: gains[kinds[kind]][:, None] for kind in ROWS_OF}
        first = {kind: np.array([starts[i] for i in kinds[kind]], int) for kind in ROWS_OF}
        self._rows = {kind: (first[kind][:, None] + np.arange(size)).ravel() for kind, size in ROWS_OF.items()}

        # Constant entries of the (R + 6 H, 6) rows over spatial velocities, and where the others go.
        hand_first = count + 6 * np.arange(len(hands))
        self._form = np.zeros((count + 6 * len(hands), 6))
        for i in (*kinds["orientation"], *kinds["position"]):
            start = starts[i]
            self._form[start : start + 3, 3 * (tasks[i].kind == "orientation") :][:, :3] = np.eye(3)
        for start in hand_first:
            self._form[start : start + 6] = np.eye(6)
        self._cross_index = np.array(
            [
                [(row + i) * 6 + 3 + j for i, j in ((2, 1), (0, 2), (1, 0), (1, 2), (2, 0), (0, 1))]
                for row in (*first["position"], *hand_first)
            ],
            int,
        ).reshape(-1, 6)
        self._axis_index = (self._rows["axis"][:, None] * 6 + 3 + np.arange(3)).ravel()
        # Orientations that matter less about their own direction u: rows and command times I - (1 - √ε) u uᵀ.
        self._twisted = [(n, i) for n, i in enumerate(kinds["orientation"]) if tasks[i].twist_weight < 1.0]
        self._twist_loss = [1.0 - float(np.sqrt(tasks[i].twist_weight)) for _, i in self._twisted]
        self._twist_axis = [places[i][1] @ tasks[i].axis for _, i in self._twisted]

        paths = joint_paths(model, 0)
        moved = [np.isin(columns, paths[place[0]]) for place in (*places, *hand_places)]
        sizes = [ROWS_OF[task.kind] for task in tasks] + [6] * len(hands)
        self._moves = np.repeat(np.array(moved, float).reshape(-1, len(columns)), sizes, axis=0)
        self._all_rows = np.zeros((len(self._form), len(columns)))
        self.jacobian, self.hand_rows = self._all_rows[:count], self._all_rows[count:]
        self.command = np.zeros(count)
        self.inertia = np.zeros((len(columns), len(columns)))

    def linearise(self, q: Array, wanted: TaskSample) -> None:
        """Fill `jacobian`, `command`, `hand_rows` and `inertia` at pinocchio configuration `q`."""
        self._pin.crba(self._model, self._data, q)
        np.take(self._mass, self._inertia_index, out=self.inertia)
        self._pin.computeJointJacobians(self._model, self._data, q)
        turn, shift = np.stack(self._turns), np.stack(self._shifts)
        flat, command, rows, gain = self._form.reshape(-1), self.command, self._rows, self._gain

        if len(self._point):
            at = (turn[self._point] @ self._point_offset[:, :, None])[:, :, 0] + shift[self._point]
            flat[self._cross_index] = np.concatenate([-at, at], axis=1)
            count = len(wanted.position)
            command[rows["position"]] = (
                wanted.position_rate + gain["position"] * (wanted.position - at[:count])
            ).ravel()
        if len(self._axis):
            turned = turn[self._axis]
            own = (turned @ self._own_axis[:, :, None])[:, :, 0]
            across_world = self._across @ turned.transpose(0, 2, 1)
            flat[self._axis_index] = across_world.ravel()
            rate = wanted.axis_rate + gain["axis"] * smallest_turn(own, wanted.axis)
            command[rows["axis"]] = (across_world @ rate[:, :, None]).ravel()
        if len(self._orientation):
            error = rotation_vector(wanted.orientation @ turn[self._orientation].transpose(0, 2, 1))
            rate = wanted.orientation_rate + gain["orientation"] * error
            self._lose_twist(rate, turn)
            command[rows["orientation"]] = rate.ravel()
        np.matmul(self._form, self._spatial[:, self._columns], out=self._all_rows)
        self._all_rows *= self._moves

    def hand_poses(self, q: Array) -> tuple[Array, Array]:
        """World rotation (H, 3, 3) of the hand links and (H, 3) m of the hand points at configuration `q`."""
        self._pin.forwardKinematics(self._model, self._data, q)
        hands = self._point[len(self._point) - len(self.hand_rows) // 6 :]
        turn, shift = np.stack(self._turns)[hands], np.stack(self._shifts)[hands]
        offset = self._point_offset[len(self._point_offset) - len(hands) :]
        return turn, (turn @ offset[:, :, None])[:, :, 0] + shift

    def _lose_twist(self, rate: Array, turn: Array) -> None:
        """Scale the rows and commands `rate` (O, 3) of orientation tasks with a twist weight below 1, in place."""
        for (n, _), loss, axis in zip(self._twisted, self._twist_loss, self._twist_axis, strict=True):
            u = turn[self._orientation[n]] @ axis
            form = np.eye(3) - loss * np.outer(u, u)
            start = self._rows["orientation"][3 * n]
            self._form[start : start + 3, 3:] = form
            rate[n] = form @ rate[n]


def across(axis: Array) -> Array:
    """Two unit directions (2, 3) that with unit `axis` (3,) make a right-handed frame axis, first, second; y and z for the x axis."""
    nearest_axis = int(np.argmax(np.abs(axis)))
    guide = np.roll(np.eye(3)[nearest_axis], 1)
    first = guide - (guide @ axis) * axis
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(axis, first)])


def rotation_vector(matrix: Array) -> Array:
    """Logarithm (K, 3), angle in [0, π], of rotation matrices (K, 3, 3); half turns included."""
    vector = 0.5 * np.stack(
        [
            matrix[:, 2, 1] - matrix[:, 1, 2],
            matrix[:, 0, 2] - matrix[:, 2, 0],
            matrix[:, 1, 0] - matrix[:, 0, 1],
        ],
        axis=1,
    )
    cosine = 0.5 * (np.trace(matrix, axis1=1, axis2=2) - 1.0)
    found = _with_angle(vector, cosine)
    if (near := cosine < HALF_TURN).any():
        found[near] = rotations.log(rotations.from_matrix(matrix[near]))
    return found


def smallest_turn(start: Array, end: Array) -> Array:
    """Rotation vectors (K, 3) of the smallest rotations that take unit `start` to unit `end` (K, 3)."""
    x, y = start, end
    vector = np.stack(
        [
            x[:, 1] * y[:, 2] - x[:, 2] * y[:, 1],
            x[:, 2] * y[:, 0] - x[:, 0] * y[:, 2],
            x[:, 0] * y[:, 1] - x[:, 1] * y[:, 0],
        ],
        axis=1,
    )
    cosine = (x * y).sum(axis=1)
    found = _with_angle(vector, cosine)
    if (near := cosine < HALF_TURN).any():
        found[near] = rotations.log(rotations.shortest_arc(x[near], y[near]))
    return found


def _with_angle(vector: Array, cosine: Array) -> Array:
    """sin θ · axis (K, 3) and cos θ (K,) → θ · axis."""
    sine = np.sqrt((vector * vector).sum(axis=1))
    small = sine < 1e-12
    scaled: Array = vector * np.where(small, 1.0, np.arctan2(sine, cosine) / np.where(small, 1.0, sine))[:, None]
    return scaled
