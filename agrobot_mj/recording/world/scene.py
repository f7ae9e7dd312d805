"""Static content of the scene: ground, reference path, contour lines, and the geoms of each body in its frame.

Geoms of a body with the same shape form one entity, for example all 64 lugs of the wheels. Contour lines show the
large-scale slope of the ground without furrows and bumps.
"""

from collections.abc import Sequence
from math import ceil, floor, log10
from typing import Any

import numpy as np
import rerun as rr
from contourpy import contour_generator
from rerun.components import FillMode

from agrobot_mj.core.signals import TICK_S, Array
from agrobot_mj.paths import sample
from agrobot_mj.plants.mujoco.clearance import rotation_of
from agrobot_mj.plants.scene import Geom, Mesh, Scene
from agrobot_mj.recording.world.ground import ROUGH_LIFT_M, ground_mesh, on_ground, smooth_corners
from agrobot_mj.recording.world.names import REFERENCE
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.terrain import Ground

PATH_LIFT_M = 0.01
"""Height of the reference path above the ground [m]. Lines in the scene have different heights, so that all are
visible."""
PATH_WIDTH = rr.Radius.ui_points(1.0)  # Line width of the reference path on the screen, independent of camera distance
PATH_STEP_M, ROUGH_PATH_STEP_M, MOST_PATH_POINTS = 0.25, 0.1, 20_000
"""Point distances of the reference path on a plane and on uneven ground [m], and maximum number of points [-]."""


def send_scene(stream: rr.RecordingStream, scene: Scene, ground: Ground, reference: Array) -> None:
    """Send the static content of the scene; `reference` (n, 3) [m] is the reference path from `reference_line`."""
    stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    stream.log("world/ground", ground_mesh(ground, reference[:, :2]), static=True)
    lines = contour_lines(smooth_corners(ground, reference[:, :2]), 0.0 if ground.is_plane else ROUGH_LIFT_M)
    if lines is not None:
        stream.log(CONTOURS, lines, static=True)
    stream.log("world/path", rr.LineStrips3D([reference], colors=REFERENCE, radii=PATH_WIDTH), static=True)
    for body in scene.bodies:
        for kind, shape in shapes([geom for geom in scene.geoms if geom.body == body]).items():
            stream.log(f"world/bodies/{body}/{kind}", shape, static=True)


def reference_line(scenario: Scenario, ground: Ground) -> Array:
    """Return the reference path of the complete run, raised above the ground, shape (n, 3) [m]."""
    duration, step = scenario.ticks * TICK_S, PATH_STEP_M if ground.is_plane else ROUGH_PATH_STEP_M
    count = min(ceil(duration * scenario.path.speed_m_s / step), scenario.ticks, MOST_PATH_POINTS)
    times = np.linspace(0.0, duration, max(count, 1) + 1)
    return on_ground(ground, sample(scenario.path, times), PATH_LIFT_M)


SHAPES = {"box": "boxes", "cylinder": "cylinders", "capsule": "capsules"}
"""Entity names of geom types. Geoms of other types are drawn as ellipsoids."""


def shapes(geoms: Sequence[Geom]) -> dict[str, rr.AsComponents]:
    """Return the geoms as Rerun shapes by entity name: one shape for all geoms of a type, and one shape for each
    mesh."""
    batches: dict[str, list[Geom]] = {}
    meshes = [geom for geom in geoms if geom.mesh is not None]
    for geom in geoms:
        if geom.mesh is None:
            batches.setdefault(SHAPES.get(geom.kind, "ellipsoids"), []).append(geom)
    found = {entity: _batch(entity, batch) for entity, batch in batches.items()}
    return found | {f"meshes/{k}": _surface(geom, geom.mesh) for k, geom in enumerate(meshes) if geom.mesh is not None}


def camera_target(scene: Scene) -> str:
    """Return the entity that the camera follows, relative to `world/bodies`: the first shape of the first body with
    geoms."""
    return next(
        f"{body}/{kind}"
        for body in scene.bodies
        for kind in shapes([geom for geom in scene.geoms if geom.body == body])
    )


def _surface(geom: Geom, mesh: Mesh) -> rr.Mesh3D:
    placed = mesh.vertices @ rotation_of(np.array(geom.quat)).T + geom.pos
    corners = placed[mesh.triangles]
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(placed)
    for k in range(3):
        np.add.at(normals, mesh.triangles[:, k], faces)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return rr.Mesh3D(
        vertex_positions=placed, triangle_indices=mesh.triangles, vertex_normals=normals, albedo_factor=geom.rgba
    )


def _batch(entity: str, geoms: Sequence[Geom]) -> rr.AsComponents:
    places = np.array([geom.pos for geom in geoms])
    sizes = np.array([(geom.size[0],) * 3 if geom.kind == "sphere" else geom.size for geom in geoms])
    turns = np.array([geom.quat for geom in geoms])[:, [1, 2, 3, 0]]  # Rerun has the order x, y, z, w
    style: Any = {"quaternions": turns, "colors": np.array([geom.rgba for geom in geoms]), "fill_mode": FillMode.Solid}
    if entity == "boxes":
        return rr.Boxes3D(half_sizes=sizes, centers=places, **style)
    if entity == "ellipsoids":
        return rr.Ellipsoids3D(half_sizes=sizes, centers=places, **style)
    tube: Any = {"lengths": 2 * sizes[:, 1], "radii": sizes[:, 0], **style}
    if entity == "cylinders":
        return rr.Cylinders3D(centers=places, **tube)
    x, y, z, w = turns.T
    axes = np.column_stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
    # Capsules of Rerun start at their origin; capsules of MuJoCo are centred.
    return rr.Capsules3D(translations=places - sizes[:, 1:2] * axes, **tube)


CONTOURS = "world/contours"
COLOUR, WIDTH, LIFT_M = 0x20280FA0, rr.Radius.ui_points(0.6), 0.005
"""Colour, width and height above the ground [m] of contour lines, which are below the reference path and the tracks."""
MOST_LINES = 24  # Maximum number of contour lines
LEAST_RISE_M = 0.4  # Minimum height difference of the ground at which contour lines are drawn [m]


def interval(low: float, high: float) -> float | None:
    """Return the height interval of contour lines [m]: 1, 2 or 5 times a power of ten, or None for level ground."""
    if high - low < LEAST_RISE_M:
        return None
    least = (high - low) / MOST_LINES
    decade = 10.0 ** floor(log10(least))
    return next(k * decade for k in (1, 2, 5, 10) if k * decade >= least * (1 - 1e-9))


def contours(corners: Array) -> list[Array]:
    """Return the contour lines of the surface through `corners` (rows, columns, 3), each of shape (n, 3) [m]."""
    x, y, z = np.moveaxis(corners, -1, 0)
    step = interval(float(z.min()), float(z.max()))
    if step is None:
        return []
    levels = step * np.arange(np.ceil(z.min() / step), np.floor(z.max() / step) + 1)
    lines: list[Any] = contour_generator(x, y, z).multi_lines(levels)
    return [
        np.column_stack([line, np.full(len(line), level)])
        for level, found in zip(levels, lines, strict=True)
        for line in found
    ]


def contour_lines(corners: Array, lift: float = 0.0) -> rr.LineStrips3D | None:
    """Return contour lines of `corners` (rows, columns, 3) raised by `lift` [m], or None for level ground."""
    lines = contours(corners)
    if not lines:
        return None
    above = np.array([0.0, 0.0, LIFT_M + lift])
    return rr.LineStrips3D([(line + above).astype(np.float32) for line in lines], colors=COLOUR, radii=WIDTH)
