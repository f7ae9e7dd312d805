"""Drawn scene of the tractor: its bodies and their fixed primitives.

Recordings draw a `Scene` and move its bodies, independent of the plant.
"""

from typing import NamedTuple

from agrobot_mj.core.signals import Array, Index


class Mesh(NamedTuple):
    """A surface of triangles."""

    vertices: Array
    """Shape (n, 3), in the geom's frame [m]."""
    triangles: Index
    """Indices of vertices, shape (m, 3)."""


class Geom(NamedTuple):
    """Primitive or mesh, fixed in its body."""

    name: str
    body: str
    kind: str
    """box, cylinder, capsule, sphere, ellipsoid or mesh."""
    size: tuple[float, float, float]
    """Half sizes as MuJoCo has them [m]."""
    pos: tuple[float, float, float]
    """Centre in the body's frame [m]."""
    quat: tuple[float, float, float, float]
    """w x y z in the body's frame."""
    rgba: tuple[float, float, float, float]
    mesh: Mesh | None = None
    """The surface, if it is one."""


class Scene(NamedTuple):
    """All that a recording draws of a tractor."""

    bodies: tuple[str, ...]
    """Names, in the order of the rows of `poses`."""
    geoms: tuple[Geom, ...]
