"""H and g of the orientation least squares ½ Σᵢ ‖Jᵢ δ − bᵢ‖²_{Wᵢ} [Darvish2019 eqs 3–5], in two forms.

Wᵢ = wᵢ (I − lossᵢ uᵢuᵢᵀ) with uᵢ the link's bone direction in the world: a rotation about the bone may count less than one across it.

Gram form: column j of link i's angular Jacobian is the joint axis a_j where j moves i, else 0. With A the matrix of all axes (3, c) and
C = Sᵀ diag(w) S (S: which column moves which link), H = (AᵀA)∘C less one rank-one term per link with a bone. No Jacobian per link.
Stacked form: the Jacobians written out, JᵀWJ; slower, the oracle.
"""

from __future__ import annotations

import numpy as np
from retarget.core.types import Array


def rotation_errors(desired: Array, current: Array) -> Array:
    """World rotation vectors (L, 3) that take `current` to `desired` (L, 3, 3): the logarithm, not its sine, so that half turns pull too.

    [Darvish2019 eq. 4a] uses vee(sk(·)) = sin θ · axis, which vanishes at 180°.
    """
    difference = np.matmul(desired, current.transpose(0, 2, 1)).reshape(-1, 9)
    sine_axis = 0.5 * (difference[:, [7, 2, 3]] - difference[:, [5, 6, 1]])
    sine = np.sqrt(np.einsum("li,li->l", sine_axis, sine_axis))
    cosine = 0.5 * (difference[:, 0] + difference[:, 4] + difference[:, 8] - 1.0)
    if cosine.min() < -0.99:
        return _errors_near_half_turn(difference, sine_axis, sine, cosine)
    angle = np.arctan2(sine, cosine)
    return np.asarray(
        sine_axis * (angle / np.maximum(sine, 1e-300))[:, None] if sine.min() > 1e-9 else _small(sine_axis, sine, angle)
    )


def _small(sine_axis: Array, sine: Array, angle: Array) -> Array:
    return np.asarray(sine_axis * np.where(sine > 1e-9, angle / np.maximum(sine, 1e-9), 1.0)[:, None])


def _errors_near_half_turn(difference: Array, sine_axis: Array, sine: Array, cosine: Array) -> Array:
    """Near 180° the axis comes from the symmetric part, its sign from the antisymmetric one."""
    angle = np.arctan2(sine, cosine)
    errors = _small(sine_axis, sine, angle)
    for i in np.flatnonzero(cosine < -0.99):
        symmetric = 0.5 * (difference[i].reshape(3, 3) + difference[i].reshape(3, 3).T)
        outer = (symmetric - cosine[i] * np.eye(3)) / (1.0 - cosine[i])
        column = int(np.argmax(np.diag(outer)))
        axis = outer[:, column] / np.linalg.norm(outer[:, column])
        errors[i] = angle[i] * (axis if axis @ sine_axis[i] >= 0 else -axis)
    return errors


def gram(
    axes: Array, moves: Array, weight: Array, desired_step: Array, bones: Array, twist_loss: Array
) -> tuple[Array, Array]:
    """H (c, c) and g (c,) by the Gram form.

    axes: (3, c) world rotation axis of every column. moves: (L, c). weight, twist_loss: (L,). desired_step: (L, 3) world, b.
    bones: (L, 3) unit, world.
    """
    hessian = (axes.T @ axes) * ((moves.T * weight) @ moves)
    along = np.einsum("li,li->l", bones, desired_step)
    weighted = weight[:, None] * (desired_step - (twist_loss * along)[:, None] * bones)
    gradient = -np.einsum("ic,ic->c", axes, weighted.T @ moves)
    if twist_loss.any():
        rows = (bones @ axes) * moves * np.sqrt(weight * twist_loss)[:, None]
        hessian -= rows.T @ rows
    return hessian, gradient


def stacked(
    axes: Array, moves: Array, weight: Array, desired_step: Array, bones: Array, twist_loss: Array
) -> tuple[Array, Array]:
    """The same H and g from the Jacobians written out, one (3, c) block per link: the oracle of `gram`."""
    columns = axes.shape[1]
    hessian, gradient = np.zeros((columns, columns)), np.zeros(columns)
    for link in range(len(moves)):
        jacobian = axes * moves[link]
        metric = weight[link] * (np.eye(3) - twist_loss[link] * np.outer(bones[link], bones[link]))
        hessian += jacobian.T @ metric @ jacobian
        gradient -= jacobian.T @ metric @ desired_step[link]
    return hessian, gradient


def cost(errors: Array, weight: Array, bones: Array, twist_loss: Array) -> float:
    """½ Σ ‖e‖²_W of errors (L, 3), world: what the converged solver minimises, less the posture term."""
    along = np.einsum("li,li->l", bones, errors)
    return float(0.5 * np.sum(weight * (np.einsum("li,li->l", errors, errors) - twist_loss * along**2)))
