"""Rotations by their vectors: axis times angle [rad]. In scalars: a filter asks for one at a time."""

from __future__ import annotations

import math

import numpy as np

from vita.types import Array


def skew(v: Array) -> Array:
    """(3, 3) matrix S with S x = v cross x."""
    x, y, z = float(v[0]), float(v[1]), float(v[2])
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def skews(v: Array) -> Array:
    """(k, 3, 3) the same of every row of `v` (k, 3)."""
    out = np.zeros((len(v), 3, 3))
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    out[:, 1, 0], out[:, 2, 0], out[:, 2, 1] = v[:, 2], -v[:, 1], v[:, 0]
    return out


def _series(angle: float) -> tuple[float, float, float]:
    """sin(a) / a, (1 - cos a) / a^2 and (a - sin a) / a^3, also where a is tiny."""
    if angle < 1e-3:
        # The first term that is left out is of order a^4, below the rounding of the result.
        square = angle * angle
        return 1.0 - square / 6.0, 0.5 - square / 24.0, 1.0 / 6.0 - square / 120.0
    sine = math.sin(angle)
    # sin(a/2) keeps the digits that 1 - cos(a) would lose.
    half = math.sin(0.5 * angle) / angle
    return sine / angle, 2.0 * half * half, (angle - sine) / angle**3


def _combine(v: Array, one: float, first: float, second: float) -> Array:
    """one I + first [v]x + second v v', written out."""
    x, y, z = float(v[0]), float(v[1]), float(v[2])
    xy, xz, yz = second * x * y, second * x * z, second * y * z
    fx, fy, fz = first * x, first * y, first * z
    return np.array(
        [
            [one + second * x * x, xy - fz, xz + fy],
            [xy + fz, one + second * y * y, yz - fx],
            [xz - fy, yz + fx, one + second * z * z],
        ]
    )


def rotation_exp(v: Array) -> Array:
    """(3, 3) rotation about the direction of `v` (3,) by its length [rad]: Rodrigues' formula."""
    angle = math.sqrt(float(v[0]) ** 2 + float(v[1]) ** 2 + float(v[2]) ** 2)
    s, c, _ = _series(angle)
    return _combine(v, math.cos(angle), s, c)


def left_jacobian(v: Array) -> Array:
    """(3, 3) J with exp(v + d) = exp(J d) exp(v) for small d: how a turn's vector moves its end."""
    angle = math.sqrt(float(v[0]) ** 2 + float(v[1]) ** 2 + float(v[2]) ** 2)
    s, c, t = _series(angle)
    return _combine(v, s, c, t)


def rotation_log(R: Array) -> Array:
    """(3,) vector of a rotation, of length 0 to pi [rad]."""
    # By way of the quaternion, which keeps its digits at half a turn too: its largest component leads.
    trace = float(np.trace(R))
    squares = np.array([trace, R[0, 0], R[1, 1], R[2, 2]])
    k = int(np.argmax(squares))
    if k == 0:
        q = np.array([1.0 + trace, R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    else:
        i, j, m = k - 1, k % 3, (k + 1) % 3
        q = np.empty(4)
        q[0] = R[m, j] - R[j, m]
        q[1 + i] = 1.0 + R[i, i] - R[j, j] - R[m, m]
        q[1 + j] = R[j, i] + R[i, j]
        q[1 + m] = R[m, i] + R[i, m]
    q /= np.linalg.norm(q)
    q = -q if q[0] < 0.0 else q
    sine = float(np.linalg.norm(q[1:]))
    if sine < 1e-12:
        return 2.0 * q[1:]
    return q[1:] * (2.0 * math.atan2(sine, float(q[0])) / sine)


def orthonormal(R: Array) -> Array:
    """(3, 3) the rotation next to `R`, which products of many rotations have left by a few roundings."""
    # One Newton step of the polar decomposition; its own error is the square of what it mends.
    return 1.5 * R - 0.5 * R @ (R.T @ R)


def rigid(R: Array, t: Array) -> Array:
    """(4, 4) pose of rotation `R` (3, 3) and translation `t` (3,)."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, t
    return T


def angle_between(a: Array, b: Array) -> float:
    """Angle of the turn from one rotation (3, 3) to another [rad]."""
    return float(np.linalg.norm(rotation_log(a[:3, :3].T @ b[:3, :3])))
