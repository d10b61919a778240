"""Batches of rotations that pinocchio and SciPy give only one by one or in another order.

Quaternions are unit, **wxyz** (scalar first), arrays of shape (..., 4); vectors (..., 3); matrices (..., 3, 3).
A rotation written `q_world_body` takes body coordinates to world coordinates. Angles are radians.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def multiply(left: ArrayLike, right: ArrayLike) -> Array:
    """Hamilton product `left ⊗ right`, shapes (..., 4) broadcast against each other: rotate by `right`, then by `left`."""
    a, b = np.asarray(left, float), np.asarray(right, float)
    aw, ax, ay, az = np.moveaxis(a, -1, 0)
    bw, bx, by, bz = np.moveaxis(b, -1, 0)
    return np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        axis=-1,
    )


def conjugate(quaternion: ArrayLike) -> Array:
    """Inverse of unit quaternions (..., 4)."""
    return np.asarray(np.asarray(quaternion, float) * np.array([1.0, -1.0, -1.0, -1.0]))


def normalize(quaternion: ArrayLike) -> Array:
    """Unit quaternions in the same directions as `quaternion` (..., 4). Zero quaternions give NaN."""
    q = np.asarray(quaternion, float)
    with np.errstate(invalid="ignore", divide="ignore"):
        unit: Array = q / np.linalg.norm(q, axis=-1, keepdims=True)
    return unit


def rotate(quaternion: ArrayLike, vector: ArrayLike) -> Array:
    """Vectors (..., 3) rotated by unit quaternions (..., 4)."""
    q, v = np.asarray(quaternion, float), np.asarray(vector, float)
    w, xyz = q[..., :1], q[..., 1:]
    t = 2.0 * np.cross(xyz, v)
    rotated: Array = v + w * t + np.cross(xyz, t)
    return rotated


def to_matrix(quaternion: ArrayLike) -> Array:
    """Rotation matrices (..., 3, 3) of unit quaternions (..., 4)."""
    w, x, y, z = np.moveaxis(np.asarray(quaternion, float), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def from_matrix(matrix: ArrayLike) -> Array:
    """Unit quaternions (..., 4), w ≥ 0, of rotation matrices (..., 3, 3).

    Shepperd's method: of the four ways to start, the one with the largest pivot, so that no half turn loses digits.
    """
    m = np.asarray(matrix, float)
    d0, d1, d2 = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    pivots = np.stack([1 + d0 + d1 + d2, 1 + d0 - d1 - d2, 1 - d0 + d1 - d2, 1 - d0 - d1 + d2], axis=-1)
    a, b, c = m[..., 2, 1] - m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0], m[..., 1, 0] - m[..., 0, 1]
    d, e, f = m[..., 1, 0] + m[..., 0, 1], m[..., 0, 2] + m[..., 2, 0], m[..., 2, 1] + m[..., 1, 2]
    rows = np.stack(
        [
            np.stack([pivots[..., 0], a, b, c], axis=-1),
            np.stack([a, pivots[..., 1], d, e], axis=-1),
            np.stack([b, d, pivots[..., 2], f], axis=-1),
            np.stack([c, e, f, pivots[..., 3]], axis=-1),
        ],
        axis=-2,
    )
    best = np.argmax(pivots, axis=-1)
    q = normalize(np.take_along_axis(rows, best[..., None, None], axis=-2)[..., 0, :])
    return np.where(q[..., :1] < 0, -q, q)


def log(quaternion: ArrayLike) -> Array:
    """Rotation vectors (..., 3), angle in [0, π], of unit quaternions (..., 4): the logarithm θ·axis."""
    q = np.asarray(quaternion, float)
    q = np.where(q[..., :1] < 0, -q, q)
    norm = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(norm, q[..., :1])
    small = norm < 1e-12
    scale = np.where(small, 2.0, angle / np.where(small, 1.0, norm))
    return np.asarray(q[..., 1:] * scale)


def exp(rotation_vector: ArrayLike) -> Array:
    """Unit quaternions (..., 4) of rotation vectors (..., 3)."""
    v = np.asarray(rotation_vector, float)
    angle = np.linalg.norm(v, axis=-1, keepdims=True)
    return np.concatenate([np.cos(angle / 2), 0.5 * np.sinc(angle / (2 * np.pi)) * v], axis=-1)


def about_z(angle: ArrayLike) -> Array:
    """Unit quaternions (..., 4) of turns about Z by `angle` (...) rad, positive to the left; continuous in sign where the angle is."""
    half = np.asarray(angle, float) / 2
    q = np.zeros((*half.shape, 4))
    q[..., 0], q[..., 3] = np.cos(half), np.sin(half)
    return q


def angle(a: ArrayLike, b: ArrayLike) -> Array:
    """Angle (...) in [0, π] of the rotation between unit quaternions `a` and `b`, accurate near 0 and near π."""
    d = multiply(conjugate(a), b)
    return np.asarray(2.0 * np.arctan2(np.linalg.norm(d[..., 1:], axis=-1), np.abs(d[..., 0])))


def vector_angle(a: ArrayLike, b: ArrayLike) -> Array:
    """Angle (...) in [0, π] between vectors (..., 3), accurate near 0 and near π. NaN where a vector is zero or NaN."""
    u, v = np.asarray(a, float), np.asarray(b, float)
    with np.errstate(invalid="ignore", divide="ignore"):
        u = u / np.linalg.norm(u, axis=-1, keepdims=True)
        v = v / np.linalg.norm(v, axis=-1, keepdims=True)
    return np.asarray(2.0 * np.arctan2(np.linalg.norm(u - v, axis=-1), np.linalg.norm(u + v, axis=-1)))


def make_continuous(quaternion: ArrayLike) -> Array:
    """The same rotations with signs chosen so that neighbours along axis 0 never jump to the other hemisphere.

    `quaternion` is (T, ..., 4) without NaN. The first frame keeps its sign.
    """
    q = np.array(quaternion, float)
    if len(q) > 1:
        flips = np.einsum("t...i,t...i->t...", q[1:], q[:-1]) < 0
        q[1:] *= np.where(np.logical_xor.accumulate(flips, axis=0), -1.0, 1.0)[..., None]
    return q


def mean(quaternion: ArrayLike) -> Array:
    """The mean rotation (4,), w ≥ 0, of unit quaternions (N, 4), whose signs don't matter.

    The rotation with the least sum of squared chordal distances to all: the eigenvector of Σ q qᵀ with the largest eigenvalue
    [Markley2007 eq. 13].
    """
    q = np.asarray(quaternion, float)
    unit = np.linalg.eigh(q.T @ q)[1][:, -1]
    return np.asarray(-unit if unit[0] < 0 else unit)


def slerp(start: ArrayLike, end: ArrayLike, fraction: ArrayLike) -> Array:
    """Shortest-arc interpolation from `start` to `end` (..., 4) at `fraction` (...), 0 → start, 1 → end."""
    a, b = np.asarray(start, float), np.asarray(end, float)
    step = log(multiply(conjugate(a), b)) * np.asarray(fraction, float)[..., None]
    return normalize(multiply(a, exp(step)))


def angular_velocity(time: ArrayLike, quaternion: ArrayLike) -> Array:
    """World-frame angular velocity (T, ..., 3) in rad/s of orientations (T, ..., 4) at `time` (T,) in s.

    Central differences of the logarithm, one-sided at both ends; zero for a single frame. Signs need not be continuous.
    """
    t, q = np.asarray(time, float), np.asarray(quaternion, float)
    omega = np.zeros((*q.shape[:-1], 3))
    if len(t) < 2:
        return omega
    shape = (-1,) + (1,) * (q.ndim - 1)
    step = log(multiply(q[1:], conjugate(q[:-1]))) / np.diff(t).reshape(shape)
    omega[0], omega[-1] = step[0], step[-1]
    before, after = np.diff(t)[:-1].reshape(shape), np.diff(t)[1:].reshape(shape)
    omega[1:-1] = (step[:-1] * after + step[1:] * before) / (before + after)
    return omega


def from_rpy(rpy: ArrayLike) -> Array:
    """Unit quaternions (..., 4) of URDF fixed-axis roll, pitch, yaw (..., 3): R = Rz(yaw) Ry(pitch) Rx(roll)."""
    r = np.asarray(rpy, float)
    axes = [exp(r[..., i, None] * np.eye(3)[i]) for i in range(3)]
    return multiply(axes[2], multiply(axes[1], axes[0]))


def to_rpy(quaternion: ArrayLike) -> Array:
    """URDF fixed-axis roll, pitch, yaw (..., 3) of unit quaternions (..., 4), pitch in [−π/2, π/2]: R = Rz(yaw) Ry(pitch) Rx(roll).

    Exact everywhere: where the pitch is a quarter turn and yaw is all rounding, the roll is that which goes with it.
    """
    m = to_matrix(quaternion)
    heading = np.arctan2(m[..., 1, 0], m[..., 0, 0])
    cosine, sine = np.cos(heading), np.sin(heading)
    pitch = np.arctan2(-m[..., 2, 0], cosine * m[..., 0, 0] + sine * m[..., 1, 0])
    roll = np.arctan2(sine * m[..., 0, 2] - cosine * m[..., 1, 2], cosine * m[..., 1, 1] - sine * m[..., 0, 1])
    return np.stack([roll, pitch, heading], axis=-1)


def yaw(quaternion: ArrayLike) -> Array:
    """Heading (...) in (−π, π] rad: the twist about world Z of `quaternion` (..., 4), 0 = facing +X, positive to the left.

    The twist of the swing-twist decomposition: unlike the yaw of roll-pitch-yaw it has no jump when the person bends forward
    by 90°; undefined (0) only for a body turned exactly upside down.
    """
    q = np.asarray(quaternion, float)
    w, z = q[..., 0], q[..., 3]
    # q and -q are one rotation: the one with w ≥ 0 has its half angle in [-π/2, π/2].
    twist = 2.0 * np.arctan2(np.where(w < 0, -z, z), np.abs(w))
    return np.where(twist <= -np.pi, np.pi, twist)


def shortest_arc(start: ArrayLike, end: ArrayLike) -> Array:
    """Unit quaternions (..., 4) of the smallest rotation that takes directions `start` to directions `end` (..., 3).

    Exactly opposite directions have no unique answer: any half turn about a perpendicular axis is returned.
    """
    u, v = np.asarray(start, float), np.asarray(end, float)
    u = u / np.linalg.norm(u, axis=-1, keepdims=True)
    v = v / np.linalg.norm(v, axis=-1, keepdims=True)
    u, v = np.broadcast_arrays(u, v)
    axis = np.cross(u, v)
    length = np.linalg.norm(axis, axis=-1, keepdims=True)
    helper = np.cross(u, np.where(np.abs(u[..., :1]) < 0.9, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]))
    axis = np.where(length > 0, axis / np.where(length > 0, length, 1.0), helper)
    # Near opposite directions the product is all rounding: whatever is left of it must at least be perpendicular to `start`.
    axis = axis - np.einsum("...i,...i->...", axis, u)[..., None] * u
    axis = axis / np.linalg.norm(axis, axis=-1, keepdims=True)
    cosine = np.linalg.norm(u + v, axis=-1, keepdims=True)
    sine = np.linalg.norm(u - v, axis=-1, keepdims=True)
    return normalize(np.concatenate([cosine, sine * axis], axis=-1))
