"""Height grid from `Elevation.txt`, the heights that AgOpenGPS and AgOpenWeb record during field work.

A row contains latitude, longitude [deg], height of the ground [m] and quality of the fix. The surface is a bicubic
P-spline [Eilers1996] with a thin-plate penalty, which halves waves of the length `WAVE_M`. Weights of a Cauchy
distribution reduce the influence of outliers, which are then omitted. A gradient penalty reduces the slope beyond the
points to a fraction 1/e within `FADE_M`.

The grid has cells of `CELL_M` and extends `MARGIN_M` beyond the points. Coordinates are metres east and north of the
start fix in the file.
"""

from functools import lru_cache
from itertools import pairwise
from math import pi, sqrt
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from agrobot_mj.core.geodesy import Origin, local_points
from agrobot_mj.core.resources import Stamp, refuse
from agrobot_mj.core.signals import Array
from agrobot_mj.terrain.grid import Ground

RTK = 4  # Quality of a fix with fixed ambiguities in GGA messages
CELL_M, MARGIN_M, MOST_CELLS = 2.0, 200.0, 400_000
"""Cell size [m] and distance from the points to the edge of the grid [m], and number of cells above which the cell size
is increased [-]. Assumed values."""
KNOT_M, MOST_KNOTS = 10.0, 30_000
"""Distance between the knots of the spline [m], and number of knots above which this distance is increased [-]."""
WAVE_M, FADE_M = 20.0, 200.0
"""Wavelength at which the spline halves the relief, and distance beyond the points within which the slope fades [m].
Assumed values (ranges 10-40, 100-500)."""
FAR_M = 5000.0  # Maximum distance of a point from the median point [m]
OUTLYING, LEAST_M, CAUCHY, ROUNDS = 5.0, 0.3, 2.385, 5
"""Minimum residual of an outlier divided by the standard deviation [-], and in metres; scale of the Cauchy weights
for an efficiency of 95 %, and number of weighted fits [-]."""
FINEST_M = 0.1  # Minimum standard deviation in the Cauchy weights [m], above which a narrow bank is an outlier
MOST_AT_ONCE = 100_000  # Maximum number of points that are evaluated together, to limit the use of memory
FEWEST, NARROWEST_M = 10, 3.0
"""Minimum number of points [-], and minimum rms extent of the points across their main direction [m]."""
HEADS = ("latitude", "longitude", "elevation")  # Names of the first columns, in the row above the points


class Elevation(NamedTuple):
    """Ground fitted to recorded points."""

    ground: Ground  # Ground whose coordinates are east and north of the start fix [m]
    origin: Origin  # Start fix of the file
    points: Array  # Points with measured heights, east and north of the start fix [m], shape (n, 2)
    notes: tuple[str, ...]  # Sentence about the omitted rows and about the grid


@lru_cache(maxsize=4)
def read_elevation(stamp: Stamp) -> Elevation:
    """Return the height grid of an Elevation.txt. Raise ValueError for an invalid file."""
    path = Path(stamp[0])
    try:
        lines = path.read_text(encoding="utf-8-sig", errors="replace").splitlines()
        first = next((k for k, line in enumerate(lines) if _is_title(line)), None)
        if first is None:
            raise ValueError("the file has no row Latitude,Longitude,Elevation,Quality; specify an Elevation.txt")
        origin = _start_fix(lines[:first])
        rows, damaged = _rows(lines[first + 1 :])
        return _fit(origin, rows, damaged)
    except (ValueError, OSError) as error:
        refuse(path, str(error))


def _is_title(line: str) -> bool:
    return tuple(cell.strip().lower() for cell in line.split(",")[:3]) == HEADS


def _start_fix(head: list[str]) -> Origin:
    """Return the start fix in the rows above the points: rows StartLat and StartLon, or the row after StartFix."""
    words = [line.strip().split(",") for line in head]
    named = {line[0]: line[1] for line in words if len(line) == 2 and line[0] in ("StartLat", "StartLon")}
    after = next((line for before, line in pairwise(words) if before == ["StartFix"]), [])
    try:
        latitude, longitude = (float(cell) for cell in (list(named.values()) or after))
    except ValueError:
        raise ValueError("the file has no StartFix with latitude and longitude; record it again") from None
    if not (abs(latitude) <= 90 and abs(longitude) <= 180):
        raise ValueError(f"the StartFix ({latitude:g}, {longitude:g}) deg is not on the Earth; record it again")
    return Origin(latitude, longitude)


def _rows(lines: list[str]) -> tuple[Array, int]:
    """Return latitude, longitude [deg], height [m] and quality of each row, shape (n, 4), and the number of damaged
    rows. Later columns may contain thousands separators and are ignored."""
    lines = [line for line in lines if line.strip()]
    try:
        rows = np.loadtxt(lines or [",,,"], delimiter=",", usecols=range(4), ndmin=2, comments=None)
    except ValueError:
        rows = np.array([row for line in lines if (row := _numbers(line))]).reshape(-1, 4)
    latitude, longitude, height, _ = rows.T
    on_earth = (np.abs(latitude) <= 90) & (np.abs(longitude) <= 180) & ((latitude != 0) | (longitude != 0))
    good = rows[on_earth & (np.abs(height) < 10_000)]
    if not len(good):
        raise ValueError(
            "the file has no rows with latitude, longitude, height [m] and quality; write decimal points, and record "
            "the heights again if the file is empty"
        )
    return good, len(lines) - len(good)


def _numbers(line: str) -> list[float]:
    """Return the first four numbers of a row, or an empty list for a damaged row."""
    cells = line.split(",", 4)[:4]
    try:
        return [float(cell) for cell in cells] if len(cells) == 4 else []
    except ValueError:
        return []


def _fit(origin: Origin, rows: Array, damaged: int) -> Elevation:
    """Return the height grid through the points with an RTK fix. Raise ValueError if there are too few points."""
    fixed = rows[rows[:, 3] == RTK]
    if len(fixed) < FEWEST:
        raise ValueError(
            f"the file has {len(fixed)} of {len(rows)} points with an RTK fix (quality {RTK}), fewer than {FEWEST}; "
            "record the heights with an RTK fix"
        )
    points, heights = local_points(origin, fixed[:, 0], fixed[:, 1]), fixed[:, 2]
    near = np.hypot(*(points - np.median(points, axis=0)).T) < FAR_M
    points, heights = points[near], heights[near]
    if len(points) < FEWEST:
        raise ValueError(f"the points are more than {FAR_M / 1000:g} km away from their median; remove distant points")
    if np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[1] < NARROWEST_M * sqrt(len(points)):
        raise ValueError("the points are on one line, so the slope across is unknown; record several passes")
    grid, good = interpolate(points, heights)
    omitted = {
        "damaged": damaged,
        "without an RTK fix": len(rows) - len(fixed),
        f"more than {FAR_M / 1000:g} km away": len(near) - len(points),
        "outliers": len(points) - int(good.sum()),
    }
    left = ", ".join(f"{count} {reason}" for reason, count in omitted.items() if count)
    note = f"heights are interpolated from {good.sum()} of {damaged + len(rows)} points" + f" ({left})" * bool(left)
    return Elevation(grid, origin, points[good], (f"{note}, with a cell size of {grid.spacing:.3g} m",))


def interpolate(points: Array, heights: Array) -> tuple[Ground, "np.ndarray[Any, np.dtype[np.bool_]]"]:
    """Fit the ground to points of shape (n, 2) [m] with `heights` [m]. Return the ground, and a mask (n,) that is False
    for outliers."""
    surface, good = _surface(points, heights)
    low, high = points.min(axis=0) - MARGIN_M, points.max(axis=0) + MARGIN_M
    cell = max(CELL_M, sqrt(float(np.prod(high - low)) / MOST_CELLS))
    x, y = (np.arange(a, b + cell, cell) for a, b in zip(low, high, strict=True))
    return Ground(float(x[0]), float(y[0]), cell, surface.grid(x, y)), good


class _Spline(NamedTuple):
    """Bicubic spline with equidistant knots."""

    low: Array  # First knot in each direction [m], shape (2,)
    knot: float  # Distance between knots [m]
    values: Array  # Coefficients [m], shape (columns, rows)

    def weights(self, x: Array, axis: int) -> Any:
        """Return the sparse matrix of the basis functions at the coordinates `x` along an axis."""
        from scipy.interpolate import BSpline

        count = self.values.shape[axis]
        return BSpline.design_matrix(x, self.low[axis] + self.knot * np.arange(-3, count + 1), 3)

    def at(self, points: Array) -> Array:
        """Return the heights at points of shape (n, 2) [m]."""
        parts = [points[k : k + MOST_AT_ONCE] for k in range(0, len(points), MOST_AT_ONCE)]
        return np.concatenate([self.basis(part) @ self.values.ravel() for part in parts])

    def basis(self, points: Array) -> Any:
        """Return the sparse matrix of the basis functions at points of shape (n, 2) [m], with a row for each point."""
        from scipy.sparse import csr_array

        x, y = (self.weights(points[:, axis], axis) for axis in (0, 1))
        count = len(points)
        a, b = (part.data.reshape(count, 4) for part in (x, y))
        i, j = (part.indices.reshape(count, 4).astype(np.int64) for part in (x, y))
        columns = (i[:, :, None] * self.values.shape[1] + j[:, None, :]).ravel()
        data, ends = (a[:, :, None] * b[:, None, :]).ravel(), 16 * np.arange(count + 1)
        return csr_array((data, columns, ends), shape=(count, self.values.size))

    def grid(self, x: Array, y: Array) -> Array:
        """Return the heights at the nodes with the coordinates `x` and `y` [m], shape (rows, columns)."""
        found: Array = np.ascontiguousarray(self.weights(y, 1) @ (self.weights(x, 0) @ self.values).T)
        return found


def _surface(points: Array, heights: Array) -> tuple[_Spline, "np.ndarray[Any, np.dtype[np.bool_]]"]:
    """Fit a spline to `heights` [m] at points of shape (n, 2) [m]. Return the spline, and a mask (n,) that is False for
    outliers."""
    middle = float(np.median(heights))
    places, values = _cell_medians(points, heights - middle)
    low, high = points.min(axis=0) - MARGIN_M - KNOT_M, points.max(axis=0) + MARGIN_M + KNOT_M
    knot = max(KNOT_M, sqrt(float(np.prod(high - low)) / MOST_KNOTS))
    shape = tuple((np.ceil((high - low) / knot) + 3).astype(int).tolist())
    spline = _Spline(low, knot, np.zeros(shape))
    basis = spline.basis(places)
    stiffness = _stiffness(shape, knot, places)
    weights = np.ones(len(places))
    for _ in range(ROUNDS):
        found = _solve(basis, weights, values, stiffness)
        residuals = np.abs(values - basis @ found)
        spread = max(1.4826 * float(np.median(residuals)), FINEST_M)
        weights = 1 / (1 + (residuals / (CAUCHY * spread)) ** 2)
    limit = max(OUTLYING * spread, LEAST_M)
    found = _solve(basis, (residuals < limit).astype(float), values, stiffness)
    spline = spline._replace(values=middle + found.reshape(shape))
    return spline, np.abs(heights - spline.at(points)) < limit


def _cell_medians(points: Array, heights: Array) -> tuple[Array, Array]:
    """Return the mean positions, shape (m, 2), and median heights of the points in each cell of the size CELL_M."""
    cells = np.floor(points / CELL_M).astype(np.int64)
    _, number = np.unique(cells[:, 0] * 2**32 + cells[:, 1], return_inverse=True)
    order = np.lexsort((heights, number))
    counts = np.bincount(number)
    ends = np.cumsum(counts)
    low, high = order[ends - counts + (counts - 1) // 2], order[ends - counts + counts // 2]
    places = np.column_stack([np.bincount(number, points[:, axis]) / counts for axis in (0, 1)])
    return places, (heights[low] + heights[high]) / 2


def _stiffness(shape: tuple[int, ...], knot: float, places: Array) -> Any:
    """Return the matrix of the penalties on bending and gradient, for points with the positions `places` [m]."""
    from scipy.sparse import diags_array, eye_array, kron

    def differences(count: int, order: int) -> Any:
        signs = ((-1.0, 1.0), (1.0, -2.0, 1.0))[order - 1]
        return diags_array(signs, offsets=range(order + 1), shape=(count - order, count))

    (nx, ny), (ix, iy) = shape, (eye_array(n) for n in shape)
    first = [kron(differences(nx, 1), iy), kron(ix, differences(ny, 1))]
    second = [
        (kron(differences(nx, 2), iy), 1.0),
        (kron(ix, differences(ny, 2)), 1.0),
        (kron(differences(nx, 1), differences(ny, 1)), 2.0),
    ]
    blocks = len(np.unique(np.floor(places / WAVE_M), axis=0))
    stiff = (WAVE_M / (2 * pi)) ** 4 * len(places) / (blocks * WAVE_M**2)
    bending = sum(factor * (matrix.T @ matrix) for matrix, factor in second) / knot**2
    return stiff * (bending + sum(matrix.T @ matrix for matrix in first) / FADE_M**2)


def _solve(basis: Any, weights: Array, values: Array, stiffness: Any) -> Array:
    """Return the coefficients that minimise the weighted squares of the residuals plus the penalty."""
    from scipy.sparse import csc_array, diags_array
    from scipy.sparse.linalg import splu

    scaled = diags_array(weights) @ basis
    solver = splu(
        csc_array(basis.T @ scaled + stiffness), "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )
    found: Array = solver.solve(scaled.T @ values)
    return found
