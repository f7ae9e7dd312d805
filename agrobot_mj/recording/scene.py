"""What does not move: the ground, the reference path, and the shape of each body in the body's own frame.

A body's geoms go into one entity a shape, so that the 64 lugs of the wheels cost no more than one.
"""

from collections.abc import Sequence

import numpy as np
import rerun as rr
from rerun.components import FillMode

from agrobot_mj.paths import sample
from agrobot_mj.plants.scene import Geom, Scene
from agrobot_mj.scenario import Scenario
from agrobot_mj.signals import TICK_S, Array
from agrobot_mj.terrain import Ground
from agrobot_mj.terrain.grid import heights

MARGIN_M = 60.0
"""Ground drawn around the path; a tractor farther off has diverged [m]."""
CHECK_M = 2.0
"""Side of the squares of the ground, which make motion visible [m]."""
MOST_SQUARES = 200
"""Along a side of the ground; squares grow on larger ones."""
FIELD = np.array([[96, 112, 66], [104, 120, 73]], dtype=np.uint8)
"""The two greens of the ground."""
PATH_COLOUR, PATH_LIFT_M = 0xE8E8E8FF, 0.01
"""Lines are lifted above the ground, each to its own height, so that none hides in it or in another [m]."""
PATH_WIDTH = rr.Radius.ui_points(1.0)
"""Widths are those on the screen, so that lines are visible from near and far."""
PATH_POINTS = 2000


def send_scene(stream: rr.RecordingStream, scene: Scene, ground: Ground, reference: Array) -> None:
    """Log everything static; `reference` is what `reference_line` returns."""
    stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    stream.log("world/ground", ground_mesh(ground, reference[:, :2]), static=True)
    stream.log("world/path", rr.LineStrips3D([reference], colors=PATH_COLOUR, radii=PATH_WIDTH), static=True)
    for body in scene.bodies:
        for kind, shape in shapes([geom for geom in scene.geoms if geom.body == body]).items():
            stream.log(f"world/bodies/{body}/{kind}", shape, static=True)


def reference_line(scenario: Scenario, ground: Ground) -> Array:
    """The reference over the whole run, shape (n, 3) [m]."""
    times = np.linspace(0.0, scenario.ticks * TICK_S, min(scenario.ticks, PATH_POINTS) + 1)
    return on_ground(ground, sample(scenario.path, times), PATH_LIFT_M)


def on_ground(ground: Ground, points: Array, lift: float) -> Array:
    """Points (n, 2) laid `lift` above the ground, shape (n, 3) [m]."""
    return np.column_stack([points, heights(ground, points[:, 0], points[:, 1]) + lift])


def ground_mesh(ground: Ground, points: Array) -> rr.Mesh3D:
    """The ground around `points` (n, 2), as far as there is any, in squares of two greens."""
    (x0, y0), (x1, y1) = points.min(axis=0) - MARGIN_M, points.max(axis=0) + MARGIN_M
    x_min, x_max, y_min, y_max = ground.extent
    x0, x1, y0, y1 = max(x0, x_min), min(x1, x_max), max(y0, y_min), min(y1, y_max)
    side = max(CHECK_M, (x1 - x0) / MOST_SQUARES, (y1 - y0) / MOST_SQUARES)
    nx, ny = int((x1 - x0) / side), int((y1 - y0) / side)
    x, y = np.meshgrid(x0 + side * np.arange(nx + 1), y0 + side * np.arange(ny + 1))
    corners = np.stack([x, y, heights(ground, x, y)], axis=-1)
    quads = np.stack([corners[:-1, :-1], corners[:-1, 1:], corners[1:, 1:], corners[1:, :-1]], axis=2)
    colours = FIELD[np.add.outer(np.arange(ny), np.arange(nx)) % 2]
    first = 4 * np.arange(nx * ny, dtype=np.uint32)[:, None]
    return rr.Mesh3D(
        vertex_positions=quads.reshape(-1, 3),
        triangle_indices=(first + np.array([[0, 1, 2, 0, 2, 3]])).reshape(-1, 3),
        vertex_colors=np.repeat(colours.reshape(-1, 3), 4, axis=0),
    )


def shapes(geoms: Sequence[Geom]) -> dict[str, rr.AsComponents]:
    """One batch for each kind of shape among `geoms`, by the name of its entity."""
    makers = {"boxes": _boxes, "cylinders": _cylinders, "capsules": _capsules, "ellipsoids": _ellipsoids}
    kinds = {"boxes": "box", "cylinders": "cylinder", "capsules": "capsule", "ellipsoids": "ellipsoid sphere"}
    chosen = {name: [geom for geom in geoms if geom.kind in kinds[name].split()] for name in makers}
    return {name: makers[name](found) for name, found in chosen.items() if found}


def _colours(geoms: Sequence[Geom]) -> Array:
    return np.array([geom.rgba for geom in geoms])


def _quaternions(geoms: Sequence[Geom]) -> Array:
    """Shape (n, 4), x y z w as rerun has them."""
    return np.array([geom.quat for geom in geoms])[:, [1, 2, 3, 0]]


def _boxes(geoms: Sequence[Geom]) -> rr.AsComponents:
    return rr.Boxes3D(
        half_sizes=[geom.size for geom in geoms],
        centers=[geom.pos for geom in geoms],
        quaternions=_quaternions(geoms),
        colors=_colours(geoms),
        fill_mode=FillMode.Solid,
    )


def _cylinders(geoms: Sequence[Geom]) -> rr.AsComponents:
    return rr.Cylinders3D(
        lengths=[2 * geom.size[1] for geom in geoms],
        radii=[geom.size[0] for geom in geoms],
        centers=[geom.pos for geom in geoms],
        quaternions=_quaternions(geoms),
        colors=_colours(geoms),
        fill_mode=FillMode.Solid,
    )


def _capsules(geoms: Sequence[Geom]) -> rr.AsComponents:
    """Rerun's capsules start at their origin, MuJoCo's are centred on it."""
    x, y, z, w = _quaternions(geoms).T
    axes = np.column_stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
    halves = np.array([[geom.size[1]] for geom in geoms])
    return rr.Capsules3D(
        lengths=2 * halves[:, 0],
        radii=[geom.size[0] for geom in geoms],
        translations=np.array([geom.pos for geom in geoms]) - halves * axes,
        quaternions=_quaternions(geoms),
        colors=_colours(geoms),
        fill_mode=FillMode.Solid,
    )


def _ellipsoids(geoms: Sequence[Geom]) -> rr.AsComponents:
    sizes = [geom.size if geom.kind == "ellipsoid" else (geom.size[0],) * 3 for geom in geoms]
    return rr.Ellipsoids3D(
        half_sizes=sizes,
        centers=[geom.pos for geom in geoms],
        quaternions=_quaternions(geoms),
        colors=_colours(geoms),
        fill_mode=FillMode.Solid,
    )
