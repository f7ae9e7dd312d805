"""Report page of field work: coverage summary, map and results, followed by the report of the run."""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from agrobot_mj.core.geodesy import Origin, to_local
from agrobot_mj.core.palette import BLACK, ORANGE, VERMILION
from agrobot_mj.core.signals import Array
from agrobot_mj.studies.pages.document import SHADE, Chart, Document, layout
from agrobot_mj.studies.pages.drive import MOST_POINTS, line, read_signals, run_page
from agrobot_mj.studies.pages.report import Reports

SMALLEST_M2 = 0.01  # Area below which a gap or an overlap is not drawn in the report [m2]
COLOURS = {"worked": SHADE, "overlapped": ORANGE, "missed": VERMILION}
SHARES = ("worked at least once", "missed", "overlapped", "covered, with overlaps")
EFFORT = (
    ("energy_wheels_mj", "energy at the driven wheels", "MJ"),
    ("energy_ground_mj", "energy of the wheel forces on the ground", "MJ"),
    ("slip_median_percent", "median slip", "%"),
    ("rut_depth_max_m", "maximum depth of ruts", "m"),
)
"""Key, label and unit of each effort quantity in the results table."""
TOLERANCES_M = (0.02, 0.05, 0.1, 0.2, 0.5)  # Maximum deviations of the simplified track in the map [m]
HEAD = 2  # Number of elements that precede the coverage section of a page: title and facts


def field_page(folder: Path) -> Document:
    """Return the report page of field work: coverage, followed by the report of the run."""
    found = json.loads((folder / "coverage.json").read_text("utf-8"))
    page = run_page(folder)
    run = page.parts[HEAD:]
    del page.parts[HEAD:]
    page.section("Coverage", f"{found['summary']}.")
    page.remarks(found["plan_warnings"])
    page.grid([("Map", _map(folder, found))])
    page.table(("part", "area [m2]", *(f"{name} [%]" for name in SHARES)), _areas(found))
    page.table(("quantity", "value", "unit"), _numbers(found))
    page.parts += run
    return page


def _areas(found: Mapping[str, Any]) -> Iterator[tuple[object, ...]]:
    for name, part in found["areas"].items():
        overlapped, missed = (round(part[f"{key}_percent"], 2) for key in ("overlapped", "missed"))
        worked = round(100 - missed, 2)
        yield name, round(part["area_m2"], 1), worked, missed, overlapped, round(worked + overlapped, 2)


def _numbers(found: Mapping[str, Any]) -> Iterator[tuple[str, object, str]]:
    turns, capacity, accuracy = found["turns"], found["capacity"], found["accuracy"]
    for gap in found["gaps"]:
        yield f"missed in the {gap['place']}", round(gap["area_m2"], 2), "m2"
    for name, out in found["excursions"].items():
        at = f" at ({out['x']:z.0f}, {out['y']:z.0f}) m" if "x" in out else ""
        yield f"{name} outside the boundary{at}", round(out["largest_m"], 3), "m"
        yield f"area of the {name} outside the boundary", round(out["area_m2"], 2), "m2"
    yield "pass-to-pass error at the implement, 95th percentile", _round_or_blank(accuracy["pass_to_pass_p95_m"]), "m"
    yield "planned overlap of the field", round(found["planned"]["field"]["overlapped_percent"], 2), "%"
    for name, text, unit in EFFORT:
        if found["effort"][name] is not None:
            yield text, round(found["effort"][name], 3), unit
    if rows := found.get("crop_rows"):
        yield "crop rows", round(rows["rows_m"], 1), "m"
        yield "crop rows run over outside the tramlines", round(rows["run_over_m"], 2), "m"
    for name, value in found.get("cost", {}).items():
        yield f"cost, {name}", round(value, 2), "-"
    yield "distance", round(found["distance_m"], 1), "m"
    yield "working distance", round(found["working_distance_m"], 1), "m"
    yield "time", round(found["time_s"], 1), "s"
    yield "turns", turns["count"], "-"
    if turns["count"]:
        yield "median duration of a turn", round(turns["median_s"], 1), "s"
        yield "maximum swept width of a turn", round(turns["swept_width_max_m"], 2), "m"
        yield "peak steering angle in turns", round(turns["peak_steer_deg"], 1), "deg"
    yield "effective field capacity", round(capacity["effective_ha_h"], 3), "ha/h"
    yield "theoretical field capacity", round(capacity["theoretical_ha_h"], 3), "ha/h"
    yield "field efficiency", round(capacity["field_efficiency"], 3), "-"


def _round_or_blank(value: float | None) -> object:
    return "" if value is None else round(value, 4)


def _map(folder: Path, found: Mapping[str, Any]) -> Chart:
    origin = found["origin"] and Origin(*found["origin"])
    shapes = json.loads((folder / "coverage.geojson").read_text("utf-8"))["features"]
    signals = read_signals(folder)
    data = []
    for kind, colour in COLOURS.items():
        x, y = _outline([each for each in shapes if each["properties"]["kind"] == kind], origin)
        data.append({**_filled_trace(x, y, colour), "name": kind})
    data.append(line(*_simplified_track(signals["x"], signals["y"]), "track", BLACK, width=0.7))
    x, y = _outline([each for each in shapes if each["properties"]["kind"] == "field"], origin)
    outline = {"type": "scatter", "mode": "lines", "x": x, "y": y, "name": "boundary"}
    data.append({**outline, "line": {"color": BLACK, "width": 2}})
    return {"data": data, "layout": layout("east [m]", "north [m]", yaxis={"scaleanchor": "x"})}


def _simplified_track(x: Array, y: Array) -> tuple[Array, Array]:
    """Return the points of a track, simplified with the smallest of several tolerances that gives at most `MOST_POINTS`
    points."""
    known = np.isfinite(x) & np.isfinite(y)
    track = shapely.LineString(np.column_stack([x[known], y[known]])) if known.sum() > 1 else shapely.LineString()
    points = np.empty((0, 2))
    for tolerance in TOLERANCES_M:
        points = shapely.get_coordinates(track.simplify(tolerance))
        if len(points) <= MOST_POINTS:
            break
    return points[:, 0], points[:, 1]


def _filled_trace(x: list[float | None], y: list[float | None], colour: str) -> dict[str, Any]:
    style = {"type": "scatter", "mode": "lines", "fill": "toself", "fillcolor": colour, "hoverinfo": "skip"}
    return {**style, "x": x, "y": y, "line": {"width": 0, "color": colour}}


def _outline(features: list[dict[str, Any]], origin: Origin | None) -> tuple[list[float | None], list[float | None]]:
    """Return the x and y coordinates of all polygon rings in `features` [m], with None as separator between rings."""
    x: list[float | None] = []
    y: list[float | None] = []
    for ring in (ring for each in features for ring in _rings(each["geometry"])):
        points = np.array(ring)[:, :2]
        if origin is not None:
            points = np.array([to_local(origin, latitude, longitude) for longitude, latitude in points.tolist()])
        if _area(points) > SMALLEST_M2:
            x += [*points[:, 0].round(2).tolist(), None]
            y += [*points[:, 1].round(2).tolist(), None]
    return x, y


def _rings(geometry: Mapping[str, Any]) -> Iterator[list[list[float]]]:
    if geometry["type"] == "Polygon":
        yield from geometry["coordinates"]
    elif geometry["type"] == "MultiPolygon":
        for polygon in geometry["coordinates"]:
            yield from polygon
    for part in geometry.get("geometries", ()):
        yield from _rings(part)


def _area(ring: "np.ndarray[Any, np.dtype[np.float64]]") -> float:
    x, y = (ring - ring[0]).T
    return abs(float(np.dot(x[:-1], y[1:]) - np.dot(x[1:], y[:-1]))) / 2


REPORTS = Reports({"coverage.json": field_page})
