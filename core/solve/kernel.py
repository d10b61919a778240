"""The frame solver's inner loops compiled by numba: the same steps as `newton`, on the robot's tree instead of on matrices.

Columns are numbered from the base outward: `parent[j] < j`. What a column moves is a subtree, so sums over links (of pulls b and metrics N)
are made once, from the tips to the base. With b_j and N_j the sums over what column j moves,

    H_kj = a_k · (N_j a_j + ½ b_j × a_j)   for k on the path from the base to j, 0 across branches

as the composite-rigid-body algorithm makes a mass matrix (½ b_j × a_j only between different joints). H = LᵀL starts at the tips and
fills in nothing [Featherstone 2005, Efficient factorization of the joint-space inertia matrix for branched kinematic trees]. The box QP
is solved by the primal-dual active set method; its answer satisfies the optimality conditions.

All in one file: numba's cache notices changes only in the file of the function that was called from outside.

Nothing out of the ordinary is handled here (no descent, an indefinite Hessian, an active set that cycles, a coupled row touched, a half
turn): the kernel stops before that frame.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from retarget.core.solve.jit import jit
from retarget.core.types import Array, BoolArray

IntArray = NDArray[np.int64]

HALF_TURN_RAD = 3.1
MOST_STEPS, MOST_SETS = 20, 25
FREE, LOW, HIGH = 0, 1, 2


class Tree(NamedTuple):
    """parent (c,): the column before on the way to the base, -1 for none. base: number of base columns.

    fixed (c, 3, 3): from the frame of the column before (`root` where there is none) to the joint's own at zero, both with the joint's
    axis as z. sliding (c,).
    """

    parent: IntArray
    base: int
    fixed: Array
    root: Array
    sliding: BoolArray


class Tasks(NamedTuple):
    """As in `OrientationProblem`. column (L,): the last one that moves the link, -1 for none; from_link (L, 3, 3): its frame ← the link's joint."""

    column: IntArray
    from_link: Array
    bone: Array
    desired: Array
    desired_bone: Array
    weight: Array
    twist_loss: Array


class Limits(NamedTuple):
    """lower, upper, velocity (n,). rows (m, n) with their bounds, drawn in by as much as makes them touched. max_step: of one variable, rad."""

    lower: Array
    upper: Array
    velocity: Array
    rows: Array
    rows_lower: Array
    rows_upper: Array
    max_step: float


class Posture(NamedTuple):
    """reference (n,) with its weight, and the frames' own pull: stiffness and held (P, n), P = T or 0 for none."""

    reference: Array
    weight: float
    stiffness: Array
    held: Array


class Work(NamedTuple):
    """Work space. turned (c, 3, 3), axes, pulls (c, 3), metrics (c, 6) symmetric: xx xy xz yy yz zz; hessian, factor (c, c); the rest (c,)."""

    turned: Array
    axes: Array
    pulls: Array
    metrics: Array
    hessian: Array
    factor: Array
    gradient: Array
    slope: Array
    step: Array
    low: Array
    high: Array
    held: IntArray


def work_space(columns: int) -> Work:
    """Work space for problems of that many columns."""
    c = columns
    shapes: list[tuple[int, ...]] = [(c, 3, 3), (c, 3), (c, 3), (c, 6), (c, c), (c, c), (c,), (c,), (c,), (c,), (c,)]
    return Work._make([*(np.zeros(shape) for shape in shapes), np.zeros(c, np.int64)])


@jit
def _place(tree: Tree, q: Array, work: Work) -> None:
    """World rotations and axes of all columns at configuration q."""
    turned, axes, fixed, base = work.turned, work.axes, tree.fixed, tree.base
    columns = len(tree.parent)
    if base:
        x, y, z, w = q[3], q[4], q[5], q[6]
        for column in range(base):
            r = turned[column]
            r[0, 0], r[0, 1], r[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)
            r[1, 0], r[1, 1], r[1, 2] = 2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)
            r[2, 0], r[2, 1], r[2, 2] = 2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)
            for i in range(3):
                axes[column, i] = r[i, column]
    first = len(q) - columns  # of column j in q, for joints
    for j in range(base, columns):
        before = turned[tree.parent[j]] if tree.parent[j] >= 0 else tree.root
        angle = 0.0 if tree.sliding[j] else q[first + j]
        cosine, sine = np.cos(angle), np.sin(angle)
        for i in range(3):
            b0, b1, b2 = before[i, 0], before[i, 1], before[i, 2]
            c0 = b0 * fixed[j, 0, 0] + b1 * fixed[j, 1, 0] + b2 * fixed[j, 2, 0]
            c1 = b0 * fixed[j, 0, 1] + b1 * fixed[j, 1, 1] + b2 * fixed[j, 2, 1]
            c2 = b0 * fixed[j, 0, 2] + b1 * fixed[j, 1, 2] + b2 * fixed[j, 2, 2]
            turned[j, i, 0] = c0 * cosine + c1 * sine
            turned[j, i, 1] = c1 * cosine - c0 * sine
            turned[j, i, 2] = c2
            axes[j, i] = 0.0 if tree.sliding[j] else c2


@jit
def _measure(tree: Tree, tasks: Tasks, k: int, work: Work) -> float:
    """Pulls and metrics of frame k's links, summed at the column that carries each; the tasks' cost, or infinity at a half turn."""
    pulls, metrics = work.pulls, work.metrics
    pulls[:] = 0.0
    metrics[:] = 0.0
    r = np.empty((3, 3))
    cost = 0.0
    for link in range(len(tasks.column)):
        column = tasks.column[link]
        before, own = (work.turned[column] if column >= 0 else tree.root), tasks.from_link[link]
        for i in range(3):
            for j in range(3):
                r[i, j] = before[i, 0] * own[0, j] + before[i, 1] * own[1, j] + before[i, 2] * own[2, j]
        d = tasks.desired[k, link]
        # e: 2 sin θ · axis = the antisymmetric part of d rᵀ
        ex = ey = ez = trace = 0.0
        for i in range(3):
            ex += d[2, i] * r[1, i] - d[1, i] * r[2, i]
            ey += d[0, i] * r[2, i] - d[2, i] * r[0, i]
            ez += d[1, i] * r[0, i] - d[0, i] * r[1, i]
            trace += d[0, i] * r[0, i] + d[1, i] * r[1, i] + d[2, i] * r[2, i]
        length = np.sqrt(ex * ex + ey * ey + ez * ez)
        theta = np.arctan2(length, trace - 1.0)
        if theta > HALF_TURN_RAD:
            return np.inf
        ratio = theta / length if length > 0.0 else 0.5
        ex, ey, ez = ex * ratio, ey * ratio, ez * ratio
        w, loss = tasks.weight[k, link], tasks.twist_loss[link]
        full = w * (1.0 - loss)
        cost += 0.5 * full * theta * theta
        bx, by, bz = full * ex, full * ey, full * ez
        if theta > 1e-4:
            kappa = 0.5 * ratio * (1.0 + trace)
            lost = full * (1.0 - kappa) / (theta * theta)
        else:
            kappa, lost = 1.0, 0.0
        xx = full * kappa + lost * ex * ex
        yy = full * kappa + lost * ey * ey
        zz = full * kappa + lost * ez * ez
        xy, xz, yz = lost * ex * ey, lost * ex * ez, lost * ey * ez
        if loss > 0.0:
            u, s, part = tasks.bone[link], tasks.desired_bone[k, link], w * loss
            ux = r[0, 0] * u[0] + r[0, 1] * u[1] + r[0, 2] * u[2]
            uy = r[1, 0] * u[0] + r[1, 1] * u[1] + r[1, 2] * u[2]
            uz = r[2, 0] * u[0] + r[2, 1] * u[1] + r[2, 2] * u[2]
            dx, dy, dz = uy * s[2] - uz * s[1], uz * s[0] - ux * s[2], ux * s[1] - uy * s[0]
            length, cosine = np.sqrt(dx * dx + dy * dy + dz * dz), ux * s[0] + uy * s[1] + uz * s[2]
            phi = np.arctan2(length, cosine)
            if phi > HALF_TURN_RAD:
                return np.inf
            ratio = phi / length if length > 0.0 else 1.0
            dx, dy, dz = dx * ratio, dy * ratio, dz * ratio
            cost += 0.5 * part * phi * phi
            bx, by, bz = bx + part * dx, by + part * dy, bz + part * dz
            tx, ty, tz = dy * uz - dz * uy, dz * ux - dx * uz, dx * uy - dy * ux
            px, py, pz = ux + 0.5 * tx, uy + 0.5 * ty, uz + 0.5 * tz
            lost = (1.0 - ratio * cosine - 0.25 * phi * phi) / (phi * phi) if phi > 1e-4 else 0.0
            xx += part * (1.0 - px * px - lost * tx * tx)
            yy += part * (1.0 - py * py - lost * ty * ty)
            zz += part * (1.0 - pz * pz - lost * tz * tz)
            xy -= part * (px * py + lost * tx * ty)
            xz -= part * (px * pz + lost * tx * tz)
            yz -= part * (py * pz + lost * ty * tz)
        if column >= 0:
            pulls[column, 0] += bx
            pulls[column, 1] += by
            pulls[column, 2] += bz
            m = metrics[column]
            m[0] += xx
            m[1] += xy
            m[2] += xz
            m[3] += yy
            m[4] += yz
            m[5] += zz
    return cost


@jit
def _linearise(tree: Tree, tasks: Tasks, posture: Posture, k: int, q: Array, work: Work) -> float:
    """F at q, or infinity at a half turn; fills gradient and hessian (entries of a column with itself and with those before it)."""
    _place(tree, q, work)
    cost = _measure(tree, tasks, k, work)
    parent, base, axes, columns = tree.parent, tree.base, work.axes, len(tree.parent)
    first = len(q) - columns
    for j in range(columns - 1, -1, -1):
        a, b, n = axes[j], work.pulls[j], work.metrics[j]
        work.gradient[j] = -(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])
        x = n[0] * a[0] + n[1] * a[1] + n[2] * a[2]
        y = n[1] * a[0] + n[3] * a[1] + n[4] * a[2]
        z = n[2] * a[0] + n[4] * a[1] + n[5] * a[2]
        work.hessian[j, j] = a[0] * x + a[1] * y + a[2] * z
        if j >= base:
            away = q[first + j] - posture.reference[j - base]
            cost += 0.5 * posture.weight * away * away
            work.gradient[j] += posture.weight * away
            work.hessian[j, j] += posture.weight
            if len(posture.stiffness):
                stiffness, away = posture.stiffness[k, j - base], q[first + j] - posture.held[k, j - base]
                cost += 0.5 * stiffness * away * away
                work.gradient[j] += stiffness * away
                work.hessian[j, j] += stiffness
            x += 0.5 * (b[1] * a[2] - b[2] * a[1])
            y += 0.5 * (b[2] * a[0] - b[0] * a[2])
            z += 0.5 * (b[0] * a[1] - b[1] * a[0])
        before = parent[j]
        if before >= 0:
            for i in range(3):
                work.pulls[before, i] += b[i]
            for i in range(6):
                work.metrics[before, i] += n[i]
        while before >= 0:
            work.hessian[j, before] = axes[before, 0] * x + axes[before, 1] * y + axes[before, 2] * z
            before = parent[before]
    return cost


@jit
def _factor(parent: IntArray, work: Work) -> bool:
    """H = LᵀL on the variables that are not held; False when H isn't positive definite there."""
    hessian, factor, held = work.hessian, work.factor, work.held
    columns = len(parent)
    for j in range(columns):
        if held[j] == FREE:
            i = j
            while i >= 0:
                factor[j, i] = hessian[j, i]
                i = parent[i]
    for j in range(columns - 1, -1, -1):
        if held[j] != FREE:
            continue
        if not factor[j, j] > 1e-12:
            return False
        pivot = np.sqrt(factor[j, j])
        factor[j, j] = pivot
        i = parent[j]
        while i >= 0:
            if held[i] == FREE:
                factor[j, i] /= pivot
            i = parent[i]
        i = parent[j]
        while i >= 0:
            if held[i] == FREE:
                h = i
                while h >= 0:
                    if held[h] == FREE:
                        factor[i, h] -= factor[j, i] * factor[j, h]
                    h = parent[h]
            i = parent[i]
    return True


@jit
def _solve_factored(parent: IntArray, work: Work) -> None:
    """step := (LᵀL)⁻¹ step on the variables that are not held."""
    factor, held, x = work.factor, work.held, work.step
    columns = len(parent)
    for j in range(columns - 1, -1, -1):
        if held[j] == FREE:
            x[j] /= factor[j, j]
            i = parent[j]
            while i >= 0:
                if held[i] == FREE:
                    x[i] -= factor[j, i] * x[j]
                i = parent[i]
    for j in range(columns):
        if held[j] == FREE:
            i = parent[j]
            while i >= 0:
                if held[i] == FREE:
                    x[j] -= factor[j, i] * x[i]
                i = parent[i]
            x[j] /= factor[j, j]


@jit
def _multiply(parent: IntArray, work: Work, only_held: bool) -> None:
    """slope := gradient + H step; with `only_held` as if the free part of step were zero."""
    hessian, step, slope = work.hessian, work.step, work.slope
    columns = len(parent)
    for j in range(columns):
        slope[j] = work.gradient[j]
    for j in range(columns):
        at_j = 0.0 if only_held and work.held[j] == FREE else step[j]
        slope[j] += hessian[j, j] * at_j
        i = parent[j]
        while i >= 0:
            at_i = 0.0 if only_held and work.held[i] == FREE else step[i]
            slope[j] += hessian[j, i] * at_i
            slope[i] += hessian[j, i] * at_j
            i = parent[i]


@jit
def _box_qp(parent: IntArray, work: Work) -> bool:
    """step := argmin ½ xᵀHx + gᵀx in [low, high], low ≤ 0 ≤ high; False when H is indefinite or the set cycles.

    Held at first is what stands at a bound and would leave it.
    """
    columns = len(parent)
    step, low, high, held, slope = work.step, work.low, work.high, work.held, work.slope
    for j in range(columns):
        gradient = work.gradient[j]
        held[j] = LOW if low[j] >= 0.0 and gradient > 0.0 else HIGH if high[j] <= 0.0 and gradient < 0.0 else FREE
    for _ in range(MOST_SETS):
        any_held = False
        for j in range(columns):
            if held[j] == LOW:
                step[j] = low[j]
                any_held = True
            elif held[j] == HIGH:
                step[j] = high[j]
                any_held = True
        if not _factor(parent, work):
            return False
        if any_held:
            _multiply(parent, work, True)
        for j in range(columns):
            if held[j] == FREE:
                step[j] = -(slope[j] if any_held else work.gradient[j])
        _solve_factored(parent, work)
        if any_held:
            _multiply(parent, work, False)
        changed = False
        for j in range(columns):
            if held[j] == FREE:
                if step[j] < low[j]:
                    held[j], changed = LOW, True
                elif step[j] > high[j]:
                    held[j], changed = HIGH, True
            elif (held[j] == LOW and slope[j] < 0.0) or (held[j] == HIGH and slope[j] > 0.0):
                held[j], changed = FREE, True
        if not changed:
            return True
    return False


@jit
def _advance(base: int, q: Array, step: Array, lower: Array, upper: Array) -> None:
    """q := q ⊕ step, joints kept in their bounds."""
    if base:
        angle = np.sqrt(step[0] ** 2 + step[1] ** 2 + step[2] ** 2)
        half = np.sin(0.5 * angle) / angle if angle > 1e-12 else 0.5
        tx, ty, tz, tw = half * step[0], half * step[1], half * step[2], np.cos(0.5 * angle)
        _turn_base(q, tx, ty, tz, tw)
    first = len(q) - len(step)
    for j in range(base, len(step)):
        value = q[first + j] + step[j]
        q[first + j] = max(min(value, upper[j - base]), lower[j - base])


@jit
def _turn_base(q: Array, tx: float, ty: float, tz: float, tw: float) -> None:
    """Quaternion xyzw of q times (tx, ty, tz, tw), normalised."""
    x, y, z, w = q[3], q[4], q[5], q[6]
    nx = w * tx + x * tw + y * tz - z * ty
    ny = w * ty - x * tz + y * tw + z * tx
    nz = w * tz + x * ty - y * tx + z * tw
    nw = w * tw - x * tx - y * ty - z * tz
    norm = np.sqrt(nx * nx + ny * ny + nz * nz + nw * nw)
    q[3], q[4], q[5], q[6] = nx / norm, ny / norm, nz / norm, nw / norm


@jit
def _rows_are_clear(limits: Limits, joints: Array) -> bool:
    for row in range(len(limits.rows)):
        value = 0.0
        for j in range(len(joints)):
            value += limits.rows[row, j] * joints[j]
        if value < limits.rows_lower[row] or value > limits.rows_upper[row]:
            return False
    return True


@jit
def converge(
    tree: Tree, tasks: Tasks, limits: Limits, posture: Posture, k: int, q: Array, lower: Array, upper: Array,
    tolerance: float, work: Work,
) -> tuple[int, float]:  # fmt: skip
    """Frame k solved from q, in place: (QPs it took, F there), or (0, 0) when it is not for this kernel; q is then spoilt."""
    columns, base = len(tree.parent), tree.base
    first = len(q) - columns
    for j in range(base, columns):
        q[first + j] = max(min(q[first + j], upper[j - base]), lower[j - base])
    last_size, cost_before = np.inf, np.inf
    for iteration in range(1, MOST_STEPS + 1):
        if not _rows_are_clear(limits, q[first + base :]):
            return 0, 0.0
        cost = _linearise(tree, tasks, posture, k, q, work)
        if not cost <= cost_before * (1.0 + 1e-12) + 1e-15 or cost == np.inf:
            return 0, 0.0
        for j in range(columns):
            work.low[j], work.high[j] = -limits.max_step, limits.max_step
            if j >= base:
                work.low[j] = max(work.low[j], lower[j - base] - q[first + j])
                work.high[j] = min(work.high[j], upper[j - base] - q[first + j])
        if not _box_qp(tree.parent, work):
            return 0, 0.0
        cost_before = cost
        size = 0.0
        for j in range(columns):
            size = max(size, abs(work.step[j]))
        _advance(base, q, work.step, lower, upper)
        ratio = size / last_size if last_size > 0.0 else 0.0
        left = size if last_size == np.inf else (size * ratio / (1.0 - ratio) if ratio < 1.0 else np.inf)
        if left <= tolerance:
            if not _rows_are_clear(limits, q[first + base :]):
                return 0, 0.0
            _multiply(tree.parent, work, False)
            for j in range(columns):
                cost += 0.5 * work.step[j] * (work.gradient[j] + work.slope[j])
            return iteration, cost
        last_size = size
    return 0, 0.0


@jit
def follow(
    tree: Tree, tasks: Tasks, limits: Limits, posture: Posture, time: Array, path: Array, costs: Array, iterations: IntArray,
    below: Array, first: int, last: int, tolerance: float, work: Work,
) -> tuple[int, bool]:  # fmt: skip
    """Solve the frames after `first` up to `last` as `FrameSolver.follow`; (last frame written, whether it ended by itself).

    path (T, nq), costs and iterations (T,) are written; below: (T,), or (0,) for none. When it did not end by itself, the next frame is
    one that the kernel does not solve.
    """
    joints = len(limits.lower)
    size = path.shape[1]
    start = size - joints
    direction = 1 if last >= first else -1
    lower, upper, q = np.empty(joints), np.empty(joints), np.empty(size)
    k = first
    while k != last:
        before, k = path[k], k + direction
        step_s = abs(time[k] - time[k - direction])
        for j in range(joints):
            reach = limits.velocity[j] * step_s
            lower[j] = max(limits.lower[j], before[start + j] - reach)
            upper[j] = min(limits.upper[j], before[start + j] + reach)
        q[:] = before
        two = k - 2 * direction
        if 0 <= two < len(path) and costs[two] < np.inf:
            if tree.base:
                older = path[two]
                # the rotation from the older to the newer, once more: older⁻¹ · newer
                x, y, z, w = -older[3], -older[4], -older[5], older[6]
                a, b, c, d = before[3], before[4], before[5], before[6]
                _turn_base(
                    q, w * a + x * d + y * c - z * b, w * b - x * c + y * d + z * a,
                    w * c + x * b - y * a + z * d, w * d - x * a - y * b - z * c,
                )  # fmt: skip
            for j in range(start, size):
                q[j] += before[j] - path[two, j]
        count, cost = converge(tree, tasks, limits, posture, k, q, lower, upper, tolerance, work)
        if count == 0:
            return k - direction, False
        if len(below) and not cost < below[k]:
            return k - direction, True
        path[k], costs[k], iterations[k] = q, cost, count
    return last, True
