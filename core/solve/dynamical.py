"""Dynamical inverse kinematics [Darvish2019 eqs 3–5]: follow every link's orientation, one box QP a step.

Offline (default) every frame is iterated to convergence: each inner step solves

    min_δ  ½ Σᵢ ‖Jᵢ δ − log(R*ᵢ Rᵢᵀ)‖²_{Wᵢ} + ½ ρ ‖s + δ_s − s_ref‖² + ½ μ ‖δ‖²   s.t.  reach of the previous frame, coupled rows

that is eq. 5 with gain 1/dt, repeated until δ is small: no lag is left for the feed-forward to make up. The posture term ρ, not the path
taken, decides what the targets leave open, so the same pose gives the same joints wherever a clip was cut. Online keeps the paper's one QP
per frame: ω* − K e as desired velocity, λ ‖ν‖² as regularisation, limits fading out by tanh.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from retarget.core import rotations
from retarget.core.errors import SolverError
from retarget.core.solve.box_qp import BoxQp
from retarget.core.solve.limits import ROW_MARGIN_RAD, damped_velocity_bounds, nearest_feasible, reachable
from retarget.core.solve.normal_equations import cost, gram, rotation_errors
from retarget.core.solve.problem import OrientationProblem
from retarget.core.types import FRAME_MARKED, FRAME_OK, Array

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class DynamicalOptions:
    """posture_weight ρ and step_damping μ stand beside task weights of about 1. tolerance: the step (rad) at which a frame is converged.

    gain K (1/s) and damping λ are for `online` only; the authors used 10 and 1 at 50 Hz [Darvish2019, their code], which attenuates.
    """

    online: bool = False
    posture_weight: float = 1e-4
    step_damping: float = 1e-6
    tolerance: float = 1e-7
    max_iterations: int = 60
    max_step_rad: float = 0.5
    starts: int = 16
    gain: float = 10.0
    damping: float = 1e-3


@dataclass(frozen=True)
class Solution:
    """joints (T, n) rad; base_orientation (T, 4) wxyz world ← base link, or None; status (T,); iterations (T,) QPs per frame.

    start: which of the first frame's starts was the best (0 = the reference posture). fallbacks: QPs solved by the fallback solver.
    """

    joints: Array
    base_orientation: Array | None
    status: NDArray[np.int8]
    iterations: NDArray[np.int64]
    start: int
    fallbacks: int


def solve(problem: OrientationProblem, options: DynamicalOptions, progress: Progress | None = None) -> Solution:
    """Joint motion that follows the problem's targets inside all limits.

    Frames on which the QP fails hold the last good posture and are marked in `status`. Raises `SolverError` only when nothing can start.
    """
    solver = _Solver(problem, options)
    frames, n = len(problem.time), len(problem.lower)
    joints, base = np.zeros((frames, n)), np.zeros((frames, 4))
    status, iterations = np.zeros(frames, np.int8), np.zeros(frames, np.int64)
    start, iterations[0] = solver.start()
    joints[0], base[0] = solver.joints, solver.base_orientation
    for k in range(1, frames):
        step_s = float(problem.time[k] - problem.time[k - 1])
        before = solver.q.copy()
        try:
            if options.online:
                iterations[k] = solver.online_step(k, step_s)
            else:
                guess = 2 * joints[k - 1] - joints[k - 2] if k > 1 else joints[0]
                iterations[k] = solver.converge(k, *solver.reach(joints[k - 1], step_s), guess=guess)
            status[k] = FRAME_OK
        except SolverError:
            solver.q = before
            status[k] = FRAME_MARKED
        joints[k], base[k] = solver.joints, solver.base_orientation
        if progress is not None and k % 256 == 0:
            progress(k, frames)
    orientation = rotations.make_continuous(base) if problem.base_columns else None
    return Solution(joints, orientation, status, iterations, start, solver.qp.fallbacks)


class _Solver:
    """State and work space of one clip. `q` is pinocchio's configuration."""

    def __init__(self, problem: OrientationProblem, options: DynamicalOptions) -> None:
        import pinocchio as pin

        self.problem, self.options = problem, options
        self.pin, self.model = pin, problem.model.pin_model
        self.data = self.model.createData()
        self.n, self.base_columns = len(problem.lower), problem.base_columns
        self.first = self.model.nv - problem.columns  # columns of pinocchio's velocity that are not solved for
        self.q = problem.model.configuration(problem.reference)
        pin.computeJointJacobians(self.model, self.data, self.q)
        # Views into pinocchio's own memory: fetching `oMi[i].rotation` anew costs 1 µs a link.
        self.rotations = [self.data.oMi[int(i)].rotation for i in problem.joint_ids]
        self.qp = BoxQp(problem.columns)
        self.has_twist = bool(problem.twist_loss.any())

    @property
    def joints(self) -> Array:
        return np.array(self.q[-self.n :])

    @property
    def base_orientation(self) -> Array:
        return np.roll(self.q[3:7], 1) if self.base_columns else np.array([1.0, 0.0, 0.0, 0.0])

    def reach(self, previous: Array, step_s: float) -> tuple[Array, Array]:
        p = self.problem
        return reachable(previous, p.lower, p.upper, p.velocity, step_s)

    def linearise(self, k: int, gain: float | None = None) -> tuple[Array, Array, Array, Array]:
        """H, g of the task terms at the present posture, the errors (L, 3) and the bones (L, 3), world.

        Without `gain` the unknown is a step and the errors are what it should make up; with it, a velocity: ω* + gain · error.
        """
        p = self.problem
        self.pin.computeJointJacobians(self.model, self.data, self.q)
        current = np.array(self.rotations)
        errors = rotation_errors(p.desired[k], current)
        bones = np.einsum("lij,lj->li", current, p.bone)
        desired = errors if gain is None else gain * errors + p.feed_forward[k]
        hessian, gradient = gram(self.data.J[3:, self.first :], p.moves, p.weight[k], desired, bones, p.twist_loss)
        return hessian, gradient, errors, bones

    def converge(self, k: int, lower: Array, upper: Array, guess: Array | None = None) -> int:
        """Iterate frame k to convergence with joints kept in [lower, upper]; the number of QPs it took. Raises `SolverError`."""
        options, b = self.options, self.base_columns
        if guess is not None:
            self.q[-self.n :] = self._feasible_guess(guess, lower, upper)
        for iteration in range(1, options.max_iterations + 1):
            hessian, gradient, _, _ = self.linearise(k)
            posture = self.q[-self.n :] - self.problem.reference
            hessian[np.diag_indices_from(hessian)] += options.step_damping
            hessian[np.arange(b, len(hessian)), np.arange(b, len(hessian))] += options.posture_weight
            gradient[b:] += options.posture_weight * posture
            low = np.full(len(gradient), -options.max_step_rad)
            high = np.full(len(gradient), options.max_step_rad)
            np.maximum(low[b:], lower - self.q[-self.n :], out=low[b:])
            np.minimum(high[b:], upper - self.q[-self.n :], out=high[b:])
            step = self._step(hessian, gradient, low, high)
            self._advance(step, lower, upper)
            if np.abs(step).max() < options.tolerance:
                break
        return iteration

    def online_step(self, k: int, step_s: float) -> int:
        """One QP in velocities [Darvish2019 eq. 5], integrated over `step_s`."""
        p, options, b = self.problem, self.options, self.base_columns
        hessian, gradient, _, _ = self.linearise(k, gain=min(options.gain, 1.0 / step_s))
        hessian[np.diag_indices_from(hessian)] += options.damping
        low = np.full(len(gradient), -1e3)
        high = np.full(len(gradient), 1e3)
        low[b:], high[b:] = damped_velocity_bounds(self.joints, p.lower, p.upper, p.velocity, step_s)
        velocity = self._step(hessian, gradient, low, high, rows_scale=step_s)
        self._advance(velocity * step_s, *self.reach(self.joints, step_s))
        return 1

    def start(self) -> tuple[int, int]:
        """Converge the first frame from several postures, keep the best; its number and the QPs it took."""
        p = self.problem
        generator = np.random.default_rng(0)  # the same starts in every run: part of the recorded input
        postures = [
            p.reference,
            np.zeros(self.n),
            0.5 * (np.maximum(p.lower, -np.pi) + np.minimum(p.upper, np.pi)),
        ]
        spread = np.minimum(p.upper, np.pi) - np.maximum(p.lower, -np.pi)
        while len(postures) < self.options.starts:
            postures.append(np.maximum(p.lower, -np.pi) + spread * generator.random(self.n))
        best: tuple[float, int, Array, int] | None = None
        for number, posture in enumerate(postures):
            self.q = self._first_configuration(nearest_feasible(posture, p.lower, p.upper, p.coupled))
            try:
                count = self.converge(0, p.lower, p.upper)
            except SolverError:
                continue
            value = self.cost(0)
            # A later start must be clearly better: equal basins must not be decided by rounding.
            if best is None or value < best[0] - 1e-6:
                best = (value, number, self.q.copy(), count)
        if best is None:
            raise SolverError("the first frame can't be solved from any start")
        self.q = best[2]
        return best[1], best[3]

    def cost(self, k: int) -> float:
        """½ Σ ‖e‖²_W + ½ ρ ‖s − s_ref‖² of frame k at the present posture."""
        _, _, errors, bones = self.linearise(k)
        p = self.problem
        posture = self.q[-self.n :] - p.reference
        return cost(errors, p.weight[k], bones, p.twist_loss) + 0.5 * self.options.posture_weight * float(
            posture @ posture
        )

    def _first_configuration(self, joints: Array) -> Array:
        """Base turned to the pelvis target where there is one, else upright."""
        p = self.problem
        q = p.model.configuration(joints)
        root = np.flatnonzero(p.joint_ids == 1)
        if self.base_columns and len(root):
            q[3:7] = np.roll(rotations.from_matrix(p.desired[0, root[0]]), -1)
        return np.asarray(q)

    def _feasible_guess(self, guess: Array, lower: Array, upper: Array) -> Array:
        inside = np.minimum(np.maximum(guess, lower), upper)
        if self.problem.coupled is None:
            return inside
        matrix, rows_lower, rows_upper = self.problem.coupled
        value = matrix @ inside
        return inside if (value >= rows_lower).all() and (value <= rows_upper).all() else self.joints

    def _step(self, hessian: Array, gradient: Array, low: Array, high: Array, rows_scale: float = 1.0) -> Array:
        step = self.qp.solve(hessian, gradient, low, high)
        if self.problem.coupled is None:
            return step
        matrix, rows_lower, rows_upper = self.problem.coupled
        value = matrix @ self.q[-self.n :]
        room_low = np.minimum(rows_lower + ROW_MARGIN_RAD - value, 0.0) / rows_scale
        room_high = np.maximum(rows_upper - ROW_MARGIN_RAD - value, 0.0) / rows_scale
        moved = matrix @ step[self.base_columns :]
        if (moved >= room_low).all() and (moved <= room_high).all():
            return step  # the optimum of the relaxed problem is feasible, so it is the optimum
        rows = np.hstack([np.zeros((len(matrix), self.base_columns)), matrix])
        return self.qp.solve_with_rows(hessian, gradient, low, high, rows, room_low, room_high)

    def _advance(self, step: Array, lower: Array, upper: Array) -> None:
        full = np.zeros(self.model.nv)
        full[self.first :] = step
        self.q = self.pin.integrate(self.model, self.q, full)
        # Integration rounds: the written file must hold the limits to the last bit.
        self.q[-self.n :] = np.minimum(np.maximum(self.q[-self.n :], lower), upper)
