"""Description of a field: area, perimeter, slope, sharp corners and map."""

from collections.abc import Iterator, Mapping
from math import ceil, degrees
from typing import Any

import numpy as np
import shapely
from matplotlib.figure import Figure
from shapely import Polygon

from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.palette import BLACK, BLUE, GREEN, LIGHT_GREY, ORANGE, VERMILION
from agrobot_mj.core.signals import Array
from agrobot_mj.extensions.fields.field import Field
from agrobot_mj.extensions.fields.slope import Relief, slope_numbers, slope_text

SHARP_DEG = 60.0
"""Minimum change of direction at a sharp corner [deg]. Assumed value: headland laps cannot follow sharper corners."""
CORNER_M = 1.0  # Tolerance for the simplification of a boundary before sharp corners are counted [m]
INTERVALS_M = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)  # Possible height intervals of contour lines [m]
MOST_CONTOURS = 12  # Number of contour lines above which the next larger interval is used
SIDE_IN = 5.0  # Length of the longer side of a field map [in]


def field_description(field: Field, relief: Relief | None = None) -> dict[str, Any]:
    """Return area, perimeter, slope, sharp corners, geographic position and repairs of a field as JSON values."""
    corners = [corner for ring in _rings(field.boundary) for corner in _sharp(ring)]
    return {
        "field": field.name,
        "area_m2": field.boundary.area,
        "perimeter_m": field.boundary.exterior.length,
        "holes": len(field.boundary.interiors),
        "obstacles": len(field.obstacles),
        "headland_m2": field.headland and field.boundary.area - field.headland.intersection(field.boundary).area,
        "slope": relief and slope_numbers(relief),
        "sharp_corners": [{"x_m": x, "y_m": y, "turn_deg": turn} for x, y, turn in corners],
        "crs": field.crs,
        "origin": field.plane and list(field.plane),
        "shift_m": list(field.shift),
        "notes": list(field.notes),
    }


def lines_of(content: Mapping[str, Any]) -> list[str]:
    """Return the field description `content`, a result of `field_description`, as lines of text."""
    corners, plural = content["sharp_corners"], "s" * (content["holes"] != 1)
    first = f"{content['field']}: {content['area_m2'] / 1e4:.4g} ha, perimeter {content['perimeter_m']:.0f} m"
    inner = f"{content['holes']} hole{plural}" if content["holes"] else ""
    shown = [first + (f", {inner}" if inner else "")]
    if content["slope"]:
        shown += [slope_text(content["slope"]), *content["slope"]["notes"]]
    if corners:
        tightest = max(corners, key=lambda corner: abs(corner["turn_deg"]))
        place = f"({tightest['x_m']:.1f}, {tightest['y_m']:.1f}) m"
        many = f"{len(corners)} sharp corners of up to" if len(corners) > 1 else "1 sharp corner of"
        shown.append(f"{many} {abs(tightest['turn_deg']):.0f} deg at {place}")
    if content["headland_m2"] is not None:
        shown.append(f"headland of {content['headland_m2'] / 1e4:.3g} ha")
    if content["origin"]:
        latitude, longitude = content["origin"]
        shown.append(
            f"origin {abs(latitude):.7f} {'NS'[latitude < 0]}, {abs(longitude):.7f} {'EW'[longitude < 0]} [deg]"
        )
    return [*shown, *(f"problem: {note}" for note in content["notes"])]


def _rings(polygon: Polygon) -> Iterator[Array]:
    for ring in (polygon.exterior, *polygon.interiors):
        yield shapely.get_coordinates(ring)


def _sharp(ring: Array) -> Iterator[tuple[float, float, float]]:
    """Yield each sharp corner of a polygon ring: x [m], y [m] and change of direction [deg], positive to the left."""
    points = shapely.get_coordinates(Polygon(ring).simplify(CORNER_M).exterior)
    legs = np.diff(points, axis=0)
    yaws = np.arctan2(legs[:, 1], legs[:, 0]).tolist()
    for (x, y), before, after in zip(points[:-1].tolist(), [yaws[-1], *yaws[:-1]], yaws, strict=True):
        turn = degrees(wrap(after - before))
        if abs(turn) > SHARP_DEG:
            yield x, y, turn


def draw_field(field: Field, relief: Relief | None = None) -> Figure:
    """Draw the map of a field: boundary, holes, obstacles, headland, sharp corners and contour lines."""
    west, south, east, north = field.boundary.bounds
    scale = SIDE_IN / max(east - west, north - south)
    figure = Figure(figsize=(max(scale * (east - west), 2.5) + 1.0, max(scale * (north - south), 1.5) + 1.0))
    figure.set_layout_engine("constrained")
    axes = figure.subplots()
    for k, ring in enumerate(_rings(field.boundary)):
        axes.fill(*ring.T, facecolor="white" if k else (LIGHT_GREY, 0.4), edgecolor=BLACK, linewidth=1.0)
    axes.plot([], [], color=BLACK, label="boundary")
    for k, obstacle in enumerate(field.obstacles):
        axes.fill(*obstacle.exterior.xy, color=VERMILION, alpha=0.6, label=None if k else "obstacle")
    if field.headland is not None:
        axes.plot(*field.headland.exterior.xy, color=BLUE, linestyle="--", label="headland")
    if relief is not None:
        _draw_contours(axes, relief)
    if corners := [corner for ring in _rings(field.boundary) for corner in _sharp(ring)]:
        x, y, _ = np.transpose(corners)
        axes.plot(x, y, "o", color=ORANGE, markersize=4, label=f"corner of more than {SHARP_DEG:.0f} deg")
    axes.set_aspect("equal")
    axes.use_sticky_edges = False
    axes.margins(0.03)
    axes.set_xlabel("east [m]")
    axes.set_ylabel("north [m]")
    axes.set_title(f"{field.name}: {field.boundary.area / 1e4:.4g} ha")
    figure.legend(loc="outside lower center", ncols=4)
    return figure


def _draw_contours(axes: Any, relief: Relief) -> None:
    """Draw labelled contour lines of the heights of a field, if the ground is not level."""
    low, high = np.nanmin(relief.heights), np.nanmax(relief.heights)
    interval = next((step for step in INTERVALS_M if high - low <= MOST_CONTOURS * step), INTERVALS_M[-1])
    levels = np.arange(ceil(low / interval), high / interval) * interval
    if len(levels) and high - low > INTERVALS_M[0]:
        lines = axes.contour(relief.x, relief.y, relief.heights, levels, colors=GREEN, linewidths=0.7)
        axes.clabel(lines, fontsize=6, fmt="%g")
        axes.plot([], [], color=GREEN, linewidth=0.7, label=f"height, every {interval:g} m")
