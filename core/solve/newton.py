"""One frame solved to convergence: projected Newton steps on the orientation cost, inside the joints' reach.

Minimised over the base's rotation and the joint values s, with f the tasks' cost (`normal_equations`), ρ the posture weight and h the
frame's own stiffnesses (`calm`; mostly none):

    F = f + ½ ρ ‖s - s_ref‖² + ½ Σ h (s - s_hold)²   s.t.  lower ≤ s ≤ upper,  rows_lower ≤ rows · s ≤ rows_upper

Every step is a box QP with F's gradient and Hessian: eq. 5 of [Darvish2019] with gain 1/dt, repeated until nothing is left of the lag that
the feed-forward would have to make up. The posture term, not the path taken, decides what the targets leave open, so the same
pose gives the same joints wherever a clip was cut.

Far from an answer the Hessian may be indefinite, or a step may overshoot: then it is damped (Levenberg-Marquardt) until the cost falls. Where
the cost has a ridge (a symmetric posture that has to bend to one side), the steps vanish on top of it: one step along the
direction of negative curvature, to the side that a fixed rule names, leads down.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from retarget.core.errors import SolverError
from retarget.core.profile import DEFAULT_POSTURE_WEIGHT
from retarget.core.solve.box_qp import BoxQp
from retarget.core.solve.limits import CoupledRows, reachable
from retarget.core.solve.normal_equations import NormalEquations
from retarget.core.solve.problem import OrientationProblem
from retarget.core.types import FRAME_MARKED, FRAME_OK, Array

FIRST_DAMPING, DAMPING_FACTOR, LARGEST_DAMPING = 1e-3, 8.0, 1e6
RIDGE_STEP_RAD, MOST_RIDGES = 0.05, 3
COST_ROUNDING = 1e-12
QP_SCALE = 1e6
"""Steps are solved in millionths of a radian: frames converge far below the QP solver's own stop."""


@dataclass(frozen=True)
class NewtonOptions:
    """posture_weight ρ stands beside task weights of about 1. tolerance: the error (rad) estimated to be left when a frame is done.

    max_step_rad: largest change of one variable in one step. max_iterations: QPs after which a frame is left as it is, unconverged.
    """

    posture_weight: float = DEFAULT_POSTURE_WEIGHT
    tolerance: float = 1e-10
    max_step_rad: float = 0.5
    max_iterations: int = 100


@dataclass(frozen=True)
class Converged:
    """q: pinocchio configuration. cost: F there, to second order. iterations: QPs it took. done: whether `tolerance` was reached."""

    q: Array
    cost: float
    iterations: int
    done: bool


@dataclass(frozen=True, eq=False)
class Path:
    """Solved frames, written as they are found. q (T, nq) configurations, cost (T,) F, iterations (T,) QPs, 0 where not solved, status (T,).

    unconverged (T,): whether the iterations ran out.
    """

    q: Array
    cost: Array
    iterations: NDArray[np.int64]
    status: NDArray[np.int8]
    unconverged: NDArray[np.bool_]

    @classmethod
    def empty(cls, frames: int, size: int) -> Path:
        """A path of which no frame is solved yet."""
        return cls(
            np.zeros((frames, size)),
            np.full(frames, np.inf),
            np.zeros(frames, np.int64),
            np.full(frames, FRAME_OK, np.int8),
            np.zeros(frames, bool),
        )

    def put(self, k: int, found: Converged) -> None:
        """Write frame k."""
        self.q[k], self.cost[k], self.iterations[k] = found.q, found.cost, found.iterations
        self.status[k], self.unconverged[k] = FRAME_OK, not found.done


class FrameSolver:
    """Newton's method for the frames of one problem, with its work space. Not thread-safe."""

    def __init__(self, problem: OrientationProblem, options: NewtonOptions) -> None:
        import pinocchio as pin

        self.problem, self.options = problem, options
        self.qp = BoxQp(problem.columns, QP_SCALE)
        self._pin, self._model = pin, problem.model.pin_model
        self._base, self._joints = problem.base_columns, len(problem.lower)
        self._coupled = None if problem.coupled is None else CoupledRows(problem.base_columns, *problem.coupled)
        self._equations = NormalEquations(problem, np.repeat([0.0, options.posture_weight], [self._base, self._joints]))
        self._damped = np.empty_like(self._equations.hessian)
        self._low = np.full(problem.columns, -options.max_step_rad)
        self._high = np.full(problem.columns, options.max_step_rad)
        self._full_step = np.zeros(self._model.nv)

    def converge(self, k: int, q: Array, lower: Array, upper: Array) -> Converged:
        """Frame k solved from configuration `q` with the joints kept in [lower, upper], rad. Raises `SolverError` when a QP fails.

        `q` must satisfy the coupled rows; its joints are clipped into the bounds.
        """
        options, n = self.options, self._joints
        q = q.copy()
        q[-n:] = np.minimum(np.maximum(q[-n:], lower), upper)
        damping, last_damping, last_size, before, cost_before, ridges = 0.0, 0.0, np.inf, q, np.inf, 0
        for iteration in range(1, options.max_iterations + 1):
            cost = self._linearise(k, q)
            if (
                cost > cost_before * (1.0 + COST_ROUNDING) + 1e-15
            ):  # the step overshot: from where it came, a shorter one
                q, damping = before, max(DAMPING_FACTOR * damping, FIRST_DAMPING)
                cost = self._linearise(k, q)
            elif damping > 0.0:
                damping = damping / DAMPING_FACTOR if damping > FIRST_DAMPING else 0.0
            step, damping = self._damped_step(q, lower, upper, damping)
            before, cost_before = q, cost
            q = self._advance(q, step, lower, upper)
            size = max(float(step.max()), -float(step.min()))
            # A step that is shorter because it is damped more says nothing about what is left.
            comparable = damping == 0.0 or (damping <= last_damping and last_size < np.inf)
            if comparable and remaining(size, last_size) <= options.tolerance:
                down = self._way_down(before, lower, upper) if damping > 0.0 and ridges < MOST_RIDGES else None
                if down is None:
                    return Converged(q, self._cost_after(cost, step), iteration, True)
                q, cost_before, size, ridges = down, np.inf, np.inf, ridges + 1
            last_size, last_damping = size, damping
        return Converged(q, self._cost_after(cost, step), options.max_iterations, False)

    def follow(self, path: Path, first: int, last: int, below: Array | None = None) -> int:
        """Solve the frames after `first` up to `last`, forward or backward, each within reach of the one before; the last one written.

        Frames on which the QP fails hold the posture before and are marked. With `below` (T,) it stops before the first frame
        that is marked or whose cost is not below.
        """
        direction = 1 if last >= first else -1
        for k in range(first + direction, last + direction, direction):
            if not self._follow_one(path, k, direction, below):
                return k - direction
        return last

    def _follow_one(self, path: Path, k: int, direction: int, below: Array | None) -> bool:
        """Solve frame k within reach of frame k - direction; whether it was written."""
        problem, n = self.problem, self._joints
        before = path.q[k - direction]
        step_s = abs(float(problem.time[k] - problem.time[k - direction]))
        lower, upper = reachable(before[-n:], problem.lower, problem.upper, problem.velocity, step_s)
        try:
            found = self.converge(k, self._guess(path, k, direction, lower, upper), lower, upper)
        except SolverError:
            found = None
        if below is not None and (found is None or not found.cost < below[k]):
            return False
        if found is not None:
            path.put(k, found)
        else:
            path.q[k], path.cost[k], path.status[k] = before, self.cost(k, before), FRAME_MARKED
        return True

    def cost(self, k: int, q: Array) -> float:
        """F of frame k at configuration `q`."""
        return self._linearise(k, q)

    def _guess(self, path: Path, k: int, direction: int, lower: Array, upper: Array) -> Array:
        """The motion of the two frames before continued; the frame before where that breaks a coupled row or only one is solved."""
        before: Array = path.q[k - direction]
        if not (0 <= k - 2 * direction < len(path.q) and path.cost[k - 2 * direction] < np.inf):
            return before
        change = self._pin.difference(self._model, path.q[k - 2 * direction], before)
        guess: Array = self._pin.integrate(self._model, before, change)
        joints = guess[-self._joints :]
        np.minimum(joints, upper, out=joints)
        np.maximum(joints, lower, out=joints)
        return guess if self._coupled is None or self._coupled.hold(joints) else before

    def _linearise(self, k: int, q: Array) -> float:
        cost = self._equations.linearise(k, q)
        weight, b = self.options.posture_weight, self._base
        away = q[-self._joints :] - self.problem.reference
        cost += 0.5 * weight * float(away.dot(away))
        away *= weight
        self._equations.gradient[b:] += away
        if self.problem.hold is not None:
            stiffness, away = self.problem.hold[0][k], q[-self._joints :] - self.problem.hold[1][k]
            cost += 0.5 * float(stiffness.dot(away * away))
            self._equations.gradient[b:] += stiffness * away
            columns = len(self._equations.gradient)
            self._equations.hessian.reshape(-1)[b * (columns + 1) :: columns + 1] += stiffness
        return cost

    def _cost_after(self, cost: float, step: Array) -> float:
        return cost + float(step @ (self._equations.gradient + 0.5 * (self._equations.hessian @ step)))

    def _damped_step(self, q: Array, lower: Array, upper: Array, damping: float) -> tuple[Array, float]:
        """A step that solves the QP with at least `damping` on H's diagonal, and the damping that it took."""
        options, b, joints = self.options, self._base, q[-self._joints :]
        low, high = self._low, self._high
        np.subtract(lower, joints, out=low[b:])
        np.maximum(low[b:], -options.max_step_rad, out=low[b:])
        np.subtract(upper, joints, out=high[b:])
        np.minimum(high[b:], options.max_step_rad, out=high[b:])
        hessian = self._equations.hessian
        while damping <= LARGEST_DAMPING:
            if damping > 0.0:
                np.copyto(self._damped, hessian)
                self._damped.reshape(-1)[:: len(self._damped) + 1] += damping
            # Damping comes cheaper than a thorough search, but only without it do steps end quadratically near.
            step = self._qp_step(self._damped if damping > 0.0 else hessian, joints, low, high, damping == 0.0)
            if step is not None:
                return step, damping
            damping = max(DAMPING_FACTOR * damping, FIRST_DAMPING)
        raise SolverError("no damping makes the QP convex")

    def _qp_step(self, hessian: Array, joints: Array, low: Array, high: Array, thorough: bool) -> Array | None:
        """The QP's solution, coupled rows included; None where H is not convex enough for it."""
        gradient = self._equations.gradient
        if self._coupled is None:
            return self.qp.solve(hessian, gradient, low, high, thorough=thorough)
        room = self._coupled.room(joints)
        return self.qp.solve_coupled(hessian, gradient, low, high, self._coupled.rows, *room, thorough=thorough)

    def _advance(self, q: Array, step: Array, lower: Array, upper: Array) -> Array:
        self._full_step[-len(step) :] = step
        after: Array = self._pin.integrate(self._model, q, self._full_step)
        joints = after[-self._joints :]
        # Integration rounds: the written file must hold the limits to the last bit.
        np.minimum(joints, upper, out=joints)
        np.maximum(joints, lower, out=joints)
        return after

    def _way_down(self, q: Array, lower: Array, upper: Array) -> Array | None:
        """Configuration beside the ridge on which `q` stands; None where the cost curves upward in every free direction."""
        b, joints, gradient = self._base, q[-self._joints :], self._equations.gradient
        held = np.zeros(len(gradient), bool)
        held[b:] = ((joints <= lower + 1e-9) & (gradient[b:] >= 0)) | ((joints >= upper - 1e-9) & (gradient[b:] <= 0))
        free = np.flatnonzero(~held)
        if not len(free):
            return None
        values, vectors = np.linalg.eigh(self._equations.hessian[np.ix_(free, free)])
        if values[0] > -1e-9:
            return None
        down = vectors[:, 0]
        # Mirror-symmetric postures have two equal ways down: the first of the leading entries is made positive, whatever rounding says.
        leading = np.flatnonzero(np.abs(down) > 0.9 * np.abs(down).max())[0]
        step = np.zeros(len(gradient))
        step[free] = down * (np.sign(down[leading]) * RIDGE_STEP_RAD / np.abs(down).max())
        after = self._advance(q, step, lower, upper)
        return after if self._coupled is None or self._coupled.hold(after[-self._joints :]) else None


def remaining(size: float, last_size: float) -> float:
    """Distance (rad) to the limit of steps that go on shrinking as the last two did: size · r / (1 - r), r = size / last_size.

    Without a last step (infinite) the size itself; infinite where steps grow.
    """
    if last_size == np.inf:
        return size
    ratio = size / last_size if last_size > 0.0 else 0.0
    return size * ratio / (1.0 - ratio) if ratio < 1.0 else np.inf
