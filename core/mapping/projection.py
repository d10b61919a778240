"""The nearest point of a small polytope, exactly: a quadratic programme of three variables, solved by listing its vertices, edges
and faces.

For a strictly convex quadratic programme the answer is the minimum over one of the polytope's faces, and with three variables and
six two-sided rows there are at most 233 of these. What each takes depends only on the metric and the rows, so it is computed
once, and a solution is two small matrix products: as fast as an iterative solver, and without its tolerance.
"""

from __future__ import annotations

from itertools import combinations, product

import numpy as np
from retarget.core.types import Array

FEASIBLE = 1e-10
"""A candidate may be outside a bound by this much, relative to the size of its terms: rounding."""
DEPENDENT = 1e-10
"""Rows whose Gram determinant, lengths set to one, is below this are parallel or lie in one plane: other candidates cover them."""


class Projection:
    """argmin over x of (x - x0)ᵀ metric (x - x0) subject to lower ≤ rows · x ≤ upper, for changing x0, lower and upper.

    metric: (n, n), positive definite. rows: (m, n). n and m small: the number of candidates grows as mⁿ.
    """

    def __init__(self, metric: Array, rows: Array) -> None:
        count, size = rows.shape
        inverse = np.linalg.inv(metric)
        gram = rows @ inverse @ rows.T
        scale = np.sqrt(np.diag(gram))
        moves = [np.zeros((size, 2 * count))]
        for length in range(1, size + 1):
            for chosen in combinations(range(count), length):
                block = gram[np.ix_(chosen, chosen)]
                if np.linalg.det(block / np.outer(scale[list(chosen)], scale[list(chosen)])) < DEPENDENT:
                    continue
                gains = inverse @ rows[list(chosen)].T @ np.linalg.inv(block)
                for at_lower in product((0, 1), repeat=length):
                    move = np.zeros((size, 2 * count))
                    for column, row, low in zip(range(length), chosen, at_lower, strict=True):
                        move[:, row + low * count] = gains[:, column]
                    moves.append(move)
        self._rows = rows
        self._size = size
        self._moves = np.stack(moves)
        self._steps = self._moves.reshape(-1, 2 * count)
        self._metric = metric

    def nearest(self, start: Array, lower: Array, upper: Array) -> Array:
        """x (n,) for x0 = `start` (n,); lower, upper: (m,), finite, with a point between them."""
        value = self._rows @ start
        if (value <= upper).all() and (value >= lower).all():
            return start
        moves = (self._steps @ np.concatenate([upper - value, lower - value])).reshape(-1, self._size)
        reached = value + moves @ self._rows.T
        slack = FEASIBLE * (1.0 + np.abs(value).max())
        outside = np.maximum(reached - upper, lower - reached).max(axis=1)
        cost = np.einsum("ci,ij,cj->c", moves, self._metric, moves)
        cost[outside > max(slack, float(outside.min()))] = np.inf
        return np.asarray(start + moves[int(np.argmin(cost))])
