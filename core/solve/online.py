"""The paper's own loop [Darvish2019 eqs 3–5]: one QP a frame in velocities, then integrate.

    min_ν  ½ Σ ‖Jᵢ ν - (ω*ᵢ + K eᵢ)‖²_{Wᵢ} + ½ λ ‖ν‖²   s.t.  limits that fade out by tanh, coupled rows

A robot that gets targets one by one can do no more; what it lags behind is what the offline solver iterates away.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from retarget.core.errors import SolverError
from retarget.core.solve.box_qp import BoxQp
from retarget.core.solve.limits import CoupledRows, DampedVelocityBounds
from retarget.core.solve.newton import Path
from retarget.core.solve.normal_equations import NormalEquations
from retarget.core.solve.problem import OrientationProblem
from retarget.core.types import FRAME_MARKED, Array


@dataclass(frozen=True)
class OnlineOptions:
    """gain K (1/s), at most one over the time step; damping λ beside task weights of about 1.

    The authors used 10 and 1 at 50 Hz [Darvish2019, their code], which attenuates.
    """

    gain: float = 10.0
    damping: float = 1e-3


class OnlineSolver:
    """One QP per frame, with its work space. Not thread-safe."""

    def __init__(self, problem: OrientationProblem, options: OnlineOptions) -> None:
        import pinocchio as pin

        self.problem, self.options = problem, options
        self.qp = BoxQp(problem.columns, warm=True)
        self._coupled = None if problem.coupled is None else CoupledRows(problem.base_columns, *problem.coupled)
        self._bounds = DampedVelocityBounds(problem.base_columns, problem.lower, problem.upper, problem.velocity)
        self._integrate, self._model = pin.integrate, problem.model.pin_model
        self._equations = NormalEquations(problem, np.full(problem.columns, options.damping))
        self._joints = len(problem.lower)
        self._full_step = np.zeros(self._model.nv)
        self._own_step = self._full_step[-problem.columns :]

    def step(self, k: int, q: Array, step_s: float) -> Array:
        """Configuration `step_s` seconds after `q`, moved by the velocities that frame k asks for. Raises `SolverError` when the QP fails."""
        p = self.problem
        self._equations.linearise_velocity(k, q, min(self.options.gain, 1.0 / step_s))
        joints = q[-self._joints :]
        self._bounds.update(joints, step_s)
        np.multiply(self._velocity(joints, step_s), step_s, self._own_step)
        after: Array = self._integrate(self._model, q, self._full_step)
        joints = after[-self._joints :]
        # Integration rounds: the written file must hold the limits to the last bit.
        np.minimum(joints, p.upper, joints)
        np.maximum(joints, p.lower, joints)
        return after

    def follow(self, path: Path, first: int, last: int) -> None:
        """One QP for every frame after `first` up to `last`: what the frame before asks for leads to it [explicit Euler].

        Frames on which it fails hold the posture before and are marked.
        """
        q, times = path.q[first], self.problem.time.tolist()
        for k in range(first + 1, last + 1):
            try:
                q = self.step(k - 1, q, times[k] - times[k - 1])
            except SolverError:
                path.status[k] = FRAME_MARKED
            path.q[k] = q
        path.iterations[first + 1 : last + 1] = 1

    def _velocity(self, joints: Array, step_s: float) -> Array:
        problem = (self._equations.hessian, self._equations.gradient, self._bounds.low, self._bounds.high)
        if self._coupled is None:
            velocity = self.qp.solve(*problem)
        else:
            room = (bound / step_s for bound in self._coupled.room(joints))
            velocity = self.qp.solve_coupled(*problem, self._coupled.rows, *room)
        if velocity is None:
            raise SolverError("the online QP has no solution")
        return velocity
