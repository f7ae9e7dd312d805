"""Scene for images of the tractor: bodies with attached geoms.

A recording shows a `Scene` and moves its bodies, independently of the type of plant.
"""

from typing import NamedTuple

from agrobot_mj.core.signals import Array, Index


class Mesh(NamedTuple):
    """Triangle mesh of a geom."""

    vertices: Array  # Vertex positions in the frame of the geom [m], shape (n, 3)
    triangles: Index  # Vertex indices of each triangle, shape (m, 3)


class Geom(NamedTuple):
    """Primitive shape or mesh, fixed to a body."""

    name: str
    body: str
    kind: str  # Type: box, cylinder, capsule, sphere, ellipsoid or mesh
    size: tuple[float, float, float]  # Half sizes in the convention of MuJoCo [m]
    pos: tuple[float, float, float]  # Centre of the geom in the frame of its body [m]
    quat: tuple[float, float, float, float]  # Orientation of the geom in the frame of its body, quaternion w x y z
    rgba: tuple[float, float, float, float]
    mesh: Mesh | None = None  # Triangle mesh of a geom of kind mesh, or None for primitives


class Scene(NamedTuple):
    """Bodies and geoms of a tractor, for drawing."""

    bodies: tuple[str, ...]  # Names of the bodies, in the order of the rows of `RunningPlant.poses`
    geoms: tuple[Geom, ...]
