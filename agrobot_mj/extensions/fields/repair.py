"""Conversion of rings to valid polygons. Invalid rings are repaired, with a note about each repair."""

from collections.abc import Sequence

import numpy as np
import shapely
from shapely import LineString, Polygon

from agrobot_mj.core.signals import Array
from agrobot_mj.paths.imports.cleaning import CLOSEST_M, distinct, outliers, space_out
from agrobot_mj.paths.track import Index

LEAST_M2 = 10.0  # Minimum area of a field [m2]. Assumed value: smaller than a machine.
MOST_POINTS, WITHIN_M = 20_000, 0.02
"""Number of points above which a polygon ring is simplified [-], and tolerance of the simplification [m]."""
SLIVER_M2 = 0.01  # Area below which the loss of a part of a polygon is not reported [m2]
MOST_LOST = 0.05  # Maximum fraction of the area that the repair of a boundary may remove [-]. Assumed value.
SHOWN = 3  # Maximum number of crossings or spikes in a message
MOST_CROSSINGS, SIDES_AT_ONCE = 1000, 100
"""Maximum number of self-crossings of a polygon ring that is repaired, and number of sides that are examined together
[-]."""
FOLD_DEG, SPIKE_DEG = 1.0, 15.0
"""Maximum interior angle of a fold, whose tip is omitted, and of a spike, which is reported [deg]. Assumed values."""
FOLD_M, SPIKE_M = 1.0, 10.0  # Minimum length of the shorter side of a fold and of a spike [m]
MOST_FOLDS = 20  # Maximum number of folds whose tips are omitted from a ring


def boundary_polygon(points: Array) -> tuple[Polygon, list[str]]:
    """Return a valid polygon for the boundary `points`, shape (n, 2) [m], and notes about repairs.

    A boundary that crosses or touches itself is reduced to its largest part. Raise ValueError if the reduction of a
    crossing boundary removes much of the enclosed area, or if the boundary encloses no area.
    """
    parts, crossing, notes = _polygons(points, "boundary")
    found = max(parts, key=lambda each: each.area, default=Polygon())
    crosses = "crosses" in crossing
    whole = float(shapely.union_all([Polygon(part.exterior) for part in parts] if crosses else parts).area)
    lost = whole - found.area
    if crosses and lost > MOST_LOST * whole:
        raise ValueError(f"{crossing}; the largest part covers {found.area:.0f} of {whole:.0f} m2; remove crossings")
    if crossing:
        notes.append(
            f"{crossing} and is repaired" + f", without {lost:.2f} m2 of {whole:.0f} m2" * bool(lost > SLIVER_M2)
        )
    if found.area < LEAST_M2:
        raise ValueError(f"the boundary encloses {found.area:.2g} m2, less than {LEAST_M2:g}; check its coordinates")
    return found, notes


def inner_polygons(points: Array, what: str) -> tuple[list[Polygon], list[str]]:
    """Return all polygons of the inner ring `points`, shape (n, 2) [m], and notes about repairs.

    `what` is the name of the ring in notes and messages. Raise ValueError if the ring encloses no area.
    """
    parts, crossing, notes = _polygons(points, what)
    parts = [part for part in parts if part.area > SLIVER_M2]
    if not parts:
        raise ValueError(f"the {what} does not enclose an area; check its coordinates")
    return parts, [*notes, *([f"{crossing}; all parts are kept"] if crossing else [])]


def _polygons(points: Array, what: str) -> tuple[list[Polygon], str, list[str]]:
    """Return the polygons of a closed line, a text about self-crossings (empty for a valid line), and notes about
    repairs."""
    notes = list[str]()
    kept = _without_repeats(points, what, notes)
    if (far := outliers(points[kept])).size:
        for k in kept[far].tolist():
            away = float(np.hypot(*(points[k] - np.median(points, axis=0))))
            notes.append(
                f"point {k + 1} of the {what} is omitted, because it is {away:.0f} m away from the other points"
            )
        kept = np.delete(kept, far)
    kept = _without_folds(points, kept, what, notes)
    if len(kept) < 3:
        raise ValueError(f"the {what} needs at least 3 different points, got {len(kept)}; add its corners")
    simple = len(kept) > MOST_POINTS
    polygon = Polygon(_simplify(points[kept], what, notes) if simple else points[kept])
    if polygon.is_valid:
        return [polygon], "", notes
    crossing = _crossing(polygon, None if simple else kept, what)
    return polygons_of(shapely.make_valid(polygon)), crossing, notes


def _crossing(polygon: Polygon, numbers: Index | None, what: str) -> str:
    """Return a text with the positions at which a ring crosses or touches itself.

    `numbers` contains the indices of the ring points in the file, or None for a simplified ring. Raises ValueError
    for a ring with more than `MOST_CROSSINGS` crossings.
    """
    corners = shapely.get_coordinates(polygon.exterior)
    sides = shapely.linestrings(np.stack([corners[:-1], corners[1:]], axis=1))
    tree, pairs = shapely.STRtree(sides), list[tuple[int, int]]()
    for start in range(0, len(sides), SIDES_AT_ONCE):
        first, second = tree.query(sides[start : start + SIDES_AT_ONCE], predicate="crosses")
        pairs += [(a, b) for a, b in zip((first + start).tolist(), second.tolist(), strict=True) if a < b]
        if len(pairs) > MOST_CROSSINGS:
            raise ValueError(
                f"the {what} crosses itself at more than {MOST_CROSSINGS} places; sort the points along the {what}, or "
                "record fewer points"
            )
    if not pairs:
        place = shapely.is_valid_reason(polygon).partition("[")[2].rstrip("]").split()
        return f"the {what} touches itself" + (f" at ({float(place[0]):.1f}, {float(place[1]):.1f}) m" if place else "")
    shown = []
    for pair in sorted(pairs)[:SHOWN]:
        at = shapely.intersection(*sides[list(pair)]).centroid
        between = ""
        if numbers is not None:
            ends = (f"{numbers[k] + 1}-{numbers[(k + 1) % len(numbers)] + 1}" for k in pair)
            between = f" between points {' and '.join(ends)}"
        shown.append(f"({at.x:.1f}, {at.y:.1f}) m{between}")
    more = f" and {len(pairs) - SHOWN} other places" if len(pairs) > SHOWN else ""
    return f"the {what} crosses itself at {', '.join(shown)}{more}"


def _simplify(points: Array, what: str, notes: list[str]) -> Array:
    """Return a simplified polygon ring, usually with fewer than `MOST_POINTS` points. Append a note to `notes`."""
    apart = max(WITHIN_M, 4 * float(np.hypot(*np.ptp(points, axis=0))) / MOST_POINTS)
    near = points[space_out(points, apart, closed=True)]
    found = shapely.get_coordinates(LineString(near).simplify(WITHIN_M, preserve_topology=False))
    notes.append(f"the {what} is simplified within {apart:.2g} m, from {len(points)} to {len(found)} points")
    return found if len(found) > 2 else points[:3]


def _without_equal(points: Array, kept: Index) -> Index:
    """Return the indices in `kept` whose ring point differs from the previous kept point. The last points also differ
    from the first point."""
    found: Index = kept[distinct(points[kept])]
    near_start = np.hypot(*(points[found] - points[found[0]]).T) < CLOSEST_M
    return found[: np.flatnonzero(~near_start)[-1] + 1] if not near_start.all() else found[:1]


def _without_repeats(points: Array, what: str, notes: list[str]) -> Index:
    """Return the indices of the ring points without repeated points. A note about repeated points is appended to
    `notes`, except for the last point of a closed ring."""
    closed = len(points) > 1 and np.hypot(*(points[0] - points[-1])) < CLOSEST_M
    kept = np.arange(len(points) - closed)
    if len(kept) < 2:
        return kept
    found = _without_equal(points, kept)
    if repeated := len(kept) - len(found):
        noun, are = ("point", "is") if repeated == 1 else ("points", "are")
        notes.append(f"{repeated} repeated {noun} of the {what} {are} omitted")
    return found


def _without_folds(points: Array, kept: Index, what: str, notes: list[str]) -> Index:
    """Return the indices of ring points without the tips of folds. Append notes about folds and spikes to `notes`."""
    for _ in range(MOST_FOLDS):
        if len(kept) < 4:
            return kept
        angles, sides = _corners(points[kept])
        folds = np.flatnonzero((angles < FOLD_DEG) & (sides > FOLD_M))
        if not len(folds):
            break
        k = int(folds[np.argmax(sides[folds])])
        notes.append(
            f"point {kept[k] + 1} of the {what} is omitted, because the {what} turns back over {sides[k]:.0f} m"
        )
        kept = _without_equal(points, np.delete(kept, k))
    for k in np.flatnonzero((angles < SPIKE_DEG) & (sides > SPIKE_M))[:SHOWN].tolist():
        notes.append(
            f"point {kept[k] + 1} of the {what} is the tip of a spike of {angles[k]:.0f} deg and {sides[k]:.0f} m; "
            "check it"
        )
    return kept


def _corners(ring: Array) -> tuple[Array, Array]:
    """Return the interior angle [deg] and the length of the shorter adjacent side [m] at each point of a polygon ring,
    shape (n,) each."""
    before, after = np.roll(ring, 1, axis=0) - ring, np.roll(ring, -1, axis=0) - ring
    across = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    angles = np.degrees(np.arctan2(np.abs(across), (before * after).sum(axis=1)))
    return angles, np.minimum(np.hypot(*before.T), np.hypot(*after.T))


def polygons_of(geometry: shapely.Geometry) -> list[Polygon]:
    """Return the polygons of a geometry collection. Lines and points are omitted."""
    parts = shapely.get_parts(geometry)
    return [
        each
        for part in parts.tolist()
        if not part.is_empty
        for each in ([part] if isinstance(part, Polygon) else polygons_of(part) if hasattr(part, "geoms") else [])
    ]


def without(boundary: Polygon, inner: Sequence[Polygon], what: str) -> tuple[Polygon, list[Polygon], list[str]]:
    """Subtract inner areas from a boundary. Return the reduced boundary, the inner areas clipped to it, and notes."""
    notes, kept, cut, outside, crossing = list[str](), list[Polygon](), list[Polygon](), 0, 0
    for each in inner:
        if not boundary.intersects(each) or boundary.intersection(each).area < SLIVER_M2:
            outside += 1
            continue
        crossing += not boundary.covers(each)
        kept += polygons_of(boundary.intersection(each))
        cut.append(each)
    if outside:
        notes.append(
            f"{outside} {what}{'s' * (outside > 1)} outside the boundary {'are' if outside > 1 else 'is'} omitted"
        )
    if crossing:
        notes.append(f"{crossing} {what}{'s' * (crossing > 1)} {'are' if crossing > 1 else 'is'} cut at the boundary")
    parts = polygons_of(boundary.difference(shapely.union_all(cut))) if cut else [boundary]
    if max((part.area for part in parts), default=0.0) < LEAST_M2:
        raise ValueError(f"the {what}s cover the whole field; check the file")
    if len(parts) > 1:
        notes.append(f"{what}s divide the field into {len(parts)} parts; only the largest is kept")
    return max(parts, key=lambda part: part.area), kept, notes
