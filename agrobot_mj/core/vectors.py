"""Vector algebra in three dimensions for compiled kernels: tuples of floats, no arrays."""

from math import sqrt

from agrobot_mj.core.kernels import kernel
from agrobot_mj.core.signals import Array

Vector = tuple[float, float, float]
"""x, y, z."""


@kernel
def dot(a: Vector, b: Vector) -> float:
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def cross(a: Vector, b: Vector) -> Vector:
    """Vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel
def unit(a: Vector) -> Vector:
    """`a` over its length."""
    s = 1.0 / sqrt(dot(a, a))
    return a[0] * s, a[1] * s, a[2] * s


@kernel
def plus(a: Vector, b: Vector) -> Vector:
    """Sum."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@kernel
def minus(a: Vector, b: Vector) -> Vector:
    """Difference."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@kernel
def scaled(s: float, a: Vector) -> Vector:
    """`a` times `s`."""
    return s * a[0], s * a[1], s * a[2]


@kernel
def to_world(R: Array, a: Vector) -> Vector:
    """A vector of a body's frame in the world's axes, by the body's rotation (9,), row by row as MuJoCo has it."""
    return (
        R[0] * a[0] + R[1] * a[1] + R[2] * a[2],
        R[3] * a[0] + R[4] * a[1] + R[5] * a[2],
        R[6] * a[0] + R[7] * a[1] + R[8] * a[2],
    )
