"""Vector algebra in three dimensions for compiled kernels, with tuples of floats instead of arrays."""

from math import sqrt

from agrobot_mj.core.kernels import kernel
from agrobot_mj.core.signals import Array

Vector = tuple[float, float, float]


@kernel
def dot(a: Vector, b: Vector) -> float:
    """Return the scalar product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def cross(a: Vector, b: Vector) -> Vector:
    """Return the vector product of two vectors."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel
def unit(a: Vector) -> Vector:
    """Return the unit vector in the direction of `a`."""
    s = 1.0 / sqrt(dot(a, a))
    return a[0] * s, a[1] * s, a[2] * s


@kernel
def plus(a: Vector, b: Vector) -> Vector:
    """Return the sum of two vectors."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@kernel
def minus(a: Vector, b: Vector) -> Vector:
    """Return the difference of two vectors."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@kernel
def scale(s: float, a: Vector) -> Vector:
    """Return the vector `a` times the scalar `s`."""
    return s * a[0], s * a[1], s * a[2]


@kernel
def to_world(R: Array, a: Vector) -> Vector:
    """Rotate a vector from body axes to world axes by a rotation matrix with the elements `R` (9,), row by row as in
    MuJoCo."""
    return (
        R[0] * a[0] + R[1] * a[1] + R[2] * a[2],
        R[3] * a[0] + R[4] * a[1] + R[5] * a[2],
        R[6] * a[0] + R[7] * a[1] + R[8] * a[2],
    )
