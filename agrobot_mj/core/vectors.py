"""Vector algebra in three dimensions for compiled kernels: tuples of floats, no arrays."""

from math import sqrt

from agrobot_mj.core.kernels import kernel

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
