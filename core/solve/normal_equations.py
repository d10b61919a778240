"""Cost, gradient g and Hessian H of the orientation tasks [Darvish2019 eqs 3–5] at one posture.

The cost of one frame, with R the achieved and R* the desired rotation of a link, u and u* its bone's direction, w its weight and l its
twist loss (1 - twist weight; the bone alone matters at l = 1):

    f = ½ Σ w ( (1 - l) ‖log(R* Rᵀ)‖² + l ∠(u, u*)² )

Both terms are squared geodesic distances, so their gradients are exactly -Jᵀ b with

    b = w ( (1 - l) e + l d ),   e = log(R* Rᵀ),   d = ∠(u, u*) · u × u* / ‖u × u*‖

([Darvish2019 eq. 4a] has vee(sk(·)) = sin θ · axis for e, which vanishes at 180°: the logarithm pulls from everywhere.)

Gram form: column j of a link's angular Jacobian is the joint axis a_j where j moves the link, else 0. With A the matrix of all axes (3, c),
S the links' rows of such ones and zeros, and C = Sᵀ diag(w) S: JᵀJ = (AᵀA)∘C, without a Jacobian per link; Jᵀb = Σ over rows of A∘(bᵀS);
each bone takes the rank-one term of its free twist away.

Curvature: JᵀJ is the Hessian only where errors vanish; robots that can't follow their targets exactly would need dozens of steps.
Exactly, with θ = ‖e‖ and φ = ‖d‖, and with t = d × u, the metric of a link is

    w (1 - l) ( κ I + (1 - κ)/θ² e eᵀ ) + w l ( I - p pᵀ - (1 - φ cot φ - φ²/4)/φ² t tᵀ ),   κ = θ/2 cot θ/2,   p = u + ½ t

and along a chain the axis a_j turns with every joint k that leads it: ∂²f/∂k∂j gains ½ a_k · (b_j × a_j), b_j the sum of b over the links that
j moves. (Both follow from f's second derivative along exp(x a_k) exp(y a_j), and exp(a) exp(b) = exp(a + b + ½ a × b + …).) The
fractions are about 1/12: their terms are left out where no error exceeds `SMALL_ANGLE`.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import as_strided
from numpy.typing import NDArray
from retarget.core.solve.problem import OrientationProblem
from retarget.core.types import Array

SMALL_ANGLE = 0.1
"""Errors (rad) up to which the Hessian does without terms of second order: they are below 1/1000 of it."""

_TINY = 1e-300
_NEAR_HALF_TURN = 3.1
_CHUNK = 64
_YZX, _ZXY = np.array([1, 2, 0]), np.array([2, 0, 1])
_UPPER, _LOWER = np.array([7, 2, 3]), np.array([5, 6, 1])
"""Flat places of R[2,1] R[0,2] R[1,0] and of R[1,2] R[2,0] R[0,1]: their differences are 2 sin θ · axis."""


class NormalEquations:
    """`cost`, `gradient` (c,) and `hessian` (c, c) of one frame at one posture, in place. Columns as in `OrientationProblem`.

    The work space belongs to one clip; results are overwritten by the next call. Written for few NumPy calls: at this size a
    call costs more than its arithmetic (and `a.dot(b, out)` half of what `np.matmul` does).
    """

    def __init__(self, problem: OrientationProblem, diagonal: Array) -> None:
        """diagonal: (c,) what is added to every Hessian's diagonal: weights of the unknowns themselves."""
        import pinocchio as pin

        self._jacobians, self._model = pin.computeJointJacobians, problem.model.pin_model
        self._data = self._model.createData()
        self._problem = problem
        links, columns = problem.moves.shape
        # Some posture with all joints turned, so that the check of the memory layout means something.
        posture = pin.integrate(self._model, pin.neutral(self._model), np.linspace(0.1, 1.0, self._model.nv))
        self._jacobians(self._model, self._data, posture)
        self._has_twist = bool(problem.twist_loss.any())
        self._links, parts = links, (2 if self._has_twist else 1) * links
        self._jacobian_memory, self._axes_index = _flat_jacobian(self._data, columns)
        self._placement_memory, self._rotation_index = _flat_placements(
            self._data, np.tile(problem.joint_ids, parts // links)
        )
        self._moves, self._half_leads = problem.moves, 0.5 * problem.leads
        self._bone = problem.bone[:, :, None]
        self.hessian, self.gradient = np.empty((columns, columns)), np.empty(columns)
        self._square = np.empty((columns, columns))
        # The axes are kept twice: NumPy multiplies a matrix by its own transpose by a slower routine (syrk) than two different ones.
        self._axes_twice = np.empty((6, columns))
        self._axes, self._axes_again = self._axes_twice[:3], self._axes_twice[3:]
        self._jacobian_memory.take(self._axes_index, None, self._axes_twice, "clip")
        self._pulls, self._product = np.empty((3, columns)), np.empty((3, columns))
        self._ones, self._four_ones, self._minus_ones = np.ones(3), np.ones(4), -np.ones(3)
        self._rotation = np.empty((parts, 10))
        self._rotation_column = self._rotation[:, :, None]
        self._rotation_3x3 = _as_3x3(self._rotation[:links])
        # Of e twice the sine · axis and twice the cosine, of d the sine · axis and the cosine; one column per error.
        self._linear = np.empty((4, parts))
        self._sine, self._cosine = self._linear[:3], self._linear[3]
        self._linear_out = self._linear.T[:, :, None]
        self._bone_now = np.empty((3, links))
        self._bone_out = self._bone_now.T[:, :, None]
        self._errors = np.empty((3, parts))
        # A fourth square of next to nothing: no length is zero, no angle divided by it NaN.
        self._squares = np.full((4, parts), _TINY)
        self._own_squares = self._squares[:3]
        self._length, self._angle, self._ratio = (np.empty(parts) for _ in range(3))
        self._chunk, self._measures = -1, np.empty(0)
        self._diagonal, self._sliding = diagonal, np.flatnonzero(~self._axes_twice.any(axis=0))
        self._constant_weight = bool((problem.weight == problem.weight[0]).all())
        self._set_weight(0)

    def linearise(self, k: int, q: Array) -> float:
        """The cost of frame k at pinocchio configuration `q`; fills `gradient` and `hessian`, curvature included."""
        self._measure(k, q)
        toward = pivot = self._bone_now
        if self._has_twist:
            toward = _cross(self._errors[:, self._links :], self._bone_now)
            pivot = self._bone_now + 0.5 * toward
        self._gauss_newton(pivot)
        if self._angle.max() > SMALL_ANGLE:
            self._add_second_order(toward)
        turning = self._axes.T.dot(_cross(self._pulls, self._axes), self._square)
        turning *= self._half_leads
        self.hessian += turning
        self.hessian += turning.T
        np.multiply(self._angle, self._angle, self._length)
        return 0.5 * float(self._length.dot(self._part_weight))

    def linearise_velocity(self, k: int, q: Array, gain: float) -> None:
        """`gradient` and `hessian` of ½ ‖J ν - (ω* + gain · error)‖² over velocities ν [Darvish2019 eq. 5]; no curvature."""
        self._measure(k, q)
        pull, feed_forward = self._errors, self._problem.feed_forward[k].T
        pull *= gain
        if self._has_twist:
            along = self._ones.dot(self._bone_now * feed_forward)
            pull[:, : self._links] += feed_forward
            pull[:, self._links :] += feed_forward - along * self._bone_now
        else:
            pull += feed_forward
        self._gauss_newton(self._bone_now)

    def _set_weight(self, k: int) -> None:
        weight, loss = self._problem.weight[k], self._problem.twist_loss
        self._part_weight = np.concatenate([weight * (1 - loss), weight * loss])[: len(self._angle)]
        self._weighted_moves = self._part_weight[:, None] * np.tile(self._moves, (len(self._angle) // self._links, 1))
        # Axes are unit vectors: what stands on the coupling's diagonal stands on H's, except where a joint slides and has none.
        self._coupling = (self._moves.T * weight) @ self._moves + np.diag(self._diagonal)
        self._twist_moves = np.sqrt(weight * loss)[:, None] * self._moves

    def _measure(self, k: int, q: Array) -> None:
        """Axes, rotations, errors e (and d) of frame k at `q`."""
        if k // _CHUNK != self._chunk:
            self._chunk = k // _CHUNK
            self._measures = measuring_matrices(self._problem, slice(_CHUNK * self._chunk, _CHUNK * (self._chunk + 1)))
        if not self._constant_weight:
            self._set_weight(k)
        self._jacobians(self._model, self._data, q)
        self._jacobian_memory.take(self._axes_index, None, self._axes_twice, "clip")
        self._placement_memory.take(self._rotation_index, None, self._rotation, "clip")
        np.matmul(self._measures[k % _CHUNK], self._rotation_column, self._linear_out)
        if self._has_twist:
            np.matmul(self._rotation_3x3, self._bone, self._bone_out)
        cosine, length, angle, ratio = self._cosine, self._length, self._angle, self._ratio
        np.multiply(self._sine, self._sine, self._own_squares)
        np.sqrt(self._four_ones.dot(self._squares, length), length)
        np.arctan2(length, cosine, angle)
        np.divide(angle, length, ratio)
        np.multiply(self._sine, ratio, self._errors)
        if (
            angle.dot(angle) > _NEAR_HALF_TURN**2
        ):  # an angle near a half turn, where the sine has no direction left, or many errors
            self._half_turns(k)

    def _half_turns(self, k: int) -> None:
        """Directions of errors near 180°, from the symmetric part of the rotation; d borrows e's."""
        for i in np.flatnonzero(self._angle > _NEAR_HALF_TURN):
            link = i % self._links
            error = rotation_vector(self._problem.desired[k, link] @ self._rotation_3x3[link].T)
            if i >= self._links:
                if np.linalg.norm(self._sine[:, i]) > 1e-8:
                    continue
                bone = self._bone_now[:, link]
                across = error - (error @ bone) * bone
                length = np.linalg.norm(across)
                error = across * (self._angle[i] / length) if length > 1e-8 else self._angle[i] * _perpendicular(bone)
            self._errors[:, i] = error

    def _gauss_newton(self, pivot: Array) -> None:
        """g = -Jᵀb and H = JᵀWJ in Gram form from `_errors`, twist free about `pivot` (3, L). Fills `_pulls` (3, c): b summed over what a column moves."""
        axes, hessian = self._axes, self.hessian
        self._errors.dot(self._weighted_moves, self._pulls)
        np.multiply(axes, self._pulls, self._product)
        self._minus_ones.dot(self._product, self.gradient)
        axes.T.dot(self._axes_again, hessian)
        hessian *= self._coupling
        if len(self._sliding):
            hessian[self._sliding, self._sliding] = self._diagonal[self._sliding]
        if self._has_twist:
            rows = pivot.T.dot(axes)
            rows *= self._twist_moves
            hessian -= rows.T.dot(rows, self._square)

    def _add_second_order(self, toward: Array) -> None:
        """The Hessian's terms in θ² and φ²; `toward` (3, L): d × u."""
        links, weight = self._links, self._part_weight
        # Where an angle vanishes so do e and t, and whatever finite factor they get.
        squared = self._angle * self._angle + 1e-30
        kappa = 0.5 * self._ratio[:links] * (2.0 + self._cosine[:links])
        lost = weight[:links] * (1.0 - kappa)
        factor = lost / squared[:links]
        directions, moves = self._errors[:, :links], self._moves
        if self._has_twist:
            across = 1.0 - self._ratio[links:] * self._cosine[links:] - 0.25 * squared[links:]
            factor = np.concatenate([factor, -weight[links:] * across / squared[links:]])
            directions, moves = np.concatenate([directions, toward], axis=1), np.concatenate([moves, moves])
        rows = directions.T.dot(self._axes) * moves
        self.hessian += rows.T @ (factor[:, None] * rows)
        self.hessian -= self._axes.T.dot(self._axes) * ((self._moves.T * lost) @ self._moves)


def measuring_matrices(problem: OrientationProblem, frames: slice) -> Array:
    """(T, L or 2L, 4, 10): what the errors of those frames are made of is linear in (R, 1), R a link's present rotation row by row.

    The first L matrices give 2 sin θ · axis and 2 cos θ = trace(R* Rᵀ) - 1 of e; where any twist counts less, L more give u × u* and u · u* of d.
    """
    desired = problem.desired[frames]
    count, links = desired.shape[:2]
    twist = bool(problem.twist_loss.any())
    matrices = np.zeros((count, links * (2 if twist else 1), 4, 10))
    matrices[:, :links, 3, 9] = -1.0
    of_e = _as_3x3(matrices[:, :links])
    of_e[:, :, 3] = desired
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):  # entry (k, j) less entry (j, k) of R* Rᵀ
        of_e[:, :, i, j] = desired[:, :, k]
        of_e[:, :, i, k] = -desired[:, :, j]
    if twist:
        aim = problem.desired_bone[frames][..., None] * problem.bone[:, None, :]  # (T, L, 3, 3) u* uᵀ
        of_d = _as_3x3(matrices[:, links:])
        of_d[:, :, 3] = aim
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            of_d[:, :, i, j] = aim[:, :, k]
            of_d[:, :, i, k] = -aim[:, :, j]
    return matrices


def _as_3x3(matrices: Array) -> Array:
    """View (…, 3, 3) of the first nine columns of (…, 10)."""
    *strides, last = matrices.strides
    return as_strided(matrices, (*matrices.shape[:-1], 3, 3), (*strides, 3 * last, last))


def rotation_vector(rotation: Array) -> Array:
    """Logarithm (3,) of one rotation matrix (3, 3), accurate at every angle: θ · axis, 0 ≤ θ ≤ π."""
    sine_axis = 0.5 * (rotation.ravel()[_UPPER] - rotation.ravel()[_LOWER])
    sine, cosine = float(np.linalg.norm(sine_axis)), 0.5 * (float(np.trace(rotation)) - 1.0)
    angle = float(np.arctan2(sine, cosine))
    if cosine > -0.9:
        return np.asarray(sine_axis * (angle / sine if sine > 0 else 1.0))
    # Near a half turn the axis comes from the symmetric part cos θ I + (1 - cos θ) axis axisᵀ, its sign from the antisymmetric one.
    outer = 0.5 * (rotation + rotation.T) - cosine * np.eye(3)
    column = outer[:, int(np.argmax(np.diag(outer)))]
    axis = column / np.linalg.norm(column)
    return np.asarray(angle * (axis if axis @ sine_axis >= 0 else -axis))


def _cross(a: Array, b: Array) -> Array:
    """Column-wise cross products of (3, N) arrays: a tenth of `np.cross`'s time."""
    product: Array = a.take(_YZX, 0) * b.take(_ZXY, 0)
    product -= a.take(_ZXY, 0) * b.take(_YZX, 0)
    return product


def _perpendicular(direction: Array) -> Array:
    """Some unit vector (3,) at right angles to `direction`."""
    across = np.cross(direction, np.eye(3)[int(np.argmin(np.abs(direction)))])
    return np.asarray(across / np.linalg.norm(across))


def _flat_jacobian(data: object, columns: int) -> tuple[Array, NDArray[np.intp]]:
    """pinocchio's Jacobian (6, nv) as flat memory, and the places in it of the world axes of the last `columns`, twice: (6, columns)."""
    jacobian: Array = data.J  # type: ignore[attr-defined]  # pinocchio has no type stubs
    first = jacobian.shape[1] - columns
    flat = jacobian.T.reshape(-1)
    if not np.shares_memory(flat, jacobian):
        raise RuntimeError("pinocchio no longer keeps its Jacobian column by column")
    return flat, np.array([[6 * (first + c) + 3 + i for c in range(columns)] for i in (0, 1, 2, 0, 1, 2)])


def _flat_placements(data: object, joint_ids: NDArray[np.intp]) -> tuple[Array, NDArray[np.intp]]:
    """pinocchio's joint placements as flat memory, and the places in it of (R, 1), (L, 10), of `joint_ids`.

    They lie in one vector of (rotation column by column, translation): one `take` instead of a call per link. The first of them is the
    world's own, whose first entry is always 1.
    """
    placements = data.oMi  # type: ignore[attr-defined]  # pinocchio has no type stubs
    one = placements[0].rotation
    stride = (placements[1].rotation.ctypes.data - one.ctypes.data) // one.itemsize
    flat = as_strided(one, shape=(stride * len(placements),), strides=(one.itemsize,), writeable=False)
    entries = [3 * column + row for row in range(3) for column in range(3)]
    index = np.array([[*(stride * joint + entry for entry in entries), 0] for joint in joint_ids])
    for places, joint in zip(index, joint_ids, strict=True):
        if not np.array_equal(flat[places], [*placements[int(joint)].rotation.ravel(), 1.0]):
            raise RuntimeError("pinocchio no longer keeps joint placements in one block of memory")
    return flat, index
