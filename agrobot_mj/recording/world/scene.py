"""What does not move: the ground, the reference path, and the shape of each body in the body's own frame.

A body's geoms go into one entity a shape, so that the 64 lugs of the wheels cost no more than one.
"""

from collections.abc import Sequence
from math import ceil

import numpy as np
import rerun as rr
from rerun.components import FillMode

from agrobot_mj.core.signals import TICK_S, Array
from agrobot_mj.paths import sample
from agrobot_mj.plants.scene import Geom, Scene
from agrobot_mj.recording.world.contours import ENTITY as CONTOURS
from agrobot_mj.recording.world.contours import contour_lines
from agrobot_mj.recording.world.ground import ROUGH_LIFT_M, ground_mesh, on_ground, smooth_corners
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.terrain import Ground

PATH_COLOUR, PATH_LIFT_M = 0xE8E8E8FF, 0.01
"""Lines are lifted above the ground, each to its own height, so that none hides in it or in another [m]."""
PATH_WIDTH = rr.Radius.ui_points(1.0)
"""Widths are those on the screen, so that lines are visible from near and far."""
PATH_STEP_M, ROUGH_PATH_STEP_M, MOST_PATH_POINTS = 0.25, 0.1, 20_000
"""Between points of the reference on a plane, and where the line must follow the relief [m]; how many there may be."""


def send_scene(stream: rr.RecordingStream, scene: Scene, ground: Ground, reference: Array) -> None:
    """Log everything static; `reference` is what `reference_line` returns."""
    stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    stream.log("world/ground", ground_mesh(ground, reference[:, :2]), static=True)
    lines = contour_lines(smooth_corners(ground, reference[:, :2]), 0.0 if ground.is_plane else ROUGH_LIFT_M)
    if lines is not None:
        stream.log(CONTOURS, lines, static=True)
    stream.log("world/path", rr.LineStrips3D([reference], colors=PATH_COLOUR, radii=PATH_WIDTH), static=True)
    for body in scene.bodies:
        for kind, shape in shapes([geom for geom in scene.geoms if geom.body == body]).items():
            stream.log(f"world/bodies/{body}/{kind}", shape, static=True)


def reference_line(scenario: Scenario, ground: Ground) -> Array:
    """The reference over the whole run, shape (n, 3) [m]."""
    duration, step = scenario.ticks * TICK_S, PATH_STEP_M if ground.is_plane else ROUGH_PATH_STEP_M
    count = min(ceil(duration * scenario.path.speed_m_s / step), scenario.ticks, MOST_PATH_POINTS)
    times = np.linspace(0.0, duration, max(count, 1) + 1)
    return on_ground(ground, sample(scenario.path, times), PATH_LIFT_M)


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
